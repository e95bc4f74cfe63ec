//! Gloss of virtual lights on the CPU (\[N09\] §3.3.1): per-light refinement against one list and
//! full resolution. No light is lost, crosses edges or is NaN. Bounds are measured, with a margin.

use meshless_gi_lab::fixtures::gloss as gloss_support;

use glam::{Mat4, Vec3};
use gloss_support::{Scene, evaluated_fraction, room, virtual_lights};
use meshless_gi::SpecularSettings;
use meshless_gi::internals::frame::vpl_specular::{receiver, specular_at, specular_fraction};
use meshless_gi::internals::frame::{Vpl, VplParams, gbuffer};

const SIZE: [u32; 2] = [480, 270];
const SMALL: [u32; 2] = [131, 75];

fn finite(texels: &[[f32; 4]]) {
    for t in texels {
        let sane = t.iter().all(|v| v.is_finite() && *v >= 0.0);
        assert!(sane && (t[3] == 1.0 || *t == [0.0; 4]), "{t:?}");
    }
}

/// FLIP is 0.01 against full resolution with a tenth of its evaluations. One list for all lights
/// takes twice as many evaluations, and its FLIP is hardly lower.
#[test]
fn specular_adaptive_evaluation_matches_full_resolution() {
    let mesh = room();
    for (count, roughness) in [(64, 0.25), (256, 0.25), (64, 0.15)] {
        let scene = Scene::new(SIZE, virtual_lights(&mesh, 64, count), roughness);
        let full = scene.full();
        finite(&full);
        assert!(scene.glossy(&full) * 4 > full.len() as u64);
        let of = |together| {
            let found = scene.run(&SpecularSettings {
                together,
                ..SpecularSettings::default()
            });
            finite(&found.texels);
            let (flip, nrmse) = scene.compare(&full, &found.texels);
            let share = evaluated_fraction(&scene, &full, &found);
            println!(
                "{count} lights, roughness {roughness}, together {together}: {:?}, 1/{:.1}, FLIP {flip:.4}, NRMSE {nrmse:.3}",
                found.evaluated,
                1.0 / share
            );
            (share, flip, nrmse)
        };
        let ((each, flip, nrmse), (one, min, _)) = (of(false), of(true));
        assert!(each < 1.0 / 10.0 && flip < 0.01 && nrmse < 0.1);
        assert!(2.0 * each < one && flip - min < 0.004);
    }
}

/// The sum of changes equals the sum of the lights if every light visible around a node is
/// evaluated. A light that is dark at all nodes around is not evaluated, which affects few nodes.
#[test]
fn specular_full_refinement_equals_sum_of_lights() {
    let scene = Scene::new(SMALL, virtual_lights(&room(), 32, 40), 0.25);
    let settings = SpecularSettings {
        radiance_threshold: 0.0,
        ..SpecularSettings::default()
    };
    let params = scene.params(&settings);
    let view = scene.view(&params);
    let found = view.run();
    let (mut checked, mut off) = (0, 0);
    for y in (0..SMALL[1]).step_by(2) {
        for x in (0..SMALL[0]).step_by(2) {
            let i = (y * SMALL[0] + x) as usize;
            let full = view.full([x, y]);
            let worst = (0..3)
                .map(|c| (full[c] - found.texels[i][c]).abs() / (full[c] + 0.01))
                .fold(0.0, f32::max);
            checked += u32::from(full[3] > 0.0);
            off += u32::from(worst > 0.01);
        }
    }
    println!("{checked} nodes, {off} not exact");
    // 16-bit floats round at every level.
    assert!(checked > 500 && off * 100 < checked, "{off} of {checked}");
    // One light's color is wrong: the test detects it.
    let mut wrong = Scene::new(SMALL, scene.vpls.clone(), 0.25);
    wrong.view.scale = scene.view.scale;
    wrong.vpls[7].flux[0] *= 3.0;
    assert!(wrong.run(&settings).texels != found.texels);
}

/// Shadows of the room's own walls: edges of light in the gloss.
#[test]
fn specular_of_hidden_lights_is_zero() {
    let open = Scene::new(SIZE, virtual_lights(&room(), 32, 48), 0.25);
    let bright: f32 = open.full().iter().map(|t| t[1]).sum();
    let scene = open.shadowed();
    let full = scene.full();
    let dark: f32 = full.iter().map(|t| t[1]).sum();
    let found = scene.run(&SpecularSettings::default());
    let (flip, _) = scene.compare(&full, &found.texels);
    let share = evaluated_fraction(&scene, &full, &found);
    println!(
        "{:.3} of the gloss stays, 1/{:.1}, FLIP {flip:.4}",
        dark / bright,
        1.0 / share
    );
    assert!(dark < 0.95 * bright && dark > 0.2 * bright);
    assert!(flip < 0.012 && share < 0.12);
}

