//! Representation of light: the multilevel Shepard basis of \[L08\] §2.

mod clip;
mod emitter_points;
mod flat;
mod hierarchy;
mod hit_senders;
mod layer_edge;
mod level_points;
mod light_samples;
mod probes;
mod shepard;
mod visibility;
mod voronoi_cells;
mod weight;
mod weight_rows;

pub use hierarchy::{Hierarchy, HierarchySettings};
pub use hit_senders::GatherHit;
pub use light_samples::{SenderLevel, place_light_samples};
pub use probes::{PROBE_OVERLAP, probe_basis, probe_weight};
pub use shepard::{LevelBasis, support_bounds};
pub use voronoi_cells::{CellPart, find_cells};
pub use weight::{CREASE_MARGIN, LEAN_FROM, crease_weight, flat_weight, kernel, weight};
pub use weight_rows::{WeightEntry, Weights};

/// Sum of weights up to which a position counts as not covered. The Shepard quotient of a smaller
/// sum would be 0/0 or noise.
pub const NO_COVER: f32 = 1e-6;
