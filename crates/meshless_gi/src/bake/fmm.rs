//! Rule `fmm`: from points and their surfaces to the octree that carries a frame's light ([G08]).
//!
//! **Who shines.** The senders of the finest sender level, each from a few pieces of its cell
//! ([`find_cells`]): a wall near by is then a wall, and not a few disks. [G08] has one place a
//! point.
//!
//! **Who receives.** The points of the sender levels. An expansion can be asked anywhere, and
//! points of finer levels might receive at their own places; they take the mean of their parents,
//! which was as exact or more so wherever it was tried, for parts of visibility are the same over a
//! leaf, and costs next to nothing.
//!
//! **Closed form.** Even light of one makes one at every point, less what the sky and unlit backs
//! take: (1/π) ∫ n·ω dω = 1. What near disks, areas and parts of visibility miss of that, each
//! point's factor mends.

use super::context::BakeContext;
use super::{BakeError, BakeSettings, BakeStage, BakeStats, FmmRecipe, energy_fmm};
use crate::asset::{BakedScene, TierInfo};
use crate::basis::{CellPart, Hierarchy, find_cells};
use crate::scene::Geometry;
use crate::transport::fmm::passes::{Field, along};
use crate::transport::fmm::{Fmm, FmmOperator, FmmPoint, FmmSettings, Passes};
use crate::transport::look_out;
use glam::Vec3;
use rayon::prelude::*;
use std::time::Instant;

impl FmmRecipe {
    /// Settings of the solver.
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

/// The cells of the senders that shine.
pub(super) struct SenderCells {
    /// The first of those senders.
    first: usize,
    /// Pieces of each.
    cells: Vec<Vec<CellPart>>,
    rays: u64,
}

impl SenderCells {
    /// Nothing but under rule `fmm`.
    pub fn find(
        geometry: &dyn Geometry,
        hierarchy: &Hierarchy,
        settings: &BakeSettings,
    ) -> Option<Self> {
        let octree = settings.fmm()?;
        let finest = settings.sender_levels as usize - 1;
        let level = &hierarchy.senders[finest];
        let (cells, rays) = find_cells(geometry, level, octree.samples_per_sender, settings.seed);
        Some(Self {
            first: hierarchy.level(finest).start,
            cells,
            rays,
        })
    }

    /// The points of the octree: pieces of the senders that shine, then the points of all senders;
    /// and of each the sender that it is of.
    fn points(&self, scene: &BakedScene) -> (Vec<FmmPoint>, Vec<u32>) {
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

/// Factors beyond these mend no rounding: what such a point sees is not on any list, or lies in a
/// crack.
const FACTOR_RANGE: [f32; 2] = [0.25, 4.0];

/// Adds the octree of method `fmm` to a scene with `cells`.
pub(super) fn add_octree(
    context: &BakeContext<'_>,
    settings: &BakeSettings,
    cells: Option<SenderCells>,
    scene: BakedScene,
    stats: &mut BakeStats,
) -> Result<BakedScene, BakeError> {
    let (Some(cells), Some(recipe)) = (cells, settings.fmm()) else {
        return Ok(scene);
    };
    let began = Instant::now();
    context.report(BakeStage::Transport, 0.9)?;
    let geometry = context.source.geometry;
    let rays = (settings.rays_per_point / 4).max(16);
    let sky_rays: Vec<(Vec3, f32)> = (scene.points.par_iter().enumerate())
        .map(|(i, p)| look_out(geometry, p.x(), p.n(), i, rays, settings.seed))
        .collect();
    stats.rays += cells.rays + sky_rays.len() as u64 * u64::from(rays);
    let mut scene = match recipe.fallback_links {
        // Links gathered their own sky visibility, which sweeps over them subtract.
        true => scene,
        false => with_sky(scene, &sky_rays),
    };
    let (points, of) = cells.points(&scene);
    let fmm = Fmm::new(&points, &recipe.solver(settings.seed), Some(geometry))?;
    stats.rays += fmm.lists().counts.rays;
    let mut operator = fmm.operator(|at| of[at as usize]);
    for place in operator.places.iter_mut().filter(|p| p.share == 0.0) {
        place.sky = scene.surfaces[place.point as usize].sky;
    }
    let unlit: Vec<f32> = sky_rays.iter().map(|s| s.1).collect();
    normalize_to_closed_form(&mut operator, &scene, &unlit);
    stats.octree_bytes = operator.bytes();
    stats.octree_entries = operator.entries.len() as u64;
    scene.fmm = Some(operator);
    scene.info.tiers = TierInfo::of(&scene);
    let energy = energy_fmm::enforce_energy_bound(&mut scene, &unlit, &cells.areas());
    let senders = scene.senders() as u64;
    (stats.warnings).extend(super::energy::warning(&energy, senders));
    scene.info.energy = energy;
    stats.energy = energy;
    stats.seconds.octree = began.elapsed().as_secs_f64();
    Ok(scene)
}

/// The scene with the sky visibility of `sky_rays`.
fn with_sky(mut scene: BakedScene, sky_rays: &[(Vec3, f32)]) -> BakedScene {
    for (surface, (sky, _)) in scene.surfaces.iter_mut().zip(sky_rays) {
        surface.sky = sky.to_array();
    }
    scene
}

impl SenderCells {
    /// The surface of each sender, m²; nothing for those that do not shine.
    fn areas(&self) -> Vec<f32> {
        let own = (self.cells.iter()).map(|cell| cell.iter().map(|p| p.area).sum());
        std::iter::repeat_n(0.0, self.first).chain(own).collect()
    }
}

/// Sets the factor of every place that receives.
fn normalize_to_closed_form(operator: &mut FmmOperator, scene: &BakedScene, unlit: &[f32]) {
    let unit = unit_response(operator, scene);
    for place in operator.places.iter_mut().filter(|p| p.share == 0.0) {
        let i = place.point as usize;
        let sky = Vec3::from_array(place.sky).dot(Vec3::from_array(place.normal));
        let right = 1.0 - sky.max(0.0) - unlit[i];
        let factor = right / unit[i];
        place.factor = match (FACTOR_RANGE[0]..=FACTOR_RANGE[1]).contains(&factor) {
            true => factor,
            false => 1.0,
        };
    }
}

/// What senders of radiosity one make of each other along their normals.
pub(super) fn unit_response(operator: &FmmOperator, scene: &BakedScene) -> Vec<f32> {
    let radiosity = vec![[1.0f32; 4]; scene.senders()];
    let mut passes = Passes::new(Field::of(operator));
    passes.run(&radiosity);
    let mut out = vec![0.0; scene.senders()];
    for node in operator.nodes.iter().filter(|n| n.is_leaf()) {
        for i in node.receiver_range() {
            let place = &operator.places[i];
            let e = along(place.normal, &passes.values[i])[0];
            out[place.point as usize] = place.factor * e;
        }
    }
    out
}
