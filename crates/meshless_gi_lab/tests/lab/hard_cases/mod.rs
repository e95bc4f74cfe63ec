//! Cases in which light transport is known to fail: what is done about each, and that it holds.
//! `docs/reports/robustness.md` lists them with what was measured.

mod closed_rooms;
mod energy;
mod geometry;
mod layers;
mod lights;
mod pca;
mod point_clouds;
mod precision;
mod scale_and_origin;
mod temporal_stability;

use meshless_gi_lab::fixtures::hard_cases as support;
