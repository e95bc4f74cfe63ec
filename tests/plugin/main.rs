//! Tests of the running plugin, headless, on any GPU adapter (a software one is enough). They are one
//! program, because each further one would link Bevy again.

#[path = "../../examples/common/mod.rs"]
mod common;
#[path = "../support/mod.rs"]
mod support;

mod assets;
mod cameras;
mod display;
mod dynamic_lighting;
mod ecs_changes;
mod effects;
mod entity_bake;
mod example_panel;
mod examples;
mod fog;
mod forward;
mod frame;
mod invalid_input;
mod load_gltf;
mod occluders;
mod octree;
mod outdated_scene;
mod plan;
mod point_cloud;
mod probes;
mod processing;
mod quality;
mod reflect;
mod rsm;
mod soft_shadows;
mod volume;
mod volume_export;
