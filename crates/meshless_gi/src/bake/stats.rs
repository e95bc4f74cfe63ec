//! Statistics of a bake: the tool's `--stats` file.

use super::packing::RowFacts;
use crate::asset::{BakeInfo, EnergyInfo, SceneData, TierInfo};
use crate::transport::fmm::FmmOperator;
use crate::transport::pca::Visibility;
use serde::{Deserialize, Serialize};

/// Wall-clock time of each stage, in seconds. Gather and refinement run together on all threads.
/// Their time is split by processor time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct StageSeconds {
    /// Reading the scene.
    pub load: f64,
    /// Building the BVH.
    pub bvh: f64,
    /// Scattering points and building levels, parents and clip planes.
    pub points: f64,
    /// Casting gather rays and summing them.
    pub gather: f64,
    /// Selecting receivers and links.
    pub refine: f64,
    /// Baking bounces.
    pub bounces: f64,
    /// Baking visibility for soft shadows.
    #[serde(default)]
    pub visibility: f64,
    /// Gathering probes.
    #[serde(default)]
    pub probes: f64,
    /// Building the octree of method `fmm`.
    #[serde(default)]
    pub octree: f64,
    /// Estimating the error.
    pub estimate: f64,
    /// Writing the file.
    pub write: f64,
    /// Whole bake.
    pub total: f64,
}

/// Statistics of a bake.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct BakeStats {
    /// Wall-clock times.
    pub seconds: StageSeconds,
    /// Number of rays of all kinds.
    pub rays: u64,
    /// Number of rays of the gather.
    pub gather_rays: u64,
    /// Number of triangles or other primitives.
    pub triangles: u64,
    /// Number of points of each level, coarse first.
    pub points_per_level: Vec<u64>,
    /// Number of senders.
    pub senders: u64,
    /// Number of receivers that were gathered.
    pub gathered: u64,
    /// Number of points with a row.
    pub active_rows: u64,
    /// Number of links of the operator.
    pub links: u64,
    /// Number of sender clusters of method `pca`. 0 with other methods.
    pub clusters: u64,
    /// Number of vectors of all light bases, which are columns of the operator.
    pub components: u64,
    /// Fraction of the training lights that the bases miss, root mean square.
    pub basis_missed: f64,
    /// Size of the file in bytes. 0 before it is written.
    pub bytes: u64,
    /// Number of threads.
    pub threads: u64,
    /// See [`crate::asset::BakeInfo::estimated_nrmse`].
    pub estimated_nrmse: f64,
    /// Half width of its 95 % prediction interval for one more light.
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
    /// Number of probes. 0 without probes.
    #[serde(default)]
    pub probes: u64,
    /// Number of links of the probes.
    #[serde(default)]
    pub probe_links: u64,
    /// Fraction of the directions from probes that hit a surface without a sender, or a back side.
    #[serde(default)]
    pub probes_lost: f64,
    /// Size of the visibility data in bytes. 0 without soft shadows.
    #[serde(default)]
    pub visibility_bytes: u64,
    /// Fraction of the visibility coefficients that is stored.
    #[serde(default)]
    pub visibility_kept: f64,
    /// Size of the octree in bytes. 0 without method `fmm`.
    #[serde(default)]
    pub octree_bytes: u64,
    /// Number of entries of the octree's lists.
    #[serde(default)]
    pub octree_entries: u64,
    /// Number of clip planes of the flat basis.
    pub clip_planes: u64,
    /// Levels that have fewer points than needed, because they reached the limit.
    pub truncated_levels: Vec<u64>,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

impl BakeStats {
    /// Collects the statistics of a bake from its results.
    pub(super) fn new(
        scene: &SceneData,
        info: &BakeInfo,
        facts: RowFacts,
        warnings: Vec<String>,
        seconds: StageSeconds,
    ) -> Self {
        let (octree, visibility) = (scene.fmm.as_ref(), scene.visibility.as_ref());
        let probes = scene.probes.as_ref();
        let levels = scene.level_starts.windows(2);
        let rows = scene.operator.rows.iter();
        Self {
            seconds,
            rays: info.rays,
            gather_rays: facts.gather_rays,
            triangles: info.triangles,
            points_per_level: levels.map(|w| u64::from(w[1] - w[0])).collect(),
            senders: scene.senders() as u64,
            gathered: facts.gathered,
            active_rows: rows.filter(|row| row.tier != 0).count() as u64,
            links: scene.operator.links.len() as u64,
            clusters: facts.basis.clusters,
            components: facts.basis.components,
            basis_missed: facts.basis.missed,
            bytes: 0,
            threads: rayon::current_num_threads() as u64,
            estimated_nrmse: info.estimated_nrmse.into(),
            estimated_nrmse_interval: info.estimated_nrmse_interval.into(),
            tiers: info.tiers.clone(),
            uncovered: facts.uncovered,
            largest_row_sum: info.largest_row_sum.into(),
            energy: info.energy,
            link_error: info.link_error.into(),
            probes: probes.map_or(0, |p| p.points.len() as u64),
            probe_links: probes.map_or(0, |p| p.links.len() as u64),
            probes_lost: facts.probes_lost,
            visibility_bytes: visibility.map_or(0, |v| v.bytes() as u64),
            visibility_kept: visibility.map_or(0.0, Visibility::kept),
            octree_bytes: octree.map_or(0, FmmOperator::bytes),
            octree_entries: octree.map_or(0, |o| o.entries.len() as u64),
            clip_planes: scene.display.planes.len() as u64,
            truncated_levels: facts.truncated_levels,
            warnings,
        }
    }
}
