//! Indirect light of scenes at the pixels of their views and at random surface points: of a bake,
//! and of the path tracer.
//!
//! It is the light that a frame adds to direct light. For lights, it includes one to four
//! reflections. For the sky and emissive surfaces, it includes none to four.

mod displayed_light;
mod strip;
mod view_reference;

pub use displayed_light::DisplayedLight;
pub use strip::{Strip, exposure};
pub use view_reference::{ReferencePoint, ViewReferenceSize, surface_reference, view_reference};

/// Number of reflections.
const BOUNCES: u32 = 4;
