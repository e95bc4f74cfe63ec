//! Effect `display`: indirect light at the pixels of each view.
//!
//! Reads: the views, the scenes in them, and the pixels at which they evaluate light. The layers of
//! a view (surface irradiance, probe irradiance, virtual lights) are evaluated together, by
//! multiresolution splatting ([N09]) or at every pixel. Kernels: `splat`, `pyramid`, `refine`,
//! `upsample`; the draw `composite`.

use super::rsm::{self, Reflections};
use super::{Effect, PassKind, Record, Recording, probes};
use crate::gpu;
use crate::gpu::{Draw, SceneBuffers, SplatTargets, SubsplatTargets, ViewBuffers, draw_over};
use crate::plan::{
    DisplayUse, FrameStage, FrameState, Pass, Plan, RunReason, SceneId, SkipReason, Work,
};
use crate::plugin::camera::GiDebugView;
use crate::plugin::record::{Layer, ViewContext};
use crate::plugin::splatting::{GiSplatting, SubsplatView, ViewSubsplats};
use bevy::log::warn_once;
use bevy::render::render_resource::RenderPassDescriptor;
use meshless_gi::internals::frame::{CompositeParams, SplatParams, SubsplatParams};

pub(super) const EFFECT: Effect = Effect {
    name: "display",
    summary: "evaluates indirect light at the pixels of each view",
    schedule,
    passes: &[
        PassKind {
            stage: FrameStage::SPLAT,
            per_view: true,
            timed_with: Some(FrameStage::SPLAT),
            work: |state, pass| Work::Pixels(state.pixels(pass.view)),
            record: Recording {
                kernels: &[
                    gpu::EntryPoint::Splat,
                    gpu::EntryPoint::SplatOver,
                    gpu::EntryPoint::SplatNodes,
                    gpu::EntryPoint::PyramidBase,
                    gpu::EntryPoint::PyramidReduce,
                    gpu::EntryPoint::RefineStart,
                    gpu::EntryPoint::Refine,
                    gpu::EntryPoint::Upsample,
                    gpu::EntryPoint::Resolve,
                    gpu::EntryPoint::Fill,
                ],
                draws: None,
                how: Record::Layer(add_layer),
            },
        },
        PassKind {
            stage: FrameStage::COMPOSITE,
            per_view: true,
            timed_with: Some(FrameStage::COMPOSITE),
            work: |state, pass| Work::Pixels(state.pixels(pass.view)),
            record: Recording {
                kernels: &[],
                draws: Some(|counters| counters.composites),
                how: Record::View(record_composite),
            },
        },
    ],
};

fn schedule(state: &FrameState, plan: &mut Plan) {
    for view in &state.views {
        let mut shown = Vec::new();
        for scene in state.active_scenes().filter(|s| view.sees.contains(&s.id)) {
            let skip = match (view.enabled, view.has_gbuffer) {
                (false, _) => SkipReason::ViewDisabled,
                (true, false) => SkipReason::NoGbuffer,
                (true, true) => {
                    let (stage, reason) = (FrameStage::SPLAT, RunReason::InView);
                    plan.push(EFFECT.name, stage, scene.id, reason).view = Some(view.id);
                    shown.push(scene);
                    continue;
                }
            };
            plan.skipped.push((scene.id, Some(view.id), skip));
        }
        for scene in &shown {
            probes::schedule_in_view(scene, view.id, plan);
        }
        rsm::schedule_in_view(state, view, plan);
        let first = shown.first().map(|scene| scene.id);
        // All layers of a view make one picture, which is added once.
        let world = rsm::lights_view(state, view).then_some(SceneId::WORLD);
        if let Some(scene) = first.or(world) {
            plan.displays.push((view.id, view.display));
            let (stage, reason) = (FrameStage::COMPOSITE, RunReason::InView);
            plan.push(EFFECT.name, stage, scene, reason).view = Some(view.id);
        }
    }
}

