//! Recording of a plan: walks the passes in their order and calls the recording of each.
//!
//! | passes | recorded by | before |
//! |---|---|---|
//! | of a scene, shared by all views | [`record_scene`] | any camera draws |
//! | of a view | [`record_view`] | the view's transparent surfaces |
//! | fog of a view | [`super::effects::fog::draw`] | the view's post-processing |
//! | maps of a light | [`super::rsm_render`] | the views: Bevy draws a camera for each map |

use super::effects::subtract_shadow::ViewShadow;
use super::effects::vpl_specular::ViewSpecular;
use super::effects::{Effect, Record, display};
use super::extract::{ExtractedGi, ExtractedGiView, ExtractedScene};
use super::readback::CoefficientReadback;
use super::render_state::{GiRender, SceneRuntime};
use super::rsm_render::Reflections;
use super::soft_shadow::ExtractedSoft;
use super::view_state::ViewRuntime;
use super::volume::ExtractedVolumes;
use crate::gpu::{GpuCounters, GpuError, KernelPipelines};
use crate::plan::{Pass, Plan, SceneId, TimingScope, kind_of};
use bevy::math::Mat4;
use bevy::render::camera::{ExtractedCamera, TemporalJitter};
use bevy::render::diagnostic::{DiagnosticsRecorder, RecordDiagnostics};
use bevy::render::renderer::RenderContext;
use bevy::render::view::{ExtractedView, ViewTarget};
use std::collections::BTreeMap;

/// Recorder of Bevy's diagnostics. `None` if the app has none.
pub(crate) type Recorder<'a> = Option<&'a DiagnosticsRecorder>;

/// Spans of the device's clock, outermost first. Passes of one timing scope share a span.
pub(crate) struct Spans<'a> {
    recorder: Recorder<'a>,
    open: Vec<String>,
}

impl<'a> Spans<'a> {
    /// Creates a recorder of spans.
    pub fn new(recorder: Recorder<'a>) -> Self {
        Self {
            recorder,
            open: Vec::new(),
        }
    }

    /// Opens the spans of a scope and closes those that do not contain it.
    pub fn enter(&mut self, encoder: &mut wgpu::CommandEncoder, scope: Option<TimingScope>) {
        let path = scope.map_or_else(Vec::new, |scope| super::gpu_timings::spans(&scope));
        let shared = (self.open.iter().zip(&path))
            .take_while(|(a, b)| a == b)
            .count();
        while self.open.len() > shared {
            self.open.pop();
            self.recorder.end_time_span(encoder);
        }
        for name in path.into_iter().skip(shared) {
            self.recorder.begin_time_span(encoder, name.clone().into());
            self.open.push(name);
        }
    }
}

/// A baked scene, and the means to record its passes.
pub(crate) struct SceneContext<'a> {
    pub kernels: &'a KernelPipelines,
    pub queue: &'a wgpu::Queue,
    pub encoder: &'a mut wgpu::CommandEncoder,
    /// The scene as extracted from the main world.
    pub scene: &'a ExtractedScene,
    pub volumes: &'a ExtractedVolumes,
    /// Copy of an earlier frame. It is released if no pass uses it.
    pub read_back: Option<CoefficientReadback>,
    pub runtime: &'a mut SceneRuntime,
}

/// Records the passes of a scene that all views share.
///
/// # Errors
/// The error of the first pass that fails. The passes after it are not recorded.
pub(crate) fn record_scene(
    effects: &[Effect],
    plan: &Plan,
    ctx: &mut SceneContext<'_>,
    recorder: Recorder<'_>,
) -> Result<(), GpuError> {
    let mut spans = Spans::new(recorder);
    let mut result = Ok(());
    for pass in plan.of_scene(ctx.scene.id) {
        if let Some(Record::Scene(record)) = kind_of(effects, pass).map(|kind| &kind.record.how) {
            spans.enter(ctx.encoder, pass.timing);
            result = record(ctx, pass);
            if result.is_err() {
                break;
            }
        }
    }
    spans.enter(ctx.encoder, None);
    result
}

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
        let mut clip_from_view = self.view.clip_from_view;
        if let (Some(jitter), Some(size)) = (self.jitter, self.camera.physical_viewport_size) {
            jitter.jitter_projection(&mut clip_from_view, size.as_vec2());
        }
        clip_from_view
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

