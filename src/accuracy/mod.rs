//! How wrong it is: a reference integrator that shares nothing with the baked path but the geometry, the metrics of design and docs, and a
//! renderer for pictures on the CPU.

mod metrics;
mod reference;
mod render;

pub use metrics::{Errors, errors};
pub use reference::{
    Irradiance, ReferenceSettings, direct_irradiance, irradiance, irradiance_at_all,
};
pub use render::{Camera, Image, render};
