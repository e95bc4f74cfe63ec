//! Effect `display`: indirect light at the pixels of each view.
//!
//! Reads: the views, the scenes in them, and the pixels at which they evaluate light. The layers of
//! a view (surface irradiance, and those of other effects) are evaluated together, by
//! multiresolution splatting ([N09]) or at every pixel. Kernels: `splat`, `pyramid`, `refine`,
//! `upsample`; the draw `composite`.

pub(crate) mod splatting;

use super::{Effect, PassKind, Record, Recording};
use crate::gpu;
use crate::gpu::{Draw, SplatTargets, ViewBuffers, draw_over};
use crate::plan::{
    FrameStage, FrameState, Pass, Plan, RunReason, SceneId, SkipReason, Timing, Work,
};
use crate::plugin::camera::GiDebugView;
use crate::plugin::record::{LayerInput, LayerRecording, SubsplatLayers, ViewContext};
use bevy::render::render_resource::RenderPassDescriptor;
use meshless_gi::internals::frame::{CompositeParams, SplatParams};

pub(super) const EFFECT: Effect = Effect {
    name: "display",
    summary: "evaluates indirect light at the pixels of each view",
    schedule,
    passes: &[
        PassKind {
            stage: FrameStage::SPLAT,
            per_view: true,
            timing: Timing::With(FrameStage::SPLAT),
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
                how: Record::Layer(LayerRecording {
                    prepare,
                    splat,
                    add_to_subsplats,
                }),
            },
        },
        PassKind {
            stage: FrameStage::COMPOSITE,
            per_view: true,
            timing: Timing::With(FrameStage::COMPOSITE),
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
        for scene in state.active_scenes().filter(|s| view.sees.contains(&s.id)) {
            let skip = match (view.enabled, view.has_gbuffer) {
                (false, _) => SkipReason::ViewDisabled,
                (true, false) => SkipReason::NoGbuffer,
                (true, true) => {
                    plan.push_layer(EFFECT.name, FrameStage::SPLAT, scene.id, view);
                    continue;
                }
            };
            plan.skipped.push((scene.id, Some(view.id), skip));
        }
    }
    // All layers of a view are added to its picture at once.
    for view in state.views.iter().filter(|view| view.has_picture) {
        if plan.displays.iter().all(|(id, _)| *id != view.id) {
            continue;
        }
        let first = state.active_scenes().find(|s| view.shows(s.id));
        let scene = first.map_or(SceneId::WORLD, |s| s.id);
        let (stage, reason) = (FrameStage::COMPOSITE, RunReason::InView);
        plan.push(EFFECT.name, stage, scene, reason).view = Some(view.id);
    }
}

/// Writes the parameters of a scene in the view.
fn prepare(ctx: &mut ViewContext<'_>, pass: &Pass) -> Option<()> {
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
    ctx.shown.push(pass.scene);
    Some(())
}

/// Adds the surface irradiance of a scene.
fn splat(ctx: &mut ViewContext<'_>, pass: &Pass, targets: &SplatTargets<'_>) -> Option<()> {
    let frame = ctx.scenes.get_mut(&pass.scene)?.frame.as_mut()?;
    let buffers = ctx.runtime.buffers.get(&pass.scene)?;
    frame.splat(ctx.kernels, ctx.encoder, buffers, targets);
    Some(())
}

/// Adds a scene to the subsplats of a view.
fn add_to_subsplats<'a>(
    input: &LayerInput<'a>,
    pass: &Pass,
    layers: &mut SubsplatLayers<'a>,
) -> Option<()> {
    let frame = input.scenes.get(&pass.scene)?.frame.as_ref()?;
    let buffers = input.buffers.get(&pass.scene)?;
    layers.scenes.push((frame.buffers(), buffers));
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

/// Draws the irradiance over the picture of a deferred camera.
fn record_composite(ctx: &mut ViewContext<'_>, _: &[&Pass]) -> Option<()> {
    let primary_scene = ctx.primary_scene();
    if primary_scene == SceneId::WORLD {
        let params = SplatParams {
            size: ctx.input.surfaces.size,
            ..bytemuck::Zeroable::zeroed()
        };
        write_params(ctx, primary_scene, &params);
    }
    let how = match ctx.input.camera.settings.debug_view {
        GiDebugView::Final => Draw::Add,
        _ => Draw::Replace,
    };
    let irradiance = ctx.irradiance.clone()?;
    draw_over_picture(ctx, how, &irradiance)?;
    ctx.counters.composites += 1;
    Some(())
}

/// Draws a texture of the view's size over its picture. Returns `None` if there is no picture, or
/// if no layer lights the view.
pub(super) fn draw_over_picture(
    ctx: &mut ViewContext<'_>,
    how: Draw,
    texture: &wgpu::TextureView,
) -> Option<()> {
    let surfaces = ctx.input.surfaces;
    let picture = ctx.input.picture.as_ref()?;
    let params = ctx.runtime.buffers.get(&ctx.primary_scene())?;
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
    Some(())
}
