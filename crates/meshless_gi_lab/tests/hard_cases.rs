//! Cases in which light transport is known to fail: what is done about each, and that it holds.
//! `docs/reports/robustness.md` lists them with what was measured.

#[path = "hard_cases/closed_rooms.rs"]
mod closed_rooms;
#[path = "hard_cases/energy.rs"]
mod energy;
#[path = "hard_cases/geometry.rs"]
mod geometry;
#[path = "hard_cases/lights.rs"]
mod lights;
#[path = "hard_cases/pca.rs"]
mod pca;
#[path = "hard_cases/point_clouds.rs"]
mod point_clouds;
#[path = "hard_cases/precision.rs"]
mod precision;
#[path = "hard_cases/scale_and_origin.rs"]
mod scale_and_origin;
#[path = "hard_cases/temporal_stability.rs"]
mod temporal_stability;

use meshless_gi_lab::fixtures::hard_cases as support;
