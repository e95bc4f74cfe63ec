//! Comparison of the shaders with the Rust side, read from the WGSL by naga, without a GPU.
//! Structs, constants, bindings, entry points and workgroup sizes must match the kernel table and
//! the shared types. Every kernel must have a shader and a CPU twin of its name. Each comparison is
//! repeated on a perturbed shader, and must fail.

use bevy_meshless_gi::internals::gpu::{BindingKind, EntryPoint, KERNELS, Kernel};
use meshless_gi::internals::asset::PointSurface;
use meshless_gi::internals::basis::{CREASE_MARGIN, LEAN_FROM, NO_COVER, WeightEntry};
use meshless_gi::internals::frame::fmm_layout::{
    FmmEntry, FmmNode, FmmOperatorPoint, FmmParams, FmmTerm, MAX_FMM_TERMS, NO_TERM,
};
use meshless_gi::internals::frame::pyramid::{self, CellRange};
use meshless_gi::internals::frame::subsplat::{LUMINANCE, PIXELS_PER_DIRECT_EVALUATION, state};
use meshless_gi::internals::frame::{
    CompositeParams, FogInscatterParams, FogParams, RsmParams, RsmSelectParams, RsmShadowParams,
    RsmTexel, SoftLight, SoftShadowParams, SolveParams, Span, SpecularNode, SpecularParams,
    SplatParams, SubsplatNode, SubsplatParams, SubtractShadowParams, VectorIrradiance,
    VolumeParams, Vpl, VplParams, VplViewParams, WallSample, WallWeight, apply, brdf, compress,
    fog, fog_inscatter, gbuffer, probe, project, refine, rsm, soft_shadow, splat, subtract_shadow,
    upsample, volume, volume_distance, volume_sample, volume_walls, volume_weights, vpl,
    vpl_specular,
};
use meshless_gi::internals::samples::{F_SQUASH, GridSlot, HashedGrid, LightSample, Point};
use meshless_gi::internals::scene::{BvhNode, BvhTriangle};
use meshless_gi::internals::transport::pca::{
    Column, MAX_RATIO, Visibility, VisibilityCluster, VisiblePoint,
};
use meshless_gi::internals::transport::{BounceLink, Link, PROBE_ROWS, PackedLinkTerm, Row};
use meshless_gi::{Bvh, FrameLight};
use naga::front::wgsl;
use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use std::collections::{BTreeMap, BTreeSet};
use std::mem::offset_of;
use std::path::Path;

