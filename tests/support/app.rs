//! Bevy apps without a window, and the pictures that they draw. They run on any device, software
//! Vulkan included.

use super::flip::Picture;
use bevy::app::{PluginsState, TaskPoolOptions, TaskPoolThreadAssignmentPolicy};
use bevy::asset::RenderAssetUsages;
use bevy::camera::{CameraOutputMode, RenderTarget};
use bevy::core_pipeline::tonemapping::Tonemapping;
use bevy::prelude::*;
use bevy::render::pipelined_rendering::PipelinedRenderingPlugin;
use bevy::render::render_asset::RenderAssets;
use bevy::render::render_resource::{
    BufferDescriptor, BufferUsages, CommandEncoderDescriptor, Extent3d, MapMode, PollType,
    TexelCopyBufferInfo, TexelCopyBufferLayout, TextureDimension, TextureFormat, TextureUsages,
};
use bevy::render::renderer::{RenderDevice, RenderQueue};
use bevy::render::settings::{RenderCreation, WgpuLimits, WgpuSettings};
use bevy::render::texture::GpuImage;
use bevy::render::{RenderApp, RenderPlugin};
use bevy::window::ExitCondition;
use bevy::winit::WinitPlugin;
use bevy_meshless_gi::prelude::*;
use half::f16;

/// Edges of the pictures, in pixels. At 8 bytes per pixel the length of a row is a multiple of 256
/// bytes, as texture read-back requires.
pub const WIDTH: u32 = 128;
pub const HEIGHT: u32 = 96;

/// Returns Bevy's default plugins without window and event loop.
pub fn headless_plugins() -> bevy::app::PluginGroupBuilder {
    DefaultPlugins
        .set(WindowPlugin {
            primary_window: None,
            exit_condition: ExitCondition::DontExit,
            ..default()
        })
        .set(RenderPlugin {
            synchronous_pipeline_compilation: true,
            ..default()
        })
        .set(bevy::log::LogPlugin {
            filter: "warn,bevy_render=warn,wgpu=error".into(),
            ..default()
        })
        .set(TaskPoolPlugin {
            task_pool_options: TaskPoolOptions {
                // All apps of a process share the pool. One thread, Bevy's choice on two cores,
                // would run the systems of only one test at a time.
                compute: TaskPoolThreadAssignmentPolicy {
                    min_threads: 3,
                    max_threads: usize::MAX,
                    percent: 1.0,
                    on_thread_spawn: None,
                    on_thread_destroy: None,
                },
                ..default()
            },
        })
        .disable::<WinitPlugin>()
        .disable::<PipelinedRenderingPlugin>()
}

/// Returns [`headless_plugins`] on a device with at most these limits.
pub fn limited_plugins(limits: WgpuLimits) -> bevy::app::PluginGroupBuilder {
    headless_plugins().set(RenderPlugin {
        synchronous_pipeline_compilation: true,
        render_creation: RenderCreation::Automatic(Box::new(WgpuSettings {
            constrained_limits: Some(limits),
            ..default()
        })),
        ..default()
    })
}

/// Creates an app with the plugin and finishes its plugins.
pub fn app() -> App {
    app_with(headless_plugins())
}

/// Creates an app with these plugins of Bevy and the plugin, and finishes its plugins.
pub fn app_with(plugins: bevy::app::PluginGroupBuilder) -> App {
    let mut app = App::new();
    app.add_plugins((plugins, MeshlessGiPlugin::default(), MeshlessGiDebugPlugin))
        .insert_resource(GlobalAmbientLight::NONE)
        .insert_resource(bevy::light::PointLightShadowMap { size: 256 });
    finish_plugins(&mut app);
    app
}

/// Number of bounces of the tests' rooms, also in `settings`. Expected pictures therefore do not
/// depend on a bake's automatic number. A test of the automatic number sets `Auto` later.
pub const BOUNCES: u32 = 4;

