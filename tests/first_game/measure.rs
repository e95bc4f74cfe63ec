//! Plugin that the test adds to a first game. It waits until a bake lights the scene and writes a
//! screenshot of the window. It compares the plugin's indirect light with that of `CpuFrame`.
//!
//! A second camera with the transform of the game's camera draws indirect light alone,
//! scene-linear, to an image. The CPU's picture uses the meshes of the running game, so it fits any
//! game. Surfaces are flat-shaded and have no textures, and lights are point lights.
//!
//! Output in the folder `MGI_FIRST_GAME`: `window.png`, `pictures.png` (plugin, CPU), and one line
//! on standard output: `FIRST_GAME flip=… nrmse=… mean=… covered=…`.

use bevy::asset::RenderAssetUsages;
use bevy::camera::RenderTarget;
use bevy::core_pipeline::tonemapping::{DebandDither, Tonemapping};
use bevy::mesh::{Indices, VertexAttributeValues};
use bevy::prelude::*;
use bevy::render::gpu_readback::{Readback, ReadbackComplete};
use bevy::render::render_resource::{Extent3d, TextureDimension, TextureFormat, TextureUsages};
use bevy::render::view::screenshot::{Screenshot, save_to_disk};
use meshless_gi_lab::accuracy::{Image as LinearImage, flip};
use meshless_gi::{BakedScene, CpuFrame, FrameLight, FrameSettings};
use bevy_meshless_gi::internals::plan::BounceSelector;
use bevy_meshless_gi::{GiFrameStats, GiDebugView};
use bevy_meshless_gi::prelude::*;
use meshless_gi::Light;
use std::f32::consts::PI;
use std::path::PathBuf;

/// Size of the compared pictures in pixels. Rows are a multiple of 256 bytes.
const WIDTH: u32 = 160;
const HEIGHT: u32 = 96;
/// Frames between the first solve and the measurement.
const SETTLE_FRAMES: u32 = 20;
/// Frames after which the measurement fails.
const MAX_FRAMES: u32 = 4000;

/// Plugin that compares the game's indirect light with the CPU's and ends the game.
pub struct MeasurePlugin;

impl Plugin for MeasurePlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<Measurement>()
            .add_observer(store_pixels)
            .add_systems(Startup, shrink_window)
            .add_systems(Last, measure);
    }
}

/// Reduces the window to a quarter of its width and height, because software devices take most of
/// the time for its pixels. Pictures that are kept have the game's own size.
fn shrink_window(mut windows: Query<&mut Window>) {
    if std::env::var_os("MGI_TEST_PICTURES").is_none() {
        for mut window in &mut windows {
            window.resolution.set(320.0, 180.0);
        }
    }
}

/// State of the measurement.
#[derive(Resource, Default)]
struct Measurement {
    frames: u32,
    lit_frames: u32,
    target: Option<Handle<Image>>,
    pixels: Option<Vec<Vec3>>,
    waits: u32,
}

/// Stores the pixels of the second camera.
fn store_pixels(event: On<ReadbackComplete>, mut measurement: ResMut<Measurement>) {
    let half = |at: usize| {
        let bits = [event.data[at], event.data[at + 1]];
        half::f16::from_le_bytes(bits).to_f32()
    };
    let count = (WIDTH * HEIGHT) as usize;
    measurement.pixels = Some(
        (0..count)
            .map(|i| Vec3::new(half(8 * i), half(8 * i + 2), half(8 * i + 4)))
            .collect(),
    );
}

/// Advances the measurement. Runs once per frame.
fn measure(world: &mut World) {
    let mut state = world.remove_resource::<Measurement>().unwrap_or_default();
    state.frames += 1;
    let lit = !world.resource::<GiFrameStats>().get().solved.is_empty() || state.lit_frames > 0;
    state.lit_frames += u32::from(lit);
    if state.frames > MAX_FRAMES {
        println!("FIRST_GAME no indirect light after {MAX_FRAMES} frames");
        world.write_message(AppExit::error());
    } else if state.lit_frames == SETTLE_FRAMES {
        state.target = Some(spawn_second_camera(world));
    } else if state.lit_frames == 2 * SETTLE_FRAMES {
        // The second camera does not draw to the window, so the screenshot shows the game's own
        // camera.
        let target = state.target.clone().expect("the second camera has a target");
        world.spawn(Readback::texture(target));
        let file = folder().join("window.png");
        world
            .spawn(Screenshot::primary_window())
            .observe(save_to_disk(file));
    } else if state.lit_frames > 2 * SETTLE_FRAMES {
        state.waits += 1;
        if let (Some(pixels), true) = (&state.pixels, folder().join("window.png").exists()) {
            report(world, pixels);
            world.write_message(AppExit::Success);
        } else if state.waits > 600 {
            println!("FIRST_GAME no picture arrived");
            world.write_message(AppExit::error());
        }
    }
    world.insert_resource(state);
}

/// Returns the folder of the output.
fn folder() -> PathBuf {
    std::env::var_os("MGI_FIRST_GAME")
        .expect("MGI_FIRST_GAME names the folder of the output")
        .into()
}