/// Rust struct as a shader must declare it: name, size, fields with offsets.
struct Layout {
    name: &'static str,
    size: usize,
    fields: Vec<(&'static str, usize)>,
}

macro_rules! layout {
    ($name:ident { $($field:ident $(as $shader:ident)?),* }) => {
        Layout {
            name: stringify!($name),
            size: size_of::<$name>(),
            fields: vec![$((layout!(@ $field $($shader)?), offset_of!($name, $field))),*],
        }
    };
    (@ $field:ident) => { stringify!($field) };
    (@ $field:ident $shader:ident) => { stringify!($shader) };
}

fn layouts() -> Vec<Layout> {
    vec![
        layout!(Point {
            position,
            radius,
            normal,
            planes
        }),
        layout!(PointSurface {
            albedo,
            emission,
            sky
        }),
        layout!(FrameLight {
            position,
            kind,
            direction,
            inverse_square_range,
            color,
            spot_scale,
            spot_offset
        }),
        layout!(LightSample { position, normal }),
        layout!(WeightEntry { index, weight }),
        layout!(Row {
            start,
            count,
            scale,
            tier
        }),
        layout!(Link { xy, z_sender }),
        layout!(PackedLinkTerm { link, xy, z_set }),
        layout!(Column {
            member,
            count,
            value,
            scale
        }),
        layout!(BounceLink { gain, sender }),
        layout!(VectorIrradiance { x, y, z }),
        layout!(SolveParams {
            sky,
            emission,
            points,
            samples_per_sender,
            senders,
            finest_sender,
            slots,
            nodes,
            extent,
            tier,
            sky_sender,
            coarsest_points,
            differences,
            sample_spacing,
            sky_terms,
            channel,
            hue,
            sky_more
        }),
        layout!(Span { first, count, base }),
        layout!(SoftLight {
            center,
            kind,
            u,
            radius,
            v,
            inverse_square_range,
            color,
            columns,
            rows
        }),
        layout!(SoftShadowParams {
            points,
            lights,
            columns,
            rows,
            extent,
            bias,
            before,
            ramp
        }),
        layout!(SubtractShadowParams {
            lights,
            extent,
            gloss
        }),
        layout!(VisibilityCluster {
            tangent,
            components,
            basis,
            scales,
            near
        }),
        layout!(VisiblePoint {
            cluster,
            first,
            error,
            mask
        }),
        layout!(SplatParams {
            local_from_clip,
            local_from_world,
            viewport,
            size,
            slot_mask,
            cell_size,
            scale,
            seam
        }),
        layout!(WallSample { normal, start }),
        layout!(WallWeight { point, part }),
        layout!(VolumeParams {
            size,
            scale,
            axes,
            steps
        }),
        layout!(SubsplatParams {
            view_from_clip,
            view_from_world,
            viewport,
            size,
            coarsest_level,
            finest_level,
            depth_test,
            normal_test,
            depth_threshold,
            normal_threshold,
            radiance_threshold,
            min_similarity,
            detail,
            diagonal,
            starts
        }),
        layout!(CellRange {
            near,
            far,
            low,
            high
        }),
        layout!(SubsplatNode { words }),
        layout!(SpecularParams {
            max_roughness,
            together
        }),
        layout!(SpecularNode { words }),
        layout!(CompositeParams { scale, white }),
        layout!(FogParams {
            view_from_clip,
            fog_from_view,
            voxels_from_view,
            earlier,
            viewport,
            color,
            extinction,
            offset,
            density,
            size,
            steps,
            low,
            earlier_count,
            high,
            textured,
            radius,
            part
        }),
        layout!(FogInscatterParams {
            world_from_voxels,
            eye,
            steps,
            size,
            asymmetry
        }),
        layout!(GridSlot { cell, start }),
        layout!(BvhNode {
            min,
            first,
            max,
            count
        }),
        layout!(BvhTriangle {
            a,
            occluder,
            b,
            transmittance,
            c
        }),
        layout!(RsmParams {
            space_from_clip,
            light,
            forward,
            side,
            right,
            first,
            up,
            area
        }),
        layout!(RsmTexel {
            position,
            spread,
            normal,
            flux
        }),
        layout!(RsmShadowParams {
            local_from_space,
            light,
            texels,
            nodes,
            extent
        }),
        layout!(RsmSelectParams {
            texels,
            first,
            vpls
        }),
        layout!(Vpl {
            position,
            square,
            normal,
            flux
        }),
        layout!(VplParams {
            local_from_space,
            vpls,
            nodes,
            extent,
            dim
        }),
        layout!(FmmNode {
            center,
            size,
            start,
            end,
            first_child,
            children,
            parent,
            far,
            local,
            multipole,
            near,
            finish,
            sources,
            receivers
        }),
        layout!(FmmEntry { source, weight }),
        layout!(FmmOperatorPoint {
            position,
            share,
            normal,
            point,
            sky,
            factor
        }),
        layout!(FmmTerm {
            down,
            exponents,
            degree,
            factorial
        }),
        layout!(FmmParams {
            order,
            terms,
            disks,
            nearest,
            sky
        }),
        layout!(VplViewParams {
            space_from_clip,
            viewport,
            size,
            scale
        }),
    ]
}

/// Structs that exist in a shader only.
const SHADER_ONLY: [&str; 23] = [
    "Cell",
    "PixelPosition",
    "Shear",
    "Covered",
    "VisibleSurface",
    "Interpolation",
    "Near",
    "ShadingPoint",
    "SpecularRadiance",
    "Receiver",
    "Glossy",
    "NeighborNode",
    "Prediction",
    "Spectrum",
    "OccludedFraction",
    "Surface",
    "Lobe",
    "ProbeIrradiance",
    "Listed",
    "BasisFunction",
    "RowPart",
    "Ray",
    "Outgoing",
];

/// Returns every constant that a shader may declare, with its value in Rust. `None` for a constant
/// that has no counterpart in Rust.
fn constants() -> BTreeMap<&'static str, Option<f64>> {
    BTreeMap::from([
        ("LIGHT_NONE", Some(f64::from(FrameLight::NONE))),
        ("LIGHT_POINT", Some(f64::from(FrameLight::POINT))),
        ("LIGHT_SPOT", Some(f64::from(FrameLight::SPOT))),
        (
            "LIGHT_DIRECTIONAL",
            Some(f64::from(FrameLight::DIRECTIONAL)),
        ),
        ("SOFT_SPHERE", Some(f64::from(SoftLight::SPHERE))),
        ("SOFT_RECTANGLE", Some(f64::from(SoftLight::RECTANGLE))),
        ("QUARTER_PI", Some(f64::from(std::f32::consts::FRAC_PI_4))),
        ("HALF_PI", Some(f64::from(std::f32::consts::FRAC_PI_2))),
        ("TURN", Some(f64::from(std::f32::consts::TAU))),
        (
            "MAX_COMPONENTS",
            Some(f64::from(Visibility::MAX_COMPONENTS)),
        ),
        ("MIN_ALONG", Some(f64::from(soft_shadow::MIN_ALONG))),
        (
            "SUBTRACTED_FRACTION",
            Some(f64::from(subtract_shadow::SUBTRACTED_FRACTION)),
        ),
        ("NO_NODE", None),
        ("PROBE_ROWS", Some(PROBE_ROWS as f64)),
        ("STRAIGHT_STEP", Some(volume::STRAIGHT_STEP as f64)),
        (
            "MIN_FACING_COSINE",
            Some(f64::from(volume_walls::MIN_FACING_COSINE)),
        ),
        (
            "COSINE_TOLERANCE",
            Some(f64::from(volume_walls::COSINE_TOLERANCE)),
        ),
        ("CREASE_MARGIN", Some(f64::from(CREASE_MARGIN))),
        ("LEAN_FROM", Some(f64::from(LEAN_FROM))),
        ("RETRY_OFFSET", Some(f64::from(probe::RETRY_OFFSET))),
        ("MIN_COVER_COSINE", Some(f64::from(splat::MIN_COVER_COSINE))),
        (
            "FULL_COVER_COSINE",
            Some(f64::from(splat::FULL_COVER_COSINE)),
        ),
        (
            "MIN_COVERED_FRACTION",
            Some(f64::from(splat::MIN_COVERED_FRACTION)),
        ),
        (
            "UNOBSTRUCTED",
            Some(f64::from(volume_distance::UNOBSTRUCTED)),
        ),
        (
            "DISTANCE_STEPS",
            Some(f64::from(volume_distance::DISTANCE_STEPS)),
        ),
        ("ALL_UNOBSTRUCTED", Some(f64::from(u32::MAX))),
        ("WEIGHT_BITS", Some(f64::from(volume_weights::WEIGHT_BITS))),
        ("GOLDEN", Some(f64::from(soft_shadow::GOLDEN))),
        ("ROUNDING", Some(f64::from(soft_shadow::ROUNDING))),
        ("ERROR_ONE", Some(f64::from(VisiblePoint::ONE))),
        ("MAX_RATIO", Some(f64::from(MAX_RATIO))),
        ("LIGHT_PATCH", Some(f64::from(FrameLight::PATCH))),
        ("FAR", Some(f64::from(project::FAR))),
        ("MIN_TRANSMITTANCE", Some(f64::from(fog::MIN_TRANSMITTANCE))),
        (
            "UNOBSTRUCTED_THRESHOLD",
            Some(f64::from(fog_inscatter::UNOBSTRUCTED_THRESHOLD)),
        ),
        (
            "MIN_EYE_DISTANCE",
            Some(f64::from(fog_inscatter::MIN_EYE_DISTANCE)),
        ),
        ("PARALLEL", Some(f64::from(fog::PARALLEL))),
        ("MAX_RAY_LENGTH", Some(f64::from(fog::MAX_RAY_LENGTH))),
        (
            "NO_WALL_THRESHOLD",
            Some(f64::from(volume_sample::NO_WALL_THRESHOLD)),
        ),
        (
            "DISTANCE_OFFSET",
            Some(f64::from(volume_sample::DISTANCE_OFFSET)),
        ),
        (
            "WALL_FADE_START",
            Some(f64::from(volume_sample::WALL_FADE_START)),
        ),
        (
            "WALL_FADE_END",
            Some(f64::from(volume_sample::WALL_FADE_END)),
        ),
        ("MIN_WEIGHT_SUM", Some(f64::from(volume_sample::MIN))),
        ("PATCH_SAMPLES", Some(project::PATCH_SAMPLES as f64)),
        ("EPSILON", Some(f64::from(f32::EPSILON))),
        ("LANES", Some(f64::from(apply::LANES))),
        ("COLUMN_LANES", Some(f64::from(compress::LANES))),
        ("ROWS", Some(f64::from(EntryPoint::Apply.entry().1.items))),
        ("EMPTY_SLOT", Some(f64::from(GridSlot::EMPTY))),
        ("CELL_LIMIT", Some(f64::from(HashedGrid::CELL_LIMIT))),
        ("F_SQUASH", Some(f64::from(F_SQUASH))),
        ("NO_COVER", Some(f64::from(NO_COVER))),
        ("UNLIT", Some(f64::from(gbuffer::UNLIT))),
        ("GAMMA", Some(f64::from(gbuffer::GAMMA))),
        ("MAX_HALF", Some(f64::from(splat::MAX_HALF))),
        ("KNOWN", Some(f64::from(state::KNOWN))),
        ("COVERED", Some(f64::from(state::COVERED))),
        ("EVALUATED", Some(f64::from(state::EVALUATED))),
        ("PROBE_FRACTION", Some(f64::from(state::PROBE_FRACTION))),
        ("RED", Some(f64::from(LUMINANCE.x))),
        ("GREEN", Some(f64::from(LUMINANCE.y))),
        ("BLUE", Some(f64::from(LUMINANCE.z))),
        (
            "PIXELS_PER_DIRECT_EVALUATION",
            Some(f64::from(PIXELS_PER_DIRECT_EVALUATION)),
        ),
        (
            "BACKGROUND_DEPTH",
            Some(f64::from(pyramid::BACKGROUND_DEPTH)),
        ),
        ("MAX_SLOPE", Some(f64::from(pyramid::MAX_SLOPE))),
        ("EMPTY_LOW", Some(f64::from(pyramid::EMPTY.0))),
        ("EMPTY_HIGH", Some(f64::from(pyramid::EMPTY.1))),
        ("FLOOR", Some(f64::from(refine::FLOOR))),
        ("PLANE", Some(f64::from(upsample::PLANE))),
        (
            "MIN_NORMAL_COSINE",
            Some(f64::from(upsample::MIN_NORMAL_COSINE)),
        ),
        (
            "FULL_NORMAL_COSINE",
            Some(f64::from(upsample::FULL_NORMAL_COSINE)),
        ),
        (
            "CUBIC_MIN_SIMILARITY",
            Some(f64::from(upsample::CUBIC_MIN_SIMILARITY)),
        ),
        ("MIN_ROUGHNESS", Some(f64::from(brdf::MIN_ROUGHNESS))),
        ("MIN_NDOTV", Some(f64::from(brdf::MIN_NDOTV))),
        (
            "MULTISCATTER_LOSS",
            Some(f64::from(brdf::MULTISCATTER_LOSS)),
        ),
        (
            "MULTISCATTER_ROLLOFF",
            Some(f64::from(brdf::MULTISCATTER_ROLLOFF)),
        ),
        ("LIGHT_GROUPS", Some(f64::from(vpl_specular::LIGHT_GROUPS))),
        (
            "ROUGHNESS_FADE",
            Some(f64::from(vpl_specular::ROUGHNESS_FADE)),
        ),
        ("MIN", Some(f64::from(vpl_specular::MIN))),
        (
            "MAX_REACH_PIXELS",
            Some(f64::from(pyramid::MAX_REACH_PIXELS)),
        ),
        (
            "NORMAL_COSINE_FROM",
            Some(f64::from(vpl_specular::NORMAL_COSINES[0])),
        ),
        (
            "NORMAL_COSINE_TO",
            Some(f64::from(vpl_specular::NORMAL_COSINES[1])),
        ),
        (
            "VIEW_COSINE_TOLERANCE",
            Some(f64::from(vpl_specular::VIEW_COSINE_TOLERANCE)),
        ),
        (
            "ROUGHNESS_TOLERANCE",
            Some(f64::from(vpl_specular::ROUGHNESS_TOLERANCE)),
        ),
        ("ITEMS", Some(f64::from(EntryPoint::Refine.entry().1.items))),
        ("MAX_GROUPS", Some(65_535.0)),
        ("FRAC_1_PI", Some(f64::from(std::f32::consts::FRAC_1_PI))),
        ("STACK", Some(Bvh::STACK as f64)),
        ("MIN_COMPONENT", Some(f64::from(Bvh::MIN_COMPONENT))),
        ("CHUNKS", Some(rsm::CHUNKS as f64)),
        ("MAX_DISTANCE", Some(f64::from(rsm::MAX_DISTANCE))),
        ("MIN_COSINE", Some(f64::from(rsm::MIN_COSINE))),
        (
            "MIN_DISTANCE_SQUARED",
            Some(f64::from(rsm::MIN_DISTANCE_SQUARED)),
        ),
        ("DISK", Some(f64::from(vpl::DISK))),
        ("NEAR_FROM", Some(f64::from(vpl::NEAR_SQUARES[0]))),
        ("NEAR_TO", Some(f64::from(vpl::NEAR_SQUARES[1]))),
        ("FLAT_FROM", Some(f64::from(vpl::NEAR_FLAT[0]))),
        ("FLAT_TO", Some(f64::from(vpl::NEAR_FLAT[1]))),
        ("FADE", Some(f64::from(vpl::FADE))),
        ("MIN_EDGE_LENGTH", Some(f64::from(vpl::MIN_EDGE_LENGTH))),
        ("PI", Some(f64::from(std::f32::consts::PI))),
        ("RAY_OFFSET_SCALE", Some(f64::from(vpl::RAY_OFFSET_SCALE))),
        ("MAX_FMM_TERMS", Some(MAX_FMM_TERMS as f64)),
        ("NO_TERM", Some(f64::from(NO_TERM))),
        ("TINY", Some(f64::from(f32::MIN_POSITIVE))),
    ])
}

