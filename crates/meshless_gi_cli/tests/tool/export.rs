//! `export`: the files of the tool equal the results of the CPU kernels bit by bit.

use crate::support::data_path as data;
use glam::{Mat4, Vec3};
use half::f16;
use meshless_gi::internals::frame::volume::volume_texels;
use meshless_gi::internals::frame::{VolumeParams, VolumeValues, VoxelGrid, VoxelWeights};
use meshless_gi::internals::scene::SceneDescription;
use meshless_gi::{BakedScene, CpuFrame, FrameLight, FrameSettings, Limits, VolumePlacement};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;
use tempfile::TempDir;

fn tool() -> Command {
    Command::new(env!("CARGO_BIN_EXE_meshless_gi"))
}

fn output_text(ran: &Output) -> String {
    String::from_utf8_lossy(&ran.stderr).into_owned()
}

/// Returns the Cornell box with and without probes. Bakes once.
fn bakes() -> &'static (TempDir, PathBuf, PathBuf) {
    static BAKED: OnceLock<(TempDir, PathBuf, PathBuf)> = OnceLock::new();
    BAKED.get_or_init(|| {
        let folder = TempDir::new_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
        let recipe = folder.path().join("quick.gi.ron");
        let text = "(preset: Draft, rays: 64, levels: 4, sender_levels: 3, extra_levels: 0, epsilon: 0.03)";
        fs::write(&recipe, text).unwrap();
        let bake = |name: &str, options: &[&str]| {
            let out = folder.path().join(name);
            let mut run = tool();
            run.arg("bake").arg(data("cornell/cornell.glb")).arg("-o").arg(&out);
            run.arg("--recipe").arg(&recipe).args(options);
            let ran = run.output().unwrap();
            assert!(ran.status.success(), "{}", output_text(&ran));
            out
        };
        let with = bake("with.mgi", &["--probes", "--probe-spacing", "0.6"]);
        let without = bake("without.mgi", &[]);
        (folder, with, without)
    })
}

/// Runs the command and returns its exit code and its output.
fn export(bake: &Path, scene: &Path, out: &Path, options: &[&str]) -> (Option<i32>, String) {
    let mut run = tool();
    run.arg("export").arg(bake).arg("--scene").arg(scene);
    run.arg("--irradiance-volume").arg(out).args(options);
    let ran = run.output().unwrap();
    let text = output_text(&ran) + &String::from_utf8_lossy(&ran.stdout);
    assert!(!text.contains("panicked"), "{text}");
    (ran.status.code(), text)
}

/// Returns the size of a KTX 2.0 file in texels, and the texels.
fn texture(path: &Path) -> ([u32; 3], Vec<[f16; 4]>) {
    let file = fs::read(path).unwrap();
    let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap());
    let long = |at: usize| u64::from_le_bytes(file[at..at + 8].try_into().unwrap()) as usize;
    // VK_FORMAT_R16G16B16A16_SFLOAT, two bytes per component. One mip level, uncompressed.
    assert_eq!((word(12), word(16), word(40), word(44)), (97, 2, 1, 0));
    let size = [word(20), word(24), word(28)];
    let level = &file[long(80)..][..long(88)];
    let texels = level
        .chunks_exact(8)
        .map(|texel| std::array::from_fn(|k| f16::from_le_bytes([texel[2 * k], texel[2 * k + 1]])));
    (size, texels.collect())
}

fn placement(texture: &Path) -> VolumePlacement {
    let text = fs::read_to_string(texture.with_extension("ron")).unwrap();
    VolumePlacement::from_ron(&text).unwrap()
}

#[test]
fn export_texels_match_kernel() {
    let (folder, bake, _) = bakes();
    let (out, lights) = (folder.path().join("room.ktx2"), data("cornell/L0.json"));
    let (code, text) = export(bake, &lights, &out, &[]);
    assert_eq!(code, Some(0), "{text}");
    assert!(
        text.contains("room.ktx2") && text.contains("room.ron"),
        "{text}"
    );

    let scene = BakedScene::read(bake, &Limits::default()).unwrap();
    let description = SceneDescription::read(&lights).unwrap();
    let lights: Vec<FrameLight> = (description.lights.iter())
        .flat_map(|light| FrameLight::expand(light, 64))
        .collect();
    let mut frame = CpuFrame::new(&scene);
    frame.set_lights(&scene, &lights);
    frame.solve(&scene, &FrameSettings::bounces(scene.info().bounces));
    let shape = VoxelGrid::from_scene(scene.data(), None, 1 << 16).unwrap();
    let params = VolumeParams::new(&shape, &Mat4::IDENTITY);
    let values = VolumeValues {
        points: frame.vector_irradiance(),
        probes: frame.probes(),
    };
    let expected = volume_texels(
        &params,
        &VoxelWeights::from_scene(shape, scene.data()),
        values,
    );

    let placement = placement(&out);
    let (size, texels) = texture(&out);
    assert_eq!(size, shape.texels().to_array());
    assert_eq!(placement.resolution, shape.size().to_array());
    assert_eq!(placement.texture, "room.ktx2");
    assert_eq!(placement.lights, "L0.json");
    assert_eq!(placement.rotation, [0.0, 0.0, 0.0, 1.0]);
    let (center, edges) = (
        Vec3::from(placement.translation),
        Vec3::from(placement.scale),
    );
    let [low, high] = scene.info().bounds.map(Vec3::from);
    assert!((center - 0.5 * edges).cmplt(low).all() && (center + 0.5 * edges).cmpgt(high).all());
    let stored = |[r, g, b, way]: [f32; 4]| {
        let i = placement.intensity;
        [r / i, g / i, b / i, way].map(f16::from_f32)
    };
    let expected: Vec<[f16; 4]> = expected.into_iter().map(stored).collect();
    assert!(texels == expected, "the file has other texels");
    let lit = texels.iter().filter(|t| t[0] > f16::ZERO).count();
    assert!(
        2 * lit > texels.len(),
        "{lit} of {} texels are lit",
        texels.len()
    );
}

