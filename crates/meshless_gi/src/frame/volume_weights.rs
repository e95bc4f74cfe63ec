//! Voxels of a volume, and the weights of the probes at each voxel. Weights depend on no light and
//! are computed once per volume (`find`, in several calls for large volumes). Kernel `volume` is
//! then a short sum per voxel without lookups.
//!
//! A weight is a probe's squared weight of kernel `probe` (\[L08\] Eq. (3) in space), relative to
//! the voxel's largest one: the probe's index in the high 20 bits, the weight in the low 12.
//! Weights below half of the smallest step are dropped. The light of a voxel is the weighted sum
//! over the sum of the weights, so rounding changes no total.

use super::layout::VectorIrradiance;
use super::probe::ProbeIrradiance;
use super::volume_distance::WallDistances;
use super::volume_walls::{WallIndex, WallSamples};
use crate::asset::{Probes, SceneData};
use crate::basis::{NO_COVER, PROBE_OVERLAP, probe_weight};
use crate::transport::PROBE_ROWS;
use glam::{UVec3, Vec3};
use rayon::prelude::*;

/// Maximum number of voxels along an edge. The texture is twice as high and three times as deep.
pub const MAX_VOXELS: u32 = 512;
/// Maximum number of voxels of a volume. With [`MAX_WEIGHTS`] each they fill the largest binding of
/// WebGPU, 128 MiB.
pub const MAX_VOLUME_VOXELS: u32 = 1 << 20;
/// Maximum number of weights of a voxel. If more probes reach it, the largest weights are kept.
pub const MAX_WEIGHTS: usize = 32;
/// Bits of a quantized weight.
pub const WEIGHT_BITS: u32 = 12;
/// Largest quantized weight.
const FULL_WEIGHT: u32 = (1 << WEIGHT_BITS) - 1;
/// Voxels per task.
const RUN: u32 = 256;
/// Approximate cost of a ray, in functions processed.
const RAY: u64 = 8;
/// Number of tasks between two checks of the budget.
const RUNS: u32 = 8;

const _: () = assert!(Probes::MAX <= 1 << (32 - WEIGHT_BITS));

/// A box divided into voxels, in the bake's local space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VoxelGrid {
    low: Vec3,
    voxel: Vec3,
    size: UVec3,
}

impl VoxelGrid {
    /// Creates a grid of `size` voxels from `low` to `high`, meters. Returns `None` if that is no
    /// box, or if the number of voxels is zero or too large. The limits are [`MAX_VOXELS`] along an
    /// edge and [`MAX_VOLUME_VOXELS`] in total.
    #[must_use]
    pub fn new([low, high]: [Vec3; 2], size: UVec3) -> Option<Self> {
        let edges = high - low;
        let fits = size.cmpge(UVec3::ONE).all() && size.cmple(UVec3::splat(MAX_VOXELS)).all();
        if !fits || !edges.is_finite() || !edges.cmpgt(Vec3::ZERO).all() {
            return None;
        }
        // At most 2^27: 512 along each edge.
        let few = size.element_product() <= MAX_VOLUME_VOXELS;
        few.then(|| Self {
            low,
            voxel: edges / size.as_vec3(),
            size,
        })
    }

    /// Returns the box around a bake, divided into at most `max_voxels` voxels of `voxel` meters.
    /// If `voxel` is `None` or not a valid length, it is half the distance between the bake's
    /// probes. Returns `None` for a bake without probe irradiance.
    #[must_use]
    pub fn from_scene(scene: &SceneData, voxel: Option<f32>, max_voxels: u32) -> Option<Self> {
        let probes = scene.probes.as_ref()?;
        let widest = probes.points.iter().map(|p| p.radius).fold(0.0, f32::max);
        let edge = voxel.filter(|e| e.is_finite() && *e > 0.0);
        let edge = edge.unwrap_or(0.5 * widest / PROBE_OVERLAP);
        let [low, high] = scene.bounds.map(Vec3::from_array);
        // Walls at the edge of the scene lie inside.
        let (low, high) = (low - edge, high + edge);
        Self::new([low, high], voxels_of(high - low, edge, max_voxels))
    }

    /// Returns the number of voxels along each edge.
    #[must_use]
    pub fn size(&self) -> UVec3 {
        self.size
    }

    /// Returns the edges of a voxel, meters.
    #[must_use]
    pub fn voxel(&self) -> Vec3 {
        self.voxel
    }

    /// Returns the corner at the first voxel, meters.
    #[must_use]
    pub fn origin(&self) -> Vec3 {
        self.low
    }

