//! Triangles of a mesh that emit light.

use super::*;
use crate::samples::lattice;

impl TriangleMesh {
    /// Index, corners and mean emission of the triangles whose material emits.
    pub(super) fn emissive_triangles(&self) -> Vec<(u32, [Vec3; 3], f32)> {
        /// Number of texture samples per triangle.
        const SAMPLES: u32 = 16;
        let in_order = self.face_index.iter().map(|&k| &self.faces[k as usize]);
        let emissive =
            in_order.filter(|f| self.materials[f.material as usize].emissive != Vec3::ZERO);
        emissive
            .map(|face| {
                let mut glow = Vec3::ZERO;
                for k in 0..SAMPLES {
                    let u = lattice(k, SAMPLES, Vec2::ZERO);
                    // The unit square folded into the triangle.
                    let uv = if u.x + u.y > 1.0 { Vec2::ONE - u } else { u };
                    let hit = Hit {
                        t: 0.0,
                        primitive: face.index,
                        uv: uv.to_array(),
                    };
                    glow += self.texels(face, &hit).2 / SAMPLES as f32;
                }
                let emission = self.materials[face.material as usize].emissive * glow;
                (face.index, face.corners, emission.max_element())
            })
            .collect()
    }
}
