//! Octree of method `fmm` ([G08]).
//!
//! **Sources** are the senders of the finest sender level. Each emits from several pieces of its
//! cell ([`find_cells`]), so that a close wall is a wall and not a few disks. [G08] has one
//! position per point.
//!
//! **Receivers** are the points of the sender levels. Points of finer levels take the mean of their
//! parents. Evaluating expansions at them costs more, and no measurement was more exact, since
//! visibility is constant over a leaf.
//!
//! **Closed form.** Uniform radiosity of one gives irradiance one at every point, except for the
//! sky and unlit back sides: (1/π) ∫ n·ω dω = 1. A factor per point corrects the errors of close
//! disks, areas and partial visibility.

use super::context::BakeContext;
use super::{BakeError, BakeSettings, BakeStage, BakeStats, FmmRecipe, energy_fmm};
use crate::asset::{SceneData, TierInfo};
use crate::basis::{CellPart, Hierarchy, find_cells};
use crate::scene::Geometry;
use crate::transport::fmm::passes::{Field, along};
use crate::transport::fmm::{Fmm, FmmOperator, FmmPoint, FmmSettings, Passes};
use crate::transport::{ReceiverRays, gather_sky_visibility};
use glam::Vec3;
use rayon::prelude::*;
use std::time::Instant;

impl FmmRecipe {
    /// Returns the settings of the solver.
    fn solver(&self, seed: u64) -> FmmSettings {
        FmmSettings {
            order: self.order as usize,
            leaf: self.leaf_size as usize,
            rays: self.visibility_rays,
            seed,
            ..FmmSettings::default()
        }
    }
}

/// Cells of the emitting senders.
pub(super) struct SenderCells {
    /// Parameters of the method.
    recipe: FmmRecipe,
    /// Index of the first emitting sender.
    first: usize,
    /// Pieces of each cell.
    cells: Vec<Vec<CellPart>>,
    rays: u64,
}

impl SenderCells {
    /// Finds the cells. Returns `None` without method `fmm`.
    pub fn find(
        geometry: &dyn Geometry,
        hierarchy: &Hierarchy,
        settings: &BakeSettings,
    ) -> Option<Self> {
        let recipe = settings.fmm()?;
        let finest = settings.sender_levels as usize - 1;
        let level = &hierarchy.senders[finest];
        let (cells, rays) = find_cells(geometry, level, recipe.samples_per_sender, settings.seed);
        Some(Self {
            recipe,
            first: hierarchy.level(finest).start,
            cells,
            rays,
        })
    }

    /// Returns the points of the octree, and the sender of each: pieces of the emitting senders,
    /// then the points of all senders.
    fn points(&self, scene: &SceneData) -> (Vec<FmmPoint>, Vec<u32>) {
        let (mut points, mut of) = (Vec::new(), Vec::new());
        for (j, cell) in self.cells.iter().enumerate() {
            for part in cell {
                of.push((self.first + j) as u32);
                points.push(FmmPoint {
                    position: part.position,
                    normal: part.normal,
                    weight: part.area,
                    receives: false,
                });
            }
        }
        for (i, p) in scene.points[..scene.senders()].iter().enumerate() {
            of.push(i as u32);
            points.push(FmmPoint {
                position: p.x(),
                normal: p.n(),
                weight: 0.0,
                receives: true,
            });
        }
        (points, of)
    }
}

/// Range of the correction factor. Factors outside of it are not rounding errors: such a point
/// receives light that no list has, or lies in a crack.
const FACTOR_RANGE: [f32; 2] = [0.25, 4.0];

