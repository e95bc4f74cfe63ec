//! Point clouds as scenes. A Cornell box of points is compared with the reference integrator on the
//! same cells, and with the box of triangles below the points. The tool bakes `.ply` files alone
//! and together with meshes. Comparisons with a wrong input must fail.

use meshless_gi_lab::fixtures::points as points_support;

use glam::Vec3;
use meshless_gi::internals::samples::{Random, scatter};
use meshless_gi::internals::scene::{PlyEncoding, PlyPoints, read_ply, write_ply};
use meshless_gi::{
    BakedScene, Bounces, Geometry, Light, Limits, PointCloud, Preset, Quad, Ray, TriangleMesh,
};
use points_support::{REFLECTIONS, baked, direct, evaluate_bake, indirect, nrmse, reference};
use std::fs;
use std::path::Path;
use std::process::Command;

const CORNELL_BOX: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../tests/data/cornell/cornell.glb"
);

/// Minimum distance between points, in meters. The room has an edge of two meters.
const SPACING: f32 = 0.035;

fn light_source() -> [Light; 1] {
    [Light::Rect {
        center: Vec3::new(0.1, 1.9, 0.0),
        u: Vec3::X * 0.2,
        v: Vec3::Z * 0.2,
        radiance: Vec3::new(30.0, 27.0, 22.0),
    }]
}

/// Returns positions on the triangles of the box, with normals. They are visible from a camera in
/// front of the open side or from one below the ceiling.
fn samples(mesh: &TriangleMesh, count: u64) -> Vec<(Vec3, Vec3)> {
    (0..count)
        .filter_map(|k| {
            let mut r = Random::new(4, 4, k);
            let eye = if k % 2 == 0 {
                Vec3::new(0.0, 1.2, 2.5)
            } else {
                Vec3::new(0.2, 1.7, 0.3)
            };
            let to = Vec3::new(2.0 * r.unit() - 1.0, 2.0 * r.unit(), 2.0 * r.unit() - 1.0);
            let ray = Ray::new(eye, (to - eye).normalize());
            let surface = mesh.surface(&ray, &mesh.cast(&ray)?);
            Some((surface.position, surface.normal))
        })
        .collect()
}

#[test]
fn point_box_matches_triangle_box() {
    let solid = TriangleMesh::from_quads(&Quad::cornell_box());
    let points = scatter(&solid, SPACING, 1).expect("points");
    let samples = samples(&solid, 400);
    let truth = reference(&solid, &light_source(), &samples, 64);
    let bare = PlyPoints {
        normals: None,
        ..points.clone()
    };
    for (what, points, bounds) in [
        ("normals given", points, [0.045, 0.045, 0.04]),
        ("normals estimated", bare, [0.045, 0.045, 0.04]),
    ] {
        let cloud = PointCloud::new(points, &[]).expect("a cloud");
        let (cells, _) = cloud.mesh();
        let own = reference(&cells, &light_source(), &samples, 64);
        let scene = baked(&cells, Preset::Draft);
        let bytes = std::mem::size_of_val(&scene.data().bvh.nodes[..])
            + std::mem::size_of_val(&scene.data().bvh.triangles[..]);
        let (points, triangles) = (cloud.len(), cells.len());
        let (d, i) = evaluate_bake(
            &scene,
            cells,
            &light_source(),
            &samples,
            Bounces::Count(REFLECTIONS),
        );
        let found = [
            nrmse(&i, &own, indirect),
            nrmse(&i, &truth, indirect),
            nrmse(&d, &truth, direct),
        ];
        println!(
            "{what}: {points} points, {triangles} triangles, {bytes} bytes of shadow tree; NRMSE of indirect light {:.4} on the same cells, {:.4} on the box; \
             direct {:.4} on the box",
            found[0], found[1], found[2]
        );
        for (found, bound) in found.into_iter().zip(bounds) {
            assert!(found < bound, "{what}: {found}, at most {bound}");
        }
        // The same light at the wrong positions has a large error.
        let reversed: Vec<Vec3> = i.iter().rev().copied().collect();
        assert!(nrmse(&reversed, &truth, indirect) > 0.2);
        // Color bleeding: the floor next to the red wall is redder than next to the green one.
        let tint = |left: bool| {
            let near = |(x, n): &(Vec3, Vec3)| {
                n.y > 0.9 && x.y < 0.1 && (if left { -x.x } else { x.x }) > 0.75
            };
            let sum: Vec3 = samples
                .iter()
                .zip(&i)
                .filter(|(p, _)| near(p))
                .map(|(_, e)| *e)
                .sum();
            sum.x / sum.y
        };
        println!(
            "red over green next to the red wall {:.2}, next to the green wall {:.2}",
            tint(true),
            tint(false)
        );
        assert!(tint(true) > 1.5 * tint(false));
    }
}

