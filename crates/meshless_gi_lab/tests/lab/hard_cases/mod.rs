//! Known failure cases of light transport, and tests of the remedy for each.
//! `docs/reports/robustness.md` lists them with the measurements.

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
