//! Bakes of recipes next to the folder of processed assets, each with the key of its input.
//!
//! Bevy's asset processor truncates an asset's output before its processor runs, and it bakes again
//! whenever the hash of an input's `.meta` changes, which depends on the loaders of the app. The
//! build step and every app of a project therefore search here first. The key alone identifies a
//! bake. A damaged entry counts as missing.

use super::asset_folders::source_file;
use bevy::asset::AssetPath;
use bevy::log::{debug, warn};
use meshless_gi::internals::asset::write_file;
use std::path::{Component, Path, PathBuf};

/// First bytes of an entry.
const MAGIC: [u8; 8] = *b"MGIKEPT1";
/// Bytes of a hash.
const HASH: usize = 32;
/// Bytes in front of the container: magic, key, hash of the container.
const HEADER: usize = MAGIC.len() + 2 * HASH;

/// Folder with one entry for each recipe.
#[derive(Clone, Debug)]
pub(crate) struct BakeStore {
    folder: PathBuf,
}

impl BakeStore {
    /// Store of a folder of processed assets: `imported_assets/meshless_gi/Default` next to
    /// `imported_assets/Default`. Returns `None` if the folder has no name.
    pub fn next_to(processed: &Path) -> Option<Self> {
        let parent = processed.parent()?;
        Some(Self {
            folder: parent.join("meshless_gi").join(processed.file_name()?),
        })
    }

    /// Folder of the entries.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Returns the container that was baked for `recipe` from input of this key.
    pub fn load(&self, recipe: &AssetPath<'_>, key: &[u8; HASH]) -> Option<Vec<u8>> {
        let mut entry = std::fs::read(self.entry(recipe)?).ok()?;
        let (header, container) = entry.split_at_checked(HEADER)?;
        let (magic, hashes) = header.split_at(MAGIC.len());
        let (held, hash) = hashes.split_at(HASH);
        let whole = magic == MAGIC && held == key && hash == blake3::hash(container).as_bytes();
        whole.then(|| entry.split_off(HEADER))
    }

    /// Stores the container that was baked for `recipe` from input of this key, and replaces the
    /// previous one. A store that cannot be written is logged and costs the next run a bake.
    pub fn save(&self, recipe: &AssetPath<'_>, key: &[u8; HASH], container: &[u8]) {
        let Some(file) = self.entry(recipe) else {
            debug!("the bake of `{recipe}` is not stored: its path is outside the asset folder");
            return;
        };
        let mut entry = Vec::with_capacity(HEADER + container.len());
        entry.extend(MAGIC);
        entry.extend(key);
        entry.extend(blake3::hash(container).as_bytes());
        entry.extend(container);
        let folder = file.parent().unwrap_or(&self.folder);
        let written = std::fs::create_dir_all(folder).and_then(|()| write_file(&file, &entry));
        if let Err(error) = written {
            warn!(
                "{}: the bake cannot be stored for the next run: {error}",
                file.display()
            );
        }
    }

    /// File of a recipe. Returns `None` for a path that leaves the folder.
    fn entry(&self, recipe: &AssetPath<'_>) -> Option<PathBuf> {
        let inside = |c: Component<'_>| matches!(c, Component::Normal(_) | Component::CurDir);
        if !recipe.path().components().all(inside) {
            return None;
        }
        let mut file = source_file(&self.folder, recipe)?.into_os_string();
        file.push(".bake");
        Some(file.into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn load_returns_only_whole_entries_of_the_key() {
        let folder = tempfile::tempdir().unwrap();
        let store = BakeStore::next_to(&folder.path().join("Default")).unwrap();
        assert!(store.folder().ends_with("meshless_gi/Default"));
        let recipe = AssetPath::from("levels/room.gi.ron");
        let (key, other) = ([1; 32], [2; 32]);
        assert_eq!(store.load(&recipe, &key), None, "the store is empty");
        store.save(&recipe, &key, b"container");
        assert_eq!(
            store.load(&recipe, &key).as_deref(),
            Some(&b"container"[..])
        );
        assert_eq!(store.load(&recipe, &other), None, "other input");
        assert_eq!(store.load(&AssetPath::from("levels/b.gi.ron"), &key), None);

        let file = store.folder().join("levels/room.gi.ron.bake");
        let whole = std::fs::read(&file).unwrap();
        for length in 0..whole.len() {
            std::fs::write(&file, &whole[..length]).unwrap();
            assert_eq!(store.load(&recipe, &key), None, "cut to {length} bytes");
        }
        let mut damaged = whole.clone();
        *damaged.last_mut().unwrap() ^= 1;
        std::fs::write(&file, damaged).unwrap();
        assert_eq!(store.load(&recipe, &key), None, "damaged");
        store.save(&recipe, &other, b"later");
        assert_eq!(store.load(&recipe, &other).as_deref(), Some(&b"later"[..]));
    }

    #[test]
    fn save_outside_the_folder_writes_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let store = BakeStore::next_to(&folder.path().join("Default")).unwrap();
        for path in ["../room.gi.ron", "/room.gi.ron"] {
            let path = AssetPath::from_path(Path::new(path));
            store.save(&path, &[1; 32], b"container");
            assert_eq!(store.load(&path, &[1; 32]), None);
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn save_to_a_folder_that_is_a_file_is_no_error() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("meshless_gi"), b"in the way").unwrap();
        let store = BakeStore::next_to(&folder.path().join("Default")).unwrap();
        let recipe = AssetPath::from("room.gi.ron");
        store.save(&recipe, &[1; 32], b"container");
        assert_eq!(store.load(&recipe, &[1; 32]), None);
    }
}
