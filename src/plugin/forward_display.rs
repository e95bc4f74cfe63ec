//! The display of views that are not deferred, read by Bevy's forward shader itself.
//!
//! Bevy binds a texture at binding 24 in every view with meshes: `view_transmission_texture`
//! (bevy_pbr `render/mesh_view_bindings.rs`). It is a fallback, or the picture behind transmissive
//! materials. Only the transmissive pass reads it, after the opaque pass, and Bevy copies the
//! picture into it first. It is free while opaque surfaces are drawn. During that time it holds the
//! display: the light of the pixel's surface, and that surface's distance. The replacement of
//! Bevy's module of irradiance volumes (`shaders/engine/irradiance_volume.wgsl`) reads it there. It
//! returns the light of the volume if the distance differs.
//!
//! | when | system | does |
//! |---|---|---|
//! | `Render`, `PrepareResourcesFlush` | [`prepare`] | textures of each view, and the binding |
//! | `Core3d`, before the opaque pass | [`draw`] | prepasses to a G-buffer, [the view's passes](super::record), the texture |

use super::extract::ExtractedGi;
use super::record::{Surfaces, ViewInput, record_view};
use super::render_state::GiRender;
use crate::plan::ViewId;
use bevy::app::SubApp;
use bevy::core_pipeline::core_3d::main_opaque_pass_3d;
use bevy::core_pipeline::prepass::ViewPrepassTextures;
use bevy::core_pipeline::schedule::{Core3d, Core3dSystems};
use bevy::ecs::prelude::*;
use bevy::pbr::{ScreenSpaceTransmission, Transmissive3d, ViewTransmissionTexture};
use bevy::platform::collections::HashMap;
use bevy::render::camera::{ExtractedCamera, TemporalJitter};
use bevy::render::render_phase::ViewSortedRenderPhases;
use bevy::render::render_resource::{
    Extent3d, Sampler, SamplerDescriptor, Texture, TextureDescriptor, TextureDimension,
    TextureFormat, TextureUsages, TextureView, TextureViewDescriptor,
};
use bevy::render::renderer::{RenderContext, RenderDevice, RenderQueue, ViewQuery};
use bevy::render::view::{ExtractedView, Msaa, RetainedViewEntity};
use bevy::render::{GpuResourceAppExt, Render, RenderSystems};
use bytemuck::{Pod, Zeroable};

/// The shader of the draws.
const SHADER: &str = include_str!("../../shaders/engine/forward.wgsl");
/// Format of the texture that surfaces read.
const DISPLAY_FORMAT: TextureFormat = TextureFormat::Rgba16Float;

/// Adds the systems to the render world.
pub(crate) fn add_systems(app: &mut SubApp) {
    app.init_gpu_resource::<ForwardViews>()
        .add_systems(Render, prepare.in_set(RenderSystems::PrepareResourcesFlush))
        .add_systems(
            Core3d,
            draw.in_set(Core3dSystems::MainPass)
                .before(main_opaque_pass_3d),
        );
}

/// Parameters of the shader.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct ForwardParams {
    view_from_clip: [[f32; 4]; 4],
    viewport: [f32; 4],
    scale: f32,
    pad: [f32; 3],
}

/// Textures of a view, of the size of its target.
struct ForwardView {
    size: [u32; 2],
    depth: TextureView,
    gbuffer: TextureView,
    shown: (Texture, TextureView),
    sampler: Sampler,
    params: wgpu::Buffer,
    /// Bevy's own texture in this frame, where something transmissive is in view.
    transmission: Option<Texture>,
}

/// Pipelines of the draws.
struct Pipelines {
    single_sampled: wgpu::RenderPipeline,
    multisampled: wgpu::RenderPipeline,
    shown: wgpu::RenderPipeline,
}

/// GPU resources of views that are not deferred. Created again with the device.
#[derive(Resource, Default)]
pub(crate) struct ForwardViews {
    views: HashMap<RetainedViewEntity, ForwardView>,
    pipelines: Option<Pipelines>,
}

