//! Thirteen scenes, from one light at rest to all effects together, and the stages of each.
use bevy::camera::{Hdr, RenderTarget};
use bevy::light::{FogVolume, RectLight, VolumetricFog, VolumetricLight};
use bevy::pbr::DefaultOpaqueRendererMethod;
use bevy::prelude::*;
use bevy::render::render_resource::{TextureFormat, TextureUsages};
use bevy::render::view::Msaa;
use bevy_meshless_gi::internals::plan::FrameStage;
use bevy_meshless_gi::prelude::*;
use meshless_gi::{
    BakedScene, Material, OccluderBox, OccluderDesc, Progress, Quad, Recipe, TriangleMesh,
    bake_scene,
};
use std::sync::Arc;

/// Content of a scene.
#[derive(Clone, Copy, Debug, Default)]
pub struct Scene {
    /// Description.
    pub name: &'static str,
    /// Point light: `Some(true)` if it moves. `None` for no point light.
    light: Option<bool>,
    /// `true` if the light changes its color.
    color: bool,
    /// `true` if the radiance of the sky changes.
    sky: bool,
    /// `true` if the emission of signs changes.
    emission_changes: bool,
    /// `true` if a ball moves.
    ball: bool,
    /// `true` if the ball reflects the light.
    bounce: bool,
    /// `true` for a moving panel with soft shadows.
    panel: bool,
    /// `true` if an occluder in the room opens and closes.
    screen: bool,
    /// `true` for a forward camera in addition to the deferred one, or instead of it.
    forward: bool,
    /// `true` if there is no deferred camera.
    no_deferred: bool,
    /// `true` if fog fills the room and cameras display it.
    fog: bool,
    /// `true` if the bake has probes and visibility.
    probes_and_visibility: bool,
    /// `true` if all surfaces and emission are gray.
    pub gray: bool,
    /// Stages that run in every frame. No other stage runs.
    pub runs: &'static [FrameStage],
}

