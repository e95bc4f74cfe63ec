//! The hierarchy of functions ([L08] §2.1-2.3): levels of Poisson disks, their radii, clip planes, parents and children, and the flat
//! basis made of the same points ([L08] §4.1).

use super::clip::clip_planes;
use super::{LevelBasis, WeightEntry, Weights};
use crate::samples::{Candidate, DiskSettings, Point, fill_level};
use crate::scene::{Geometry, Surface};
use glam::Vec3;
use rayon::prelude::*;

/// C of r = C · R on the coarsest and on the finest level ([L08] §2.3).
const OVERLAP: [f32; 2] = [1.5, 2.5];

/// How to build a hierarchy.
#[derive(Clone, Debug)]
pub struct HierarchySettings {
    /// Disk radius of the coarsest level, metres; halves from level to level.
    pub coarse_radius: f32,
    /// How many levels.
    pub levels: usize,
    /// How many of them, from the coarsest, are senders. The finest sender level and the finest level of all cover everything; the others
    /// leave tight corners to finer levels.
    pub sender_levels: usize,
    /// Most points of each level.
    pub most: Vec<usize>,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Whether functions stop at walls. Off is [L08].
    pub clip: bool,
    /// Whether particles drop their first bounces.
    pub drop_first: bool,
}

/// Levels of functions with everything that connects them.
#[derive(Debug)]
pub struct Hierarchy {
    /// The levels, coarse first, each with radii for the hierarchical basis.
    pub levels: Vec<LevelBasis>,
    /// The surface at each point, all levels behind one another.
    pub surfaces: Vec<Surface>,
    /// Where each level starts among all points, and the end.
    pub level_starts: Vec<u32>,
    /// Rays that the construction took.
    pub rays: u64,
    /// Levels that were cut short by their largest number of points.
    pub truncated: Vec<usize>,
}

impl Hierarchy {
    /// Scatters the points and builds the levels. `progress` is told after each step how much of the work is done and may stop it by
    /// answering false; then nothing comes back.
    pub fn build(
        geometry: &dyn Geometry,
        viewpoints: &[Vec3],
        settings: &HierarchySettings,
        progress: &(dyn Fn(f32) -> bool + Sync),
    ) -> Option<Self> {
        let mut rays = 0;
        let mut filled: Vec<Vec<Candidate>> = Vec::new();
        let mut truncated = Vec::new();
        for l in 0..settings.levels {
            let all_covering = l + 1 == settings.levels || l + 1 == settings.sender_levels;
            let disks = fill_level(
                geometry,
                viewpoints,
                &DiskSettings {
                    radius: settings.coarse_radius / (1u32 << l) as f32,
                    open_only: !all_covering,
                    most: settings.most[l],
                    seed: settings.seed.wrapping_add(l as u64),
                    drop_first: settings.drop_first,
                },
            );
            rays += disks.rays;
            if disks.truncated {
                truncated.push(l);
            }
            filled.push(disks.points);
            if !progress(0.7 * (l + 1) as f32 / settings.levels as f32) {
                return None;
            }
        }
        let mut level_starts = vec![0];
        for level in &filled {
            level_starts.push(level_starts[level_starts.len() - 1] + level.len() as u32);
        }
        let mut levels = Vec::new();
        for l in 0..settings.levels {
            let radius = settings.coarse_radius / (1u32 << l) as f32 * overlap(l, settings.levels);
            let points = to_points(&filled[l], radius);
            // Look at the points of this level and the next: four to five times as dense as the functions themselves.
            let finer = (l + 1).min(settings.levels - 1);
            let mut around: Vec<&[Candidate]> = vec![&filled[finer]];
            if finer != l {
                around.push(&filled[l]);
            }
            let (level, cast) = with_planes(geometry, points, &around, settings.clip);
            rays += cast;
            levels.push(level);
            if !progress(0.7 + 0.3 * (l + 1) as f32 / settings.levels as f32) {
                return None;
            }
        }
        Some(Self {
            levels,
            surfaces: filled.iter().flatten().map(|c| c.surface).collect(),
            level_starts,
            rays,
            truncated,
        })
    }

    /// How many points there are on all levels.
    #[must_use]
    pub fn len(&self) -> usize {
        self.surfaces.len()
    }

