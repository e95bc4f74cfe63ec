//! Tests of the built program: exit codes, files and output.

use crate::support::data;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::OnceLock;
use tempfile::TempDir;

const DONE: i32 = 0;
const INPUT: i32 = 1;
const USAGE: i32 = 2;
const IO: i32 = 3;

fn tool(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_meshless_gi"))
        .args(arguments)
        .stdin(Stdio::null())
        .output()
        .expect("the tool starts")
}

/// Runs the tool, checks its exit code and returns its output. Fails on a panic, and on the escape
/// sequences of progress bars.
fn expect(code: i32, arguments: &[&str]) -> (String, String) {
    let ran = tool(arguments);
    let out = String::from_utf8(ran.stdout).expect("text");
    let err = String::from_utf8(ran.stderr).expect("text");
    assert_eq!(ran.status.code(), Some(code), "{arguments:?}: {out}{err}");
    assert!(!err.contains("panicked"), "{arguments:?}: {err}");
    assert!(
        !out.contains('\u{1b}') && !err.contains('\u{1b}'),
        "progress bars without a terminal: {err}"
    );
    if code == INPUT || code == IO {
        assert!(err.contains("error: "), "{arguments:?}: no error message");
    }
    (out, err)
}

fn text(path: &Path) -> &str {
    path.to_str().expect("text")
}

/// Recipe that bakes in less than a second.
const QUICK: &str =
    "(preset: Draft, rays: 64, levels: 4, sender_levels: 3, extra_levels: 0, epsilon: 0.03)";

/// Returns the Cornell box, baked with [`QUICK`], and its statistics. Bakes once for all tests.
fn baked() -> &'static (TempDir, PathBuf, Value) {
    static BAKED: OnceLock<(TempDir, PathBuf, Value)> = OnceLock::new();
    BAKED.get_or_init(|| {
        // The folder is never dropped. It is in the build folder, not in a shared one.
        let folder = TempDir::new_in(env!("CARGO_TARGET_TMPDIR")).expect("a folder");
        let at = |name: &str| folder.path().join(name);
        fs::write(at("quick.gi.ron"), QUICK).unwrap();
        let (out, stats) = (at("cornell.mgi"), at("stats.json"));
        let (printed, _) = expect(
            DONE,
            &[
                "bake",
                &data("cornell/cornell.glb"),
                "-o",
                text(&out),
                "--recipe",
                text(&at("quick.gi.ron")),
                "--stats",
                text(&stats),
                "--threads",
                "2",
                "--ray-baseline",
            ],
        );
        for word in [
            "points",
            "links",
            "estimated error",
            "seconds",
            "ray baseline",
        ] {
            assert!(printed.contains(word), "no {word}: {printed}");
        }
        let stats = serde_json::from_slice(&fs::read(stats).unwrap()).expect("JSON");
        (folder, out, stats)
    })
}

#[test]
fn bake_stats_have_contract_fields() {
    let (_, out, stats) = baked();
    let seconds = &stats["seconds"];
    let mut parts = 0.0;
    for name in [
        "load", "bvh", "points", "gather", "refine", "bounces", "write", "estimate",
    ] {
        let s = seconds[name].as_f64().unwrap_or(f64::NAN);
        assert!(s >= 0.0, "{name}: {s}");
        parts += s;
    }
    let total = seconds["total"].as_f64().unwrap();
    assert!(
        parts <= total * 1.001 && parts > 0.5 * total,
        "{parts} of {total}"
    );
    for (name, value) in [("triangles", 30), ("threads", 2)] {
        assert_eq!(stats[name], value);
    }
    for name in ["rays", "links", "gather_rays"] {
        assert!(stats[name].as_u64().unwrap() > 1000, "{name}");
    }
    assert_eq!(
        stats["bytes"].as_u64().unwrap(),
        fs::metadata(out).unwrap().len()
    );
    assert_eq!(stats["points_per_level"].as_array().unwrap().len(), 4);
    assert!(stats["estimated_nrmse"].as_f64().unwrap() >= 0.0);
    assert!(stats["ray_baseline_seconds"].as_f64().unwrap() > 0.0);
    assert!(stats["total_over_ray_baseline"].as_f64().unwrap() > 1.0);
}

