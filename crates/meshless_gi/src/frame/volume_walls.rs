//! Walls next to the voxels of a volume: weights of surface functions for sides that face in the
//! direction of a wall. Computed with the weights of a volume (`volume_weights`), for kernel
//! `volume`.
//!
//! An engine lights a wall between the eight voxels around each point, in front of the wall and
//! inside. Probe irradiance there comes from distant probes, and the wall's own functions are more
//! accurate. A voxel with its center within one voxel of a wall therefore has a wall sample. This
//! is the nearest point on the wall, with the weights of kernel `splat` there (\[L08\] Eq. (3),
//! squared weights over radii). Both layers of voxels have the same sample, so the wall has its own
//! irradiance between them.
//!
//! A wall sample has its wall's normal and no side. The sides of the voxel that read it depend on
//! the scene's rotation in the world.

use super::splat::FULL_COVER;
use super::volume_weights::{MAX_WEIGHTS, VoxelGrid};
use crate::asset::FlatBasis;
use crate::basis::{flat_weight, weight};
use crate::samples::Point;
use bytemuck::{Pod, Zeroable};
use glam::{UVec3, Vec3, Vec4};

/// Minimum cosine between a side and a wall sample that it reads: 60 degrees. All three sides by
/// which an engine may sample a wall then have its light.
pub const MIN_FACING_COSINE: f32 = 0.5;
/// Cosine difference below which two samples count as equal. The first one is then used, so the
/// result does not depend on rounding.
pub const COSINE_TOLERANCE: f32 = 1e-4;
/// Cosine between wall normals above which walls share one sample of a voxel: 30 degrees.
const MIN_SHARED_COSINE: f32 = 0.866_025_4;
/// Maximum number of wall samples of a voxel.
pub const MAX_FACES: usize = 6;
/// Maximum number of weights of all wall samples of a volume, by the largest binding of WebGPU, 128
/// MiB. Voxels beyond this limit have no wall samples.
const MAX_TOTAL: usize = 1 << 24;
/// Index that marks an empty entry.
const NONE: u32 = u32::MAX;
/// Fraction of its radius within which a function represents the wall. Within this radius a single
/// function has enough cover.
const CORE: f32 = 0.5;

/// A point on a wall next to a voxel. 16 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct WallSample {
    /// Normal of the wall, a unit vector of the bake's local space.
    pub normal: [f32; 3],
    /// Index of the first weight. The weights end at the start of the next sample.
    pub start: u32,
}

/// Weight of a surface function in a wall sample. 8 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct WallWeight {
    /// Index of the function's point.
    pub point: u32,
    /// Normalized weight. The weights of a sample sum to one.
    pub part: f32,
}

/// Wall samples of consecutive voxels.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WallSamples {
    /// End of each voxel's wall samples, from the first one.
    pub ends: Vec<u32>,
    /// Wall samples with the start of their weights.
    pub wall_samples: Vec<WallSample>,
    /// Weights of the wall samples.
    pub weights: Vec<WallWeight>,
}

impl WallSamples {
    /// Appends `other`. Voxels beyond the limit get no wall samples.
    pub(super) fn append(&mut self, other: Self) {
        let (wall_samples, weights) = (self.wall_samples.len() as u32, self.weights.len() as u32);
        if self.weights.len() + other.weights.len() > MAX_TOTAL {
            self.ends.extend(other.ends.iter().map(|_| wall_samples));
            return;
        }
        self.ends
            .extend(other.ends.iter().map(|end| end + wall_samples));
        self.wall_samples
            .extend(other.wall_samples.iter().map(|f| WallSample {
                start: f.start + weights,
                ..*f
            }));
        self.weights.extend(other.weights);
    }

    /// Returns the indices of the wall samples of a voxel.
    #[must_use]
    pub fn samples_of(&self, voxel: u32) -> std::ops::Range<usize> {
        let end = |i: u32| self.ends[i as usize] as usize;
        voxel.checked_sub(1).map_or(0, end)..end(voxel)
    }

    /// Returns the weights of a wall sample.
    #[must_use]
    pub fn weights_of(&self, sample: usize) -> &[WallWeight] {
        let end = self.wall_samples.get(sample + 1).map(|f| f.start as usize);
        &self.weights[self.wall_samples[sample].start as usize..end.unwrap_or(self.weights.len())]
    }

    /// Adds the wall samples of the next voxel, with center `x`, from the
    /// `wall_points`. Returns the number of functions processed.
    pub(super) fn find(
        &mut self,
        wall_points: &[WallPoint],
        points: &[Point],
        display: &FlatBasis,
        x: Vec3,
    ) -> u64 {
        let mut visit_cost = 0;
        for wall in wall_points.iter().filter(|b| !b.is_beyond(wall_points, x)) {
            // If only functions end at the wall point, the center of the function found is used
            // instead.
            for at in [wall.at, points[wall.point as usize].x()] {
                visit_cost += display.grid.indices_near(at).len() as u64;
                if self.add(points, display, at, wall.n) {
                    break;
                }
            }
        }
        self.ends.push(self.wall_samples.len() as u32);
        visit_cost
    }

