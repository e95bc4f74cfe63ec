//! Functions shared by the tests of the plugin.
#![allow(dead_code, reason = "each test uses its part")]

pub mod app;
pub mod assets;
pub mod bakes;
pub mod bounce;
pub mod flip;
pub mod glb;
pub mod log;
pub mod scenes;
pub mod stage;