    /// Returns the edges of the box, meters.
    #[must_use]
    pub fn edges(&self) -> Vec3 {
        self.voxel * self.size.as_vec3()
    }

    /// Returns the center of the box, meters.
    #[must_use]
    pub fn center(&self) -> Vec3 {
        self.low + 0.5 * self.edges()
    }

    /// Returns the total number of voxels.
    #[must_use]
    pub fn voxels(&self) -> u32 {
        self.size.element_product()
    }

    /// Returns the number of texels of the texture along each edge: six per voxel.
    #[must_use]
    pub fn texels(&self) -> UVec3 {
        self.size * UVec3::new(1, 2, 3)
    }

    /// Returns the first and the last voxel with the center in the box from `low` to `high`, along
    /// each edge. Returns `None` if there are none.
    #[must_use]
    pub fn voxel_range(&self, low: Vec3, high: Vec3) -> Option<[UVec3; 2]> {
        let at = |x: Vec3| (x - self.low) / self.voxel - 0.5;
        let (from, to) = (
            at(low).ceil().max(Vec3::ZERO),
            at(high).floor().min(self.size.as_vec3() - 1.0),
        );
        from.cmple(to)
            .all()
            .then(|| [from.as_uvec3(), to.as_uvec3()])
    }

    /// Returns the center of a voxel, meters. x varies fastest.
    #[must_use]
    pub fn voxel_center(&self, index: u32) -> Vec3 {
        let [x, y, _] = self.size.to_array();
        let at = UVec3::new(index % x, index / x % y, index / (x * y));
        self.low + self.voxel * (at.as_vec3() + 0.5)
    }
}

/// Returns the number of voxels along each edge of a box, meters. Voxels are cubes of about `edge`
/// meters. They are larger if the limit `max`, [`MAX_VOLUME_VOXELS`] in total or [`MAX_VOXELS`]
/// along an edge requires it.
#[must_use]
pub fn voxels_of(edges: Vec3, edge: f32, max: u32) -> UVec3 {
    let edges = edges.max(Vec3::splat(f32::MIN_POSITIVE));
    let mut edge = edge.max(edges.max_element() / MAX_VOXELS as f32);
    let count = |edge: f32| {
        let along = (edges / edge).ceil().max(Vec3::ONE);
        along.as_uvec3().min(UVec3::splat(MAX_VOXELS))
    };
    let max = max.clamp(1, MAX_VOLUME_VOXELS);
    // Rounding up adds at most one voxel along each edge, so a few steps suffice.
    while count(edge).element_product() > max && count(edge) != UVec3::ONE {
        edge *= 1.1;
    }
    count(edge)
}

/// Weights of the probes at each voxel of a volume, and of the surface functions of the walls next
/// to it.
#[derive(Clone, Debug, PartialEq)]
pub struct VoxelWeights {
    shape: VoxelGrid,
    /// Start of each voxel's weights, followed by the end of the last.
    starts: Vec<u32>,
    weights: Vec<u32>,
    wall_samples: WallSamples,
    wall_distances: Vec<WallDistances>,
    /// Walls near voxels, until the table is complete.
    walls: WallIndex,
}

impl VoxelWeights {
    /// Creates an empty table for a grid. Call `find` until it returns `true`.
    #[must_use]
    pub fn new(shape: VoxelGrid) -> Self {
        Self {
            shape,
            starts: vec![0],
            weights: Vec::new(),
            wall_samples: WallSamples::default(),
            wall_distances: Vec::new(),
            walls: WallIndex::default(),
        }
    }

    /// Creates the complete table for a grid.
    #[must_use]
    pub fn from_scene(shape: VoxelGrid, scene: &SceneData) -> Self {
        let mut voxels = Self::new(shape);
        while !voxels.find(scene, u64::MAX) {}
        voxels
    }

