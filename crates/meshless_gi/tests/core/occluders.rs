//! Door between two rooms, and shutters in front of an open box. Residual light behind closed
//! occluders is compared with bakes of closed scenes. Half-open occluders and rejected recipes are
//! also tested. Every comparison is repeated with a wrong input, for which it must fail.
#![allow(clippy::float_cmp, reason = "closed occluders transmit exactly zero")]

use glam::Vec3;
use meshless_gi::internals::transport::PackedLinkTerm;
use meshless_gi::{
    BakeError, BakeSceneError, BakedScene, CpuFrame, FrameLight, FrameSettings, Light, Limits,
    Material, OccluderBox, OccluderDesc, Preset, ProbeSettings, Progress, Quad, Recipe, SkyModel,
    SkyRadiance, TransportMethod, TriangleMesh, bake_scene, load_gltf,
};
use std::path::Path;
use std::sync::LazyLock;

/// Both rooms, the wall between them, and its opening (from z, to z, height). Meters.
const SIZE: Vec3 = Vec3::new(8.0, 2.6, 3.6);
const WALL: [f32; 2] = [3.9, 4.1];
const OPENING: [f32; 3] = [1.4, 2.4, 2.0];

/// State of the opening.
#[derive(Clone, Copy, PartialEq)]
enum Opening {
    Open,
    /// Black panel in the middle of the wall, equivalent to a closed door.
    Panel,
}

fn quad(origin: Vec3, u: Vec3, v: Vec3, albedo: f32) -> Quad {
    Quad {
        corners: [origin, origin + u, origin + u + v, origin + v],
        material: Material::diffuse(Vec3::splat(albedo)),
    }
}

/// Returns two rooms.
fn rooms(opening: Opening) -> TriangleMesh {
    rooms_in_row(&[4.0], opening)
}

/// Returns rooms in a row, with a wall between them at each x of `walls`, and an opening in each
/// wall.
fn rooms_in_row(walls: &[f32], opening: Opening) -> TriangleMesh {
    let [x, y, z] = [Vec3::X, Vec3::Y, Vec3::Z];
    let [w, h, d] = SIZE.to_array();
    let [left, right, top] = OPENING;
    let mut quads = vec![
        quad(Vec3::ZERO, d * z, w * x, 0.6),
        quad(h * y, w * x, d * z, 0.7),
        quad(Vec3::ZERO, w * x, h * y, 0.7),
        quad(d * z, h * y, w * x, 0.7),
        quad(Vec3::ZERO, h * y, d * z, 0.7),
        quad(w * x, d * z, h * y, 0.7),
    ];
    for &wall in walls {
        let [from_x, to_x] = [wall - 0.1, wall + 0.1];
        for [from, to, low, high] in [
            [0.0, left, 0.0, h],
            [right, d, 0.0, h],
            [left, right, top, h],
        ] {
            let corner = from * z + low * y;
            let (across, up) = ((to - from) * z, (high - low) * y);
            quads.push(quad(from_x * x + corner, across, up, 0.7));
            quads.push(quad(to_x * x + corner, up, across, 0.7));
        }
        let (foot, thick) = (from_x * x + left * z, (to_x - from_x) * x);
        let across = (right - left) * z;
        quads.push(quad(foot, thick, top * y, 0.7));
        quads.push(quad(foot + across, top * y, thick, 0.7));
        quads.push(quad(foot + top * y, thick, across, 0.7));
        if opening == Opening::Panel {
            let foot = (wall - 0.02) * x + left * z;
            quads.push(quad(foot, across, top * y, 0.0));
            let foot = (wall + 0.02) * x + left * z;
            quads.push(quad(foot, top * y, across, 0.0));
        }
    }
    TriangleMesh::from_quads(&quads)
}

/// Returns the door between two rooms.
fn door() -> OccluderDesc {
    door_at("door", 4.0)
}

/// Returns a door in the middle of the wall at `x`, four centimeters thick.
fn door_at(name: &str, x: f32) -> OccluderDesc {
    let [left, right, top] = OPENING;
    OccluderDesc {
        name: name.into(),
        boxes: vec![OccluderBox {
            center: [x, 0.5 * top, 0.5 * (left + right)],
            half_edges: [0.02, 0.5 * top, 0.5 * (right - left)],
        }],
    }
}