/// Scenes of the report.
pub const SCENES: [Scene; 13] = [
    Scene {
        name: "one light at rest",
        light: Some(false),
        runs: &[FrameStage::SPLAT, FrameStage::COMPOSITE],
        ..NONE
    },
    Scene {
        name: "the same, in a bake with more features",
        light: Some(false),
        probes_and_visibility: true,
        runs: &[
            FrameStage::PROBE_PIXELS,
            FrameStage::SPLAT,
            FrameStage::COMPOSITE,
        ],
        ..NONE
    },
    Scene {
        name: "one light that changes its color",
        light: Some(false),
        color: true,
        runs: &[
            FrameStage::PULL_PUSH,
            FrameStage::APPLY,
            FrameStage::FLATTEN,
            FrameStage::SPLAT,
            FrameStage::COMPOSITE,
        ],
        ..NONE
    },
    Scene {
        name: "one light that moves",
        light: Some(true),
        runs: &[
            FrameStage::PROJECT,
            FrameStage::PULL_PUSH,
            FrameStage::APPLY,
            FrameStage::FLATTEN,
            FrameStage::SPLAT,
            FrameStage::COMPOSITE,
        ],
        ..NONE
    },
    Scene {
        name: "the same in a gray room",
        light: Some(true),
        gray: true,
        runs: &[
            FrameStage::PROJECT,
            FrameStage::PULL_PUSH,
            FrameStage::APPLY,
            FrameStage::FLATTEN,
            FrameStage::SPLAT,
            FrameStage::COMPOSITE,
        ],
        ..NONE
    },
    Scene {
        name: "no light, a sky that changes",
        sky: true,
        runs: &[
            FrameStage::PULL_PUSH,
            FrameStage::APPLY,
            FrameStage::FLATTEN,
            FrameStage::SPLAT,
            FrameStage::COMPOSITE,
        ],
        ..NONE
    },
    Scene {
        name: "no light, signs that change",
        emission_changes: true,
        runs: &[
            FrameStage::PULL_PUSH,
            FrameStage::APPLY,
            FrameStage::FLATTEN,
            FrameStage::SPLAT,
            FrameStage::COMPOSITE,
        ],
        ..NONE
    },
    Scene {
        name: "a light that moves, a ball that moves",
        light: Some(true),
        ball: true,
        probes_and_visibility: true,
        runs: &[
            FrameStage::PROJECT,
            FrameStage::PULL_PUSH,
            FrameStage::APPLY,
            FrameStage::FLATTEN,
            FrameStage::PROBE_PIXELS,
            FrameStage::SPLAT,
            FrameStage::COMPOSITE,
        ],
        ..NONE
    },
    Scene {
        name: "the same with a forward camera",
        light: Some(true),
        ball: true,
        probes_and_visibility: true,
        forward: true,
        no_deferred: true,
        runs: &[
            FrameStage::PROJECT,
            FrameStage::PULL_PUSH,
            FrameStage::APPLY,
            FrameStage::FLATTEN,
            FrameStage::VOLUME,
        ],
        ..NONE
    },
    Scene {
        name: "a light that moves, in fog",
        light: Some(true),
        probes_and_visibility: true,
        fog: true,
        runs: &[
            FrameStage::PROJECT,
            FrameStage::PULL_PUSH,
            FrameStage::APPLY,
            FrameStage::FLATTEN,
            FrameStage::PROBE_PIXELS,
            FrameStage::VOLUME,
            FrameStage::SPLAT,
            FrameStage::COMPOSITE,
            FrameStage::FOG,
        ],
        ..NONE
    },
    Scene {
        name: "a light at rest, a screen that opens and closes",
        light: Some(false),
        screen: true,
        runs: &[
            FrameStage::OCCLUDE,
            FrameStage::PROJECT,
            FrameStage::PULL_PUSH,
            FrameStage::APPLY,
            FrameStage::FLATTEN,
            FrameStage::SPLAT,
            FrameStage::COMPOSITE,
        ],
        ..NONE
    },
    Scene {
        name: "a panel that moves, with soft shadows",
        panel: true,
        probes_and_visibility: true,
        runs: &[
            FrameStage::PROJECT,
            FrameStage::PULL_PUSH,
            FrameStage::APPLY,
            FrameStage::FLATTEN,
            FrameStage::PROBE_PIXELS,
            FrameStage::SOFT_SHADOW,
            FrameStage::SPLAT,
            FrameStage::COMPOSITE,
            FrameStage::SUBTRACT_SHADOW,
        ],
        ..NONE
    },
    Scene {
        name: "everything at once",
        light: Some(true),
        color: true,
        sky: true,
        emission_changes: true,
        ball: true,
        bounce: true,
        panel: true,
        screen: true,
        forward: true,
        probes_and_visibility: true,
        fog: true,
        runs: &[
            FrameStage::OCCLUDE,
            FrameStage::PROJECT,
            FrameStage::PULL_PUSH,
            FrameStage::APPLY,
            FrameStage::FLATTEN,
            FrameStage::PROBE_PIXELS,
            FrameStage::VOLUME,
            FrameStage::SOFT_SHADOW,
            FrameStage::RSM,
            FrameStage::SPLAT,
            FrameStage::VPL,
            FrameStage::COMPOSITE,
            FrameStage::SUBTRACT_SHADOW,
            FrameStage::FOG,
        ],
        ..NONE
    },
];

const NONE: Scene = Scene {
    name: "",
    light: None,
    color: false,
    sky: false,
    emission_changes: false,
    ball: false,
    bounce: false,
    panel: false,
    screen: false,
    forward: false,
    no_deferred: false,
    fog: false,
    probes_and_visibility: false,
    gray: false,
    runs: &[],
};

