//! Where a bake's time went and what came out: the tool's `--stats` file.

use crate::asset::{EnergyInfo, TierInfo};
use serde::{Deserialize, Serialize};

/// Seconds of wall-clock time by stage. Gather and refinement run together on all threads; their
/// share of it is split by the processor time that each took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StageSeconds {
    /// Reading the level.
    pub load: f64,
    /// Building the BVH.
    pub bvh: f64,
    /// Scattering points, levels, parents, clip planes.
    pub points: f64,
    /// Rays of the gather and what they add up to.
    pub gather: f64,
    /// Deciding on receivers and links.
    pub refine: f64,
    /// Baked bounces.
    pub bounces: f64,
    /// What points see, for soft shadows.
    #[serde(default)]
    pub visibility: f64,
    /// Light in free space.
    #[serde(default)]
    pub probes: f64,
    /// The octree of rule `fmm`.
    #[serde(default)]
    pub octree: f64,
    /// Measuring the error.
    pub estimate: f64,
    /// Writing the file.
    pub write: f64,
    /// Everything.
    pub total: f64,
}

/// What a bake did.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BakeStats {
    /// Wall-clock seconds.
    pub seconds: StageSeconds,
    /// Rays cast, of all kinds.
    pub rays: u64,
    /// Rays of the gather alone.
    pub gather_rays: u64,
    /// Triangles (or other primitives).
    pub triangles: u64,
    /// Points of each level, coarse first.
    pub points_per_level: Vec<u64>,
    /// Senders.
    pub senders: u64,
    /// Receivers that were gathered.
    pub gathered: u64,
    /// Points with a row of their own.
    pub active_rows: u64,
    /// Links of the operator.
    pub links: u64,
    /// Clusters of senders with a basis of direct light each; 0 but under rule `pca`.
    pub clusters: u64,
    /// Vectors of all bases: columns of the operator.
    pub components: u64,
    /// Share of the example lamps' light (root mean square) that the bases miss.
    pub basis_missed: f64,
    /// Size of the file, bytes; 0 before it is written.
    pub bytes: u64,
    /// Threads used.
    pub threads: u64,
    /// See [`crate::asset::BakeInfo::estimated_nrmse`].
    pub estimated_nrmse: f64,
    /// Half width of its 95 % prediction interval for one more lamp.
    pub estimated_nrmse_interval: f64,
    /// See [`crate::asset::BakeInfo::tiers`].
    pub tiers: Vec<TierInfo>,
    /// See [`crate::asset::BakeInfo::uncovered`].
    pub uncovered: f64,
    /// See [`crate::asset::BakeInfo::largest_row_sum`].
    pub largest_row_sum: f64,
    /// See [`crate::asset::BakeInfo::energy`].
    pub energy: EnergyInfo,
    /// See [`crate::asset::BakeInfo::link_error`].
    pub link_error: f64,
    /// Probes in free space; 0 where none were asked for.
    #[serde(default)]
    pub probes: u64,
    /// Links of their rows.
    #[serde(default)]
    pub probe_links: u64,
    /// Part of the directions from probes that met a surface which no sender covers, or the back of
    /// one.
    #[serde(default)]
    pub probes_lost: f64,
    /// Bytes of visibility in memory and on the device; 0 without soft shadows.
    #[serde(default)]
    pub visibility_bytes: u64,
    /// Share of visibility's coefficients that are kept.
    #[serde(default)]
    pub visibility_kept: f64,
    /// Bytes of the octree of rule `fmm` in memory and on the device; 0 under every other rule.
    #[serde(default)]
    pub octree_bytes: u64,
    /// Entries of its lists.
    #[serde(default)]
    pub octree_entries: u64,
    /// Clip planes of the display basis.
    pub clip_planes: u64,
    /// Levels cut short because they would have had too many points.
    pub truncated_levels: Vec<u64>,
    /// What the user of the bake should know of it, in words; nothing for most.
    pub warnings: Vec<String>,
}
