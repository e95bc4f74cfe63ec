//! What light meets. Basis and transport know a scene only through [`Geometry`] ([L08] §5.1); everything here may be
//! swapped for another representation without touching them.
//!
//! Lengths are metres, right-handed, Y up; light is linear RGB.

mod bvh;
mod geometry;
mod light;

pub use bvh::{Bvh, BvhNode, BvhTriangle};
pub use geometry::{Bounds, Geometry, Hit, Ray, Surface};
pub use light::Light;
