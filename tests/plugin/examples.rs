//! Examples as programs: each bakes its scene, runs for some frames, writes a picture with the
//! table of its plan, and ends. Other tests measure the light.

use image::RgbImage;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Size of the pictures, in pixels.
const WIDTH: u32 = 480;
const HEIGHT: u32 = 270;

/// Builds an example with the options of the tests, so that nothing is built twice. Returns its
/// path.
fn program(example: &str) -> PathBuf {
    let built = Command::new(env!("CARGO"))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(["build", "--locked", "--workspace", "--example", example])
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&built.stderr);
    assert!(built.status.success(), "{text}");
    let test = std::env::current_exe().unwrap();
    // The test is in `target/debug/deps`.
    let folder = test.ancestors().nth(2).unwrap().join("examples");
    folder.join(format!("{example}{}", std::env::consts::EXE_SUFFIX))
}

/// Runs an example with these options. Returns its picture.
fn drawn(example: &str, options: &[&str]) -> RgbImage {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("examples");
    std::fs::create_dir_all(&folder).unwrap();
    let file: PathBuf = folder.join(format!("{example}.png"));
    let _ = std::fs::remove_file(&file);
    let mut command = Command::new(program(example));
    match example {
        "headless" => command.arg(&file),
        _ => command
            .arg("--screenshot")
            .arg(&file)
            .args(["--size", &format!("{WIDTH}x{HEIGHT}")]),
    };
    let run = command
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(options)
        .output()
        .unwrap();
    let stderr = String::from_utf8_lossy(&run.stderr);
    assert!(run.status.success(), "{example}: {}\n{stderr}", run.status);
    for bad in ["panicked", "ERROR"] {
        assert!(!stderr.contains(bad), "{example}:\n{stderr}");
    }
    image::open(&file).unwrap().into_rgb8()
}

/// Returns the fraction of bright pixels, such as letters, from `low` to `high` (0 to 1 along each
/// edge).
fn letters(picture: &RgbImage, low: [f32; 2], high: [f32; 2]) -> f32 {
    let at = |part: f32, edge: u32| (part * edge as f32) as u32;
    let (w, h) = picture.dimensions();
    let (mut white, mut all) = (0u32, 0u32);
    for y in at(low[1], h)..at(high[1], h) {
        for x in at(low[0], w)..at(high[0], w) {
            white += u32::from(picture.get_pixel(x, y).0.iter().all(|c| *c > 180));
            all += 1;
        }
    }
    white as f32 / all as f32
}

/// Asserts that a picture is neither black nor of a few colors.
fn assert_lit(example: &str, picture: &RgbImage) {
    let colors: std::collections::HashSet<[u8; 3]> = picture.pixels().map(|p| p.0).collect();
    let sum: f64 = picture.as_raw().iter().map(|&c| f64::from(c)).sum();
    let mean = sum / picture.as_raw().len() as f64;
    println!("{example}: mean {mean:.1} of 255, {} colors", colors.len());
    assert!(mean > 8.0 && colors.len() > 2000, "{example}: {mean}");
}

fn assert_runs(example: &str, options: &[&str]) {
    let picture = drawn(example, &[options, &["--frames", "16"]].concat());
    assert_eq!(picture.dimensions(), (WIDTH, HEIGHT));
    assert_lit(example, &picture);
    // The table is at the bottom on the left.
    let table = letters(&picture, [0.0, 0.75], [0.4, 1.0]);
    assert!(table > 0.05, "{example}: {table}");
}

#[test]
fn cornell_example_lights_box() {
    assert_runs("cornell", &["--press", "M,P"]);
}

#[test]
fn points_example_lights_statue() {
    assert_runs("points", &["--press", "M,P"]);
}

#[test]
fn load_gltf_example_lights_box() {
    let scene = "tests/data/cornell/cornell.glb";
    assert_runs("load_gltf", &[scene, "draft", "--press", "P"]);
}

#[test]
fn headless_example_writes_picture() {
    assert_lit("headless", &drawn("headless", &[]));
}

#[test]
fn emissive_signs_example_lights_street() {
    assert_runs("emissive_signs", &["--at", "2", "--press", "P"]);
}

#[test]
fn doors_example_lights_visitor() {
    assert_runs("doors", &["--at", "2", "--press", "P"]);
}

#[test]
fn time_of_day_example_lights_atrium() {
    assert_runs("time_of_day", &["--at", "6", "--press", "P"]);
}

/// The volume lights the room without the plugin: the first run bakes and exports, the second run
/// loads the files.
#[test]
fn exported_volume_example_lights_room_without_plugin() {
    let data = tempfile::TempDir::new_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let folder = data.path().to_str().unwrap();
    let lit = drawn("exported", &["--data", folder]);
    for file in ["room.ktx2", "room.ron"] {
        assert!(data.path().join(file).exists(), "no {file}");
    }
    let direct = drawn("exported", &["--data", folder, "--press", "Space"]);
    // Two sides of the blocks get no direct light: one faces the red wall, the other the green
    // wall.
    let patch = |picture: &RgbImage, [left, top]: [u32; 2]| {
        let pixels = (0..40).map(|i| picture.get_pixel(left + i % 2, top + i / 2).0);
        pixels.fold([0.0; 3], |sum, p| {
            [0, 1, 2].map(|k| sum[k] + f64::from(p[k]) / 40.0)
        })
    };
    let (red, green) = ([193, 150], [294, 190]);
    println!("{:?}, {:?}", patch(&lit, red), patch(&lit, green));
    let [r, g, _] = patch(&lit, red);
    assert!(r > 40.0 && r > 1.5 * g, "{r}, {g}");
    let [r, g, _] = patch(&lit, green);
    assert!(g > 40.0 && g > 1.2 * r, "{r}, {g}");
    for dark in [red, green] {
        assert!(patch(&direct, dark).iter().all(|v| *v < 5.0));
    }
}

#[test]
fn examples_reject_invalid_arguments() {
    let refused: [&[&str]; 7] = [
        &["--nonsense"],
        &["--size", "480x270"],
        &["--screenshot", "never.png", "--size"],
        &["--screenshot", "never.png", "--size", "480"],
        &["--screenshot", "never.png", "--size", "480x0"],
        &["--screenshot", "never.png", "--size", "9000x270"],
        &["--screenshot", "never.png", "--size", "-4x270"],
    ];
    let doors = program("doors");
    for arguments in refused {
        let run = Command::new(&doors)
            .current_dir(env!("CARGO_TARGET_TMPDIR"))
            .args(arguments)
            .output()
            .unwrap();
        let stderr = String::from_utf8_lossy(&run.stderr);
        let option = if arguments.contains(&"--size") {
            "--size"
        } else {
            arguments[0]
        };
        assert_eq!(run.status.code(), Some(2), "{arguments:?}: {stderr}");
        let (reason, usage) = stderr.split_once("usage: doors").expect("the usage");
        assert!(reason.contains(option), "{arguments:?}: {stderr}");
        assert!(usage.contains("--size WIDTHxHEIGHT"), "{stderr}");
    }
}