#[test]
fn export_any_thread_count_writes_equal_bytes() {
    let (folder, bake, _) = bakes();
    let lights = data("cornell/L0.json");
    let bytes = |name: &str, threads: &str| {
        let out = folder.path().join(name);
        let mut run = tool();
        run.arg("export").arg(bake).arg("--scene").arg(&lights);
        run.arg("--irradiance-volume")
            .arg(&out)
            .env("RAYON_NUM_THREADS", threads);
        assert!(run.status().unwrap().success());
        (fs::read(&out).unwrap(), placement(&out).translation)
    };
    assert!(bytes("one.ktx2", "1") == bytes("three.ktx2", "3"));
}

#[test]
fn export_brighter_light_raises_intensity() {
    let (folder, bake, _) = bakes();
    let at = |name: &str| folder.path().join(name);
    let volume = |name: &str, candela: f32| {
        let scene = format!(
            r#"{{"lights":[{{"type":"point","position":[2.7,4.5,2.7],"intensity":[{candela},{candela},{candela}]}}]}}"#
        );
        fs::write(at("light.json"), scene).unwrap();
        let (code, text) = export(bake, &at("light.json"), &at(name), &[]);
        assert_eq!(code, Some(0), "{text}");
        (placement(&at(name)).intensity, texture(&at(name)).1)
    };
    let peak = |texels: &[[f16; 4]]| {
        let colors = texels.iter().flat_map(|t| &t[..3]);
        colors.map(|v| v.to_f32()).fold(0.0, f32::max)
    };
    let (plain, texels) = volume("plain.ktx2", 1000.0);
    assert_eq!(plain, 1.0);
    for (name, factor) in [
        ("bright.ktx2", 2.0f32.powi(24)),
        ("dim.ktx2", 2.0f32.powi(-24)),
    ] {
        let (intensity, other) = volume(name, 1000.0 * factor);
        assert!(
            (intensity > 1.0) == (factor > 1.0) && intensity != 1.0,
            "{intensity}"
        );
        let (peak, expected) = (intensity * peak(&other), factor * peak(&texels));
        assert!(
            (peak / expected - 1.0).abs() < 1e-3,
            "{name}: {peak}, {expected}"
        );
        assert!(other.iter().flatten().all(|v| v.is_finite()), "{name}");
    }
    // Light above the limit of frames is clamped and stays finite.
    let (intensity, texels) = volume("most.ktx2", 1e38);
    assert!(intensity > 1e9 && intensity.is_finite() && peak(&texels) > 1.0);
    assert!(texels.iter().flatten().all(|v| v.is_finite()));
}

#[test]
fn export_options_change_volume() {
    let (folder, bake, _) = bakes();
    let lights = data("cornell/L0.json");
    let volume = |options: &[&str]| {
        let out = folder.path().join("options.ktx2");
        let (code, text) = export(bake, &lights, &out, options);
        assert_eq!(code, Some(0), "{text}");
        let light: f32 = texture(&out)
            .1
            .iter()
            .flat_map(|t| &t[..3])
            .map(|v| v.to_f32())
            .sum();
        let placement = placement(&out);
        (placement.resolution, light * placement.intensity)
    };
    let (plain, _) = volume(&[]);
    let (fine, _) = volume(&["--voxel", "0.2"]);
    let (few, one) = volume(&["--max-voxels", "500", "--bounces", "1"]);
    let (same, all) = volume(&["--max-voxels", "500", "--bounces", "all"]);
    let count = |size: [u32; 3]| size.iter().product::<u32>();
    assert!(count(fine) > count(plain) && count(plain) > count(few) && count(few) <= 500);
    assert_eq!(few, same);
    assert!(all > 1.2 * one, "{one} and {all}");
}

#[test]
fn export_invalid_input_has_exit_code() {
    let (folder, bake, without) = bakes();
    let at = |name: &str| folder.path().join(name);
    let (lights, out) = (data("cornell/L0.json"), at("wrong.ktx2"));
    let check = |code: i32, ran: (Option<i32>, String), word: &str| {
        assert_eq!(ran.0, Some(code), "{}", ran.1);
        assert!(ran.1.contains(word), "no {word}: {}", ran.1);
        assert!(!at("wrong.ktx2").exists());
    };
    check(1, export(without, &lights, &out, &[]), "--probes");
    check(
        1,
        export(&data("cornell/cornell.glb"), &lights, &out, &[]),
        "not a .mgi file",
    );
    check(3, export(&at("gone.mgi"), &lights, &out, &[]), "gone.mgi");
    check(3, export(bake, &at("gone.json"), &out, &[]), "gone.json");
    check(
        3,
        export(bake, &lights, &at("no/folder.ktx2"), &[]),
        "folder.ktx2",
    );
    check(2, export(bake, &lights, &at("wrong.ktx"), &[]), ".ktx2");
    for wrong in [["--voxel", "0"], ["--max-voxels", "0"], ["--bounces", "0"]] {
        check(2, export(bake, &lights, &out, &wrong), wrong[0]);
    }
    let varies =
        r#"{"lights":[{"type":"sky","zenith":[1,1,1],"horizon":[0,0,0],"ground":[0,0,0]}]}"#;
    fs::write(at("varies.json"), varies).unwrap();
    check(
        1,
        export(bake, &at("varies.json"), &out, &[]),
        "--sky harmonics",
    );
}