/// Waits for the plugins and finishes them. The renderer starts in the background. Replaces each
/// inserted `Auto` number of bounces by [`BOUNCES`].
pub fn finish_plugins(app: &mut App) {
    app.add_observer(|set: On<Insert, GiSolver>, mut all: Query<&mut GiSolver>| {
        if let Ok(mut solver) = all.get_mut(set.entity)
            && solver.bounces == GiBounceCount::Auto
        {
            solver.bounces = GiBounceCount::Fixed(BOUNCES);
        }
    });
    while app.plugins_state() == PluginsState::Adding {
        bevy::tasks::tick_global_task_pools_on_main_thread();
    }
    app.finish();
    app.cleanup();
}

/// Runs `frames` frames and waits for the device after each.
pub fn run(app: &mut App, frames: usize) {
    for _ in 0..frames {
        app.update();
        if let Some(device) = app.world().get_resource::<RenderDevice>() {
            device
                .wgpu_device()
                .poll(PollType::wait_indefinitely())
                .expect("the device completes its work");
        }
    }
}

/// Creates the render target of a test camera. Pixels are 16-bit floats without tonemapping,
/// therefore scene-linear.
pub fn target(app: &mut App) -> Handle<Image> {
    let image = create_target_image(WIDTH, HEIGHT);
    app.world_mut().resource_mut::<Assets<Image>>().add(image)
}

/// Creates an image that a camera can draw to and a test can read. `width` must be a multiple of
/// 32.
pub fn create_target_image(width: u32, height: u32) -> Image {
    let mut image = Image::new_uninit(
        Extent3d {
            width,
            height,
            depth_or_array_layers: 1,
        },
        TextureDimension::D2,
        TextureFormat::Rgba16Float,
        RenderAssetUsages::all(),
    );
    image.texture_descriptor.usage =
        TextureUsages::RENDER_ATTACHMENT | TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_SRC;
    image
}

/// Creates a camera without tonemapping that clears to black. It evaluates indirect light at every
/// pixel, like the CPU's pictures.
pub fn camera(target: &Handle<Image>, transform: Transform) -> impl Bundle {
    (
        Camera3d::default(),
        Camera {
            clear_color: ClearColorConfig::Custom(Color::BLACK),
            output_mode: CameraOutputMode::default(),
            ..default()
        },
        RenderTarget::Image(target.clone().into()),
        Tonemapping::None,
        GiSplatting::PerPixel,
        bevy::core_pipeline::tonemapping::DebandDither::Disabled,
        transform,
    )
}

/// Runs one frame and returns the target's pixels.
pub fn picture(app: &mut App, target: &Handle<Image>) -> Picture {
    run(app, 1);
    drawn(app, target)
}

/// Returns the target's pixels after the last frame.
pub fn drawn(app: &App, target: &Handle<Image>) -> Picture {
    let world = app.sub_app(RenderApp).world();
    let images = world.resource::<RenderAssets<GpuImage>>();
    let texture = &images.get(target).expect("the target is drawn").texture;
    let (width, height) = (texture.width(), texture.height());
    let bytes = u64::from(8 * width * height);
    let device = world.resource::<RenderDevice>().wgpu_device();
    let buffer = device.create_buffer(&BufferDescriptor {
        label: None,
        size: bytes,
        usage: BufferUsages::COPY_DST | BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = device.create_command_encoder(&CommandEncoderDescriptor::default());
    let rows = TexelCopyBufferInfo {
        buffer: &buffer,
        layout: TexelCopyBufferLayout {
            bytes_per_row: Some(8 * width),
            ..default()
        },
    };
    encoder.copy_texture_to_buffer(texture.as_image_copy(), rows, texture.size());
    world.resource::<RenderQueue>().submit([encoder.finish()]);
    buffer.map_async(MapMode::Read, .., |result| {
        result.expect("the buffer is mapped")
    });
    device
        .poll(PollType::wait_indefinitely())
        .expect("the device completes its work");
    let bytes = buffer.get_mapped_range(..).to_vec();
    let half = |at: usize| f16::from_le_bytes([bytes[at], bytes[at + 1]]).to_f32();
    Picture {
        width: width as usize,
        height: height as usize,
        pixels: (0..bytes.len() / 8)
            .map(|i| [half(8 * i), half(8 * i + 2), half(8 * i + 4)])
            .collect(),
    }
}
