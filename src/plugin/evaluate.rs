//! The irradiance of a view's surfaces: scenes, what their probes light, and virtual lights, by
//! subsplats or at every pixel.
//!
//! [`super::composite`] adds it to the picture of a deferred camera; [`super::forward_display`] hands it to the surfaces of a forward one.

use super::camera::GiDebugView;
use super::composite::ViewRuntime;
use super::compute::GiRender;
use super::extract::{ExtractedGi, ExtractedGiView};
use super::gpu_timings::view_span;
use super::rsm_render::{bakes, lights_view};
use super::splatting::{GiSplatting, SubsplatView, ViewLights, ViewSubsplats};
use super::vpl_specular::{SpecularView, ViewSpecular};
use crate::gpu::{GpuFrame, SceneBuffers, SplatTargets, SubsplatTargets, ViewBuffers};
use crate::plan::{FrameStage, SceneId, ViewId};
use bevy::log::warn_once;
use bevy::math::Mat4;
use bevy::render::camera::{ExtractedCamera, TemporalJitter};
use bevy::render::diagnostic::RecordDiagnostics;
use bevy::render::renderer::{RenderContext, RenderDevice, RenderQueue};
use bevy::render::view::ExtractedView;
use meshless_gi::internals::frame::{CompositeParams, SplatParams, SubsplatParams};

/// A view's surfaces, as textures of the size of its target.
pub(super) struct Surfaces<'a> {
    pub view: &'a ExtractedView,
    pub camera: &'a ExtractedCamera,
    pub jitter: Option<&'a TemporalJitter>,
    /// Reversed, one sample a pixel.
    pub depth: &'a wgpu::TextureView,
    /// Bevy's deferred G-buffer, or one with the same normals.
    pub gbuffer: &'a wgpu::TextureView,
    pub size: [u32; 2],
}

impl Surfaces<'_> {
    /// The viewport in texels: x, y, width, height.
    pub fn viewport(&self) -> [f32; 4] {
        self.view.viewport.as_vec4().to_array()
    }

    /// From the view to clip space; jittered where the depth was.
    pub fn clip_from_view(&self) -> Mat4 {
        let mut clip_from_view = self.view.clip_from_view;
        if let (Some(jitter), Some(size)) = (self.jitter, self.camera.physical_viewport_size) {
            jitter.jitter_projection(&mut clip_from_view, size.as_vec2());
        }
        clip_from_view
    }

    fn world_from_view(&self) -> Mat4 {
        self.view.world_from_view.to_matrix()
    }

    /// From the world to the view, and from the view to clip space.
    fn matrices(&self) -> [Mat4; 2] {
        [self.world_from_view(), self.clip_from_view()]
    }
}

/// What a view shows.
pub(super) struct Evaluated {
    /// Exposed irradiance in rgb, and how much of it is known in a; none where nothing lights the
    /// view.
    pub irradiance: Option<wgpu::TextureView>,
    /// The scenes that were evaluated.
    pub scenes: Vec<SceneId>,
    /// Whose parameters the view's draws use.
    pub lead: SceneId,
}

/// Scenes of the plan whose splats a view shows.
fn planned(render: &GiRender, id: ViewId) -> Vec<SceneId> {
    let splats =
        (render.plan.passes.iter()).filter(|p| p.stage == FrameStage::SPLAT && p.view == Some(id));
    splats.map(|p| p.scene).collect()
}

/// Whether the plan has anything for a view.
pub(super) fn is_planned(render: &GiRender, id: ViewId) -> bool {
    render.kernels.is_some() && (lights_view(&render.plan, id) || !planned(render, id).is_empty())
}

