//! Lengths of files, functions and lines. Clippy checks the lengths of functions and the numbers of
//! their parameters too (`too_many_lines`, `too_many_arguments`), but not without the engine.

use crate::{code_only, files, none, pages, surface};

/// Folders of sources and of tests.
const SOURCES: [&str; 8] = [
    "src",
    "crates/meshless_gi/src",
    "crates/meshless_gi_lab/src",
    "crates/meshless_gi_lab/examples",
    "crates/meshless_gi_lab/benches",
    "crates/meshless_gi_cli/src",
    "shaders",
    "examples",
];
const TESTS: [&str; 4] = [
    "tests",
    "crates/meshless_gi/tests",
    "crates/meshless_gi_lab",
    "crates/meshless_gi_cli/tests",
];

/// Maximum lines of a source file. Tests are lists of cases and may be longer.
const MAX_FILE_LINES: usize = 500;
const MAX_TEST_FILE_LINES: usize = 1200;
/// Maximum code lines of a function, without blank lines and comments.
const MAX_FUNCTION_LINES: usize = 100;
const MAX_PARAMETERS: usize = 7;
/// Maximum columns of a comment. Addresses and tables may be wider.
const MAX_COMMENT_COLUMNS: usize = 100;

/// A function of a source: name, line, code lines and parameters.
#[derive(Debug, PartialEq)]
struct Function {
    name: String,
    line: usize,
    lines: usize,
    parameters: usize,
}

/// Position after the bracket that closes the one at `open`.
fn closing(code: &[u8], open: usize) -> Option<usize> {
    let mut depth = 0usize;
    for (i, c) in code.iter().enumerate().skip(open) {
        match c {
            b'(' | b'{' | b'[' => depth += 1,
            b')' | b'}' | b']' => {
                depth -= 1;
                if depth == 0 {
                    return Some(i + 1);
                }
            }
            _ => {}
        }
    }
    None
}

/// Returns the number of items between commas at nesting depth 0 of a parameter list.
fn parameters(list: &str) -> usize {
    let (mut depth, mut count, mut empty) = (0, 0, true);
    let mut previous = ' ';
    for c in list.chars() {
        match c {
            '(' | '[' | '{' | '<' => depth += 1,
            '>' if previous == '-' => {}
            ')' | ']' | '}' | '>' => depth -= 1,
            ',' if depth == 0 => {
                count += usize::from(!empty);
                empty = true;
            }
            _ => {}
        }
        if !c.is_whitespace() && c != ',' {
            empty = false;
        }
        previous = c;
    }
    count + usize::from(!empty)
}

/// Functions of a Rust source with a body.
fn functions(text: &str) -> Vec<Function> {
    let code = code_only(text);
    // Offsets below are bytes: anything beyond ASCII becomes a question mark.
    let code: String = code
        .chars()
        .map(|c| if c.is_ascii() { c } else { '?' })
        .collect();
    let bytes = code.as_bytes();
    let mut found = Vec::new();
    for (start, _) in code.match_indices("fn ") {
        let before = start.checked_sub(1).map_or(b' ', |i| bytes[i]);
        if before.is_ascii_alphanumeric() || before == b'_' {
            continue;
        }
        let rest = &code[start + 3..];
        let end = rest.find(|c: char| !(c.is_alphanumeric() || c == '_'));
        let name = &rest[..end.unwrap_or(0)];
        let Some(open) = code[start..].find('(').map(|i| start + i) else {
            continue;
        };
        let Some(list_end) = closing(bytes, open).filter(|_| !name.is_empty()) else {
            continue;
        };
        let body = code[list_end..].find(['{', ';']).map(|i| list_end + i);
        let Some(body) = body.filter(|&i| bytes[i] == b'{') else {
            continue;
        };
        let Some(body_end) = closing(bytes, body) else {
            continue;
        };
        found.push(Function {
            name: name.into(),
            line: 1 + code[..start].matches('\n').count(),
            lines: code[body + 1..body_end - 1]
                .lines()
                .filter(|l| !l.trim().is_empty())
                .count(),
            parameters: parameters(&code[open + 1..list_end - 1]),
        });
    }
    found
}

/// Comments of a source that are wider than `MAX_COMMENT_COLUMNS`.
fn wide_comments(path: &str, text: &str) -> Vec<String> {
    text.lines()
        .enumerate()
        .filter(|(_, l)| {
            let comment = l.trim_start();
            comment.starts_with("//")
                && l.chars().count() > MAX_COMMENT_COLUMNS
                && !comment.contains("://")
                && !comment.trim_start_matches(['/', '!', ' ']).starts_with('|')
        })
        .map(|(i, l)| format!("{path}:{}: {} columns", i + 1, l.chars().count()))
        .collect()
}

fn too_long(path: &str, text: &str, max: usize) -> Option<String> {
    let lines = text.lines().count();
    (lines > max).then(|| format!("{path} has {lines} lines, of at most {max}"))
}

fn sources() -> Vec<(String, String)> {
    SOURCES
        .iter()
        .flat_map(|folder| files(folder, &["rs", "wgsl"]))
        .collect()
}

