//! Public names of the two libraries, and their list in docs/API.md.

use crate::{code_only, none, read};
use std::collections::BTreeSet;

/// Libraries with a list of public names: name, root, and public modules in files of their own.
/// `internals` is exempt from semantic versioning.
const CRATES: [(&str, &str, &[&str]); 2] = [
    ("bevy_meshless_gi", "src/lib.rs", &["src/gpu/mod.rs"]),
    ("meshless_gi", "crates/meshless_gi/src/lib.rs", &[]),
];

/// Maximum number of public names of a library's root. Names of `gpu` serve other engines than
/// Bevy and are counted by themselves.
const MAX_NAMES: usize = 70;

/// Rust code of a library's root without the body of `mod internals`.
fn without_internals(code: &str) -> String {
    let Some((before, rest)) = code.split_once("mod internals {") else {
        return code.into();
    };
    let mut depth = 1;
    let end = rest.find(|c| {
        depth += match c {
            '{' => 1,
            '}' => -1,
            _ => 0,
        };
        depth == 0
    });
    format!("{before}{}", &rest[end.unwrap_or(rest.len() - 1) + 1..])
}

/// Names that `pub use` statements export, and public items of the text itself. Modules are not
/// counted. Hidden statements are exempt.
fn exported(text: &str) -> BTreeSet<String> {
    let code = without_internals(&code_only(text));
    let mut names = BTreeSet::new();
    for (start, _) in code.match_indices("pub use ") {
        if code[..start].trim_end().ends_with("#[doc(hidden)]") {
            continue;
        }
        let statement = &code[start + 8..];
        let statement = &statement[..statement.find(';').unwrap_or(0)];
        // The last segment of each path: `a::{b::C, D as E}` exports C and E.
        for path in statement.split([',', '{', '}']).map(str::trim) {
            let name = path.rsplit("::").next().unwrap_or("");
            let name = name.rsplit(" as ").next().unwrap_or("").trim();
            if !name.is_empty() && path != "meshless_gi" {
                names.insert(name.into());
            }
        }
    }
    for kind in ["struct", "enum", "fn", "trait", "const", "type"] {
        for (start, m) in code.match_indices(&format!("pub {kind} ")) {
            let rest = &code[start + m.len()..];
            let end = rest.find(|c: char| !(c.is_alphanumeric() || c == '_'));
            names.insert(rest[..end.unwrap_or(0)].into());
        }
    }
    names
}

/// Returns the number of public names of each library, with its public modules.
pub fn public_names() -> Vec<(&'static str, usize)> {
    let count = |(name, root, modules): (_, _, &[&'static str])| {
        let files = std::iter::once(root).chain(modules.iter().copied());
        let names: BTreeSet<String> = files.flat_map(|file| exported(&read(file))).collect();
        (name, names.len())
    };
    CRATES.into_iter().map(count).collect()
}

/// Names of the rows of docs/API.md below the heading of a crate: `| `Name` | sentence |`.
fn listed(document: &str, name: &str) -> BTreeSet<String> {
    let heading = format!("\n## `{name}`\n");
    let section = document.split_once(&heading).map_or("", |(_, rest)| rest);
    let section = section.split("\n## ").next().unwrap_or("");
    section
        .lines()
        .filter_map(|l| l.strip_prefix("| `")?.split_once("` | "))
        .filter(|(_, sentence)| sentence.len() > 8)
        .flat_map(|(names, _)| names.split("`, `").map(String::from))
        .collect()
}

/// Differences between the names of a crate and its list.
fn differences(name: &str, exported: &BTreeSet<String>, listed: &BTreeSet<String>) -> Vec<String> {
    let missing = exported
        .difference(listed)
        .map(|n| format!("{name}: docs/API.md has no row for `{n}`"));
    let extra = listed
        .difference(exported)
        .map(|n| format!("{name}: docs/API.md has `{n}`, which is not exported"));
    missing.chain(extra).collect()
}

#[test]
fn public_names_are_few_and_listed() {
    let document = read("docs/API.md");
    let mut found = Vec::new();
    for (name, root, modules) in CRATES {
        let mut exported = exported(&read(root));
        assert!(exported.len() > 20, "the search finds nothing");
        if exported.len() > MAX_NAMES {
            found.push(format!("{name}: {} public names", exported.len()));
        }
        for module in modules {
            exported.extend(self::exported(&read(module)));
        }
        found.extend(differences(name, &exported, &listed(&document, name)));
    }
    none(found);
}

#[test]
fn surface_check_detects_unlisted_and_missing_names() {
    let text = "mod a;\npub use a::{b::C, D as E, f};\npub mod g { pub use crate::a::H; }\n\
                #[doc(hidden)]\npub mod internals { pub mod x { pub use crate::x::Y; } }\npub use i::J;\n\
                #[doc(hidden)]\npub use k::L;\n";
    let names = exported(text);
    let expected = ["C", "E", "H", "J", "f"];
    assert_eq!(
        names.iter().map(String::as_str).collect::<Vec<_>>(),
        expected
    );
    let document = "# A\n\n## `k`\n\n| name | use |\n|---|---|\n| `C`, `f` | A sentence. |\n| `Z` | A sentence. |\n\n## `l`\n\n| `E` | A sentence. |\n";
    let listed = listed(document, "k");
    let found = differences("k", &names, &listed);
    assert_eq!(found.len(), 4, "{found:?}");
}