/// Returns the transform of the game's active camera that draws to a window.
fn game_camera(world: &mut World) -> Transform {
    let mut cameras =
        world.query_filtered::<(&GlobalTransform, &RenderTarget), (With<Camera3d>, With<Camera>)>();
    cameras
        .iter(world)
        .find(|(_, target)| matches!(target, RenderTarget::Window(_)))
        .map(|(transform, _)| transform.compute_transform())
        .expect("the game has a camera")
}

/// Spawns a camera with the transform of the game's camera that draws indirect light alone. Returns
/// its target.
fn spawn_second_camera(world: &mut World) -> Handle<Image> {
    let transform = game_camera(world);
    let size = Extent3d {
        width: WIDTH,
        height: HEIGHT,
        depth_or_array_layers: 1,
    };
    let mut image = Image::new_uninit(
        size,
        TextureDimension::D2,
        TextureFormat::Rgba16Float,
        RenderAssetUsages::all(),
    );
    image.texture_descriptor.usage =
        TextureUsages::RENDER_ATTACHMENT | TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_SRC;
    let target = world.resource_mut::<Assets<Image>>().add(image);
    world.spawn((
        Camera3d::default(),
        Camera {
            order: -1,
            clear_color: ClearColorConfig::Custom(Color::BLACK),
            ..default()
        },
        RenderTarget::Image(target.clone().into()),
        GiCamera {
            debug_view: GiDebugView::IndirectOnly,
            ..default()
        },
        Tonemapping::None,
        DebandDither::Disabled,
        transform,
    ));
    target
}

/// Triangle of the running game with its diffuse reflectance.
struct Triangle {
    corners: [Vec3; 3],
    normal: Vec3,
    albedo: Vec3,
    culled: bool,
}

/// Returns all triangles that the game draws, in world space.
fn triangles(world: &mut World) -> Vec<Triangle> {
    let mut drawn = world.query::<(
        &Mesh3d,
        &MeshMaterial3d<StandardMaterial>,
        &GlobalTransform,
    )>();
    let (meshes, materials) = (
        world.resource::<Assets<Mesh>>(),
        world.resource::<Assets<StandardMaterial>>(),
    );
    let mut triangles = Vec::new();
    for (mesh, material, transform) in drawn.iter(world) {
        let mesh = meshes.get(&mesh.0).expect("meshes are loaded");
        let material = materials.get(&material.0).expect("materials are loaded");
        assert!(material.base_color_texture.is_none(), "no textures here");
        let Some(VertexAttributeValues::Float32x3(positions)) =
            mesh.attribute(Mesh::ATTRIBUTE_POSITION)
        else {
            panic!("a mesh without positions");
        };
        let indices: Vec<usize> = match mesh.indices() {
            Some(Indices::U16(all)) => all.iter().map(|&i| i as usize).collect(),
            Some(Indices::U32(all)) => all.iter().map(|&i| i as usize).collect(),
            None => (0..positions.len()).collect(),
        };
        let color = material.base_color.to_linear();
        let albedo = Vec3::new(color.red, color.green, color.blue) * (1.0 - material.metallic);
        for corner in indices.chunks_exact(3) {
            let corners =
                [0, 1, 2].map(|k| transform.transform_point(positions[corner[k]].into()));
            let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
            triangles.push(Triangle {
                corners,
                normal: normal.normalize_or_zero(),
                albedo,
                culled: material.cull_mode.is_some(),
            });
        }
    }
    triangles
}

/// Returns the first triangle that a ray hits: its distance, its normal on the side of the ray, and
/// its albedo.
fn cast(triangles: &[Triangle], origin: Vec3, direction: Vec3) -> Option<(f32, Vec3, Vec3)> {
    let mut best: Option<(f32, Vec3, Vec3)> = None;
    for triangle in triangles {
        let cosine = triangle.normal.dot(direction);
        if cosine == 0.0 || (triangle.culled && cosine > 0.0) {
            continue;
        }
        let [a, b, c] = triangle.corners;
        let t = (a - origin).dot(triangle.normal) / cosine;
        let at = origin + t * direction;
        let inside = [(a, b), (b, c), (c, a)]
            .iter()
            .all(|&(p, q)| (q - p).cross(at - p).dot(triangle.normal) >= 0.0);
        if t > 0.0 && inside && best.is_none_or(|(nearest, ..)| t < nearest) {
            let normal = -cosine.signum() * triangle.normal;
            best = Some((t, normal, triangle.albedo));
        }
    }
    best
}

/// Returns the point lights of the game as lights of `CpuFrame`.
fn lights(world: &mut World) -> Vec<FrameLight> {
    let mut others = world.query_filtered::<(), Or<(With<SpotLight>, With<DirectionalLight>)>>();
    assert_eq!(others.iter(world).count(), 0, "point lights alone");
    let mut points = world.query::<(&PointLight, &GlobalTransform)>();
    points
        .iter(world)
        .flat_map(|(light, transform)| {
            let color = light.color.to_linear();
            let intensity = Vec3::new(color.red, color.green, color.blue) * light.intensity;
            let light = Light::Point {
                position: transform.translation(),
                intensity: intensity / (4.0 * PI),
                range: light.range,
            };
            FrameLight::expand(&light, 16)
        })
        .collect()
}

