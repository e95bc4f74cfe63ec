//! Damaged scenes through the tool: broken `.glb` files, exit codes, and the messages on
//! standard error.

use glam::Vec3;
use meshless_gi_lab::fixtures::hard_cases::{Triangles, room};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use tempfile::TempDir;

/// Returns a `.glb` file of one mesh without indices. All corners have the same normal. `material`
/// has the factors as JSON.
fn glb(triangles: &Triangles, normal: Vec3, material: &str) -> Vec<u8> {
    let corners: Vec<Vec3> = triangles.iter().flatten().copied().collect();
    let numbers = |all: &mut dyn Iterator<Item = Vec3>| -> Vec<u8> {
        all.flat_map(|v| v.to_array())
            .flat_map(f32::to_le_bytes)
            .collect()
    };
    let mut binary = numbers(&mut corners.iter().copied());
    let length = binary.len();
    binary.extend(numbers(&mut corners.iter().map(|_| normal)));
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"NORMAL":1}},"material":0}}]}}],
        "materials":[{material}],"buffers":[{{"byteLength":{}}}],
        "bufferViews":[{{"buffer":0,"byteLength":{length}}},{{"buffer":0,"byteOffset":{length},"byteLength":{length}}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":{count},"type":"VEC3","min":[0,0,0],"max":[2,2,2]}},
          {{"bufferView":1,"componentType":5126,"count":{count},"type":"VEC3"}}]}}"#,
        2 * length,
        count = corners.len(),
    );
    let mut json = json.into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut out = b"glTF\x02\0\0\0".to_vec();
    out.extend((28 + json.len() as u32 + binary.len() as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", json), (b"BIN\0", binary)] {
        out.extend((chunk.len() as u32).to_le_bytes());
        out.extend(kind);
        out.extend(chunk);
    }
    out
}

/// Runs the tool and returns exit code, standard output and standard error. Fails on a panic.
fn run(arguments: &[&str]) -> (i32, String, String) {
    let ran = Command::new(env!("CARGO_BIN_EXE_meshless_gi"))
        .args(arguments)
        .stdin(Stdio::null())
        .output()
        .expect("the tool starts");
    let err = String::from_utf8(ran.stderr).expect("text");
    assert!(!err.contains("panicked"), "{err}");
    let out = String::from_utf8(ran.stdout).expect("text");
    (ran.status.code().expect("no signal"), out, err)
}

const QUICK: &str = "(preset: Draft, rays: 64, levels: 3, sender_levels: 2, extra_levels: 0, places: 4, bounces: 1)";

fn bake(folder: &Path, scene_file: &[u8]) -> (i32, String, String) {
    let at = |name: &str| folder.join(name).to_str().expect("text").to_owned();
    fs::write(at("level.glb"), scene_file).unwrap();
    fs::write(at("quick.gi.ron"), QUICK).unwrap();
    let (recipe, out, stats) = (at("quick.gi.ron"), at("out.mgi"), at("stats.json"));
    run(&[
        "bake",
        &at("level.glb"),
        "--recipe",
        &recipe,
        "-o",
        &out,
        "--stats",
        &stats,
    ])
}

const GRAY: &str = r#"{"doubleSided":true,"pbrMetallicRoughness":{"metallicFactor":0,"baseColorFactor":[0.5,0.5,0.5,1]}}"#;
const WHITE: &str = r#"{"doubleSided":true,"emissiveFactor":[1,1,1],"pbrMetallicRoughness":{"metallicFactor":0,"baseColorFactor":[1,1,1,1]}}"#;

