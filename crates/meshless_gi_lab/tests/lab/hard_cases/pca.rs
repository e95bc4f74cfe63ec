//! Method `pca`: bases of direct light that are complete, small, empty, and of clusters of one. Its
//! bakes are sound and all alike.

use super::support::{baked, closed, cornell, irradiances, quick, small};
use glam::Vec3;
use meshless_gi::{
    BakedScene, CpuFrame, FrameLight, FrameSettings, Material, PcaRecipe, Progress, Recipe,
    TransportMethod, bake_scene,
};

/// Parameters of the bakes here.
fn parameters() -> PcaRecipe {
    PcaRecipe {
        training_lights: 100,
        cluster_size: Some(40),
        ..PcaRecipe::default()
    }
}

fn pca() -> Recipe {
    Recipe {
        transport: TransportMethod::Pca(parameters()),
        ..quick()
    }
}

/// Returns the irradiance at all points, under three lights of one color each.
fn lit(scene: &BakedScene, bounces: u32) -> Vec<Vec3> {
    let mut frame = CpuFrame::new(scene);
    let light_source = |x: Vec3, color| FrameLight::point(x, color, f32::INFINITY);
    frame.set_lights(
        scene,
        &[
            light_source(Vec3::new(0.0, 1.7, 0.0), Vec3::X),
            light_source(Vec3::new(0.6, 0.9, 0.3), Vec3::Y),
            light_source(Vec3::new(-0.5, 0.4, 0.7), Vec3::Z),
        ],
    );
    frame.solve(scene, &FrameSettings::bounces(bounces));
    irradiances(&frame, scene)
}

/// Returns the root mean square of the difference, relative to that of `right`.
fn relative_error(values: &[Vec3], right: &[Vec3]) -> f32 {
    let square = |v: Vec3| v.length_squared();
    let differences = values.iter().zip(right).map(|(a, b)| square(a - b));
    let all: f32 = right.iter().map(|b| square(*b)).sum();
    (differences.sum::<f32>() / all).sqrt()
}

#[test]
fn pca_error_falls_with_vectors() {
    let level = cornell(1.0, Vec3::ZERO);
    let of = |transport| Recipe {
        transport,
        truncation_error: Some(0.0),
        ..pca()
    };
    let with = |coefficients| {
        TransportMethod::Pca(PcaRecipe {
            coefficients,
            ..parameters()
        })
    };
    // A hundred lights span clusters of forty: a change of basis that loses only the rounding to
    // sixteen bits.
    let whole = baked(&level, &of(with(1000))).scene;
    let senders = baked(&level, &of(TransportMethod::Bounded)).scene;
    let few = [1, 4, 12].map(|k| baked(&level, &of(with(k))));
    assert_eq!(senders.data().points.len(), whole.data().points.len());
    for bounces in [1, 4] {
        let right = lit(&whole, bounces);
        let other = relative_error(&lit(&senders, bounces), &right);
        let errors = few.each_ref().map(|bake| {
            assert!(bake.stats.clusters > 5);
            relative_error(&lit(&bake.scene, bounces), &right)
        });
        eprintln!(
            "{bounces} reflections, 1, 4 and 12 coefficients: {errors:.4?}; by links to senders {other:.4}"
        );
        // Links to senders transfer the light that the noise of 64 rays hides, even at ε = 0.
        assert!(other < 0.06, "{other}");
        assert!(errors.is_sorted_by(|a, b| a > b), "{errors:?}");
        assert!(errors[2] < 0.5 * errors[0] && errors[0] < 1.0, "{errors:?}");
    }
}

#[test]
fn pca_uniform_light_is_exact() {
    // No light, no light from any light, one light, fewer lights than vectors, clusters of one and
    // of all.
    let white = || closed(Material::diffuse(Vec3::splat(0.8)));
    let cases = [
        (white(), 0, None),
        (closed(Material::diffuse(Vec3::ZERO)), 50, None),
        (white(), 1, None),
        (white(), 5, Some(1)),
        (white(), 50, Some(65_536)),
    ];
    for (k, (level, training_lights, cluster_points)) in cases.into_iter().enumerate() {
        let bake = baked(
            &level,
            &Recipe {
                transport: TransportMethod::Pca(PcaRecipe {
                    training_lights,
                    cluster_size: cluster_points.or(Some(40)),
                    ..PcaRecipe::default()
                }),
                ..small()
            },
        );
        let stats = &bake.stats;
        eprintln!(
            "case {k}: {} clusters, {} vectors, {:?}",
            stats.clusters, stats.components, stats.energy
        );
        assert!(
            stats.energy.row_deviation < 1e-3,
            "case {k}: {:?}",
            stats.energy
        );
        match k {
            0 | 1 => assert_eq!(stats.clusters, stats.components),
            2 => assert!(stats.components <= 2 * stats.clusters),
            3 => assert_eq!(
                (stats.clusters, stats.components > 100),
                (stats.components, true)
            ),
            // Six walls with six normals.
            _ => assert!(stats.clusters >= 6 && stats.clusters < 16),
        }
    }
}

#[test]
fn pca_lights_inside_or_behind_walls_give_zero() {
    let scene = baked(&closed(Material::diffuse(Vec3::splat(0.8))), &pca()).scene;
    for x in [
        Vec3::splat(5.0),
        Vec3::new(1.0, 1.0, -1e-4),
        Vec3::new(-3.0, 1.0, 1.0),
    ] {
        let mut frame = CpuFrame::new(&scene);
        frame.set_lights(&scene, &[FrameLight::point(x, Vec3::ONE, f32::INFINITY)]);
        frame.solve(&scene, &FrameSettings::bounces(4));
        assert!(irradiances(&frame, &scene).iter().all(|e| *e == Vec3::ZERO));
    }
}

#[test]
fn pca_white_room_is_bounded_and_barely_darkened() {
    let bake = baked(
        &closed(Material::diffuse(Vec3::ONE)),
        &Recipe {
            transport: TransportMethod::pca(),
            ..small()
        },
    );
    let energy = bake.stats.energy;
    eprintln!("{energy:?}");
    assert!(energy.clamped_senders > 0 && energy.albedo_scale > 0.97);
    assert!((energy.spectral_radius_estimate - 0.999).abs() < 1e-3);
    assert_eq!(bake.stats.warnings.len(), 1);
    let light_source = FrameLight::point(Vec3::ONE, Vec3::ONE, f32::INFINITY);
    let mut frame = CpuFrame::new(&bake.scene);
    frame.set_lights(&bake.scene, &[light_source]);
    frame.solve(&bake.scene, &FrameSettings::bounces(256));
    let values = irradiances(&frame, &bake.scene);
    assert!(values.iter().all(|e| e.x < 256.0));
}

#[test]
fn pca_any_thread_count_is_equal() {
    let level = cornell(1.0, Vec3::ZERO);
    let bytes = |threads| {
        let bake = bake_scene(&level, &pca(), threads, &Progress::default()).unwrap();
        bake.scene.to_bytes().unwrap()
    };
    assert!(bytes(1) == bytes(3));
}
