//! Chapters of the book that are generated from doc comments. `MGI_TEST_UPDATE=1` writes them.

use crate::{files, read, root};
use meshless_gi_lab::report::split_sentences;
use std::fmt::Write;

/// Documented structure or enumeration.
struct Item {
    name: String,
    doc: String,
    attributes: String,
    members: Vec<Member>,
}

/// Public field or variant.
struct Member {
    name: String,
    doc: String,
}

/// Structures and enumerations with public members of a source file, in its order.
fn items(source: &str) -> Vec<Item> {
    let mut found: Vec<Item> = Vec::new();
    let (mut doc, mut attributes) = (Vec::new(), String::new());
    let (mut open, mut depth) = (false, 0i32);
    for line in source.lines() {
        let text = line.trim();
        if text == "#[cfg(test)]" {
            break;
        }
        if let Some(part) = text.strip_prefix("///") {
            doc.push(part.trim().to_string());
            continue;
        }
        if text.starts_with("#[") || depth > 0 {
            attributes.push_str(text);
            depth += text.matches(['(', '[']).count() as i32;
            depth -= text.matches([')', ']']).count() as i32;
            continue;
        }
        let head = (line.strip_prefix("pub struct ")).or_else(|| line.strip_prefix("pub enum "));
        if let Some(head) = head {
            let name = head.split([' ', '(', ';', '<']).next().unwrap_or_default();
            found.push(Item {
                name: name.into(),
                doc: paragraphs(&doc),
                attributes: attributes.clone(),
                members: Vec::new(),
            });
            open = text.ends_with('{');
        } else if line == "}" {
            open = false;
        } else if let (true, Some(name), Some(item)) = (open, member(line), found.last_mut()) {
            item.members.push(Member {
                name,
                doc: plain(&doc),
            });
        }
        doc.clear();
        attributes.clear();
    }
    found
}

/// Name of the public field or the variant that a line declares.
fn member(line: &str) -> Option<String> {
    let text = line.strip_prefix("    ")?;
    match text.strip_prefix("pub ") {
        Some(field) => field.split_once(':').map(|(name, _)| name.to_string()),
        None => {
            let variant = text.starts_with(|c: char| c.is_ascii_uppercase());
            variant.then(|| {
                text.split([',', '(', ' ', '{'])
                    .next()
                    .unwrap_or_default()
                    .into()
            })
        }
    }
}

/// Doc comment as Markdown, without links to items: paragraphs with one sentence per line, tables,
/// and headings below those of items.
fn paragraphs(doc: &[String]) -> String {
    let blocks = doc.split(|line| line.is_empty());
    let blocks = blocks.filter(|block| !block.is_empty()).map(|block| {
        if block[0].starts_with('|') {
            let rows = block.iter().map(|row| without_links(row));
            return rows.collect::<Vec<_>>().join("\n");
        }
        match block[0].strip_prefix("# ") {
            Some(heading) => format!("#### {heading}"),
            None => split_sentences(&plain(block)),
        }
    });
    blocks.collect::<Vec<_>>().join("\n\n")
}

/// Doc comment as one line in a table of Markdown, without links to items.
fn plain(doc: &[String]) -> String {
    without_links(&doc.join(" ")).replace('|', "\\|")
}

/// Text without links to items.
fn without_links(text: &str) -> String {
    let joined = text.replace("\\[", "[").replace("\\]", "]");
    let mut text = joined.split_whitespace().collect::<Vec<_>>().join(" ");
    // [`Name`](target) and [`Name`] become `Name`, [words](target) becomes words.
    while let Some(start) = text.find("](") {
        let Some(end) = text[start..].find(')').map(|i| start + i) else {
            break;
        };
        let Some(open) = text[..start].rfind('[') else {
            break;
        };
        text.replace_range(start..=end, "");
        text.remove(open);
    }
    let mut text = text.replace("[`", "`").replace("`]", "`");
    // Private modules have no page that the book could link.
    while let Some(start) = text.find(" See `crate::") {
        let end = text[start..]
            .find("`.")
            .map_or(text.len(), |i| start + i + 2);
        text.replace_range(start..end, "");
    }
    text
}

/// The item of this name below `folder`.
fn item(folder: &str, name: &str) -> Item {
    files(folder, &["rs"])
        .iter()
        .flat_map(|(_, text)| items(text))
        .find(|item| item.name == name)
        .unwrap_or_else(|| panic!("{folder} has no {name}"))
}

