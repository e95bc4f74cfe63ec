//! How wrong it is: a reference integrator that shares nothing with the baked path but the geometry, and the metrics of design and docs.

mod metrics;
mod reference;

pub use metrics::{Errors, errors};
pub use reference::{
    Irradiance, ReferenceSettings, direct_irradiance, irradiance, irradiance_at_all,
};
