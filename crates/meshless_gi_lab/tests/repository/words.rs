//! Writing rules of comments, documents and names.

use crate::{code_only, files_and_pages, none};

/// Words that do not start a documentation comment: it starts with a noun or a verb.
const OPENERS: [&str; 9] = [
    "what", "how", "who", "whether", "which", "where", "of", "so many", "why",
];

/// Verbs that describe people, not code.
const VERBS_OF_PEOPLE: [&str; 27] = [
    "know",
    "knows",
    "tell",
    "tells",
    "told",
    "remember",
    "remembers",
    "mend",
    "mends",
    "hears",
    "say",
    "says",
    "said",
    "ask",
    "asks",
    "asked",
    "asking",
    "want",
    "wants",
    "notice",
    "notices",
    "noticed",
    "speak",
    "speaks",
    "forgive",
    "promise",
    "promises",
];

/// Phrases that have a plain term. Refused in comments and documents.
const PHRASES: [&str; 7] = [
    "beside",
    "so many",
    "free space",
    "but for",
    "nobody",
    "of ours",
    "hair's",
];

/// Words that have a standard term or are not American English.
const BANNED: [&str; 17] = [
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
    "live",
    "passage",
    "passages",
];

/// Words before "place" or "places" as a noun. Its terms are position, sample, point and index.
const DETERMINERS: [&str; 22] = [
    "a", "the", "this", "that", "these", "those", "each", "every", "one", "two", "another", "any",
    "no", "same", "all", "of", "at", "such", "many", "some", "other", "its",
];

/// Adverbs, prepositions and participles that are no names of functions.
const VAGUE_FUNCTIONS: [&str; 13] = [
    "of",
    "whole",
    "even",
    "within",
    "shown",
    "turned",
    "near",
    "along",
    "around",
    "between",
    "surprised",
    "asked",
    "told",
];

/// Former identifiers with their replacements. They do not come back.
const REFUSED_NAMES: [(&str, &str); 20] = [
    ("GiBakeStage", "BakeStage"),
    ("FmmPlace", "FmmOperatorPoint"),
    ("live_materials", "dynamic_materials"),
    ("live_surface", "dynamic_surface"),
    ("live_surfaces", "dynamic_surfaces"),
    ("live_gain", "max_spectral_radius"),
    ("roughest", "max_roughness"),
    ("rested", "skipped_solves"),
    ("free_space", "probes"),
    ("bounce_from_dynamic", "rsm"),
    ("gloss_from_dynamic", "vpl_specular"),
    ("fmm_places", "fmm_points"),
    ("places_per_sender", "samples_per_sender"),
    ("place_normal", "sample_normal"),
    ("gain_found", "spectral_radius_estimate"),
    ("guard_factor", "albedo_scale"),
    ("yardstick", "ray_baseline"),
    ("keep_frames", "unload_after_frames"),
    ("roomy_places", "sample_open_positions"),
    ("free_places", "sample_light_positions"),
];