fn parse(name: &str, source: &str) -> Result<(naga::Module, ModuleInfo), String> {
    let module = wgsl::parse_str(source).map_err(|e| e.emit_to_string_with_path(source, name))?;
    // Only capabilities of WebGPU, which include `unpack2x16float`.
    let info = Validator::new(
        ValidationFlags::all(),
        Capabilities::SHADER_FLOAT16_IN_FLOAT32,
    )
    .validate(&module)
    .map_err(|e| e.emit_to_string_with_path(source, name))?;
    Ok((module, info))
}

/// Returns the problems of a shader's structs.
fn struct_problems(module: &naga::Module) -> Vec<String> {
    let known = layouts();
    let mut problems = Vec::new();
    for (_, ty) in module.types.iter() {
        let (Some(name), naga::TypeInner::Struct { members, span }) = (&ty.name, &ty.inner) else {
            continue;
        };
        let Some(layout) = known.iter().find(|l| l.name == name) else {
            if !SHADER_ONLY.contains(&name.as_str()) {
                problems.push(format!("struct {name} has no Rust counterpart"));
            }
            continue;
        };
        if layout.size != *span as usize {
            problems.push(format!(
                "struct {name} has {span} bytes, in Rust {}",
                layout.size
            ));
        }
        let fields: Vec<(&str, usize)> = members
            .iter()
            .map(|m| (m.name.as_deref().unwrap_or("?"), m.offset as usize))
            .filter(|(name, _)| !name.starts_with("pad"))
            .collect();
        if fields != layout.fields {
            problems.push(format!(
                "struct {name}: {fields:?}, in Rust {:?}",
                layout.fields
            ));
        }
    }
    problems
}

