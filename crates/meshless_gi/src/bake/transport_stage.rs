//! Third stage: gathered and refined rows of the operator, and of probes.

use super::context::BakeContext;
use super::fmm::SenderCells;
use super::link_method::LinkMethod;
use super::point_set::PointSet;
use super::probes::{BakedProbes, ProbeInput, bake_probes};
use super::survey::Survey;
use super::{
    BakeError, BakeStage, BakeStats, PcaRecipe, SkyModel, basis_training, training_lights,
};
use crate::basis::LevelBasis;
use crate::transport::pca::{Compression, LightBasis};
use crate::transport::{
    BoundedSettings, GatherSettings, Receivers, RefinedOperator, SenderTree, Training,
    l08_truncation, precision_of, refine_bounded,
};
use std::time::Instant;

/// Result of the stage.
pub(super) struct Transport {
    /// Points, with the levels that refinement added.
    pub points: PointSet,
    /// Rows of all points.
    pub refined: RefinedOperator,
    /// Light bases of method `pca`.
    pub compression: Option<Compression>,
    /// Probes, if the recipe has any.
    pub probes: Option<BakedProbes>,
    /// Precision of links to each sender, the sky last.
    pub precision: Vec<u8>,
    /// Flat basis of all points.
    pub flat: LevelBasis,
    /// Cells of the senders, for method `fmm`.
    pub cells: Option<SenderCells>,
}

/// Rows of one method, and results that only some methods have.
struct Rows {
    refined: RefinedOperator,
    compression: Option<Compression>,
    probes: Option<BakedProbes>,
    precision: Vec<u8>,
}

/// Gathers and refines the rows of all points.
pub(super) fn build_transport(
    context: &BakeContext<'_>,
    survey: &Survey,
    mut points: PointSet,
    stats: &mut BakeStats,
) -> Result<Transport, BakeError> {
    let began = Instant::now();
    context.report(BakeStage::Transport, 0.0)?;
    let geometry = context.source.geometry;
    let settings = &survey.settings;
    let gathering = GatherSettings {
        geometry,
        sender_levels: settings.sender_levels as usize,
        rays: settings.rays_per_point,
        seed: settings.seed,
        deposit: survey.method.deposit(),
    };
    let stage = TransportStage {
        context,
        survey,
        gathering,
    };
    let rows = match survey.method {
        LinkMethod::Averages => stage.averages(&mut points, None, stats)?,
        LinkMethod::Components(pca) => stage.averages(&mut points, Some(&pca), stats)?,
        LinkMethod::Differences => stage.differences(&points)?,
        LinkMethod::Octree => Rows {
            refined: RefinedOperator::without_rows(points.hierarchy.len()),
            compression: None,
            probes: None,
            precision: Vec::new(),
        },
    };
    let (flat, rays) = points
        .hierarchy
        .flat(geometry, &survey.viewpoints, &points.building);
    stats.rays += rays;
    let seconds = began.elapsed().as_secs_f64();
    stats.seconds.gather = seconds * rows.refined.gather_share;
    stats.seconds.refine = seconds - stats.seconds.gather;
    let cells = SenderCells::find(geometry, &points.hierarchy, settings);
    Ok(Transport {
        points,
        refined: rows.refined,
        compression: rows.compression,
        probes: rows.probes,
        precision: rows.precision,
        flat,
        cells,
    })
}

/// Input of the methods.
struct TransportStage<'a> {
    context: &'a BakeContext<'a>,
    survey: &'a Survey,
    gathering: GatherSettings<'a>,
}

impl TransportStage<'_> {
    fn report(&self, done: f32) -> bool {
        self.context.progress.set(BakeStage::Transport, done)
    }

    /// Gathers and refines rows that keep their mass: links to averages of senders, or to
    /// components of light bases.
    fn averages(
        &self,
        points: &mut PointSet,
        pca: Option<&PcaRecipe>,
        stats: &mut BakeStats,
    ) -> Result<Rows, BakeError> {
        let settings = &self.survey.settings;
        let sender_levels = settings.sender_levels as usize;
        let starts = &points.hierarchy.level_starts[..=sender_levels];
        let tree = SenderTree::new(&points.tree, starts);
        let (training, rays) = training_lights::train(&self.gathering, points, self.survey, &tree);
        stats.rays += rays;
        let basis = pca.map(|pca| self.light_basis(points, pca, stats));
        let compression = basis
            .as_ref()
            .map(|basis| Compression::new(basis, points.pull.len()));
        let refined = refine_bounded(
            &self.gathering,
            &mut Receivers {
                hierarchy: &mut points.hierarchy,
                parents: &mut points.parents,
                building: &points.building,
            },
            &tree,
            &training,
            &BoundedSettings {
                epsilon: settings.truncation_error,
                tolerance: settings.receiver_tolerance,
                always: sender_levels.max(1),
                extra_levels: settings.refinement_levels as usize,
                extra_points: settings.max_refinement_points as usize,
                extra_rays: settings.rays_of_level(settings.levels as usize),
            },
            basis.as_ref(),
            &|done| self.report(done),
        )
        .ok_or(BakeError::Canceled)?;
        let probes = self.probes(points, &tree, &training, stats)?;
        if let Some(mass) = &refined.truncation_mass {
            points.pull = mass.pull(&tree, &points.visible_areas);
        }
        let exposures = training.exposure.iter().chain([&training.sky]);
        Ok(Rows {
            refined,
            compression,
            probes,
            precision: exposures.map(|&e| precision_of(e)).collect(),
        })
    }

    /// Computes the light bases of the sender clusters.
    fn light_basis(&self, points: &PointSet, pca: &PcaRecipe, stats: &mut BakeStats) -> LightBasis {
        let (basis, rays) = basis_training::light_basis(&self.gathering, points, self.survey, pca);
        stats.rays += rays;
        stats.clusters = basis.clusters() as u64;
        stats.components = basis.columns() as u64;
        stats.basis_missed = basis.missed();
        basis
    }

    /// Bakes the probes, if the recipe has any.
    fn probes(
        &self,
        points: &PointSet,
        tree: &SenderTree,
        training: &Training,
        stats: &mut BakeStats,
    ) -> Result<Option<BakedProbes>, BakeError> {
        let settings = &self.survey.settings;
        let Some(probes) = &settings.probes else {
            return Ok(None);
        };
        let input = ProbeInput {
            gathering: &self.gathering,
            hierarchy: &points.hierarchy,
            viewpoints: &self.survey.viewpoints,
            tree,
            training,
            epsilon: settings.truncation_error,
            sky_terms: settings.sky == SkyModel::Harmonics,
            drop_first: self.survey.drop_first,
        };
        bake_probes(probes, &input, stats, self.context.progress).map(Some)
    }

    /// Computes rows of differences, as published in \[L08\].
    fn differences(&self, points: &PointSet) -> Result<Rows, BakeError> {
        let settings = &self.survey.settings;
        let neighbors =
            l08_truncation::neighbors(&points.hierarchy, settings.sender_levels as usize);
        let refined = l08_truncation::refine_l08(
            &self.gathering.scene(&points.hierarchy),
            &points.parents,
            &neighbors,
            settings.truncation_error,
            &|done| self.report(done),
        );
        Ok(Rows {
            refined: refined.ok_or(BakeError::Canceled)?,
            compression: None,
            probes: None,
            precision: Vec::new(),
        })
    }
}