/// Evaluates the irradiance of the surfaces; none where the plan has nothing for the view.
pub(super) fn evaluate(
    render: &mut GiRender,
    shown_by: &ExtractedGiView,
    surfaces: &Surfaces<'_>,
    world: &ExtractedGi,
    device: &RenderDevice,
    queue: &RenderQueue,
    ctx: &mut RenderContext,
) -> Option<Evaluated> {
    let (id, settings) = (shown_by.id, &shown_by.settings);
    let Surfaces {
        camera,
        depth,
        gbuffer,
        size,
        ..
    } = *surfaces;
    let scenes = planned(render, id);
    let bounced = lights_view(&render.plan, id);
    let kernels = render.kernels.as_ref()?;
    if !bounced && scenes.is_empty() {
        return None;
    }
    let runtime = render
        .views
        .entry(id)
        .or_insert_with(|| ViewRuntime::new(size));
    if runtime.size != size {
        *runtime = ViewRuntime::new(size);
    }
    let viewport = surfaces.viewport();
    let [world_from_view, clip_from_view] = surfaces.matrices();
    let recorder = ctx.diagnostic_recorder();
    let recorder = recorder.as_deref();
    let composite = CompositeParams {
        scale: settings.intensity.max(0.0),
        white: f32::from(u8::from(settings.debug_view == GiDebugView::Irradiance)),
        ..CompositeParams::default()
    };

    let on_view = render
        .reflections
        .as_ref()
        .filter(|_| bounced)
        .map(|reflections| {
            let bake = bakes(world, &render.scenes)
                .find(|(id, ..)| scenes.contains(id))
                .map(|(_, local, buffers)| (local, buffers));
            let matrices = [&world_from_view, &clip_from_view];
            (
                reflections,
                reflections.on_view(matrices, viewport, size, camera.exposure, bake),
            )
        });
    // Parameters of each scene that shows.
    let mut shown: Vec<SceneId> = Vec::new();
    for &scene in &scenes {
        let placement = world
            .scenes
            .iter()
            .find(|s| s.id == scene)
            .and_then(|s| s.placement);
        let (Some(placement), Some(frame)) = (
            placement,
            render.scenes.get(&scene).and_then(|s| s.frame.as_ref()),
        ) else {
            continue;
        };
        let world_from_clip = world_from_view * clip_from_view.inverse();
        let params = SplatParams {
            local_from_clip: placement
                .local_from_clip(clip_from_view, world_from_view)
                .to_cols_array_2d(),
            ..frame.splat_params(
                world_from_clip,
                placement.matrix(),
                viewport,
                size,
                camera.exposure,
            )
        };
        let buffers = runtime
            .buffers
            .entry(scene)
            .or_insert_with(|| ViewBuffers::new(device.wgpu_device()));
        buffers.write(queue, &params, &composite);
        let probes = frame.probe_params(&params);
        buffers.write_probes(device.wgpu_device(), queue, probes.as_ref());
        shown.push(scene);
    }
    if shown.is_empty() && on_view.is_some() {
        let params = SplatParams {
            size,
            ..bytemuck::Zeroable::zeroed()
        };
        (runtime.buffers.entry(SceneId::WORLD))
            .or_insert_with(|| ViewBuffers::new(device.wgpu_device()))
            .write(queue, &params, &composite);
    }
    let glossy = shown_by.gloss.filter(|_| {
        (render.plan.passes.iter())
            .any(|p| p.stage == FrameStage::VPL_SPECULAR && p.view == Some(id))
    });
    // Irradiance is what a white, rough surface would get.
    let glossy = glossy.filter(|_| settings.debug_view != GiDebugView::Irradiance);
    match (glossy, on_view.as_ref()) {
        (Some(gloss), Some((reflections, (view, shadows)))) if !runtime.too_large => {
            let timed = recorder.time_span(
                ctx.command_encoder(),
                view_span(FrameStage::VPL_SPECULAR, id),
            );
            let recorded = ViewSpecular::record(
                &mut runtime.gloss,
                kernels,
                queue,
                ctx.command_encoder(),
                &SpecularView {
                    settings: gloss.0,
                    view_from_clip: clip_from_view.inverse(),
                    view_from_world: world_from_view.inverse(),
                    viewport,
                    size,
                    depth,
                    gbuffer,
                },
                &ViewLights {
                    maps: reflections.maps(),
                    view: *view,
                    lit: reflections.maps().params(shadows.as_ref()),
                    shadows: *shadows,
                },
            );
            timed.end(ctx.command_encoder());
            match recorded {
                Ok(recorded) => render.retired.add(&recorded),
                Err(why) => warn_once!("a view shows no gloss: {why}"),
            }
        }
        _ => runtime.gloss = None,
    }
    let first = runtime.irradiance(0, device.wgpu_device());
    let subsplats = match &shown_by.display {
        GiSplatting::Multiresolution(settings) if !runtime.too_large => {
            let params = SubsplatParams::new(
                settings,
                clip_from_view.inverse(),
                world_from_view.inverse(),
                viewport,
                size,
            );
            let before = runtime.subsplats.take();
            match ViewSubsplats::fit(before, device.wgpu_device(), queue, params.levels()) {
                Ok(fits) => Some((runtime.subsplats.insert(fits), params)),
                Err(why) => {
                    warn_once!("a view is shown at full resolution: {why}");
                    runtime.too_large = true;
                    None
                }
            }
        }
        _ => {
            runtime.subsplats = None;
            None
        }
    };
    let timed = recorder.time_span(ctx.command_encoder(), view_span(FrameStage::SPLAT, id));
    let irradiance = match subsplats {
        Some((subsplats, params)) => {
            let on: Vec<(&SceneBuffers, &ViewBuffers)> = shown
                .iter()
                .filter_map(|id| {
                    let frame = render.scenes.get(id)?.frame.as_ref()?;
                    Some((frame.buffers(), runtime.buffers.get(id)?))
                })
                .collect();
            let lights = on_view
                .as_ref()
                .map(|(reflections, (view, shadows))| ViewLights {
                    maps: reflections.maps(),
                    view: *view,
                    lit: reflections.maps().params(shadows.as_ref()),
                    shadows: *shadows,
                });
            let recorded = subsplats.record(
                kernels,
                queue,
                ctx.command_encoder(),
                &SubsplatView {
                    params: &params,
                    targets: &SubsplatTargets {
                        depth,
                        gbuffer,
                        output: &first,
                    },
                    scenes: &on,
                    lights: lights.as_ref(),
                },
            );
            render.retired.add(&recorded);
            runtime.irradiance[1] = None;
            Some(first)
        }
        None => {
            // Scenes, what their probes light, and virtual lights take turns: each reads what was
            // before it.
            let probing: Vec<SceneId> = (shown.iter().copied())
                .filter(|id| {
                    let frame = render.scenes.get(id).and_then(|s| s.frame.as_ref());
                    frame.is_some_and(GpuFrame::has_probes)
                })
                .collect();
            let passes = shown.len() + probing.len() + usize::from(on_view.is_some());
            let second = (passes > 1).then(|| runtime.irradiance(1, device.wgpu_device()));
            if second.is_none() {
                runtime.irradiance[1] = None;
            }
            let textures = [Some(&first), second.as_ref()];
            let targets = |turn: usize| {
                Some(SplatTargets {
                    depth,
                    gbuffer,
                    earlier: if turn == 0 {
                        None
                    } else {
                        textures[1 - turn % 2]
                    },
                    output: textures[turn % 2]?,
                })
            };
            for (turn, id) in shown.iter().enumerate() {
                if let (Some(targets), Some(buffers)) = (targets(turn), runtime.buffers.get(id))
                    && let Some(frame) = render.scenes.get_mut(id).and_then(|s| s.frame.as_mut())
                {
                    frame.splat(kernels, ctx.command_encoder(), buffers, &targets);
                }
            }
            for (turn, id) in (shown.len()..).zip(&probing) {
                if let (Some(targets), Some(buffers)) = (targets(turn), runtime.buffers.get(id))
                    && let Some(frame) = render.scenes.get_mut(id).and_then(|s| s.frame.as_mut())
                {
                    frame.probe(kernels, ctx.command_encoder(), buffers, &targets);
                }
            }
            if bounced
                && let Some(reflections) = &mut render.reflections
                && let Some(targets) = targets(shown.len() + probing.len())
            {
                let bake = bakes(world, &render.scenes)
                    .find(|(id, ..)| scenes.contains(id))
                    .map(|(_, local, buffers)| (local, buffers));
                let matrices = [&world_from_view, &clip_from_view];
                let lights = reflections.on_view(matrices, viewport, size, camera.exposure, bake);
                reflections.light_view(kernels, queue, ctx.command_encoder(), &lights, &targets);
            }
            match passes {
                0 => None,
                _ => textures[(passes - 1) % 2].cloned(),
            }
        }
    };
    timed.end(ctx.command_encoder());
    let lead = shown.first().copied().unwrap_or(SceneId::WORLD);
    (runtime.buffers).retain(|id, _| shown.contains(id) || *id == lead);
    Some(Evaluated {
        irradiance,
        scenes: shown,
        lead,
    })
}
