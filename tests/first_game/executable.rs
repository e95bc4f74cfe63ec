//! Programs of README in one executable, linked with the libraries that the tests use.

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Crates that the programs and `measure.rs` import.
const CRATES: [&str; 6] = [
    "bevy",
    "bevy_meshless_gi",
    "meshless_gi",
    "meshless_gi_lab",
    "half",
    "image",
];

/// Built executable. Dropping the value removes its folder.
pub struct Executable {
    _folder: tempfile::TempDir,
    program: PathBuf,
}

impl Executable {
    /// Builds `programs`, pairs of a name and a program's text, as modules of one executable. The
    /// first argument of the executable is the name of a program. The plugin of `measure.rs` is
    /// added to each program. The rest of the text is unchanged.
    pub fn build(programs: &[(&str, &str)]) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let measure = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/first_game/measure.rs");
        let mut main = format!("#[path = {measure:?}]\nmod measure;\n");
        let mut arms = String::new();
        for (name, text) in programs {
            let text = replace_one(text, "\nfn main() {", "\npub fn main() {");
            let added = "\n        .add_plugins(crate::measure::MeasurePlugin)\n        .run();";
            let text = replace_one(&text, "\n        .run();", added);
            std::fs::write(folder.path().join(format!("{name}.rs")), text).expect("a program");
            main += &format!("mod {name};\n");
            arms += &format!("        Some({name:?}) => {name}::main(),\n");
        }
        main += &format!(
            "fn main() {{\n    match std::env::args().nth(1).as_deref() {{\n{arms}        \
             other => panic!(\"no program {{other:?}}\"),\n    }}\n}}\n"
        );
        let source = folder.path().join("main.rs");
        std::fs::write(&source, main).expect("a program");
        let name = format!("first_game{}", std::env::consts::EXE_SUFFIX);
        let program = folder.path().join(name);
        run_command(
            Command::new(Path::new(env!("CARGO")).with_file_name("rustc"))
                .args(["--edition", "2024"])
                .args(library_arguments())
                .arg("-o")
                .args([&program, &source]),
        );
        Self {
            _folder: folder,
            program,
        }
    }

    /// Returns the path of the executable.
    pub fn path(&self) -> &Path {
        &self.program
    }
}

/// Returns `text` with its only `from` replaced by `to`. Panics if `from` does not occur exactly
/// once.
#[track_caller]
fn replace_one(text: &str, from: &str, to: &str) -> String {
    assert_eq!(text.matches(from).count(), 1, "one `{from}` in\n{text}");
    text.replacen(from, to, 1)
}

/// Runs a command and returns its output.
#[track_caller]
fn run_command(command: &mut Command) -> Output {
    let output = command.output().expect("the command starts");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?}\n{errors}");
    output
}

/// Returns the compiler arguments that name the libraries with which this test was built.
fn library_arguments() -> Vec<String> {
    let test = std::env::current_exe().expect("the test has a path");
    let target = test.ancestors().nth(3).expect("target/debug/deps/test");
    let output = run_command(
        Command::new(env!("CARGO"))
            .args([
                "test",
                "--workspace",
                "--offline",
                "--no-run",
                "--test",
                "first_game",
            ])
            .arg("--message-format=json")
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .env("CARGO_TARGET_DIR", target),
    );
    let text = String::from_utf8(output.stdout).expect("cargo prints UTF-8");
    let messages = text
        .lines()
        .filter_map(|line| serde_json::from_str::<Value>(line).ok());
    let deps = target.join("debug/deps");
    let mut arguments = vec![format!("-Ldependency={}", deps.display())];
    let mut found = Vec::new();
    for message in messages {
        let strings = |value: &Value| -> Vec<String> {
            let values = value.as_array().into_iter().flatten();
            values
                .filter_map(|v| v.as_str().map(String::from))
                .collect()
        };
        let folders = strings(&message["linked_paths"]);
        arguments.extend(folders.iter().map(|folder| format!("-L{folder}")));
        let name = message["target"]["name"].as_str().unwrap_or_default();
        let is_library = strings(&message["target"]["kind"]).contains(&"lib".to_string());
        let files = strings(&message["filenames"]);
        let library = files.iter().find(|file| file.ends_with(".rlib"));
        if let (true, true, Some(file)) = (CRATES.contains(&name), is_library, library) {
            found.push(name.to_string());
            arguments.push(format!("--extern={name}={file}"));
        }
    }
    found.sort_unstable();
    let mut expected = CRATES.map(String::from);
    expected.sort_unstable();
    assert_eq!(found, expected, "each library once");
    arguments
}
