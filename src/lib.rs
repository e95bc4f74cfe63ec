//! Instant, noise-free indirect light for Bevy.
//!
//! [`meshless_gi`] bakes a scene and defines what a frame computes. This crate records the frame on a GPU:
//! the kernels on any wgpu device (feature `gpu`), and `MeshlessGiPlugin` (feature `bevy`).
//!
//! Data flows down this list, and so do imports:
//!
//! | module | content |
//! |---|---|
//! | [`plan`] | effects that a frame's scene calls for |
//! | `gpu` | the kernels on any wgpu device (feature `gpu`) |
//! | `plugin` | `MeshlessGiPlugin` (feature `bevy`) |
#![warn(missing_docs)]

#[cfg(feature = "gpu")]
pub mod gpu;
pub mod plan;
#[cfg(feature = "bevy")]
pub mod plugin;

pub use meshless_gi;
#[cfg(feature = "bevy")]
pub use plugin::prelude;

// The documents' examples are compiled as documentation tests.
#[cfg(all(doctest, feature = "bevy"))]
#[doc = include_str!("../README.md")]
struct Readme;
#[cfg(all(doctest, feature = "bevy"))]
#[doc = include_str!("../docs/GUIDE.md")]
struct Guide;