/// Returns the problems of a shader's constants.
fn constant_problems(module: &naga::Module) -> Vec<String> {
    let known = constants();
    let mut problems = Vec::new();
    for (_, constant) in module.constants.iter() {
        let name = constant.name.as_deref().unwrap_or("?");
        let value = match module.global_expressions[constant.init] {
            naga::Expression::Literal(naga::Literal::F32(v)) => f64::from(v),
            naga::Expression::Literal(naga::Literal::U32(v)) => f64::from(v),
            naga::Expression::Literal(naga::Literal::I32(v)) => f64::from(v),
            ref other => {
                problems.push(format!("const {name} is {other:?}"));
                continue;
            }
        };
        match known.get(name) {
            None => problems.push(format!("const {name} has no Rust counterpart")),
            Some(Some(rust)) if *rust != value => {
                problems.push(format!("const {name} is {value}, in Rust {rust}"))
            }
            Some(_) => {}
        }
    }
    problems
}

/// Returns the kind of a global variable, in the terms of the table.
fn kind_of(module: &naga::Module, variable: &naga::GlobalVariable) -> Option<BindingKind> {
    let ty = &module.types[variable.ty];
    let size = |ty: naga::Handle<naga::Type>| module.types[ty].inner.size(module.to_ctx()) as usize;
    match (variable.space, &ty.inner) {
        (naga::AddressSpace::Uniform, _) if ty.name.as_deref() == Some("Span") => {
            Some(BindingKind::Span)
        }
        (naga::AddressSpace::Uniform, _) => Some(BindingKind::Uniform(size(variable.ty))),
        (naga::AddressSpace::Storage { access }, naga::TypeInner::Array { stride, .. }) => {
            if access.contains(naga::StorageAccess::STORE) {
                Some(BindingKind::Write(*stride as usize))
            } else {
                Some(BindingKind::Read(*stride as usize))
            }
        }
        (
            _,
            naga::TypeInner::Image {
                class:
                    naga::ImageClass::Sampled {
                        kind: naga::ScalarKind::Float,
                        multi: false,
                    },
                arrayed: true,
                dim: naga::ImageDimension::D2,
            },
        ) => Some(BindingKind::Layers),
        (
            _,
            naga::TypeInner::Image {
                class:
                    naga::ImageClass::Storage {
                        format: naga::StorageFormat::Rgba16Float,
                        access,
                    },
                arrayed: false,
                dim: naga::ImageDimension::D3,
            },
        ) if *access == naga::StorageAccess::STORE => Some(BindingKind::Voxels),
        (
            _,
            naga::TypeInner::Image {
                class:
                    naga::ImageClass::Sampled {
                        kind: naga::ScalarKind::Float,
                        multi: false,
                    },
                arrayed: false,
                dim: naga::ImageDimension::D3,
            },
        ) => Some(BindingKind::Space),
        (_, naga::TypeInner::Sampler { comparison: false }) => Some(BindingKind::Sampler),
        (
            _,
            naga::TypeInner::Image {
                class,
                arrayed: false,
                dim: naga::ImageDimension::D2,
            },
        ) => match class {
            naga::ImageClass::Depth { multi: false } => Some(BindingKind::Depth),
            naga::ImageClass::Depth { multi: true } => Some(BindingKind::Samples),
            naga::ImageClass::Sampled {
                kind: naga::ScalarKind::Uint,
                multi: false,
            } => Some(BindingKind::Uint),
            naga::ImageClass::Sampled {
                kind: naga::ScalarKind::Float,
                multi: false,
            } => Some(BindingKind::Float),
            naga::ImageClass::Storage {
                format: naga::StorageFormat::Rgba16Float,
                access,
            } if *access == naga::StorageAccess::STORE => Some(BindingKind::Output),
            _ => None,
        },
        _ => None,
    }
}

