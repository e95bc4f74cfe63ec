//! Camera: start position, direction, exposure, and walking.

use super::drop::{CurrentScene, DefaultLight};
use bevy::camera::Exposure;
use bevy::input::mouse::AccumulatedMouseMotion;
use bevy::prelude::*;
use bevy_meshless_gi::prelude::*;
use meshless_gi::{BakedScene, Bounds, Bvh, CpuFrame, FrameLight, FrameSettings, Light, Ray};
use std::f32::consts::{PI, TAU};

/// Camera of the example, with its transform when the scene was loaded.
#[derive(Component, Default)]
pub struct Eye {
    start: Transform,
}

/// Number of horizontal directions that are compared.
const DIRECTIONS: usize = 16;
/// Approximate number of points of the bake that are used.
const SAMPLES: usize = 2048;
/// Cosine of half the angle of view in which brightness is compared.
const VIEW: f32 = 0.8;
/// Mean luminance of the picture relative to white.
const GRAY: f32 = 0.18;

pub fn set_up(mut commands: Commands) {
    commands.spawn((
        Eye::default(),
        Camera3d::default(),
        IsDefaultUiCamera,
        GiCamera::default(),
        Exposure::default(),
    ));
}

impl Eye {
    /// Moves the camera near the middle of a scene without a bake.
    pub fn move_to_middle(world: &mut World, bounds: &Bounds, size: f32) {
        let extent = bounds.size();
        let at = bounds.center() + Vec3::new(0.25 * extent.x, -0.1 * extent.y, 0.0);
        let start = Transform::from_translation(at).looking_at(bounds.center(), Vec3::Y);
        let projection = Projection::from(PerspectiveProjection {
            near: 1e-3 * size,
            ..default()
        });
        let mut eyes = world.query_filtered::<Entity, With<Eye>>();
        for eye in eyes.iter(world).collect::<Vec<_>>() {
            let parts = (Eye { start }, start, projection.clone());
            world.entity_mut(eye).insert(parts);
        }
    }
}

/// Moves the camera to a viewpoint with clearance after a bake. Turns it to the direction in which
/// most of the scene is visible and lit, and sets its exposure. Also moves the light of a scene
/// without lights. A camera that was moved by hand stays.
pub fn look_at_light(
    event: On<GiBakeFinished>,
    mut scenes: Query<(&GiScene, &mut GiEnvironment)>,
    bakes: Res<Assets<GiBakedScene>>,
    current: Res<CurrentScene>,
    mut eye: Single<(&Eye, &mut Transform, &mut Exposure), Without<DefaultLight>>,
    mut default_light: Query<(&PointLight, &mut Transform), With<DefaultLight>>,
) {
    let (Ok((gi, mut environment)), Ok(_)) = (scenes.get_mut(event.entity), &event.result) else {
        return;
    };
    let Some(bake) = bakes.get(&gi.0) else {
        return;
    };
    let bake = &bake.scene;
    let (eye, transform, exposure) = &mut *eye;
    let at_start = **transform == eye.start;
    let outlooks = Outlook::all(bake);
    let mut default_light = default_light.iter_mut().next();
    let best = LitPoints::new(bake, &current.lights_with(None)).best(bake, &outlooks);
    if let (true, Some(best)) = (at_start, best) {
        **transform = Transform::from_translation(best.from).looking_to(best.toward, Vec3::Y);
        if let Some((_, transform)) = &mut default_light {
            transform.translation = best.from + 0.4 * best.forward_clearance * best.toward;
        }
    }
    let lights = current.lights_with(
        default_light
            .as_ref()
            .map(|(light, at)| (*light, at.translation)),
    );
    let lit = LitPoints::new(bake, &lights);
    let seen = lit.seen(bake, transform.translation);
    if let Some(ev100) = exposure_of(&luminances_toward(&seen, transform.forward().into())) {
        exposure.ev100 = ev100;
        // Bevy displays emissive surfaces independently of the exposure. Their light follows that.
        environment.emissive_luminance = 1.2 * ev100.exp2();
    }
}

/// Viewpoint of the bake and a horizontal direction.
#[derive(Clone, Copy)]
struct Outlook {
    from: Vec3,
    toward: Vec3,
    /// Distance to the scene straight ahead, in meters.
    forward_clearance: f32,
}