/// Returns the Cornell box with a sign on its back wall, in color or gray.
fn quads(gray: bool) -> Vec<Quad> {
    let mut quads = Quad::cornell_box();
    let low = Vec3::new(-0.4, 1.3, -0.98);
    quads.push(Quad {
        corners: [
            low,
            low + Vec3::X * 0.8,
            low + Vec3::X * 0.8 + Vec3::Y * 0.2,
            low + Vec3::Y * 0.2,
        ],
        material: Material::emissive(Vec3::splat(0.1), Vec3::new(1.0, 0.2, 0.5)),
    });
    for material in quads.iter_mut().map(|q| &mut q.material).filter(|_| gray) {
        let gray = |color: Vec3| Vec3::splat(color.max_element());
        material.base_color = gray(material.base_color.truncate()).extend(material.base_color.w);
        material.emissive = gray(material.emissive);
    }
    quads
}

/// Bakes of the box.
pub struct Bakes {
    /// Bakes with and without probes and visibility, with and without a screen.
    by_content: [[Arc<BakedScene>; 2]; 2],
    /// Gray bake without probes, visibility and screen.
    gray: Arc<BakedScene>,
}

/// Bakes the box by `recipe`: without and with probes and visibility, each without and with a
/// screen, and in gray.
///
/// # Errors
/// Returns a message if a bake fails.
pub fn bakes(recipe: &Recipe) -> Result<Bakes, String> {
    let bake = |probes_and_visibility: bool, screen: bool, gray: bool| {
        let mut recipe = recipe.clone();
        if !probes_and_visibility {
            (recipe.probes, recipe.soft_shadows) = (None, None);
        }
        if screen {
            recipe.occluders = vec![OccluderDesc {
                name: "screen".into(),
                boxes: vec![OccluderBox {
                    center: [-0.5, 0.6, 0.2],
                    half_edges: [0.01, 0.5, 0.6],
                }],
            }];
        }
        let mesh = TriangleMesh::from_quads(&quads(gray));
        let made = bake_scene(&mesh, &recipe, 0, &Progress::default());
        made.map(|b| Arc::new(b.scene)).map_err(|e| e.to_string())
    };
    Ok(Bakes {
        by_content: [
            [bake(false, false, false)?, bake(false, true, false)?],
            [bake(true, false, false)?, bake(true, true, false)?],
        ],
        gray: bake(false, false, true)?,
    })
}

/// Moving entity, with its start.
#[derive(Component)]
pub struct Moves(Vec3);

/// Spawns a scene into an empty world.
pub fn spawn(app: &mut App, scene: &Scene, bakes: &Bakes, size: UVec2) {
    let world = app.world_mut();
    if scene.no_deferred {
        world.insert_resource(DefaultOpaqueRendererMethod::forward());
    }
    let bake = match scene.gray {
        true => &bakes.gray,
        false => {
            &bakes.by_content[usize::from(scene.probes_and_visibility)][usize::from(scene.screen)]
        }
    };
    let scene_data = bake.clone();
    let asset = (world.resource_mut::<Assets<_>>()).add(GiBakedScene { scene: scene_data });
    let mut root = world.spawn((GiScene(asset), Transform::IDENTITY));
    if scene.forward || scene.fog {
        root.insert(GiIrradianceVolume {
            max_voxels: 4096,
            ..default()
        });
    }
    if scene.fog {
        root.insert(GiVolumetricFog::default());
    }
    let root = root.id();
    world
        .run_system_cached_with(room, (root, scene.gray))
        .expect("a room");
    if scene.screen {
        world.spawn(GiOccluder {
            name: "screen".into(),
            transmittance: 1.0,
        });
    }
    spawn_lights(world, scene);
    if scene.ball {
        let position = Vec3::new(-0.2, 1.4, 0.5);
        let mesh = world
            .resource_mut::<Assets<Mesh>>()
            .add(Sphere::new(0.2).mesh());
        let material = world
            .resource_mut::<Assets<StandardMaterial>>()
            .add(StandardMaterial {
                base_color: Color::linear_rgb(0.8, 0.3, 0.1),
                perceptual_roughness: 1.0,
                ..default()
            });
        let mut ball = world.spawn((
            Mesh3d(mesh),
            MeshMaterial3d(material),
            Transform::from_translation(position),
            Moves(position),
        ));
        if scene.bounce {
            ball.insert(GiReflector);
        }
    }
    if scene.fog {
        // Bevy draws fog if a light is volumetric.
        let sun = DirectionalLight {
            illuminance: 0.0,
            ..default()
        };
        world.spawn((sun, VolumetricLight));
        let position = Transform::from_translation(Vec3::Y).with_scale(Vec3::splat(2.0));
        let fog = FogVolume {
            density_factor: 0.3,
            ..default()
        };
        world.spawn((fog, position));
    }
    spawn_cameras(world, scene, size);
}

