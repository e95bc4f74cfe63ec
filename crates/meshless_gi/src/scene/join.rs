//! Joining several meshes and cells of point clouds to one mesh. They share one hierarchy, so that
//! they light and shadow each other.

use super::mesh::FaceParts;
use super::{Material, TriangleMesh, TriangleUvs};

impl TriangleMesh {
    /// Joins all triangles to one mesh, part after part, each with its own materials and textures.
    /// A single part is returned unchanged.
    #[must_use]
    pub fn joined(mut parts: Vec<Self>) -> Self {
        if parts.len() == 1
            && let Some(only) = parts.pop()
        {
            return only;
        }
        let textured = parts.iter().any(|p| p.texture_count() > 0);
        let (mut triangles, mut material_of, mut uvs) = (Vec::new(), Vec::new(), Vec::new());
        let (mut materials, mut textures, mut lifts) = (Vec::new(), Vec::new(), Vec::new());
        let (mut nodes, mut node_of) = (Vec::new(), Vec::new());
        for part in parts {
            let part = part.into_parts();
            let (own_nodes, own_node_of) = part.nodes_behind(nodes.len() as u32);
            nodes.extend(own_nodes);
            node_of.extend(own_node_of);
            let FaceParts {
                triangles: own_triangles,
                material_of: own_material_of,
                uvs: own_uvs,
                materials: own_materials,
                textures: own_textures,
                lifts: own_lifts,
                ..
            } = part;
            let (first_material, first_texture) = (materials.len() as u32, textures.len() as u32);
            material_of.extend(own_material_of.iter().map(|m| m + first_material));
            if textured {
                // A part without textures has no coordinates.
                let missing = own_triangles.len() - own_uvs.len().min(own_triangles.len());
                uvs.extend(own_uvs);
                uvs.extend(std::iter::repeat_n(TriangleUvs::default(), missing));
            }
            triangles.extend(own_triangles);
            let moved = |texture: Option<u32>| texture.map(|t| t + first_texture);
            materials.extend(own_materials.into_iter().map(|m| Material {
                base_color_texture: moved(m.base_color_texture),
                metallic_texture: moved(m.metallic_texture),
                emissive_texture: moved(m.emissive_texture),
                ..m
            }));
            textures.extend(own_textures);
            lifts.extend(own_lifts);
        }
        let mut mesh = Self::textured(triangles, material_of, materials, uvs, textures);
        mesh.set_ray_offsets(lifts);
        if !nodes.is_empty() {
            mesh.set_nodes(nodes, node_of);
        }
        mesh
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Geometry, Ray, Texture, Wrap};
    use glam::{Vec2, Vec3};

    fn tile(x: f32, material: Material, textures: Vec<Texture>) -> TriangleMesh {
        let at = |u: f32, v: f32| Vec3::new(x + u, v, 0.0);
        let uvs = TriangleUvs {
            base_color: [Vec2::ZERO, Vec2::X, Vec2::Y],
            ..TriangleUvs::default()
        };
        TriangleMesh::textured(
            vec![[at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0)]],
            vec![0],
            vec![material],
            vec![uvs],
            textures,
        )
    }

    #[test]
    fn joined_meshes_keep_materials_and_textures() {
        let painted = |texel: [u8; 4]| {
            let material = Material {
                base_color_texture: Some(0),
                ..Material::diffuse(Vec3::ONE)
            };
            let texture = Texture::new(1, 1, vec![texel], [Wrap::Repeat; 2]).unwrap();
            (material, vec![texture])
        };
        let (red, reds) = painted([255, 0, 0, 255]);
        let (blue, blues) = painted([0, 0, 255, 255]);
        let all = TriangleMesh::joined(vec![
            tile(0.0, red, reds),
            tile(2.0, Material::diffuse(Vec3::splat(0.25)), Vec::new()),
            tile(4.0, blue, blues),
        ]);
        let seen = |x: f32| {
            let ray = Ray::new(Vec3::new(x + 0.25, 0.25, 1.0), Vec3::NEG_Z);
            let hit = all.cast(&ray).expect("a tile");
            (hit.primitive, all.surface(&ray, &hit).albedo)
        };
        assert_eq!(seen(0.0), (0, Vec3::X));
        assert_eq!(seen(2.0), (1, Vec3::splat(0.25)));
        assert_eq!(seen(4.0), (2, Vec3::Z));
        assert!(TriangleMesh::joined(Vec::new()).is_empty());
    }
}
