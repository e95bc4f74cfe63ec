//! How light is written down: the multilevel Shepard basis of \[L08\] §2.

mod cells;
mod clip;
mod flat;
mod hierarchy;
mod kernel;
mod places;
mod probes;
mod shepard;
mod weights;

pub use cells::{CellPart, find_cells};
pub use clip::clip_planes;
pub use hierarchy::{Hierarchy, HierarchySettings};
pub use kernel::{LEAN_FROM, kernel, weight};
pub use places::find_places;
pub use probes::{PROBE_OVERLAP, probe_basis, weight_in_space};
pub use shepard::{LevelBasis, support_bounds};
pub use weights::{WeightEntry, Weights};

/// Sum of weights below which a place counts as not covered: a Shepard quotient of less would be 0/0 or noise.
pub const NO_COVER: f32 = 1e-6;
