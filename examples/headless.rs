//! Renders one picture with indirect light without a window, on servers, in tests, and on machines
//! without a GPU (software Vulkan).
//!
//! ```text
//! cargo run --release --example headless -- cornell.png [--direct] [--budget MS]
//! ```
//!
//! The Cornell box is made in code and baked first. `--direct` turns indirect light off. `--budget`
//! limits the GPU time of indirect light per frame. It moves light and camera along a path first,
//! and prints the times and the tier of the bake.

mod common;

use bevy::app::PluginsState;
use bevy::camera::RenderTarget;
use bevy::prelude::*;
use bevy::render::diagnostic::RenderDiagnosticsPlugin;
use bevy::render::gpu_readback::{Readback, ReadbackComplete};
use bevy::render::render_resource::{PollType, TextureFormat, TextureUsages};
use bevy::render::renderer::RenderDevice;
use bevy_meshless_gi::prelude::*;
use meshless_gi::Quad;
use std::process::ExitCode;
use std::sync::{Arc, Mutex};
use std::time::Instant;

/// Size in pixels of 4 bytes. Rows of a multiple of 256 bytes need no unpacking.
const SIZE: UVec2 = UVec2::new(640, 480);

fn main() -> ExitCode {
    let mut path = "headless.png".to_string();
    let mut indirect = true;
    let mut budget = None;
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--direct" => indirect = false,
            "--budget" => {
                budget = arguments.next().and_then(|ms| ms.parse::<f32>().ok());
                if budget.is_none() {
                    eprintln!("--budget needs milliseconds");
                    return ExitCode::from(2);
                }
            }
            option if option.starts_with('-') => {
                eprintln!("usage: headless [PICTURE.png] [--direct] [--budget MS]");
                return ExitCode::from(2);
            }
            file => path = file.to_string(),
        }
    }
    let mut app = App::new();
    app.add_plugins((
        common::capture::windowless(),
        // Measures GPU times.
        RenderDiagnosticsPlugin,
        MeshlessGiPlugin::default(),
    ))
    .insert_resource(GlobalAmbientLight::NONE);
    while app.plugins_state() == PluginsState::Adding {
        bevy::tasks::tick_global_task_pools_on_main_thread();
    }
    app.finish();
    app.cleanup();

    let target = picture_to_draw(&mut app);
    app.world_mut()
        .run_system_cached_with(setup, (target.clone(), indirect))
        .expect("the scene can be made");

    // Bakes in the background.
    let mut baking = app.world_mut().query::<&GiBakeProgress>();
    while baking.iter(app.world()).next().is_some() {
        std::thread::sleep(std::time::Duration::from_millis(10));
        frame(&mut app);
    }
    let mut baked = app.world_mut().query::<&GiScene>();
    if baked.iter(app.world()).next().is_none() {
        // The log has the error.
        return ExitCode::from(1);
    }

    // Some more frames for shadow maps and shaders.
    for _ in 0..5 {
        frame(&mut app);
    }
    if let Some(ms) = budget {
        walk(&mut app, ms);
    }
    let bytes = Arc::new(Mutex::new(None));
    let sink = bytes.clone();
    app.world_mut()
        .spawn(Readback::texture(target))
        .observe(move |event: On<ReadbackComplete>| {
            *sink.lock().expect("the lock is not poisoned") = Some(event.data.clone())
        });
    for _ in 0..10 {
        frame(&mut app);
    }
    let Some(bytes) = bytes.lock().expect("the lock is not poisoned").take() else {
        eprintln!("the renderer gave no picture; see the log above");
        return ExitCode::from(3);
    };
    if let Err(error) = image::save_buffer(&path, &bytes, SIZE.x, SIZE.y, image::ColorType::Rgba8) {
        eprintln!("{path}: {error}");
        return ExitCode::from(3);
    }
    println!("{path}");
    ExitCode::SUCCESS
}

fn frame(app: &mut App) {
    app.update();
    if let Some(device) = app.world().get_resource::<RenderDevice>() {
        // A lost device shows in the log, and as a missing picture.
        let _ = device.wgpu_device().poll(PollType::wait_indefinitely());
    }
}

/// Moves light and camera along a path under a budget, and prints a row for every tenth frame.
fn walk(app: &mut App, ms: f32) {
    const FRAMES: u32 = 300;
    let world = app.world_mut();
    let mut roots = world.query_filtered::<Entity, With<GiScene>>();
    let roots: Vec<Entity> = roots.iter(world).collect();
    for &root in &roots {
        let budget = GiQuality::GpuBudget(std::time::Duration::from_secs_f32(1e-3 * ms));
        world.entity_mut(root).insert(budget);
    }
    let mut moving = world.query_filtered::<&mut Transform, Or<(With<PointLight>, With<Camera>)>>();
    println!("| frame | frame ms | tier and reason |");
    println!("|---|---|---|");
    for k in 0..FRAMES {
        let (sine, cosine) = (0.05 * k as f32).sin_cos();
        for mut transform in moving.iter_mut(app.world_mut()) {
            transform.translation += 0.01 * Vec3::new(cosine, 0.0, sine);
        }
        let began = Instant::now();
        frame(app);
        let took = 1e3 * began.elapsed().as_secs_f32();
        let tiers = roots.iter().filter_map(|&root| app.world().get(root));
        for picked in tiers.filter_map(GiActiveTier::selection) {
            if k % 10 == 0 {
                println!("| {k} | {took:.1} | {picked} |");
            }
        }
    }
    for tier in roots
        .iter()
        .filter_map(|&root| app.world().get::<GiActiveTier>(root))
    {
        println!(
            "\nthe tier changed {} times in {FRAMES} frames",
            tier.changes()
        );
    }
}

fn picture_to_draw(app: &mut App) -> Handle<Image> {
    let mut image = Image::new_target_texture(SIZE.x, SIZE.y, TextureFormat::Rgba8UnormSrgb, None);
    image.texture_descriptor.usage |= TextureUsages::COPY_SRC;
    app.world_mut().resource_mut::<Assets<Image>>().add(image)
}

fn setup(
    In((target, indirect)): In<(Handle<Image>, bool)>,
    mut commands: Commands,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    let quads = Quad::cornell_box();
    let recipe = Recipe {
        preset: Preset::Draft,
        ..default()
    };
    let mut root = commands.spawn((Transform::default(), Visibility::default()));
    common::spawn_quads(&quads, &mut root, &mut meshes, &mut materials);
    root.bake_gi(recipe);
    commands.spawn((
        PointLight {
            color: Color::linear_rgb(1.0, 0.95, 0.85),
            intensity: 60_000.0,
            shadow_maps_enabled: true,
            ..default()
        },
        Transform::from_xyz(0.0, 1.6, 0.2),
    ));
    commands.spawn((
        Camera3d::default(),
        Camera {
            clear_color: ClearColorConfig::Custom(Color::BLACK),
            ..default()
        },
        RenderTarget::Image(target.into()),
        GiCamera {
            enabled: indirect,
            ..default()
        },
        Transform::from_xyz(0.0, 1.0, 4.2).looking_at(Vec3::new(0.0, 1.0, 0.0), Vec3::Y),
    ));
}