fn recipe(occluders: Vec<OccluderDesc>) -> Recipe {
    Recipe {
        preset: Preset::Draft,
        viewpoints: vec![[2.0, 1.3, 1.8], [6.0, 1.3, 1.8]],
        probes: Some(ProbeSettings::default()),
        occluders,
        ..Recipe::default()
    }
}

fn baked(mesh: &TriangleMesh, recipe: &Recipe) -> BakedScene {
    bake_scene(mesh, recipe, 0, &Progress::default())
        .expect("a bake")
        .scene
}

/// Bake of the open rooms with the door.
static WITH_DOOR: LazyLock<BakedScene> =
    LazyLock::new(|| baked(&rooms(Opening::Open), &recipe(vec![door()])));

fn light_source() -> Vec<FrameLight> {
    let light_source = Light::Point {
        position: Vec3::new(2.2, 2.1, 1.3),
        intensity: Vec3::splat(10.0),
        range: f32::INFINITY,
    };
    FrameLight::expand(&light_source, 1)
}

/// Returns positions with normals on walls, floor and ceiling between two x, centimeters from the
/// door and far.
fn positions(from: f32, to: f32) -> Vec<(Vec3, Vec3)> {
    let mut out = Vec::new();
    let steps = 16;
    for i in 0..steps {
        let x = from + (to - from) * (i as f32 + 0.5) / steps as f32;
        for k in 0..steps {
            let t = (k as f32 + 0.5) / steps as f32;
            let (y, z) = (t * SIZE.y, t * SIZE.z);
            out.extend([
                (Vec3::new(x, 0.0, z), Vec3::Y),
                (Vec3::new(x, SIZE.y, z), Vec3::NEG_Y),
                (Vec3::new(x, y, 0.0), Vec3::Z),
                (Vec3::new(x, y, SIZE.z), Vec3::NEG_Z),
            ]);
        }
    }
    out
}

fn lit_room_positions() -> Vec<(Vec3, Vec3)> {
    positions(0.02, 3.88)
}

/// Returns positions in the room behind the door, on its side of the wall, and in the part of the
/// opening beyond the door.
fn dark_room_positions() -> Vec<(Vec3, Vec3)> {
    let mut out = positions(4.12, 7.98);
    let [left, right, top] = OPENING;
    for k in 0..20 {
        let t = (k as f32 + 0.5) / 20.0;
        let (x, y, z) = (4.025 + 0.075 * t, 0.99 * t * top, left + t * (right - left));
        out.extend([
            (Vec3::new(WALL[1], 2.1 + 0.02 * k as f32, z), Vec3::X),
            (Vec3::new(WALL[1], y, 0.9 * left * t), Vec3::X),
            (Vec3::new(x, 0.0, z), Vec3::Y),
            (Vec3::new(x, y, left), Vec3::Z),
            (Vec3::new(x, y, right), Vec3::NEG_Z),
        ]);
    }
    out
}

/// Returns the sum of direct and indirect irradiance at the positions.
fn light(frame: &CpuFrame, scene: &BakedScene, positions: &[(Vec3, Vec3)]) -> Vec<f32> {
    let at = |&(x, n): &(Vec3, Vec3)| {
        let e = frame.irradiance(scene, x, n).expect("a function there");
        e.x + frame.direct(scene, x + n * 1e-4, n).x
    };
    positions.iter().map(at).collect()
}

fn root_mean_square(values: &[f32]) -> f64 {
    let sum: f64 = values.iter().map(|&v| f64::from(v) * f64::from(v)).sum();
    (sum / values.len() as f64).sqrt()
}

/// Returns the root mean square of the differences, relative to that of `right`.
fn error(found: &[f32], right: &[f32]) -> f64 {
    let off: Vec<f32> = found.iter().zip(right).map(|(a, b)| a - b).collect();
    root_mean_square(&off) / root_mean_square(right)
}

/// Solves the frame of a scene under the light, with these transmittances.
fn solve_frame(scene: &BakedScene, transmittances: &[f32]) -> CpuFrame {
    let mut frame = CpuFrame::new(scene);
    frame.set_lights(scene, &light_source());
    frame.set_occluders(scene, transmittances);
    frame.solve(scene, &FrameSettings::bounces(4));
    frame
}

