//! Counts of a valid baked scene, as `inspect` and `validate` print them.

use super::materials::DynamicMaterials;
use super::occluders::Occluders;
use super::probes::Probes;
use super::scene_data::SceneData;
use crate::basis::Weights;
use crate::samples::GridSlot;
use crate::transport::fmm::FmmOperator;
use crate::transport::pca::Compression;

/// Counts of a valid scene.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct BakedStats {
    /// Points of each level, coarse first.
    pub points_per_level: Vec<u64>,
    /// Senders, without the sky.
    pub senders: u64,
    /// Points with a row of their own.
    pub active_rows: u64,
    /// Links of the operator.
    pub links: u64,
    /// Links of the longest row.
    pub longest_row: u64,
    /// Weights of the pull rows.
    pub pull_weights: u64,
    /// Weights of the parent rows.
    pub parent_weights: u64,
    /// Entries of the baked bounces. 0 without baked bounces.
    pub bounce_links: u64,
    /// Clip planes.
    pub planes: u64,
    /// Cells of the display's grid.
    pub grid_cells: u64,
    /// Entries of the longest list of the display's grid.
    pub longest_list: u64,
    /// Nodes of the BVH.
    pub bvh_nodes: u64,
    /// Triangles of the BVH.
    pub bvh_triangles: u64,
    /// Levels of the BVH.
    pub bvh_depth: u64,
    /// Columns of an operator of components, without the sky's. 0 in the other forms.
    pub columns: u64,
    /// Clusters of senders that share columns.
    pub clusters: u64,
    /// Values of the columns.
    pub column_values: u64,
    /// Clusters of points with visibility. 0 without visibility.
    pub visibility_clusters: u64,
    /// Stored coefficients of the visibility.
    pub visibility_coefficients: u64,
    /// Bytes of the visibility.
    pub visibility_bytes: u64,
    /// Probes. 0 without probes.
    pub probes: u64,
    /// Links of the probes' rows.
    pub probe_links: u64,
    /// Nodes of the octree of method `fmm`. 0 without an octree.
    pub fmm_nodes: u64,
    /// Entries of the octree's lists.
    pub fmm_entries: u64,
    /// Points of the octree, emitting and receiving.
    pub fmm_points: u64,
    /// Bytes of the octree.
    pub fmm_bytes: u64,
    /// Dynamic materials. 0 without dynamic materials.
    pub materials: u64,
    /// Coverages of senders by dynamic materials.
    pub material_shares: u64,
    /// Occluders. 0 without occluders.
    pub occluders: u64,
    /// Terms of links that occluders block.
    #[serde(rename = "passages")]
    pub occluded_link_terms: u64,
    /// Terms of a non-uniform sky. 0 for a uniform sky.
    pub sky_terms: u64,
    /// Bytes of all arrays.
    pub memory: u64,
}

impl SceneData {
    pub(super) fn stats(&self, bvh_depth: u64) -> BakedStats {
        let rows = &self.operator.rows;
        let grid = &self.display.grid;
        let bytes = |length: usize, size: usize| (length * size) as u64;
        let weights = |w: &Weights| bytes(w.starts.len(), 4) + bytes(w.entries.len(), 8);
        let bounces = self.bounces.as_ref();
        let columns = self.operator.compression.as_ref();
        let visibility = self.visibility.as_ref();
        let probes = self.probes.as_ref();
        let octree = self.fmm.as_ref();
        BakedStats {
            probes: probes.map_or(0, |p| p.points.len() as u64),
            probe_links: probes.map_or(0, |p| p.links.len() as u64),
            materials: (self.materials.as_ref()).map_or(0, |m| m.factors.len() as u64),
            occluders: (self.occluders.as_ref()).map_or(0, |o| o.names.len() as u64),
            occluded_link_terms: (self.occluders.as_ref())
                .map_or(0, |o| (o.links.len() + o.probes.len()) as u64),
            material_shares: (self.materials.as_ref()).map_or(0, |m| m.shares.len() as u64),
            sky_terms: self.sky_terms() as u64,
            fmm_nodes: octree.map_or(0, |o| o.nodes.len() as u64),
            fmm_entries: octree.map_or(0, |o| o.entries.len() as u64),
            fmm_points: octree.map_or(0, |o| o.points.len() as u64),
            fmm_bytes: octree.map_or(0, FmmOperator::bytes),
            visibility_clusters: visibility.map_or(0, |v| v.clusters.len() as u64),
            visibility_coefficients: visibility
                .map_or(0, |v| v.points.iter().map(|p| u64::from(p.count())).sum()),
            visibility_bytes: visibility.map_or(0, |v| v.bytes() as u64),
            points_per_level: self
                .level_starts
                .windows(2)
                .map(|w| u64::from(w[1] - w[0]))
                .collect(),
            senders: self.senders() as u64,
            active_rows: rows.iter().filter(|r| r.tier != 0).count() as u64,
            links: self.operator.links.len() as u64,
            longest_row: rows.iter().map(|r| u64::from(r.count)).max().unwrap_or(0),
            pull_weights: self.pull.entries.len() as u64,
            parent_weights: self.parents.entries.len() as u64,
            bounce_links: bounces.map_or(0, |b| b.links.len() as u64),
            planes: self.display.planes.len() as u64,
            grid_cells: grid
                .slots
                .iter()
                .filter(|s| s.start != GridSlot::EMPTY)
                .count() as u64,
            longest_list: grid
                .slots
                .iter()
                .filter_map(|s| grid.entries.get(s.start as usize))
                .map(|&n| u64::from(n))
                .max()
                .unwrap_or(0),
            bvh_nodes: self.bvh.nodes.len() as u64,
            bvh_triangles: self.bvh.triangles.len() as u64,
            bvh_depth,
            columns: columns.map_or(0, |c| c.components() as u64),
            clusters: columns.map_or(0, |c| {
                let own = &c.columns[..c.components()];
                own.chunk_by(|a, b| a.member == b.member).count() as u64
            }),
            column_values: columns
                .map_or(0, |c| c.columns.iter().map(|c| u64::from(c.count)).sum()),
            memory: visibility.map_or(0, |v| v.bytes() as u64)
                + probes.map_or(0, Probes::bytes)
                + octree.map_or(0, FmmOperator::bytes)
                + self.materials.as_ref().map_or(0, DynamicMaterials::bytes)
                + self.occluders.as_ref().map_or(0, Occluders::bytes)
                + self.sky.as_ref().map_or(0, |s| bytes(s.senders.len(), 32))
                + bytes(self.illumination.len(), 12)
                + bytes(self.points.len(), 32 + 48 + 16)
                + bytes(self.operator.links.len(), 8)
                + columns.map_or(0, Compression::bytes)
                + weights(&self.pull)
                + weights(&self.parents)
                + bounces.map_or(0, |b| bytes(b.starts.len(), 4) + bytes(b.links.len(), 16))
                + bytes(self.display.planes.len(), 16)
                + bytes(grid.slots.len(), 16)
                + bytes(grid.entries.len(), 4)
                + bytes(self.bvh.nodes.len(), 32)
                + bytes(self.bvh.triangles.len(), 48),
        }
    }
}