#[test]
fn bake_of_broken_scene_prints_warnings() {
    let folder = TempDir::new_in(env!("CARGO_TARGET_TMPDIR")).expect("a folder");
    let clean = room(Vec3::ZERO, Vec3::splat(2.0));
    // Normals that are NaN are replaced by those of the triangles.
    let (code, _, err) = bake(folder.path(), &glb(&clean, Vec3::NAN, GRAY));
    assert!(code == 0 || err.contains("error: "), "{code} {err}");
    let mut dirty = clean.clone();
    for wrong in [f32::NAN, f32::INFINITY, 0.0] {
        dirty.push([Vec3::ONE, Vec3::ONE, Vec3::splat(wrong)]);
    }
    let (code, _, err) = bake(folder.path(), &glb(&dirty, Vec3::Y, GRAY));
    assert_eq!(code, 0, "{err}");
    assert!(
        err.contains("3 triangles without area or without finite coordinates"),
        "{err}"
    );
    // A scene without a usable triangle.
    let (code, _, err) = bake(folder.path(), &glb(&vec![[Vec3::NAN; 3]], Vec3::Y, GRAY));
    assert!(
        code == 1 && err.contains("no usable triangle"),
        "{code} {err}"
    );
    let distant_room = room(Vec3::new(1e7, 0.0, 0.0), Vec3::splat(2.0));
    let (code, _, err) = bake(folder.path(), &glb(&distant_room, Vec3::Y, GRAY));
    assert!(code == 1 && err.contains("origin"), "{code} {err}");
}

#[test]
fn bake_of_lossless_room_prints_warning() {
    let folder = TempDir::new_in(env!("CARGO_TARGET_TMPDIR")).expect("a folder");
    let scene_file = glb(&room(Vec3::ZERO, Vec3::splat(2.0)), Vec3::Y, WHITE);
    let (code, out, err) = bake(folder.path(), &scene_file);
    assert_eq!(code, 0, "{err}");
    assert!(
        err.contains("converges too slowly") && out.contains("lowered by up to 0.10 %"),
        "{out}{err}"
    );
    let at = |name: &str| folder.path().join(name).to_str().expect("text").to_owned();
    let stats: Value = serde_json::from_slice(&fs::read(at("stats.json")).unwrap()).unwrap();
    let energy = &stats["energy"];
    assert!(
        energy["spectral_radius_bound"].as_f64().unwrap() < 1.0,
        "{energy}"
    );
    assert_eq!(energy["clamped_senders"], stats["senders"]);
    assert!(
        stats["warnings"][0]
            .as_str()
            .unwrap()
            .contains("converges too slowly")
    );
    let (code, out, _) = run(&["inspect", &at("out.mgi"), "--json"]);
    let info: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(code, 0);
    // The statistics write single precision numbers as double precision.
    for (name, reported) in energy.as_object().unwrap() {
        let inspected = &info["info"]["energy"][name];
        if reported.is_boolean() {
            assert_eq!(reported, inspected, "{name}");
            continue;
        }
        let [a, b] = [reported, inspected].map(|v| v.as_f64().unwrap());
        assert!((a - b).abs() <= 1e-6 * a.abs(), "{name}: {a} {b}");
    }
    let (code, out, _) = run(&["inspect", &at("out.mgi")]);
    assert!(
        code == 0 && out.contains("gain") && out.contains("not reciprocal"),
        "{out}"
    );

    // The light of all bounces is M / (1 − 0.999). M of it is direct.
    let description = r#"{"geometry":[{"file":"level.glb"}],"lights":[]}"#;
    fs::write(at("scene.json"), description).unwrap();
    fs::write(
        at("points.csv"),
        "px,py,pz,nx,ny,nz\n1,0,1,0,1,0\n0.1,0,0.1,0,1,0\n",
    )
    .unwrap();
    let arguments = [
        "eval",
        &at("out.mgi"),
        "--scene",
        &at("scene.json"),
        "--points",
        &at("points.csv"),
        "-o",
        &at("out.csv"),
        "--bounces",
    ];
    let (code, _, err) = run(&[&arguments[..], &["all"]].concat());
    assert_eq!(code, 0, "{err}");
    let table = fs::read_to_string(at("out.csv")).unwrap();
    let names: Vec<&str> = table.lines().next().unwrap().split(',').collect();
    let column = names.iter().position(|n| *n == "indirect_g").unwrap();
    for line in table.lines().skip(1) {
        let e: f32 = line.split(',').nth(column).unwrap().parse().unwrap();
        assert!(
            (e / (999.0 * std::f32::consts::PI) - 1.0).abs() < 0.01,
            "{line}"
        );
    }
    // More bounces than a frame can simulate are an error. They are not clamped silently.
    let (code, _, err) = run(&[&arguments[..], &["1000"]].concat());
    assert!(code == 2 && err.contains("256"), "{code} {err}");
}
