//! Table of all kernels: name, shader, entry points, bindings. The CPU twin of `name` is
//! `crates/meshless_gi/src/frame/<name>.rs`. `tests/checks/shader_layout.rs` compares the table
//! with the declarations of the shaders.

mod solve;
mod view;

use super::EntryPoint;
use super::kernel::BindingKind::{
    Depth, Float, Layers, Output, Read, Sampler, Samples, Space, Span, Uint, Uniform, Voxels, Write,
};
use super::kernel::{Binding, BindingKind, ComputeEntry, Kernel, bind, each, node, tile};
use meshless_gi::FrameLight;
use meshless_gi::internals::asset::PointSurface;
use meshless_gi::internals::basis::WeightEntry;
use meshless_gi::internals::frame::fmm_layout::{
    FmmEntry, FmmNode, FmmOperatorPoint, FmmParams, FmmTerm,
};
use meshless_gi::internals::frame::pyramid::CellRange;
use meshless_gi::internals::frame::{
    CompositeParams, FogInscatterParams, FogParams, RsmParams, RsmSelectParams, RsmShadowParams,
    RsmTexel, SoftLight, SoftShadowParams, SolveParams, SpecularNode, SpecularParams, SplatParams,
    SubsplatNode, SubsplatParams, SubtractShadowParams, VectorIrradiance, VolumeParams, Vpl,
    VplParams, VplViewParams, WallDistances, WallSample, WallWeight, rsm,
};
use meshless_gi::internals::samples::{GridSlot, LightSample, Point};
use meshless_gi::internals::scene::{BvhNode, BvhTriangle};
use meshless_gi::internals::transport::pca::{Column, VisibilityCluster, VisiblePoint};
use meshless_gi::internals::transport::{BounceLink, Link, PackedLinkTerm, Row};

/// Concatenates a shader and the parts of the library that it needs.
macro_rules! shader {
    ($name:literal $(, $part:literal)*) => {
        concat!(
            include_str!("../../../shaders/lib/layout.wgsl"),
            $(include_str!(concat!("../../../shaders/lib/", $part, ".wgsl")),)*
            include_str!(concat!("../../../shaders/", $name, ".wgsl"))
        )
    };
}
use shader;

const FMM: BindingKind = Uniform(size_of::<FmmParams>());
const SCREEN: BindingKind = Uniform(size_of::<SubsplatParams>());
const NODE: usize = size_of::<SubsplatNode>();
const CELL: usize = size_of::<CellRange>();
const PARAMS: Binding = bind(0, "params", Uniform(size_of::<SolveParams>()));
const SPAN: Binding = bind(1, "span", Span);
const VEC4: usize = size_of::<[f32; 4]>();
const POINT: usize = size_of::<Point>();
const SURFACE: usize = size_of::<PointSurface>();
const LIGHT: usize = size_of::<FrameLight>();
const WEIGHT: usize = size_of::<WeightEntry>();
const VECTOR: usize = size_of::<VectorIrradiance>();

/// All kernels, in the order of a frame.
pub const KERNELS: [Kernel; solve::KERNELS.len() + view::KERNELS.len()] = {
    let mut all = [solve::KERNELS[0]; solve::KERNELS.len() + view::KERNELS.len()];
    let mut i = 0;
    while i < all.len() {
        all[i] = if i < solve::KERNELS.len() {
            solve::KERNELS[i]
        } else {
            view::KERNELS[i - solve::KERNELS.len()]
        };
        i += 1;
    }
    all
};

/// Index of `composite` in [`KERNELS`].
pub const COMPOSITE: usize = KERNELS.len() - 2;
/// Index of `fog` in [`KERNELS`].
pub const FOG: usize = KERNELS.len() - 1;