#[test]
fn specular_rough_or_unlit_pixels_are_not_evaluated() {
    let mut scene = Scene::new(SMALL, virtual_lights(&room(), 32, 40), 0.25);
    for (i, texel) in scene.drawn.gbuffer.iter_mut().enumerate() {
        let n = gbuffer::normal(*texel);
        *texel = match i as u32 % SMALL[0] {
            0..60 => gbuffer::with_roughness(gbuffer::pack(Vec3::ONE, 0.0, 1.0, n, 0), 0.7, 0.5),
            _ => gbuffer::pack(Vec3::ONE, 1.0, 1.0, n, gbuffer::UNLIT),
        };
    }
    for depth in &mut scene.drawn.depth[..500] {
        *depth = 0.0;
    }
    let found = scene.run(&SpecularSettings::default());
    assert_eq!(found.evaluated.iter().sum::<u64>(), 0);
    assert!(found.texels.iter().all(|t| *t == [0.0; 4]));
    // Half-dull surfaces show a part: no step where roughness crosses the bound.
    let params = scene.params(&SpecularSettings::default()).1;
    let of = |roughness| {
        specular_fraction(
            &params,
            gbuffer::with_roughness([0, 0, 0, 0], roughness, 0.5),
        )
    };
    assert!(of(0.45) == 1.0 && of(0.62) == 0.0);
    assert!((of(0.55) - 0.5).abs() < 0.03);
}

/// The direction to the eye comes from the matrix alone: of a pinhole, of parallel rays.
#[test]
fn view_direction_follows_projection_matrix() {
    let scene = Scene::new(SMALL, virtual_lights(&room(), 32, 8), 0.25);
    let eye = scene.view_from_world.inverse().project_point3(Vec3::ZERO);
    let params = scene.params(&SpecularSettings::default());
    let view = scene.view(&params);
    let parallel = Mat4::orthographic_rh(-2.0, 2.0, -1.0, 1.0, 10.0, 0.1) * scene.view_from_world;
    let mut ortho = scene.view;
    ortho.space_from_clip = parallel.inverse().to_cols_array_2d();
    let forward = (scene.view_from_world.inverse()).transform_vector3(Vec3::NEG_Z);
    for i in (0..scene.drawn.depth.len()).step_by(97) {
        let (pixel, depth) = (scene.pixel(i), scene.drawn.depth[i]);
        let texel = scene.drawn.gbuffer[i];
        let at = receiver(&scene.view, &view.lights, pixel, depth, texel);
        assert!((at.facet.v - (eye - at.x).normalize()).length() < 1e-4);
        let at = receiver(&ortho, &view.lights, pixel, 0.5, texel);
        assert!((at.facet.v + forward).length() < 1e-4);
    }
}

/// Lights on the very surface, without size, without normal, without flux, behind it: no number
/// that is none, and nothing brighter than the disk's light allows.
#[test]
fn specular_degenerate_lights_stay_finite_and_bounded() {
    let mut vpls = virtual_lights(&room(), 32, 12);
    let on = |square, normal: Vec3| Vpl {
        position: [2.7, 0.001, 2.5],
        square,
        normal: normal.to_array(),
        flux: [5.0; 3],
        ..Vpl::default()
    };
    vpls.extend([
        on(0.04, Vec3::Y),
        on(0.04, -Vec3::Y),
        on(0.01, Vec3::ZERO),
        on(0.0, 0.5 * Vec3::X),
        Vpl::default(),
    ]);
    let scene = Scene::new(SMALL, vpls, 0.0);
    finite(&scene.full());
    let wild = [
        SpecularSettings::default(),
        SpecularSettings {
            coarsest_level: 99,
            finest_level: 99,
            radiance_threshold: f32::NAN,
            max_roughness: f32::NAN,
            together: true,
        },
        SpecularSettings {
            coarsest_level: 0,
            finest_level: 0,
            radiance_threshold: f32::INFINITY,
            max_roughness: f32::INFINITY,
            together: false,
        },
    ];
    for settings in wild {
        finite(&scene.run(&settings).texels);
    }
    for size in [[1, 1], [3, 2], [1, 40]] {
        let small = Scene::new(size, scene.vpls.clone(), 0.1);
        let found = small.run(&SpecularSettings::default());
        finite(&found.texels);
        assert_eq!(found.texels.len(), (size[0] * size[1]) as usize);
    }
    // A light of 5 W on a disk of 0.04 m² squared radius leaves with 5 / (π 0.04) W/m²; a mirror
    // shows its radiance.
    let params = scene.params(&SpecularSettings::default());
    let view = scene.view(&params);
    let alone = vec![on(0.04, -Vec3::Y)];
    let lit = VplParams::unshadowed(1);
    let lights = meshless_gi::internals::frame::vpl_specular::VplSet {
        lit: &lit,
        vpls: &alone,
        ..view.lights
    };
    let max = 5.0 / (std::f32::consts::PI * 0.04) / std::f32::consts::PI;
    for i in 0..scene.drawn.depth.len() {
        let texel = scene.drawn.gbuffer[i];
        let at = receiver(
            &scene.view,
            &lights,
            scene.pixel(i),
            scene.drawn.depth[i],
            texel,
        );
        let found = specular_at(&lights, &at).evaluate(Vec3::ONE).max_element();
        assert!(found < 4.0 * max, "{found} of {max}");
    }
}
