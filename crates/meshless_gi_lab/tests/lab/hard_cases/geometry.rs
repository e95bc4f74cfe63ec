//! Scenes with the defects of artists' tools and broken files: invalid triangles are left out and
//! counted, odd ones change no light.

use super::support::{
    Triangles, baked, closed, cornell, irradiances, lit, mesh, quick, room, small, square,
};
use glam::Vec3;
use meshless_gi::internals::eval::irradiance_at_all;
use meshless_gi::{
    BakeError, BakeSceneError, Bounces, CpuFrame, Evaluator, FrameLight, FrameSettings, Geometry,
    Light, Material, Progress, Recipe, ReferenceSettings, TriangleMesh, bake_scene,
};
use meshless_gi_lab::accuracy::{Errors, errors};

/// The walls of 2 m, each cut by `cut`.
fn walls(cut: impl Fn(Vec3, Vec3, Vec3) -> Triangles) -> Triangles {
    let (x, y, z) = (Vec3::X * 2.0, Vec3::Y * 2.0, Vec3::Z * 2.0);
    [
        (Vec3::ZERO, z, x),
        (y, x, z),
        (Vec3::ZERO, x, y),
        (z, y, x),
        (Vec3::ZERO, y, z),
        (x, z, y),
    ]
    .into_iter()
    .flat_map(|(a, u, v)| cut(a, u, v))
    .collect()
}

fn half() -> Material {
    Material::diffuse(Vec3::splat(0.5))
}

#[test]
fn sliver_and_duplicate_triangles_change_nothing() {
    // Strips down to a micrometer, a thousandth of the size of their neighbors, and fans of
    // needles.
    let strips = walls(|a, u, v| {
        let cuts = [0.0, 0.3, 0.300_000_5, 0.300_5, 0.7, 0.700_000_1, 1.0];
        let pairs = cuts.windows(2);
        pairs
            .flat_map(|c| square(a + u * c[0], u * (c[1] - c[0]), v))
            .collect()
    });
    let needles = walls(|a, u, v| {
        (0..500)
            .flat_map(|k| {
                let at = |k: i32| a + v * (k as f32 / 500.0);
                [[at(k), a + u, at(k + 1)], [a + v, a + u, a + u + v]]
                    .into_iter()
                    .take(if k == 0 { 2 } else { 1 })
            })
            .collect()
    });
    let twice = walls(|a, u, v| [square(a, u, v), square(a, u, v)].concat());
    for (name, triangles) in [("strips", strips), ("needles", needles), ("twice", twice)] {
        let level = mesh(triangles, half());
        assert_eq!(level.problems().dropped(), 0);
        let bake = baked(&level, &small());
        let (one, eight) = lit(&bake.scene, 1.0);
        eprintln!("{name}: {one:.4} of one reflection, {eight:.4} of eight");
        assert!(bake.stats.uncovered < 1e-5, "{name}");
        // Σ over eight: (1 − 2⁻⁸) / (1 − ½).
        assert!((one - 1.0).abs() < 0.02, "{name}: {one}");
        assert!((eight / 1.992 - 1.0).abs() < 0.02, "{name}: {eight}");
    }
}

#[test]
fn invalid_triangles_are_skipped_and_counted() {
    let clean = room(Vec3::ZERO, Vec3::splat(2.0));
    let mut dirty = clean.clone();
    let p = Vec3::ONE;
    dirty.extend([
        [p, p, p],
        [p, p + Vec3::X, p + 2.0 * Vec3::X],
        [p, p + Vec3::X, p],
    ]);
    for wrong in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30] {
        for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
            dirty.push([p, p + Vec3::Y, p + axis * wrong]);
        }
    }
    let (clean, dirty) = (mesh(clean, half()), mesh(dirty, half()));
    let problems = dirty.problems();
    assert_eq!((problems.no_area, problems.not_finite), (3, 12));
    let (a, b) = (baked(&clean, &small()).scene, baked(&dirty, &small()).scene);
    // Bit by bit equal to the clean scene.
    assert!(
        a.data().operator == b.data().operator
            && a.data().points == b.data().points
            && a.data().light_samples == b.data().light_samples
    );
    let indices = [[0, 1, 2], [0, 1, 3], [7, 0, 1]];
    let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
    let few = TriangleMesh::indexed(&corners, &indices, &[0, 0, 0], vec![half()]);
    assert_eq!((few.len(), few.problems().bad_index), (1, 2));
}

