//! Writing rules of comments, documents and names.

use crate::{files, none, read};

/// Words that do not start a documentation comment: it starts with a noun or a verb.
const OPENERS: [&str; 9] = [
    "what", "how", "who", "whether", "which", "where", "of", "so many", "why",
];

/// Verbs that describe people, not code.
const VERBS_OF_PEOPLE: [&str; 10] = [
    "know",
    "knows",
    "remember",
    "remembers",
    "tell",
    "tells",
    "told",
    "mend",
    "mends",
    "hears",
];

/// Words that have a standard term or are not American English.
const BANNED: [&str; 14] = [
    "lamp",
    "lamps",
    "colour",
    "colours",
    "grey",
    "centre",
    "centres",
    "metre",
    "metres",
    "normalise",
    "foretold",
    "lest",
    "bouncer",
    "bouncers",
];

/// Paragraphs of documentation comments that start with one of `OPENERS`.
fn wrong_openers(path: &str, text: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut is_inside = false;
    for (i, line) in text.lines().enumerate() {
        let line = line.trim_start();
        let is_doc = line.starts_with("///") || line.starts_with("//!");
        let body = line.get(3..).unwrap_or("").trim_start().to_lowercase();
        let opens = OPENERS.iter().any(|word| {
            body.strip_prefix(word)
                .is_some_and(|rest| !rest.starts_with(|c: char| c.is_alphanumeric()))
        });
        if is_doc && !is_inside && opens {
            found.push(format!("{path}:{}: {line}", i + 1));
        }
        is_inside = is_doc && !body.is_empty();
    }
    found
}

/// Comments in which code does what people do.
fn people(path: &str, text: &str) -> Vec<String> {
    text.lines()
        .enumerate()
        .filter(|(_, line)| line.trim_start().starts_with("//"))
        .filter(|(_, line)| words(line).any(|word| VERBS_OF_PEOPLE.contains(&word.as_str())))
        .map(|(i, line)| format!("{path}:{}: {}", i + 1, line.trim_start()))
        .collect()
}

/// Words of `text` in lower case, with identifiers split at underscores and capitals.
fn words(text: &str) -> impl Iterator<Item = String> + '_ {
    text.split(|c: char| !c.is_alphanumeric()).flat_map(|word| {
        let mut parts = vec![String::new()];
        let mut lower = false;
        for c in word.chars() {
            if c.is_uppercase() && lower {
                parts.push(String::new());
            }
            lower = c.is_lowercase();
            parts.last_mut().expect("one part").extend(c.to_lowercase());
        }
        parts
    })
}

/// Banned words of a text. Old spellings that files and command lines may still use are exempt.
fn banned(path: &str, text: &str) -> Vec<String> {
    let mut found = Vec::new();
    for (i, line) in text
        .lines()
        .enumerate()
        .filter(|(_, l)| !l.contains("alias"))
    {
        for word in words(line).filter(|w| BANNED.contains(&w.as_str())) {
            found.push(format!("{path}:{}: `{word}`", i + 1));
        }
        if line.contains("MOST_") || line.contains("LEAST_") {
            found.push(format!("{path}:{}: MAX_ and MIN_ name limits", i + 1));
        }
    }
    found
}

/// All texts that the rules hold for. This file has the words as examples.
fn texts() -> Vec<(String, String)> {
    let mut all = Vec::new();
    for folder in ["src", "crates", "shaders", "examples", "tests", "docs"] {
        all.extend(files(folder, &["rs", "wgsl", "md", "toml", "ron"]));
    }
    for page in [
        "README.md",
        "ARCHITECTURE.md",
        "CHANGELOG.md",
        "CONTRIBUTING.md",
    ] {
        all.push((page.into(), read(page)));
    }
    all.retain(|(path, _)| {
        !path.contains("tests/repository/words.rs") && !path.ends_with("migration.md")
    });
    all
}

#[test]
fn doc_comments_start_with_a_noun_or_a_verb() {
    let found: Vec<String> = texts()
        .iter()
        .filter(|(path, _)| path.ends_with(".rs"))
        .flat_map(|(path, text)| wrong_openers(path, text))
        .collect();
    none(found);
    assert_eq!(wrong_openers("a", "/// A.\n///\n/// How.\n").len(), 1);
    assert_eq!(wrong_openers("a", "/// Offset\n/// of a how.\n").len(), 0);
}

#[test]
fn texts_have_no_banned_words() {
    let found: Vec<String> = texts()
        .iter()
        .flat_map(|(path, text)| banned(path, text))
        .collect();
    none(found);
    assert_eq!(banned("a", "fn lamp_at(c: Colour) {} // MOST_X").len(), 3);
    assert_eq!(banned("a", "alias = \"lamps\"").len(), 0);
}

#[test]
fn comments_have_no_verbs_of_people() {
    let found: Vec<String> = texts()
        .iter()
        .filter(|(path, _)| path.ends_with(".rs") || path.ends_with(".wgsl"))
        .flat_map(|(path, text)| people(path, text))
        .collect();
    none(found);
    assert_eq!(people("a", "// It knows.\nlet knows = 1;\n").len(), 1);
}