#[test]
fn bake_any_thread_count_writes_equal_bytes() {
    let (folder, out, _) = baked();
    let again = folder.path().join("one.mgi");
    let recipe = folder.path().join("quick.gi.ron");
    let bake = |more: &[&str]| {
        let scene = data("cornell/cornell.glb");
        let mut all = vec![
            "bake",
            &scene,
            "-o",
            text(&again),
            "--recipe",
            text(&recipe),
        ];
        all.extend(more);
        expect(DONE, &all);
        fs::read(&again).unwrap()
    };
    let first = fs::read(out).unwrap();
    assert!(
        bake(&["--threads", "1"]) == first,
        "the number of threads changes the bake"
    );
    assert!(bake(&["--seed", "7"]) != first, "the seed changes nothing");
}

/// Returns columns of a CSV file by name, as numbers.
fn columns(csv: &str, names: [&str; 3]) -> Vec<[f64; 3]> {
    let mut lines = csv.lines();
    let header: Vec<&str> = lines.next().expect("a header").split(',').collect();
    let at = names.map(|n| header.iter().position(|h| *h == n).expect("a column"));
    lines
        .map(|l| {
            let cells: Vec<&str> = l.split(',').collect();
            at.map(|i| cells[i].parse().expect("a number"))
        })
        .collect()
}

fn nrmse(values: &[[f64; 3]], reference: &[[f64; 3]]) -> f64 {
    assert_eq!(values.len(), reference.len());
    let (mut square, mut power) = (0.0, 0.0);
    for (a, b) in values.as_flattened().iter().zip(reference.as_flattened()) {
        square += (a - b).powi(2);
        power += b * b;
    }
    (square / power).sqrt()
}

#[test]
fn eval_is_near_ground_truth() {
    let (folder, bake, _) = baked();
    let truth = fs::read_to_string(data("cornell/L0.csv")).unwrap();
    let out = folder.path().join("out.csv");
    let eval = |more: &[&str]| {
        let (scene, points) = (data("cornell/L0.json"), data("cornell/L0.csv"));
        let mut all = vec![
            "eval",
            text(bake),
            "--scene",
            &scene,
            "--points",
            &points,
            "-o",
            text(&out),
        ];
        all.extend(more);
        let (printed, _) = expect(DONE, &all);
        assert_eq!(printed, "");
        fs::read_to_string(&out).unwrap()
    };
    let direct = ["direct_r", "direct_g", "direct_b"];
    let indirect = ["indirect_r", "indirect_g", "indirect_b"];
    let mut last = 0.0;
    for (bounces, name) in [
        ("1", "ind1"),
        ("2", "ind2"),
        ("4", "ind4"),
        ("all", "indinf"),
    ] {
        let ours = eval(&["--bounces", bounces]);
        let header = ours.lines().next().unwrap();
        assert_eq!(
            header,
            "px,py,pz,nx,ny,nz,direct_r,direct_g,direct_b,indirect_r,indirect_g,indirect_b,covered"
        );
        let truth_of = |prefix: &str| {
            let names = ["r", "g", "b"].map(|c| format!("{prefix}_{c}"));
            columns(&truth, [&names[0], &names[1], &names[2]])
        };
        assert!(nrmse(&columns(&ours, direct), &truth_of("direct")) < 0.01);
        let found = columns(&ours, indirect);
        let error = nrmse(&found, &truth_of(name));
        assert!(error < 0.2, "{bounces}: {error}");
        let sum: f64 = found.as_flattened().iter().sum();
        assert!(sum > last, "{bounces} bounces are not more than fewer");
        last = sum;
        let columns_read = ["px", "py", "pz"];
        assert_eq!(columns(&ours, columns_read), columns(&truth, columns_read));
        assert!(
            ours.lines()
                .skip(1)
                .all(|l| l.ends_with(",1") || l.ends_with(",0"))
        );
    }
    // The default is the number in the recipe.
    assert_eq!(eval(&[]), eval(&["--bounces", "4"]));
    // Tiers differ. The last tier has all links.
    let (json, _) = expect(DONE, &["inspect", text(bake), "--json"]);
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    let tiers = json["tiers"].as_array().unwrap();
    let truth = columns(&truth, ["ind4_r", "ind4_g", "ind4_b"]);
    let mut last = (String::new(), 0);
    for (number, tier) in (1..).zip(tiers) {
        assert_eq!(tier["tier"], number);
        assert!(tier["estimated_nrmse"].as_f64().unwrap() > 0.0);
        let links = tier["links"].as_u64().unwrap();
        assert!(links > last.1 && tier["bytes"] == 8 * links);
        let ours = eval(&["--tier", &number.to_string()]);
        assert!(ours != last.0, "tier {number}");
        let error = nrmse(&columns(&ours, indirect), &truth);
        assert!(error < 0.2, "tier {number}: {error}");
        last = (ours, links);
    }
    assert_eq!(last.0, eval(&[]));
    assert_eq!(tiers.last().unwrap()["share"], 1.0);
    assert_eq!(json["info"]["tiers"].as_array().unwrap().len(), tiers.len());
}

