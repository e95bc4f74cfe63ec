//! How light is written down: the multilevel Shepard basis of [L08] §2.

mod weights;

pub use weights::{WeightEntry, Weights};
