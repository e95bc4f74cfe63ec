//! Precomputed indirect light.
//!
//! A bake scatters points over a scene, builds a meshless hierarchical basis on them and computes a
//! sparse operator from direct to indirect light. A frame projects the lights that changed, applies
//! the operator and reads the result at every pixel. This crate has the bake, its file, and the
//! frame on the CPU. It depends on no graphics API and no engine.
//!
//! Data flows down this list, and so do imports:
//!
//! | module | content |
//! |---|---|
//! | [`scene`] | the [`scene::Geometry`] trait, triangle meshes, point clouds, implicit surfaces, lights, readers |
//! | [`samples`] | viewpoints, importance particles, Poisson disks, the hashed grid |
//! | [`basis`] | weights, the hierarchy, Shepard sums, pull-push, clip planes |
//! | [`transport`] | the gather, refinement, the sparse operator, bounces, PCA, the fast multipole method |
//! | [`asset`] | the baked scene and its container: format, write, read, validate |
//! | [`frame`] | the CPU twins of the frame's kernels, in the order of a frame |
//! | [`eval`] | a baked scene at single points, and the reference integrator that a bake's own estimate uses |
//! | [`export`] | light for fixed lights in files that engines read by themselves |
//! | [`bake`] | recipe, stages, progress, statistics: the whole bake as one call |
#![warn(missing_docs)]

pub mod asset;
pub mod bake;
pub mod basis;
pub mod eval;
pub mod export;
pub mod frame;
pub mod samples;
pub mod scene;
pub mod transport;
