//! Lamps where they should not be, too strong, and too many.

use super::support::{baked, closed, cornell, irradiances, mean, mesh, room, small};
use bevy_meshless_gi::accuracy::{Bounces, Evaluator};
use bevy_meshless_gi::asset::BakedScene;
use bevy_meshless_gi::frame::{CpuFrame, FrameLight, FrameSettings, SplatParams, splat};
use bevy_meshless_gi::samples::Random;
use bevy_meshless_gi::scene::{Light, Material};
use glam::{Mat4, Vec3};
use std::f32::consts::PI;

fn lamp(x: Vec3, intensity: f32) -> FrameLight {
    FrameLight::point(x, Vec3::splat(intensity), f32::INFINITY)
}

/// Mean of the light that was reflected once, over that of a lamp of 1 W/sr in a closed room of 2 m that reflects half of it: ρ Φ / A, wherever the
/// lamp is.
fn share(scene: &BakedScene, frame: &mut CpuFrame, x: Vec3) -> f32 {
    frame.set_lights(scene, &[lamp(x, 1.0)]);
    frame.solve(scene, &FrameSettings::bounces(1));
    let right = 0.5 * 4.0 * PI / 24.0;
    mean(&irradiances(frame, scene), scene).x / right
}
