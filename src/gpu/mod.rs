//! The frame's kernels on any wgpu device: the same steps as [`CpuFrame`](meshless_gi::CpuFrame),
//! recorded as dispatches. The code does not depend on an engine. Bevy or a [`HeadlessDevice`]
//! without a window provides device, queue and encoder.
//!
//! | type | purpose |
//! |---|---|
//! | [`KERNELS`] | table of kernels: shader, entry points, bindings |
//! | [`KernelPipelines`] | pipelines, each created on first use |
//! | [`SceneBuffers`] | baked scene on the GPU |
//! | [`GpuFrame`] | records project, solve, splat and composite of one scene, and counts them |
//! | [`ViewBuffers`] | parameters of one scene in one view |
//! | [`SubsplatBuffers`] | records a view's subsplats |
//! | [`SpecularBuffers`] | records specular reflection of virtual point lights in a view |
//! | [`RsmBuffers`] | records `rsm` and `vpl`: light that dynamic objects reflect |
//! | [`SoftShadowBuffers`] | records `soft_shadow`: occluded light of soft shadows |
//! | [`SubtractShadowBuffers`] | records `subtract_shadow`: occluded radiance of a view |
//! | [`GpuFmm`] | records `fmm_up` and `fmm_down`: light between points |
//! | [`HeadlessDevice`] | device without a window |
//!
//! A frame calls `set_materials` and `set_occluders` after changes, `set_lights`, `project` for the
//! slots that moved, and `solve` if anything changed. Then it calls `splat` and `composite` for
//! each view. With two baked scenes in one view, the second `splat` gets the output of the first as
//! `earlier`. The last output is composited.

mod buffer_factory;
mod counters;
mod dispatch;
mod draw;
mod entry_point;
mod error;
mod fmm;
mod fog;
mod frame;
mod headless_device;
mod kernel;
mod kernels;
mod link_tables;
mod links;
mod occlude;
mod pipelines;
mod probes;
mod rsm;
mod scene_buffers;
mod soft_shadow;
mod solve_recorder;
mod spans;
mod subsplats;
mod subtract_shadow;
mod volume;
mod vpl_specular;

pub use error::GpuError;
pub use frame::GpuFrame;
pub use headless_device::HeadlessDevice;
pub use pipelines::KernelPipelines;
pub use scene_buffers::SceneBuffers;

// Items for the plugin and for tests. Exempt from semantic versioning.
#[doc(hidden)]
pub use counters::GpuCounters;
#[doc(hidden)]
pub use draw::draw_over;
#[doc(hidden)]
pub use entry_point::EntryPoint;
#[doc(hidden)]
pub use fmm::GpuFmm;
#[doc(hidden)]
pub use fog::{FogBuffers, FogTextures, draw_fog};
#[doc(hidden)]
pub use frame::SplatTargets;
#[doc(hidden)]
pub use kernel::{Binding, BindingKind, COMPOSITE_ENTRIES, ComputeEntry, FOG_ENTRIES, Kernel};
#[doc(hidden)]
pub use kernels::{COMPOSITE, FOG, KERNELS};
#[doc(hidden)]
pub use pipelines::{ComputeKernel, Draw, RenderKernel};
#[doc(hidden)]
pub use rsm::{RsmBuffers, RsmCapture, VplShadows};
#[doc(hidden)]
pub use scene_buffers::ViewBuffers;
#[doc(hidden)]
pub use soft_shadow::SoftShadowBuffers;
#[doc(hidden)]
pub use subsplats::{NodeLights, SubsplatBuffers, SubsplatTargets};
#[doc(hidden)]
pub use subtract_shadow::SubtractShadowBuffers;
#[doc(hidden)]
pub use volume::VolumeBuffers;
#[doc(hidden)]
pub use vpl_specular::SpecularBuffers;