impl Outlook {
    /// Returns the directions of the viewpoints with at least half of the largest clearance, except
    /// directions out of the scene.
    fn all(scene: &BakedScene) -> Vec<Self> {
        let far = diagonal(scene);
        let viewpoints = scene.info().viewpoints.iter().take(64);
        let rated: Vec<(Vec3, f32)> = viewpoints
            .map(|at| Vec3::from_array(*at))
            .map(|at| (at, clearance(&scene.data().bvh, at, far)))
            .collect();
        let largest = rated.iter().map(|(_, clear)| *clear).fold(0.0, f32::max);
        let wide = rated.iter().filter(|(_, clear)| *clear >= 0.5 * largest);
        let mut all = Vec::new();
        for (from, _) in wide {
            for toward in directions() {
                all.push(Self {
                    from: *from,
                    toward,
                    forward_clearance: free_distance(&scene.data().bvh, *from, toward, far),
                });
            }
        }
        all.retain(|outlook| outlook.forward_clearance < far);
        all
    }
}

fn diagonal(scene: &BakedScene) -> f32 {
    let [low, high] = scene.info().bounds.map(Vec3::from_array);
    (high - low).length()
}

fn directions() -> impl Iterator<Item = Vec3> {
    (0..DIRECTIONS).map(|i| Quat::from_rotation_y(i as f32 * TAU / DIRECTIONS as f32) * Vec3::NEG_Z)
}

/// Returns the approximate distance from a position to the nearest surface, in meters.
fn clearance(bvh: &Bvh, from: Vec3, far: f32) -> f32 {
    const RAYS: usize = 48;
    let ray = |i: usize| {
        // Directions of a Fibonacci spiral.
        let z = 1.0 - (2.0 * i as f32 + 1.0) / RAYS as f32;
        let (sine, cosine) = (i as f32 * PI * (3.0 - 5f32.sqrt())).sin_cos();
        let r = (1.0 - z * z).sqrt();
        free_distance(bvh, from, Vec3::new(r * cosine, z, r * sine), far)
    };
    (0..RAYS).map(ray).fold(far, f32::min)
}

/// Returns the distance from a position to the first surface in a direction, to 0.1 % of `far`.
/// Returns `far` if there is none.
fn free_distance(bvh: &Bvh, from: Vec3, toward: Vec3, far: f32) -> f32 {
    let meets = |distance| bvh.is_occluded(&Ray::segment(from, toward, distance));
    if !meets(far) {
        return far;
    }
    let (mut open, mut closed) = (0.0, far);
    for _ in 0..10 {
        let middle = 0.5 * (open + closed);
        if meets(middle) {
            closed = middle;
        } else {
            open = middle;
        }
    }
    open
}

/// Points of the bake that receive light: positions, normals and luminances in cd/m².
struct LitPoints(Vec<(Vec3, Vec3, f32)>);

impl LitPoints {
    /// Solves the light once on the CPU.
    fn new(scene: &BakedScene, lights: &[Light]) -> Self {
        let slots: Vec<FrameLight> = (lights.iter())
            .flat_map(|light| FrameLight::expand(light, 16))
            .collect();
        let mut frame = CpuFrame::new(scene);
        frame.set_lights(scene, &slots);
        let settings = FrameSettings {
            emission: 0.0,
            ..FrameSettings::bounces(4)
        };
        frame.solve(scene, &settings);
        let step = (scene.data().points.len() / SAMPLES).max(1);
        let indices = (0..scene.data().points.len()).step_by(step);
        let points = indices.filter_map(|i| {
            let (x, n) = (scene.data().points[i].x(), scene.data().points[i].n());
            let irradiance = frame.irradiance(scene, x, n)? + frame.direct(scene, x, n);
            let albedo = Vec3::from_array(scene.data().surfaces[i].albedo);
            let radiance = albedo * irradiance / PI;
            let luminance = radiance.dot(Vec3::new(0.2126, 0.7152, 0.0722));
            luminance.is_finite().then_some((x, n, luminance))
        });
        Self(points.collect())
    }