#[test]
fn eval_few_and_distant_points_succeed() {
    let (folder, bake, _) = baked();
    let at = |name: &str| folder.path().join(name);
    let (points, out, scene) = (at("p.csv"), at("few.csv"), data("cornell/L0.json"));
    let eval = |code: i32, csv: &str| {
        fs::write(&points, csv).unwrap();
        expect(
            code,
            &[
                "eval",
                text(bake),
                "--scene",
                &scene,
                "--points",
                text(&points),
                "-o",
                text(&out),
            ],
        )
    };
    eval(DONE, "nz,ny,nx,name,pz,py,px\r\n");
    assert_eq!(fs::read_to_string(&out).unwrap().lines().count(), 1);
    eval(DONE, "nz,ny,nx,name,pz,py,px\r\n0,1,0,far,1e3,1e30,0\r\n");
    let written = fs::read_to_string(&out).unwrap();
    assert!(
        written.ends_with(",0,0,0,0\n") && !written.contains("NaN"),
        "{written}"
    );
    for (csv, location) in [
        ("", "empty"),
        ("px,py,pz,nx,ny\n", "`nz`"),
        (
            "px,py,pz,nx,ny,nz\n0,0,0,0,1,0\n0,0,x,0,1,0\n",
            "line 3, column `pz`",
        ),
        ("px,py,pz,nx,ny,nz\n0,0,0,0,0,0\n", "line 2"),
        ("px,py,pz,nx,ny,nz\n0,0\n", "line 2, column `pz`"),
    ] {
        let (_, error) = eval(INPUT, csv);
        assert!(
            error.contains(location) && error.contains("p.csv"),
            "{error}"
        );
    }
}

#[test]
fn eval_invalid_input_has_exit_code() {
    let (folder, bake, _) = baked();
    let at = |name: &str| text(&folder.path().join(name)).to_string();
    let (scene, points, out) = (data("cornell/L0.json"), data("cornell/L0.csv"), at("e.csv"));
    let bake = text(bake);
    let eval = |code, bake: &str, scene: &str, points: &str, out: &str| {
        expect(
            code,
            &[
                "eval", bake, "--scene", scene, "--points", points, "-o", out,
            ],
        )
        .1
    };
    eval(IO, &at("no.mgi"), &scene, &points, &out);
    eval(IO, bake, &at("no.json"), &points, &out);
    eval(IO, bake, &scene, &at("no.csv"), &out);
    eval(IO, bake, &scene, &points, text(folder.path()));
    eval(INPUT, &data("cornell/cornell.glb"), &scene, &points, &out);
    eval(INPUT, bake, &points, &points, &out);
    eval(INPUT, bake, &scene, &scene, &out);
    // The direct light of the sky needs the geometry. That of lights does not.
    let sky = r#"{"geometry":[{"file":"gone.glb"}],"lights":[{"type":"sky","radiance":[1,1,1]}]}"#;
    fs::write(at("sky.json"), sky).unwrap();
    eval(IO, bake, &at("sky.json"), &points, &out);
    fs::write(
        at("dark.json"),
        r#"{"geometry":[{"file":"gone.glb"}],"lights":[]}"#,
    )
    .unwrap();
    let note = eval(DONE, bake, &at("dark.json"), &points, &out);
    assert!(note.contains("gone.glb"), "{note}");
    fs::write(
        at("bad.json"),
        r#"{"lights":[{"type":"sky","radiance":[1,-1,1]}]}"#,
    )
    .unwrap();
    assert!(eval(INPUT, bake, &at("bad.json"), &points, &out).contains("lights[0]"));
    // The sky varies, but the bake has a uniform sky.
    fs::write(
        at("varies.json"),
        r#"{"lights":[{"type":"sky","zenith":[1,1,1],"horizon":[0,0,0],"ground":[0,0,0]}]}"#,
    )
    .unwrap();
    let error = eval(INPUT, bake, &at("varies.json"), &points, &out);
    assert!(error.contains("--sky harmonics"), "{error}");
    for (code, wrong) in [
        (INPUT, ["--tier", "9"]),
        (INPUT, ["--tier", "0"]),
        (USAGE, ["--tier", "some"]),
        (USAGE, ["--bounces", "0"]),
        (USAGE, ["--bounces", "some"]),
    ] {
        let mut all = vec![
            "eval", bake, "--scene", &scene, "--points", &points, "-o", &out,
        ];
        all.extend(wrong);
        let (_, error) = expect(code, &all);
        assert!(
            code == USAGE || error.contains("tiers") || error.contains("1 to 4"),
            "{error}"
        );
    }
}

