//! Rules of the repository: imports go one way, engine and device stay where they belong, citations
//! and decisions are defined, files stay short, and documents agree with the code. The checks read
//! text only. Each one also fails on a bad example.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Most lines of a file, by folder. Tests may be longer: they are lists of cases.
const MAX_LINES: [(&str, usize); 7] = [
    ("src", 700),
    ("crates/meshless_gi/src", 700),
    ("crates/meshless_gi_lab/src", 700),
    ("crates/meshless_gi_cli/src", 700),
    ("shaders", 700),
    ("examples", 700),
    ("tests", 1200),
];

/// Folders of libraries: each has a `lib.rs` with a table of its modules.
const LIBRARIES: [&str; 3] = [
    "src",
    "crates/meshless_gi/src",
    "crates/meshless_gi_lab/src",
];

fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

fn read(path: &str) -> String {
    fs::read_to_string(root().join(path)).unwrap_or_else(|why| panic!("{path}: {why}"))
}

/// All files below `folder` with one of the endings: path from the root with forward slashes, and
/// text.
fn files(folder: &str, endings: &[&str]) -> Vec<(String, String)> {
    fn collect(folder: &Path, found: &mut Vec<PathBuf>) {
        for entry in fs::read_dir(folder)
            .expect("a folder of this repository")
            .flatten()
        {
            let path = entry.path();
            if path.is_dir() {
                collect(&path, found);
            } else {
                found.push(path);
            }
        }
    }
    let mut found = Vec::new();
    collect(&root().join(folder), &mut found);
    found.sort();
    let ends = |p: &PathBuf| {
        p.extension()
            .is_some_and(|e| endings.iter().any(|w| e == *w))
    };
    let found: Vec<_> = found.into_iter().filter(ends).collect();
    assert!(!found.is_empty(), "no {endings:?} in {folder}");
    found
        .into_iter()
        .map(|path| {
            let text = fs::read_to_string(&path).expect("text");
            let name = path.strip_prefix(root()).expect("below the root");
            (name.to_string_lossy().replace('\\', "/"), text)
        })
        .collect()
}

/// Rust source without comments, strings and character literals; lines stay where they are.
fn code_only(text: &str) -> String {
    let s: Vec<char> = text.chars().collect();
    let at = |i: usize| s.get(i).copied().unwrap_or('\0');
    let mut out = String::with_capacity(text.len());
    let mut i = 0;
    // Everything skipped becomes a space or a line break.
    let skip = |out: &mut String, c: char| out.push(if c == '\n' { '\n' } else { ' ' });
    while i < s.len() {
        let c = s[i];
        let word_before = i > 0 && (s[i - 1].is_alphanumeric() || s[i - 1] == '_');
        if c == '/' && at(i + 1) == '/' {
            while i < s.len() && s[i] != '\n' {
                i += 1;
            }
        } else if c == '/' && at(i + 1) == '*' {
            let mut depth = 0;
            while i < s.len() {
                if at(i) == '/' && at(i + 1) == '*' {
                    depth += 1;
                    i += 2;
                } else if at(i) == '*' && at(i + 1) == '/' {
                    depth -= 1;
                    i += 2;
                } else {
                    skip(&mut out, s[i]);
                    i += 1;
                }
                if depth == 0 {
                    break;
                }
            }
            out.push(' ');
        } else if let Some(hashes) = raw_string(&s, i).filter(|_| !word_before) {
            while at(i) != '"' {
                i += 1;
            }
            i += 1;
            while i < s.len() && !(s[i] == '"' && (1..=hashes).all(|k| at(i + k) == '#')) {
                skip(&mut out, s[i]);
                i += 1;
            }
            i += 1 + hashes;
        } else if c == '"' {
            i += 1;
            while i < s.len() && s[i] != '"' {
                let step = if s[i] == '\\' { 2 } else { 1 };
                (0..step).for_each(|k| skip(&mut out, at(i + k)));
                i += step;
            }
            i += 1;
        } else if c == '\'' && (at(i + 1) == '\\' || at(i + 2) == '\'') {
            // A character; anything else with a quote is a lifetime.
            i += if at(i + 1) == '\\' { 3 } else { 2 };
            while i < s.len() && s[i] != '\'' {
                i += 1;
            }
            i += 1;
        } else {
            out.push(c);
            i += 1;
        }
    }
    out
}

