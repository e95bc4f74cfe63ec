//! The one table of kernels: name, shader, entry points, bindings. The CPU twin of `name` is
//! `crates/meshless_gi/src/frame/<name>.rs`. `tests/shader_layout.rs` compares the table with what
//! the shaders declare.

use super::Pass;
use super::kernel::Kind::{
    Depth, Float, Layers, Output, Read, Sampler, Samples, Space, Span, Uint, Uniform, Voxels, Write,
};
use super::kernel::{Binding, Entry, Kernel, Kind, bind, each, node, tile};
use meshless_gi::FrameLight;
use meshless_gi::internals::asset::PointSurface;
use meshless_gi::internals::basis::WeightEntry;
use meshless_gi::internals::frame::fmm_layout::{FmmEntry, FmmNode, FmmParams, FmmPlace, FmmTerm};
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

/// Joins a shader and the parts of the library that it needs.
macro_rules! shader {
    ($name:literal $(, $part:literal)*) => {
        concat!(
            include_str!("../../shaders/lib/layout.wgsl"),
            $(include_str!(concat!("../../shaders/lib/", $part, ".wgsl")),)*
            include_str!(concat!("../../shaders/", $name, ".wgsl"))
        )
    };
}

const FMM: Kind = Uniform(size_of::<FmmParams>());
const SCREEN: Kind = Uniform(size_of::<SubsplatParams>());
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

/// What kernels bind that look functions up for the pixels or subsplats of a view.
const LOOK_UP: [Binding; 15] = [
    bind(0, "params", Uniform(size_of::<SplatParams>())),
    bind(1, "depths", Depth),
    bind(2, "gbuffer", Uint),
    bind(3, "points", Read(POINT)),
    bind(4, "planes", Read(VEC4)),
    bind(5, "grid_slots", Read(size_of::<GridSlot>())),
    bind(6, "grid_entries", Read(4)),
    bind(7, "values", Read(VECTOR)),
    bind(8, "output", Output),
    bind(9, "earlier", Float),
    bind(10, "screen", SCREEN),
    bind(11, "span", Span),
    bind(12, "subsplats", Write(NODE)),
    bind(13, "lists", Read(4)),
    bind(14, "counted", Read(4)),
];

