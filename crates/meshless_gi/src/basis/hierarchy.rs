//! Hierarchy of basis functions ([L08] §2.1-2.3): levels of Poisson disks, their radii, clip
//! planes, parents and children.

use super::clip::with_planes;
use super::emitter_points::{emitter_candidates, on_emitters};
use super::level_points::LevelPoints;
use super::visibility::Viewer;
use super::{LevelBasis, WeightEntry, Weights};
use crate::samples::{Candidate, Point, local_candidates, order, throw_darts, trace_particles};
use crate::scene::{Emitters, Geometry, Surface};
use glam::Vec3;
use rayon::prelude::*;

/// C of r = C · R on the coarsest and on the finest level ([L08] §2.3).
const OVERLAP: [f32; 2] = [1.5, 2.5];

/// Number of rays per point that search candidates of an added level.
const LOCAL_RAYS: u64 = 64;

/// Settings of a hierarchy.
#[derive(Clone, Debug)]
pub struct HierarchySettings {
    /// Disk radius of the coarsest level, meters. It halves from level to level.
    pub coarse_radius: f32,
    /// Number of levels.
    pub levels: usize,
    /// Number of levels, from the coarsest, that are senders. The finest sender level and the
    /// finest level of all cover everything. The other levels leave tight corners to finer levels.
    pub sender_levels: usize,
    /// Largest number of points of each level.
    pub max: Vec<usize>,
    /// Seed of the random numbers.
    pub seed: u64,
    /// C of the basis functions of senders. `None` uses the functions of the hierarchy. \[L08\]
    /// uses one basis for both, and suggests different ones in §5.2. Receivers need smooth
    /// functions. Senders with a small C blur less, and their lookup is faster.
    pub sender_overlap: Option<f32>,
    /// `true` if clip planes end functions at walls. `false` is the method of \[L08\].
    pub clip: bool,
    /// `true` if particles drop their first bounces.
    pub drop_first: bool,
    /// `true` if emissive surfaces have senders of their own. See `emitter_points.rs`.
    pub separate_emitters: bool,
}

impl HierarchySettings {
    /// Returns the emitters that get senders of their own.
    pub(super) fn emitters<'a>(&self, geometry: &'a dyn Geometry) -> Option<&'a Emitters> {
        let emitters = geometry.emitters().filter(|_| self.separate_emitters);
        emitters.filter(|e| e.is_sparse())
    }
}

/// Levels of basis functions and their relations.
#[derive(Debug)]
pub struct Hierarchy {
    /// Levels, coarse first, each with radii for the hierarchical basis.
    pub levels: Vec<LevelBasis>,
    /// Sender levels with the basis functions of senders, coarse first.
    pub senders: Vec<LevelBasis>,
    /// Surface at each point, level after level.
    pub surfaces: Vec<Surface>,
    /// Start of each level among all points, and the end.
    pub level_starts: Vec<u32>,
    /// Number of rays of the construction.
    pub rays: u64,
    /// Levels that reached their largest number of points.
    pub truncated: Vec<usize>,
    /// `true` for each sender on an emissive surface. Empty if emitters are not separate.
    pub emissive: Vec<bool>,
    /// Visibility origin of each point, meters. It lies slightly above the point. See
    /// `visibility.rs`.
    pub origins: Vec<Vec3>,
}

