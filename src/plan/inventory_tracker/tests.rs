//! Tests of `inventory_tracker`.

use super::*;
use crate::plan::ChangeCounts;
use meshless_gi::internals::asset::MaterialCoverage;
use meshless_gi::{Material, Progress, Quad, Recipe, TriangleMesh, bake_scene};

fn light_source(at: Vec3, intensity: Vec3) -> Light {
    Light::Point {
        position: at,
        intensity,
        range: f32::INFINITY,
    }
}

fn observe(tracker: &mut InventoryTracker<u32>, lights: &[(u32, Light)]) -> Inventory {
    tracker.update(&WorldSnapshot {
        lights: lights.iter().map(|(k, l)| (*k, l)).collect(),
        ..WorldSnapshot::default()
    })
}

/// Returns the bake of the box, in color or in gray.
fn bake(gray: bool) -> Arc<BakedScene> {
    let mut quads = Quad::cornell_box();
    if gray {
        for quad in &mut quads {
            quad.material = Material::diffuse(Vec3::splat(0.6));
        }
    }
    let recipe = Recipe {
        coarse_radius: Some(0.8),
        levels: Some(2),
        sender_levels: Some(1),
        rays_per_point: Some(16),
        ..Recipe::default()
    };
    let made = bake_scene(
        &TriangleMesh::from_quads(&quads),
        &recipe,
        0,
        &Progress::default(),
    );
    Arc::new(made.expect("a small bake").scene)
}

fn scene<'a>(bake: &'a Arc<BakedScene>) -> SceneSnapshot<'a> {
    SceneSnapshot {
        id: SceneId(1),
        bake: Some(bake),
        transform: [0.0; 12],
        sky: SkyRadiance::BLACK,
        emission: 0.0,
        materials: &[],
        transmittances: &[],
        unlit_by: Vec::new(),
    }
}

#[test]
fn inventory_counts_moved_recolored_added_and_removed_lights() {
    let mut tracker = InventoryTracker::new();
    let mut lights: Vec<(u32, Light)> = (0..8)
        .map(|k| (k, light_source(Vec3::X * k as f32, Vec3::ONE)))
        .collect();
    let first = observe(&mut tracker, &lights).lights_of(LightKind::Point);
    assert_eq!((first.all, first.on, first.moved), (8, 8, 8));
    assert!(observe(&mut tracker, &lights).at_rest());
    // One moves, one changes its color, one is turned off, one is removed. A sun is added.
    lights[2].1 = light_source(Vec3::Y, Vec3::ONE);
    lights[3].1 = light_source(Vec3::X * 3.0, Vec3::new(1.0, 0.5, 0.5));
    lights[4].1 = light_source(Vec3::X * 4.0, Vec3::ZERO);
    lights.remove(7);
    let sun = Light::Directional {
        direction: Vec3::NEG_Y,
        irradiance: Vec3::ONE,
    };
    lights.push((9, sun));
    let found = observe(&mut tracker, &lights);
    assert_eq!(
        found.lights_of(LightKind::Point),
        ChangeCounts {
            all: 7,
            on: 6,
            moved: 2,
            recolored: 2
        }
    );
    assert_eq!(found.lights_of(LightKind::Directional).moved, 1);
    assert_eq!(found.lights_of(LightKind::Spot), ChangeCounts::default());
    assert_eq!(found.colors, ColorUniformity::Lights);
    assert!(!found.at_rest());
    assert!(observe(&mut tracker, &lights).at_rest());
    // A light that changes its kind counts as a new one of that kind.
    lights[0].1 = sun;
    let found = observe(&mut tracker, &lights);
    assert_eq!(found.lights_of(LightKind::Directional).moved, 1);
    assert_eq!(found.lights_of(LightKind::Point).all, 6);
}

#[test]
fn scene_is_gray_if_surfaces_and_lights_are() {
    let (gray, colored) = (bake(true), bake(false));
    let colors = |bake, lights: &[Vec3], sky: Vec3| {
        let light_sources: Vec<Light> = lights
            .iter()
            .map(|c| light_source(Vec3::ZERO, *c))
            .collect();
        let found = WorldSnapshot {
            lights: (0u32..).zip(&light_sources).collect(),
            scenes: vec![SceneSnapshot {
                sky: sky.into(),
                ..scene(bake)
            }],
            ..WorldSnapshot::default()
        };
        let mut tracker = InventoryTracker::new();
        let all = tracker.update(&found).colors;
        let own = tracker.colors_of(SceneId(1));
        assert_eq!(own.colors, all);
        let expected = match all {
            ColorUniformity::One => lights[0],
            _ => Vec3::ONE,
        };
        assert!(own.hue.abs_diff_eq(expected / expected.max_element(), 1e-6));
        // Lights that do not reach it do not affect its colors.
        let mut aside = found.clone();
        aside.scenes[0].unlit_by = (0..lights.len()).collect();
        tracker.update(&aside);
        let unlit = tracker.colors_of(SceneId(1)).colors;
        aside.lights.clear();
        assert_eq!(unlit, tracker.update(&aside).colors);
        all
    };
    let warm = Vec3::new(2.0, 1.0, 0.5);
    assert_eq!(colors(&gray, &[], Vec3::ZERO), ColorUniformity::Dark);
    // Any single chromaticity, at any intensity.
    let one = [warm, 7.0 * warm, Vec3::ZERO];
    assert_eq!(colors(&gray, &one, 0.1 * warm), ColorUniformity::One);
    assert_eq!(colors(&gray, &one, Vec3::ONE), ColorUniformity::Lights);
    assert_eq!(
        colors(&gray, &[warm, Vec3::ONE], Vec3::ZERO),
        ColorUniformity::Lights
    );
    assert_eq!(
        colors(&colored, &one, Vec3::ZERO),
        ColorUniformity::Surfaces
    );
}

