//! What each camera does: splats the scenes that it sees over its pixels, and adds the irradiance to its picture.

use super::capture::{bakes, lights_view};
use super::components::MeshlessGiView;
use super::compute::GiRender;
use super::costs::view_span;
use super::display::{MeshlessGiDisplay, ViewLights, ViewSubsplats};
use super::extract::ExtractedGi;
use super::gloss::{GlossView, ViewGloss};
use super::soft::{ExtractedSoft, Shaded, ViewShade};
use crate::frame::{CompositeParams, SplatParams, SubsplatParams};
use crate::gpu::{
    GpuFrame, SceneBuffers, SplatTargets, SubsplatTargets, ViewBuffers, draw_composite, draw_gloss,
    draw_shade,
};
use crate::plan::{Pass, SceneId, Stage, ViewId};
use bevy::core_pipeline::prepass::ViewPrepassTextures;
use bevy::ecs::prelude::*;
use bevy::log::warn_once;
use bevy::math::Mat4;
use bevy::render::camera::{ExtractedCamera, TemporalJitter};
use bevy::render::diagnostic::RecordDiagnostics;
use bevy::render::render_resource::RenderPassDescriptor;
use bevy::render::renderer::{RenderContext, RenderDevice, RenderQueue, ViewQuery};
use bevy::render::view::{ExtractedView, ViewTarget};
use std::collections::BTreeMap;

/// What a view holds on the device: the irradiance of its pixels (twice, where it sees several scenes), and parameters.
pub(crate) struct ViewRuntime {
    size: [u32; 2],
    irradiance: [Option<wgpu::TextureView>; 2],
    buffers: BTreeMap<SceneId, ViewBuffers>,
    subsplats: Option<ViewSubsplats>,
    gloss: Option<ViewGloss>,
    shade: Option<ViewShade>,
    /// The device has no room for subsplats of this size.
    pub(super) too_large: bool,
}

impl ViewRuntime {
    fn new(size: [u32; 2]) -> Self {
        Self {
            size,
            irradiance: [None, None],
            buffers: BTreeMap::new(),
            subsplats: None,
            gloss: None,
            shade: None,
            too_large: false,
        }
    }

    /// Parameter buffers of each scene, and those of subsplats.
    pub fn buffer_count(&self) -> u32 {
        let gloss = self.gloss.as_ref().map_or(0, |g| g.footprint().0);
        let own: u32 = self.buffers.values().map(ViewBuffers::count).sum();
        let shade = self.shade.as_ref().map_or(0, |s| s.size().0);
        let subsplats = self.subsplats.as_ref().map_or(0, |s| s.size().0);
        own + subsplats + gloss + shade
    }

    /// What subsplats the view has, if it is shown by them.
    pub fn subsplats(&mut self) -> Option<&mut ViewSubsplats> {
        self.subsplats.as_mut()
    }

    /// Bytes of parameters and textures.
    pub fn bytes(&self) -> u64 {
        let textures = self.irradiance.iter().flatten().count() as u64
            * u64::from(self.size[0])
            * u64::from(self.size[1])
            * 8;
        let parameters: u64 = self.buffers.values().map(ViewBuffers::bytes).sum();
        let subsplats = self.subsplats.as_ref().map_or(0, |s| s.size().1);
        let gloss = self.gloss.as_ref().map_or(0, |g| g.footprint().1);
        let shade = self.shade.as_ref().map_or(0, |s| s.size().1);
        textures + parameters + subsplats + gloss + shade
    }

    fn irradiance(&mut self, which: usize, device: &wgpu::Device) -> wgpu::TextureView {
        let size = self.size;
        self.irradiance[which]
            .get_or_insert_with(|| screen_texture(device, "meshless_gi irradiance", size))
            .clone()
    }
}

