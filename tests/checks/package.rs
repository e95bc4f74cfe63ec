//! Contents of the published package: the files that a build needs, and no others.

use std::process::Command;

#[test]
fn package_contains_only_build_files() {
    let run = Command::new(env!("CARGO"))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(["package", "--list", "--allow-dirty", "--offline"])
        .output()
        .unwrap();
    let error = String::from_utf8_lossy(&run.stderr);
    assert!(run.status.success(), "{error}");
    let list = String::from_utf8(run.stdout).unwrap();
    let files: Vec<&str> = list.lines().collect();
    for needed in [
        "Cargo.toml",
        "CHANGELOG.md",
        "LICENSE-APACHE",
        "LICENSE-MIT",
        "README.md",
        "docs/book/src/SUMMARY.md",
        "src/lib.rs",
        "shaders/volume.wgsl",
        "shaders/lib/layout.wgsl",
        "shaders/engine/irradiance_volume.wgsl",
        "examples/cornell.rs",
    ] {
        assert!(files.contains(&needed), "{needed} is not in the package");
    }
    let unwanted = |file: &&&str| {
        let folder = ["tests/", ".ci/", "scripts/", "assets/", "out/"];
        folder.iter().any(|folder| file.starts_with(folder)) || file.ends_with(".png")
    };
    let found: Vec<_> = files.iter().filter(unwanted).collect();
    assert!(found.is_empty(), "{found:?}");
}
