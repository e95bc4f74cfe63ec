//! Tests of the plugin's images: cameras, displays, shadows, volumes and fog. See `tests/plugin`.

#[path = "../support/mod.rs"]
mod support;

mod cameras;
mod display;
mod dynamic_lighting;
mod fog;
mod probes;
mod rsm;
mod soft_shadows;
mod volume;
mod volume_export;