    /// Processes up to about `max` functions of probes and surfaces. Returns `true` if the table is
    /// complete. All calls take the same `scene`. The result is the same for any number of threads.
    pub fn find(&mut self, scene: &SceneData, max: u64) -> bool {
        let all = self.shape.voxels();
        let (points, display) = (&scene.points, &scene.display);
        let mut visit_cost = match self.is_whole() {
            true => 0,
            false => self.walls.find(&self.shape, points, display, max),
        };
        while !self.is_whole() && visit_cost < max {
            let found = self.starts.len() as u32 - 1;
            let end = all.min(found + RUN * RUNS);
            let runs: Vec<Run> = (found..end)
                .step_by(RUN as usize)
                .collect::<Vec<_>>()
                .into_par_iter()
                .map(|first| {
                    Run::find(&self.shape, scene, &self.walls, first..end.min(first + RUN))
                })
                .collect();
            for run in runs {
                let before = self.weights.len() as u32;
                self.starts.extend(run.ends.iter().map(|end| before + end));
                self.weights.extend(run.weights);
                self.wall_samples.append(run.wall_samples);
                self.wall_distances.extend(run.wall_distances);
                // A lookup without functions has a cost too.
                visit_cost += run.visit_cost + run.ends.len() as u64;
            }
        }
        if self.is_whole() {
            self.walls = WallIndex::default();
        }
        self.is_whole()
    }

    /// Returns `true` if the table is complete.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.starts.len() as u32 > self.shape.voxels()
    }

    /// Returns the grid of the volume.
    #[must_use]
    pub fn shape(&self) -> &VoxelGrid {
        &self.shape
    }

    /// Returns the start of each voxel's weights, followed by the end of the last.
    #[must_use]
    pub fn starts(&self) -> &[u32] {
        &self.starts
    }

    /// Returns the weights: a probe's index times 2^[`WEIGHT_BITS`], plus the quantized weight.
    #[must_use]
    pub fn weights(&self) -> &[u32] {
        &self.weights
    }

    /// Returns the wall samples.
    #[must_use]
    pub fn wall_samples(&self) -> &WallSamples {
        &self.wall_samples
    }

    /// Returns the distances of each voxel to walls.
    #[must_use]
    pub fn wall_distances(&self) -> &[WallDistances] {
        &self.wall_distances
    }

    /// Returns the irradiance at a voxel that is already processed. `values` are those of the
    /// probes, [`PROBE_ROWS`] each. Returns `None` if no probe reaches it.
    #[must_use]
    pub fn light(&self, values: &[VectorIrradiance], voxel: u32) -> Option<ProbeIrradiance> {
        let at = voxel as usize;
        let weights = &self.weights[self.starts[at] as usize..self.starts[at + 1] as usize];
        let (mut sum, mut all) = (ProbeIrradiance::default(), 0.0);
        for share in weights {
            let (probe, part) = (share >> WEIGHT_BITS, (share & FULL_WEIGHT) as f32);
            all += part;
            sum.add_scaled(part, &values[PROBE_ROWS * probe as usize..][..PROBE_ROWS]);
        }
        let mut out = ProbeIrradiance::default();
        out.add_scaled(1.0 / all, &sum.parts);
        (!weights.is_empty()).then_some(out)
    }
}

/// Weights of consecutive voxels.
struct Run {
    /// End of each voxel's weights, from the run's first one.
    ends: Vec<u32>,
    weights: Vec<u32>,
    wall_samples: WallSamples,
    wall_distances: Vec<WallDistances>,
    /// Number of functions processed and of rays traced.
    visit_cost: u64,
}

impl Run {
    fn find(
        shape: &VoxelGrid,
        scene: &SceneData,
        walls: &WallIndex,
        voxels: std::ops::Range<u32>,
    ) -> Self {
        let mut run = Self {
            ends: Vec::with_capacity(voxels.len()),
            weights: Vec::new(),
            wall_samples: WallSamples::default(),
            wall_distances: Vec::with_capacity(voxels.len()),
            visit_cost: 0,
        };
        let (points, display) = (&scene.points, &scene.display);
        let mut reaching: Vec<(u32, f32)> = Vec::new();
        for voxel in voxels {
            let x = shape.voxel_center(voxel);
            let (beside, count) = walls.points_next_to(voxel, points, &display.planes, x);
            let beside = &beside[..count];
            run.visit_cost += run.wall_samples.find(beside, points, display, x);
            let behind = (beside.iter())
                .filter(|b| !b.is_beyond(beside, x))
                .map(|b| (-b.height(x), b.n))
                .filter(|(depth, _)| *depth > 0.0);
            run.wall_distances
                .push(WallDistances::find(shape, &scene.bvh, x, behind));
            run.visit_cost += RAY * 6;
            let Some(probes) = &scene.probes else {
                run.ends.push(0);
                continue;
            };
            let near = probes.grid.indices_near(x);
            run.visit_cost += near.len() as u64;
            reaching.clear();
            let weights = near.iter().map(|&j| {
                (
                    j,
                    probe_weight(&probes.points[j as usize], &probes.planes, x, Vec3::ZERO),
                )
            });
            reaching.extend(weights.filter(|&(_, w)| w > 0.0));
            run.weights_of(&mut reaching);
            run.ends.push(run.weights.len() as u32);
        }
        run
    }

