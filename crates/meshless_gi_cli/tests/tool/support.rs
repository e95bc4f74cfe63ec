//! Functions shared by the tests of the tool.

use std::path::PathBuf;

/// Returns the path of a file of the published scenes, relative to `tests/data`.
pub fn data(path: &str) -> String {
    format!(
        "{}/tests/data/{path}",
        concat!(env!("CARGO_MANIFEST_DIR"), "/../..")
    )
}

/// Returns [`data`] as a path.
pub fn data_path(path: &str) -> PathBuf {
    data(path).into()
}