impl Pipelines {
    fn new(device: &wgpu::Device) -> Self {
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("meshless_gi forward"),
            source: wgpu::ShaderSource::Wgsl(SHADER.into()),
        });
        let draw = |entry, format, depth: Option<wgpu::DepthStencilState>| {
            device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(entry),
                layout: None,
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some("whole_screen"),
                    compilation_options: wgpu::PipelineCompilationOptions::default(),
                    buffers: &[],
                },
                primitive: wgpu::PrimitiveState::default(),
                depth_stencil: depth,
                multisample: wgpu::MultisampleState::default(),
                fragment: Some(wgpu::FragmentState {
                    module: &module,
                    entry_point: Some(entry),
                    compilation_options: wgpu::PipelineCompilationOptions::default(),
                    targets: &[Some(format)],
                }),
                multiview_mask: None,
                cache: None,
            })
        };
        let gbuffer = wgpu::ColorTargetState::from(TextureFormat::Rgba32Uint);
        let depth = Some(wgpu::DepthStencilState {
            format: TextureFormat::Depth32Float,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::Always),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        });
        Self {
            single_sampled: draw("gbuffer_of_one", gbuffer.clone(), depth.clone()),
            multisampled: draw("gbuffer_of_samples", gbuffer, depth),
            shown: draw(
                "exposed_light",
                wgpu::ColorTargetState::from(DISPLAY_FORMAT),
                None,
            ),
        }
    }
}

impl ForwardView {
    fn new(device: &RenderDevice, [width, height]: [u32; 2]) -> Self {
        let texture = |label, format, usage| {
            let texture = device.create_texture(&TextureDescriptor {
                label: Some(label),
                size: Extent3d {
                    width,
                    height,
                    depth_or_array_layers: 1,
                },
                mip_level_count: 1,
                sample_count: 1,
                dimension: TextureDimension::D2,
                format,
                usage: usage | TextureUsages::RENDER_ATTACHMENT | TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            });
            let view = texture.create_view(&TextureViewDescriptor::default());
            (texture, view)
        };
        let own = TextureUsages::empty();
        Self {
            size: [width, height],
            depth: texture("meshless_gi depth", TextureFormat::Depth32Float, own).1,
            gbuffer: texture("meshless_gi normals", TextureFormat::Rgba32Uint, own).1,
            shown: texture(
                "meshless_gi display",
                DISPLAY_FORMAT,
                TextureUsages::COPY_SRC,
            ),
            sampler: device.create_sampler(&SamplerDescriptor::default()),
            params: device.wgpu_device().create_buffer(&wgpu::BufferDescriptor {
                label: Some("meshless_gi forward"),
                size: size_of::<ForwardParams>() as u64,
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            }),
            transmission: None,
        }
    }
}

/// A view that may have a display.
type Prepared = (
    Entity,
    &'static ExtractedView,
    &'static ExtractedCamera,
    Option<&'static ScreenSpaceTransmission>,
    Option<&'static ViewTransmissionTexture>,
);

/// Makes textures for the views that display, and binds them where Bevy does not bind its own.
pub(crate) fn prepare(
    mut commands: Commands,
    mut forward: ResMut<ForwardViews>,
    world: Res<ExtractedGi>,
    phases: Option<Res<ViewSortedRenderPhases<Transmissive3d>>>,
    device: Res<RenderDevice>,
    views: Query<Prepared>,
) {
    let mut used = Vec::new();
    for (entity, view, camera, settings, bound) in &views {
        let id = view.retained_view_entity;
        let camera_id = ViewId(id.main_entity.to_bits());
        let needs_picture = (world.views.iter())
            .any(|v| v.id == camera_id && v.forward && v.has_gbuffer && v.settings.enabled);
        let Some(size) = camera.physical_target_size.filter(|_| needs_picture) else {
            if let Some(gone) = forward.views.remove(&id)
                && bound.is_some_and(|b| b.texture.id() == gone.shown.0.id())
            {
                commands.entity(entity).remove::<ViewTransmissionTexture>();
            }
            continue;
        };
        used.push(id);
        let size = size.to_array();
        let own = forward
            .views
            .entry(id)
            .or_insert_with(|| ForwardView::new(&device, size));
        if own.size != size {
            *own = ForwardView::new(&device, size);
        }
        let transmissive = settings.is_some_and(|s| s.steps > 0)
            && (phases.as_ref().and_then(|p| p.get(&id))).is_some_and(|p| !p.items.is_empty());
        own.transmission = (bound.filter(|_| transmissive)).map(|bound| bound.texture.clone());
        if own.transmission.is_none() {
            commands.entity(entity).insert(ViewTransmissionTexture {
                texture: own.shown.0.clone(),
                view: own.shown.1.clone(),
                sampler: own.sampler.clone(),
            });
        }
    }
    forward.views.retain(|id, _| used.contains(id));
    if used.is_empty() {
        forward.pipelines = None;
    } else if forward.pipelines.is_none() {
        forward.pipelines = Some(Pipelines::new(device.wgpu_device()));
    }
}