/// Adds the surface irradiance of a scene.
fn add_layer(ctx: &mut ViewContext<'_>, pass: &Pass) -> Option<()> {
    let scene = ctx.input.world.scenes.iter().find(|s| s.id == pass.scene);
    let placement = scene?.placement?;
    let frame = ctx.scenes.get(&pass.scene)?.frame.as_ref()?;
    let surfaces = ctx.input.surfaces;
    let (world_from_view, clip_from_view) = (surfaces.world_from_view(), surfaces.clip_from_view());
    let params = SplatParams {
        local_from_clip: placement
            .local_from_clip(clip_from_view, world_from_view)
            .to_cols_array_2d(),
        ..frame.splat_params(
            world_from_view * clip_from_view.inverse(),
            placement.matrix(),
            surfaces.viewport(),
            surfaces.size,
            surfaces.camera.exposure,
        )
    };
    let probes = frame.probe_params(&params);
    let (device, queue) = (ctx.kernels.device(), ctx.queue);
    write_params(ctx, pass.scene, &params).write_probes(device, queue, probes.as_ref());
    ctx.layers.push(Layer::Scene(pass.scene));
    Some(())
}

/// Writes the parameters of a scene in the view, in new buffers if it has none.
fn write_params<'c>(
    ctx: &'c mut ViewContext<'_>,
    scene: SceneId,
    params: &SplatParams,
) -> &'c mut ViewBuffers {
    let settings = &ctx.input.camera.settings;
    let composite = CompositeParams {
        scale: settings.intensity.max(0.0),
        white: f32::from(u8::from(settings.debug_view == GiDebugView::Irradiance)),
        ..CompositeParams::default()
    };
    let device = ctx.kernels.device();
    let buffers = (ctx.runtime.buffers.entry(scene)).or_insert_with(|| ViewBuffers::new(device));
    buffers.write(ctx.queue, params, &composite);
    buffers
}

/// Evaluates the layers of a view: its irradiance.
pub(crate) fn evaluate_layers(ctx: &mut ViewContext<'_>) {
    if ctx.layers.is_empty() {
        return;
    }
    let primary_scene = ctx.primary_scene();
    if primary_scene == SceneId::WORLD {
        let params = SplatParams {
            size: ctx.input.surfaces.size,
            ..bytemuck::Zeroable::zeroed()
        };
        write_params(ctx, primary_scene, &params);
    }
    let layers = &ctx.layers;
    (ctx.runtime.buffers)
        .retain(|id, _| layers.contains(&Layer::Scene(*id)) || *id == primary_scene);
    ctx.irradiance = match subsplats(ctx) {
        Some((subsplats, params)) => Some(evaluate_subsplats(ctx, subsplats, &params)),
        None => evaluate_pixels(ctx),
    };
}

/// Returns the view's subsplats and their parameters. `None` if it evaluates light at every pixel,
/// or if the device cannot hold the subsplats.
fn subsplats(ctx: &mut ViewContext<'_>) -> Option<(ViewSubsplats, SubsplatParams)> {
    let before = ctx.earlier.take::<ViewSubsplats>();
    let surfaces = ctx.input.surfaces;
    let (Some(DisplayUse::Subsplats), GiSplatting::Multiresolution(settings)) =
        (ctx.display, &ctx.input.camera.display)
    else {
        return None;
    };
    let params = SubsplatParams::new(
        settings,
        surfaces.clip_from_view().inverse(),
        surfaces.world_from_view().inverse(),
        surfaces.viewport(),
        surfaces.size,
    );
    match ViewSubsplats::fit(before, ctx.kernels.device(), ctx.queue, params.levels()) {
        Ok(fits) => Some((fits, params)),
        Err(error) => {
            warn_once!("a view evaluates indirect light at every pixel: {error}");
            ctx.runtime.too_large = true;
            None
        }
    }
}

fn evaluate_subsplats(
    ctx: &mut ViewContext<'_>,
    mut subsplats: ViewSubsplats,
    params: &SubsplatParams,
) -> wgpu::TextureView {
    let output = ctx.runtime.irradiance(0, ctx.kernels.device());
    let scenes: Vec<(&SceneBuffers, &ViewBuffers)> = (ctx.layers.iter())
        .filter_map(|layer| {
            let Layer::Scene(id) = layer else { return None };
            let frame = ctx.scenes.get(id)?.frame.as_ref()?;
            Some((frame.buffers(), ctx.runtime.buffers.get(id)?))
        })
        .collect();
    let lit = ctx.layers.contains(&Layer::VirtualLights);
    let reflections = ctx.world_states.get::<Reflections>().filter(|_| lit);
    let lights = reflections.map(|r| r.view_lights(ctx.input, ctx.scenes, &ctx.layers));
    let targets = SubsplatTargets {
        depth: ctx.input.surfaces.depth,
        gbuffer: ctx.input.surfaces.gbuffer,
        output: &output,
    };
    let view = SubsplatView {
        params,
        targets: &targets,
        scenes: &scenes,
        lights: lights.as_ref(),
    };
    let recorded = subsplats.record(ctx.kernels, ctx.queue, ctx.encoder, &view);
    ctx.counters.add(&recorded);
    ctx.runtime.states.insert(subsplats);
    ctx.runtime.irradiance[1] = None;
    output
}