#[test]
fn materials_out_of_range_are_clamped() {
    for (albedo, clamped) in [
        (Vec3::new(1.5, 0.5, 0.5), Vec3::new(1.0, 0.5, 0.5)),
        (Vec3::new(-0.5, 0.5, 0.5), Vec3::new(0.0, 0.5, 0.5)),
        (
            Vec3::new(f32::NAN, f32::INFINITY, 0.5),
            Vec3::new(0.0, 0.0, 0.5),
        ),
        (Vec3::splat(1e30), Vec3::ONE),
    ] {
        let material = Material::emissive(albedo, Vec3::new(f32::NAN, 1.0, -1.0));
        let level = closed(material);
        let problems = level.problems();
        assert_eq!((problems.albedo_clamped, problems.bad_emission), (1, 1));
        assert_eq!(level.material(0).unwrap().base_color.truncate(), clamped);
        let scene = baked(&level, &small()).scene;
        let (one, _) = lit(&scene, 1.0);
        assert!(one.is_finite() && one >= 0.0);
    }
    let glare = closed(Material::emissive(Vec3::splat(0.5), Vec3::splat(f32::MAX)));
    assert_eq!(glare.problems().bad_emission, 1);
    let scene = baked(&glare, &small()).scene;
    let mut frame = CpuFrame::new(&scene);
    frame.solve(&scene, &FrameSettings::bounces(256));
    irradiances(&frame, &scene);
}

/// Errors of the indirect light at positions that rays find, three bounces, against the reference.
fn compared(
    level: TriangleMesh,
    recipe: &Recipe,
    from: Vec3,
    light_source: Vec3,
) -> (Errors, usize) {
    let scene = baked(&level, recipe).scene;
    let traced = meshless_gi::internals::samples::trace_particles(&level, &[from], 0..60, 9, false);
    let positions: Vec<(Vec3, Vec3)> = traced
        .candidates
        .iter()
        .map(|c| (c.surface.position, c.surface.normal))
        .step_by(4)
        .take(200)
        .collect();
    let lights = [Light::Point {
        position: light_source,
        intensity: Vec3::ONE,
        range: f32::INFINITY,
    }];
    let settings = ReferenceSettings {
        paths: 1024,
        bounces: Some(3),
        seed: 4,
    };
    let truth = irradiance_at_all(&level, &lights, &positions, &settings);
    let meshes = [level];
    let evaluator = Evaluator::new(&scene, &meshes, &lights, Bounces::Count(3));
    let mut none = 0;
    let found: Vec<Vec3> = positions
        .iter()
        .map(|&(x, n)| {
            let e = evaluator.at(x, n, 0).indirect;
            none += usize::from(e.is_none());
            e.unwrap_or_default()
        })
        .collect();
    let right: Vec<Vec3> = truth.iter().map(|t| t.indirect).collect();
    let noise: Vec<Vec3> = truth.iter().map(|t| t.indirect_error).collect();
    (errors(&found, &right, &noise), none)
}

/// Blocks sunk into the floor, into each other and through a wall.
#[test]
fn intersecting_surfaces_match_reference() {
    let mut triangles = room(Vec3::ZERO, Vec3::splat(2.0));
    let mut block = |min: Vec3, size: Vec3| {
        // Outwards.
        let faces = room(min, size).into_iter();
        triangles.extend(faces.map(|[a, b, c]| [a, c, b]));
    };
    block(Vec3::new(0.4, -0.3, 0.5), Vec3::new(0.5, 0.9, 0.5));
    block(Vec3::new(0.7, -0.2, 0.7), Vec3::new(0.5, 0.6, 0.5));
    block(Vec3::new(1.6, 0.8, 0.5), Vec3::new(0.9, 0.3, 0.6));
    let (e, none) = compared(
        mesh(triangles, half()),
        &quick(),
        Vec3::new(1.0, 1.6, 1.5),
        Vec3::new(1.0, 1.7, 1.4),
    );
    eprintln!("run through each other: {e:?}, {none} not covered");
    assert!(e.nrmse < 0.1 && e.bias.abs() < 0.04 && none == 0, "{e:?}");
}

#[test]
fn inverted_double_sided_mesh_matches_original() {
    let turned: Triangles = room(Vec3::ZERO, Vec3::splat(2.0))
        .into_iter()
        .map(|[a, b, c]| [a, c, b])
        .collect();
    let inside = Recipe {
        viewpoints: vec![[1.0; 3]],
        ..small()
    };
    let (one, eight) = lit(&baked(&mesh(turned.clone(), half()), &inside).scene, 1.0);
    eprintln!("inside out: {one:.4}, {eight:.4}");
    assert!((one - 1.0).abs() < 0.02 && (eight / 1.992 - 1.0).abs() < 0.02);
    // Single-sided, from its unlit side: nothing reflects.
    let single = Material {
        double_sided: false,
        ..half()
    };
    let error = bake_scene(&mesh(turned, single), &inside, 1, &Progress::default()).unwrap_err();
    assert!(
        matches!(
            error,
            BakeSceneError::Bake(BakeError::NoReachableSurface { .. })
        ),
        "{error}"
    );
}