#[test]
fn bake_invalid_input_has_exit_code() {
    let folder = TempDir::new().unwrap();
    let at = |name: &str| text(&folder.path().join(name)).to_string();
    let write = |name: &str, bytes: &[u8]| {
        fs::write(at(name), bytes).unwrap();
        at(name)
    };
    let (scene_file, out) = (data("cornell/cornell.glb"), at("out.mgi"));
    let glb = fs::read(&scene_file).unwrap();
    let bake = |code, scene: &str, more: &[&str]| {
        let mut all = vec!["bake", scene, "-o", &out];
        all.extend(more);
        expect(code, &all).1
    };
    bake(IO, &at("no.glb"), &[]);
    bake(IO, &at("no.gi.ron"), &[]);
    bake(IO, text(folder.path()), &[]);
    let cut = bake(INPUT, &write("cut.glb", &glb[..glb.len() / 2]), &[]);
    assert!(cut.contains("cut.glb"), "{cut}");
    bake(INPUT, &write("empty.gltf", b""), &[]);
    bake(INPUT, &write("noise.glb", &[0xa7; 4000]), &[]);
    assert!(bake(INPUT, &write("cloud.ply", b"ply\n"), &[]).contains("no end_header"));
    assert!(bake(INPUT, &write("a.gi.ron", b"(preset: Best)"), &[]).contains("a.gi.ron"));
    assert!(bake(INPUT, &write("b.gi.ron", b"(preset: Draft)"), &[]).contains("names no scene"));
    bake(INPUT, &write("c.gi.ron", b"(scene: \"c.gi.ron\")"), &[]);
    bake(INPUT, &write("d.gi.ron", &[0xff, 0xfe]), &[]);
    bake(IO, &write("e.gi.ron", b"(scene: \"gone.glb\")"), &[]);
    let few = write("f.gi.ron", b"(levels: 2, sender_levels: 3)");
    assert!(bake(INPUT, &scene_file, &["--recipe", &few]).contains("sender_levels"));
    bake(INPUT, &scene_file, &["--viewpoint", "1e6,1e6,1e6"]);

    for wrong in [
        &["--rays", "0"][..],
        &["--rays", "-5"],
        &["--coarse-radius", "-1"],
        &["--coarse-radius", "NaN"],
        &["--levels", "99"],
        &["--levels", "2", "--sender-levels", "3"],
        &["--max-error", "0"],
        &["--epsilon", "inf"],
        &["--viewpoint", "1,2"],
        &["--viewpoint", "1,2,nan"],
        &["--preset", "best"],
        &["--rule", "none"],
        &["--threads", "-1"],
        &["--unknown"],
        &["--stats", &out],
    ] {
        bake(USAGE, &scene_file, wrong);
    }
    expect(USAGE, &[]);
    expect(USAGE, &["bake", &scene_file]);
    expect(USAGE, &["bake", &few, "-o", &out, "--recipe", &few]);
    // An input is not overwritten.
    let scene_copy = write("scene_copy.glb", &glb);
    expect(USAGE, &["bake", &scene_copy, "-o", &scene_copy]);
    assert!(fs::read(&scene_copy).unwrap() == glb);

    // Detected before the bake, which would take minutes at this preset.
    let slow = ["--preset", "high"];
    for target in [text(folder.path()), &at("no/such/folder.mgi")] {
        expect(
            IO,
            &[&["bake", &scene_file, "-o", target][..], &slow].concat(),
        );
    }
    let stats = at("no/such/stats.json");
    bake(IO, &scene_file, &[&["--stats", &stats][..], &slow].concat());
    assert!(!Path::new(&out).exists(), "a bake that failed left a file");
    let left: Vec<_> = fs::read_dir(folder.path())
        .unwrap()
        .map(|f| f.unwrap().file_name().into_string().unwrap())
        .filter(|name| name.ends_with(".tmp"))
        .collect();
    assert!(left.is_empty(), "{left:?}");
}

