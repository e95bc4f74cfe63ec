//! Programs and recipe of README.md, read from its text.

const README: &str = include_str!("../../README.md");

/// Returns the code blocks of a language in order.
fn blocks(language: &str) -> impl Iterator<Item = &'static str> {
    README
        .split("\n```")
        .skip(1)
        .step_by(2)
        .filter_map(move |block| {
            let (info, code) = block.split_once('\n')?;
            let first = info.split(',').next()?;
            (first == language).then_some(code)
        })
}

/// Returns the first complete program that contains `part`.
pub fn program(part: &str) -> String {
    blocks("rust")
        .find(|code| code.contains("fn main()") && code.contains(part))
        .unwrap_or_else(|| panic!("README.md has no program with `{part}`"))
        .to_string()
}

/// Scene that the README copies into `assets/`, relative to the repository.
pub const SCENE: &str = "tests/data/rooms_open/rooms_open.glb";

/// Returns the recipes in order.
pub fn recipes() -> impl Iterator<Item = &'static str> {
    blocks("ron")
}

/// Returns the first recipe.
pub fn recipe() -> &'static str {
    assert!(README.contains(&format!("cp ../bevy_meshless_gi/{SCENE} assets/level.glb")));
    recipes().next().expect("README.md has a recipe")
}
