//! Passes of a view's post-processing.

use super::{FramePoint, Spans, passes_of_view, report_missing};
use crate::gpu::{GpuCounters, KernelPipelines};
use crate::plan::{Pass, SceneId, ViewId};
use crate::plugin::effect_states::EffectStates;
use crate::plugin::effects::Record;
use crate::plugin::effects::fog::fog_volumes::ExtractedFogs;
use crate::plugin::effects::volume::irradiance_volume::ExtractedVolumes;
use crate::plugin::extract::ExtractedGi;
use crate::plugin::render_state::{GiRender, SceneRuntime};
use bevy::ecs::prelude::*;
use bevy::math::Mat4;
use bevy::render::camera::{ExtractedCamera, TemporalJitter};
use bevy::render::diagnostic::RecordDiagnostics;
use bevy::render::render_asset::RenderAssets;
use bevy::render::renderer::RenderContext;
use bevy::render::texture::{FallbackImage, GpuImage};
use bevy::render::view::{ExtractedView, ViewDepthTexture, ViewTarget};
use std::collections::BTreeMap;

/// Resources of [`PostProcessWorld`], as the parameter of a system.
pub(crate) type PostProcessResources<'w> = (
    Res<'w, ExtractedFogs>,
    Res<'w, ExtractedVolumes>,
    Res<'w, ExtractedGi>,
    Res<'w, RenderAssets<GpuImage>>,
    Res<'w, FallbackImage>,
);

/// World and textures that the passes read. No `SystemParam`, as
/// [`ExtractedWorld`](crate::plugin::observe::ExtractedWorld).
pub(crate) struct PostProcessWorld<'w> {
    pub fogs: Res<'w, ExtractedFogs>,
    pub volumes: Res<'w, ExtractedVolumes>,
    pub gi: Res<'w, ExtractedGi>,
    pub images: Res<'w, RenderAssets<GpuImage>>,
    pub fallback: Res<'w, FallbackImage>,
}

impl<'w> From<PostProcessResources<'w>> for PostProcessWorld<'w> {
    fn from((fogs, volumes, gi, images, fallback): PostProcessResources<'w>) -> Self {
        Self {
            fogs,
            volumes,
            gi,
            images,
            fallback,
        }
    }
}

/// A view whose surfaces are drawn.
pub(crate) struct PostProcessView<'a> {
    pub id: ViewId,
    pub view: &'a ExtractedView,
    pub camera: &'a ExtractedCamera,
    pub target: &'a ViewTarget,
    pub depth: &'a ViewDepthTexture,
    /// `true` if the depth has several samples per pixel.
    pub sampled: bool,
    pub jitter: Option<&'a TemporalJitter>,
}

impl PostProcessView<'_> {
    /// Transform from the view to clip space, with the jitter of the depth.
    pub fn clip_from_view(&self) -> Mat4 {
        super::clip_from_view(self.view, self.camera, self.jitter)
    }
}

/// A view, and the means to record its passes.
pub(crate) struct PostProcessContext<'a> {
    pub kernels: &'a KernelPipelines,
    pub queue: &'a wgpu::Queue,
    pub encoder: &'a mut wgpu::CommandEncoder,
    pub view: &'a PostProcessView<'a>,
    pub world: &'a PostProcessWorld<'a>,
    pub scenes: &'a BTreeMap<SceneId, SceneRuntime>,
    /// States of an earlier frame. Those that no pass takes are released.
    pub earlier: EffectStates,
    /// States of the effects in the view.
    pub states: &'a mut EffectStates,
    /// Counters of the buffers that belong to no scene.
    pub counters: &'a mut GpuCounters,
}

/// Records the passes of a view in its post-processing. Successive passes of one stage are recorded
/// together.
pub(crate) fn record_post_process(
    render: &mut GiRender,
    view: &PostProcessView<'_>,
    world: &PostProcessWorld<'_>,
    queue: &wgpu::Queue,
    ctx: &mut RenderContext,
) {
    let point = FramePoint::PostProcess;
    let passes: Vec<_> = passes_of_view(render.effects, &render.plan, view.id, point).collect();
    let Some(kernels) = render.kernels.as_ref().filter(|_| !passes.is_empty()) else {
        return;
    };
    let states = render.post_process.entry(view.id).or_default();
    let earlier = std::mem::take(states);
    let recorder = ctx.diagnostic_recorder();
    let recorder = recorder.as_deref();
    let encoder = ctx.command_encoder();
    let whole = recorder.time_span(encoder, point.span());
    let mut spans = Spans::new(recorder);
    let mut ctx = PostProcessContext {
        kernels,
        queue,
        encoder,
        view,
        world,
        scenes: &render.scenes,
        earlier,
        states,
        counters: &mut render.retired,
    };
    for group in passes.chunk_by(|(a, _), (b, _)| a.stage == b.stage) {
        let (first, how) = group[0];
        if let Record::PostProcess(record) = how {
            let passes: Vec<&Pass> = group.iter().map(|(pass, _)| *pass).collect();
            spans.enter(ctx.encoder, first.timing);
            report_missing(record(&mut ctx, &passes), first);
        }
    }
    spans.enter(ctx.encoder, None);
    whole.end(ctx.encoder);
}
