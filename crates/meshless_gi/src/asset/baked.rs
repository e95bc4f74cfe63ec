//! Baked scene: the result of a bake.

use super::{AssetError, BakeInfo, BakedStats, Limits, SceneData, Violation};
use crate::scene::Bounds;
use glam::Vec3;

/// Baked scene: the result of a bake, and all data that a frame reads. Stored as a `.mgi` file.
#[derive(Clone, Debug, PartialEq)]
pub struct BakedScene {
    data: SceneData,
    info: BakeInfo,
}

impl BakedScene {
    /// Creates a scene, for the crates of this workspace. Exempt from semantic versioning.
    #[doc(hidden)]
    #[must_use]
    pub fn new(data: SceneData, info: BakeInfo) -> Self {
        Self { data, info }
    }

    /// Returns the sources, settings, error estimate and statistics of the bake.
    #[must_use]
    pub fn info(&self) -> &BakeInfo {
        &self.info
    }

    /// Returns the scene with the irradiance of its points. See [`SceneData::illumination`].
    #[doc(hidden)]
    #[must_use]
    pub fn with_illumination(mut self, irradiance: Vec<[f32; 3]>) -> Self {
        self.data.illumination = irradiance;
        self
    }

    /// Returns the box around the geometry, meters. [`Bounds::EMPTY`] if it has no surface.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        let [min, max] = self.data.bounds.map(Vec3::from);
        Bounds { min, max }
    }

    /// Returns the number of points of all levels.
    #[must_use]
    pub fn point_count(&self) -> usize {
        self.data.points.len()
    }

    /// Returns the number of levels.
    #[must_use]
    pub fn levels(&self) -> usize {
        self.data.levels()
    }

    /// Returns the scene as a `.mgi` file. The same scene gives the same bytes.
    ///
    /// # Errors
    /// [`AssetError::Invalid`] if the file could not be read again. [`AssetError::Section`] if
    /// `info` cannot be written as text.
    pub fn to_bytes(&self) -> Result<Vec<u8>, AssetError> {
        self.validate().map_err(AssetError::Invalid)?;
        self.data.to_bytes(&self.info)
    }

    /// Reads a `.mgi` file from memory. Checks header, table, checksums and content. Allocates at
    /// most `limits`, for any bytes.
    ///
    /// # Errors
    /// See [`AssetError`]. No bytes cause a panic.
    pub fn from_bytes(bytes: &[u8], limits: &Limits) -> Result<Self, AssetError> {
        let (data, info) = SceneData::from_bytes(bytes, limits)?;
        let scene = Self { data, info };
        scene.validate().map_err(AssetError::Invalid)?;
        Ok(scene)
    }

    /// Checks everything that a frame requires. A scene that passes can be used without further
    /// tests. Exempt from semantic versioning.
    ///
    /// # Errors
    /// Violations, at most 32.
    #[doc(hidden)]
    pub fn validate(&self) -> Result<BakedStats, Vec<Violation>> {
        self.data.validate(&self.info.tiers)
    }

    /// Returns the arrays, for the crates of this workspace. Exempt from semantic versioning.
    #[doc(hidden)]
    #[must_use]
    pub fn data(&self) -> &SceneData {
        &self.data
    }

    /// Returns the mutable arrays, as [`data`](Self::data).
    #[doc(hidden)]
    pub fn data_mut(&mut self) -> &mut SceneData {
        &mut self.data
    }

    /// Returns the mutable facts, as [`data`](Self::data).
    #[doc(hidden)]
    pub fn info_mut(&mut self) -> &mut BakeInfo {
        &mut self.info
    }
}