/// A sign with a colored texture was baked dark, and a wall was baked black. With white factors,
/// their light is colored.
#[test]
fn dynamic_material_textures_count_with_factors() {
    let mut baked = (*bake(true)).clone();
    let senders = baked.data().senders() as u32;
    for surface in &mut baked.data_mut().surfaces[..2] {
        (surface.albedo, surface.emission) = ([0.0; 3], [0.0; 3]);
    }
    let share = |material, albedo, emission| MaterialCoverage {
        material,
        albedo,
        emission,
    };
    baked.data_mut().materials = Some(DynamicMaterials {
        names: vec!["wall".into(), "sign".into()],
        factors: vec![MaterialFactors::default(); 2],
        starts: [0, 1].into_iter().chain((0..senders).map(|_| 2)).collect(),
        shares: vec![
            share(0, [0.2, 0.6, 0.2], [0.0; 3]),
            share(1, [0.5; 3], [0.1, 0.2, 0.9]),
        ],
    });
    baked
        .data_mut()
        .materials
        .as_mut()
        .expect("some")
        .starts
        .truncate(senders as usize + 1);
    let baked = Arc::new(baked);
    let white = [light_source(Vec3::ZERO, Vec3::ONE)];
    let colors = |wall: f32, sign: Vec3| {
        let factors = |base_color: f32, emissive: Vec3| MaterialFactors {
            base_color: [base_color; 3],
            emissive: emissive.to_array(),
        };
        let materials = [factors(wall, Vec3::ZERO), factors(0.7, sign)];
        let found = WorldSnapshot {
            lights: (0u32..).zip(&white).collect(),
            scenes: vec![SceneSnapshot {
                emission: 1.0,
                materials: &materials,
                ..scene(&baked)
            }],
            ..WorldSnapshot::default()
        };
        InventoryTracker::new().update(&found).colors
    };
    assert_eq!(colors(0.0, Vec3::ZERO), ColorUniformity::One);
    assert_eq!(colors(1.0, Vec3::ZERO), ColorUniformity::Surfaces);
    assert_eq!(colors(0.0, Vec3::ONE), ColorUniformity::Lights);
    // A factor may undo the texture's color.
    let undone = 0.1 / Vec3::new(0.1, 0.2, 0.9);
    assert_eq!(colors(0.0, undone), ColorUniformity::One);
}

#[test]
fn scene_snapshot_reports_changes() {
    let gray = bake(true);
    let mut tracker = InventoryTracker::<u32>::new();
    let mut observe = |scenes: Vec<SceneSnapshot<'_>>| {
        tracker.update(&WorldSnapshot {
            scenes,
            ..WorldSnapshot::default()
        })
    };
    assert_eq!(observe(vec![scene(&gray)]).bakes_moved, 1);
    assert!(observe(vec![scene(&gray)]).at_rest());
    let red = [MaterialFactors {
        base_color: [0.8, 0.1, 0.1],
        emissive: [1.0; 3],
    }];
    let changed = SceneSnapshot {
        transform: [1.0; 12],
        sky: Vec3::ONE.into(),
        emission: 2.0,
        materials: &red,
        transmittances: &[0.5, 1.0],
        ..scene(&gray)
    };
    let found = observe(vec![changed.clone()]);
    assert_eq!((found.skies, found.skies_changed), (SkyKind::Uniform, 1));
    assert_eq!((found.dynamic_materials, found.materials_changed), (1, 1));
    assert_eq!((found.doors, found.doors_moved), (2, 2));
    assert_eq!((found.emissive_scenes, found.emissions_changed), (1, 1));
    assert_eq!((found.bakes, found.bakes_moved), (1, 1));
    // A changed material makes a gray bake colored.
    assert_eq!(found.colors, ColorUniformity::Surfaces);
    assert!(observe(vec![changed.clone()]).at_rest());
    let shut = SceneSnapshot {
        transmittances: &[0.5, 0.0],
        ..changed
    };
    let found = observe(vec![shut]);
    assert_eq!((found.doors_moved, found.materials_changed), (1, 0));
    // The light is removed.
    let found = observe(Vec::new());
    assert_eq!((found.bakes, found.bakes_moved), (0, 1));
    assert_eq!(found.colors, ColorUniformity::Dark);
}
