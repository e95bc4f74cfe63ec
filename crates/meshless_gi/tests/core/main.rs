//! Bakes, their files and their frames on the CPU, without the lab.

mod asset_bake;
mod occluders;
mod tiers;
mod watertight;
