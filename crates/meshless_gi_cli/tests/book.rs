//! Chapter of the book with the tool's help, and options that set a field of a recipe.
//! `MGI_TEST_UPDATE=1` writes the chapter.

use documented::DocumentedFields;
use meshless_gi::{FmmRecipe, PcaRecipe, ProbeSettings, Recipe, VisibilityRecipe};
use std::fmt::Write;
use std::path::Path;
use std::process::Command;

const COMMANDS: [&str; 9] = [
    "bake",
    "eval",
    "export",
    "illuminate",
    "demo",
    "report",
    "scatter",
    "inspect",
    "validate",
];

fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

fn help(arguments: &[&str]) -> String {
    let run = Command::new(env!("CARGO_BIN_EXE_meshless_gi"))
        .args(arguments)
        .output()
        .expect("the tool starts");
    assert!(run.status.success(), "{arguments:?}");
    String::from_utf8(run.stdout).expect("text")
}

#[test]
fn tool_chapter_equals_its_help() {
    let mut text = String::from(
        "# Command-line tool\n\nGenerated from the tool's help.\nDo not edit.\n\
         Options of earlier versions are accepted, see [Migration](migration.md).\n\n",
    );
    let _ = writeln!(text, "```text\n{}\n```\n", help(&["--help"]).trim_end());
    for command in COMMANDS {
        let _ = writeln!(
            text,
            "## `{command}`\n\n```text\n{}\n```\n",
            help(&["help", command]).trim_end()
        );
    }
    let text = format!("{}\n", text.trim_end());
    let path = root().join("docs/book/src/reference/cli.md");
    if std::env::var_os("MGI_TEST_UPDATE").is_some() {
        std::fs::write(&path, &text).expect("a writable book");
    }
    let chapter = std::fs::read_to_string(&path).expect("the chapter");
    assert!(
        chapter == text,
        "docs/book/src/reference/cli.md differs from the help; run with MGI_TEST_UPDATE=1"
    );
}

#[test]
fn each_recipe_field_has_an_option_with_dashes_and_help() {
    let help = help(&["help", "bake"]);
    let options: Vec<(Vec<&str>, &str)> = (help.lines().map(str::trim))
        .filter(|line| line.starts_with("--"))
        .map(|line| {
            let (head, text) = line.split_once("  ").unwrap_or((line, ""));
            let words = line.split(|c: char| c.is_whitespace() || ",[]".contains(c));
            assert!(!text.is_empty(), "{head} has no help");
            (words.collect(), text.trim())
        })
        .collect();
    for (prefix, fields) in [
        ("", Recipe::FIELD_NAMES),
        ("pca-", PcaRecipe::FIELD_NAMES),
        ("fmm-", FmmRecipe::FIELD_NAMES),
        ("visibility-", VisibilityRecipe::FIELD_NAMES),
        ("probe-", ProbeSettings::FIELD_NAMES),
    ] {
        for field in fields {
            let option = format!("--{prefix}{}", field.replace('_', "-"));
            // The scene is the argument of the command.
            let present = options.iter().any(|(words, _)| words.contains(&&*option));
            assert!(present || option == "--scene", "no {option}");
        }
    }
}
