//! Hostile input of the tool: endless files, files that are too large, and small files with a large
//! declared size. Each is rejected with an exit code and a message, within limited memory and
//! processor time.
#![cfg(target_os = "linux")]

use crate::support::data;
use std::fs::{self, File};
use std::io::Write;
use std::os::unix::fs::symlink;
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread;
use tempfile::TempDir;

const INPUT: i32 = 1;
const USAGE: i32 = 2;

/// Address space of the tool, in KiB. The declared sizes below exceed it.
const MEMORY: u32 = 768 * 1024;

/// Processor time of the tool, in seconds. A signal ends it after that.
const PROCESSOR_TIME: u32 = 120;

/// Runs the tool in little memory and returns standard error. The tool must exit with `code`,
/// without a panic or a signal.
fn run(code: i32, arguments: &[&str]) -> String {
    let limited = format!("ulimit -v {MEMORY} && ulimit -t {PROCESSOR_TIME} && exec \"$0\" \"$@\"");
    let ran = Command::new("sh")
        .args(["-c", &limited, env!("CARGO_BIN_EXE_meshless_gi")])
        .args(arguments)
        .env("RAYON_NUM_THREADS", "2")
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .output()
        .unwrap();
    let error = String::from_utf8_lossy(&ran.stderr).into_owned();
    assert_eq!(
        ran.status.code(),
        Some(code),
        "{arguments:?}: {:?} {error}",
        ran.status
    );
    assert!(!error.contains("panicked"), "{arguments:?}: {error}");
    error
}

/// Writes zeros to a named pipe until the end of the process. A tool that reads the pipe is stopped
/// by its limits, and does not wait for data forever.
fn write_zeros(pipe: &str) {
    // A pipe that is open for reading and writing does not wait for another process.
    let mut pipe = File::options().read(true).write(true).open(pipe).unwrap();
    thread::spawn(move || while pipe.write_all(&[0; 4096]).is_ok() {});
}

/// Temporary folder for hostile files.
struct Folder(TempDir);