/// Runs the tool.
fn tool(arguments: &[&str], code: i32) -> String {
    let ran = Command::new(env!("CARGO_BIN_EXE_meshless_gi"))
        .args(arguments)
        .output()
        .expect("the tool starts");
    let message =
        String::from_utf8_lossy(&ran.stderr).into_owned() + &String::from_utf8_lossy(&ran.stdout);
    assert_eq!(ran.status.code(), Some(code), "{arguments:?}: {message}");
    message
}

#[test]
fn tool_bakes_points_like_triangles() {
    the_tool_takes_points("Bounded");
}

#[test]
fn tool_bakes_points_with_fmm() {
    the_tool_takes_points("Fmm");
}

fn the_tool_takes_points(rule: &str) {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().expect("text").to_string();
    let (ply, again) = (at("box.ply"), at("again.ply"));
    let scattered = tool(
        &["scatter", CORNELL_BOX, "-o", &ply, "--spacing", "0.25"],
        0,
    );
    assert!(scattered.contains("points"), "{scattered}");
    tool(
        &["scatter", CORNELL_BOX, "-o", &again, "--spacing", "0.25"],
        0,
    );
    assert!(
        fs::read(&ply).unwrap() == fs::read(&again).unwrap(),
        "two runs differ"
    );
    let own = if rule == "Bounded" {
        "epsilon: 0.03"
    } else {
        "leaf: 16"
    };
    let settings = "preset: Draft, rays: 64, levels: 3, sender_levels: 2, extra_levels: 0";
    let recipe = format!("(scene: \"box.ply\", rule: {rule}, {settings}, {own})");
    fs::write(at("q.gi.ron"), recipe).unwrap();
    for (out, threads) in [("one.mgi", "1"), ("two.mgi", "3")] {
        tool(
            &[
                "bake",
                &at("q.gi.ron"),
                "-o",
                &at(out),
                "--threads",
                threads,
                "--stats",
                &at("s.json"),
            ],
            0,
        );
    }
    assert!(
        fs::read(at("one.mgi")).unwrap() == fs::read(at("two.mgi")).unwrap(),
        "threads change nothing"
    );
    let inspected = tool(&["inspect", &at("one.mgi")], 0);
    let octree = inspected
        .lines()
        .any(|l| l.contains("octree") && l.contains("nodes"));
    assert!(
        inspected.contains("links") && octree == (rule == "Fmm"),
        "{inspected}"
    );
    tool(&["validate", &at("one.mgi"), "--level", &ply], 0);
    let spot = r#"{"type":"spot","position":[2.78,5.4,2.795],"direction":[0,-1,0],"intensity":[10,9,7],"inner_deg":45,"outer_deg":65}"#;
    let sky = r#"{"type":"sky","radiance":[0.1,0.1,0.1]}"#;
    let scene =
        |lights: &str| format!(r#"{{"geometry":[{{"file":"box.ply"}}],"lights":[{lights}]}}"#);
    fs::write(at("s.json"), scene(&format!("{spot},{sky}"))).unwrap();
    // The direct light of a spot light uses no random numbers.
    fs::write(at("spot.json"), scene(spot)).unwrap();
    fs::write(
        at("p.csv"),
        "px,py,pz,nx,ny,nz\n2.0,0,4.0,0,1,0\n5.5,3,3,-1,0,0\n",
    )
    .unwrap();
    tool(
        &[
            "eval",
            &at("one.mgi"),
            "--scene",
            &at("s.json"),
            "--points",
            &at("p.csv"),
            "-o",
            &at("o.csv"),
        ],
        0,
    );
    let rows = fs::read_to_string(at("o.csv")).unwrap();
    let lit = |line: usize| -> Vec<f32> {
        rows.lines()
            .nth(line)
            .unwrap()
            .split(',')
            .map(|v| v.parse().unwrap())
            .collect()
    };
    for row in [lit(1), lit(2)] {
        assert!(
            row[6..12].iter().all(|e| *e > 0.0 && e.is_finite()) && row[12] == 1.0,
            "{row:?}"
        );
    }
    // The light at every point equals the output of `eval`. It is stored in the bake and as colors
    // of a cloud.
    let illuminate = |more: &[&str], out: &str| {
        let all = [
            "illuminate",
            &at("one.mgi"),
            "--scene",
            &at("spot.json"),
            "--irradiance",
            "-o",
            &at(out),
        ];
        tool(&[&all, more].concat(), 0);
        let cloud = read_ply(at(out)).unwrap();
        (
            cloud.positions,
            cloud.normals.unwrap(),
            cloud.albedo.unwrap(),
        )
    };
    let own = illuminate(&["--store", &at("lit.mgi")], "own.ply");
    let scan = illuminate(&["--points", &ply, "--ascii"], "scan.ply");
    let stored = BakedScene::read(Path::new(&at("lit.mgi")), &Limits::default()).unwrap();
    assert_eq!(stored.data().illumination.len(), stored.data().points.len());
    assert_eq!(own.2.len(), stored.data().points.len());
    for (color, light) in own.2.iter().zip(&stored.data().illumination) {
        assert!(color.abs_diff_eq(Vec3::from_array(*light), 1e-6 + 1e-5 * color.length()));
    }
    let mut points_csv = String::from("px,py,pz,nx,ny,nz\n");
    let mut expected = Vec::new();
    for (positions, normals, light) in [&own, &scan] {
        for i in (0..positions.len()).step_by(positions.len() / 20) {
            let (p, n) = (positions[i], normals[i]);
            points_csv += &format!("{},{},{},{},{},{}\n", p.x, p.y, p.z, n.x, n.y, n.z);
            expected.push(light[i]);
        }
    }
    fs::write(at("all.csv"), points_csv).unwrap();
    tool(
        &[
            "eval",
            &at("one.mgi"),
            "--scene",
            &at("spot.json"),
            "--points",
            &at("all.csv"),
            "-o",
            &at("all_out.csv"),
        ],
        0,
    );
    let rows = fs::read_to_string(at("all_out.csv")).unwrap();
    let (mut bright, mut count) = (0, 0);
    for (row, expected) in rows.lines().skip(1).zip(&expected) {
        let v: Vec<f32> = row.split(',').map(|v| v.parse().unwrap()).collect();
        // Direct light, then indirect light.
        let light = Vec3::new(v[6] + v[9], v[7] + v[10], v[8] + v[11]);
        assert!(
            light.abs_diff_eq(*expected, 1e-4 + 2e-3 * light.length()),
            "{light}, expected {expected}"
        );
        count += 1;
        bright += u32::from(light.x > 0.3);
    }
    // The values must not be all bright or all dark.
    assert!(
        count == expected.len() && bright > 5 && (bright as usize) < count,
        "{bright} of {count}"
    );
    // Changed points make the bake stale. Empty and truncated scenes are rejected.
    let moved = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::ONE];
    let mut bytes = Vec::new();
    write_ply(&mut bytes, PlyEncoding::Ascii, &moved, &[], &[]).unwrap();
    fs::write(at("four.ply"), bytes).unwrap();
    assert!(tool(&["validate", &at("one.mgi"), "--level", &at("four.ply")], 1).contains("stale"));
    fs::write(at("none.json"), r#"{"geometry":[],"lights":[]}"#).unwrap();
    assert!(tool(&["bake", &at("none.json"), "-o", &at("n.mgi")], 1).contains("names no file"));
    let cut = &fs::read(&ply).unwrap()[..5000];
    fs::write(at("cut.ply"), cut).unwrap();
    assert!(tool(&["bake", &at("cut.ply"), "-o", &at("n.mgi")], 1).contains("do not fit"));
}

/// Scan of the inside of a room without normals. Its surface faces the viewpoint inside, in the
/// bake and at lit points.
#[test]
fn scan_without_normals_faces_viewpoint() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().expect("text").to_string();
    let on = |i: u64| {
        let mut r = Random::new(3, 3, i);
        2.0 * meshless_gi::internals::samples::uniform_sphere(glam::Vec2::new(r.unit(), r.unit()))
    };
    let positions: Vec<Vec3> = (0..3000).map(on).collect();
    let mut bytes = Vec::new();
    write_ply(&mut bytes, PlyEncoding::LittleEndian, &positions, &[], &[]).unwrap();
    fs::write(at("scan.ply"), bytes).unwrap();
    let recipe = "(scene: \"scan.ply\", preset: Draft, rays: 64, levels: 3, sender_levels: 2, extra_levels: 0)";
    fs::write(at("scan.gi.ron"), recipe).unwrap();
    let (bake, scan) = (at("named.mgi"), at("scan.ply"));
    let named = ["--viewpoint", "0.1,0,0.2"];
    let all = ["bake", &at("scan.gi.ron"), "-o", &bake];
    let message = tool(&[&all[..], &named].concat(), 0);
    assert!(message.contains("no normals"), "{message}");
    tool(&["validate", &bake, "--level", &scan], 0);
    let light_source = r#"{"type":"point","position":[0,0.5,0],"intensity":[1,1,1]}"#;
    fs::write(
        at("s.json"),
        format!(r#"{{"geometry":[{{"file":"scan.ply"}}],"lights":[{light_source}]}}"#),
    )
    .unwrap();
    let (scene, out) = (at("s.json"), at("lit.ply"));
    let all = [
        "illuminate",
        &bake,
        "--scene",
        &scene,
        "--irradiance",
        "-o",
        &out,
    ];
    for more in [&["--points", &scan][..], &[]] {
        tool(&[&all, more].concat(), 0);
        let lit = read_ply(&out).unwrap();
        let (normals, light) = (lit.normals.unwrap(), lit.albedo.unwrap());
        assert!(lit.positions.len() > 100);
        // All normals of the scan face inside. A few points of the bake are outside, where rays
        // passed gaps between random points.
        let outwards = (0..normals.len()).filter(|&i| normals[i].dot(lit.positions[i]) >= 0.0);
        let max = if more.is_empty() {
            normals.len() / 20
        } else {
            0
        };
        let outwards = outwards.count();
        assert!(outwards <= max, "{outwards} of {}", normals.len());
        // At least the direct light inside the ball: 1 / (1.5..2.5)² times a cosine near one.
        let mean = light.iter().map(|e| e.x).sum::<f32>() / light.len() as f32;
        assert!(mean > 0.2, "{mean}");
    }
    // Without viewpoints, normals face outward.
    let outwards = PointCloud::new(read_ply(&scan).unwrap(), &[]).unwrap();
    assert!(outwards.normals[0].dot(outwards.positions[0]) > 0.0);
}

/// Point cloud in a room of triangles: one bake of both, and light from one on the other.
#[test]
fn bake_of_points_and_triangles_exchanges_light() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().expect("text").to_string();
    // Red ball of points in the middle of the white box.
    let ball = |i: u64| {
        let mut r = Random::new(8, 8, i);
        meshless_gi::internals::samples::uniform_sphere(glam::Vec2::new(r.unit(), r.unit()))
    };
    let normals: Vec<Vec3> = (0..2000).map(ball).collect();
    let positions: Vec<Vec3> = normals
        .iter()
        .map(|n| Vec3::new(2.0, 2.9, 4.0) + 0.6 * *n)
        .collect();
    let mut bytes = Vec::new();
    write_ply(
        &mut bytes,
        PlyEncoding::BigEndian,
        &positions,
        &normals,
        &[Vec3::new(0.9, 0.02, 0.02)].repeat(2000),
    )
    .unwrap();
    fs::write(at("ball.ply"), bytes).unwrap();
    let room = CORNELL_BOX.replace('\\', "/");
    fs::write(at("m.json"), format!(r#"{{"geometry":[{{"file":"{room}"}},{{"file":"ball.ply"}}],"lights":[{{"type":"point","position":[4,4.5,4],"intensity":[9,9,9]}}]}}"#)).unwrap();
    fs::write(
        at("r.json"),
        fs::read_to_string(at("m.json"))
            .unwrap()
            .replace(r#",{"file":"ball.ply"}"#, ""),
    )
    .unwrap();
    // Wall in the shadow of the ball, wall above it, ceiling over the lit side of the ball.
    let points_csv = "px,py,pz,nx,ny,nz\n0,1.3,4,1,0,0\n0,4.5,4,1,0,0\n2.6,5.48,4,0,-1,0\n";
    fs::write(at("mp.csv"), points_csv).unwrap();
    let light = |scene: &str| -> Vec<Vec<f32>> {
        let (json, out, csv) = (at(scene), at("m.mgi"), at("mo.csv"));
        let quick = [
            "--preset",
            "draft",
            "--rays",
            "256",
            "--levels",
            "4",
            "--sender-levels",
            "3",
        ];
        tool(&[&["bake", &json, "-o", &out][..], &quick].concat(), 0);
        tool(
            &[
                "eval",
                &out,
                "--scene",
                &json,
                "--points",
                &at("mp.csv"),
                "-o",
                &csv,
                "--bounces",
                "1",
            ],
            0,
        );
        let rows = fs::read_to_string(&csv).unwrap();
        let numbers = |l: &str| l.split(',').map(|v| v.parse().unwrap()).collect();
        rows.lines().skip(1).map(numbers).collect()
    };
    let (with, without) = (light("m.json"), light("r.json"));
    assert!(
        with[0][6] == 0.0 && without[0][6] > 0.0,
        "the ball does not shade the wall"
    );
    assert!(
        with[1][6] > 0.0 && with[1][6] == without[1][6],
        "the ball shades the whole wall"
    );
    let red = |row: &[f32]| row[9] / row[10];
    println!(
        "red over green on the ceiling {:.3}, without the ball {:.3}",
        red(&with[2]),
        red(&without[2])
    );
    assert!(
        red(&with[2]) > 1.05 * red(&without[2]),
        "the ball does not redden the ceiling"
    );
}