/// Returns the problems of a shader's bindings and entry points.
fn interface_problems(kernel: &Kernel, module: &naga::Module, info: &ModuleInfo) -> Vec<String> {
    let mut problems = Vec::new();
    let bound = |v: &naga::GlobalVariable| v.binding.as_ref().map(|b| (b.group, b.binding));
    let mut declared = BTreeSet::new();
    for (_, variable) in module.global_variables.iter() {
        let Some((group, index)) = bound(variable) else {
            continue;
        };
        declared.insert(index);
        let name = variable.name.as_deref().unwrap_or("?");
        let kind = kind_of(module, variable);
        match kernel.bindings.iter().find(|b| b.index == index) {
            Some(b) if group == 0 && b.name == name && Some(b.kind) == kind => {}
            row => problems.push(format!(
                "{name} at {group}/{index} is {kind:?}, in the table {row:?}"
            )),
        }
    }
    for binding in kernel.bindings {
        if !declared.contains(&binding.index) {
            problems.push(format!("{binding:?} is not in the shader"));
        }
    }
    let mut names = BTreeSet::new();
    for (at, entry) in module.entry_points.iter().enumerate() {
        names.insert(entry.name.as_str());
        let uses = info.get_entry_point(at);
        let used: Vec<u32> = module
            .global_variables
            .iter()
            .filter(|(handle, _)| !uses[*handle].is_empty())
            .filter_map(|(_, v)| bound(v).map(|b| b.1))
            .collect::<BTreeSet<_>>()
            .into_iter()
            .collect();
        let row = kernel.entries.iter().find(|e| e.name == entry.name);
        match (entry.stage, row) {
            (naga::ShaderStage::Compute, Some(row)) => {
                if row.workgroup != entry.workgroup_size {
                    problems.push(format!(
                        "{}: workgroup {:?}, in the table {:?}",
                        entry.name, entry.workgroup_size, row.workgroup
                    ));
                }
                if row.bindings != used {
                    problems.push(format!(
                        "{}: uses {used:?}, in the table {:?}",
                        entry.name, row.bindings
                    ));
                }
            }
            (naga::ShaderStage::Vertex | naga::ShaderStage::Fragment, None)
                if kernel.draws().contains(&entry.name.as_str()) => {}
            _ => problems.push(format!("{} is not in the table", entry.name)),
        }
    }
    let rows = kernel.entries.iter().map(|e| e.name);
    let draws = kernel.draws().iter().copied();
    for name in rows.chain(draws).filter(|n| !names.contains(n)) {
        problems.push(format!("{name} is not in the shader"));
    }
    problems
}

