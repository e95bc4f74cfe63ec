//! Bakes and frames on the CPU against closed forms, the reference integrator and each other. One
//! program, so that it links once and its tests run in parallel. `--test lab SUBJECT` runs a
//! module.

mod asset_roundtrip;
mod closed_forms;
mod cpu_frame;
mod emitters;
mod error_estimate;
mod evaluate;
mod fmm;
mod fog;
mod hard_cases;
mod leaks;
mod occluder_display;
mod penumbra;
mod pictures;
mod point_cloud_light;
mod probes;
mod rsm;
mod sphere_over_disk;
mod subsplats;
#[path = "../support/mod.rs"]
mod support;
mod v11;
mod visibility;
mod vpl_specular;