impl Hierarchy {
    /// Scatters the points and builds the levels. `progress` is called with the completed fraction
    /// after each step. If it returns `false`, the construction stops and returns `None`.
    pub fn build(
        geometry: &dyn Geometry,
        viewpoints: &[Vec3],
        settings: &HierarchySettings,
        progress: &(dyn Fn(f32) -> bool + Sync),
    ) -> Option<Self> {
        let mut rays = 0;
        let emitters = settings.emitters(geometry);
        let (on_emitter, cast) = emitters.map_or_else(Default::default, |emitters| {
            emitter_candidates(geometry, emitters, viewpoints, settings.seed)
        });
        rays += cast;
        let filled = LevelPoints::new(geometry, viewpoints, settings, &on_emitter, progress)?;
        rays += filled.rays;
        let LevelPoints {
            points: filled,
            truncated,
            ..
        } = filled;
        let mut level_starts = vec![0];
        for level in &filled {
            level_starts.push(level_starts[level_starts.len() - 1] + level.len() as u32);
        }
        let mut levels = Vec::new();
        let mut senders = Vec::new();
        for l in 0..settings.levels {
            let disk = settings.coarse_radius / (1u32 << l) as f32;
            let points = to_points(&filled[l], disk * overlap(l, settings.levels));
            // Use the points of this level and the next: four to five times as dense as the
            // functions themselves.
            let finer = (l + 1).min(settings.levels - 1);
            let mut around: Vec<&[Candidate]> = vec![&filled[finer]];
            if finer != l {
                around.push(&filled[l]);
            }
            let (level, cast) = with_planes(geometry, points, &around, settings.clip);
            rays += cast;
            if l < settings.sender_levels {
                senders.push(match settings.sender_overlap {
                    None => level.clone(),
                    Some(c) => {
                        let (level, cast) = with_planes(
                            geometry,
                            to_points(&filled[l], disk * c),
                            &around,
                            settings.clip,
                        );
                        rays += cast;
                        level
                    }
                });
            }
            levels.push(level);
            if !progress(0.7 + 0.3 * (l + 1) as f32 / settings.levels as f32) {
                return None;
            }
        }
        let surfaces: Vec<Surface> = filled.iter().flatten().map(|c| c.surface).collect();
        let emissive = emitters.map_or_else(Vec::new, |emitters| {
            let senders = level_starts[settings.sender_levels] as usize;
            on_emitters(geometry, emitters, &surfaces[..senders])
        });
        let origins: Vec<Vec3> = levels.iter().flat_map(|l| origins(geometry, l)).collect();
        rays += origins.len() as u64;
        Some(Self {
            levels,
            senders,
            surfaces,
            level_starts,
            rays,
            truncated,
            emissive,
            origins,
        })
    }

    /// Adds a level around the points `refined_points` of the finest level, where light needs more
    /// detail. Its disk radius is half that of the finest level. Candidates are surface points
    /// visible from just above each of the points. `max` limits the number of added points. Returns
    /// the number of added points.
    pub fn add_level(
        &mut self,
        geometry: &dyn Geometry,
        refined_points: &[usize],
        max: usize,
        settings: &HierarchySettings,
    ) -> usize {
        let l = self.levels.len();
        let disk = settings.coarse_radius / (1u32 << l) as f32;
        let (candidates, rays) = local_candidates(
            geometry,
            &self.surfaces,
            refined_points,
            2.0 * disk * OVERLAP[1],
            LOCAL_RAYS,
            settings.seed.wrapping_add(l as u64),
        );
        self.rays += rays;
        let (mut filled, cast) = throw_darts(Some(geometry), candidates, disk, max);
        self.rays += cast;
        order(&mut filled, &geometry.bounds());
        if filled.is_empty() {
            return 0;
        }
        let points = to_points(&filled, disk * OVERLAP[1]);
        let (level, cast) = with_planes(geometry, points, &[&filled], settings.clip);
        self.rays += cast + filled.len() as u64;
        self.origins.extend(origins(geometry, &level));
        self.levels.push(level);
        self.surfaces.extend(filled.iter().map(|c| c.surface));
        self.level_starts.push(self.surfaces.len() as u32);
        filled.len()
    }

    /// Returns the number of points of all levels.
    #[must_use]
    pub fn len(&self) -> usize {
        self.surfaces.len()
    }

