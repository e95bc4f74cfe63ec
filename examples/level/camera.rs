//! The camera: where it starts, where it looks, its exposure, and walking.

use super::drop::{Lamp, Level};
use bevy::camera::Exposure;
use bevy::input::mouse::AccumulatedMouseMotion;
use bevy::prelude::*;
use bevy_meshless_gi::asset::BakedScene;
use bevy_meshless_gi::frame::{CpuFrame, FrameLight, FrameSettings};
use bevy_meshless_gi::prelude::*;
use bevy_meshless_gi::scene::{Bounds, Bvh, Light, Ray};
use std::f32::consts::{PI, TAU};

/// The camera of the example, and where it stood when the level came.
#[derive(Component, Default)]
pub struct Eye {
    start: Transform,
}

/// Horizontal directions that are compared.
const DIRECTIONS: usize = 16;
/// Points of the bake that are looked at, about.
const SAMPLES: usize = 2048;
/// Cosine of half the angle of view in which brightness is compared.
const VIEW: f32 = 0.8;
/// Luminance of the picture's mean over the luminance of white.
const GRAY: f32 = 0.18;

pub fn set_up(mut commands: Commands) {
    commands.spawn((
        Eye::default(),
        Camera3d::default(),
        IsDefaultUiCamera,
        MeshlessGiCamera::default(),
        Exposure::default(),
    ));
}