    /// Adds a wall sample at `x`, a position on a wall with this normal, if functions cover it
    /// well.
    fn add(&mut self, points: &[Point], display: &FlatBasis, x: Vec3, n: Vec3) -> bool {
        let mut cover = 0.0;
        let mut weights: Vec<WallWeight> = Vec::new();
        for &j in display.grid.indices_near(x) {
            let point = &points[j as usize];
            let w = weight(point, &display.planes, x, n);
            if w > 0.0 {
                cover += w;
                let part = flat_weight(point, w);
                weights.push(WallWeight { point: j, part });
            }
        }
        if cover < FULL_COVER {
            return false;
        }
        if weights.len() > MAX_WEIGHTS {
            let strongest = |a: &WallWeight, b: &WallWeight| {
                b.part.total_cmp(&a.part).then(a.point.cmp(&b.point))
            };
            weights.select_nth_unstable_by(MAX_WEIGHTS, strongest);
            weights.truncate(MAX_WEIGHTS);
            weights.sort_unstable_by_key(|s| s.point);
        }
        let all: f32 = weights.iter().map(|s| s.part).sum();
        for share in &mut weights {
            share.part /= all;
        }
        self.wall_samples.push(WallSample {
            normal: n.to_array(),
            start: self.weights.len() as u32,
        });
        self.weights.append(&mut weights);
        true
    }
}

/// Point on a wall that is nearest to a voxel center.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct WallPoint {
    /// Index of the function that represents it.
    point: u32,
    at: Vec3,
    /// Normal of the wall.
    pub n: Vec3,
}

impl WallPoint {
    /// Returns the height of `x` above the wall, meters. Negative behind it.
    pub fn height(&self, x: Vec3) -> f32 {
        (x - self.at).dot(self.n)
    }

    /// Returns `true` if the wall belongs to the next room. The center `x` then lies behind it and
    /// in front of another wall that faces the opposite way.
    pub fn is_beyond(&self, all: &[Self], x: Vec3) -> bool {
        let depth = -self.height(x);
        let between = |other: &Self| {
            let height = other.height(x);
            other.n.dot(self.n) < -MIN_FACING_COSINE
                && height > 0.0
                && height <= depth * (1.0 + 1e-3)
        };
        depth > 0.0 && all.iter().any(between)
    }
}

/// Functions that represent the walls next to each voxel of a volume: the nearest function of each
/// group with similar normals.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct WallIndex {
    /// Function indices of each voxel. Unused entries at the end are `NONE`.
    nearest: Vec<[u32; MAX_FACES]>,
    /// Number of the scene's functions processed.
    seen: usize,
}

impl WallIndex {
    /// Processes functions of a scene until about `max` voxels were visited. Returns the number of
    /// visits, 0 when all functions are processed.
    pub fn find(
        &mut self,
        shape: &VoxelGrid,
        points: &[Point],
        display: &FlatBasis,
        max: u64,
    ) -> u64 {
        self.nearest
            .resize(shape.voxels() as usize, [NONE; MAX_FACES]);
        let mut visit_cost = 0;
        while self.seen < points.len() && visit_cost < max {
            visit_cost += 1 + self.enter(shape, points, &display.planes, self.seen as u32);
            self.seen += 1;
        }
        visit_cost
    }

    /// Returns the wall points next to a voxel with center `x`.
    pub fn points_next_to(
        &self,
        voxel: u32,
        points: &[Point],
        planes: &[[f32; 4]],
        x: Vec3,
    ) -> ([WallPoint; MAX_FACES], usize) {
        let mut wall_points = [WallPoint::default(); MAX_FACES];
        let mut count = 0;
        for &point in self.nearest[voxel as usize].iter().filter(|&&j| j != NONE) {
            let of = &points[point as usize];
            let (at, n) = (nearest_wall_point(of, planes, x), of.n());
            wall_points[count] = WallPoint { point, at, n };
            count += 1;
        }
        (wall_points, count)
    }

    fn enter(&mut self, shape: &VoxelGrid, points: &[Point], planes: &[[f32; 4]], j: u32) -> u64 {
        let point = &points[j as usize];
        let n = point.n();
        // Interpolation on the wall reads voxels whose centers are less than one voxel away along
        // each edge.
        let reach = n.abs().dot(shape.voxel());
        let aside = CORE * point.radius * (1.0 - n * n).max(Vec3::ZERO).map(f32::sqrt);
        let around = shape.voxel() + aside;
        let Some([from, to]) = shape.voxel_range(point.x() - around, point.x() + around) else {
            return 0;
        };
        let size = shape.size();
        for z in from.z..=to.z {
            for y in from.y..=to.y {
                for x in from.x..=to.x {
                    let voxel = UVec3::new(x, y, z);
                    let voxel = voxel.x + size.x * (voxel.y + size.y * voxel.z);
                    let x = shape.voxel_center(voxel);
                    if (x - point.x()).dot(n).abs() > reach {
                        continue;
                    }
                    let far = |j: u32| {
                        let point = &points[j as usize];
                        x.distance_squared(nearest_wall_point(point, planes, x))
                    };
                    let list = &mut self.nearest[voxel as usize];
                    let alike =
                        |&i: &u32| i == NONE || points[i as usize].n().dot(n) >= MIN_SHARED_COSINE;
                    if let Some(k) = list.iter().position(alike)
                        && (list[k] == NONE || far(j) < far(list[k]))
                    {
                        list[k] = j;
                    }
                }
            }
        }
        (to - from + 1).as_u64vec3().element_product()
    }
}

/// Returns the point nearest to `x` that a function represents: on its plane, within [`CORE`] of
/// its radius, and in front of its clip planes.
fn nearest_wall_point(point: &Point, planes: &[[f32; 4]], x: Vec3) -> Vec3 {
    let (center, n, radius) = (point.x(), point.n(), CORE * point.radius);
    let from = x - center;
    let along = from - from.dot(n) * n;
    let mut at = center + along.clamp_length_max(radius);
    for plane in &planes[point.plane_range()] {
        let plane = Vec4::from_array(*plane);
        let behind = -plane.dot(at.extend(1.0));
        let inwards = plane.truncate().reject_from_normalized(n);
        if behind > 0.0 {
            // Moves slightly beyond the plane. A clip plane parallel to the wall moves nothing.
            at += inwards * ((behind + 1e-3 * radius) / inwards.length_squared().max(1e-3));
        }
    }
    at
}