#[test]
fn files_are_short() {
    let mut long = Vec::new();
    for (path, text) in sources() {
        if !path.ends_with("tests.rs") {
            long.extend(too_long(&path, &text, MAX_FILE_LINES));
        }
    }
    for folder in TESTS {
        for (path, text) in files(folder, &["rs"]) {
            long.extend(too_long(&path, &text, MAX_TEST_FILE_LINES));
        }
    }
    none(long);
    assert!(too_long("a", &"\n".repeat(8), 7).is_some());
    assert!(too_long("a", &"\n".repeat(7), 7).is_none());
}

#[test]
fn functions_are_short_and_have_few_parameters() {
    let mut found = Vec::new();
    for (path, text) in sources().iter().filter(|(path, _)| path.ends_with(".rs")) {
        for f in functions(text) {
            if path.ends_with("tests.rs") {
                continue;
            }
            let Function { name, line, .. } = &f;
            if f.lines > MAX_FUNCTION_LINES {
                found.push(format!("{path}:{line}: `{name}` has {} lines", f.lines));
            }
            if f.parameters > MAX_PARAMETERS {
                found.push(format!(
                    "{path}:{line}: `{name}` has {} parameters",
                    f.parameters
                ));
            }
        }
        let allows = |l: &str| l.contains("clippy::too_many_") && !l.contains("warn(");
        if text.lines().any(allows) {
            found.push(format!("{path}: allows long functions"));
        }
    }
    none(found);
}

#[test]
fn function_check_counts_lines_and_parameters() {
    let text = "impl A {\n    fn f<T>(&self, b: Vec<(u8, u8)>, c: impl Fn(u8) -> u8,) -> u8 {\n\
                        // nothing\n\n        g(\"}\");\n        1\n    }\n}\nfn g();\n";
    let f = Function {
        name: "f".into(),
        line: 2,
        lines: 2,
        parameters: 3,
    };
    assert_eq!(functions(text), [f]);
}

#[test]
fn comments_fit_in_100_columns() {
    let mut all = Vec::new();
    for folder in SOURCES.into_iter().chain(TESTS) {
        for (path, text) in files(folder, &["rs", "wgsl"]) {
            all.extend(wide_comments(&path, &text));
        }
    }
    none(all);
    assert_eq!(
        wide_comments("a", &format!("  // {}", "x".repeat(96))).len(),
        1
    );
    assert_eq!(
        wide_comments("a", &format!("// | {}", "x".repeat(96))).len(),
        0
    );
}

/// Number of columns that a line of a source or a document has without reason to be wider.
const MAX_COLUMNS: usize = 120;

/// Returns the number of lines that are wider than `MAX_COLUMNS`.
fn wide_lines(files: &[(String, String)]) -> usize {
    let lines = files.iter().flat_map(|(_, text)| text.lines());
    lines.filter(|l| l.chars().count() > MAX_COLUMNS).count()
}

/// Figures of the last version that was a single package (0ebe716), computed by the same code. The
/// number of public items is a manual count.
const BEFORE: &str = "before: 67410 lines in src, 4632 in shaders, 8644 in examples; longest file \
    687 lines (src/bake/mod.rs); longest function 339 lines (composite); 2040 comments over 100 \
    columns; 1656 source lines and 796 of 2900 Markdown lines over 120 columns; about 800 public \
    items";

/// Prints the figures of the repository. Run with `--nocapture`.
#[test]
fn figures_are_printed() {
    let all = sources();
    let longest_file = all
        .iter()
        .filter(|(path, _)| !path.ends_with("tests.rs"))
        .map(|(path, text)| (text.lines().count(), path.as_str()))
        .max();
    let longest_function = all
        .iter()
        .filter(|(path, _)| path.ends_with(".rs") && !path.ends_with("tests.rs"))
        .flat_map(|(path, text)| functions(text).into_iter().map(move |f| (f, path)))
        .map(|(f, path)| (f.lines, f.name, path.as_str()))
        .max();
    let wide = all
        .iter()
        .flat_map(|(path, text)| wide_comments(path, text));
    let pages = pages();
    let page_lines: usize = pages.iter().map(|(_, text)| text.lines().count()).sum();
    println!("{BEFORE}");
    println!("longest file: {longest_file:?}");
    println!("longest function: {longest_function:?}");
    println!("comments over 100 columns: {}", wide.count());
    println!("source lines over 120 columns: {}", wide_lines(&all));
    println!(
        "Markdown lines over 120 columns: {} of {page_lines}",
        wide_lines(&pages)
    );
    for (name, count) in surface::public_names() {
        println!("{name}: {count} public names");
    }
    for folder in SOURCES {
        let lines: usize = files(folder, &["rs", "wgsl"])
            .iter()
            .map(|(_, text)| text.lines().count())
            .sum();
        println!("{folder}: {lines} lines");
    }
    let text = format!("{}\nb\n", "a".repeat(MAX_COLUMNS + 1));
    assert_eq!(wide_lines(&[(String::new(), text)]), 1);
}
