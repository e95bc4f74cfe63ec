//! Problems of the triangles and materials that a mesh was built from.

/// Numbers of parts that were dropped or corrected when a mesh was built.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MeshProblems {
    /// Triangles dropped because a coordinate was not finite, or beyond 10⁹ m.
    pub not_finite: u64,
    /// Triangles dropped because they have no area.
    pub no_area: u64,
    /// Triangles dropped because a vertex index was out of range.
    pub bad_index: u64,
    /// Triangles whose material index was out of range: they got the default material.
    pub bad_material: u64,
    /// Materials whose reflectance was not within [0, 1]: clamped.
    pub albedo_clamped: u64,
    /// Materials whose emission was not finite or negative: it was dropped; or beyond 10¹⁸ W/(m²
    /// sr): it was lowered to that.
    pub bad_emission: u64,
    /// Materials that named a texture that is not there: used without it.
    pub bad_texture: u64,
}

impl MeshProblems {
    /// Triangles that are not in the mesh.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.not_finite + self.no_area + self.bad_index
    }

    /// Adds what was wrong elsewhere.
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
