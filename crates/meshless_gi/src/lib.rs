//! Precomputed indirect light.
//!
//! A bake scatters points over a scene, builds a meshless hierarchical basis on them and computes a
//! sparse operator from direct to indirect light. A frame projects the lights that changed, applies
//! the operator and reads the result at every pixel. This crate has the bake, its file, and the
//! frame on the CPU. It depends on no graphics API and no engine.
//!
//! [`bake_scene`] bakes a [`TriangleMesh`] by a [`Recipe`]. The resulting [`BakedScene`] is written
//! to and read from a file. [`CpuFrame`] computes a frame and [`Evaluator`] the light at single
//! points.
//!
//! Data flows down this list, and so do imports:
//!
//! | module | content |
//! |---|---|
//! | `scene` | the [`Geometry`] trait, triangle meshes, point clouds, implicit surfaces, lights, readers |
//! | `samples` | viewpoints, importance particles, Poisson disks, the hashed grid |
//! | `basis` | weights, the hierarchy, Shepard sums, pull-push, clip planes |
//! | `transport` | the gather, refinement, the sparse operator, bounces, PCA, the fast multipole method |
//! | `asset` | the baked scene and its container: format, write, read, validate |
//! | `frame` | the CPU twins of the frame's kernels, in the order of a frame |
//! | `eval` | a baked scene at single points, and the reference integrator that a bake's own estimate uses |
//! | `export` | light for fixed lights in files that engines read by themselves |
//! | `bake` | recipe, stages, progress, statistics: the whole bake as one call |
#![warn(missing_docs)]
#![cfg_attr(not(test), warn(clippy::too_many_lines))]

mod asset;
mod bake;
mod basis;
mod eval;
mod export;
mod frame;
mod samples;
mod scene;
mod transport;

// Scenes.
#[cfg(feature = "point_clouds")]
pub use scene::PointCloud;
pub use scene::{
    Bounds, Bvh, Geometry, Hit, HitPoint, Light, Material, MaterialFactors, MeshProblems, Occluder,
    Quad, Ray, SceneError, SkyRadiance, Surface, Texture, TriangleMesh, TriangleUvs, Wrap,
};
#[cfg(feature = "gltf")]
pub use scene::{LoadedScene, load_geometry, load_gltf};

// Bakes.
pub use bake::{
    BakeError, BakeSceneError, BakeSource, BakeStage, BakeStats, Baked, BounceMode, FmmRecipe,
    OccluderBox, OccluderDesc, PcaRecipe, Preset, ProbeSettings, Progress, Recipe, RecipeError,
    SkyModel, StageSeconds, TransportMethod, VisibilityRecipe, bake, bake_scene,
};

// Baked scenes.
pub use asset::{AssetError, BakeInfo, BakedScene, EnergyInfo, Limits, TierInfo, Violation};

// Frames on the CPU.
pub use frame::{
    Channels, CpuFrame, DepthTest, FrameLight, FrameSettings, NormalTest, SpecularSettings,
    SubsplatSettings,
};

// Evaluation at points.
pub use eval::{Bounces, Evaluated, Evaluator, Irradiance, ReferenceSettings, irradiance};

// Export to other engines.
pub use export::{ExportError, ExportedVolume, VolumeExport, VolumePlacement};

/// Items for the crates of this workspace and their tests. Exempt from semantic versioning.
#[doc(hidden)]
pub mod internals {
    pub mod asset {
        pub use crate::asset::*;
    }
    pub mod bake {
        pub use crate::bake::*;
    }
    pub mod basis {
        pub use crate::basis::*;
    }
    pub mod eval {
        pub use crate::eval::*;
    }
    pub mod export {
        pub use crate::export::*;
    }
    pub mod frame {
        pub use crate::frame::*;
    }
    pub mod samples {
        pub use crate::samples::*;
    }
    pub mod scene {
        pub use crate::scene::*;
    }
    pub mod transport {
        pub use crate::transport::*;
    }
}