/// A colour in halves for every pixel of a view, written by a kernel.
pub(crate) fn screen_texture(
    device: &wgpu::Device,
    label: &'static str,
    [width, height]: [u32; 2],
) -> wgpu::TextureView {
    device
        .create_texture(&wgpu::TextureDescriptor {
            label: Some(label),
            size: wgpu::Extent3d {
                width,
                height,
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba16Float,
            usage: wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        })
        .create_view(&wgpu::TextureViewDescriptor::default())
}

type View = (
    &'static ExtractedView,
    &'static ExtractedCamera,
    &'static ViewTarget,
    &'static ViewPrepassTextures,
    Option<&'static TemporalJitter>,
);

/// Runs in [`MeshlessGiSystems::Composite`](super::MeshlessGiSystems::Composite).
pub(crate) fn composite(
    view: ViewQuery<View>,
    world: Res<ExtractedGi>,
    soft: Res<ExtractedSoft>,
    mut render: ResMut<GiRender>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
    mut ctx: RenderContext,
) {
    let (view, camera, target, prepass, jitter) = view.into_inner();
    let id = ViewId(view.retained_view_entity.main_entity.to_bits());
    let render = &mut *render;
    let scenes: Vec<SceneId> = render
        .plan
        .passes
        .iter()
        .filter(|p| p.stage == Stage::Splat && p.view == Some(id))
        .map(|p| p.scene)
        .collect();
    let shown_by = world.views.iter().find(|v| v.id == id);
    let Some((settings, display, layers)) = shown_by.map(|v| (&v.settings, &v.display, &v.layers))
    else {
        return;
    };
    let bounced = lights_view(&render.plan, id);
    let (Some(kernels), true) = (&render.kernels, bounced || !scenes.is_empty()) else {
        return;
    };
    let (Some(depth), Some(gbuffer), Some(passes)) = (
        prepass.depth_view(),
        prepass.deferred_view(),
        prepass.deferred_lighting_pass_id.as_ref(),
    ) else {
        warn_once!(
            "a camera asks for indirect light but drew no G-buffer: it has no deferred materials in view, or not all prepasses"
        );
        return;
    };
    let size = [prepass.size.width, prepass.size.height];
    let runtime = render
        .views
        .entry(id)
        .or_insert_with(|| ViewRuntime::new(size));
    if runtime.size != size {
        *runtime = ViewRuntime::new(size);
    }

    // From clip space to the world; jittered where the depth was.
    let mut clip_from_view = view.clip_from_view;
    if let (Some(jitter), Some(size)) = (jitter, camera.physical_viewport_size) {
        jitter.jitter_projection(&mut clip_from_view, size.as_vec2());
    }
    let world_from_view: Mat4 = view.world_from_view.to_matrix();
    let viewport = view.viewport.as_vec4().to_array();

    let composite = CompositeParams {
        scale: settings.intensity.max(0.0),
        white: f32::from(u8::from(settings.view == MeshlessGiView::Irradiance)),
        ..CompositeParams::default()
    };

    let recorder = ctx.diagnostic_recorder();
    let recorder = recorder.as_deref();
    let span = recorder.time_span(ctx.command_encoder(), "meshless_gi_composite");
    let on_view = render
        .reflections
        .as_ref()
        .filter(|_| bounced)
        .map(|reflections| {
            let bake = bakes(&world, &render.scenes)
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
        buffers.write(&queue, &params, &composite);
        let probes = frame.probe_params(&params);
        buffers.write_probes(device.wgpu_device(), &queue, probes.as_ref());
        shown.push(scene);
    }
    if shown.is_empty() && on_view.is_some() {
        let params = SplatParams {
            size,
            ..bytemuck::Zeroable::zeroed()
        };
        (runtime.buffers.entry(SceneId::WORLD))
            .or_insert_with(|| ViewBuffers::new(device.wgpu_device()))
            .write(&queue, &params, &composite);
    }
    let glossy = shown_by.and_then(|v| v.gloss).filter(|_| {
        (render.plan.passes.iter()).any(|p| p.stage == Stage::Gloss && p.view == Some(id))
    });
    // Irradiance is what a white, rough surface would get.
    let glossy = glossy.filter(|_| settings.view != MeshlessGiView::Irradiance);
    match (glossy, on_view.as_ref()) {
        (Some(gloss), Some((reflections, (view, shadows)))) if !runtime.too_large => {
            let timed = recorder.time_span(ctx.command_encoder(), view_span(Stage::Gloss, id));
            let recorded = ViewGloss::record(
                &mut runtime.gloss,
                kernels,
                &queue,
                ctx.command_encoder(),
                &GlossView {
                    settings: gloss.into(),
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
    let subsplats = match display {
        MeshlessGiDisplay::Subsplats(settings) if !runtime.too_large => {
            let params = SubsplatParams::new(
                &(*settings).into(),
                clip_from_view.inverse(),
                world_from_view.inverse(),
                viewport,
                size,
            );
            let before = runtime.subsplats.take();
            match ViewSubsplats::fit(before, device.wgpu_device(), &queue, params.levels()) {
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
    let timed = recorder.time_span(ctx.command_encoder(), view_span(Stage::Splat, id));
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
                &queue,
                ctx.command_encoder(),
                &params,
                &SubsplatTargets {
                    depth,
                    gbuffer,
                    output: &first,
                },
                &on,
                lights.as_ref(),
            );
            render.retired.add(&recorded);
            runtime.irradiance[1] = None;
            Some(first)
        }
        None => {
            // Scenes, what their probes light, and virtual lights take turns: each reads what was before it.
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
                let bake = bakes(&world, &render.scenes)
                    .find(|(id, ..)| scenes.contains(id))
                    .map(|(_, local, buffers)| (local, buffers));
                let matrices = [&world_from_view, &clip_from_view];
                let lights = reflections.on_view(matrices, viewport, size, camera.exposure, bake);
                reflections.light_view(kernels, &queue, ctx.command_encoder(), &lights, &targets);
            }
            match passes {
                0 => None,
                _ => textures[(passes - 1) % 2].cloned(),
            }
        }
    };
    timed.end(ctx.command_encoder());
    let shaded: Vec<Shaded> = (shown.iter())
        .filter(|scene| {
            let takes =
                |p: &Pass| p.stage == Stage::Shade && p.view == Some(id) && p.scene == **scene;
            render.plan.passes.iter().any(takes)
        })
        .filter_map(|scene| {
            let instance = render.scenes.get(scene)?;
            Some(Shaded {
                id: *scene,
                soft: &instance.soft,
                scene: instance.frame.as_ref()?.buffers(),
                view: runtime.buffers.get(scene)?,
            })
        })
        .collect();
    let timed = recorder.time_span(ctx.command_encoder(), view_span(Stage::Shade, id));
    let recorded = ViewShade::record(
        &mut runtime.shade,
        kernels,
        &queue,
        ctx.command_encoder(),
        (depth, gbuffer),
        size,
        layers,
        &soft,
        &shaded,
    );
    timed.end(ctx.command_encoder());
    match recorded {
        Ok(recorded) => render.retired.add(&recorded),
        Err(why) => {
            warn_once!("a view shows no soft shadows: {why}");
            runtime.shade = None;
        }
    }
    let lead = shown.first().copied().unwrap_or(SceneId::WORLD);
    (runtime.buffers).retain(|id, _| shown.contains(id) || *id == lead);
    if let Some(irradiance) = irradiance
        && let Some(buffers) = runtime.buffers.get(&lead)
    {
        let timed = recorder.time_span(ctx.command_encoder(), view_span(Stage::Composite, id));
        let mut pass = ctx
            .command_encoder()
            .begin_render_pass(&RenderPassDescriptor {
                label: Some("meshless_gi composite"),
                color_attachments: &[Some(target.get_color_attachment())],
                depth_stencil_attachment: None,
                timestamp_writes: None,
                occlusion_query_set: None,
                multiview_mask: None,
            });
        let [x, y, width, height] = view.viewport.to_array();
        pass.set_viewport(x as f32, y as f32, width as f32, height as f32, 0.0, 1.0);
        pass.set_scissor_rect(x, y, width, height);
        let replace = settings.view != MeshlessGiView::Lit;
        let textures = [&irradiance, &**gbuffer, &*passes.texture.default_view];
        draw_composite(
            kernels,
            &mut pass,
            view.target_format,
            replace,
            buffers,
            textures,
        );
        if let Some(gloss) = &runtime.gloss {
            let textures = [gloss.radiance(), &**gbuffer, &*passes.texture.default_view];
            draw_gloss(kernels, &mut pass, view.target_format, buffers, textures);
        }
        if let Some(missing) = runtime.shade.as_ref().and_then(ViewShade::radiance) {
            let textures = [missing, &**gbuffer, &*passes.texture.default_view];
            draw_shade(kernels, &mut pass, view.target_format, buffers, textures);
        }
        drop(pass);
        timed.end(ctx.command_encoder());
        render.retired.composites += 1;
    }
    span.end(ctx.command_encoder());
}