fn probe_irradiances(frame: &CpuFrame, scene: &BakedScene) -> Vec<f32> {
    let positions = (0..40).map(|i| {
        let t = (i as f32 + 0.5) / 40.0;
        Vec3::new(4.2 + 3.7 * t, 0.2 + 2.2 * t, 0.3 + 3.0 * (1.0 - t))
    });
    let up = |x| {
        frame
            .probe_irradiance(scene, x, Vec3::NEG_X)
            .map(|l| l.irradiance(Vec3::NEG_X).x)
    };
    positions.map(|x| up(x).expect("a probe there")).collect()
}

#[test]
fn closed_door_blocks_all_light() {
    let with = &*WITH_DOOR;
    let without = baked(&rooms(Opening::Open), &recipe(Vec::new()));
    let closed = baked(&rooms(Opening::Panel), &recipe(Vec::new()));
    let occluders = with.data().occluders.as_ref().expect("a door");
    assert_eq!(occluders.names, ["door"]);
    assert_eq!(occluders.sets, [0, 1]);
    assert!(!occluders.probes.is_empty());
    assert!(without.data().occluders.is_none());
    // Half of the scene has no light path through the door.
    let share = occluders.links.len() as f64 / with.data().operator.links.len() as f64;
    println!(
        "{} link terms of {} links, {share:.3}",
        occluders.links.len(),
        with.data().operator.links.len()
    );
    assert!(share < 0.7, "{share}");

    let (near, beyond) = (lit_room_positions(), dark_room_positions());
    let open = solve_frame(with, &[]);
    let right = solve_frame(&without, &[]);
    let [a, b] = [(&open, with), (&right, &without)].map(|(f, s)| light(f, s, &beyond));
    println!(
        "open, other room: {:.4} of the bake without a door",
        error(&a, &b)
    );
    assert!(error(&a, &b) < 0.1, "{}", error(&a, &b));
    let bright = root_mean_square(&b);

    let shut = solve_frame(with, &[0.0]);
    let black = light(&solve_frame(&closed, &[]), &closed, &beyond);
    let dark = light(&shut, with, &beyond);
    let off: Vec<f32> = dark.iter().zip(&black).map(|(a, b)| a - b).collect();
    let left = root_mean_square(&off) / bright;
    println!("closed, other room: {left:.2e} of the light when open");
    assert!(left <= 0.01, "{left}");
    let worst = off.iter().fold(0.0f32, |a, o| a.max(o.abs()));
    println!(
        "the brightest of {} positions: {worst:.2e}, {bright:.2e} when open",
        off.len()
    );
    assert!(f64::from(worst) <= 0.01 * bright, "{worst}");
    let space = probe_irradiances(&shut, with);
    let open_space = probe_irradiances(&open, with);
    let left = root_mean_square(&space) / root_mean_square(&open_space);
    println!("closed, probes of the other room: {left:.2e} of the light when open");
    assert!(left <= 0.01, "{left}");
    // Room in front of the door, compared with a bake with a black panel.
    let before = light(&solve_frame(&closed, &[]), &closed, &near);
    let found = light(&shut, with, &near);
    println!(
        "closed, lit room: {:.4} of the bake with a panel",
        error(&found, &before)
    );
    assert!(error(&found, &before) < 0.1);

    // A half-open door transmits half of the light that crosses it once.
    let half = solve_frame(with, &[0.5]);
    let ajar = light(&half, with, &beyond);
    let between = root_mean_square(&ajar) / root_mean_square(&a);
    println!("half open, other room: {between:.4} of the light when open");
    assert!((0.3..0.55).contains(&between), "{between}");
    let nearly = light(&solve_frame(with, &[0.1]), with, &beyond);
    assert!(
        root_mean_square(&nearly) > 0.01 * bright,
        "a gap blocks all light"
    );
}

