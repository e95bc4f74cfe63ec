//! Light leaks through walls: none into a sealed room. Next to an open door the error behind a thin
//! wall is not larger than the error before it. The same is measured for functions that do not stop
//! at walls, as [L08]'s do not, and must fail there. `examples/leaks.rs` prints the table
//! (docs/reports/leaks.md).

use meshless_gi_lab::fixtures::leaks as leak_support;

use leak_support::{Door, Leak, WalledScene, load_open_rooms, rooms};
use meshless_gi::{Preset, Progress, Recipe, TransportMethod, bake_scene};

/// Measures with few rays: leaks depend on the support of functions.
fn measure(scene: &WalledScene, rule: TransportMethod, walls: bool, rays: u32) -> Leak {
    let recipe = Recipe {
        preset: Preset::Draft,
        transport: rule,
        clip_planes: Some(walls),
        rays_per_point: Some(rays),
        max_refinement_points: Some(3000),
        viewpoints: vec![[2.0, 1.3, 1.8], [6.0, 1.3, 1.8]],
        ..Recipe::default()
    };
    let baked = bake_scene(&scene.mesh, &recipe, 0, &Progress::default()).expect("a bake");
    let leak = scene.measure(&baked.scene);
    println!("{}, {rule:?}, walls {walls}: {leak:?}", scene.name);
    leak
}

fn stays_dark(scene: &WalledScene, rules: &[TransportMethod]) {
    assert!(scene.dark.positions.len() > 400 && scene.lit.positions.len() > 400);
    for &rule in rules {
        let with = measure(scene, rule, true, 32);
        assert!(with.ratio <= 1e-4, "{rule:?}: {with:?}");
        // A black result must not pass.
        assert!(with.lit.bias.abs() < 0.15, "{rule:?}: {with:?}");
        assert_eq!(with.uncovered, [0, 0], "{rule:?}");
    }
    let without = measure(scene, rules[0], false, 32);
    assert!(without.ratio > 1e-2, "{without:?}");
}

#[test]
fn room_behind_thin_wall_stays_dark() {
    stays_dark(
        &rooms("2 cm", 0.02, Door::Closed, 256),
        &[TransportMethod::Bounded],
    );
}

#[test]
fn room_behind_sheet_stays_dark() {
    let scene = rooms("a sheet", 0.0, Door::Closed, 256);
    stays_dark(&scene, &[TransportMethod::L08, TransportMethod::Bounded]);
}

/// Relative to the light of the lit room, the error behind the wall is smaller than the error
/// before it.
#[test]
fn room_behind_thin_wall_with_door_is_as_accurate_as_lit_room() {
    let scene = load_open_rooms();
    let with = measure(&scene, TransportMethod::Bounded, true, 64);
    let without = measure(&scene, TransportMethod::Bounded, false, 64);
    assert!(with.ratio <= with.lit.nrmse, "{with:?}");
    assert!(
        with.dark.nrmse < 0.5 * without.dark.nrmse,
        "{with:?} {without:?}"
    );
    assert!(without.dark.bias > 0.3, "{without:?}");
    assert_eq!(with.uncovered, [0, 0]);
}
