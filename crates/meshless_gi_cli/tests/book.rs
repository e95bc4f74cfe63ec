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
const OPTIONS: [(&str, &str); 20] = [
    ("preset", "preset"),
    ("viewpoint", "viewpoints"),
    ("coarse-radius", "coarse_radius"),
    ("levels", "levels"),
    ("sender-levels", "sender_levels"),
    ("refinement-levels", "refinement_levels"),
    ("max-refinement-points", "max_refinement_points"),
    ("rays", "rays_per_point"),
    ("samples-per-sender", "samples_per_sender"),
    ("bounces", "bounces"),
    ("bounce-mode", "bounce_mode"),
    ("rule", "transport"),
    ("epsilon", "truncation_error"),
    ("receiver-tolerance", "receiver_tolerance"),
    ("max-error", "target_nrmse"),
    ("sky", "sky"),
    ("dynamic-materials", "dynamic_materials"),
    ("occluder", "occluders"),
    ("seed", "seed"),
    ("clip-planes", "clip_planes"),
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

/// Returns the first sentence of the doc comment of a public field.
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

/// Returns the names of the public fields of a structure.
fn fields<'a>(source: &'a str, name: &str) -> Vec<&'a str> {
    let head = format!("pub struct {name} {{\n");
    let (_, body) = source.split_once(&head).expect("the structure");
    let lines = body.lines().take_while(|line| *line != "}");
    let fields = lines.filter_map(|line| line.strip_prefix("    pub ")?.split_once(':'));
    fields.map(|(field, _)| field).collect()
}

#[test]
fn each_recipe_field_has_an_option_with_dashes() {
    let help = help(&["help", "bake"]);
    let words: Vec<&str> = help
        .split(|c: char| c.is_whitespace() || ",[]".contains(c))
        .collect();
    let mut count = 0;
    for (file, name, prefix) in [
        ("recipe", "Recipe", ""),
        ("transport_method", "PcaRecipe", "pca-"),
        ("transport_method", "FmmRecipe", "fmm-"),
        ("visibility", "VisibilityRecipe", "visibility-"),
        ("probes", "ProbeSettings", "probe-"),
    ] {
        let path = root().join(format!("crates/meshless_gi/src/bake/{file}.rs"));
        let source = std::fs::read_to_string(path).expect("the source");
        for field in fields(&source, name) {
            let option = format!("--{prefix}{}", field.replace('_', "-"));
            // The scene is the argument of the command.
            let present = words.contains(&option.as_str()) || option == "--scene";
            assert!(present, "{name}::{field} has no {option}");
            count += 1;
        }
    }
    assert!(count > 30, "the search finds {count} fields");
}

/// Returns the first sentence in lower case, without the marks of code, links and parameters.
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
        // clap appends other spellings.
        let words = words.split(" [alias").next().expect("a first part");
        assert_eq!(
            first_sentence(words),
            field_sentence(&recipe, field),
            "--{option}"
        );
    }
    assert_eq!(first_sentence("A `b(..)`, \\[c\\]. D."), "a b, [c]");
}
