//! Triangles of a mesh that emit light.

use super::*;

impl TriangleMesh {
    /// Collects the triangles with an emissive material.
    pub(super) fn find_emitters(&self) -> Emitters {
        /// Number of texture samples per triangle in each direction.
        const SAMPLES: u8 = 4;
        let in_order = self.face_index.iter().map(|&k| &self.faces[k as usize]);
        let emissive =
            in_order.filter(|f| self.materials[f.material as usize].emissive != Vec3::ZERO);
        let triangles = emissive.map(|face| {
            let mut glow = Vec3::ZERO;
            let at = |k: u8| (f32::from(k) + 0.5) / f32::from(SAMPLES);
            for (i, j) in (0..SAMPLES).flat_map(|i| (0..SAMPLES).map(move |j| (i, j))) {
                let u = Vec2::new(at(i), at(j));
                // Folds the unit square into the triangle.
                let uv = if u.x + u.y > 1.0 { Vec2::ONE - u } else { u };
                let hit = Hit {
                    t: 0.0,
                    primitive: face.index,
                    uv: uv.to_array(),
                };
                glow += self.texels(face, &hit).2 / f32::from(SAMPLES).powi(2);
            }
            let emission = self.materials[face.material as usize].emissive * glow;
            (face.index, face.corners, emission.max_element())
        });
        let areas = self.faces.iter().map(|face| {
            let [a, b, c] = face.corners;
            0.5 * f64::from((b - a).cross(c - a).length())
        });
        Emitters::new(triangles, areas.sum())
    }
}
