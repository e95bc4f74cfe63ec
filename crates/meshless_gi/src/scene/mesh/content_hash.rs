//! Digest of a mesh.

use super::*;

impl TriangleMesh {
    /// Returns a digest of all properties that a bake reads from this mesh: geometry, materials and
    /// textures.
    #[must_use]
    pub fn content_hash(&self) -> [u8; 32] {
        let mut hasher = blake3::Hasher::new();
        hasher.update(b"triangle mesh 1");
        for count in [
            self.face_index.len(),
            self.uvs.len(),
            self.materials.len(),
            self.textures.len(),
        ] {
            hasher.update(&(count as u64).to_le_bytes());
        }
        for &k in &self.face_index {
            let face = &self.faces[k as usize];
            hasher.update(bytemuck::cast_slice(&face.corners));
            hasher.update(&face.material.to_le_bytes());
        }
        for uvs in &self.uvs {
            for corners in [uvs.base_color, uvs.metallic, uvs.emissive] {
                hasher.update(bytemuck::cast_slice(&corners));
            }
        }
        self.materials
            .iter()
            .for_each(|m| m.add_to_hash(&mut hasher));
        self.textures
            .iter()
            .for_each(|t| t.add_to_hash(&mut hasher));
        *hasher.finalize().as_bytes()
    }
}