    /// Returns directions and luminances of the points that are visible from a position.
    fn seen(&self, scene: &BakedScene, from: Vec3) -> Vec<(Vec3, f32)> {
        let visible = |(x, n, luminance): &(Vec3, Vec3, f32)| {
            let distance = x.distance(from);
            let toward = (x - from) / distance.max(1e-6);
            // Front side, without an occluder except the surface itself in the last 1 %.
            let clear = || {
                let ray = Ray::segment(from, toward, 0.99 * distance);
                !scene.data().bvh.is_occluded(&ray)
            };
            (toward.dot(*n) < 0.0 && clear()).then_some((toward, *luminance))
        };
        self.0.iter().filter_map(visible).collect()
    }

    /// Returns the outlook with the most visible points of the bake, weighted by the fourth root of
    /// luminance. Points are dense where a scene has detail.
    fn best(&self, scene: &BakedScene, outlooks: &[Outlook]) -> Option<Outlook> {
        let mut best: Option<(f32, Outlook)> = None;
        for same in outlooks.chunk_by(|a, b| a.from == b.from) {
            let seen = self.seen(scene, same[0].from);
            for outlook in same {
                let found = luminances_toward(&seen, outlook.toward);
                let mean = found.iter().sum::<f32>() / found.len().max(1) as f32;
                let score = found.len() as f32 * (mean + 1e-6).powf(0.25);
                if found.len() >= 8 && best.is_none_or(|(max, _)| score > max) {
                    best = Some((score, *outlook));
                }
            }
        }
        best.map(|(_, outlook)| outlook)
    }
}

/// Returns the luminances of the points around a direction.
fn luminances_toward(seen: &[(Vec3, f32)], toward: Vec3) -> Vec<f32> {
    let inside = seen.iter().filter(|(way, _)| way.dot(toward) > VIEW);
    inside.map(|(_, luminance)| *luminance).collect()
}

/// Returns the exposure (EV100) that maps mean luminance to middle gray. Returns `None` in the
/// dark.
fn exposure_of(luminances: &[f32]) -> Option<f32> {
    let lit: Vec<f32> = (luminances.iter().copied())
        .filter(|luminance| *luminance > 1e-4)
        .collect();
    if lit.is_empty() {
        return None;
    }
    let mean = lit.iter().map(|l| l.ln()).sum::<f32>() / lit.len() as f32;
    // Bevy multiplies luminance by 1 / (1.2 · 2^EV100).
    Some((mean.exp() / (1.2 * GRAY)).log2().clamp(-4.0, 16.0))
}

/// Returns 1, −1 or 0 from two keys.
pub fn axis(keys: &ButtonInput<KeyCode>, plus: KeyCode, minus: KeyCode) -> f32 {
    f32::from(u8::from(keys.pressed(plus))) - f32::from(u8::from(keys.pressed(minus)))
}

pub fn walk(
    mut camera: Single<&mut Transform, With<Eye>>,
    keys: Res<ButtonInput<KeyCode>>,
    buttons: Res<ButtonInput<MouseButton>>,
    mouse: Res<AccumulatedMouseMotion>,
    time: Res<Time>,
) {
    if buttons.pressed(MouseButton::Right) && mouse.delta != Vec2::ZERO {
        let (yaw, pitch, _) = camera.rotation.to_euler(EulerRot::YXZ);
        let pitch = (pitch - 0.003 * mouse.delta.y).clamp(-1.5, 1.5);
        camera.rotation = Quat::from_euler(EulerRot::YXZ, yaw - 0.003 * mouse.delta.x, pitch, 0.0);
    }
    if keys.any_pressed([KeyCode::ControlLeft, KeyCode::ControlRight]) {
        return;
    }
    let step = Vec3::new(
        axis(&keys, KeyCode::KeyD, KeyCode::KeyA),
        axis(&keys, KeyCode::KeyE, KeyCode::KeyQ),
        axis(&keys, KeyCode::KeyS, KeyCode::KeyW),
    );
    if step == Vec3::ZERO {
        return;
    }
    let speed = match keys.pressed(KeyCode::ShiftLeft) {
        true => 8.0,
        false => 2.0,
    };
    let way = camera.rotation * step;
    camera.translation += way * speed * time.delta_secs();
}
