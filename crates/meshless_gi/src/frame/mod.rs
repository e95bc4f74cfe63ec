//! A frame on the CPU: one file a kernel, in the order of a frame. Each is the twin of the shader
//! of the same name: the oracle of its test, and what runs where there is no compute.
//!
//! | kernel | does |
//! |---|---|
//! | [`occlude`] | gains of doors and lifts → the links that those are in the way of; only when one changed |
//! | [`project`] | light → irradiance at the lit points, shadows included; only for lights that moved |
//! | [`radiosity`] | all lights and the sky → radiosity at the lit points |
//! | [`pull`] | → the senders' coefficients, fine to coarse |
//! | [`push`] | → differences, coarse to fine, where the operator asks for them |
//! | [`compress`] | → coefficients in bases of direct light, where the operator asks for them |
//! | [`apply`] | operator × coefficients → vector irradiance at the points with rows |
//! | [`apply_one`] | the same in one channel, where surfaces are gray and all light has one color |
//! | [`fmm_up`], [`fmm_down`] | radiosity → expansions of an octree's nodes → vector irradiance of the senders' points, in place of `apply` where the bake has an octree |
//! | [`bounce`] | → the senders' coefficients after further reflections |
//! | [`flatten`] | → vector irradiance at all points |
//! | [`rsm`] | what a light sees of moving objects → virtual point lights |
//! | [`pyramid`] | depth and normals → where the picture is not continuous |
//! | [`refine`] | → which of its cells are divided, and the subsplats to evaluate |
//! | [`splat`] | → irradiance of a subsplat, a pixel, or at any place |
//! | [`probe`] | → light in free space, for what moves |
//! | [`vpl`] | → irradiance from the virtual lights, added to that |
//! | [`upsample`] | → between the subsplats, and at every pixel |
//! | [`gloss`] | what glossy surfaces send to the eye of the virtual lights |
//! | [`soft`] | what lamps with soft shadows do not reach, at the points that remember what they see |
//! | [`shade`] | → what was drawn of it at every pixel |
//! | [`composite`] | → what a pixel's color gains, and loses |
//! | [`volume`] | light in free space → a volume that engines read ([`volume_read`]) |
//! | [`fog_inscatter`] | → what fog would send of it to the eye |
//! | [`fog`] | → what fog between the eye and a pixel sends of it |
//!
//! [`CpuFrame`] runs them up to [`splat`], [`subsplats`] those of the screen; a [`FrameSettings`] says how many bounces.

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