/// Three rooms in a row, with a light in the first. Each door alone blocks the light behind it, and
/// rooms in front of it stay bright.
#[test]
fn two_doors_in_sequence_block_independently() {
    let mesh = rooms_in_row(&[3.0, 5.5], Opening::Open);
    let rooms = [[0.02, 2.88], [3.12, 5.38], [5.62, 7.98]].map(|[from, to]| positions(from, to));
    let viewpoints = vec![[1.5, 1.3, 1.8], [4.2, 1.3, 1.8], [6.7, 1.3, 1.8]];
    let recipe = |occluders| Recipe {
        viewpoints: viewpoints.clone(),
        ..recipe(occluders)
    };
    let doors = vec![door_at("first", 3.0), door_at("second", 5.5)];
    let scene = baked(&mesh, &recipe(doors));
    // Sets: none, the first, the second, both.
    let occluders = scene.data().occluders.as_ref().expect("two doors");
    assert_eq!(occluders.sets, [0, 1, 2, 3]);
    let of = |transmittances: [f32; 2]| {
        let frame = solve_frame(&scene, &transmittances);
        rooms
            .each_ref()
            .map(|room| root_mean_square(&light(&frame, &scene, room)))
    };
    let open = of([1.0, 1.0]);
    let without = baked(&mesh, &recipe(Vec::new()));
    let frame = solve_frame(&without, &[]);
    for (k, room) in rooms.iter().enumerate() {
        let right = root_mean_square(&light(&frame, &without, room));
        println!("open, room {k}: {:.3e}, expected {right:.3e}", open[k]);
        assert!((open[k] / right - 1.0).abs() < 0.1, "{k}");
    }
    for (transmittances, dark) in [
        ([0.0, 1.0], [false, true, true]),
        ([1.0, 0.0], [false, false, true]),
        ([0.0, 0.0], [false, true, true]),
    ] {
        let found = of(transmittances);
        for k in 0..3 {
            let part = found[k] / open[k];
            println!("doors {transmittances:?}, room {k}: {part:.2e} of the light when open");
            assert!(
                if dark[k] { part <= 0.01 } else { part > 0.5 },
                "{transmittances:?}"
            );
        }
    }
    // Light through both doors is reduced to a quarter. Light that crosses them repeatedly is
    // reduced further.
    let half = of([0.5, 0.5])[2] / open[2];
    let one = of([0.5, 1.0])[2] / open[2];
    println!("half open in the last room, both {half:.3}, the first {one:.3}");
    assert!((0.15..0.3).contains(&half) && (0.35..0.55).contains(&one));
}

#[test]
fn frame_follows_door_transmittance_and_returns() {
    let scene = &*WITH_DOOR;
    let settings = FrameSettings::bounces(4);
    let mut frame = solve_frame(scene, &[]);
    let open = frame.vector_irradiance().to_vec();
    assert!(!frame.set_occluders(scene, &[1.0]), "nothing changed");
    assert!(
        !frame.set_occluders(scene, &[7.0, 3.0]),
        "no more than open"
    );
    assert!(!frame.solve(scene, &settings));
    let projected = frame.counters().projected;
    assert!(frame.set_occluders(scene, &[0.25]));
    assert_eq!(
        frame.counters().projected,
        projected + 1,
        "its shadow moved"
    );
    assert!(frame.solve(scene, &settings));
    assert_ne!(frame.vector_irradiance(), open);
    assert!(frame.set_occluders(scene, &[1.0]));
    frame.solve(scene, &settings);
    assert_eq!(frame.vector_irradiance(), open, "open again, but not equal");
    assert_eq!(frame.links(scene)[0], scene.data().operator.links);
    let bytes = scene.to_bytes().unwrap();
    assert_eq!(
        BakedScene::from_bytes(&bytes, &Limits::default()).unwrap(),
        *scene
    );
}

/// Returns a box that is open at its front, and a recipe with two shutters in front of the opening.
fn open_box() -> (TriangleMesh, Recipe) {
    let file = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
        .join("tests/data/cornell/cornell.glb");
    let mesh = load_gltf(&file).unwrap().mesh;
    let bounds = meshless_gi::Geometry::bounds(&mesh);
    let (center, size) = (bounds.center(), bounds.size());
    // The front of the box has the smallest z.
    let shutter = |name: &str, z: f32| OccluderDesc {
        name: name.into(),
        boxes: vec![OccluderBox {
            center: [center.x, center.y, z],
            half_edges: [0.6 * size.x, 0.6 * size.y, 0.01],
        }],
    };
    let recipe = Recipe {
        preset: Preset::Draft,
        sky: SkyModel::Harmonics,
        dynamic_materials: true,
        probes: Some(ProbeSettings::default()),
        occluders: vec![
            shutter("outer", bounds.min.z - 0.4),
            shutter("inner", bounds.min.z - 0.1),
        ],
        ..Recipe::default()
    };
    (mesh, recipe)
}

