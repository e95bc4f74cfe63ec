//! Problems of the triangles and materials of a mesh.

/// Numbers of parts that were dropped or corrected when a mesh was built.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct MeshProblems {
    /// Triangles dropped because a coordinate was not finite or was beyond 10⁹ m.
    pub not_finite: u64,
    /// Triangles dropped because they have no area.
    pub no_area: u64,
    /// Triangles dropped because a vertex index was out of range.
    pub bad_index: u64,
    /// Triangles with a material index out of range. They got the default material.
    pub bad_material: u64,
    /// Materials with a reflectance outside [0, 1]. It was clamped.
    pub albedo_clamped: u64,
    /// Materials with invalid emission. It was dropped if it was not finite or was negative. It was
    /// lowered to 10¹⁸ W/(m² sr) if it was larger.
    pub bad_emission: u64,
    /// Materials that reference a missing texture. They are used without the texture.
    pub bad_texture: u64,
}

impl MeshProblems {
    /// Returns the number of dropped triangles.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.not_finite + self.no_area + self.bad_index
    }

    /// Adds the numbers of `other`.
    #[cfg(feature = "json")]
    pub(super) fn add(&mut self, other: &Self) {
        self.not_finite += other.not_finite;
        self.no_area += other.no_area;
        self.bad_index += other.bad_index;
        self.bad_material += other.bad_material;
        self.albedo_clamped += other.albedo_clamped;
        self.bad_emission += other.bad_emission;
        self.bad_texture += other.bad_texture;
    }
}