/// Returns the CPU's picture of indirect light, and the fraction of pixels that the bake covers.
fn cpu_picture(world: &mut World) -> (Vec<Vec3>, f32) {
    let camera = game_camera(world);
    let triangles = triangles(world);
    let lights = lights(world);
    let mut roots = world.query::<(&GiScene, &GlobalTransform, &GiEnvironment, &GiSolver)>();
    let (gi, root, environment, solver) = roots.single(world).expect("the game has one bake");
    let local_from_world = root.to_matrix().inverse();
    let assets = world.resource::<Assets<GiBakedScene>>();
    let scene: &BakedScene = &assets.get(&gi.0).expect("the bake is loaded").scene;
    let selection = BounceSelector::new().select(solver.bounces, scene, &[]);
    let settings = FrameSettings {
        emission: environment.emissive_luminance,
        ..FrameSettings::bounces(selection.map_or(1, |selection| selection.bounces))
    };
    let lights: Vec<FrameLight> = lights.iter().map(|l| l.to_local(&local_from_world)).collect();
    let mut frame = CpuFrame::new(scene);
    frame.set_lights(scene, &lights);
    frame.solve(scene, &settings);
    let half_height = (std::f32::consts::FRAC_PI_4 / 2.0).tan();
    let aspect = WIDTH as f32 / HEIGHT as f32;
    // Bevy's default exposure, EV100 9.7.
    let exposure = (-9.7f32).exp2() / 1.2;
    let (mut covered, mut drawn) = (0, 0);
    let pixel = |i: u32| {
        let (x, y) = ((i % WIDTH) as f32 + 0.5, (i / WIDTH) as f32 + 0.5);
        let ndc = Vec2::new(2.0 * x / WIDTH as f32 - 1.0, 1.0 - 2.0 * y / HEIGHT as f32);
        let toward = Vec3::new(ndc.x * aspect * half_height, ndc.y * half_height, -1.0);
        let direction = (camera.rotation * toward).normalize();
        let Some((t, normal, albedo)) = cast(&triangles, camera.translation, direction) else {
            return Vec3::ZERO;
        };
        drawn += 1;
        let position = local_from_world.transform_point3(camera.translation + t * direction);
        let normal = local_from_world.transform_vector3(normal).normalize();
        let irradiance = frame.irradiance(scene, position, normal);
        covered += u32::from(irradiance.is_some());
        exposure * albedo * irradiance.unwrap_or(Vec3::ZERO) / PI
    };
    let pixels: Vec<Vec3> = (0..WIDTH * HEIGHT).map(pixel).collect();
    (pixels, covered as f32 / drawn.max(1) as f32)
}

/// Compares the pictures and prints the result.
fn report(world: &mut World, plugin_pixels: &[Vec3]) {
    let (cpu, covered) = cpu_picture(world);
    let picture = |pixels: &[Vec3]| LinearImage {
        width: WIDTH,
        height: HEIGHT,
        pixels: pixels.to_vec(),
    };
    let difference = flip(&picture(&cpu), &picture(plugin_pixels));
    let error: f32 = cpu.iter().zip(plugin_pixels).map(|(a, b)| (*a - *b).length_squared()).sum();
    let power: f32 = cpu.iter().map(|a| a.length_squared()).sum();
    let mean = cpu.iter().map(|p| p.element_sum()).sum::<f32>() / (3 * cpu.len()) as f32;
    // The comparison distinguishes pictures. A reversed picture has a large error.
    let mut reversed = plugin_pixels.to_vec();
    reversed.reverse();
    let perturbed = flip(&picture(&cpu), &picture(&reversed));
    write_pictures(plugin_pixels, &cpu);
    println!(
        "FIRST_GAME flip={difference:.4} nrmse={:.4} mean={mean:.4} covered={covered:.3} \
         perturbed={perturbed:.4}",
        (error / power).sqrt()
    );
}

/// Writes the pictures of the plugin and of the CPU next to each other.
fn write_pictures(plugin_pixels: &[Vec3], cpu: &[Vec3]) {
    let srgb = |v: f32| Color::linear_rgb(v.clamp(0.0, 1.0), 0.0, 0.0).to_srgba().red;
    let mut bytes = Vec::new();
    for y in 0..HEIGHT {
        for picture in [plugin_pixels, cpu] {
            let row = &picture[(y * WIDTH) as usize..((y + 1) * WIDTH) as usize];
            let channels = row.iter().flat_map(|p| p.to_array());
            bytes.extend(channels.map(|v| (255.0 * srgb(v) + 0.5) as u8));
        }
    }
    let file = folder().join("pictures.png");
    image::save_buffer(&file, &bytes, 2 * WIDTH, HEIGHT, image::ColorType::Rgb8)
        .expect("the pictures can be written");
}