/// How many hashes a raw string that starts at `i` has.
fn raw_string(s: &[char], mut i: usize) -> Option<usize> {
    if s.get(i) == Some(&'b') {
        i += 1;
    }
    if s.get(i) != Some(&'r') {
        return None;
    }
    let hashes = s[i + 1..].iter().take_while(|c| **c == '#').count();
    (s.get(i + 1 + hashes) == Some(&'"')).then_some(hashes)
}

/// The modules in the order of the table in `lib.rs`: each may use those above it.
fn order(lib: &str) -> Vec<String> {
    lib.lines()
        .filter_map(|l| l.strip_prefix("//! | "))
        .map(|l| l.split('|').next().unwrap_or_default().trim())
        .map(|cell| cell.trim_matches(['[', ']', '`']))
        .filter(|name| !name.is_empty() && *name != "module")
        .map(String::from)
        .collect()
}

/// The module that a file of a `src/` belongs to; none for `lib.rs`.
fn module_of(path: &str) -> Option<&str> {
    let (_, path) = path.split_once("src/")?;
    let first = path.split('/').next()?;
    let name = first.strip_suffix(".rs").unwrap_or(first);
    (name != "lib").then_some(name)
}

/// Identifiers that follow `prefix` in `code`, those in a group of braces too, with their lines.
fn named_after<'a>(code: &'a str, prefix: &str) -> Vec<(usize, &'a str)> {
    let mut names = Vec::new();
    for (start, _) in code.match_indices(prefix) {
        let before = code[..start].chars().next_back();
        if before.is_some_and(|c| c.is_alphanumeric() || c == '_' || c == ':') {
            continue;
        }
        let rest = &code[start + prefix.len()..];
        let line = 1 + code[..start].matches('\n').count();
        let word = |t: &'a str| {
            let t = t.trim_start();
            &t[..t
                .find(|c: char| !(c.is_alphanumeric() || c == '_'))
                .unwrap_or(t.len())]
        };
        let Some(group) = rest.trim_start().strip_prefix('{') else {
            names.push((line, word(rest)));
            continue;
        };
        // A group: its items on the first level.
        let mut depth = 0;
        let mut item = 0;
        for (i, c) in group.char_indices() {
            match c {
                '{' => depth += 1,
                '}' if depth > 0 => depth -= 1,
                ',' if depth > 0 => {}
                ',' | '}' => {
                    names.push((line, word(&group[item..i])));
                    item = i + 1;
                    if c == '}' {
                        break;
                    }
                }
                _ => {}
            }
        }
    }
    names.retain(|(_, name)| !name.is_empty());
    names
}

/// Uses of a module that stands further down in `order`. Unit tests may use what they like.
fn imports_upwards(path: &str, text: &str, order: &[String]) -> Vec<String> {
    let Some(own) = module_of(path).filter(|_| !path.ends_with("/tests.rs")) else {
        return Vec::new();
    };
    let text = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or("");
    let rank = |name: &str| order.iter().position(|m| m == name);
    let Some(own_rank) = rank(own) else {
        return vec![format!(
            "{path}: module `{own}` is not in the table of lib.rs"
        )];
    };
    let code = code_only(text);
    let mut used = named_after(&code, "crate::");
    if path.ends_with("/mod.rs") {
        used.extend(named_after(&code, "super::"));
    }
    used.extend(named_after(&code, "super::super::"));
    used.into_iter()
        .filter(|(_, name)| rank(name).is_some_and(|r| r > own_rank))
        .map(|(line, name)| format!("{path}:{line}: `{own}` uses `{name}`, which stands below it"))
        .collect()
}

