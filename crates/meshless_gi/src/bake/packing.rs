//! Fifth stage: rows as a frame reads them, and everything else that follows from points and rows.

use super::closed_form::rescale_rows;
use super::context::{BakeContext, StageCost};
use super::fmm::Octree;
use super::point_set::PointSet;
use super::survey::Survey;
use super::transport_stage::{BasisCounts, Transport};
use super::{BakeError, BakeStage, SkyModel, materials, occluders, sky};
use crate::asset::{
    DynamicMaterials, FlatBasis, LightSamples, Occluders, PointSurface, Probes, SkyVisibility,
};
use crate::basis::Weights;
use crate::samples::Point;
use crate::transport::pca::Compression;
use crate::transport::{Operator, PackSettings, RawRow, assign_tiers, pack};
use glam::Vec3;
use std::ops::Range;
use std::time::Instant;

/// Result of the stage. [`SceneData`](crate::asset::SceneData) documents the other fields.
pub(super) struct Packed {
    pub linked: LinkedPoints,
    pub surfaces: Vec<PointSurface>,
    pub light_samples: LightSamples,
    pub materials: Option<DynamicMaterials>,
    pub sky: Option<SkyVisibility>,
    pub probes: Option<Probes>,
    pub occluders: Option<Occluders>,
    pub display: FlatBasis,
    /// Rows of all points in full precision.
    pub rows: Vec<RawRow>,
    /// Fraction of each point's hemisphere that has no sender.
    pub missed: Vec<f32>,
    pub facts: RowFacts,
}

/// Points and the operator between them: what a bounce of light reads, without the surfaces.
/// [`SceneData`](crate::asset::SceneData) documents the fields.
pub(super) struct LinkedPoints {
    pub points: Vec<Point>,
    pub level_starts: Vec<u32>,
    pub sender_levels: u32,
    pub pull: Weights,
    pub parents: Weights,
    pub operator: Operator,
}

impl LinkedPoints {
    /// Returns the points of level `l`.
    pub fn level(&self, l: usize) -> Range<usize> {
        self.level_starts[l] as usize..self.level_starts[l + 1] as usize
    }

    /// Returns the number of senders without the sky.
    pub fn senders(&self) -> usize {
        self.level_starts[self.sender_levels as usize] as usize
    }

    /// Returns the senders of the finest sender level.
    pub fn finest_senders(&self) -> Range<usize> {
        self.level(self.sender_levels as usize - 1)
    }

    /// Returns `true` if a point has a row.
    pub fn has_links(&self) -> bool {
        self.operator.rows.iter().any(|row| row.tier != 0)
    }
}

/// Facts about the rows that the scene itself does not show. [`BakeStats`](super::BakeStats)
/// documents them.
pub(super) struct RowFacts {
    pub gather_rays: u64,
    pub gathered: u64,
    pub gather_share: f64,
    pub uncovered: f64,
    pub largest_row_sum: f32,
    pub link_error: f32,
    pub truncated_levels: Vec<u64>,
    pub basis: BasisCounts,
    pub probes_lost: f64,
    pub probe_seconds: f64,
}

