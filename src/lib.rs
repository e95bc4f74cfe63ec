//! Instant, noise-free indirect light for Bevy.
//!
//! A bake scatters points over a level, builds a meshless hierarchical basis on them and computes a sparse operator
//! from direct to indirect light. A frame projects the lights that changed, applies the operator and splats the
//! result over the screen.
//!
//! Data flows down this list, and so do imports:
//!
//! | module | what lives there |
//! |---|---|
//! | [`scene`] | what light meets: the [`scene::Geometry`] trait, triangle meshes, point clouds, implicit surfaces, lights, readers |
//! | [`samples`] | where light is known: importance particles, Poisson disks, the hashed grid |
//! | [`basis`] | how light is written down: weights, the hierarchy, Shepard sums, pull-push, clip planes |
//! | [`transport`] | how light travels: the gather, refinement, the sparse operator, bounces |
//! | [`asset`] | the baked scene and its container: format, write, read, validate |
//! | [`frame`] | the CPU twins of the frame's kernels, in the order of a frame |
//! | [`accuracy`] | the reference integrator and the metrics |
//! | [`export`] | light for fixed lights in files that engines read by themselves |
//! | [`bake`] | recipe, stages, progress, statistics: the whole bake as one call |
//! | [`report`] | what accuracy costs: sweeps over recipes, Pareto fronts, charts and a text |
//! | [`plan`] | what this frame's scene calls for |
//! | `gpu` | the same kernels on any wgpu device (feature `gpu`) |
//! | `plugin` | `MeshlessGiPlugin` (feature `bevy`) |
#![warn(missing_docs)]

pub mod accuracy;
pub mod asset;
pub mod bake;
pub mod basis;
pub mod export;
pub mod frame;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod plan;
#[cfg(feature = "bevy")]
pub mod plugin;
pub mod report;
pub mod samples;
pub mod scene;
pub mod transport;

#[cfg(feature = "bevy")]
pub use plugin::prelude;

// The documents' examples are compiled as documentation tests.
#[cfg(all(doctest, feature = "engine"))]
#[doc = include_str!("../README.md")]
struct Readme;
#[cfg(all(doctest, feature = "engine"))]
#[doc = include_str!("../docs/GUIDE.md")]
struct Guide;
