//! The examples that a reader starts first, as programs: each bakes its level, runs, draws a
//! picture with the table of its plan over it, and ends. What is right about the light other tests
//! say.

use image::RgbImage;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Size of the pictures, in pixels.
const WIDTH: u32 = 480;
const HEIGHT: u32 = 270;

/// Builds an example as the tests are built, so that nothing is built twice, and returns its path.
fn program(example: &str) -> PathBuf {
    let built = Command::new(env!("CARGO"))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(["build", "--locked", "--workspace", "--example", example])
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&built.stderr);
    assert!(built.status.success(), "{text}");
    let test = std::env::current_exe().unwrap();
    // The test lies in `target/debug/deps`.
    let folder = test.ancestors().nth(2).unwrap().join("examples");
    folder.join(format!("{example}{}", std::env::consts::EXE_SUFFIX))
}

/// Runs an example until it has drawn a picture, with these options.
fn drawn(example: &str, options: &[&str]) -> RgbImage {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("examples");
    std::fs::create_dir_all(&folder).unwrap();
    let file: PathBuf = folder.join(format!("{example}.png"));
    let _ = std::fs::remove_file(&file);
    let run = Command::new(program(example))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .arg("--screenshot")
        .arg(&file)
        .args(["--size", &format!("{WIDTH}x{HEIGHT}")])
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

/// The part of the pixels from `low` to `high` (0 to 1 along each edge) that are bright, as
/// letters are.
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

fn runs(example: &str, at: &str) {
    let picture = drawn(example, &["--at", at, "--press", "P", "--frames", "16"]);
    assert_eq!(picture.dimensions(), (WIDTH, HEIGHT));
    // Lit: neither black nor of a few colors.
    let colors: std::collections::HashSet<[u8; 3]> = picture.pixels().map(|p| p.0).collect();
    let mean = picture
        .pixels()
        .map(|p| p.0.map(f64::from))
        .fold(0.0, |a, c| a + c.iter().sum::<f64>());
    let mean = mean / (3 * picture.pixels().len()) as f64;
    // The table stands at the bottom on the left.
    let table = letters(&picture, [0.0, 0.75], [0.4, 1.0]);
    println!(
        "{example}: mean {mean:.1} of 255, {} colors, letters {table:.3}",
        colors.len()
    );
    assert!(mean > 8.0 && colors.len() > 2000, "{example}: {mean}");
    assert!(table > 0.05, "{example}: {table}");
}

#[test]
fn emissive_signs_example_lights_street() {
    runs("emissive_signs", "2");
}

#[test]
fn doors_example_lights_visitor() {
    runs("doors", "2");
}

#[test]
fn time_of_day_example_lights_atrium() {
    runs("time_of_day", "6");
}

/// Without the plugin: the first run bakes and exports, the second one loads the files.
#[test]
fn exported_volume_example_lights_room_without_plugin() {
    let data = tempfile::TempDir::new_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let folder = data.path().to_str().unwrap();
    let lit = drawn("exported", &["--data", folder]);
    for file in ["room.ktx2", "room.ron"] {
        assert!(data.path().join(file).exists(), "no {file}");
    }
    let direct = drawn("exported", &["--data", folder, "--press", "Space"]);
    // Two sides of the blocks get no direct light: one faces the red wall, the other the green one.
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
