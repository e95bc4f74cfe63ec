//! Indirect light of scenes at the pixels of their views and at random surface points: of a bake,
//! beside the path tracer's.
//!
//! The light is what a frame adds to the direct light of its lights: light of lights after one to
//! four reflections, and light of the sky and of emissive surfaces after none to four.

mod displayed_light;
mod strip;
mod view_reference;

pub use displayed_light::DisplayedLight;
pub use strip::{Strip, exposure};
pub use view_reference::{ReferencePoint, ViewReferenceSize, surface_reference, view_reference};

/// Number of reflections.
const BOUNCES: u32 = 4;