    /// True without points.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.surfaces.is_empty()
    }

    /// The points of level `l`, as a range of all points.
    #[must_use]
    pub fn level(&self, l: usize) -> std::ops::Range<usize> {
        self.level_starts[l] as usize..self.level_starts[l + 1] as usize
    }

    /// The level of point `i`.
    #[must_use]
    pub fn level_of(&self, i: usize) -> usize {
        self.level_starts.partition_point(|&s| s as usize <= i) - 1
    }

    /// The parents of every point with B_k(p_i) ([L08] §2.1, Eq. (17)). `all` asks for those of all coarser levels, weights that sum to one
    /// for each; else only those of the nearest coarser level that covers the point.
    #[must_use]
    pub fn parents(&self, all: bool) -> Weights {
        let rows: Vec<Vec<WeightEntry>> = (0..self.levels.len())
            .flat_map(|l| self.level(l).map(move |i| (l, i)))
            .collect::<Vec<_>>()
            .into_par_iter()
            .map(|(l, i)| {
                let surface = &self.surfaces[i];
                let mut row = Vec::new();
                let mut found = Vec::new();
                for k in (0..l).rev() {
                    if self.levels[k].weights(surface.position, surface.normal, &mut found) {
                        let start = self.level_starts[k];
                        row.extend(found.iter().map(|w| WeightEntry {
                            index: w.index + start,
                            weight: w.weight,
                        }));
                        if !all {
                            break;
                        }
                    }
                }
                row.sort_unstable_by_key(|w| w.index);
                row
            })
            .collect();
        Weights::from_rows(rows)
    }

    /// Pull rows of the first `levels` levels: each function's children (points of the next level that it covers) with weights w_k(p_c) that
    /// sum to one ([L08] §2.1 "Pull-Push Approximation": "the weighted average of function values in its children").
    #[must_use]
    pub fn pull(&self, levels: usize) -> Weights {
        let mut rows: Vec<Vec<WeightEntry>> = vec![Vec::new(); self.level_starts[levels] as usize];
        for l in 0..levels.min(self.levels.len() - 1) {
            let per_child: Vec<(u32, Vec<WeightEntry>)> = self
                .level(l + 1)
                .into_par_iter()
                .map(|c| {
                    let mut found = Vec::new();
                    self.levels[l].raw_weights(self.surfaces[c].position, self.surfaces[c].normal, &mut found);
                    (c as u32, found)
                })
                .collect();
            for (child, found) in per_child {
                for w in found {
                    rows[(self.level_starts[l] + w.index) as usize].push(WeightEntry {
                        index: child,
                        weight: w.weight,
                    });
                }
            }
        }
        for row in &mut rows {
            let sum: f32 = row.iter().map(|w| w.weight).sum();
            if sum <= super::NO_COVER {
                row.clear();
            }
            for w in row.iter_mut() {
                w.weight /= sum;
            }
        }
        Weights::from_rows(rows)
    }

    /// The flat basis: all points on one level with the radius of the finest ([L08] §4.1 "Flattening"). Also says how many rays it took.
    #[must_use]
    pub fn flat(&self, geometry: &dyn Geometry, clip: bool) -> (LevelBasis, u64) {
        let finest = self.levels.len() - 1;
        let radius = self.levels[finest].points.first().map_or(0.0, |p| p.radius);
        let all: Vec<Candidate> = self
            .surfaces
            .iter()
            .map(|&surface| Candidate {
                surface,
                free: surface.position,
            })
            .collect();
        with_planes(geometry, to_points(&all, radius), &[&all], clip)
    }
}

fn overlap(l: usize, levels: usize) -> f32 {
    let t = if levels > 1 { l as f32 / (levels - 1) as f32 } else { 1.0 };
    OVERLAP[0] + t * (OVERLAP[1] - OVERLAP[0])
}

fn to_points(candidates: &[Candidate], radius: f32) -> Vec<Point> {
    candidates
        .iter()
        .map(|c| Point::new(c.surface.position, c.surface.normal, radius))
        .collect()
}

/// Gives each function its clip planes, looking at the places in `around`.
fn with_planes(
    geometry: &dyn Geometry,
    mut points: Vec<Point>,
    around: &[&[Candidate]],
    clip: bool,
) -> (LevelBasis, u64) {
    if !clip || points.is_empty() {
        return (LevelBasis::new(points, Vec::new()), 0);
    }
    // The places by cell; a place is looked up from the cell of the function's centre, so its box is as large as a support.
    let places: Vec<(Vec3, Vec3)> = around
        .iter()
        .flat_map(|level| level.iter().map(|c| (c.surface.position, c.surface.normal)))
        .collect();
    let reach = points[0].radius;
    let grid = crate::samples::HashedGrid::build(places.len(), reach, |i| crate::scene::Bounds {
        min: places[i].0 - reach,
        max: places[i].0 + reach,
    });
    let found: Vec<(Vec<[f32; 4]>, u64)> = points
        .par_iter()
        .map(|point| {
            let mut rays = 0;
            let near = grid.near(point.x()).iter().map(|&i| places[i as usize]);
            (clip_planes(geometry, point, near, &mut rays), rays)
        })
        .collect();
    let mut planes: Vec<[f32; 4]> = Vec::new();
    let mut rays = 0;
    for (point, (own, cast)) in points.iter_mut().zip(found) {
        point.planes = planes.len() as u32 | (own.len() as u32) << 24;
        planes.extend(own);
        rays += cast;
    }
    (LevelBasis::new(points, planes), rays)
}
