//! Recording of a plan: walks the passes in their order and calls the recording of each.
//!
//! Bevy records a frame schedule by schedule, and a pass belongs to one of these [`FramePoint`]s. A
//! system of each schedule passes its part of the world to the walk of its point. The walk selects
//! the passes of the plan by their kind, and decides nothing else. Before it, [`release_unused`]
//! releases the states without a pass, and [`prepare_light_maps`] reserves the buffers of maps.
//!
//! | point | walk | called by | runs |
//! |---|---|---|---|
//! | [`Scenes`](FramePoint::Scenes) | [`record_scene`] | [`compute`](super::compute) | before any camera draws |
//! | [`LightMaps`](FramePoint::LightMaps) | [`draw_light_map`], [`read_light_map`] | [`map_schedule`](super::effects::rsm::map_schedule) | in the camera of each map, before other cameras |
//! | [`MainPass`](FramePoint::MainPass) | [`record_view`] | [`composite`](super::composite) | before the view's transparent surfaces |
//! | | | [`forward_display`](super::forward_display) | before the opaque surfaces of a view without a G-buffer |
//! | [`PostProcess`](FramePoint::PostProcess) | [`record_post_process`] | [`post_process`](super::post_process) | behind Bevy's fog |

mod layers;
mod light_map;
mod post_process;
mod scene;
mod view;

pub(crate) use layers::{LayerInput, LayerRecording, SubsplatLayers};
pub(crate) use light_map::{
    LightMapRecording, MapDrawContext, MapOfLight, MapReadContext, MapsContext, draw_light_map,
    prepare_light_maps, read_light_map,
};
pub(crate) use post_process::{
    PostProcessContext, PostProcessResources, PostProcessView, PostProcessWorld,
    record_post_process,
};
pub(crate) use scene::{SceneContext, record_scene};
pub(crate) use view::{Picture, Surfaces, ViewContext, ViewInput, record_view};

use super::effects::{Effect, Record};
use super::render_state::GiRender;
use crate::plan::{Pass, Plan, TimingScope, ViewId, kind_of};
use bevy::log::warn_once;
use bevy::math::Mat4;
use bevy::render::camera::{ExtractedCamera, TemporalJitter};
use bevy::render::diagnostic::{DiagnosticsRecorder, RecordDiagnostics};
use bevy::render::view::ExtractedView;

/// Point of a frame at which passes are recorded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FramePoint {
    /// Before any camera draws.
    Scenes,
    /// Cameras of reflective shadow maps.
    LightMaps,
    /// Main pass of a view.
    MainPass,
    /// Post-processing of a view.
    PostProcess,
}

impl FramePoint {
    /// Name of the span around the passes that are recorded at this point.
    pub fn span(self) -> &'static str {
        match self {
            Self::Scenes => "meshless_gi_compute",
            Self::LightMaps => "meshless_gi_rsm",
            Self::MainPass => "meshless_gi_composite",
            Self::PostProcess => "meshless_gi_fog",
        }
    }
}

impl Record {
    /// Point of the frame at which such passes are recorded.
    pub fn point(&self) -> FramePoint {
        match self {
            Self::Scene(_) => FramePoint::Scenes,
            Self::LightMap(_) => FramePoint::LightMaps,
            Self::Layer(_) | Self::View(_) => FramePoint::MainPass,
            Self::PostProcess(_) => FramePoint::PostProcess,
        }
    }
}

/// Returns the passes of a view that are recorded at a point of the frame, in order.
fn passes_of_view<'a>(
    effects: &'static [Effect],
    plan: &'a Plan,
    view: ViewId,
    point: FramePoint,
) -> impl Iterator<Item = (&'a Pass, &'static Record)> {
    let recorded = |pass| Some((pass, &kind_of(effects, pass)?.record.how));
    let passes = plan.of_view(view).filter_map(recorded);
    passes.filter(move |(_, how)| how.point() == point)
}

/// Reports a pass that was planned but lacked an input. `recorded` is `None` for such a pass.
pub(crate) fn report_missing(recorded: Option<()>, pass: &Pass) {
    if recorded.is_none() {
        warn_once!("a planned pass was not recorded, an input is missing: {pass}");
    }
}

/// Releases the states that no pass of the plan uses: of views, and of effects.
pub(crate) fn release_unused(render: &mut GiRender) {
    let (effects, plan) = (render.effects, &render.plan);
    let records = |view: &ViewId, point| {
        let mut passes = passes_of_view(effects, plan, *view, point);
        passes.next().is_some()
    };
    (render.views).retain(|view, _| records(view, FramePoint::MainPass));
    (render.post_process).retain(|view, _| records(view, FramePoint::PostProcess));
    let released = render.states.take_unused(plan);
    render.retired.add(&released.counters());
}

/// Transform from a view to clip space, with the jitter of its depth.
fn clip_from_view(
    view: &ExtractedView,
    camera: &ExtractedCamera,
    jitter: Option<&TemporalJitter>,
) -> Mat4 {
    let mut clip_from_view = view.clip_from_view;
    if let (Some(jitter), Some(size)) = (jitter, camera.physical_viewport_size) {
        jitter.jitter_projection(&mut clip_from_view, size.as_vec2());
    }
    clip_from_view
}

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