#[test]
fn tiny_and_empty_scenes_return_error_or_dark() {
    for triangles in [
        vec![],
        vec![[Vec3::NAN; 3]],
        vec![[Vec3::ZERO, Vec3::X, 2.0 * Vec3::X]],
    ] {
        let error = bake_scene(&mesh(triangles, half()), &quick(), 1, &Progress::default());
        let error = error.unwrap_err();
        assert!(
            matches!(
                error,
                BakeSceneError::Bake(BakeError::NoReachableSurface { .. })
            ),
            "{error}"
        );
    }
    // One triangle, in an axis' plane and askew, small and far: lit, and nothing comes back to it.
    for corners in [
        [Vec3::ZERO, Vec3::X, Vec3::Z],
        [
            Vec3::new(0.3, 0.1, 7.0),
            Vec3::new(0.4, 0.2, 7.1),
            Vec3::new(0.3, 0.3, 7.3),
        ],
    ] {
        let level = mesh(vec![corners], half());
        let scene = match bake_scene(&level, &quick(), 1, &Progress::default()) {
            Ok(bake) => bake.scene,
            Err(error) => panic!("{error}"),
        };
        super::support::check_scene(&scene);
        let mut frame = CpuFrame::new(&scene);
        let above = level.bounds().center() + Vec3::Y + 0.2 * Vec3::Z;
        frame.set_lights(
            &scene,
            &[FrameLight::point(above, Vec3::ONE, f32::INFINITY)],
        );
        frame.solve(&scene, &FrameSettings::bounces(256));
        assert!(irradiances(&frame, &scene).iter().all(|e| *e == Vec3::ZERO));
        assert!(frame.senders().iter().any(|s| s[0] > 0.0), "it is lit");
        frame.converge(&scene, &FrameSettings::default(), 1e-4);
        assert!(irradiances(&frame, &scene).iter().all(|e| *e == Vec3::ZERO));
    }
}

#[test]
fn uncovered_points_are_reported() {
    let scene = baked(&cornell(1.0, Vec3::ZERO), &small()).scene;
    let light_source = [Light::Point {
        position: Vec3::new(0.0, 1.7, 0.0),
        intensity: Vec3::ONE,
        range: f32::INFINITY,
    }];
    let evaluator = Evaluator::new(&scene, &[], &light_source, Bounces::Count(4));
    for (x, n, covered) in [
        (Vec3::new(0.0, 0.0, 0.9), Vec3::Y, true),
        (Vec3::new(0.0, 0.0, 0.9), Vec3::NEG_Y, false),
        (Vec3::new(0.0, 1.0, 0.5), Vec3::Y, false),
        (Vec3::splat(50.0), Vec3::Y, false),
        (Vec3::splat(1e30), Vec3::Y, false),
        (Vec3::splat(f32::NAN), Vec3::Y, false),
        (Vec3::new(0.0, 0.0, 0.9), Vec3::NAN, false),
        (Vec3::new(0.0, 0.0, 0.9), Vec3::ZERO, false),
        (Vec3::NEG_INFINITY, Vec3::Y, false),
    ] {
        let found = evaluator.at(x, n, 0);
        assert_eq!(found.indirect.is_some(), covered, "{x} {n}");
        assert!(found.direct.is_finite());
    }
}

/// Sheets without thickness, one above the other 2 cm apart: each is lit from its own side alone.
#[test]
fn thin_sheets_are_lit_per_side() {
    let mut triangles = room(Vec3::ZERO, Vec3::splat(2.0));
    for k in 0..4 {
        let corner = Vec3::new(0.5, 0.8 + 0.02 * k as f32, 0.5);
        triangles.extend(square(corner, Vec3::Z * 1.0, Vec3::X * 1.0));
    }
    let level = mesh(triangles, half());
    let recipe = Recipe {
        refinement_levels: Some(1),
        ..quick()
    };
    let (e, none) = compared(
        level,
        &recipe,
        Vec3::new(1.0, 1.6, 1.5),
        Vec3::new(1.0, 1.7, 1.0),
    );
    eprintln!("leaves: {e:?}, {none} not covered");
    assert!(e.nrmse < 0.12 && e.bias.abs() < 0.04 && none == 0, "{e:?}");
}

/// A leaf that hangs in the room under the light: its upper side is bright, and its lower side gets
/// the light of the floor.
#[test]
fn sheet_under_light_has_only_floor_light_below() {
    let mut triangles = room(Vec3::ZERO, Vec3::splat(2.0));
    triangles.extend(square(Vec3::new(0.5, 1.0, 0.5), Vec3::Z, Vec3::X));
    let scene = baked(&mesh(triangles, half()), &quick()).scene;
    let mut frame = CpuFrame::new(&scene);
    frame.set_lights(
        &scene,
        &[FrameLight::point(
            Vec3::new(1.0, 1.5, 1.0),
            Vec3::ONE,
            f32::INFINITY,
        )],
    );
    // The senders' own light: the sheet's two sides lie in the same positions.
    frame.solve(&scene, &FrameSettings::bounces(1));
    let (mut above, mut below) = (0.0f32, 0.0f32);
    for j in scene.data().finest_senders() {
        let p = &scene.data().points[j];
        let middle = (p.x() - Vec3::ONE).abs().max_element() < 0.35;
        if middle && p.n().y > 0.9 {
            above = above.max(frame.senders()[j][0]);
        } else if middle && p.n().y < -0.9 {
            below = below.max(frame.senders()[j][0]);
        }
    }
    assert!(above > 0.5 && below == 0.0, "{above} {below}");
}