    /// Adds the weights of one position from the probes that reach it and their weights.
    fn weights_of(&mut self, reaching: &mut Vec<(u32, f32)>) {
        if reaching.iter().map(|r| r.1).sum::<f32>() <= NO_COVER {
            return;
        }
        if reaching.len() > MAX_WEIGHTS {
            let strongest =
                |a: &(u32, f32), b: &(u32, f32)| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0));
            reaching.select_nth_unstable_by(MAX_WEIGHTS, strongest);
            reaching.truncate(MAX_WEIGHTS);
            reaching.sort_unstable_by_key(|r| r.0);
        }
        let largest = reaching.iter().map(|r| r.1).fold(0.0, f32::max);
        for &(probe, weight) in reaching.iter() {
            let part = weight / largest;
            let part = (part * part * FULL_WEIGHT as f32).round() as u32;
            if part > 0 {
                self.weights.push(probe << WEIGHT_BITS | part);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn voxel_grid_has_requested_size_within_limit() {
        let room = Vec3::new(8.0, 3.0, 4.0);
        assert_eq!(voxels_of(room, 0.25, u32::MAX), UVec3::new(32, 12, 16));
        for max in [1, 100, 4096, 65_536, u32::MAX] {
            let size = voxels_of(room, 0.01, max);
            let max = max.min(MAX_VOLUME_VOXELS);
            assert!(size.element_product() <= max, "{size}");
            assert!(max < 100 || size.element_product() * 3 > max, "{size}");
        }
        // A line, a plane and a point are boxes with a width of one voxel.
        let thin = voxels_of(Vec3::new(100.0, 0.0, 1e-30), 0.01, u32::MAX);
        assert_eq!(thin, UVec3::new(MAX_VOXELS, 1, 1));
        assert_eq!(voxels_of(Vec3::ZERO, 1.0, 8), UVec3::ONE);
    }

    #[test]
    fn voxel_grid_invalid_bounds_are_rejected() {
        let room = [Vec3::ZERO, Vec3::ONE];
        assert!(VoxelGrid::new(room, UVec3::splat(4)).is_some());
        assert!(VoxelGrid::new(room, UVec3::new(4, 0, 4)).is_none());
        assert!(VoxelGrid::new(room, UVec3::new(4, MAX_VOXELS + 1, 4)).is_none());
        assert!(VoxelGrid::new(room, UVec3::new(512, 512, 4)).is_some());
        assert!(VoxelGrid::new(room, UVec3::new(512, 512, 5)).is_none());
        assert!(VoxelGrid::new([Vec3::ONE, Vec3::ZERO], UVec3::ONE).is_none());
        assert!(VoxelGrid::new([Vec3::ZERO, Vec3::splat(f32::NAN)], UVec3::ONE).is_none());
    }

    #[test]
    fn voxel_weights_keep_strongest_functions() {
        let mut run = Run {
            ends: Vec::new(),
            weights: Vec::new(),
            wall_samples: WallSamples::default(),
            wall_distances: Vec::new(),
            visit_cost: 0,
        };
        // Every third probe is strong, and there are more of them than a position keeps. The weak
        // ones would round to zero.
        let mut reaching: Vec<(u32, f32)> = (0..120)
            .map(|j| {
                (
                    j,
                    if j % 3 == 0 {
                        1.0 - 0.005 * j as f32
                    } else {
                        0.3
                    },
                )
            })
            .collect();
        run.weights_of(&mut reaching);
        let probes: Vec<u32> = run.weights.iter().map(|s| s >> WEIGHT_BITS).collect();
        assert_eq!(probes, (0..32).map(|k| 3 * k).collect::<Vec<_>>());
        assert_eq!(run.weights[0], FULL_WEIGHT);
        assert_eq!(
            run.weights[1] & FULL_WEIGHT,
            (0.985f32.powi(2) * 4095.0).round() as u32
        );
        // Negligible weights are dropped, and so is a position with little cover.
        run.weights.clear();
        run.weights_of(&mut vec![(7, 0.5), (9, 0.004)]);
        assert_eq!(run.weights, [7 << WEIGHT_BITS | FULL_WEIGHT]);
        run.weights.clear();
        run.weights_of(&mut vec![(7, 0.5 * NO_COVER)]);
        assert!(run.weights.is_empty());
    }
}
