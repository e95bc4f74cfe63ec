//! What each camera does: splats the scenes that it sees over its pixels, and adds the irradiance
//! to its picture.

use super::camera::GiDebugView;
use super::compute::GiRender;
use super::evaluate::{Evaluated, Surfaces, evaluate, is_planned};
use super::extract::ExtractedGi;
use super::gpu_timings::view_span;
use super::soft_shadow::{ExtractedSoft, Shaded, ViewShade};
use super::splatting::ViewSubsplats;
use super::vpl_specular::ViewSpecular;
use crate::gpu::{ViewBuffers, draw_composite, draw_shadow, draw_specular};
use crate::plan::{FrameStage, Pass, SceneId, ViewId};
use bevy::core_pipeline::prepass::ViewPrepassTextures;
use bevy::ecs::prelude::*;
use bevy::log::warn_once;
use bevy::render::camera::{ExtractedCamera, TemporalJitter};
use bevy::render::diagnostic::RecordDiagnostics;
use bevy::render::render_resource::RenderPassDescriptor;
use bevy::render::renderer::{RenderContext, RenderDevice, RenderQueue, ViewQuery};
use bevy::render::view::{ExtractedView, ViewTarget};
use std::collections::BTreeMap;

/// What a view holds on the device: the irradiance of its pixels (twice, where it sees several
/// scenes), and parameters.
pub(crate) struct ViewRuntime {
    pub(super) size: [u32; 2],
    pub(super) irradiance: [Option<wgpu::TextureView>; 2],
    pub(super) buffers: BTreeMap<SceneId, ViewBuffers>,
    pub(super) subsplats: Option<ViewSubsplats>,
    pub(super) gloss: Option<ViewSpecular>,
    shade: Option<ViewShade>,
    /// The device has no room for subsplats of this size.
    pub(super) too_large: bool,
}

impl ViewRuntime {
    pub(super) fn new(size: [u32; 2]) -> Self {
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

    pub(super) fn irradiance(&mut self, which: usize, device: &wgpu::Device) -> wgpu::TextureView {
        let size = self.size;
        self.irradiance[which]
            .get_or_insert_with(|| screen_texture(device, "meshless_gi irradiance", size))
            .clone()
    }
}

/// A color in halves for every pixel of a view, written by a kernel.
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

/// Runs in [`GiRenderSystems::Composite`](super::GiRenderSystems::Composite).
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
    let Some(shown_by) = world.views.iter().find(|v| v.id == id && !v.forward) else {
        return;
    };
    if !is_planned(render, id) {
        return;
    }
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
    let surfaces = Surfaces {
        view,
        camera,
        jitter,
        depth,
        gbuffer,
        size: [prepass.size.width, prepass.size.height],
    };
    let recorder = ctx.diagnostic_recorder();
    let recorder = recorder.as_deref();
    let span = recorder.time_span(ctx.command_encoder(), "meshless_gi_composite");
    let evaluated = evaluate(
        render, shown_by, &surfaces, &world, &device, &queue, &mut ctx,
    );
    let (Some(evaluated), Some(kernels), Some(runtime)) =
        (evaluated, &render.kernels, render.views.get_mut(&id))
    else {
        span.end(ctx.command_encoder());
        return;
    };
    let Evaluated {
        irradiance,
        scenes: shown,
        lead,
    } = evaluated;
    let settings = &shown_by.settings;
    let shaded: Vec<Shaded> = (shown.iter())
        .filter(|scene| {
            let takes = |p: &Pass| {
                p.stage == FrameStage::SUBTRACT_SHADOW && p.view == Some(id) && p.scene == **scene
            };
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
    let timed = recorder.time_span(
        ctx.command_encoder(),
        view_span(FrameStage::SUBTRACT_SHADOW, id),
    );
    let recorded = ViewShade::record(
        &mut runtime.shade,
        kernels,
        &queue,
        ctx.command_encoder(),
        (depth, gbuffer),
        surfaces.size,
        &shown_by.layers,
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
    if let Some(irradiance) = irradiance
        && let Some(buffers) = runtime.buffers.get(&lead)
    {
        let timed = recorder.time_span(ctx.command_encoder(), view_span(FrameStage::COMPOSITE, id));
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
        let replace = settings.debug_view != GiDebugView::Final;
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
            draw_specular(kernels, &mut pass, view.target_format, buffers, textures);
        }
        if let Some(missing) = runtime.shade.as_ref().and_then(ViewShade::radiance) {
            let textures = [missing, &**gbuffer, &*passes.texture.default_view];
            draw_shadow(kernels, &mut pass, view.target_format, buffers, textures);
        }
        drop(pass);
        timed.end(ctx.command_encoder());
        render.retired.composites += 1;
    }
    span.end(ctx.command_encoder());
}
