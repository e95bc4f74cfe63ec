//! One sentence per line in Markdown, so that a change of a sentence is a change of a line.

/// Words that end with a period within a sentence.
const ABBREVIATIONS: [&str; 16] = [
    "e.g", "i.e", "cf", "vs", "al", "etc", "approx", "No", "pp", "Eq", "Eqs", "Fig", "Figs", "Sec",
    "Secs", "Vol",
];

/// Returns `markdown` with a line break after each sentence. Leaves code blocks, tables and HTML as
/// they are.
#[must_use]
pub fn split_sentences(markdown: &str) -> String {
    let mut out = String::with_capacity(markdown.len());
    let mut is_code = false;
    for line in markdown.split_inclusive('\n') {
        let text = line.trim_start();
        let is_fence = text.starts_with("```") || text.starts_with("~~~");
        is_code ^= is_fence;
        if is_code || is_fence || text.starts_with(['|', '<', '>']) {
            out.push_str(line);
            continue;
        }
        // A further line of a list item starts below the text of the item.
        let indent = line.len() - text.len() + marker_width(text);
        let mut rest = line;
        while let Some((end, start)) = first_break(rest) {
            out.push_str(&rest[..end]);
            out.push('\n');
            out.extend(std::iter::repeat_n(' ', indent));
            rest = &rest[start..];
        }
        out.push_str(rest);
    }
    out
}

/// Returns the width of the marker of a list item, 0 for other lines.
fn marker_width(text: &str) -> usize {
    let digits = text.len() - text.trim_start_matches(|c: char| c.is_ascii_digit()).len();
    let marker = &text[digits..];
    let is_item = match digits {
        0 => marker.starts_with("- ") || marker.starts_with("* "),
        _ => marker.starts_with(". "),
    };
    if is_item { digits + 2 } else { 0 }
}

/// Returns the end of the first sentence of a line, and the start of the next one. `None` if the
/// line has one sentence.
fn first_break(line: &str) -> Option<(usize, usize)> {
    let mut is_code = false;
    for (at, c) in line.char_indices() {
        is_code ^= c == '`';
        if is_code || !['.', '!', '?'].contains(&c) || c == '.' && !ends_sentence(&line[..at]) {
            continue;
        }
        let after = &line[at + 1..];
        let closed = after.trim_start_matches([')', '"', '”', '*', '_', ']']);
        let next = closed.trim_start_matches(' ');
        let opened = next.trim_start_matches(['*', '_', '"', '“', '(', '[']);
        let starts = opened.starts_with(|c: char| c.is_uppercase() || c == '`');
        if next.len() < closed.len() && starts {
            return Some((line.len() - closed.len(), line.len() - next.len()));
        }
    }
    None
}

/// Returns `true` if a period after `before` ends a sentence. False for abbreviations, initials and
/// the number of a list item.
fn ends_sentence(before: &str) -> bool {
    let start = before
        .rfind(|c: char| !(c.is_alphanumeric() || c == '.'))
        .map_or(0, |i| {
            i + before[i..].chars().next().map_or(0, char::len_utf8)
        });
    let word = &before[start..];
    let is_initial = word.rsplit('.').next().is_some_and(|part| {
        part.chars().count() == 1 && part.starts_with(|c: char| c.is_uppercase())
    });
    let is_number = before.trim_start().chars().all(|c| c.is_ascii_digit());
    !(ABBREVIATIONS.contains(&word) || is_initial || is_number || word.ends_with('.'))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_with_several_sentences_are_split() {
        for (text, expected) in [
            (
                "One. Two! `three` is? Four.\n",
                "One.\nTwo!\n`three` is?\nFour.\n",
            ),
            (
                "- **One.** Two.\n1. Three. Four\n",
                "- **One.**\n  Two.\n1. Three.\n   Four\n",
            ),
            (
                "  - One (two.) *Three.* Four",
                "  - One (two.)\n    *Three.*\n    Four",
            ),
        ] {
            assert_eq!(split_sentences(text), expected);
            assert_eq!(split_sentences(expected), expected);
        }
    }

    #[test]
    fn lines_with_one_sentence_are_kept() {
        let text = "See [L08] Eq. (3), Fig. 2, e.g. A vs. B, at 0.5 MB. and J. F. Hughes ... B.\n\
                    `a. B` in file.rs.\n2. A\n| a. B |\n```\nA. B\n```\n<p>A. B</p>\n";
        assert_eq!(split_sentences(text), text);
    }
}
