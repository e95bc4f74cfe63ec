//! Reading of files within `--max-input`.

use super::error::ToolError;
use meshless_gi::internals::scene::{InputBudget, read_file};
use meshless_gi::{BakedScene, Limits};
use std::path::Path;
use std::sync::OnceLock;

/// Value of `--max-input`, bytes.
static MAX_INPUT: OnceLock<u64> = OnceLock::new();

/// Sets the limit of all reads of this process. Later calls have no effect.
pub fn set_limit(bytes: Option<u64>) {
    if let Some(bytes) = bytes {
        MAX_INPUT.get_or_init(|| bytes);
    }
}

/// Returns the input budget of one scene: a file and all files that it names.
pub fn budget() -> InputBudget {
    MAX_INPUT
        .get()
        .copied()
        .map(InputBudget::new)
        .unwrap_or_default()
}

/// Returns the limits of a bake, on disk and in memory.
pub fn limits() -> Limits {
    let max_bytes = MAX_INPUT.get().copied();
    max_bytes.map_or_else(Limits::default, |max_bytes| Limits { max_bytes })
}

/// Reads a bake.
pub fn bake(path: &Path) -> Result<BakedScene, ToolError> {
    BakedScene::read(path, &limits()).map_err(|error| ToolError::asset(path, &error))
}

/// Reads a file.
pub fn bytes(path: &Path) -> Result<Vec<u8>, ToolError> {
    let limit = MAX_INPUT.get().copied().unwrap_or(InputBudget::DEFAULT);
    read_file(path, limit).map_err(|error| ToolError::reading(path, &error))
}

/// Parses a number of bytes: `1000`, `64MiB`, `8GiB`.
pub fn size(text: &str) -> Result<u64, String> {
    let units = [("KiB", 10), ("MiB", 20), ("GiB", 30), ("TiB", 40), ("B", 0)];
    let unit = units.iter().find(|(name, _)| text.ends_with(name));
    let (name, shift) = unit.copied().unwrap_or_default();
    let number: Option<u64> = text[..text.len() - name.len()].trim_end().parse().ok();
    number
        .and_then(|n| n.checked_mul(1 << shift))
        .ok_or_else(|| "expected a number of bytes, such as 500MiB or 8GiB".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn size_with_unit_parses_to_bytes() {
        assert_eq!(size("0"), Ok(0));
        assert_eq!(size("1000"), Ok(1000));
        assert_eq!(size("12B"), Ok(12));
        assert_eq!(size("64 KiB"), Ok(65_536));
        assert_eq!(size("8GiB"), Ok(8 << 30));
        for wrong in ["", "GiB", "-1", "1.5GiB", "8GB", "99999999999GiB", "8gib"] {
            assert!(size(wrong).is_err(), "{wrong}");
        }
    }
}
