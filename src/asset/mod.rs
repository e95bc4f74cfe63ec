//! The baked scene: what a frame needs, and its `.mgi` container.

mod baked;
mod info;

pub use baked::{BakedScene, Display, PointSurface};
pub use info::BakeInfo;