/// Evaluates the layers one after another. Each adds to the output of the one before.
fn evaluate_pixels(ctx: &mut ViewContext<'_>) -> Option<wgpu::TextureView> {
    let device = ctx.kernels.device();
    let first = ctx.runtime.irradiance(0, device);
    let second = (ctx.layers.len() > 1).then(|| ctx.runtime.irradiance(1, device));
    if second.is_none() {
        ctx.runtime.irradiance[1] = None;
    }
    let textures = [Some(first), second];
    for (turn, layer) in ctx.layers.clone().into_iter().enumerate() {
        let targets = SplatTargets {
            depth: ctx.input.surfaces.depth,
            gbuffer: ctx.input.surfaces.gbuffer,
            earlier: textures[1 - turn % 2].as_ref().filter(|_| turn > 0),
            output: textures[turn % 2].as_ref()?,
        };
        evaluate_layer(ctx, layer, &targets);
    }
    textures[(ctx.layers.len() - 1) % 2].clone()
}

fn evaluate_layer(ctx: &mut ViewContext<'_>, layer: Layer, targets: &SplatTargets<'_>) {
    match layer {
        Layer::Scene(id) | Layer::Probes(id) => {
            let frame = ctx.scenes.get_mut(&id).and_then(|s| s.frame.as_mut());
            let (Some(frame), Some(buffers)) = (frame, ctx.runtime.buffers.get(&id)) else {
                return;
            };
            if layer == Layer::Scene(id) {
                frame.splat(ctx.kernels, ctx.encoder, buffers, targets);
            } else {
                frame.probe(ctx.kernels, ctx.encoder, buffers, targets);
            }
        }
        Layer::VirtualLights => {
            let Some(reflections) = ctx.world_states.get_mut::<Reflections>() else {
                return;
            };
            let lights = reflections.view_params(ctx.input, ctx.scenes, &ctx.layers);
            reflections.light_view(ctx.kernels, ctx.queue, ctx.encoder, &lights, targets);
        }
    }
}

/// Draws the irradiance over the picture of a deferred camera.
fn record_composite(ctx: &mut ViewContext<'_>, _: &[&Pass]) -> Option<()> {
    let how = match ctx.input.camera.settings.debug_view {
        GiDebugView::Final => Draw::Add,
        _ => Draw::Replace,
    };
    let irradiance = ctx.irradiance.clone()?;
    let drawn = draw_over_picture(ctx, how, &irradiance);
    ctx.counters.composites += u64::from(drawn);
    Some(())
}

/// Draws a texture of the view's size over its picture. Returns `false` if there is no picture, or
/// if no layer lights the view.
pub(super) fn draw_over_picture(
    ctx: &mut ViewContext<'_>,
    how: Draw,
    texture: &wgpu::TextureView,
) -> bool {
    let primary_scene = ctx.primary_scene();
    let surfaces = ctx.input.surfaces;
    let (Some(picture), Some(params)) =
        (&ctx.input.picture, ctx.runtime.buffers.get(&primary_scene))
    else {
        return false;
    };
    let mut pass = ctx.encoder.begin_render_pass(&RenderPassDescriptor {
        label: Some("meshless_gi composite"),
        color_attachments: &[Some(picture.target.get_color_attachment())],
        depth_stencil_attachment: None,
        timestamp_writes: None,
        occlusion_query_set: None,
        multiview_mask: None,
    });
    let [x, y, width, height] = surfaces.view.viewport.to_array();
    pass.set_viewport(x as f32, y as f32, width as f32, height as f32, 0.0, 1.0);
    pass.set_scissor_rect(x, y, width, height);
    let textures = [texture, surfaces.gbuffer, picture.lighting_passes];
    let format = surfaces.view.target_format;
    draw_over(ctx.kernels, &mut pass, format, how, params, textures);
    true
}