/// Names of the graphics interface or the engine where they do not belong.
fn strangers(path: &str, text: &str) -> Vec<String> {
    let module = module_of(path).unwrap_or_default();
    let code = code_only(text);
    let mut found = Vec::new();
    for (number, line) in code.lines().enumerate() {
        for word in line.split(|c: char| !(c.is_alphanumeric() || c == '_')) {
            let device = (word == "wgpu" || word.starts_with("wgpu_"))
                && !matches!(module, "gpu" | "plugin");
            let engine = (word == "bevy" || word.starts_with("bevy_"))
                && word != "bevy_meshless_gi"
                && module != "plugin";
            if device || engine {
                found.push(format!("{path}:{}: names `{word}`", number + 1));
            }
        }
    }
    found
}

/// Citation keys such as L08 in square brackets, alone or before a place in the paper.
fn cited(text: &str) -> BTreeSet<String> {
    let key_of = |t: &str| {
        let letters = t.find(|c: char| !c.is_ascii_alphabetic())?;
        let end = letters
            + t[letters..]
                .find(|c: char| !c.is_ascii_digit())
                .unwrap_or(t.len() - letters);
        let closes = t[end..].starts_with([']', ' ', ',']);
        let is_key =
            t.starts_with(|c: char| c.is_ascii_uppercase()) && letters > 0 && end == letters + 2;
        (is_key && closes).then(|| t[..end].to_string())
    };
    text.match_indices('[')
        .filter_map(|(i, _)| key_of(&text[i + 1..]))
        .collect()
}

/// Keys that a bibliography defines: `- **[KEY]** …`. One that is defined twice is an error.
fn defined(bibliography: &str) -> Result<BTreeSet<String>, String> {
    let mut keys = BTreeSet::new();
    for line in bibliography.lines() {
        if let Some((key, _)) = line.strip_prefix("- **[").and_then(|l| l.split_once("]**"))
            && !keys.insert(key.to_string())
        {
            return Err(format!("[{key}] is defined twice"));
        }
    }
    Ok(keys)
}

/// Numbers n of "design Dn" or "Dn's" in comments, where n is a decision of docs/DECISIONS.md.
fn decisions_cited(text: &str) -> BTreeSet<u32> {
    text.match_indices("design D")
        .filter_map(|(i, m)| {
            let digits: String = text[i + m.len()..]
                .chars()
                .take_while(char::is_ascii_digit)
                .collect();
            digits.parse().ok()
        })
        .collect()
}

/// Relative links of a Markdown text that lead nowhere. Pictures are left out, for pages are read
/// without them too.
fn dead_links(text: &str, exists: impl Fn(&str) -> bool) -> Vec<String> {
    let mut dead = Vec::new();
    for (i, _) in text.match_indices("](") {
        let rest = &text[i + 2..];
        let Some(target) = rest.find(')').map(|end| &rest[..end]) else {
            continue;
        };
        let file = target.split('#').next().unwrap_or_default();
        let elsewhere = target.contains("://") || file.is_empty() || file.ends_with(".png");
        if !elsewhere && !exists(file) {
            dead.push(target.to_string());
        }
    }
    dead
}

/// Names of the public fields of `pub struct <name>`.
fn fields(source: &str, name: &str) -> Vec<String> {
    let head = format!("pub struct {name} {{");
    let body = source
        .split_once(&head)
        .map_or("", |(_, rest)| rest.split("\n}").next().unwrap_or(""));
    body.lines()
        .filter_map(|l| l.trim().strip_prefix("pub ")?.split(':').next())
        .map(String::from)
        .collect()
}