/// Adds the octree of method `fmm` to a scene with `cells`.
pub(super) fn add_octree(
    context: &BakeContext<'_>,
    settings: &BakeSettings,
    cells: Option<SenderCells>,
    scene: SceneData,
    stats: &mut BakeStats,
) -> Result<SceneData, BakeError> {
    let Some(cells) = cells else {
        return Ok(scene);
    };
    let began = Instant::now();
    context.report(BakeStage::Packing, 0.5)?;
    let geometry = context.source.geometry;
    let rays = (settings.rays_per_point / 4).max(16);
    let sky_rays: Vec<(Vec3, f32)> = (scene.points.par_iter().enumerate())
        .map(|(i, p)| {
            let at = (p.x(), p.n());
            let rays = ReceiverRays::at_center(geometry, at, i, rays, settings.seed);
            gather_sky_visibility(geometry, &rays)
        })
        .collect();
    stats.rays += cells.rays + sky_rays.len() as u64 * u64::from(rays);
    let mut scene = match cells.recipe.fallback_links {
        // Links have their own gathered sky visibility. Sweeps over them subtract it.
        true => scene,
        false => with_sky(scene, &sky_rays),
    };
    let (points, of) = cells.points(&scene);
    let fmm = Fmm::new(&points, &cells.recipe.solver(settings.seed), Some(geometry))
        .map_err(|error| BakeError::Octree(Box::new(error)))?;
    stats.rays += fmm.lists().counts.rays;
    let mut operator = fmm.operator(|at| of[at as usize]);
    for point in operator.points.iter_mut().filter(|p| p.share == 0.0) {
        point.sky = scene.surfaces[point.point as usize].sky;
    }
    let unlit: Vec<f32> = sky_rays.iter().map(|s| s.1).collect();
    normalize_to_closed_form(&mut operator, &scene, &unlit);
    stats.octree_bytes = operator.bytes();
    stats.octree_entries = operator.entries.len() as u64;
    scene.fmm = Some(operator);
    scene.info.tiers = TierInfo::from_scene(&scene);
    let energy = energy_fmm::enforce_energy_bound(&mut scene, &unlit, &cells.areas());
    let senders = scene.senders() as u64;
    (stats.warnings).extend(super::energy::warning(&energy, senders));
    scene.info.energy = energy;
    stats.energy = energy;
    stats.seconds.octree = began.elapsed().as_secs_f64();
    Ok(scene)
}

/// Returns the scene with the sky visibility of `sky_rays`.
fn with_sky(mut scene: SceneData, sky_rays: &[(Vec3, f32)]) -> SceneData {
    for (surface, (sky, _)) in scene.surfaces.iter_mut().zip(sky_rays) {
        surface.sky = sky.to_array();
    }
    scene
}

impl SenderCells {
    /// Computes the area of each sender in m². 0 for senders that do not emit.
    fn areas(&self) -> Vec<f32> {
        let own = (self.cells.iter()).map(|cell| cell.iter().map(|p| p.area).sum());
        std::iter::repeat_n(0.0, self.first).chain(own).collect()
    }
}

/// Sets the correction factor of every receiver.
fn normalize_to_closed_form(operator: &mut FmmOperator, scene: &SceneData, unlit: &[f32]) {
    let unit = unit_response(operator, scene);
    for point in operator.points.iter_mut().filter(|p| p.share == 0.0) {
        let i = point.point as usize;
        let sky = Vec3::from_array(point.sky).dot(Vec3::from_array(point.normal));
        let right = 1.0 - sky.max(0.0) - unlit[i];
        let factor = right / unit[i];
        point.factor = match (FACTOR_RANGE[0]..=FACTOR_RANGE[1]).contains(&factor) {
            true => factor,
            false => 1.0,
        };
    }
}

/// Computes the irradiance of the senders along their normals for radiosity one.
pub(super) fn unit_response(operator: &FmmOperator, scene: &SceneData) -> Vec<f32> {
    let radiosity = vec![[1.0f32; 4]; scene.senders()];
    let mut passes = Passes::new(Field::from_operator(operator));
    passes.run(&radiosity);
    let mut out = vec![0.0; scene.senders()];
    for node in operator.nodes.iter().filter(|n| n.is_leaf()) {
        for i in node.receiver_range() {
            let point = &operator.points[i];
            let e = along(point.normal, &passes.values[i])[0];
            out[point.point as usize] = point.factor * e;
        }
    }
    out
}
