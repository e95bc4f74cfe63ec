//! Lights at invalid positions, too strong, and too many.

use super::support::{baked, closed, cornell, irradiances, mean, mesh, room, small};
use glam::Vec3;
use meshless_gi::internals::frame::splat;
use meshless_gi::internals::samples::Random;
use meshless_gi::{
    BakedScene, Bounces, CpuFrame, Evaluator, FrameLight, FrameSettings, Light, Material, Recipe,
};
use std::f32::consts::PI;

fn light_source(x: Vec3, intensity: f32) -> FrameLight {
    FrameLight::point(x, Vec3::splat(intensity), f32::INFINITY)
}

/// Returns the mean of the light reflected once, relative to that of a light of 1 W/sr in a closed
/// room. The room has 2 m edges and reflects half of the light: ρ Φ / A for any position of the
/// light.
fn relative_reflected_light(scene: &BakedScene, frame: &mut CpuFrame, x: Vec3) -> f32 {
    frame.set_lights(scene, &[light_source(x, 1.0)]);
    frame.solve(scene, &FrameSettings::bounces(1));
    let right = 0.5 * 4.0 * PI / 24.0;
    mean(&irradiances(frame, scene), scene).x / right
}

#[test]
fn light_near_surface_conserves_energy() {
    let recipe = Recipe {
        samples_per_sender: Some(16),
        ..small()
    };
    let scene = baked(&closed(Material::diffuse(Vec3::splat(0.5))), &recipe).scene;
    let mut frame = CpuFrame::new(&scene);
    let mut along = |height: f32| -> (f32, f32, f32) {
        let all: Vec<f32> = (0..32)
            .map(|k| {
                let (a, b) = (0.0137 * k as f32, 0.0191 * k as f32);
                relative_reflected_light(&scene, &mut frame, Vec3::new(0.8 + a, height, 0.7 + b))
            })
            .collect();
        let mean = all.iter().sum::<f32>() / all.len() as f32;
        let min = all.iter().copied().fold(f32::INFINITY, f32::min);
        (mean, min, all.iter().copied().fold(0.0, f32::max))
    };
    for height in [1.0, 0.1, 0.02, 1e-3, 1e-4] {
        let (mean, min, max) = along(height);
        eprintln!("{height} m above the floor: {mean:.3} of the light, {min:.3} to {max:.3}");
        assert!((mean - 1.0).abs() < 0.03, "{height}: {mean}");
        assert!(min > 0.85 && max < 1.15, "{height}: {min} to {max}");
    }
    // In the plane of the floor the light emits half of its flux past the floor. Behind the floor
    // it lights nothing.
    let (mean, min, max) = along(0.0);
    assert!((mean - 0.5).abs() < 0.02 && max - min < 0.02, "{mean}");
    assert_eq!(along(-1e-3).2, 0.0);
}

/// Each of the walls of a corner is lit as if the light were in the middle of it. Light toward the
/// other walls is lost, and never gained.
#[test]
fn light_in_corner_loses_only_mutual_wall_light() {
    let bake = baked(&closed(Material::diffuse(Vec3::splat(0.5))), &small());
    let mut frame = CpuFrame::new(&bake.scene);
    for (off, min, max) in [(0.3, 0.95, 1.05), (0.05, 0.4, 1.1), (1e-3, 0.35, 1.1)] {
        let [edge, corner] = [Vec3::new(off, off, 0.9), Vec3::splat(off)]
            .map(|x| relative_reflected_light(&bake.scene, &mut frame, x));
        eprintln!("{off} m from two walls: {edge:.3} of the light; from three: {corner:.3}");
        assert!((min..max).contains(&corner), "{off}: {corner}");
        assert!((min..max).contains(&edge), "{off}: {edge}");
    }
}