fn problems(kernel: &Kernel, source: &str) -> Vec<String> {
    let (module, info) = match parse(kernel.name, source) {
        Ok(parsed) => parsed,
        Err(error) => return vec![error],
    };
    let mut all = struct_problems(&module);
    all.extend(constant_problems(&module));
    all.extend(interface_problems(kernel, &module, &info));
    all
}

#[test]
fn shader_structs_match_rust() {
    for kernel in &KERNELS {
        let found = problems(kernel, kernel.source);
        assert!(found.is_empty(), "{}:\n{}", kernel.name, found.join("\n"));
    }
}

#[test]
fn shader_struct_mismatch_is_detected() {
    // Kernel, replaced text, replacement, and a word of the message.
    let perturbations = [
        (
            "    radius: f32,\n    normal: vec3f,",
            "    normal: vec3f,\n    radius: f32,",
            "splat",
            "struct Point",
        ),
        (
            "spot_offset: f32,\n    pad0: f32,",
            "spot_offset: f32,\n    pad0: vec4f,",
            "project",
            "struct FrameLight",
        ),
        (
            "emission: f32,\n    points: u32,",
            "points: u32,\n    emission: f32,",
            "pull",
            "struct SolveParams",
        ),
        (
            "const FAR: f32 = 1e30;",
            "const FAR: f32 = 1e20;",
            "project",
            "const FAR",
        ),
        (
            "const LIGHT_SPOT: u32 = 2u;",
            "const LIGHT_SPOT: u32 = 3u;",
            "project",
            "const LIGHT_SPOT",
        ),
        (
            "const LANES: u32 = 16u;",
            "const LANES: u32 = 32u;",
            "apply",
            "const LANES",
        ),
        (
            "const COLUMN_LANES: u32 = 64u;",
            "const COLUMN_LANES: u32 = 32u;",
            "compress",
            "const COLUMN_LANES",
        ),
        (
            "count: u32,\n    value: u32,",
            "value: u32,\n    count: u32,",
            "compress",
            "struct Column",
        ),
        (
            "@workgroup_size(64)",
            "@workgroup_size(32)",
            "flatten",
            "workgroup",
        ),
        (
            "@binding(3) var<storage, read> entries",
            "@binding(9) var<storage, read> entries",
            "push",
            "in the table None",
        ),
        (
            "<storage, read> values",
            "<storage, read_write> values",
            "splat",
            "values",
        ),
        (
            "grid_entries: array<u32>;",
            "grid_entries: array<vec2u>;",
            "splat",
            "",
        ),
        (
            "fn interpolate(",
            "fn interpolate_level(",
            "bounce",
            "interpolate_level is not in the table",
        ),
        (
            "let entry = entries[at];\n        alpha -= entry.weight * differences[entry.index];",
            "alpha -= 1.0;",
            "push",
            "uses",
        ),
        ("rgba16float, write", "rgba8unorm, write", "splat", "output"),
        (
            "spread: f32,\n    normal: vec3f,",
            "normal: vec3f,\n    spread: f32,",
            "rsm",
            "struct RsmTexel",
        ),
        (
            "const CHUNKS: u32 = 256u;",
            "const CHUNKS: u32 = 128u;",
            "rsm",
            "const CHUNKS",
        ),
        (
            "near: u32,\n    finish: u32,",
            "finish: u32,\n    near: u32,",
            "fmm_down",
            "struct FmmNode",
        ),
        (
            "extent: f32,\n    dim: f32,",
            "dim: f32,\n    extent: f32,",
            "vpl",
            "struct VplParams",
        ),
        (
            "const WEIGHT_BITS: u32 = 12u;",
            "const WEIGHT_BITS: u32 = 11u;",
            "volume",
            "const WEIGHT_BITS",
        ),
        (
            "const VIEW_COSINE_TOLERANCE: f32 = 0.15;",
            "const VIEW_COSINE_TOLERANCE: f32 = 0.2;",
            "vpl_specular",
            "const VIEW_COSINE_TOLERANCE",
        ),
    ];
    for (from, to, name, complaint) in perturbations {
        let kernel = KERNELS.iter().find(|k| k.name == name).unwrap();
        assert!(kernel.source.contains(from), "{name} has no {from:?}");
        let found = problems(kernel, &kernel.source.replace(from, to)).join("\n");
        assert!(
            !found.is_empty() && found.contains(complaint),
            "{name}: {from:?} → {to:?} gave {found:?}"
        );
    }
}

