//! Irradiance at single points of a baked scene, and the reference integrator. The integrator
//! shares only the geometry with the baked path.

mod direct_emission;
mod evaluate;
mod reference;
mod test_lights;

pub use direct_emission::EmissionIntegrator;
pub use evaluate::{Bounces, Evaluated, Evaluator};
pub(crate) use evaluate::{PATCHES, solve};
pub use reference::{
    Irradiance, ReferenceSettings, direct_irradiance, irradiance, irradiance_at_all,
};
pub use test_lights::{NonEmissive, RAYS_PER_POSITION, sample_open_positions};