/// The numbers of one preset, in the order of the struct's fields.
fn preset(source: &str, name: &str) -> Vec<f64> {
    let head = format!("Self::{name} => QualityParameters {{");
    let body = source
        .split_once(&head)
        .map_or("", |(_, rest)| rest.split('}').next().unwrap_or(""));
    body.split(',')
        .filter_map(|f| f.split_once(':'))
        .map(|(_, value)| {
            let plain = value.trim().replace('_', "");
            plain.parse().unwrap_or(f64::NAN)
        })
        .collect()
}

/// The numbers of the table row of a Markdown text whose first cell is `name` in code type.
fn row(text: &str, name: &str) -> Vec<f64> {
    let head = format!("| `{name}` |");
    text.lines()
        .find_map(|l| l.strip_prefix(&head))
        .map(|cells| {
            cells
                .split('|')
                .filter_map(|c| c.trim().replace(' ', "").parse().ok())
                .collect()
        })
        .unwrap_or_default()
}

fn none(found: Vec<String>) {
    assert!(found.is_empty(), "\n{}\n", found.join("\n"));
}

#[test]
fn imports_go_one_way() {
    let mut found = Vec::new();
    for folder in LIBRARIES {
        let order = order(&read(&format!("{folder}/lib.rs")));
        assert!(
            order.len() > 2,
            "{folder}/lib.rs has no table of its modules"
        );
        for (path, text) in files(folder, &["rs"]) {
            found.extend(imports_upwards(&path, &text, &order));
        }
    }
    none(found);
}

