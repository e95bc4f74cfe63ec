//! How wrong it is: a reference integrator that shares nothing with the baked path but the geometry, the closed forms that it is tested against, the
//! metrics of design and docs, a test whether two noisy estimates agree, a baked scene evaluated at single places, and a renderer for pictures on the CPU.

mod agreement;
pub mod closed_form;
mod direct;
mod evaluate;
mod flip;
mod metrics;
mod reference;
mod render;
mod truth;

pub use agreement::{Agreement, Estimates, agreement};
pub use direct::GlowLight;
pub use evaluate::{Bounces, Evaluated, Evaluator};
pub use flip::{flip, flip_map};
pub use metrics::{Errors, errors, leak_ratio};
pub use reference::{
    Irradiance, ReferenceSettings, direct_irradiance, irradiance, irradiance_at_all,
};
pub use render::{Camera, Image, render};
pub use truth::{BOUNCES, Comparison, Truth, TruthError};