/// A source of irradiance in a view. All layers of a view are evaluated together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Layer {
    /// Surface irradiance of a baked scene.
    Scene(SceneId),
    /// Probe irradiance of a baked scene.
    Probes(SceneId),
    /// Virtual point lights.
    VirtualLights,
}

/// A view, and the means to record its passes.
pub(crate) struct ViewContext<'a> {
    pub kernels: &'a KernelPipelines,
    pub queue: &'a wgpu::Queue,
    pub encoder: &'a mut wgpu::CommandEncoder,
    pub input: &'a ViewInput<'a>,
    pub scenes: &'a mut BTreeMap<SceneId, SceneRuntime>,
    pub reflections: Option<&'a mut Reflections>,
    pub runtime: &'a mut ViewRuntime,
    /// Buffers of an earlier frame. They are released if no pass uses them.
    pub specular: Option<ViewSpecular>,
    pub shadow: Option<ViewShadow>,
    /// Counters of the buffers that belong to no scene.
    pub counters: &'a mut GpuCounters,
    /// The layers whose passes were recorded, in order.
    pub layers: Vec<Layer>,
    /// Exposed irradiance in rgb and coverage in a, after the layers were evaluated.
    pub irradiance: Option<wgpu::TextureView>,
}

impl ViewContext<'_> {
    /// The scene whose parameters the view's draws use.
    pub fn lead(&self) -> SceneId {
        let scene = self.layers.iter().find_map(|layer| match layer {
            Layer::Scene(id) => Some(*id),
            _ => None,
        });
        scene.unwrap_or(SceneId::WORLD)
    }
}

/// Records the passes of a view. Returns its irradiance. `None` if nothing lights the view.
pub(crate) fn record_view(
    render: &mut GiRender,
    input: &ViewInput<'_>,
    queue: &wgpu::Queue,
    ctx: &mut RenderContext,
) -> Option<wgpu::TextureView> {
    let (id, effects) = (input.camera.id, render.effects);
    let passes: Vec<&Pass> = render.plan.of_view(id).collect();
    let recorder = ctx.diagnostic_recorder();
    let mut spans = Spans::new(recorder.as_deref());
    let runtime = ViewRuntime::of_size(&mut render.views, id, input.surfaces.size);
    let mut ctx = ViewContext {
        kernels: render.kernels.as_ref()?,
        queue,
        encoder: ctx.command_encoder(),
        input,
        scenes: &mut render.scenes,
        reflections: render.reflections.as_mut(),
        specular: runtime.specular.take(),
        shadow: runtime.shadow.take(),
        runtime,
        counters: &mut render.retired,
        layers: Vec::new(),
        irradiance: None,
    };
    let mut rest = passes.as_slice();
    while let Some(first) = rest.first() {
        let how = kind_of(effects, first).map(|kind| &kind.record.how);
        // Passes of one scope that add layers, or of one stage, are recorded together.
        let together = rest.iter().take_while(|pass| match how {
            Some(Record::Layer(_)) => pass.timing == first.timing,
            _ => pass.stage == first.stage,
        });
        let (group, others) = rest.split_at(together.count());
        rest = others;
        match how {
            Some(Record::Layer(_)) => {
                spans.enter(ctx.encoder, first.timing);
                for pass in group {
                    if let Some(Record::Layer(add)) =
                        kind_of(effects, pass).map(|kind| &kind.record.how)
                    {
                        add(&mut ctx, pass);
                    }
                }
                display::evaluate_layers(&mut ctx);
            }
            Some(Record::View(record)) => {
                spans.enter(ctx.encoder, first.timing);
                record(&mut ctx, group);
            }
            _ => {}
        }
    }
    spans.enter(ctx.encoder, None);
    ctx.irradiance
}