#[test]
fn the_import_check_objects() {
    let order: Vec<String> = ["scene", "frame", "gpu"].map(String::from).into();
    let check = |path: &str, text: &str| imports_upwards(path, text, &order).len();
    assert_eq!(check("src/scene/a.rs", "use crate::frame::X;"), 1);
    assert_eq!(check("src/scene/a.rs", "fn f() { crate::gpu::run() }"), 1);
    assert_eq!(
        check(
            "src/scene/a.rs",
            "use crate::{\n    scene::{B, C}, frame,\n    gpu::D,\n};"
        ),
        2
    );
    assert_eq!(check("src/scene/mod.rs", "use super::frame::X;"), 1);
    assert_eq!(check("src/scene/b/c.rs", "use super::super::frame::X;"), 1);
    assert_eq!(check("src/elsewhere/a.rs", ""), 1);
    // What is allowed, or no code.
    assert_eq!(check("src/gpu/a.rs", "use crate::frame::X;"), 0);
    assert_eq!(
        check(
            "src/scene/a.rs",
            "// crate::frame\n/* a /* crate::gpu */ b */"
        ),
        0
    );
    assert_eq!(
        check("src/scene/a.rs", r##"let s = r#"crate::gpu "quoted""#;"##),
        0
    );
    assert_eq!(
        check("src/scene/a.rs", r#"let s = "\"crate::gpu"; let c = '"'; "#),
        0
    );
    // Quotes and lifetimes do not hide what follows.
    assert_eq!(
        check(
            "src/scene/a.rs",
            "fn f<'a>(c: &'a u8) { let q = '\\''; crate::gpu::f() }"
        ),
        1
    );
    assert_eq!(check("src/lib.rs", "use crate::gpu::X;"), 0);
    assert_eq!(check("src/scene/tests.rs", "use crate::gpu::X;"), 0);
    let inline = "#[cfg(test)]\nmod tests {\n    use crate::gpu::X;\n}\n";
    assert_eq!(check("src/scene/a.rs", inline), 0);
    let outside = "#[cfg(test)]\nmod tests;\nuse crate::gpu::X;\n";
    assert_eq!(check("src/scene/a.rs", outside), 1);
}

#[test]
fn engine_and_device_stay_where_they_belong() {
    let found = files("src", &["rs"])
        .iter()
        .flat_map(|(path, text)| strangers(path, text))
        .collect();
    none(found);
}

#[test]
fn the_stranger_check_objects() {
    assert_eq!(strangers("src/frame/a.rs", "use wgpu::Device;").len(), 1);
    assert_eq!(strangers("src/gpu/a.rs", "use bevy::prelude::*;").len(), 1);
    assert_eq!(strangers("src/plan/a.rs", "bevy_ecs::x()").len(), 1);
    assert_eq!(
        strangers("src/gpu/a.rs", "use wgpu::Device; // bevy").len(),
        0
    );
    assert_eq!(
        strangers("src/plugin/a.rs", "use bevy::x; use wgpu::y;").len(),
        0
    );
    assert_eq!(
        strangers("src/lib.rs", "#[cfg(feature = \"bevy\")] fn f() {}").len(),
        0
    );
    assert_eq!(
        strangers("src/plan/a.rs", "use meshless_gi::bake;").len(),
        0
    );
}

#[test]
fn every_citation_is_defined() {
    let known = defined(&read("docs/REFERENCES.md")).expect("a sound bibliography");
    let mut all = BTreeSet::new();
    for (folder, endings) in [
        ("src", ["rs"]),
        ("crates", ["rs"]),
        ("shaders", ["wgsl"]),
        ("tests", ["rs"]),
        ("docs", ["md"]),
    ] {
        for (path, text) in files(folder, &endings) {
            // This file's bad examples are none of its citations.
            if path.ends_with("tests/repository.rs") {
                continue;
            }
            let keys = cited(&text);
            let unknown: Vec<_> = keys.difference(&known).collect();
            assert!(
                unknown.is_empty(),
                "{path} cites {unknown:?}, which docs/REFERENCES.md does not define"
            );
            all.extend(keys);
        }
    }
    all.extend(cited(&read("ARCHITECTURE.md")));
    all.extend(cited(&read("README.md")));
    assert!(all.contains("L08"), "the search finds nothing");
    assert!(all.is_subset(&known), "{:?}", all.difference(&known));
}

#[test]
fn the_citation_check_objects() {
    let keys = |text| cited(text).into_iter().collect::<Vec<_>>();
    assert_eq!(
        keys("see [L08] Eq. (3), [WBW13 §2] and [X99]"),
        ["L08", "WBW13", "X99"]
    );
    assert_eq!(
        keys("[u32; 3] [Vec3] [12] [A1] [ABC123] [`L08`] [F32;3]"),
        [""; 0]
    );
    let twice = "- **[L08]** A.\n- **[L08]** B.\n";
    assert!(defined(twice).is_err());
    assert!(!defined("- **[L08]** A.").expect("one").contains("X99"));
}

#[test]
fn every_decision_is_explained() {
    let decisions = read("docs/DECISIONS.md");
    let mut all = BTreeSet::new();
    for folder in ["src", "crates", "shaders"] {
        for (path, text) in files(folder, &["rs", "wgsl"]) {
            for n in decisions_cited(&text) {
                assert!(
                    decisions.contains(&format!("\n## D{n} ")),
                    "{path} names design D{n}, which docs/DECISIONS.md does not explain"
                );
                all.insert(n);
            }
        }
    }
    assert!(all.contains(&1), "the search finds nothing");
    assert_eq!(decisions_cited("(design D12) and design D"), [12].into());
}

#[test]
fn files_stay_readable() {
    let mut long = Vec::new();
    for (folder, most) in MAX_LINES {
        for (path, text) in files(folder, &["rs", "wgsl"]) {
            long.extend(too_long(&path, &text, most));
        }
    }
    none(long);
    assert!(too_long("a", &"\n".repeat(8), 7).is_some());
    assert!(too_long("a", &"\n".repeat(7), 7).is_none());
}

fn too_long(path: &str, text: &str, most: usize) -> Option<String> {
    let lines = text.lines().count();
    (lines > most).then(|| format!("{path} has {lines} lines, of at most {most}"))
}

#[test]
fn the_readme_names_two_scripts_that_run() {
    let readme = read("README.md");
    for script in ["scripts/demo.sh", "scripts/test.sh"] {
        assert!(readme.contains(script), "README.md does not name {script}");
    }
    for script in [
        "scripts/demo.sh",
        "scripts/test.sh",
        "scripts/setup.sh",
        ".ci/run",
    ] {
        let text = read(script);
        assert!(
            text.starts_with("#!/usr/bin/env bash\n"),
            "{script}: no interpreter"
        );
        assert!(
            text.contains("\nset -euo pipefail\n"),
            "{script} goes on after failures"
        );
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            let mode = fs::metadata(root().join(script))
                .expect("there")
                .permissions()
                .mode();
            assert!(mode & 0o111 != 0, "{script} cannot be run");
        }
    }
}

#[test]
fn links_of_the_documents_lead_somewhere() {
    let mut found = Vec::new();
    let mut pages = files("docs", &["md"]);
    for page in ["README.md", "ARCHITECTURE.md", "CHANGELOG.md"] {
        pages.push((page.into(), read(page)));
    }
    for (path, text) in &pages {
        let folder = root().join(path);
        let folder = folder.parent().expect("a folder");
        for dead in dead_links(text, |target| folder.join(target).exists()) {
            found.push(format!("{path}: {dead} is not there"));
        }
    }
    none(found);
    let text = "[a](here.md) [b](gone.md#x) [c](https://example.org) [d](#below) ![e](later.png)";
    assert_eq!(dead_links(text, |t| t == "here.md"), ["gone.md#x"]);
}

/// Dependencies of a manifest that draw in an engine or a graphics interface.
fn heavy(manifest: &str) -> Vec<&str> {
    manifest
        .lines()
        .filter(|line| {
            ["bevy", "wgpu", "naga"].iter().any(|word| {
                line.starts_with(word) || line.contains(&format!("dependencies.{word}"))
            })
        })
        .collect()
}

#[test]
fn crates_below_the_plugin_need_no_engine_and_no_device() {
    for member in ["meshless_gi", "meshless_gi_lab", "meshless_gi_cli"] {
        let manifest = read(&format!("crates/{member}/Cargo.toml"));
        assert_eq!(heavy(&manifest), [""; 0], "{member}");
    }
    assert_eq!(heavy("[dependencies]\nwgpu = \"29\"\n").len(), 1);
    assert_eq!(heavy("[dependencies.bevy]\n").len(), 1);
}

#[test]
fn the_guide_lists_every_field_of_a_recipe() {
    let source = read("crates/meshless_gi/src/bake/recipe.rs");
    let guide = read("docs/GUIDE.md");
    let names = fields(&source, "Recipe");
    assert!(
        names.len() > 10 && names.contains(&"preset".to_string()),
        "{names:?}"
    );
    for name in names {
        assert!(
            guide.contains(&format!("| `{name}` |")),
            "docs/GUIDE.md has no row for the recipe's `{name}`"
        );
    }
    assert_eq!(
        fields("pub struct A {\n    /// x\n    pub b: u8,\n}\n", "A"),
        ["b"]
    );
}

#[test]
fn the_guide_has_the_numbers_of_the_presets() {
    let source = read("crates/meshless_gi/src/bake/quality_level.rs");
    let guide = read("docs/GUIDE.md");
    for name in ["Draft", "Medium", "High"] {
        let numbers = preset(&source, name);
        assert!(
            !numbers.is_empty() && numbers.iter().all(|n| n.is_finite()),
            "{numbers:?}"
        );
        assert_eq!(
            row(&guide, name),
            numbers,
            "docs/GUIDE.md, row `{name}`: the source says the second"
        );
    }
    let source = "Self::A => QualityParameters {\n points: 1_000.0,\n rays: 2,\n },";
    assert_eq!(preset(source, "A"), [1000.0, 2.0]);
    assert_eq!(row("| `a` | 1 000 | 2 |", "a"), [1000.0, 2.0]);
}