/// Two rooms with 1 cm between them: a light in the gap, in the plane of a wall or a millimeter
/// behind one, lights nothing of the room beyond.
#[test]
fn light_behind_wall_gives_zero_in_front() {
    let mut triangles = room(Vec3::ZERO, Vec3::new(2.0, 2.0, 2.0));
    triangles.extend(room(Vec3::new(2.01, 0.0, 0.0), Vec3::new(2.0, 2.0, 2.0)));
    let level = mesh(triangles, Material::diffuse(Vec3::splat(0.5)));
    let recipe = Recipe {
        viewpoints: vec![[1.0; 3], [3.0, 1.0, 1.0]],
        ..small()
    };
    let scene = baked(&level, &recipe).scene;
    let mut frame = CpuFrame::new(&scene);
    for x in [2.001, 2.005, 2.009, 2.01, 2.011] {
        frame.set_lights(&scene, &[light_source(Vec3::new(x, 1.0, 1.0), 1.0)]);
        let max = |left: bool| -> f32 {
            let senders = frame.projected(0).iter().zip(&scene.data().points);
            let side = senders.filter(|(_, p)| (p.x().x < 2.005) == left);
            side.map(|(e, _)| *e).fold(0.0, f32::max)
        };
        assert_eq!(max(true), 0.0, "{x}");
        assert_eq!(max(false) > 0.0, x >= 2.01, "{x}");
    }
}

#[test]
fn light_contrast_of_million_fits_f16() {
    let scene = baked(&cornell(1.0, Vec3::ZERO), &small()).scene;
    let mut frame = CpuFrame::new(&scene);
    let mut solved = |light_sources: &[FrameLight]| {
        frame.set_lights(&scene, light_sources);
        frame.solve(&scene, &FrameSettings::bounces(4));
        irradiances(&frame, &scene)
    };
    let x = Vec3::new(-0.3, 1.7, 0.5);
    let (dim, bright) = (
        solved(&[light_source(x, 1.0)]),
        solved(&[light_source(x, 1e6)]),
    );
    let far = solved(&[light_source(Vec3::new(0.5, 0.2, 0.9), 1e6)]);
    let both = solved(&[
        light_source(x, 1.0),
        light_source(Vec3::new(0.5, 0.2, 0.9), 1e6),
    ]);
    // Screen value at an exposure that just holds the bright one.
    let max = bright.iter().map(|e| e.max_element()).fold(0.0, f32::max);
    let exposure = 60_000.0 / max;
    let mut compared = 0;
    for k in 0..dim.len() {
        let (a, b) = (dim[k].y, bright[k].y);
        assert!((b - 1e6 * a).abs() <= 1e-5 * b.abs());
        assert!((both[k].y - (far[k].y + a)).abs() <= 1e-5 * far[k].y.abs().max(a.abs()));
        let half = half::f16::from_f32(exposure * a).to_f32();
        // The smallest normal half is 6e-5: darker values keep fewer digits.
        if exposure * a > 6.2e-5 {
            compared += 1;
            assert!((half / (exposure * a) - 1.0).abs() < 1e-3);
        }
        assert!(half::f16::from_f32(exposure * b).is_finite());
    }
    assert!(2 * compared > dim.len(), "{compared} of {}", dim.len());
}

