//! Tests of the running plugin, headless, on any GPU adapter, software adapters included: assets,
//! bakes, changes of the world, the plan and its costs. They are one program, because each further
//! program would link Bevy again. Tests of images are in `plugin_views`, because a software driver
//! keeps the memory of each view until the program ends.

#[path = "../../examples/common/mod.rs"]
mod common;
#[path = "../support/mod.rs"]
mod support;

mod assets;
mod ecs_changes;
mod effects;
mod entity_bake;
mod example_panel;
mod examples;
mod frame;
mod invalid_input;
mod occluders;
mod octree;
mod outdated_scene;
mod plan;
mod point_cloud;
mod processing;
mod quality;
mod reflect;