fn spawn_lights(world: &mut World, scene: &Scene) {
    if let Some(moves) = scene.light {
        let position = Vec3::new(0.3, 1.6, 0.4);
        let mut light = world.spawn((
            PointLight {
                intensity: 40_000.0,
                ..default()
            },
            Transform::from_translation(position),
        ));
        if moves {
            light.insert(Moves(position));
        }
        if scene.bounce {
            light.insert(GiReflectiveShadowMap::default());
        }
    }
    if scene.panel {
        let position = Vec3::new(0.0, 1.9, 0.0);
        let down = Transform::from_translation(position).looking_to(Vec3::NEG_Y, Vec3::Z);
        world.spawn((
            RectLight {
                intensity: 20_000.0,
                width: 0.5,
                height: 0.4,
                ..default()
            },
            GiSoftShadow::default(),
            down,
            Moves(position),
        ));
    }
}

fn spawn_cameras(world: &mut World, scene: &Scene, size: UVec2) {
    let eye = Transform::from_xyz(0.0, 1.0, 4.0).looking_at(Vec3::Y, Vec3::Y);
    let mut target = || {
        let mut image =
            Image::new_target_texture(size.x, size.y, TextureFormat::Rgba8UnormSrgb, None);
        image.texture_descriptor.usage |= TextureUsages::COPY_SRC;
        let image = RenderTarget::Image(world.resource_mut::<Assets<Image>>().add(image).into());
        (Camera3d::default(), image, eye)
    };
    let [deferred, forward] = [target(), target()];
    let deferred = (!scene.no_deferred).then(|| world.spawn((deferred, GiCamera::default())).id());
    let forward = (scene.forward).then(|| world.spawn((forward, Hdr, Msaa::Sample4)).id());
    let cameras = [deferred, forward].into_iter().flatten();
    for camera in cameras.filter(|_| scene.fog) {
        let fog = VolumetricFog {
            ambient_intensity: 0.0,
            ..default()
        };
        world.entity_mut(camera).insert(fog);
    }
}

fn room(
    In((root, gray)): In<(Entity, bool)>,
    mut commands: Commands,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    let root = &mut commands.entity(root);
    crate::common::spawn_quads(&quads(gray), root, &mut meshes, &mut materials);
}

/// Applies the changes from frame `k - 1` to frame `k`.
pub fn step(app: &mut App, scene: &Scene, k: u32) {
    let world = app.world_mut();
    let (sine, cosine) = (0.3 * k as f32).sin_cos();
    let mut moving = world.query::<(&Moves, &mut Transform)>();
    for (moves, mut transform) in moving.iter_mut(world) {
        transform.translation = moves.0 + 0.1 * Vec3::new(cosine, 0.0, sine);
    }
    if scene.color {
        let mut lights = world.query::<&mut PointLight>();
        for mut light in lights.iter_mut(world) {
            light.color = Color::linear_rgb(1.0, 0.6 + 0.4 * sine, 0.6 + 0.4 * cosine);
        }
    }
    let mut screens = world.query::<&mut GiOccluder>();
    for mut screen in screens.iter_mut(world) {
        screen.transmittance = 0.5 + 0.5 * sine;
    }
    let mut roots = world.query::<&mut GiEnvironment>();
    for mut environment in roots.iter_mut(world) {
        if scene.sky {
            environment.sky = GiSky::Uniform(LinearRgba::rgb(300.0, 300.0, 400.0 + 50.0 * sine));
        }
        if scene.emission_changes {
            environment.emissive_luminance = 998.0 * (1.0 + 0.5 * sine);
        }
    }
}
