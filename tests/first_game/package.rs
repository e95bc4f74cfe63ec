//! A package in an empty folder with one program a binary, built like the tests.

use std::path::{Path, PathBuf};
use std::process::Command;

/// The built package; its folder goes with it.
pub struct Package {
    _folder: tempfile::TempDir,
    target: PathBuf,
    prefix: String,
}

impl Package {
    /// Builds `programs`, pairs of a name and a program's text. The plugin of `measure.rs` is added
    /// to each; nothing else is changed.
    pub fn build(programs: &[(&str, &str)]) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        let prefix = "meshless_gi_first_game_".to_string();
        let source = folder.path().join("src/bin");
        std::fs::create_dir_all(&source).expect("a folder");
        let measure = root.join("tests/first_game/measure.rs");
        for (name, text) in programs {
            let runs = "\n        .run();";
            assert_eq!(
                text.matches(runs).count(),
                1,
                "{name} runs one app:\n{text}"
            );
            let added = format!("\n        .add_plugins(measure::MeasurePlugin){runs}");
            let text = text.replacen(runs, &added, 1);
            let text = format!("#[path = {measure:?}]\nmod measure;\n\n{text}");
            std::fs::write(source.join(format!("{prefix}{name}.rs")), text).expect("a program");
        }
        std::fs::write(folder.path().join("Cargo.toml"), manifest(root)).expect("a manifest");
        std::fs::copy(root.join("Cargo.lock"), folder.path().join("Cargo.lock")).expect("a lock");
        let target = target_folder();
        let output = Command::new(env!("CARGO"))
            .args(["build", "--offline", "--bins", "--message-format=short"])
            .current_dir(folder.path())
            .env("CARGO_TARGET_DIR", &target)
            .output()
            .expect("cargo starts");
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{text}");
        // The engine is not built a second time.
        let again: Vec<&str> = text
            .lines()
            .filter(|line| line.trim_start().starts_with("Compiling bevy_"))
            .filter(|line| !line.contains("bevy_meshless_gi"))
            .collect();
        assert!(again.is_empty(), "built a second time: {again:#?}");
        Self {
            _folder: folder,
            target,
            prefix,
        }
    }

    /// The path of a program.
    pub fn program(&self, name: &str) -> PathBuf {
        let name = format!("{}{name}{}", self.prefix, std::env::consts::EXE_SUFFIX);
        self.target.join("debug").join(name)
    }
}

/// The target folder of the tests: they lie in `target/debug/deps`.
fn target_folder() -> PathBuf {
    let test = std::env::current_exe().expect("the test has a path");
    let folder = test.ancestors().nth(3).expect("target/debug/deps/test");
    folder.to_path_buf()
}

/// A section of this package's manifest, without its heading.
fn section<'a>(manifest: &'a str, heading: &str) -> &'a str {
    let at = manifest
        .find(heading)
        .expect("the manifest has the section")
        + heading.len();
    let rest = &manifest[at..];
    &rest[..rest.find("\n[").unwrap_or(rest.len())]
}

/// The manifest of the package. All dependencies of the workspace are named too, so that every
/// package has the features with which the tests were built.
fn manifest(root: &Path) -> String {
    let own = include_str!("../../Cargo.toml");
    let shared: String = section(own, "\n[workspace.dependencies]")
        .lines()
        .map(|line| line.replace("path = \"", &format!("path = \"{}/", root.display())) + "\n")
        .collect();
    let engine = section(own, "\n[dev-dependencies.bevy]");
    let profiles = own.find("\n[profile.").map_or("", |at| &own[at..]);
    let dev = section(own, "\n[profile.dev]");
    let members = ["meshless_gi", "meshless_gi_lab"];
    let members = members.map(|name| format!("[profile.dev.package.{name}]{dev}\n"));
    let plugin = section(own, "\n[profile.dev.package.bevy_meshless_gi]");
    format!(
        "[package]\nname = \"meshless_gi_first_game\"\nversion = \"0.0.0\"\nedition = \"2024\"\n\
         publish = false\n\n[workspace]\n\n[dependencies]\n\
         bevy_meshless_gi = {{ path = {root:?} }}\n{shared}\n[dependencies.bevy]{engine}\n\
         {profiles}\n{}[profile.dev.package.meshless_gi_first_game]{plugin}\n",
        members.concat()
    )
}