impl Folder {
    fn new() -> Self {
        Self(TempDir::new_in(env!("CARGO_TARGET_TMPDIR")).unwrap())
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn text(&self, name: &str) -> String {
        self.at(name).to_str().unwrap().into()
    }

    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> String {
        fs::write(self.at(name), bytes).unwrap();
        self.text(name)
    }

    /// Bakes the scene and expects an error that names the file and contains all `words`.
    fn refuse(&self, scene_file: &str, options: &[&str], words: &[&str]) {
        let out = self.text("out.mgi");
        let mut all = vec!["bake", scene_file, "-o", &out];
        all.extend(options);
        let error = run(INPUT, &all);
        let name = Path::new(scene_file).file_name().unwrap().to_str().unwrap();
        for word in words.iter().chain([&name]) {
            assert!(error.contains(word), "{scene_file}: no {word}: {error}");
        }
    }
}

#[test]
fn readers_reject_device_pipe_and_socket() {
    let folder = Folder::new();
    let pipe = folder.text("pipe");
    assert!(
        Command::new("mkfifo")
            .arg(&pipe)
            .status()
            .unwrap()
            .success()
    );
    write_zeros(&pipe);
    let socket = folder.text("socket");
    let _open = UnixListener::bind(&socket).unwrap();
    let (scene_file, lights) = (data("cornell/cornell.glb"), data("cornell/L0.json"));
    let out = folder.text("out");
    for (special, kind) in [
        ("/dev/zero", "a device"),
        (&pipe, "a pipe"),
        (&socket, "a socket"),
    ] {
        let name = |ending: &str| {
            let name = folder.text(&format!("link.{ending}"));
            let _ = fs::remove_file(&name);
            symlink(special, &name).unwrap();
            name
        };
        let [glb, ply, json, ron, csv, mgi] =
            ["glb", "ply", "json", "gi.ron", "csv", "mgi"].map(name);
        let texture = folder.text("volume.ktx2");
        for arguments in [
            &["bake", special, "-o", &out][..],
            &["bake", &glb, "-o", &out],
            &["bake", &ply, "-o", &out],
            &["bake", &json, "-o", &out],
            &["bake", &ron, "-o", &out],
            &["bake", &scene_file, "-o", &out, "--recipe", &ron],
            &["scatter", &glb, "-o", &out],
            &["report", &glb, "-o", &out],
            &["inspect", &mgi],
            &["validate", &mgi],
            &["illuminate", &mgi, "--scene", &lights, "-o", &out],
            &[
                "eval", &mgi, "--scene", &lights, "--points", &csv, "-o", &out,
            ],
            &[
                "export",
                &mgi,
                "--scene",
                &lights,
                "--irradiance-volume",
                &texture,
            ],
        ] {
            let error = run(INPUT, arguments);
            assert!(error.contains(kind), "{arguments:?}: no {kind}: {error}");
        }
    }
}

/// Readers of the commands that take a valid bake.
#[test]
fn readers_after_valid_bake_reject_device() {
    let folder = Folder::new();
    let recipe =
        "(preset: Draft, rays: 16, levels: 2, sender_levels: 1, extra_levels: 0, probes: ())";
    let recipe = folder.write("quick.gi.ron", recipe);
    let (scene_file, lights) = (data("cornell/cornell.glb"), data("cornell/L0.json"));
    let (bake, out) = (folder.text("small.mgi"), folder.text("out"));
    run(0, &["bake", &scene_file, "-o", &bake, "--recipe", &recipe]);
    let zero = |name: &str| {
        symlink("/dev/zero", folder.at(name)).unwrap();
        folder.text(name)
    };
    let (json, ply) = (zero("zero.json"), zero("zero.ply"));
    let texture = folder.text("volume.ktx2");
    for arguments in [
        &[
            "eval",
            &bake,
            "--scene",
            &json,
            "--points",
            &data("cornell/L0.csv"),
            "-o",
            &out,
        ][..],
        &[
            "eval",
            &bake,
            "--scene",
            &lights,
            "--points",
            "/dev/zero",
            "-o",
            &out,
        ],
        &[
            "illuminate",
            &bake,
            "--scene",
            &lights,
            "--points",
            &ply,
            "-o",
            &out,
        ],
        &["illuminate", &bake, "--scene", &json, "-o", &out],
        &[
            "export",
            &bake,
            "--scene",
            &json,
            "--irradiance-volume",
            &texture,
        ],
        &["validate", &bake, "--level", "/dev/zero"],
    ] {
        let error = run(INPUT, arguments);
        assert!(error.contains("is a device"), "{arguments:?}: {error}");
    }
}

#[test]
fn scene_reference_to_special_file_is_rejected() {
    let folder = Folder::new();
    symlink("/dev/zero", folder.at("zero.bin")).unwrap();
    let buffer = r#"{"asset":{"version":"2.0"},"buffers":[{"uri":"zero.bin","byteLength":4}]}"#;
    let scene_file = folder.write("buffer.gltf", buffer);
    let out = folder.text("out.mgi");
    let error = run(INPUT, &["bake", &scene_file, "-o", &out]);
    assert!(error.contains("zero.bin: is a device"), "{error}");
    let scene_file = folder.write("image.gltf", textured(r#""uri":"zero.bin""#));
    let error = run(INPUT, &["bake", &scene_file, "-o", &out]);
    assert!(error.contains("zero.bin: is a device"), "{error}");
    let recipe = folder.write("zero.gi.ron", r#"(scene: "/dev/zero")"#);
    let error = run(INPUT, &["bake", &recipe, "-o", &out]);
    assert!(error.contains("/dev/zero: is a device"), "{error}");
    let scene = r#"{"geometry":[{"file":"zero.bin"}]}"#;
    let scene = folder.write("scene.json", scene);
    let error = run(INPUT, &["bake", &scene, "-o", &out]);
    assert!(error.contains("zero.bin: is a device"), "{error}");
}

#[test]
fn file_above_limit_is_rejected() {
    let folder = Folder::new();
    for name in ["huge.glb", "huge.ply", "huge.json", "huge.gi.ron"] {
        // Sparse file of 9 GiB.
        let file = File::create(folder.at(name)).unwrap();
        file.set_len(9 << 30).unwrap();
        folder.refuse(&folder.text(name), &[], &["9663676416 bytes", "8589934592"]);
    }
    let scene_file = data("cornell/cornell.glb");
    let size = fs::metadata(&scene_file).unwrap().len();
    folder.refuse(&scene_file, &["--max-input", "1KiB"], &["at most 1024"]);
    folder.refuse(
        &scene_file,
        &["--max-input", &(size - 1).to_string()],
        &["at most"],
    );
    let out = folder.text("points.ply");
    let enough = size.to_string();
    run(
        0,
        &[
            "--max-input",
            &enough,
            "scatter",
            &scene_file,
            "-o",
            &out,
            "--spacing",
            "1",
        ],
    );
    run(
        0,
        &[
            "scatter",
            &scene_file,
            "-o",
            &out,
            "--spacing",
            "1",
            "--max-input",
            "1MiB",
        ],
    );
    for wrong in ["", "many", "1GB", "-1"] {
        run(
            USAGE,
            &["scatter", &scene_file, "-o", &out, "--max-input", wrong],
        );
    }
    let bake = folder.write("large.mgi", vec![0; 2000]);
    for command in ["inspect", "validate"] {
        let error = run(INPUT, &[command, &bake, "--max-input", "1000"]);
        assert!(error.contains("1000 are allowed"), "{error}");
    }
}

/// Every reference of a scene to a file counts, also to the same file.
#[test]
fn scene_with_repeated_file_references_is_rejected() {
    let folder = Folder::new();
    folder.write("a.bin", vec![0; 100_000]);
    let one = r#"{"uri":"a.bin","byteLength":4}"#;
    let buffers = vec![one; 1000].join(",");
    let text = format!(r#"{{"asset":{{"version":"2.0"}},"buffers":[{buffers}]}}"#);
    let scene_file = folder.write("many.gltf", text);
    let out = folder.text("out.mgi");
    let error = run(
        INPUT,
        &["bake", &scene_file, "-o", &out, "--max-input", "5MiB"],
    );
    assert!(
        error.contains("a.bin") && error.contains("at most"),
        "{error}"
    );
}

/// Returns a scene of one textured square. `image` has the fields of its image.
fn textured(image: &str) -> String {
    let mut numbers: Vec<u8> = Vec::new();
    let corners = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    numbers.extend(corners.iter().flatten().flat_map(|v| v.to_le_bytes()));
    numbers.extend(
        [0.0f32, 0.0, 1.0, 0.0, 0.0, 1.0]
            .iter()
            .flat_map(|v| v.to_le_bytes()),
    );
    format!(
        r#"{{"asset":{{"version":"2.0"}},"nodes":[{{"mesh":0}}],
        "buffers":[{{"uri":"data:,{}","byteLength":60}}],
        "bufferViews":[{{"buffer":0,"byteLength":36}},{{"buffer":0,"byteOffset":36,"byteLength":24}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}},
                     {{"bufferView":1,"componentType":5126,"count":3,"type":"VEC2"}}],
        "images":[{{{image}}}],"textures":[{{"source":0}}],
        "materials":[{{"pbrMetallicRoughness":{{"baseColorTexture":{{"index":0}}}}}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":1}},"material":0}}]}}]}}"#,
        percent(&numbers)
    )
}

fn percent(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("%{b:02x}")).collect()
}

/// Returns a PNG of this size with a few bytes of pixels.
fn png(width: u32, height: u32) -> Vec<u8> {
    let mut out = b"\x89PNG\r\n\x1a\n".to_vec();
    let mut chunk = |kind: &[u8; 4], body: &[u8]| {
        out.extend((body.len() as u32).to_be_bytes());
        let content = [&kind[..], body].concat();
        out.extend(&content);
        out.extend(crc32fast::hash(&content).to_be_bytes());
    };
    let mut header = [width.to_be_bytes(), height.to_be_bytes()].concat();
    header.extend([8, 6, 0, 0, 0]);
    chunk(b"IHDR", &header);
    chunk(
        b"IDAT",
        &[0x78, 0x9c, 0x63, 0x60, 0x60, 0x60, 0, 0, 0, 4, 0, 1],
    );
    chunk(b"IEND", &[]);
    out
}

/// Returns the header of a JPEG of this size, without image data.
fn jpeg(width: u16, height: u16) -> Vec<u8> {
    let mut out = vec![0xff, 0xd8, 0xff, 0xdb, 0, 67, 0];
    out.extend([1; 64]);
    out.extend([0xff, 0xc0, 0, 17, 8]);
    out.extend(height.to_be_bytes());
    out.extend(width.to_be_bytes());
    out.extend([3, 1, 0x11, 0, 2, 0x11, 0, 3, 0x11, 0]);
    out.extend([0xff, 0xda, 0, 12, 3, 1, 0, 2, 0, 3, 0, 0, 63, 0]);
    out.extend([0xff, 0xd9]);
    out
}

#[test]
fn image_with_excess_declared_pixels_is_rejected() {
    let folder = Folder::new();
    for (name, image) in [
        ("png", png(16_384, 16_384)),
        ("jpeg", jpeg(16_000, 16_000)),
        ("rows", png(1, 16_384 * 16_384)),
        ("most", png(u32::MAX >> 1, u32::MAX >> 1)),
    ] {
        let uri = format!(r#""uri":"data:,{}""#, percent(&image));
        let scene_file = folder.write(&format!("{name}.gltf"), textured(&uri));
        folder.refuse(&scene_file, &[], &["image 0"]);
    }
    let uri = format!(r#""uri":"data:,{}""#, percent(&png(16_384, 16_384)));
    let scene_file = folder.write("named.gltf", textured(&uri));
    folder.refuse(&scene_file, &[], &["16384 x 16384 pixels do not fit"]);
}

#[test]
fn gltf_with_excess_declared_size_is_rejected() {
    let folder = Folder::new();
    let textured = textured(r#""uri":"data:,""#);
    let (start, end) = (
        textured.find(r#""images""#).unwrap(),
        textured.find(r#""meshes""#).unwrap(),
    );
    let square = (textured[..start].to_owned() + &textured[end..]).replace(r#","material":0"#, "");
    let with = |from: &str, to: &str| {
        assert!(square.contains(from), "{from}");
        square.replacen(from, to, 1)
    };
    let zeros = with(r#"{"bufferView":0,"#, "{");
    let many = |node: &str, text: &str| {
        let nodes = vec![node; 1000].join(",");
        text.replacen(r#"{"mesh":0}"#, &nodes, 1)
    };
    let million = zeros.replacen(r#""count":3"#, r#""count":4000000"#, 1);
    let sparse = r#"{"count":3,"sparse":{"count":9000000000,"indices":{"bufferView":0,"componentType":5125},"values":{"bufferView":0}},"#;
    for (name, text, word) in [
        (
            "count",
            with(r#""count":3"#, r#""count":4000000000000"#),
            "accessor 0",
        ),
        (
            "wide",
            with(r#""count":3"#, r#""count":18446744073709551615"#),
            "accessor 0",
        ),
        (
            "zeros",
            zeros.replacen(r#""count":3"#, r#""count":4000000000"#, 1),
            "accessor 0",
        ),
        (
            "view",
            with(r#""byteLength":36"#, r#""byteLength":9007199254740992"#),
            "buffer view 0",
        ),
        (
            "buffer",
            with(r#""byteLength":60"#, r#""byteLength":9007199254740992"#),
            "buffer 0",
        ),
        (
            "sparse",
            zeros.replacen(
                r#"{"componentType":5126,"count":3,"#,
                &format!(r#"{sparse}"componentType":5126,"#),
                1,
            ),
            "accessor 0",
        ),
        (
            "instances",
            many(r#"{"mesh":0}"#, &million),
            "triangles: 1333333000",
        ),
    ] {
        let scene_file = folder.write(&format!("{name}.gltf"), text);
        folder.refuse(&scene_file, &[], &[word]);
    }
    // Every three bytes of text take thousands of bytes of memory.
    let nodes = vec!["{}"; 4_400_000].join(",");
    let text = format!(r#"{{"asset":{{"version":"2.0"}},"nodes":[{nodes}]}}"#);
    let scene_file = folder.write("objects.gltf", text);
    folder.refuse(&scene_file, &[], &["JSON objects"]);
    // File length and chunk length above the size of the file.
    let glb = fs::read(data("cornell/cornell.glb")).unwrap();
    for (name, at) in [("length", 8), ("chunk", 12)] {
        let mut glb = glb.clone();
        glb[at..at + 4].copy_from_slice(&0xffff_fff0u32.to_le_bytes());
        let scene_file = folder.write(&format!("{name}.glb"), glb);
        folder.refuse(&scene_file, &[], &["4294967280 bytes"]);
    }
}

#[test]
fn ply_with_excess_declared_size_is_rejected() {
    let folder = Folder::new();
    let points = |format: &str, count: &str, more: &str| {
        format!(
            "ply\nformat {format} 1.0\nelement vertex {count}\nproperty float x\nproperty float y\nproperty float z\n{more}end_header\n0 0 0\n"
        )
    };
    let binary = "binary_little_endian";
    let faces = "element face 4000000000\nproperty list uint uint vertex_indices\n";
    for (name, text) in [
        ("binary", points(binary, "4000000000", "")),
        ("ascii", points("ascii", "8000000", "")),
        ("wide", points(binary, "18446744073709551615", "")),
        ("faces", points(binary, "0", faces)),
    ] {
        let scene_file = folder.write(&format!("{name}.ply"), text);
        folder.refuse(&scene_file, &[], &["do not fit"]);
    }
    // List with the largest 32-bit length.
    let list = "element face 1\nproperty list uint double vertex_indices\n";
    let mut bytes = points(binary, "0", list).into_bytes();
    bytes.truncate(bytes.len() - 6);
    bytes.extend([0xff; 8]);
    let scene_file = folder.write("list.ply", bytes);
    folder.refuse(&scene_file, &[], &["4294967295 values"]);
}

#[test]
fn deeply_nested_text_is_rejected() {
    let folder = Folder::new();
    let deep = "[".repeat(1_000_000);
    let recipe = folder.write("deep.gi.ron", format!("(viewpoints: {deep}"));
    folder.refuse(&recipe, &[], &["deep.gi.ron"]);
    let scene = folder.write("deep.json", format!(r#"{{"lights":{deep}"#));
    folder.refuse(&scene, &[], &["deep.json"]);
    let scene_file = folder.write("deep.gltf", format!(r#"{{"extras":{deep}"#));
    folder.refuse(&scene_file, &[], &["deep.gltf"]);
    let many = vec![r#"(name: "a")"#; 100_000].join(",");
    let recipe = folder.write("many.gi.ron", format!("(occluders: [{many}])"));
    folder.refuse(&recipe, &[], &["occluders"]);
    // File above the size limit of a description.
    let file = File::create(folder.at("large.json")).unwrap();
    file.set_len((1 << 26) + 1).unwrap();
    folder.refuse(&folder.text("large.json"), &[], &["67108864"]);
}