/// Light of a pixel stays within the range of 16-bit floats and is never NaN, for any brightness.
#[test]
fn bright_lights_stay_finite_in_f16() {
    let glare = Material::emissive(Vec3::splat(0.9), Vec3::splat(f32::MAX));
    let scene = baked(&closed(glare), &small()).scene;
    let mut frame = CpuFrame::new(&scene);
    let lights = |intensity: f32| {
        let at = |x: f32| Vec3::new(x, 1e-3, 1.0);
        [
            light_source(at(0.5), intensity),
            light_source(at(1.5), intensity),
            FrameLight::directional(Vec3::NEG_Y, Vec3::splat(intensity)),
            FrameLight::patch(at(1.0), Vec3::Y, Vec3::splat(intensity)),
        ]
    };
    for intensity in [
        1e30,
        f32::MAX,
        f32::INFINITY,
        f32::NAN,
        f32::MIN_POSITIVE,
        1e-45,
    ] {
        frame.set_lights(&scene, &lights(intensity));
        for sky in [Vec3::ZERO, Vec3::splat(f32::MAX), Vec3::splat(f32::NAN)] {
            for sweeps in [0, 3, 255] {
                let settings = FrameSettings {
                    sweeps,
                    sky: sky.into(),
                    emission: f32::MAX,
                    ..FrameSettings::default()
                };
                frame.solve(&scene, &settings);
                irradiances(&frame, &scene);
            }
            frame.converge(
                &scene,
                &FrameSettings {
                    sky: sky.into(),
                    ..FrameSettings::default()
                },
                1e-3,
            );
            irradiances(&frame, &scene);
        }
    }
    let strong = Light::Point {
        position: Vec3::ONE,
        intensity: Vec3::splat(f32::MAX),
        range: 1e-30,
    };
    let evaluator = Evaluator::new(&scene, &[], &[strong], Bounces::All);
    for x in [Vec3::ONE, Vec3::new(1.0, 0.0, 1.0), Vec3::splat(1e30)] {
        let found = evaluator.at(x, Vec3::Y, 0);
        assert!(found.direct.is_finite() && found.indirect.unwrap_or_default().is_finite());
    }
    // The brightest lights, on the screen.
    frame.set_lights(&scene, &lights(1e30));
    frame.solve(&scene, &FrameSettings::bounces(4));
    let e = splat::splat(
        &scene.data().points,
        &scene.data().display,
        frame.vector_irradiance(),
        Vec3::new(1.0, 0.0, 1.0),
        Vec3::Y,
    );
    let half = e.expect("covered").min(Vec3::splat(splat::MAX_HALF));
    assert_eq!(half, Vec3::splat(splat::MAX_HALF));
}

#[test]
fn many_lights_equal_their_sum() {
    const LIGHT_SOURCES: usize = 2000;
    let recipe = Recipe {
        coarse_radius: Some(0.5),
        ..small()
    };
    let scene = baked(&closed(Material::diffuse(Vec3::splat(0.5))), &recipe).scene;
    let mut random = Random::new(7, 0, 0);
    let mut unit = || 0.2 + 1.6 * random.unit();
    let light_sources: Vec<FrameLight> = (0..LIGHT_SOURCES)
        .map(|_| {
            light_source(
                Vec3::new(unit(), unit(), unit()),
                1.0 / LIGHT_SOURCES as f32,
            )
        })
        .collect();
    let mut frame = CpuFrame::new(&scene);
    let mut solved = |light_sources: &[FrameLight]| {
        frame.set_lights(&scene, light_sources);
        frame.solve(&scene, &FrameSettings::bounces(1));
        irradiances(&frame, &scene)
    };
    let whole = solved(&light_sources);
    let halves = [
        solved(&light_sources[..LIGHT_SOURCES / 2]),
        solved(&light_sources[LIGHT_SOURCES / 2..]),
    ];
    for (k, e) in whole.iter().enumerate() {
        let sum = halves[0][k] + halves[1][k];
        assert!((*e - sum).abs().max_element() <= 1e-5 * sum.max_element());
    }
    let share = mean(&whole, &scene).x / (0.5 * 4.0 * PI / 24.0);
    eprintln!("{LIGHT_SOURCES} lights: {share:.4} of their light");
    // With senders a quarter of a meter apart.
    assert!((share - 1.0).abs() < 0.03, "{share}");
    // All in one position, they are one light.
    let position = Vec3::new(0.7, 1.1, 1.3);
    let together = solved(&vec![
        light_source(position, 1.0 / LIGHT_SOURCES as f32);
        LIGHT_SOURCES
    ]);
    for (e, one) in together.iter().zip(solved(&[light_source(position, 1.0)])) {
        assert!((*e - one).abs().max_element() <= 2e-5 * one.max_element());
    }
}
