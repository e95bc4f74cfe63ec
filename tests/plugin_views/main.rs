//! Tests of the plugin's images: cameras, displays, shadows, volumes and fog. See `tests/plugin`.
//! The example `load_gltf` is here because it has a copy of `examples/common`.

#[path = "../support/mod.rs"]
mod support;

mod cameras;
mod display;
mod dynamic_lighting;
mod fog;
mod forward_cameras;
mod load_gltf;
mod probes;
mod rsm;
mod soft_shadows;
mod volume;
mod volume_export;
