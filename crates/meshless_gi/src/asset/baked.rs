//! Baked scene: the result of a bake.

use super::{AssetError, BakeInfo, Limits, SceneData};
use crate::scene::Bounds;
use glam::Vec3;

/// Baked scene: the result of a bake, and all data that a frame reads. Stored as a `.mgi` file.
#[derive(Clone, Debug, PartialEq)]
pub struct BakedScene(SceneData);

#[doc(hidden)]
impl From<SceneData> for BakedScene {
    fn from(data: SceneData) -> Self {
        Self(data)
    }
}

impl BakedScene {
    /// Returns the sources, settings, error estimate and statistics of the bake.
    #[must_use]
    pub fn info(&self) -> &BakeInfo {
        &self.0.info
    }

    /// Returns the box around the geometry, meters. [`Bounds::EMPTY`] if it has no surface.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        let [min, max] = self.0.info.bounds.map(Vec3::from);
        Bounds { min, max }
    }

    /// Returns the number of points of all levels.
    #[must_use]
    pub fn point_count(&self) -> usize {
        self.0.points.len()
    }

    /// Returns the number of levels.
    #[must_use]
    pub fn levels(&self) -> usize {
        self.0.levels()
    }

    /// Returns the scene as a `.mgi` file. The same scene gives the same bytes.
    ///
    /// # Errors
    /// [`AssetError::Invalid`] if the file could not be read again. [`AssetError::Section`] if
    /// `info` cannot be written as text.
    pub fn to_bytes(&self) -> Result<Vec<u8>, AssetError> {
        self.0.to_bytes()
    }

    /// Reads a `.mgi` file from memory. Checks header, table, checksums and content. Allocates at
    /// most `limits`, for any bytes.
    ///
    /// # Errors
    /// See [`AssetError`]. No bytes cause a panic.
    pub fn from_bytes(bytes: &[u8], limits: &Limits) -> Result<Self, AssetError> {
        SceneData::from_bytes(bytes, limits).map(Self)
    }

    /// Returns the arrays, for the crates of this workspace. Exempt from semantic versioning.
    #[doc(hidden)]
    #[must_use]
    pub fn data(&self) -> &SceneData {
        &self.0
    }

    /// Returns the mutable arrays, as [`data`](Self::data).
    #[doc(hidden)]
    pub fn data_mut(&mut self) -> &mut SceneData {
        &mut self.0
    }

    /// Returns the arrays by value, as [`data`](Self::data).
    #[doc(hidden)]
    #[must_use]
    pub fn into_data(self) -> SceneData {
        self.0
    }
}
