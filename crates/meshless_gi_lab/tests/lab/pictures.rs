//! Visibly wrong pixels of bakes at Draft in three scenes of the report of pictures, at a ninth of
//! its pixels. `cargo run -p meshless_gi_lab --example pictures` has all scenes and presets.

use meshless_gi::{Preset, Progress, Recipe, bake_scene};
use meshless_gi_lab::accuracy::{VisibleErrors, visible_errors};
use meshless_gi_lab::fixtures::scenes::SCENES;
use meshless_gi_lab::pictures::{DisplayedLight, ViewReferenceSize, view_reference};

const SIZE: ViewReferenceSize = ViewReferenceSize {
    view: [32, 18],
    surface_points: 0,
    paths: [256, 1024],
};

/// Errors of a bake at Draft in all views of a scene together, and of the same values in reverse
/// order.
fn errors_of(name: &str) -> [VisibleErrors; 2] {
    let mut scenes = SCENES.iter().map(|scene| scene());
    let scene = scenes.find(|scene| scene.name == name).expect("a scene");
    let recipe = Recipe {
        preset: Preset::Draft,
        ..Recipe::default()
    };
    let bake = bake_scene(&scene.mesh, &recipe, 0, &Progress::default()).expect("a bake");
    let light = DisplayedLight::new(&bake.scene, &scene.lights);
    let points: Vec<_> = (0..scene.views.len())
        .flat_map(|k| view_reference(&scene, k, &SIZE))
        .collect();
    let reference: Vec<_> = points.iter().map(|p| p.irradiance).collect();
    let noise: Vec<_> = points.iter().map(|p| p.standard_error).collect();
    let mut values = light.at(&points);
    let errors = visible_errors(&values, &reference, &noise);
    println!(
        "{name}: {:.2} % of {} pixels wrong, NRMSE {:.1} %",
        100.0 * errors.wrong_fraction,
        points.len(),
        100.0 * errors.nrmse
    );
    values.reverse();
    [errors, visible_errors(&values, &reference, &noise)]
}

fn check(name: &str, max_wrong: f64) {
    let [errors, reversed] = errors_of(name);
    assert!(errors.wrong_fraction <= max_wrong, "{errors:?}");
    assert!(reversed.wrong_fraction > 10.0 * max_wrong, "{reversed:?}");
}

#[test]
fn furnished_room_at_draft_has_few_wrong_pixels() {
    check("furnished_room", 0.01);
}

#[test]
fn forest_edge_at_draft_has_few_wrong_pixels() {
    check("forest_edge", 0.01);
}

#[test]
fn tent_at_draft_has_few_wrong_pixels() {
    check("tent", 0.01);
}