/// Former members: a field or function in a file with this name ending, and its replacement.
const REFUSED_MEMBERS: [(&str, &str, &str); 14] = [
    ("frame/subsplat.rs", "coarsest", "coarsest_level"),
    ("frame/subsplat.rs", "finest", "finest_level"),
    ("frame/subsplat.rs", "alike", "min_similarity"),
    ("vpl_specular/settings.rs", "coarsest", "coarsest_level"),
    ("vpl_specular/settings.rs", "finest", "finest_level"),
    ("frame/layout.rs", "places", "samples_per_sender"),
    ("asset/baked.rs", "places", "light_samples"),
    ("cpu_frame/results.rs", "values", "vector_irradiance"),
    ("plan/tier_controller.rs", "calm", "stable_solves"),
    ("plan/tier_controller.rs", "wait", "required_stable_solves"),
    ("plan/tier_controller.rs", "settle", "settle_samples"),
    ("plan/tier_controller.rs", "picked", "selection"),
    ("plan/tier_controller.rs", "measured", "record_sample"),
    ("plan/tier_controller.rs", "go", "switch_to"),
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

/// Returns comments that describe code with verbs of people.
fn people(path: &str, text: &str) -> Vec<String> {
    text.lines()
        .enumerate()
        .filter(|(_, line)| line.trim_start().starts_with("//"))
        .filter(|(_, line)| words(line).any(|word| VERBS_OF_PEOPLE.contains(&word.as_str())))
        .map(|(i, line)| format!("{path}:{}: {}", i + 1, line.trim_start()))
        .collect()
}

/// Returns comments and lines of documents with one of `PHRASES`.
fn phrases(path: &str, text: &str) -> Vec<String> {
    let is_text = |line: &str| path.ends_with(".md") || line.trim_start().starts_with("//");
    let has = |line: &str| {
        let spaced: Vec<String> = words(line).filter(|word| !word.is_empty()).collect();
        let spaced = format!(" {} ", spaced.join(" "));
        PHRASES
            .iter()
            .any(|phrase| spaced.contains(&format!(" {} ", phrase.replace('\'', " "))))
    };
    text.lines()
        .enumerate()
        .filter(|(_, line)| is_text(line) && has(line))
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
    let has_old_names = path.ends_with("bake/recipe.rs");
    let is_old_name = |l: &str| has_old_names || l.contains("alias") || l.contains("rename = ");
    for (i, line) in text.lines().enumerate().filter(|(_, l)| !is_old_name(l)) {
        for word in words(line).filter(|w| BANNED.contains(&w.as_str())) {
            found.push(format!("{path}:{}: `{word}`", i + 1));
        }
        if line.contains("MOST_") || line.contains("LEAST_") {
            found.push(format!("{path}:{}: MAX_ and MIN_ name limits", i + 1));
        }
    }
    found
}

/// Returns lines with "place" as a noun: an identifier in code that does not start with it, or a
/// word after one of `DETERMINERS` in comments and documents. "Takes the place of" is exempt.
fn places(path: &str, text: &str) -> Vec<String> {
    let is_place = |word: &str| word == "place" || word == "places";
    let names = |code: &str| {
        let mut names = code.split(|c: char| !c.is_alphanumeric() && c != '_');
        names.any(|name| {
            let is_call = code.contains(&format!("{name}("));
            let is_verb = name.to_lowercase().starts_with("place") && !is_place(name);
            !is_call && !is_verb && words(&name.replace('_', " ")).any(|word| is_place(&word))
        })
    };
    let nouns = |prose: &str| {
        let prose: String = prose.split('`').step_by(2).collect();
        let all: Vec<String> = words(&prose).filter(|word| !word.is_empty()).collect();
        let mut pairs = all.windows(2);
        pairs.any(|pair| DETERMINERS.contains(&pair[0].as_str()) && is_place(&pair[1]))
            && !prose.contains("the place of")
    };
    let code = match path.ends_with(".md") {
        true => String::new(),
        false => code_only(text),
    };
    let code = code.lines().chain(std::iter::repeat(""));
    let is_prose = |line: &str| path.ends_with(".md") || line.trim_start().starts_with("//");
    text.lines()
        .zip(code)
        .enumerate()
        .filter(|(_, (line, code))| names(code) || is_prose(line) && nouns(line))
        .map(|(i, (line, _))| format!("{path}:{}: {}", i + 1, line.trim_start()))
        .collect()
}

/// Returns `true` if `line` declares a field or function called `name`.
fn declares(line: &str, name: &str) -> bool {
    let line = line.trim_start();
    let line = match line.strip_prefix("pub(") {
        Some(rest) => rest.split_once(") ").map_or(line, |(_, rest)| rest),
        None => line.trim_start_matches("pub "),
    };
    let field = line.strip_prefix(name);
    let function = line
        .strip_prefix("fn ")
        .and_then(|rest| rest.strip_prefix(name));
    field.is_some_and(|rest| rest.starts_with(": "))
        || function.is_some_and(|rest| rest.starts_with(['(', '<']))
}

/// Former names in code. Old spellings that files and command lines may still use are exempt.
fn refused(path: &str, text: &str) -> Vec<String> {
    let mut found = Vec::new();
    for (i, line) in text.lines().enumerate() {
        if line.contains("alias") || path.ends_with("bake/recipe.rs") {
            continue;
        }
        let mut names = line.split(|c: char| !c.is_alphanumeric() && c != '_');
        let name = names.find_map(|n| REFUSED_NAMES.iter().find(|(old, _)| *old == n));
        let members = REFUSED_MEMBERS.iter();
        let member = members
            .filter(|(file, ..)| path.ends_with(file))
            .find(|(_, old, _)| declares(line, old));
        let member = member.map(|(_, old, new)| (*old, *new));
        for (old, new) in name.copied().into_iter().chain(member) {
            found.push(format!("{path}:{}: `{old}` is `{new}`", i + 1));
        }
        // A constructor is `new` or `from_x`, an accessor has a noun (R7), an action a verb (R9).
        let is_function = line.contains("fn ");
        let vague = VAGUE_FUNCTIONS.iter();
        if let Some(name) = vague.filter(|_| is_function).find(|n| declares(line, n)) {
            found.push(format!("{path}:{}: `{name}` is no name", i + 1));
        }
        if line.trim_start().starts_with("pub why:") {
            found.push(format!("{path}:{}: `why` is `reason` or `error`", i + 1));
        }
    }
    found
}

/// Returns all texts that the writing rules apply to. This file has the words as examples.
fn texts() -> Vec<(String, String)> {
    let folders = ["src", "crates", "shaders", "examples", "tests", "docs"];
    let mut all = files_and_pages(&folders, &["rs", "wgsl", "md", "toml", "ron"]);
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
fn place_is_no_noun() {
    let found: Vec<String> = texts()
        .iter()
        .filter(|(path, _)| !path.ends_with(".ron") && !path.ends_with(".toml"))
        .flat_map(|(path, text)| places(path, text))
        .collect();
    none(found);
    let bad = "// At a place.\nlet light_place = 1;\nplaces: u8,\n";
    assert_eq!(places("a.rs", bad).len(), 3);
    let good = "// Places A in place of B, which takes the place of C.\nplace(\"a place\");\n";
    assert_eq!(places("a.rs", good).len(), 0);
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

#[test]
fn comments_and_documents_have_no_literary_phrases() {
    let found: Vec<String> = texts()
        .iter()
        .filter(|(path, _)| !path.ends_with(".ron") && !path.ends_with(".toml"))
        .flat_map(|(path, text)| phrases(path, text))
        .collect();
    none(found);
    assert_eq!(
        phrases("a.rs", "// In free\n// A, beside B.\nbeside();\n").len(),
        1
    );
    assert_eq!(phrases("a.md", "So many rays.\nSomebody\n").len(), 1);
}

#[test]
fn code_has_no_former_names() {
    let found: Vec<String> = texts()
        .iter()
        .filter(|(path, _)| path.ends_with(".rs") || path.ends_with(".wgsl"))
        .flat_map(|(path, text)| refused(path, text))
        .collect();
    none(found);
    assert_eq!(refused("a.rs", "let x = live_surfaces(1);").len(), 1);
    assert_eq!(
        refused("src/frame/subsplat.rs", "    pub alike: f32,").len(),
        1
    );
    assert_eq!(refused("a.rs", "    pub alike: f32,").len(), 0);
    assert_eq!(refused("a.rs", "    pub fn of(x: u32) -> Self {").len(), 1);
    assert_eq!(refused("a.rs", "pub(crate) fn shown<T>(x: T) {").len(), 1);
    assert_eq!(refused("a.rs", "    pub why: String,").len(), 1);
    assert_eq!(refused("a.rs", "    of: u32,\n    within(a);").len(), 0);
}
