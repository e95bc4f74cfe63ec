//! Scenes of any size and position: 0.1 mm and 10 km, and 100 km from the origin.

use super::support::{baked, cornell, cornell_surface_points, quick};
use glam::Vec3;
use meshless_gi::internals::eval::irradiance_at_all;
use meshless_gi::{
    BakeError, BakeSceneError, Baked, Bounces, Evaluator, Irradiance, Light, Progress, Recipe,
    ReferenceSettings, bake_scene,
};
use meshless_gi_lab::accuracy::{Errors, errors};

/// Returns a light in the Cornell box, scaled and moved with it. Its irradiance stays the same.
fn light_source(scale: f32, by: Vec3) -> [Light; 1] {
    [Light::Point {
        position: scale * Vec3::new(0.1, 1.7, 0.2) + by,
        intensity: Vec3::splat(scale * scale),
        range: f32::INFINITY,
    }]
}

/// The truth at [`cornell_surface_points`] for the light in the box of 2 m at the origin, four
/// bounces.
fn truth(positions: &[(Vec3, Vec3)]) -> Vec<Irradiance> {
    let settings = ReferenceSettings {
        paths: 1024,
        bounces: Some(4),
        seed: 1,
    };
    let level = cornell(1.0, Vec3::ZERO);
    irradiance_at_all(&level, &light_source(1.0, Vec3::ZERO), positions, &settings)
}

/// Errors of a bake's direct and indirect light at the positions, scaled and moved with the scene.
fn measured(bake: &Baked, scale: f32, by: Vec3) -> [Errors; 2] {
    let positions = cornell_surface_points();
    assert!(positions.len() > 150, "{}", positions.len());
    let truth = truth(&positions);
    let light_sources = light_source(scale, by);
    let evaluator = Evaluator::new(&bake.scene, &[], &light_sources, Bounces::Count(4));
    let found: Vec<_> = positions
        .iter()
        .map(|&(x, n)| evaluator.at(scale * x + by, n, 0))
        .collect();
    let none = vec![Vec3::ZERO; positions.len()];
    let direct = errors(
        &found.iter().map(|f| f.direct).collect::<Vec<_>>(),
        &truth.iter().map(|t| t.direct).collect::<Vec<_>>(),
        &none,
    );
    let indirect = errors(
        &found
            .iter()
            .map(|f| f.indirect.expect("covered"))
            .collect::<Vec<_>>(),
        &truth.iter().map(|t| t.indirect).collect::<Vec<_>>(),
        &none,
    );
    [direct, indirect]
}

#[test]
fn scene_scale_does_not_change_light() {
    for scale in [1.0, 0.5e-4, 0.5e4, 1e-7] {
        let bake = baked(&cornell(scale, Vec3::ZERO), &quick());
        let [direct, indirect] = measured(&bake, scale, Vec3::ZERO);
        eprintln!(
            "a box of {} m: direct {:.5}, indirect {:.4}, bias {:+.4}",
            2.0 * scale,
            direct.nrmse,
            indirect.nrmse,
            indirect.bias
        );
        assert!(direct.nrmse < 5e-4, "{scale}: {direct:?}");
        // The value includes the reference's own noise.
        assert!(
            indirect.nrmse < 0.08 && indirect.bias.abs() < 0.03,
            "{scale}: {indirect:?}"
        );
        assert!(bake.stats.warnings.is_empty());
    }
}

#[test]
fn distant_origin_error_is_within_single_precision() {
    // Meters from the origin, then bounds on the errors of direct and indirect light; from 10 km on
    // the bake warns.
    for (far, most_direct, most_indirect, warned) in [
        (1e3, 1e-3, 0.08, false),
        (1e4, 0.03, 0.08, true),
        (1e5, 0.1, 0.15, true),
    ] {
        let by = far * Vec3::new(1.0, 0.0, -1.0);
        let bake = baked(&cornell(1.0, by), &quick());
        let [direct, indirect] = measured(&bake, 1.0, by);
        eprintln!(
            "{far} m away: direct {:.4}, indirect {:.4}, bias {:+.4}, {:?}",
            direct.nrmse, indirect.nrmse, indirect.bias, bake.stats.warnings
        );
        assert!(direct.nrmse < most_direct, "{far}: {direct:?}");
        assert!(indirect.nrmse < most_indirect, "{far}: {indirect:?}");
        assert_eq!(!bake.stats.warnings.is_empty(), warned, "{far}");
    }
}

#[test]
fn excessive_origin_distance_is_rejected() {
    let away = cornell(1.0, Vec3::new(1e6, 0.0, 0.0));
    let error = bake_scene(&away, &quick(), 2, &Progress::default()).unwrap_err();
    let BakeSceneError::Bake(BakeError::PrecisionLoss { far, size, spacing }) = &error else {
        panic!("{error}");
    };
    assert!((*far, *size) == (1_000_001.0, 2.0) && (0.1..0.13).contains(spacing));
    assert!(
        error.to_string().contains("move it to its origin"),
        "{error}"
    );
    // A scene of ten kilometers may have its corner at the origin.
    let wide = Recipe {
        coarse_radius: Some(2500.0),
        ..quick()
    };
    assert!(
        baked(&cornell(5e3, Vec3::new(5e3, 0.0, 5e3)), &wide)
            .stats
            .warnings
            .is_empty()
    );
}
