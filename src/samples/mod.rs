//! Where light is known: surface points, how far apart they are, and how to find the ones near a place.

mod grid;
mod point;

pub use grid::{GridSlot, HashedGrid};
pub use point::Point;