#[test]
fn closed_door_blocks_sky() {
    let (mesh, recipe) = open_box();
    let scene = baked(&mesh, &recipe);
    let occluders = scene.data().occluders.as_ref().unwrap();
    // Light that passes the edge of one shutter may still cross the other.
    assert!(occluders.sets.contains(&0b11), "{:?}", occluders.sets);
    let mut sky = SkyRadiance::from(Vec3::splat(2.0));
    sky.terms[0] = Vec3::new(0.3, 0.2, 0.1);
    sky.terms[5] = Vec3::new(-0.1, 0.2, 0.1);
    let settings = FrameSettings {
        sky,
        ..FrameSettings::bounces(3)
    };
    let sun = Light::Directional {
        direction: Vec3::new(0.2, -0.3, 1.0).normalize(),
        irradiance: Vec3::splat(3.0),
    };
    let sum = |transmittances: &[f32]| -> f64 {
        let mut frame = CpuFrame::new(&scene);
        let lights = FrameLight::expand(&sun, 1);
        frame.set_lights(&scene, &lights);
        frame.set_occluders(&scene, transmittances);
        frame.solve(&scene, &settings);
        let all = frame.vector_irradiance().iter().zip(&scene.data().points);
        let sum: f64 = all.map(|(e, p)| f64::from(e.dot(p.n()).x)).sum();
        // The second of a probe's three rows starts with the mean over all directions.
        let around = frame.probes().chunks_exact(3).map(|e| f64::from(e[1].x[0]));
        let space: f64 = around.sum();
        println!("{transmittances:?}: {sum:.4} on surfaces, {space:.4} at probes");
        sum + space
    };
    let open = sum(&[]);
    assert!(open > 100.0, "{open}");
    let inner = sum(&[1.0, 0.0]);
    assert!(inner.abs() < 0.01 * open, "{inner} of {open}");
    // Two half-open shutters transmit a quarter.
    let both = sum(&[0.5, 0.5]) / open;
    assert!((0.2..0.3).contains(&both), "{both}");
    let one = sum(&[0.5, 1.0]) / open;
    assert!((0.45..0.6).contains(&one), "{one}");
}

#[test]
fn invalid_occluder_recipes_are_rejected() {
    let mesh = rooms(Opening::Open);
    let fails =
        |recipe: &Recipe| bake_scene(&mesh, recipe, 0, &Progress::default()).expect_err("no bake");
    let named = |names: &[&str]| Recipe {
        occluders: names.iter().map(|&n| OccluderDesc::node(n)).collect(),
        ..Recipe::default()
    };
    let missing = fails(&named(&["gate"]));
    assert!(
        matches!(&missing, BakeSceneError::Bake(BakeError::UnknownOccluder { name }) if name == "gate"),
        "{missing}"
    );
    assert!(missing.to_string().contains("`gate`"));
    let many: Vec<String> = (0..65).map(|i| format!("door {i}")).collect();
    let many: Vec<&str> = many.iter().map(String::as_str).collect();
    let with_box = |center: [f32; 3], half_edges: [f32; 3]| Recipe {
        occluders: vec![OccluderDesc {
            name: "door".into(),
            boxes: vec![OccluderBox { center, half_edges }],
        }],
        ..Recipe::default()
    };
    let baked_bounces = Recipe {
        bounce_mode: meshless_gi::BounceMode::Baked,
        ..with_box([0.0; 3], [1.0; 3])
    };
    let other_method = Recipe {
        transport: TransportMethod::L08,
        ..with_box([0.0; 3], [1.0; 3])
    };
    for (wrong, message) in [
        (named(&[""]), "0 bytes"),
        (named(&["a", "b", "a"]), "two occluders `a`"),
        (named(&many), "65 entries"),
        (with_box([f32::NAN, 0.0, 0.0], [1.0; 3]), "boxes"),
        (with_box([0.0; 3], [1.0, 0.0, 1.0]), "boxes"),
        (with_box([0.0; 3], [1.0, -1.0, 1.0]), "boxes"),
        (baked_bounces, "bounce mode Runtime"),
        (other_method, "transport Bounded"),
    ] {
        let error = fails(&wrong).to_string();
        assert!(
            error.contains("occluders") && error.contains(message),
            "{error}"
        );
    }
    let text = "(occluders: [(name: \"door\", boxes: [(center: (0, 1, 2), half_edges: (1, 1, 1))]), (name: \"lift\")])";
    let read = Recipe::from_ron(text).expect("a recipe");
    assert_eq!(read.occluders[0].boxes[0].center, [0.0, 1.0, 2.0]);
    assert_eq!(read.occluders[1], OccluderDesc::node("lift"));
    assert!(Recipe::from_ron("(occluders: [(name: \"door\", gain: 3)])").is_err());
}

