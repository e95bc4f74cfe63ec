//! Citations, decisions, links, and tables of documents that repeat the source.

use crate::{files, none, pages, read, root};
use meshless_gi_lab::report::split_sentences;
use std::collections::BTreeSet;
use std::fs;

/// Citation keys such as L08 in square brackets, alone or before a position in the paper.
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

/// Returns relative links of a Markdown text without a target. Pictures are exempt because pages
/// are also read without them.
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

/// Relative links with an anchor: file (empty for the same page) and anchor.
fn anchors(text: &str) -> Vec<(&str, &str)> {
    text.match_indices("](")
        .filter_map(|(i, _)| text[i + 2..].split(')').next()?.split_once('#'))
        .filter(|(file, _)| !file.contains("://"))
        .collect()
}

/// Anchors of the headings of a Markdown text.
fn slugs(text: &str) -> BTreeSet<String> {
    text.lines()
        .filter(|line| line.starts_with('#'))
        .map(|line| {
            let words = line.trim_start_matches('#').trim().to_lowercase();
            words
                .chars()
                .filter(|c| c.is_alphanumeric() || [' ', '-', '_'].contains(c))
                .map(|c| if c == ' ' { '-' } else { c })
                .collect()
        })
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

/// Returns the numbers of the row of a Markdown table with `name` in code type in its first cell.
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

#[test]
fn citations_are_defined_in_the_bibliography() {
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
            // The bad examples of this file do not count as citations.
            if path.contains("tests/repository/") {
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
fn citation_check_detects_undefined_keys() {
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
fn cited_decisions_are_explained() {
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
fn readme_scripts_exist_and_stop_on_errors() {
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
fn relative_links_of_documents_exist() {
    let mut found = Vec::new();
    for (path, text) in &pages() {
        let folder = root().join(path);
        let folder = folder.parent().expect("a folder");
        for dead in dead_links(text, |target| folder.join(target).exists()) {
            found.push(format!("{path}: {dead} does not exist"));
        }
        for (file, anchor) in anchors(text) {
            let target = match file {
                "" => Some(text.clone()),
                _ => fs::read_to_string(folder.join(file)).ok(),
            };
            if target.is_some_and(|target| !slugs(&target).contains(anchor)) {
                found.push(format!("{path}: {file} has no heading #{anchor}"));
            }
        }
    }
    none(found);
    let text = "[a](here.md) [b](gone.md#x) [c](https://example.org) [d](#below) ![e](later.png)";
    assert_eq!(dead_links(text, |t| t == "here.md"), ["gone.md#x"]);
}

/// Returns the lines of a page with several sentences.
fn shared_lines(path: &str, text: &str) -> Vec<String> {
    let has_more = |line: &&str| split_sentences(line).contains('\n');
    // Code blocks are cut out with their text.
    let prose = text.split("```").step_by(2);
    let lines = prose.flat_map(|part| part.lines().filter(has_more));
    lines.map(|line| format!("{path}: {line}")).collect()
}

/// Set `MGI_TEST_UPDATE=1` to split the lines.
#[test]
fn markdown_has_one_sentence_per_line() {
    let mut found = Vec::new();
    for (path, text) in pages() {
        let split = split_sentences(&text);
        if split == text {
            continue;
        }
        if std::env::var_os("MGI_TEST_UPDATE").is_some() {
            fs::write(root().join(&path), split).expect("a writable page");
        }
        found.extend(shared_lines(&path, &text));
    }
    none(found);
    assert_eq!(
        shared_lines("a.md", "One. Two\n```\nOne. Two\n```\nOne, two.\n").len(),
        1
    );
}

/// Returns the relative links of a page of the book that leave its folder, and paths of the
/// repository in code that do not exist. `depth` is the number of folders between the page and the
/// book.
fn links_out_of_the_book(text: &str, depth: usize, exists: impl Fn(&str) -> bool) -> Vec<String> {
    let links = text.match_indices("](").filter_map(|(i, _)| {
        let target = text[i + 2..].split(')').next()?;
        let up = target.matches("../").count();
        (up > depth).then(|| target.to_string())
    });
    let paths = text.split('`').skip(1).step_by(2).filter(|code| {
        let is_path = ["docs/", "examples/"].iter().any(|f| code.starts_with(f));
        is_path && !code.contains(' ') && !exists(code)
    });
    links.chain(paths.map(str::to_string)).collect()
}

#[test]
fn links_of_the_book_stay_in_it() {
    let book = "docs/book/src/";
    let mut found = Vec::new();
    for (path, text) in files("docs/book/src", &["md"]) {
        let depth = path.trim_start_matches(book).matches('/').count();
        for target in links_out_of_the_book(&text, depth, |path| root().join(path).exists()) {
            found.push(format!("{path}: {target}"));
        }
    }
    none(found);
    let text = "[a](../b.md) [c](../../d.md) `docs/e.md` `docs/f.md`";
    let found = links_out_of_the_book(text, 1, |path| path == "docs/e.md");
    assert_eq!(found, ["../../d.md", "docs/f.md"]);
}

#[test]
fn anchors_are_slugs_of_headings() {
    assert_eq!(
        anchors("[a](b.md#c-d) [e](#f) [g](h.md)"),
        [("b.md", "c-d"), ("", "f")]
    );
    let slugs = slugs("# A `b`: C ([L08])\n## d");
    assert!(
        slugs.contains("a-b-c-l08") && slugs.contains("d"),
        "{slugs:?}"
    );
}

#[test]
fn book_summary_lists_every_chapter() {
    let summary = read("docs/book/src/SUMMARY.md");
    let missing: Vec<String> = files("docs/book/src", &["md"])
        .into_iter()
        .filter_map(|(path, _)| path.strip_prefix("docs/book/src/").map(String::from))
        .filter(|path| path != "SUMMARY.md" && !summary.contains(&format!("]({path})")))
        .collect();
    none(missing);
}

#[test]
fn book_presets_equal_the_source() {
    let source = read("crates/meshless_gi/src/bake/quality_level.rs");
    let guide = read("docs/book/src/performance/quality.md");
    for name in ["Draft", "Medium", "High"] {
        let numbers = preset(&source, name);
        assert!(
            !numbers.is_empty() && numbers.iter().all(|n| n.is_finite()),
            "{numbers:?}"
        );
        assert_eq!(
            row(&guide, name),
            numbers,
            "performance/quality.md of the book, row `{name}`: the source has the second"
        );
    }
    let source = "Self::A => QualityParameters {\n points: 1_000.0,\n rays: 2,\n },";
    assert_eq!(preset(source, "A"), [1000.0, 2.0]);
    assert_eq!(row("| `a` | 1 000 | 2 |", "a"), [1000.0, 2.0]);
}