    /// Returns `true` if the hierarchy has zero points.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.surfaces.is_empty()
    }

    /// Returns the points of level `l`, as a range of all points.
    #[must_use]
    pub fn level(&self, l: usize) -> std::ops::Range<usize> {
        self.level_starts[l] as usize..self.level_starts[l + 1] as usize
    }

    /// Returns the level of point `i`.
    #[must_use]
    pub fn level_of(&self, i: usize) -> usize {
        self.level_starts.partition_point(|&s| s as usize <= i) - 1
    }

    /// Appends the parents of the points of level `l` with B_k(p_i) (\[L08\] §2.1, Eq. (17)) to
    /// `out`, which must contain those of the coarser levels. With `all`, a point has parents on
    /// every coarser level, with weights that sum to one per level. Otherwise, it has those of the
    /// nearest coarser level that covers it.
    pub fn append_parents(&self, l: usize, all: bool, out: &mut Weights) {
        let rows: Vec<Vec<WeightEntry>> = self
            .level(l)
            .into_par_iter()
            .map_init(Vec::new, |found, i| {
                let surface = &self.surfaces[i];
                let mut row = Vec::new();
                for k in (0..l).rev() {
                    if self.levels[k].weights(surface.position, surface.normal, found) {
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
        out.append(rows);
    }

    /// Returns the parents of every point. See [`append_parents`](Self::append_parents).
    #[must_use]
    pub fn parents(&self, all: bool) -> Weights {
        let mut out = Weights::from_rows(std::iter::empty::<Vec<WeightEntry>>());
        for l in 0..self.levels.len() {
            self.append_parents(l, all, &mut out);
        }
        out
    }

    /// Returns the pull rows of the senders: each function's children (points of the next level
    /// that it covers). Their weights w_k(p_c) sum to one (\[L08\] §2.1 "Pull-Push Approximation":
    /// "the weighted average of function values in its children").
    #[must_use]
    pub fn pull(&self) -> Weights {
        let levels = self.senders.len();
        let mut rows: Vec<Vec<WeightEntry>> = vec![Vec::new(); self.level_starts[levels] as usize];
        for l in 0..levels - 1 {
            let per_child: Vec<(u32, Vec<WeightEntry>)> = self
                .level(l + 1)
                .into_par_iter()
                .map(|c| {
                    let mut found = Vec::new();
                    self.senders[l].raw_weights(
                        self.surfaces[c].position,
                        self.surfaces[c].normal,
                        &mut found,
                    );
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
            normalize(row);
        }
        Weights::from_rows(rows)
    }

    /// Returns the sender with the largest weight at each sender of the next level: a tree over the
    /// sender levels. A sender of the coarsest level is its own parent. So is a sender that no
    /// function of the previous level covers.
    #[must_use]
    pub fn tree(&self) -> Vec<u32> {
        (0..self.senders.len())
            .flat_map(|l| self.level(l).map(move |i| (l, i)))
            .collect::<Vec<_>>()
            .into_par_iter()
            .map_init(Vec::new, |found, (l, i)| {
                found.clear();
                if l > 0 {
                    let (x, n) = (self.surfaces[i].position, self.surfaces[i].normal);
                    let near = self.senders[l - 1].grid.indices_near(x);
                    self.raw_sender_weights(l - 1, near, x, n, self.is_on_emitter(i), found);
                }
                let first = if l > 0 { self.level_starts[l - 1] } else { 0 };
                let mut best = (0.0, i as u32);
                for w in found.iter() {
                    if w.weight > best.0 {
                        best = (w.weight, first + w.index);
                    }
                }
                best.1
            })
            .collect()
    }

    /// Computes the area of each point of the tree that is visible from the rest of the scene, per
    /// sender level and in arbitrary units. An area is the number of importance particles that land
    /// nearest to the point after a flight longer than the support radius of the level. Importance
    /// particles visit a closed scene evenly. Receivers that use the mean of a coarse sender are
    /// far away. The cracks between its children are not visible from them. A mean by area would
    /// count the dark cracks and lose some percent of the light. Also returns the number of rays
    /// cast.
    #[must_use]
    pub fn visible_areas(
        &self,
        geometry: &dyn Geometry,
        viewpoints: &[Vec3],
        tree: &[u32],
        settings: &HierarchySettings,
    ) -> (Vec<Vec<f32>>, u64) {
        const SAMPLES: usize = 24;
        let last = self.senders.len() - 1;
        let first = self.level_starts[last];
        let leaves = &self.levels[last];
        let reach: Vec<f32> = self.senders.iter().map(LevelBasis::radius).collect();
        // Every area is above zero: a point without a particle has almost zero weight.
        let mut areas = vec![vec![0.0f32; tree.len()]; reach.len()];
        for level in &mut areas {
            level[first as usize..].fill(0.01);
            // Few particles meet an emitter. All disks on emitters count equally.
            for (i, area) in level.iter_mut().enumerate().skip(first as usize) {
                if self.is_on_emitter(i) {
                    *area = 1.0;
                }
            }
        }
        let mut rays = 0;
        let mut found = 0;
        let mut start = 0;
        while found < SAMPLES * leaves.points.len() && start < 1 << 17 {
            let traced = trace_particles(
                geometry,
                viewpoints,
                start..start + 8192,
                settings.seed ^ 0x61_72,
                settings.drop_first,
            );
            start += 8192;
            rays += traced.rays;
            found += traced.candidates.len();
            let nearest: Vec<(u32, f32)> = traced
                .candidates
                .par_iter()
                .map_init(Vec::new, |weights, c| {
                    weights.clear();
                    leaves.raw_weights(c.surface.position, c.surface.normal, weights);
                    let mut best = (0.0, u32::MAX);
                    for w in weights.iter() {
                        let is_on_emitter = self.is_on_emitter((first + w.index) as usize);
                        if w.weight > best.0 && !is_on_emitter {
                            best = (w.weight, w.index);
                        }
                    }
                    // `free` is half-way along the flight.
                    (best.1, 2.0 * c.free.distance(c.surface.position))
                })
                .collect();
            for (leaf, flight) in nearest {
                if leaf != u32::MAX {
                    for (level, &reach) in areas.iter_mut().zip(&reach) {
                        level[(first + leaf) as usize] += if flight > reach { 1.0 } else { 0.01 };
                    }
                }
            }
        }
        // Children have higher indices than their parents.
        for level in &mut areas {
            for i in (0..tree.len()).rev() {
                if tree[i] as usize != i {
                    level[tree[i] as usize] += level[i];
                }
            }
        }
        (areas, rays)
    }

    /// Returns the pull rows of the senders over a tree of [`tree`](Self::tree): the mean of each
    /// sender's own children, weighted by visible area. A position then counts in one sender of
    /// each level. A row that moves mass to a parent thus gets the exact mean of that mass.
    #[must_use]
    pub fn tree_pull(&self, tree: &[u32], shown: &[Vec<f32>]) -> Weights {
        let mut rows: Vec<Vec<WeightEntry>> =
            vec![Vec::new(); self.level_starts[self.senders.len()] as usize];
        for (i, &parent) in tree.iter().enumerate() {
            if parent as usize != i {
                rows[parent as usize].push(WeightEntry {
                    index: i as u32,
                    weight: shown[self.level_of(parent as usize)][i],
                });
            }
        }
        for row in &mut rows {
            normalize(row);
        }
        Weights::from_rows(rows)
    }
}

/// Scales the weights to a sum of one. Clears a row whose sum is at most
/// [`NO_COVER`](super::NO_COVER).
pub(super) fn normalize(row: &mut Vec<WeightEntry>) {
    let sum: f32 = row.iter().map(|w| w.weight).sum();
    if sum <= super::NO_COVER {
        row.clear();
    }
    for w in row.iter_mut() {
        w.weight /= sum;
    }
}

/// Returns the visibility origin of each point of a level, meters.
pub(super) fn origins(geometry: &dyn Geometry, level: &LevelBasis) -> Vec<Vec3> {
    let points = level.points.par_iter();
    let origin = |p: &Point| Viewer::new(geometry, p.x(), p.n(), p.radius).origin(p.radius);
    points.map(origin).collect()
}

fn overlap(l: usize, levels: usize) -> f32 {
    let t = if levels > 1 {
        l as f32 / (levels - 1) as f32
    } else {
        1.0
    };
    OVERLAP[0] + t * (OVERLAP[1] - OVERLAP[0])
}

fn to_points(candidates: &[Candidate], radius: f32) -> Vec<Point> {
    candidates
        .iter()
        .map(|c| Point::new(c.surface.position, c.surface.normal, radius))
        .collect()
}
