//! Functions shared by the tests of the tool.

use std::path::PathBuf;

/// Path of a file of the published scenes, relative to `tests/data`.
pub fn data(path: &str) -> String {
    format!(
        "{}/tests/data/{path}",
        concat!(env!("CARGO_MANIFEST_DIR"), "/../..")
    )
}

/// [`data`] as a path.
pub fn data_path(path: &str) -> PathBuf {
    data(path).into()
}