#[test]
fn bake_options_override_recipe() {
    let folder = TempDir::new().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::create_dir(at("levels")).unwrap();
    fs::copy(data("cornell/cornell.glb"), at("levels/box.glb")).unwrap();
    let recipe = QUICK.replace('(', "(scene: \"levels/box.glb\", bounces: 3, seed: 5, ");
    fs::write(at("box.gi.ron"), recipe).unwrap();
    expect(
        DONE,
        &[
            "bake",
            text(&at("box.gi.ron")),
            "-o",
            text(&at("box.mgi")),
            "--viewpoint",
            "-0.5,2.5,-1",
            "--viewpoint",
            "2.5,2.5,2.5",
            "--bounces",
            "2",
        ],
    );
    let (json, _) = expect(DONE, &["inspect", text(&at("box.mgi")), "--json"]);
    let json: Value = serde_json::from_str(&json).expect("JSON");
    let info = &json["info"];
    assert_eq!(info["bounces"], 2);
    assert_eq!(info["viewpoints"][0][0], -0.5);
    assert_eq!(info["viewpoints"].as_array().unwrap().len(), 2);
    assert!(
        info["recipe"].as_str().unwrap().contains("seed:5"),
        "{info}"
    );
    assert!(
        info["recipe"]
            .as_str()
            .unwrap()
            .contains("rays_per_point:64"),
        "{info}"
    );
}

#[test]
fn inspect_prints_sections() {
    let (_, bake, stats) = baked();
    let (json, _) = expect(DONE, &["inspect", text(bake), "--json"]);
    let json: Value = serde_json::from_str(&json).expect("JSON");
    assert_eq!(json["bytes"], stats["bytes"]);
    assert_eq!(json["stats"]["links"], stats["links"]);
    assert_eq!(json["stats"]["points_per_level"], stats["points_per_level"]);
    assert_eq!(json["info"]["triangles"], 30);
    let fingerprint = json["info"]["fingerprint"].as_str().unwrap();
    assert_eq!(fingerprint.len(), 64);
    // Header, table and sections are the file.
    let sections = json["sections"].as_array().unwrap();
    let bytes = |section: &Value| section["bytes"].as_u64().unwrap();
    let all: u64 = sections.iter().map(bytes).sum();
    let table = 32 + 40 * sections.len() as u64;
    assert_eq!(all + table, json["bytes"].as_u64().unwrap());
    let links = sections.iter().find(|s| s["name"] == "links").unwrap();
    assert_eq!(links["digest"].as_str().unwrap().len(), 64);
    assert!(bytes(links) > all / 4);
    let (table, _) = expect(DONE, &["inspect", text(bake)]);
    for word in [
        fingerprint,
        "estimated error",
        "recipe",
        "links",
        "memory",
        "points: ",
    ] {
        assert!(table.contains(word), "no {word}: {table}");
    }
}

#[test]
fn validate_reports_outdated_bake() {
    let folder = TempDir::new().unwrap();
    let at = |name: &str| folder.path().join(name);
    let (scene_file, bake) = (at("level.glb"), at("level.mgi"));
    for (options, level_of) in [
        (
            &["--preset", "draft", "--rays", "64"][..],
            "cornell/cornell.glb",
        ),
        (
            &["--preset", "draft", "--rays", "64", "--viewpoint", "0,1,0"][..],
            "cornell/cornell.glb",
        ),
    ] {
        fs::copy(data(level_of), &scene_file).unwrap();
        let mut arguments = vec!["bake", text(&scene_file), "-o", text(&bake)];
        arguments.extend(options);
        expect(DONE, &arguments);
        let check = ["validate", text(&bake), "--level", text(&scene_file)];
        assert!(expect(DONE, &check).0.contains(": valid"));
        fs::copy(data("rooms_open/rooms_open.glb"), &scene_file).unwrap();
        let (list, error) = expect(INPUT, &check);
        assert!(
            list.contains("stale") && list.contains("level.glb"),
            "{list}"
        );
        assert!(
            error.contains("stale") && error.contains("level.mgi"),
            "{error}"
        );
        // The bake is valid if it is not compared with the scene.
        expect(DONE, &["validate", text(&bake)]);
    }
}