#[test]
fn damaged_occluder_bake_is_rejected() {
    let small = Recipe {
        coarse_radius: Some(0.5),
        levels: Some(3),
        sender_levels: Some(2),
        refinement_levels: Some(0),
        rays_per_point: Some(64),
        ..recipe(vec![door()])
    };
    let scene = baked(&rooms(Opening::Open), &small);
    scene.validate().expect("a sound bake");
    type Damage = fn(&mut BakedScene);
    let damages: [(&str, Damage); 14] = [
        ("occluder triangles", |s| s.data_mut().occluders = None),
        ("occluder triangles", |s| {
            s.data_mut().bvh.triangles[0].occluder = 1
        }),
        ("occluder triangles", |s| {
            s.data_mut().bvh.triangles[0].transmittance = 0.5
        }),
        ("occluder triangles", |s| {
            s.data_mut().bvh.triangles.last_mut().unwrap().occluder = 2;
        }),
        ("occluder triangles", |s| {
            s.data_mut().bvh.triangles.last_mut().unwrap().transmittance = 7.0;
        }),
        ("occluder names", |s| {
            s.data_mut().occluders.as_mut().unwrap().names[0].clear()
        }),
        ("occluder names", |s| {
            let names = &mut s.data_mut().occluders.as_mut().unwrap().names;
            *names = vec!["door".into(); 2];
        }),
        ("occluder sets", |s| {
            s.data_mut().occluders.as_mut().unwrap().sets[1] = 2
        }),
        ("occluder sets", |s| {
            s.data_mut().occluders.as_mut().unwrap().sets.reverse()
        }),
        ("occluded link terms", |s| {
            s.data_mut().occluders.as_mut().unwrap().sets.truncate(1)
        }),
        ("occluded link terms", |s| {
            s.data_mut().occluders.as_mut().unwrap().links[0].link = u32::MAX
        }),
        ("occluded link terms", |s| {
            s.data_mut().occluders.as_mut().unwrap().links[3].xy ^= 0x40
        }),
        ("occluded link terms", |s| {
            s.data_mut().occluders.as_mut().unwrap().links.swap(0, 1)
        }),
        ("occluded probe link terms", |s| {
            s.data_mut()
                .occluders
                .as_mut()
                .unwrap()
                .probes
                .push(PackedLinkTerm::default());
        }),
    ];
    for (location, damage) in damages {
        let mut broken = scene.clone();
        damage(&mut broken);
        let found = broken.validate().expect_err(location);
        assert!(
            found.iter().any(|v| v.location == location),
            "{location}: {found:?}"
        );
        assert!(broken.to_bytes().is_err());
    }
    // Terms that cancel when open would create light when one occluder closes.
    let mut bright = scene.clone();
    let arrays = bright.data_mut();
    let occluders = arrays.occluders.as_mut().unwrap();
    let row = (arrays.operator.rows.iter())
        .find(|r| r.count > 0 && occluders.links.iter().any(|p| p.link == r.start))
        .copied();
    if let Some(row) = row {
        let at = occluders.links.partition_point(|p| p.link < row.start);
        let one = 0x3c00_3c00;
        occluders.links[at].xy = one;
        assert!(bright.validate().is_err());
    }
    // Every damaged byte of the new sections is detected.
    let bytes = scene.to_bytes().unwrap();
    let behind = bytes.len() - 2000;
    for at in (behind..bytes.len()).step_by(97) {
        let mut broken = bytes.clone();
        broken[at] ^= 0x10;
        assert!(
            BakedScene::from_bytes(&broken, &Limits::default()).is_err(),
            "{at}"
        );
    }
}
