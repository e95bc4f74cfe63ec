//! A frame on the CPU: one file per kernel, in the order of a frame. Each file is the twin of the
//! shader of the same name: the reference of its test, and the fallback without compute shaders.
//!
//! | kernel | function |
//! |---|---|
//! | [`occlude`] | transmittances of occluders → links that pass through them, after a change |
//! | [`project`] | light → irradiance at the senders with shadows, for lights that moved |
//! | [`radiosity`] | all lights and the sky → radiosity of the senders |
//! | [`pull`] | → coefficients of coarser senders, fine to coarse |
//! | [`push`] | → differences, coarse to fine, if the operator uses them |
//! | [`compress`] | → coefficients in bases of direct light, if the operator uses them |
//! | [`apply`] | operator × coefficients → vector irradiance at the points with rows |
//! | [`apply_one`] | the same in one channel, if surfaces are gray and all light has one color |
//! | [`fmm_up`], [`fmm_down`] | radiosity → expansions → vector irradiance, instead of `apply` |
//! | [`bounce`] | → coefficients of the senders after further bounces |
//! | [`flatten`] | → vector irradiance at all points |
//! | [`rsm`] | dynamic objects in view of a light → virtual point lights |
//! | [`pyramid`] | depth and normals of a view → discontinuities |
//! | [`refine`] | → cells to divide, and subsplats to evaluate |
//! | [`splat`] | → irradiance of a subsplat, a pixel, or any surface point |
//! | [`probe`] | → irradiance from probes, for dynamic objects |
//! | [`vpl`] | → plus irradiance from virtual point lights |
//! | [`upsample`] | → interpolation between subsplats and at pixels |
//! | [`vpl_specular`] | → specular reflection of virtual point lights |
//! | [`soft_shadow`] | baked visibility → occluded irradiance of soft lights at the points |
//! | [`subtract_shadow`] | → radiance to subtract at every pixel |
//! | [`composite`] | → radiance that is added to or subtracted from a pixel |
//! | [`volume`] | probes and points → a volume that engines sample ([`volume_sample`]) |
//! | [`fog_inscatter`] | → in-scattered radiance per voxel |
//! | [`fog`] | → radiance of fog between the eye and a pixel |
//!
//! [`CpuFrame`] runs the kernels up to [`splat`], [`subsplats`] runs those of a view.
//! [`FrameSettings`] sets the number of bounces.

mod anderson;
pub mod apply;
pub mod apply_one;
pub mod bounce;
pub mod brdf;
mod channels;
pub mod composite;
pub mod compress;
mod cpu_frame;
pub mod flatten;
pub mod fmm_down;
pub mod fmm_layout;
pub mod fmm_up;
pub mod fog;
pub mod fog_inscatter;
pub mod gbuffer;
pub mod layout;
mod light;
pub mod materials;
pub mod occlude;
pub mod probe;
pub mod project;
pub mod pull;
pub mod push;
pub mod pyramid;
pub mod radiosity;
pub mod refine;
pub mod rsm;
pub mod rsm_layout;
mod settings;
pub mod soft_shadow;
pub mod splat;
pub mod subsplat;
mod subsplat_view;
pub mod subtract_shadow;
pub mod upsample;
pub mod volume;
pub mod volume_distance;
pub mod volume_sample;
pub mod volume_walls;
pub mod volume_weights;
pub mod vpl;
pub mod vpl_specular;

pub use channels::Channels;
pub use cpu_frame::{CpuFrame, CpuFrameStats};
pub use fog::{Fog, FogParams, FogView};
pub use fog_inscatter::FogInscatterParams;
pub use layout::{CompositeParams, GridShape, SolveParams, Span, SplatParams, VectorIrradiance};
pub use light::FrameLight;
pub use probe::ProbeIrradiance;
pub use rsm_layout::{
    RsmParams, RsmSelectParams, RsmShadowParams, RsmTexel, Vpl, VplParams, VplViewParams,
};
pub use settings::{FrameSettings, SceneDimensions, SolveSchedule};
pub use soft_shadow::{SoftLight, SoftShadowParams};
pub use subsplat::{
    DepthTest, NormalTest, SubsplatLevels, SubsplatNode, SubsplatParams, SubsplatSettings,
};
pub use subsplat_view::{SubsplatCounts, Subsplats, subsplats};
pub use subtract_shadow::SubtractShadowParams;
pub use volume::{VolumeParams, VolumeValues};
pub use volume_distance::WallDistances;
pub use volume_walls::{WallSample, WallSamples, WallWeight};
pub use volume_weights::{VoxelGrid, VoxelWeights, voxels_of};
pub use vpl_specular::{SpecularNode, SpecularParams, SpecularSettings};
