//! Arrays of a baked scene in memory, in the layout that the kernels read.
//!
//! Points are numbered level after level, coarse first, and `level_starts` bounds the levels.
//! Points of the first `sender_levels` levels are the senders: sender j is point j.

use super::materials::DynamicMaterials;
use super::occluders::Occluders;
use super::probes::Probes;
use super::sky::SkyVisibility;
use crate::basis::Weights;
use crate::samples::{HashedGrid, LightSample, Point};
use crate::scene::Bvh;
use crate::transport::fmm::FmmOperator;
use crate::transport::pca::Visibility;
use crate::transport::{BounceOperator, Operator};
use bytemuck::{Pod, Zeroable};

/// Material at a point, and its sky visibility. 48 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct PointSurface {
    /// Diffuse reflectance, linear RGB.
    pub albedo: [f32; 3],
    /// Padding, unused.
    pub pad0: f32,
    /// Emitted radiosity M, W/m².
    pub emission: [f32; 3],
    /// Padding, unused.
    pub pad1: f32,
    /// (1/π) ∫ ω dω over the unoccluded directions: the irradiance of a uniform sky is π L (v·n).
    pub sky: [f32; 3],
    /// Padding, unused.
    pub pad2: f32,
}

/// Flat display basis (\[L08\] §4.1 "Flattening"): the same points, one level, one radius.
#[derive(Clone, Debug, PartialEq)]
pub struct FlatBasis {
    /// Radius of every function, meters, equal to each point's `radius`.
    pub radius: f32,
    /// Clip planes (n, d): a position p is on the function's side if n·p + d ≥ 0. `Point::planes`
    /// refers to them.
    pub planes: Vec<[f32; 4]>,
    /// Grid of the functions that may cover a position.
    pub grid: HashedGrid,
}

/// Positions at which light is projected onto the senders of the finest sender level. A sender's
/// light is the mean over its samples. Without samples, and on coarser levels, it is the light at
/// the sender's own point.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LightSamples {
    /// Number of samples per sender.
    pub per_sender: u32,
    /// Samples of each sender, from the first of the finest sender level.
    pub list: Vec<LightSample>,
}

impl LightSamples {
    /// Largest number of samples per sender.
    pub const MAX: u32 = 64;
}

/// Arrays of a baked scene, as the kernels read them.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneData {
    /// All points, level after level, coarse first. `radius` and `planes` are those of the display
    /// basis.
    pub points: Vec<Point>,
    /// Surfaces, one per point.
    pub surfaces: Vec<PointSurface>,
    /// First point of each level, and the end of the last.
    pub level_starts: Vec<u32>,
    /// Number of sender levels, counted from the coarsest.
    pub sender_levels: u32,
    /// Light samples of the finest sender level.
    pub light_samples: LightSamples,
    /// Row k (a sender): weights of the senders of the next level, with sum one. Their mean is the
    /// value of sender k. A sender with an empty row keeps its own light. All rows of the finest
    /// sender level are empty. One row per sender.
    pub pull: Weights,
    /// Row i (a point): the coarser functions that cover it. For
    /// [`SenderForm::Averages`](crate::transport::SenderForm), those of the nearest coarser level
    /// that covers it, with weights that sum to one. For `Differences`, those of all coarser
    /// levels, with weights that sum to one per level (\[L08\] Eq. (17) "all-parents"). Empty on
    /// the coarsest level.
    pub parents: Weights,
    /// One-bounce operator.
    pub operator: Operator,
    /// Octree that replaces the operator's links, for method `fmm`: the tier above those of the
    /// operator. `None` if the recipe has none.
    pub fmm: Option<FmmOperator>,
    /// Baked further bounces. `None` if the recipe has none.
    pub bounces: Option<BounceOperator>,
    /// Irradiance of every point under fixed lights, W/m²: direct light and all reflections of the
    /// recipe. Empty if it was not requested.
    pub illumination: Vec<[f32; 3]>,
    /// Visibility of the senders and of the points of complete levels after them, for soft shadows
    /// without rays. `None` if the recipe has none.
    pub visibility: Option<Visibility>,
    /// Visibility of a non-uniform sky at the senders. `None` if the recipe has none. Links to its
    /// terms are among the operator's.
    pub sky: Option<SkyVisibility>,
    /// Dynamic materials of the senders. `None` if the recipe has none.
    pub materials: Option<DynamicMaterials>,
    /// Probes. `None` if the recipe has none.
    pub probes: Option<Probes>,
    /// Occluders. `None` if the recipe names none.
    pub occluders: Option<Occluders>,
    /// Display basis.
    pub display: FlatBasis,
    /// Shadow casters.
    pub bvh: Bvh,
    /// Box around the geometry, meters: smallest and largest corner.
    pub bounds: [[f32; 3]; 2],
}

impl SceneData {
    /// Returns the number of levels.
    #[must_use]
    pub fn levels(&self) -> usize {
        self.level_starts.len() - 1
    }

    /// Returns the number of shadow rays to project one light: one per coarse sender, and one per
    /// light sample.
    #[must_use]
    pub fn rays_per_slot(&self) -> u64 {
        let finest = (self.sender_levels as usize).saturating_sub(1);
        let single = self
            .level_starts
            .get(finest)
            .map_or(0, |&start| u64::from(start));
        single + self.light_samples.list.len() as u64
    }

    /// Returns the number of tiers that use links: those of the operator, or 0 if an octree
    /// replaces all links.
    #[must_use]
    pub fn link_tiers(&self) -> u32 {
        match self.fmm.is_some() && self.operator.rows.iter().all(|row| row.tier == 0) {
            true => 0,
            false => self.operator.tiers(),
        }
    }

    /// Returns the number of tiers that a frame may choose from, at least 1: those with links, and
    /// the octree above them if there is one.
    #[must_use]
    pub fn tiers(&self) -> u32 {
        self.link_tiers() + u32::from(self.fmm.is_some())
    }

    /// Returns rows and links (entries of the lists, for the octree) of each tier, tier 1 first.
    #[must_use]
    pub fn tier_sizes(&self) -> Vec<(u64, u64)> {
        let mut sizes = self.operator.tier_sizes();
        sizes.truncate(self.link_tiers() as usize);
        sizes.extend(self.fmm.as_ref().map(|octree| {
            let receive = octree.nodes.iter().filter(|n| n.is_leaf());
            let rows = receive.map(|n| n.receiver_range().len() as u64).sum();
            (rows, octree.entries.len() as u64)
        }));
        sizes
    }

    /// Returns the points of level `l`.
    #[must_use]
    pub fn level(&self, l: usize) -> std::ops::Range<usize> {
        self.level_starts[l] as usize..self.level_starts[l + 1] as usize
    }

    /// Returns the number of senders without the sky.
    #[must_use]
    pub fn senders(&self) -> usize {
        self.level_starts[self.sender_levels as usize] as usize
    }

    /// Returns the senders of the finest sender level.
    #[must_use]
    pub fn finest_senders(&self) -> std::ops::Range<usize> {
        self.level(self.sender_levels as usize - 1)
    }
}