impl Eye {
    /// Puts the camera into a level without a bake: near the middle of its box.
    pub fn place(world: &mut World, bounds: &Bounds, size: f32) {
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

/// After a bake: moves the camera to the viewpoint with most room, turns it to the light, and sets its exposure. A camera that was moved by
/// hand stays.
pub fn look_at_light(
    event: On<MeshlessGiBakeFinished>,
    mut scenes: Query<(&MeshlessGi, &mut MeshlessGiLighting)>,
    bakes: Res<Assets<MeshlessGiAsset>>,
    level: Res<Level>,
    mut eye: Single<(&Eye, &mut Transform, &mut Exposure), Without<Lamp>>,
    mut lamp: Query<(&PointLight, &mut Transform), With<Lamp>>,
) {
    let (Ok((gi, mut lighting)), Ok(_)) = (scenes.get_mut(event.entity), &event.result) else {
        return;
    };
    let Some(bake) = bakes.get(&gi.0) else {
        return;
    };
    let bake = &bake.scene;
    let (eye, transform, exposure) = &mut *eye;
    let here = Outlook::of(bake, transform.translation, transform.forward().into());
    let at_start = **transform == eye.start;
    let outlook = match at_start {
        true => Outlook::widest(bake).unwrap_or(here),
        false => here,
    };
    let mut lamp = lamp.iter_mut().next();
    if let Some((_, place)) = lamp.as_mut().filter(|_| at_start) {
        place.translation = outlook.from + 0.4 * outlook.free * outlook.toward;
    }
    let lights = level.lights_with(lamp.as_ref().map(|(light, at)| (*light, at.translation)));
    let seen = Seen::new(bake, &lights, outlook.from);
    if at_start {
        let toward = seen.brightest(bake).unwrap_or(outlook.toward);
        **transform = Transform::from_translation(outlook.from).looking_to(toward, Vec3::Y);
    }
    if let Some(ev100) = seen.exposure(transform.forward().into()) {
        exposure.ev100 = ev100;
        // Bevy shows emissive surfaces alike at any exposure; so shall their light be.
        lighting.emission = 1.2 * ev100.exp2();
    }
}

/// A place, a horizontal direction, and the way to the level in it.
struct Outlook {
    from: Vec3,
    toward: Vec3,
    /// Meters.
    free: f32,
}

impl Outlook {
    fn of(scene: &BakedScene, from: Vec3, toward: Vec3) -> Self {
        let free = free_way(&scene.bvh, from, toward, diagonal(scene));
        Self { from, toward, free }
    }

    /// From the viewpoint with the largest clearance, the direction with the longest way that ends at the level.
    fn widest(scene: &BakedScene) -> Option<Self> {
        let far = diagonal(scene);
        let viewpoints = scene.info.viewpoints.iter().take(64);
        let rated = viewpoints.map(|at| {
            let at = Vec3::from_array(*at);
            (clearance(&scene.bvh, at, far), at)
        });
        let (_, from) = rated.max_by(|a, b| a.0.total_cmp(&b.0))?;
        let outlooks = directions().map(|toward| Self::of(scene, from, toward));
        let inside = outlooks.filter(|outlook| outlook.free < far);
        inside.max_by(|a, b| a.free.total_cmp(&b.free))
    }
}

fn diagonal(scene: &BakedScene) -> f32 {
    let [low, high] = scene.info.bounds.map(Vec3::from_array);
    (high - low).length()
}

fn directions() -> impl Iterator<Item = Vec3> {
    (0..DIRECTIONS).map(|i| Quat::from_rotation_y(i as f32 * TAU / DIRECTIONS as f32) * Vec3::NEG_Z)
}

/// Distance from a place to the nearest surface, about, meters.
fn clearance(bvh: &Bvh, from: Vec3, far: f32) -> f32 {
    const RAYS: usize = 48;
    let ray = |i: usize| {
        // Fibonacci's spiral.
        let z = 1.0 - (2.0 * i as f32 + 1.0) / RAYS as f32;
        let (sine, cosine) = (i as f32 * PI * (3.0 - 5f32.sqrt())).sin_cos();
        let r = (1.0 - z * z).sqrt();
        free_way(bvh, from, Vec3::new(r * cosine, z, r * sine), far)
    };
    (0..RAYS).map(ray).fold(far, f32::min)
}

/// Distance from a place to the first surface in a direction, to a thousandth of `far`; `far` where there is none.
fn free_way(bvh: &Bvh, from: Vec3, toward: Vec3, far: f32) -> f32 {
    let meets = |distance| bvh.occluded(&Ray::segment(from, toward, distance));
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

/// What is seen from a place: directions and luminances of points of the bake, cd/m².
struct Seen {
    from: Vec3,
    points: Vec<(Vec3, f32)>,
}

impl Seen {
    /// Solves the light once on the processor.
    fn new(scene: &BakedScene, lights: &[Light], from: Vec3) -> Self {
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
        let step = (scene.points.len() / SAMPLES).max(1);
        let indices = (0..scene.points.len()).step_by(step);
        let points = indices.filter_map(|i| {
            let (x, n) = (scene.points[i].x(), scene.points[i].n());
            let way = x - from;
            let distance = way.length();
            let toward = way / distance.max(1e-6);
            // The front side, and nothing between: but for the last hundredth, which is the surface itself.
            if toward.dot(n) >= 0.0
                || (scene.bvh).occluded(&Ray::segment(from, toward, 0.99 * distance))
            {
                return None;
            }
            let irradiance = frame.irradiance(scene, x, n)? + frame.direct(scene, x, n);
            let albedo = Vec3::from_array(scene.surfaces[i].albedo);
            let radiance = albedo * irradiance / PI;
            let luminance = radiance.dot(Vec3::new(0.2126, 0.7152, 0.0722));
            luminance.is_finite().then_some((toward, luminance))
        });
        Self {
            from,
            points: points.collect(),
        }
    }

    /// Luminances of the points around a direction.
    fn around(&self, toward: Vec3) -> Vec<f32> {
        let inside = |(way, _): &&(Vec3, f32)| way.dot(toward) > VIEW;
        self.points.iter().filter(inside).map(|p| p.1).collect()
    }

    /// The horizontal direction in which the level is brightest, of those in which it is not close.
    fn brightest(&self, scene: &BakedScene) -> Option<Vec3> {
        let far = diagonal(scene);
        let free: Vec<(Vec3, f32)> = directions()
            .map(|toward| (toward, free_way(&scene.bvh, self.from, toward, far)))
            .filter(|(_, free)| *free < far)
            .collect();
        let longest = free.iter().map(|(_, free)| *free).fold(0.0, f32::max);
        let wide = free.into_iter().filter(|(_, free)| *free >= 0.5 * longest);
        let rated = wide.filter_map(|(toward, _)| {
            let found = self.around(toward);
            let mean = found.iter().sum::<f32>() / found.len() as f32;
            (found.len() >= 8).then_some((mean, toward))
        });
        rated
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .map(|(_, toward)| toward)
    }

    /// The exposure (EV100) that shows the mean luminance around a direction as middle gray; `None` in the dark.
    fn exposure(&self, toward: Vec3) -> Option<f32> {
        let mut found = self.around(toward);
        found.retain(|luminance| *luminance > 1e-4);
        if found.is_empty() {
            return None;
        }
        let mean = found.iter().map(|l| l.ln()).sum::<f32>() / found.len() as f32;
        // Bevy multiplies luminance by 1 / (1.2 · 2^EV100).
        Some((mean.exp() / (1.2 * GRAY)).log2().clamp(-4.0, 16.0))
    }
}

/// 1, −1 or 0 by two keys.
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