#[test]
fn kernel_table_has_each_entry_point_once_within_webgpu_limits() {
    for (at, id) in EntryPoint::ALL.into_iter().enumerate() {
        assert_eq!(id as usize, at);
        let entries = KERNELS
            .iter()
            .flat_map(|k| k.entries)
            .filter(|e| e.id == id)
            .count();
        assert_eq!(entries, 1, "{id:?}");
        let (kernel, entry) = id.entry();
        let storage = KERNELS[kernel]
            .bindings
            .iter()
            .filter(|b| {
                entry.bindings.contains(&b.index)
                    && matches!(b.kind, BindingKind::Read(_) | BindingKind::Write(_))
            })
            .count();
        assert!(storage <= 8, "{id:?} binds {storage} storage buffers");
        assert!(entry.workgroup.iter().product::<u32>() <= 256);
    }
    for kernel in &KERNELS {
        assert!(
            !kernel.source.contains("enable "),
            "{} needs an extension",
            kernel.name
        );
        assert!(
            !kernel.source.contains("#if"),
            "{} needs a preprocessor",
            kernel.name
        );
    }
}

/// Returns the stems of the files with this extension in a folder of the crate.
fn stems(folder: &str, extension: &str) -> BTreeSet<String> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
    let files = std::fs::read_dir(&folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    let paths = files.map(|f| f.unwrap().path());
    paths
        .filter(|p| p.extension().is_some_and(|e| e == extension))
        .map(|p| p.file_stem().unwrap().to_str().unwrap().to_owned())
        .collect()
}