#[test]
fn bake_named_node_becomes_occluder() {
    let folder = tempfile::tempdir().unwrap();
    let (scene_file, out) = (
        data("rooms_open/rooms_open.glb"),
        folder.path().join("o.mgi"),
    );
    let bake = |name: &str, code: i32| {
        let all = [
            "bake",
            &scene_file,
            "-o",
            text(&out),
            "--preset",
            "draft",
            "--rays",
            "64",
        ];
        expect(code, &[&all[..], &["--occluder", name]].concat())
    };
    bake("blue", DONE);
    assert!(expect(DONE, &["inspect", text(&out)]).0.contains("blue, "));
    // The occluder is part of the scene, so the bake is not stale.
    expect(DONE, &["validate", text(&out), "--level", &scene_file]);
    let (_, error) = bake("gate", INPUT);
    assert!(error.contains("`gate`"), "{error}");
    let (_, error) = bake("", USAGE);
    assert!(error.contains("occluders"), "{error}");
}

#[test]
fn validate_reports_damaged_file() {
    let (folder, bake, _) = baked();
    assert!(
        expect(DONE, &["validate", text(bake)])
            .0
            .contains(": valid")
    );
    let bytes = fs::read(bake).unwrap();
    let damaged = folder.path().join("damaged.mgi");
    let mut corrupted = bytes.clone();
    let last = corrupted.len() - 100;
    corrupted[last] ^= 0x10;
    for (bytes, word) in [
        (&bytes[..bytes.len() / 2], "cut off"),
        (&bytes[..3], "not a .mgi file"),
        (&corrupted, "checksum"),
        (&[], "not a .mgi file"),
    ] {
        fs::write(&damaged, bytes).unwrap();
        let (list, error) = expect(INPUT, &["validate", text(&damaged)]);
        assert!(list.contains("not valid") && list.contains(word), "{list}");
        assert!(
            error.contains(word) && error.contains("damaged.mgi"),
            "{error}"
        );
        expect(INPUT, &["inspect", text(&damaged)]);
    }
    for command in ["validate", "inspect"] {
        expect(IO, &[command, text(&folder.path().join("no.mgi"))]);
        expect(IO, &[command, text(folder.path())]);
        expect(USAGE, &[command]);
    }
}

#[test]
fn help_exits_with_success() {
    for arguments in [&["--help"][..], &["bake", "--help"], &["--version"]] {
        let (out, err) = expect(DONE, arguments);
        assert!(!out.is_empty() && err.is_empty(), "{out}{err}");
    }
    let (help, _) = expect(DONE, &["bake", "--help"]);
    for option in [
        "--recipe",
        "--preset",
        "--viewpoint",
        "--coarse-radius",
        "--levels",
        "--sender-levels",
        "--rays",
        "--bounces",
        "--rule",
        "--epsilon",
        "--max-error",
        "--seed",
        "--threads",
        "--stats",
    ] {
        assert!(help.contains(option), "no {option}");
    }
    expect(USAGE, &["demo", "--unknown"]);
    // The path of the folder is a file.
    expect(IO, &["demo", "-o", &data("cornell/L0.csv")]);
}

/// A pipe that is closed early is not an error. A full disk is an error.
#[cfg(target_os = "linux")]
#[test]
fn output_closed_pipe_succeeds_and_full_disk_fails() {
    let (_, bake, _) = baked();
    let run = |stdout: Stdio| {
        let mut child = Command::new(env!("CARGO_BIN_EXE_meshless_gi"))
            .args(["inspect", text(bake)])
            .stdout(stdout)
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        drop(child.stdout.take());
        let ran = child.wait_with_output().unwrap();
        (ran.status.code(), String::from_utf8(ran.stderr).unwrap())
    };
    assert_eq!(run(Stdio::piped()), (Some(DONE), String::new()));
    let full = fs::File::options().write(true).open("/dev/full").unwrap();
    let (code, error) = run(full.into());
    assert_eq!(code, Some(IO), "{error}");
    assert!(
        error.contains("standard output") && !error.contains("panicked"),
        "{error}"
    );
}
