//! Layers of a view: sources of irradiance that are evaluated together, at the subsplats of the
//! view or at every pixel.

use super::view::{ViewContext, ViewInput};
use crate::gpu::{SceneBuffers, SplatTargets, SubsplatTargets, ViewBuffers};
use crate::plan::{DisplayUse, FrameStage, Pass, SceneId};
use crate::plugin::effect_states::EffectStates;
use crate::plugin::effects::display::splatting::{
    GiSplatting, SubsplatView, ViewLights, ViewSubsplats,
};
use crate::plugin::render_state::SceneRuntime;
use meshless_gi::internals::frame::SubsplatParams;
use std::collections::BTreeMap;

/// Recording of a layer.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LayerRecording {
    /// Writes the parameters of a layer. Returns `None` if the pass lacks an input, which the walk
    /// reports.
    pub prepare: fn(&mut ViewContext<'_>, &Pass) -> Option<()>,
    /// Adds the irradiance of every pixel to that of earlier layers. Returns `None` if the pass
    /// lacks an input.
    pub splat: fn(&mut ViewContext<'_>, &Pass, &SplatTargets<'_>) -> Option<()>,
    /// Adds the layer to those that subsplats evaluate. Returns `None` if the pass lacks an input.
    pub add_to_subsplats: for<'a> fn(&LayerInput<'a>, &Pass, &mut SubsplatLayers<'a>) -> Option<()>,
}

/// Layer of a view, as planned and as recorded.
pub(super) type PlannedLayer<'a> = (&'a Pass, &'static LayerRecording);

/// Input of the layers of a view.
pub(crate) struct LayerInput<'a> {
    pub view: &'a ViewInput<'a>,
    pub scenes: &'a BTreeMap<SceneId, SceneRuntime>,
    /// Parameters of the scenes that the view shows.
    pub buffers: &'a BTreeMap<SceneId, ViewBuffers>,
    /// States of the effects that belong to no scene and no view.
    pub world_states: &'a EffectStates,
    /// Scenes that the view shows.
    pub shown: &'a [SceneId],
}

/// Layers that the subsplats of a view evaluate.
#[derive(Default)]
pub(crate) struct SubsplatLayers<'a> {
    pub scenes: Vec<(&'a SceneBuffers, &'a ViewBuffers)>,
    pub lights: Option<ViewLights<'a>>,
}

/// Evaluates the layers of a view: its irradiance.
pub(super) fn evaluate_layers(ctx: &mut ViewContext<'_>, layers: &[PlannedLayer<'_>]) {
    let (shown, primary) = (&ctx.shown, ctx.primary_scene());
    (ctx.runtime.buffers).retain(|id, _| shown.contains(id) || *id == primary);
    let display = layers.first().and_then(|(pass, _)| pass.display);
    let subsplats = match display {
        Some(DisplayUse::Subsplats) => subsplats(ctx),
        _ => None,
    };
    ctx.irradiance = match subsplats {
        Some((subsplats, params)) => Some(evaluate_subsplats(ctx, layers, subsplats, &params)),
        None => splat_layers(ctx, layers),
    };
}

/// Evaluates the layers at every pixel, in two textures by turns. Each adds to the output of the
/// one before. Returns the last output.
fn splat_layers(
    ctx: &mut ViewContext<'_>,
    layers: &[PlannedLayer<'_>],
) -> Option<wgpu::TextureView> {
    let (mut written, mut last) = (0, None);
    for (pass, layer) in layers {
        let output = (ctx.runtime).irradiance(written % 2, ctx.kernels.device());
        let targets = SplatTargets {
            depth: ctx.input.surfaces.depth,
            gbuffer: ctx.input.surfaces.gbuffer,
            earlier: last.as_ref(),
            output: &output,
        };
        let recorded = (layer.splat)(ctx, pass, &targets);
        super::report_missing(recorded, pass);
        if recorded.is_some() {
            written += 1;
            last = Some(output);
        }
    }
    if written < 2 {
        ctx.runtime.irradiance[1] = None;
    }
    last
}

/// Evaluates the layers by subsplats. Returns the output.
fn evaluate_subsplats(
    ctx: &mut ViewContext<'_>,
    layers: &[PlannedLayer<'_>],
    mut subsplats: ViewSubsplats,
    params: &SubsplatParams,
) -> wgpu::TextureView {
    let output = ctx.runtime.irradiance(0, ctx.kernels.device());
    let input = LayerInput {
        view: ctx.input,
        scenes: ctx.scenes,
        buffers: &ctx.runtime.buffers,
        world_states: ctx.world_states,
        shown: &ctx.shown,
    };
    let mut all = SubsplatLayers::default();
    for (pass, layer) in layers {
        super::report_missing((layer.add_to_subsplats)(&input, pass, &mut all), pass);
    }
    let targets = SubsplatTargets {
        depth: ctx.input.surfaces.depth,
        gbuffer: ctx.input.surfaces.gbuffer,
        output: &output,
    };
    let view = SubsplatView {
        params,
        targets: &targets,
        scenes: &all.scenes,
        lights: all.lights.as_ref(),
    };
    let recorded = subsplats.record(ctx.kernels, ctx.queue, ctx.encoder, &view);
    ctx.counters.add(&recorded);
    ctx.runtime.states.insert(subsplats);
    ctx.runtime.irradiance[1] = None;
    output
}

/// Returns the view's subsplats and their parameters. `None` if its settings request every pixel,
/// or if the device cannot hold the subsplats.
fn subsplats(ctx: &mut ViewContext<'_>) -> Option<(ViewSubsplats, SubsplatParams)> {
    let before = ctx.earlier.take::<ViewSubsplats>();
    let surfaces = ctx.input.surfaces;
    let GiSplatting::Multiresolution(settings) = &ctx.input.camera.display else {
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
            let effect = "evaluates indirect light at every pixel";
            ctx.runtime.refuse(FrameStage::SPLAT, effect, &error);
            None
        }
    }
}