#[test]
fn every_kernel_has_shader_and_twin() {
    let kernels: BTreeSet<String> = KERNELS.iter().map(|k| k.name.to_owned()).collect();
    assert_eq!(kernels.len(), KERNELS.len());
    assert_eq!(stems("shaders", "wgsl"), kernels);
    // Other files of crates/meshless_gi/src/frame/: shared types of the twins, and their callers.
    let shared = [
        "mod",
        "layout",
        "light",
        "gbuffer",
        "brdf",
        "settings",
        "cpu_frame",
        "anderson",
        "channels",
        "rsm_layout",
        "subsplat",
        "subsplat_view",
        "fmm_layout",
        "materials",
        "volume_walls",
        "volume_weights",
        "volume_sample",
        "volume_distance",
    ]
    .map(str::to_owned);
    let twins: BTreeSet<String> = stems("crates/meshless_gi/src/frame", "rs")
        .into_iter()
        .filter(|s| !shared.contains(s))
        .collect();
    assert_eq!(twins, kernels);
    for part in stems("shaders/lib", "wgsl") {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("shaders/lib/{part}.wgsl"));
        let text = std::fs::read_to_string(path).unwrap();
        assert!(
            KERNELS.iter().any(|k| k.source.contains(&text)),
            "no kernel uses shaders/lib/{part}.wgsl"
        );
    }
}

#[test]
fn shaders_compile_to_spirv() {
    for kernel in &KERNELS {
        let (module, info) = parse(kernel.name, kernel.source).unwrap();
        eprintln!("{}", kernel.name);
        let words =
            naga::back::spv::write_vec(&module, &info, &naga::back::spv::Options::default(), None)
                .unwrap();
        assert!(words.len() > 100, "{}", kernel.name);
    }
}