/// Packs the rows, with the sky visibility of the octree if it replaces them.
pub(super) fn pack_rows(
    context: &BakeContext<'_>,
    survey: &Survey,
    transport: Transport,
    octree: Option<&Octree>,
) -> Result<(Packed, StageCost), BakeError> {
    let began = Instant::now();
    context.report(BakeStage::Packing, 0.0)?;
    let source = context.source;
    let settings = &survey.settings;
    let Transport {
        points,
        rows: mut refined,
        method,
        flat,
    } = transport;
    let (training, bases) = method.into_parts();
    let (probes, precision) = training.map_or_else(Default::default, |t| (t.probes, t.precision));
    let basis = (bases.as_ref()).map_or_else(BasisCounts::default, |bases| bases.counts);
    let compression = bases.map(|bases| bases.compression);
    let visible_sky = octree.and_then(|octree| octree.sky.as_ref());
    let visible_sky = visible_sky.unwrap_or(&refined.sky);
    let surfaces = sender_surfaces(&points, visible_sky, settings.sender_levels as usize);
    let hierarchy = points.hierarchy;
    let starts = &hierarchy.level_starts;
    let senders = starts[settings.sender_levels as usize] as usize;
    let form = survey.method.form();
    let tiers = assign_tiers(&refined.rows, starts, &points.parents, form);
    let columns = compression
        .as_ref()
        .map_or(senders, Compression::components);
    let rows = &mut refined.rows;
    let (sky_terms, sky_rays) = sky::terms(source.geometry, &hierarchy, rows, columns, settings);
    let pack_settings = PackSettings {
        form,
        senders: columns,
        points: &flat.points,
        link_step: settings.link_step,
        precision: &precision,
    };
    let (rows, sky) = (&refined.rows, &refined.sky);
    let mut packed = pack(rows, &tiers, sky, &sky_terms, &pack_settings);
    packed.operator.compression = compression;
    let (samples, pull) = (points.light_samples, points.pull);
    let (materials, material_rays) = match settings.dynamic_materials {
        true => materials::cover(source.geometry, &hierarchy, &samples, &pull),
        false => (None, 0),
    };
    let probe_terms = probes.as_ref().map_or(&[][..], |probes| &probes.occluded);
    let occluders = occluders::index_terms(&source.occluders, &packed.link_terms, probe_terms)?;
    let facts = RowFacts {
        gather_rays: refined.rays,
        gathered: refined.gathered,
        gather_share: refined.gather_share,
        uncovered: refined.uncovered,
        largest_row_sum: refined.largest_row_sum,
        link_error: packed.error,
        truncated_levels: hierarchy.truncated.iter().map(|&l| l as u64).collect(),
        basis,
        probes_lost: probes.as_ref().map_or(0.0, |probes| probes.lost),
        probe_seconds: probes.as_ref().map_or(0.0, |probes| probes.seconds),
    };
    let sky_visibility = (settings.sky == SkyModel::Harmonics)
        .then(|| sky::visibility(&sky_terms[..senders], &hierarchy.surfaces));
    let radius = flat.radius();
    let mut linked = LinkedPoints {
        points: flat.points,
        level_starts: hierarchy.level_starts,
        sender_levels: settings.sender_levels,
        pull,
        parents: points.parents,
        operator: packed.operator,
    };
    rescale_rows(&mut linked, &refined.missed);
    let packed = Packed {
        linked,
        surfaces,
        light_samples: samples,
        materials,
        sky: sky_visibility,
        probes: probes.map(|baked| baked.probes),
        occluders,
        display: FlatBasis {
            radius,
            planes: flat.planes,
            grid: flat.grid,
        },
        rows: refined.rows,
        missed: refined.missed,
        facts,
    };
    Ok((packed, StageCost::new(began, sky_rays + material_rays)))
}

/// Computes the surfaces of all points. Coarse senders get the mean albedo of their part of the
/// surface, not the albedo at their own point.
fn sender_surfaces(points: &PointSet, sky: &[Vec3], sender_levels: usize) -> Vec<PointSurface> {
    let hierarchy = &points.hierarchy;
    let mut surfaces: Vec<PointSurface> = hierarchy
        .surfaces
        .iter()
        .zip(sky)
        .map(|(s, sky)| PointSurface {
            albedo: s.albedo.to_array(),
            emission: s.emission.to_array(),
            sky: sky.to_array(),
            ..PointSurface::default()
        })
        .collect();
    for level in (0..sender_levels).rev() {
        for k in hierarchy.level(level) {
            let row = points.pull.row(k);
            if !row.is_empty() {
                let mean: Vec3 = row
                    .iter()
                    .map(|w| w.weight * Vec3::from_array(surfaces[w.index as usize].albedo))
                    .sum();
                surfaces[k].albedo = mean.min(Vec3::ONE).to_array();
            }
        }
    }
    surfaces
}
