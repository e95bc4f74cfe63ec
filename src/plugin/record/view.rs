//! Passes of a view's main pass.

use super::layers::evaluate_layers;
use super::{FramePoint, Recorder, Spans, passes_of_view, report_missing};
use crate::gpu::{GpuCounters, KernelPipelines};
use crate::plan::{Pass, SceneId, ViewId};
use crate::plugin::effect_states::EffectStates;
use crate::plugin::effects::Record;
use crate::plugin::effects::soft_shadows::soft_lights::ExtractedSoft;
use crate::plugin::extract::{ExtractedGi, ExtractedGiView};
use crate::plugin::render_state::{GiRender, SceneRuntime};
use crate::plugin::view_state::ViewRuntime;
use bevy::log::warn_once;
use bevy::math::Mat4;
use bevy::render::camera::{ExtractedCamera, TemporalJitter};
use bevy::render::diagnostic::RecordDiagnostics;
use bevy::render::renderer::RenderContext;
use bevy::render::view::{ExtractedView, ViewTarget};
use std::collections::BTreeMap;

/// Surfaces of a view, as textures of the size of its target.
pub(crate) struct Surfaces<'a> {
    pub view: &'a ExtractedView,
    pub camera: &'a ExtractedCamera,
    pub jitter: Option<&'a TemporalJitter>,
    /// Depth, reversed (0 is infinitely far), one sample per pixel.
    pub depth: &'a wgpu::TextureView,
    /// Bevy's deferred G-buffer, or a texture with the same normals.
    pub gbuffer: &'a wgpu::TextureView,
    pub size: [u32; 2],
}

impl Surfaces<'_> {
    /// The viewport in texels: x, y, width, height.
    pub fn viewport(&self) -> [f32; 4] {
        self.view.viewport.as_vec4().to_array()
    }

    /// Transform from the view to clip space, with the jitter of the depth.
    pub fn clip_from_view(&self) -> Mat4 {
        super::clip_from_view(self.view, self.camera, self.jitter)
    }

    /// Transform from the view to the world.
    pub fn world_from_view(&self) -> Mat4 {
        self.view.world_from_view.to_matrix()
    }
}

/// Picture of a deferred camera.
pub(crate) struct Picture<'a> {
    pub target: &'a ViewTarget,
    /// Bevy's texture of deferred lighting passes.
    pub lighting_passes: &'a wgpu::TextureView,
    pub soft: &'a ExtractedSoft,
}

/// A view, as its passes are recorded.
pub(crate) struct ViewInput<'a> {
    /// The camera as extracted from the main world.
    pub camera: &'a ExtractedGiView,
    pub surfaces: &'a Surfaces<'a>,
    /// Picture to which light is added. `None` for a forward camera, whose surfaces read the
    /// irradiance.
    pub picture: Option<Picture<'a>>,
    pub world: &'a ExtractedGi,
}

/// A view, and the means to record its passes.
pub(crate) struct ViewContext<'a> {
    pub kernels: &'a KernelPipelines,
    pub queue: &'a wgpu::Queue,
    pub encoder: &'a mut wgpu::CommandEncoder,
    pub input: &'a ViewInput<'a>,
    pub scenes: &'a mut BTreeMap<SceneId, SceneRuntime>,
    /// States of the effects that belong to no scene and no view.
    pub world_states: &'a mut EffectStates,
    pub runtime: &'a mut ViewRuntime,
    /// States of an earlier frame. Those that no pass takes are released.
    pub earlier: EffectStates,
    /// Counters of the buffers that belong to no scene.
    pub counters: &'a mut GpuCounters,
    /// Scenes that the view shows, in order. Their parameters are in the view's buffers.
    pub shown: Vec<SceneId>,
    /// Exposed irradiance in rgb and coverage in a, after the layers were evaluated.
    pub irradiance: Option<wgpu::TextureView>,
}

impl ViewContext<'_> {
    /// The scene whose parameters the view's draws use.
    pub fn primary_scene(&self) -> SceneId {
        self.shown.first().copied().unwrap_or(SceneId::WORLD)
    }
}

/// Records the passes of a view in its main pass. Returns its irradiance. `None` if nothing lights
/// the view. `input` is `None` for a view without a G-buffer.
pub(crate) fn record_view(
    render: &mut GiRender,
    id: ViewId,
    input: Option<&ViewInput<'_>>,
    queue: &wgpu::Queue,
    ctx: &mut RenderContext,
) -> Option<wgpu::TextureView> {
    let point = FramePoint::MainPass;
    let passes: Vec<_> = passes_of_view(render.effects, &render.plan, id, point).collect();
    let kernels = render.kernels.as_ref().filter(|_| !passes.is_empty())?;
    let Some(input) = input else {
        warn_once!(
            "a camera with indirect light has no G-buffer: it has no deferred materials in view, or not all prepasses"
        );
        return None;
    };
    let recorder = ctx.diagnostic_recorder();
    let recorder = recorder.as_deref();
    let encoder = ctx.command_encoder();
    let whole = recorder.time_span(encoder, point.span());
    let runtime = ViewRuntime::of_size(&mut render.views, id, input.surfaces.size);
    let mut ctx = ViewContext {
        kernels,
        queue,
        encoder,
        input,
        scenes: &mut render.scenes,
        world_states: &mut render.states,
        earlier: std::mem::take(&mut runtime.states),
        runtime,
        counters: &mut render.retired,
        shown: Vec::new(),
        irradiance: None,
    };
    record_passes(&passes, &mut ctx, recorder);
    let irradiance = ctx.irradiance.take();
    whole.end(ctx.encoder);
    irradiance
}

/// Walks the passes of a view. Successive layers are recorded together, and so are successive
/// passes of one stage.
fn record_passes(
    passes: &[(&Pass, &'static Record)],
    ctx: &mut ViewContext<'_>,
    recorder: Recorder<'_>,
) {
    let mut spans = Spans::new(recorder);
    let together = |(a, how): &(&Pass, &Record), (b, other): &(&Pass, &Record)| {
        let layers = matches!((how, other), (Record::Layer(_), Record::Layer(_)));
        layers || a.stage == b.stage
    };
    for group in passes.chunk_by(together) {
        let (first, how) = group[0];
        spans.enter(ctx.encoder, first.timing);
        if let Record::View(record) = how {
            let passes: Vec<&Pass> = group.iter().map(|(pass, _)| *pass).collect();
            report_missing(record(ctx, &passes), first);
            continue;
        }
        let mut layers = Vec::with_capacity(group.len());
        for (pass, how) in group {
            if let Record::Layer(layer) = how {
                let prepared = (layer.prepare)(ctx, pass);
                report_missing(prepared, pass);
                layers.extend(prepared.map(|()| (*pass, layer)));
            }
        }
        if !layers.is_empty() {
            evaluate_layers(ctx, &layers);
        }
    }
    spans.enter(ctx.encoder, None);
}