type View = (
    &'static ExtractedView,
    &'static ExtractedCamera,
    &'static ViewPrepassTextures,
    &'static Msaa,
    Option<&'static TemporalJitter>,
);

/// Evaluates the display, and writes the texture that surfaces read.
pub(crate) fn draw(
    view: ViewQuery<View>,
    forward: Res<ForwardViews>,
    world: Res<ExtractedGi>,
    mut render: ResMut<GiRender>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
    mut ctx: RenderContext,
) {
    let (view, camera, prepass, msaa, jitter) = view.into_inner();
    let (Some(own), Some(pipelines)) = (
        forward.views.get(&view.retained_view_entity),
        &forward.pipelines,
    ) else {
        return;
    };
    let id = ViewId(view.retained_view_entity.main_entity.to_bits());
    let (Some(shown_by), Some(depth), Some(normals)) = (
        world.views.iter().find(|v| v.id == id),
        prepass.depth_view(),
        prepass.normal_view(),
    ) else {
        return;
    };
    let sampled = msaa.samples() > 1;
    let bind = |pipeline: &wgpu::RenderPipeline, entries: &[wgpu::BindGroupEntry<'_>]| {
        let layout = pipeline.get_bind_group_layout(0);
        let descriptor = wgpu::BindGroupDescriptor {
            label: Some("meshless_gi forward"),
            layout: &layout,
            entries,
        };
        device.wgpu_device().create_bind_group(&descriptor)
    };
    let (pipeline, first) = match sampled {
        false => (&pipelines.single_sampled, 0),
        true => (&pipelines.multisampled, 2),
    };
    let gbuffer = bind(pipeline, &[entry(first, depth), entry(first + 1, normals)]);
    full_screen(
        &mut ctx,
        "meshless_gi normals",
        (&own.gbuffer, Some(&own.depth)),
        Some((pipeline, &gbuffer)),
    );
    let surfaces = Surfaces {
        view,
        camera,
        jitter,
        depth: &own.depth,
        gbuffer: &own.gbuffer,
        size: own.size,
    };
    let input = ViewInput {
        camera: shown_by,
        surfaces: &surfaces,
        picture: None,
        world: &world,
    };
    let irradiance = record_view(&mut render, id, Some(&input), &queue, &mut ctx);
    let params = ForwardParams {
        view_from_clip: surfaces.clip_from_view().inverse().to_cols_array_2d(),
        viewport: surfaces.viewport(),
        scale: shown_by.settings.intensity.max(0.0),
        pad: [0.0; 3],
    };
    queue.write_buffer(&own.params, 0, bytemuck::bytes_of(&params));
    let light = irradiance.map(|irradiance| {
        let entries = [
            entry(0, &own.depth),
            entry(4, &irradiance),
            wgpu::BindGroupEntry {
                binding: 5,
                resource: own.params.as_entire_binding(),
            },
        ];
        bind(&pipelines.shown, &entries)
    });
    let drawn = light.as_ref().map(|light| (&pipelines.shown, light));
    full_screen(&mut ctx, "meshless_gi display", (&own.shown.1, None), drawn);
    if let Some(theirs) = &own.transmission
        && theirs.format() == DISPLAY_FORMAT
        && theirs.size() == own.shown.0.size()
    {
        ctx.command_encoder().copy_texture_to_texture(
            own.shown.0.as_image_copy(),
            theirs.as_image_copy(),
            theirs.size(),
        );
    }
}

fn entry(binding: u32, view: &wgpu::TextureView) -> wgpu::BindGroupEntry<'_> {
    wgpu::BindGroupEntry {
        binding,
        resource: wgpu::BindingResource::TextureView(view),
    }
}

/// Clears the targets, and draws a triangle over them where there is something to draw.
fn full_screen(
    ctx: &mut RenderContext,
    label: &str,
    (color, depth): (&TextureView, Option<&TextureView>),
    drawn: Option<(&wgpu::RenderPipeline, &wgpu::BindGroup)>,
) {
    let mut pass = ctx
        .command_encoder()
        .begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some(label),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: color,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                    store: wgpu::StoreOp::Store,
                },
            })],
            depth_stencil_attachment: depth.map(|view| wgpu::RenderPassDepthStencilAttachment {
                view,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(0.0),
                    store: wgpu::StoreOp::Store,
                }),
                stencil_ops: None,
            }),
            timestamp_writes: None,
            occlusion_query_set: None,
            multiview_mask: None,
        });
    if let Some((pipeline, bind)) = drawn {
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, bind, &[]);
        pass.draw(0..3, 0..1);
    }
}
