//! Chapter of the book with the tool's help, and options that set a field of a recipe.
//! `MGI_TEST_UPDATE=1` writes the chapter.

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

/// Options of `bake` with the recipe's field that they set.
const OPTIONS: [(&str, &str); 14] = [
    ("preset", "preset"),
    ("viewpoint", "viewpoints"),
    ("coarse-radius", "coarse_radius"),
    ("levels", "levels"),
    ("sender-levels", "sender_levels"),
    ("rays", "rays_per_point"),
    ("bounces", "bounces"),
    ("rule", "transport"),
    ("epsilon", "truncation_error"),
    ("max-error", "target_nrmse"),
    ("sky", "sky"),
    ("dynamic-materials", "dynamic_materials"),
    ("occluder", "occluders"),
    ("seed", "seed"),
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
        "# Command-line tool\n\nGenerated from the tool's help. Do not edit.\n\
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

/// First sentence of the doc comment of a public field.
fn field_sentence(source: &str, field: &str) -> String {
    let head = format!("    pub {field}:");
    let before = source.split(&head).next().expect("text");
    assert!(before.len() < source.len(), "no field {field}");
    let mut doc: Vec<&str> = (before.lines().rev().skip_while(|l| l.trim().is_empty()))
        .map_while(|line| line.trim().strip_prefix("///"))
        .collect();
    doc.reverse();
    first_sentence(&doc.join(" "))
}

/// First sentence in lower case, without the marks of code, links and parameters.
fn first_sentence(text: &str) -> String {
    let text = text.to_lowercase().replace(['`', '\\'], "");
    let text = text.replace("(..)", "");
    let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
    let end = text.find(". ").unwrap_or(text.len());
    text[..end].trim_end_matches('.').to_string()
}

#[test]
fn options_begin_like_the_recipe_fields_that_they_set() {
    let recipe = root().join("crates/meshless_gi/src/bake/recipe.rs");
    let recipe = std::fs::read_to_string(recipe).expect("the source");
    let help = help(&["help", "bake"]);
    for (option, field) in OPTIONS {
        let line = help
            .lines()
            .find(|line| line.trim_start().starts_with(&format!("--{option} ")))
            .unwrap_or_else(|| panic!("no --{option}"));
        let (_, words) = line.trim_start().split_once("  ").expect("a help text");
        assert_eq!(
            first_sentence(words),
            field_sentence(&recipe, field),
            "--{option}"
        );
    }
    assert_eq!(first_sentence("A `b(..)`, \\[c\\]. D."), "a b, [c]");
}