fn table(text: &mut String, head: &str, item: &Item) {
    let _ = writeln!(text, "| {head} | meaning |\n|---|---|");
    for member in &item.members {
        let _ = writeln!(text, "| `{}` | {} |", member.name, member.doc);
    }
    text.push('\n');
}

/// Compares a chapter with its generated text, or writes it.
fn check(path: &str, text: &str) {
    if std::env::var_os("MGI_TEST_UPDATE").is_some() {
        std::fs::write(root().join(path), text).expect("a writable book");
    }
    assert!(
        read(path) == text,
        "{path} differs from the doc comments; run with MGI_TEST_UPDATE=1 to write it"
    );
}

#[test]
fn generated_recipe_chapter_equals_doc_comments() {
    let folder = "crates/meshless_gi/src";
    let mut text = String::from(
        "# Recipe\n\n\
         Generated from the doc comments of `Recipe`.\n\
         Do not edit.\n\n\
         A recipe is a RON file `NAME.gi.ron`, or the structure `Recipe` in code.\n\
         Every field can be left out: `(scene: \"level.glb\")` is a recipe.\n\
         The values of the presets are in [Presets and target error](../performance/quality.md).\n\n",
    );
    let recipe = item(folder, "Recipe");
    assert!(recipe.members.len() > 10, "the search finds nothing");
    table(&mut text, "field", &recipe);
    for (name, title, head) in [
        ("Preset", "Values of `preset`", "value"),
        ("BounceMode", "Values of `bounce_mode`", "value"),
        ("TransportMethod", "Values of `transport`", "value"),
        ("PcaRecipe", "Fields of `Pca(..)`", "field"),
        ("FmmRecipe", "Fields of `Fmm(..)`", "field"),
        ("SkyModel", "Values of `sky`", "value"),
        ("VisibilityRecipe", "Fields of `soft_shadows`", "field"),
        ("ProbeSettings", "Fields of `probes`", "field"),
        ("OccluderDesc", "Fields of an entry of `occluders`", "field"),
        ("OccluderBox", "Fields of a box of an occluder", "field"),
    ] {
        let _ = writeln!(text, "## {title}\n");
        table(&mut text, head, &item(folder, name));
    }
    check(
        "docs/book/src/reference/recipe.md",
        &format!("{}\n", text.trim_end()),
    );
}

#[test]
fn generated_components_chapter_equals_doc_comments() {
    let mut text = String::from(
        "# Components\n\n\
         Generated from the doc comments of the plugin.\n\
         Do not edit.\n\n",
    );
    let mut all: Vec<Item> = ["src/plugin", "src/plan"]
        .iter()
        .flat_map(|folder| files(folder, &["rs"]))
        .flat_map(|(_, text)| items(&text))
        .filter(|item| item.name.starts_with("Gi"))
        .collect();
    all.sort_by(|a, b| a.name.cmp(&b.name));
    let is = |item: &Item, what: &str| {
        (item.attributes.split(|c: char| !c.is_alphanumeric())).any(|word| word == what)
    };
    for (title, what) in [("Components", "Component"), ("Resources", "Resource")] {
        let _ = writeln!(text, "## {title}\n");
        for item in all.iter().filter(|item| is(item, what)) {
            let _ = writeln!(text, "### `{}`\n\n{}\n", item.name, item.doc);
            if !item.members.is_empty() {
                table(&mut text, "field or value", item);
            }
        }
    }
    assert!(text.contains("### `GiCamera`"), "the search finds nothing");
    check(
        "docs/book/src/reference/components.md",
        &format!("{}\n", text.trim_end()),
    );
}

#[test]
fn doc_comments_become_markdown() {
    let source = "/// See [`A`](super::A), [`B`] and\n/// \\[L08\\].\n#[derive(\n    Component,\n)]\npub struct C {\n    /// Value.\n    pub d: u8,\n    e: u8,\n}\n";
    let found = items(source);
    assert_eq!(found[0].doc, "See `A`, `B` and [L08].");
    assert_eq!(found[0].members.len(), 1);
    assert!(found[0].attributes.contains("Component"));
    let doc = [
        "One. Two",
        "lines.",
        "",
        "# Head",
        "",
        "| [`A`](b) | c |",
        "|---|---|",
    ];
    let doc = doc.map(String::from);
    let expected = "One.\nTwo lines.\n\n#### Head\n\n| `A` | c |\n|---|---|";
    assert_eq!(paragraphs(&doc), expected);
}
