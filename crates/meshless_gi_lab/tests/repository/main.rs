//! Checks of the repository. They read text only. Each one also fails on a bad example.
//!
//! | module | rules |
//! |---|---|
//! | `imports` | dependencies between folders and crates |
//! | `documents` | citations, decisions, links, sentences, tables that repeat the source |
//! | `generated` | chapters of the book that repeat doc comments |
//! | `figures` | lengths of files, functions and lines |
//! | `surface` | public names and their list |
//! | `words` | writing rules of comments and documents |

mod documents;
mod figures;
mod generated;
mod imports;
mod surface;
mod words;

use std::fs;
use std::path::{Path, PathBuf};

fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

fn read(path: &str) -> String {
    fs::read_to_string(root().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// Returns all files below `folder` with one of the endings: path from the root with forward
/// slashes, and text.
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

/// Markdown files of the top level.
const ROOT_PAGES: [&str; 4] = [
    "README.md",
    "ARCHITECTURE.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
];

/// Returns the files with these extensions below folders, and `ROOT_PAGES`: path and text.
fn files_and_pages(folders: &[&str], extensions: &[&str]) -> Vec<(String, String)> {
    let below = folders.iter().flat_map(|folder| files(folder, extensions));
    let pages = ROOT_PAGES.iter().map(|page| ((*page).into(), read(page)));
    below.chain(pages).collect()
}

/// Returns all Markdown files: path and text.
fn pages() -> Vec<(String, String)> {
    files_and_pages(&["docs", "crates"], &["md"])
}

/// Returns Rust source without comments, strings and character literals. Line numbers are kept.
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
            // A character literal. Anything else with a quote is a lifetime.
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

/// Returns the number of hashes of a raw string that starts at `i`.
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

fn none(found: Vec<String>) {
    assert!(found.is_empty(), "\n{}\n", found.join("\n"));
}