/// All kernels, in the order of a frame.
pub const KERNELS: [Kernel; 26] = [
    Kernel {
        name: "occlude",
        source: shader!("occlude"),
        bindings: &[
            SPAN,
            bind(2, "passages", Read(size_of::<PackedLinkTerm>())),
            bind(3, "passing", Read(4)),
            bind(4, "links", Write(size_of::<Link>())),
        ],
        entries: &[each(Pass::Occlude, "occlude", &[1, 2, 3, 4])],
    },
    Kernel {
        name: "project",
        source: shader!("project", "bvh", "shadow"),
        bindings: &[
            PARAMS,
            bind(2, "lights", Read(LIGHT)),
            bind(3, "changed", Read(4)),
            bind(4, "points", Read(POINT)),
            bind(5, "nodes", Read(size_of::<BvhNode>())),
            bind(6, "triangles", Read(size_of::<BvhTriangle>())),
            bind(7, "projected", Write(4)),
            bind(8, "places", Read(size_of::<LightSample>())),
        ],
        entries: &[each(Pass::Project, "project", &[0, 2, 3, 4, 5, 6, 7, 8])],
    },
    Kernel {
        name: "radiosity",
        source: shader!("radiosity", "sky"),
        bindings: &[
            PARAMS,
            bind(2, "lights", Read(LIGHT)),
            bind(3, "projected", Read(4)),
            bind(4, "points", Read(POINT)),
            bind(5, "surfaces", Read(SURFACE)),
            bind(6, "senders", Write(VEC4)),
            bind(7, "seen", Read(4)),
        ],
        entries: &[each(Pass::Radiosity, "radiosity", &[0, 2, 3, 4, 5, 6, 7])],
    },
    Kernel {
        name: "pull",
        source: shader!("pull"),
        bindings: &[
            SPAN,
            bind(2, "starts", Read(4)),
            bind(3, "entries", Read(WEIGHT)),
            bind(4, "senders", Write(VEC4)),
        ],
        entries: &[each(Pass::Pull, "pull", &[1, 2, 3, 4])],
    },
    Kernel {
        name: "push",
        source: shader!("push"),
        bindings: &[
            PARAMS,
            SPAN,
            bind(2, "starts", Read(4)),
            bind(3, "entries", Read(WEIGHT)),
            bind(4, "senders", Read(VEC4)),
            bind(5, "differences", Write(VEC4)),
        ],
        entries: &[each(Pass::Push, "push", &[0, 1, 2, 3, 4, 5])],
    },
    Kernel {
        name: "compress",
        source: shader!("compress"),
        bindings: &[
            bind(2, "columns", Read(size_of::<Column>())),
            bind(3, "members", Read(4)),
            bind(4, "column_values", Read(4)),
            bind(5, "senders", Read(VEC4)),
            bind(6, "components", Write(VEC4)),
        ],
        entries: &[Entry {
            pass: Pass::Compress,
            name: "compress",
            workgroup: [meshless_gi::internals::frame::compress::LANES, 1, 1],
            items: 1,
            bindings: &[2, 3, 4, 5, 6],
        }],
    },
    Kernel {
        name: "apply",
        source: shader!("apply", "apply"),
        bindings: &[
            SPAN,
            bind(2, "rows", Read(size_of::<Row>())),
            bind(3, "links", Read(size_of::<Link>())),
            bind(4, "coefficients", Read(VEC4)),
            bind(5, "applied", Write(VECTOR)),
            bind(6, "order", Read(4)),
        ],
        entries: &[Entry {
            pass: Pass::Apply,
            name: "apply",
            workgroup: [64, 1, 1],
            items: 64 / meshless_gi::internals::frame::apply::LANES,
            bindings: &[1, 2, 3, 4, 5, 6],
        }],
    },
    Kernel {
        name: "apply_one",
        source: shader!("apply_one", "apply"),
        bindings: &[
            PARAMS,
            SPAN,
            bind(2, "rows", Read(size_of::<Row>())),
            bind(3, "links", Read(size_of::<Link>())),
            bind(4, "coefficients", Read(4)),
            bind(5, "applied", Write(VECTOR)),
            bind(6, "order", Read(4)),
        ],
        entries: &[Entry {
            pass: Pass::ApplyOne,
            name: "apply_one",
            workgroup: [64, 1, 1],
            items: 64 / meshless_gi::internals::frame::apply::LANES,
            bindings: &[0, 1, 2, 3, 4, 5, 6],
        }],
    },
    Kernel {
        name: "bounce",
        source: shader!("bounce", "sky"),
        bindings: &[
            PARAMS,
            SPAN,
            bind(2, "points", Read(POINT)),
            bind(3, "surfaces", Read(SURFACE)),
            bind(4, "pull_starts", Read(4)),
            bind(5, "direct", Read(VEC4)),
            bind(6, "irradiance", Read(VECTOR)),
            bind(7, "senders", Write(VEC4)),
            bind(8, "bounce_starts", Read(4)),
            bind(9, "bounce_links", Read(size_of::<BounceLink>())),
            bind(10, "further", Write(VEC4)),
            bind(11, "parent_starts", Read(4)),
            bind(12, "parent_entries", Read(WEIGHT)),
            bind(13, "seen", Read(4)),
        ],
        entries: &[
            each(Pass::Sweep, "sweep", &[0, 2, 3, 4, 5, 6, 7, 13]),
            each(Pass::Gather, "gather", &[0, 5, 8, 9, 10]),
            each(Pass::Spread, "spread", &[0, 1, 10, 11, 12]),
            each(Pass::Add, "add", &[0, 5, 7, 10]),
        ],
    },
    Kernel {
        name: "flatten",
        source: shader!("flatten"),
        bindings: &[
            PARAMS,
            SPAN,
            bind(2, "rows", Read(size_of::<Row>())),
            bind(3, "starts", Read(4)),
            bind(4, "entries", Read(WEIGHT)),
            bind(5, "applied", Read(VECTOR)),
            bind(6, "values", Write(VECTOR)),
        ],
        entries: &[
            each(Pass::Averages, "averages", &[0, 1, 2, 3, 4, 6]),
            each(Pass::Differences, "differences", &[1, 3, 4, 5, 6]),
        ],
    },
    Kernel {
        name: "soft_shadow",
        source: shader!("soft_shadow", "soft_light"),
        bindings: &[
            bind(0, "params", Uniform(size_of::<SoftShadowParams>())),
            bind(1, "lights", Read(size_of::<SoftLight>())),
            bind(2, "points", Read(POINT)),
            bind(3, "clusters", Read(size_of::<VisibilityCluster>())),
            bind(4, "visible", Read(size_of::<VisiblePoint>())),
            bind(5, "basis", Read(4)),
            bind(6, "scales", Read(4)),
            bind(7, "coefficients", Read(4)),
            bind(8, "occluded_irradiances", Write(VECTOR)),
        ],
        entries: &[each(
            Pass::SoftShadow,
            "soft_shadow",
            &[0, 1, 2, 3, 4, 5, 6, 7, 8],
        )],
    },
    Kernel {
        name: "splat",
        source: shader!(
            "splat",
            "pixel_pass",
            "grid",
            "weight",
            "gbuffer",
            "pixel_position",
            "screen",
            "list",
            "listed",
            "node"
        ),
        bindings: &LOOK_UP,
        entries: &[
            each(
                Pass::SplatNodes,
                "evaluate_list",
                &[0, 1, 2, 3, 4, 5, 6, 7, 10, 11, 12, 13, 14],
            ),
            tile(Pass::Splat, "first_scene", &[0, 1, 2, 3, 4, 5, 6, 7, 8]),
            tile(
                Pass::SplatOver,
                "next_scene",
                &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9],
            ),
        ],
    },
    Kernel {
        name: "probe",
        source: shader!(
            "probe",
            "grid",
            "weight",
            "probe_irradiance",
            "gbuffer",
            "pixel_position",
            "screen",
            "list",
            "listed",
            "node"
        ),
        bindings: &LOOK_UP,
        entries: &[
            each(
                Pass::ProbeNodes,
                "evaluate_list",
                &[0, 1, 2, 3, 4, 5, 6, 7, 10, 11, 12, 13, 14],
            ),
            tile(
                Pass::ProbeOver,
                "next_scene",
                &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9],
            ),
        ],
    },
    Kernel {
        name: "volume",
        source: shader!("volume", "probe_irradiance"),
        bindings: &[
            bind(0, "params", Uniform(size_of::<VolumeParams>())),
            bind(1, "starts", Read(4)),
            bind(2, "weights", Read(4)),
            bind(3, "values", Read(VECTOR)),
            bind(4, "wall_starts", Read(4)),
            bind(5, "wall_samples", Read(size_of::<WallSample>())),
            bind(6, "wall_weights", Read(size_of::<WallWeight>())),
            bind(7, "point_values", Read(VECTOR)),
            bind(8, "wall_distances", Read(size_of::<WallDistances>())),
            bind(9, "voxels", Voxels),
        ],
        entries: &[Entry {
            pass: Pass::Volume,
            name: "volume",
            workgroup: [4, 4, 4],
            items: 64,
            bindings: &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9],
        }],
    },
    Kernel {
        name: "rsm",
        source: shader!("rsm", "rsm", "gbuffer", "bvh", "shadow"),
        bindings: &[
            bind(0, "params", Uniform(size_of::<RsmParams>())),
            bind(1, "depths", Depth),
            bind(2, "gbuffer", Uint),
            bind(3, "lit_texels", Write(size_of::<RsmTexel>())),
            bind(4, "shade", Uniform(size_of::<RsmShadowParams>())),
            bind(5, "nodes", Read(size_of::<BvhNode>())),
            bind(6, "triangles", Read(size_of::<BvhTriangle>())),
            bind(7, "choice", Uniform(size_of::<RsmSelectParams>())),
            bind(8, "vpls", Write(size_of::<Vpl>())),
        ],
        entries: &[
            tile(Pass::RsmTexels, "texels", &[0, 1, 2, 3]),
            each(Pass::RsmShadow, "shadow", &[3, 4, 5, 6]),
            // One workgroup for all texels of a light.
            Entry {
                pass: Pass::RsmSelect,
                name: "select_vpls",
                workgroup: [rsm::CHUNKS as u32, 1, 1],
                items: u32::MAX,
                bindings: &[3, 7, 8],
            },
        ],
    },
    Kernel {
        name: "vpl",
        source: shader!(
            "vpl",
            "pixel_pass",
            "rsm",
            "gbuffer",
            "bvh",
            "shadow",
            "vpl",
            "screen",
            "list",
            "listed",
            "node"
        ),
        bindings: &[
            bind(0, "params", Uniform(size_of::<VplViewParams>())),
            bind(1, "depths", Depth),
            bind(2, "gbuffer", Uint),
            bind(3, "lit", Uniform(size_of::<VplParams>())),
            bind(4, "vpls", Read(size_of::<Vpl>())),
            bind(5, "nodes", Read(size_of::<BvhNode>())),
            bind(6, "triangles", Read(size_of::<BvhTriangle>())),
            bind(8, "output", Output),
            bind(9, "earlier", Float),
            bind(10, "screen", SCREEN),
            bind(11, "span", Span),
            bind(12, "subsplats", Write(NODE)),
            bind(13, "lists", Read(4)),
            bind(14, "counted", Read(4)),
        ],
        entries: &[
            each(
                Pass::VplNodes,
                "evaluate_list",
                &[0, 1, 2, 3, 4, 5, 6, 10, 11, 12, 13, 14],
            ),
            tile(Pass::Vpl, "first_scene", &[0, 1, 2, 3, 4, 5, 6, 8]),
            tile(Pass::VplOver, "next_scene", &[0, 1, 2, 3, 4, 5, 6, 8, 9]),
        ],
    },
    Kernel {
        name: "pyramid",
        source: shader!("pyramid", "cell_range", "gbuffer", "screen"),
        bindings: &[
            bind(0, "screen", SCREEN),
            bind(1, "span", Span),
            bind(2, "depths", Depth),
            bind(3, "gbuffer", Uint),
            bind(4, "cells", Write(CELL)),
        ],
        entries: &[
            tile(Pass::PyramidBase, "base", &[0, 2, 3, 4]),
            tile(Pass::PyramidReduce, "reduce", &[0, 1, 4]),
        ],
    },
    Kernel {
        name: "refine",
        source: shader!(
            "refine",
            "cell_range",
            "gbuffer",
            "screen",
            "list",
            "node",
            "luminance"
        ),
        bindings: &[
            bind(0, "screen", SCREEN),
            bind(1, "span", Span),
            bind(2, "depths", Depth),
            bind(3, "gbuffer", Uint),
            bind(4, "cells", Read(CELL)),
            bind(5, "nodes", Read(NODE)),
            bind(6, "lists", Write(4)),
            bind(7, "counted", Read(4)),
            bind(8, "next", Write(4)),
        ],
        entries: &[
            each(Pass::RefineStart, "start", &[0, 6, 8]),
            each(Pass::Refine, "refine", &[0, 1, 3, 4, 5, 6, 7, 8]),
        ],
    },
    Kernel {
        name: "upsample",
        source: shader!("upsample", "gbuffer", "screen", "list", "node", "luminance"),
        bindings: &[
            bind(0, "screen", SCREEN),
            bind(1, "span", Span),
            bind(2, "depths", Depth),
            bind(3, "gbuffer", Uint),
            bind(4, "nodes", Write(NODE)),
            bind(5, "lists", Write(4)),
            bind(6, "next", Write(4)),
            bind(7, "output", Output),
            bind(8, "counted", Read(4)),
        ],
        entries: &[
            tile(Pass::Upsample, "upsample", &[0, 1, 2, 3, 4]),
            tile(Pass::Resolve, "resolve", &[0, 2, 3, 4, 5, 6, 7]),
            each(Pass::Fill, "fill", &[0, 2, 3, 4, 5, 7, 8]),
        ],
    },
    Kernel {
        name: "vpl_specular",
        source: shader!(
            "vpl_specular",
            "rsm",
            "gbuffer",
            "bvh",
            "shadow",
            "vpl",
            "brdf",
            "screen",
            "node",
            "luminance"
        ),
        bindings: &[
            bind(0, "params", Uniform(size_of::<VplViewParams>())),
            bind(1, "depths", Depth),
            bind(2, "gbuffer", Uint),
            bind(3, "lit", Uniform(size_of::<VplParams>())),
            bind(4, "vpls", Read(size_of::<Vpl>())),
            bind(5, "nodes", Read(size_of::<BvhNode>())),
            bind(6, "triangles", Read(size_of::<BvhTriangle>())),
            bind(7, "output", Output),
            bind(8, "screen", SCREEN),
            bind(9, "span", Span),
            bind(10, "wanted", Uniform(size_of::<SpecularParams>())),
            bind(11, "shines", Write(size_of::<SpecularNode>())),
            bind(12, "refine_masks", Write(VEC4)),
        ],
        entries: &[
            tile(
                Pass::VplSpecular,
                "vpl_specular",
                &[0, 1, 2, 3, 4, 5, 6, 8, 9, 10, 11, 12],
            ),
            tile(
                Pass::VplSpecularPixels,
                "vpl_specular_pixels",
                &[0, 1, 2, 3, 4, 5, 6, 7, 8, 10, 11],
            ),
        ],
    },
    Kernel {
        name: "subtract_shadow",
        source: shader!(
            "subtract_shadow",
            "pixel_pass",
            "grid",
            "weight",
            "gbuffer",
            "pixel_position",
            "soft_light"
        ),
        bindings: &[
            bind(0, "params", Uniform(size_of::<SplatParams>())),
            bind(1, "depths", Depth),
            bind(2, "gbuffer", Uint),
            bind(3, "points", Read(POINT)),
            bind(4, "planes", Read(VEC4)),
            bind(5, "grid_slots", Read(size_of::<GridSlot>())),
            bind(6, "grid_entries", Read(4)),
            bind(7, "occluded_irradiances", Read(VECTOR)),
            bind(8, "output", Output),
            bind(9, "earlier", Float),
            bind(10, "wanted", Uniform(size_of::<SubtractShadowParams>())),
            bind(11, "lights", Read(size_of::<SoftLight>())),
            bind(12, "tables", Layers),
        ],
        entries: &[
            tile(
                Pass::SubtractShadow,
                "first_scene",
                &[0, 1, 2, 3, 4, 5, 6, 7, 8, 10, 11, 12],
            ),
            tile(
                Pass::SubtractShadowOver,
                "next_scene",
                &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12],
            ),
        ],
    },
    Kernel {
        name: "fmm_up",
        source: shader!("fmm_up", "fmm"),
        bindings: &[
            bind(0, "params", FMM),
            bind(1, "span", Span),
            bind(2, "nodes", Read(size_of::<FmmNode>())),
            bind(3, "places", Read(size_of::<FmmPlace>())),
            bind(4, "terms", Read(size_of::<FmmTerm>())),
            bind(5, "radiosity", Read(VEC4)),
            bind(6, "expansions", Write(VEC4)),
        ],
        entries: &[node(Pass::FmmUp, "up", &[0, 1, 2, 3, 4, 5, 6])],
    },
    Kernel {
        name: "fmm_down",
        source: shader!("fmm_down", "fmm"),
        bindings: &[
            bind(0, "params", FMM),
            bind(1, "span", Span),
            bind(2, "nodes", Read(size_of::<FmmNode>())),
            bind(3, "places", Read(size_of::<FmmPlace>())),
            bind(4, "terms", Read(size_of::<FmmTerm>())),
            bind(5, "radiosity", Read(VEC4)),
            bind(6, "expansions", Read(VEC4)),
            bind(7, "locals", Write(VEC4)),
            bind(8, "entries", Read(size_of::<FmmEntry>())),
            bind(9, "values", Write(VECTOR)),
        ],
        entries: &[
            node(Pass::FmmReceive, "receive", &[0, 1, 2, 3, 4, 5, 6, 7, 8]),
            node(
                Pass::FmmEvaluate,
                "evaluate",
                &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9],
            ),
        ],
    },
    Kernel {
        name: "fog_inscatter",
        source: shader!("fog_inscatter"),
        bindings: &[
            bind(0, "params", Uniform(size_of::<FogInscatterParams>())),
            bind(1, "voxels", Space),
            bind(2, "light", Voxels),
        ],
        entries: &[Entry {
            pass: Pass::FogInscatter,
            name: "fog_inscatter",
            workgroup: [4, 4, 4],
            items: 64,
            bindings: &[0, 1, 2],
        }],
    },
    Kernel {
        name: "composite",
        source: shader!("composite", "gbuffer"),
        bindings: &[
            bind(0, "params", Uniform(size_of::<CompositeParams>())),
            bind(1, "irradiance", Float),
            bind(2, "gbuffer", Uint),
            bind(3, "lighting_passes", Uint),
        ],
        entries: &[],
    },
    Kernel {
        name: "fog",
        source: include_str!("../../shaders/fog.wgsl"),
        bindings: &[
            bind(0, "params", Uniform(size_of::<FogParams>())),
            bind(1, "depth", Depth),
            bind(2, "depth_samples", Samples),
            bind(3, "voxels", Space),
            bind(4, "light", Space),
            bind(5, "light_sampler", Sampler),
            bind(6, "density", Space),
            bind(7, "density_sampler", Sampler),
        ],
        entries: &[],
    },
];

/// Where `composite` is in [`KERNELS`].
pub const COMPOSITE: usize = KERNELS.len() - 2;
/// Where `fog` is.
pub const FOG: usize = KERNELS.len() - 1;
