//! Triangle meshes as [`Geometry`]. Closest hits use obvhs's binary BVH with the watertight
//! triangle test in its leaves.
//!
//! Surfaces are flat: the normal is the geometric normal of the triangle, so that light stays on
//! the correct side of the surface. Triangles are stored in BVH order. If two hits have the same
//! distance the triangle with the lower index is returned. The result therefore does not depend on
//! the traversal order.

mod content_hash;
mod emissive_triangles;
mod rays;

use rays::{interpolate, normal};

use super::RayOffsets;
use super::bvh_build::build_binary;
use super::geometry::mesh_ray_offset;
use super::occluder::MeshNode;
use super::watertight::{TriangleHit, WatertightRay};
use super::{
    Bounds, Bvh, Emitters, Geometry, Hit, HitPoint, Material, MaterialFactors, MaterialTerms,
    MeshProblems, Ray, Surface, Texture,
};
use core::f32::consts::PI;
use glam::{DVec3, Vec2, Vec3};
use obvhs::bvh2::Bvh2;
use obvhs::ray::RayHit;
use std::time::{Duration, Instant};

/// Upper limit of coordinates, meters. Larger values are treated as damage, because their squares
/// overflow.
const MAX_COORDINATE: f32 = 1e9;

/// Upper limit of radiance, W/(m² sr). Larger values are treated as damage, because their sums
/// overflow.
const MAX_RADIANCE: f32 = 1e18;

/// Texture coordinates of the three corners of a triangle, per texture type of a [`Material`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TriangleUvs {
    /// Coordinates of the base color texture.
    pub base_color: [Vec2; 3],
    /// Coordinates of the metallic texture.
    pub metallic: [Vec2; 3],
    /// Coordinates of the emissive texture.
    pub emissive: [Vec2; 3],
}

/// Parts of a mesh, with the triangles in their original order.
pub(super) struct FaceParts {
    pub(super) triangles: Vec<[Vec3; 3]>,
    pub(super) material_of: Vec<u32>,
    /// Texture coordinates per triangle. Empty without textures.
    pub(super) uvs: Vec<TriangleUvs>,
    pub(super) materials: Vec<Material>,
    pub(super) textures: Vec<Texture>,
    pub(super) lifts: Vec<RayOffsets>,
    pub(super) nodes: Vec<MeshNode>,
    /// Node of each triangle. Empty without nodes.
    pub(super) node_of: Vec<u32>,
}

/// Triangle in the layout for traversal, 48 bytes.
#[derive(Clone, Copy, Debug)]
struct Face {
    corners: [Vec3; 3],
    /// Index of the triangle in the mesh.
    index: u32,
    /// Index of the material.
    material: u32,
    /// `true` if alpha can cut holes into the face.
    masked: bool,
}

/// Triangles with materials and a BVH for ray casts.
pub struct TriangleMesh {
    faces: Vec<Face>,
    /// Index in `faces` of each triangle.
    face_index: Vec<u32>,
    uvs: Vec<TriangleUvs>,
    materials: Vec<Material>,
    textures: Vec<Texture>,
    bounds: Bounds,
    tree: Bvh2,
    bvh_time: Duration,
    problems: MeshProblems,
    emitters: Emitters,
    /// Ray offsets of the cells of point clouds.
    lifts: Vec<RayOffsets>,
    /// Nodes of the source file. Empty without a file or if the file has no nodes.
    nodes: Vec<MeshNode>,
    /// Node of each triangle.
    node_of: Vec<u32>,
}

impl TriangleMesh {
    /// Creates a mesh with untextured materials. `triangles` are corners in meters,
    /// counter-clockwise seen from the front. `material_of` has the index into `materials` of each
    /// triangle. Triangles beyond its end get the default material. Degenerate or invalid triangles
    /// are left out and counted in [`Self::problems`]. The others keep their order.
    #[must_use]
    pub fn new(triangles: Vec<[Vec3; 3]>, material_of: Vec<u32>, materials: Vec<Material>) -> Self {
        Self::textured(triangles, material_of, materials, Vec::new(), Vec::new())
    }

    /// Creates a mesh like [`Self::new`], with textures and the texture coordinates of each
    /// triangle.
    #[must_use]
    pub fn textured(
        triangles: Vec<[Vec3; 3]>,
        material_of: Vec<u32>,
        mut materials: Vec<Material>,
        uvs: Vec<TriangleUvs>,
        textures: Vec<Texture>,
    ) -> Self {
        let mut problems = MeshProblems::default();
        for material in &mut materials {
            repair(material, textures.len(), &mut problems);
        }
        let fallback = materials.len() as u32;
        let mut fallback_used = false;
        let mut faces = Vec::with_capacity(triangles.len());
        let mut kept_uvs = Vec::new();
        for (i, corners) in triangles.iter().enumerate() {
            if !is_within_reach(corners) {
                problems.not_finite += 1;
                continue;
            }
            if normal(corners).is_none() {
                problems.no_area += 1;
                continue;
            }
            let mut material = material_of.get(i).copied().unwrap_or(fallback);
            if material >= fallback {
                problems.bad_material += 1;
                fallback_used = true;
                material = fallback;
            }
            if !textures.is_empty() {
                kept_uvs.push(uvs.get(i).copied().unwrap_or_default());
            }
            let masked = materials
                .get(material as usize)
                .is_some_and(|m| m.alpha_cutoff.is_some());
            faces.push(Face {
                corners: *corners,
                index: faces.len() as u32,
                material,
                masked,
            });
        }
        if fallback_used {
            materials.push(Material::default());
        }
        let bounds = faces
            .iter()
            .flat_map(|f| f.corners)
            .fold(Bounds::EMPTY, Bounds::join);
        let corners: Vec<_> = faces.iter().map(|f| f.corners).collect();
        let began = Instant::now();
        let tree = build_binary(&corners, 1);
        let bvh_time = began.elapsed();
        let faces: Vec<Face> = tree
            .primitive_indices
            .iter()
            .map(|&i| faces[i as usize])
            .collect();
        let mut face_index = vec![0u32; faces.len()];
        for (k, face) in faces.iter().enumerate() {
            face_index[face.index as usize] = k as u32;
        }
        let mut mesh = Self {
            faces,
            face_index,
            uvs: kept_uvs,
            materials,
            textures,
            bounds,
            tree,
            bvh_time,
            problems,
            emitters: Emitters::default(),
            lifts: Vec::new(),
            nodes: Vec::new(),
            node_of: Vec::new(),
        };
        mesh.emitters = mesh.find_emitters();
        mesh
    }

    /// Creates a mesh from vertices and indices. Triangles with indices out of range are dropped
    /// and counted.
    #[must_use]
    pub fn indexed(
        vertices: &[Vec3],
        indices: &[[u32; 3]],
        material_of: &[u32],
        materials: Vec<Material>,
    ) -> Self {
        let mut triangles = Vec::with_capacity(indices.len());
        let mut kept_materials = Vec::with_capacity(indices.len());
        let mut bad_index = 0;
        for (i, corners) in indices.iter().enumerate() {
            let [Some(&a), Some(&b), Some(&c)] = corners.map(|v| vertices.get(v as usize)) else {
                bad_index += 1;
                continue;
            };
            triangles.push([a, b, c]);
            kept_materials.push(material_of.get(i).copied().unwrap_or(u32::MAX));
        }
        let mut mesh = Self::new(triangles, kept_materials, materials);
        mesh.problems.bad_index += bad_index;
        mesh
    }

    /// Returns `true` if a mesh keeps a triangle with these corners. The corners must be finite,
    /// nearer than 10⁹ m and span an area. All other triangles are left out and counted in
    /// [`Self::problems`].
    #[must_use]
    pub fn is_valid_triangle(corners: &[Vec3; 3]) -> bool {
        is_within_reach(corners) && has_area(corners)
    }

    /// Returns the number of triangles.
    #[must_use]
    pub fn len(&self) -> usize {
        self.faces.len()
    }

    /// Returns `true` if the mesh has no triangles. Rays then have no hits.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.faces.is_empty()
    }

    /// Returns the corners in meters of the triangle with index `i`. Indices are those of
    /// [`Hit::primitive`].
    #[must_use]
    pub fn triangle(&self, i: usize) -> Option<[Vec3; 3]> {
        self.face_index
            .get(i)
            .map(|&k| self.faces[k as usize].corners)
    }

    /// Returns the material of the triangle with index `i`.
    #[must_use]
    pub fn material(&self, i: usize) -> Option<&Material> {
        self.face_index
            .get(i)
            .and_then(|&k| self.materials.get(self.faces[k as usize].material as usize))
    }

    /// Returns the numbers of parts that were dropped or corrected.
    #[must_use]
    pub fn problems(&self) -> &MeshProblems {
        &self.problems
    }

    /// Returns the build time of the hierarchy for the bake's rays.
    #[must_use]
    pub fn bvh_time(&self) -> Duration {
        self.bvh_time
    }

    pub(super) fn texture_count(&self) -> usize {
        self.textures.len()
    }

    pub(super) fn into_parts(self) -> FaceParts {
        let in_order = || self.face_index.iter().map(|&k| &self.faces[k as usize]);
        FaceParts {
            nodes: self.nodes,
            node_of: self.node_of,
            triangles: in_order().map(|f| f.corners).collect(),
            material_of: in_order().map(|f| f.material).collect(),
            uvs: self.uvs,
            materials: self.materials,
            textures: self.textures,
            lifts: self.lifts,
        }
    }

    /// Returns the nodes of the source, and the node index of each triangle.
    pub(super) fn nodes(&self) -> (&[MeshNode], &[u32]) {
        (&self.nodes, &self.node_of)
    }

    /// Assigns a node to every triangle. [`Self::split_occluders`] reads the names of the nodes.
    /// `node_of` has an entry for each triangle that the mesh keeps ([`Self::is_valid_triangle`]).
    pub fn set_nodes(&mut self, nodes: Vec<MeshNode>, node_of: Vec<u32>) {
        (self.nodes, self.node_of) = (nodes, node_of);
    }

    /// Returns the mesh of the triangles with an index that `keeps` accepts, with the same
    /// materials.
    pub(super) fn keep(&self, keeps: impl Fn(usize) -> bool) -> Self {
        let kept: Vec<usize> = (0..self.len()).filter(|&i| keeps(i)).collect();
        let face = |&i: &usize| &self.faces[self.face_index[i] as usize];
        let some = |all: &[u32]| kept.iter().filter_map(|&i| all.get(i).copied()).collect();
        let mut mesh = Self::textured(
            kept.iter().map(|i| face(i).corners).collect(),
            kept.iter().map(|i| face(i).material).collect(),
            self.materials.clone(),
            (kept.iter().filter_map(|&i| self.uvs.get(i).copied())).collect(),
            self.textures.clone(),
        );
        mesh.problems = self.problems;
        mesh.lifts.clone_from(&self.lifts);
        mesh.set_nodes(self.nodes.clone(), some(&self.node_of));
        mesh
    }

    /// Adds ray offsets of point cells to [`Geometry::ray_offset`].
    pub(super) fn set_ray_offsets(&mut self, lifts: impl IntoIterator<Item = RayOffsets>) {
        self.lifts = lifts.into_iter().collect();
    }

    #[cfg(feature = "gltf")]
    pub(super) fn add_bad_indices(&mut self, count: u64) {
        self.problems.bad_index += count;
    }

    /// Builds the hierarchy for the frame's shadow rays. It ignores textures. A triangle that alpha
    /// removes completely is left out. A triangle that alpha removes partly is kept as a whole.
    #[must_use]
    pub fn bvh(&self) -> Bvh {
        let kept = |i: &usize| {
            let face = &self.faces[self.face_index[*i] as usize];
            !face.masked || self.may_be_there(face)
        };
        let corners: Vec<_> = (0..self.faces.len())
            .filter(kept)
            .map(|i| self.faces[self.face_index[i] as usize].corners)
            .collect();
        Bvh::build(&corners).0
    }

    fn may_be_there(&self, face: &Face) -> bool {
        let material = &self.materials[face.material as usize];
        let Some(cutoff) = material.alpha_cutoff else {
            return true;
        };
        let factor = material.base_color.w;
        match (
            material.base_color_texture,
            self.uvs.get(face.index as usize),
        ) {
            (Some(texture), Some(uvs)) if factor > 0.0 => {
                self.textures[texture as usize].may_reach_alpha(uvs.base_color, cutoff / factor)
            }
            _ => factor >= cutoff,
        }
    }

    /// Returns the texture values at a hit: base color, metallic fraction and emission. Colors are
    /// white without a texture.
    fn texels(&self, face: &Face, hit: &Hit) -> (Vec3, f32, Vec3) {
        let material = &self.materials[face.material as usize];
        let (mut color, mut metallic, mut glow) = (Vec3::ONE, material.metallic, Vec3::ONE);
        if let Some(uvs) = self.uvs.get(face.index as usize) {
            let texture = |t: u32| &self.textures[t as usize];
            if let Some(t) = material.base_color_texture {
                color = texture(t)
                    .color(interpolate(uvs.base_color, hit.uv))
                    .truncate();
            }
            if let Some(t) = material.metallic_texture {
                metallic *= texture(t).data(interpolate(uvs.metallic, hit.uv)).z;
            }
            if let Some(t) = material.emissive_texture {
                glow = texture(t)
                    .color(interpolate(uvs.emissive, hit.uv))
                    .truncate();
            }
        }
        (color, metallic, glow)
    }

    /// Returns `true` if a hit is on the surface and not in an alpha hole.
    fn is_solid(&self, face: &Face, hit: &TriangleHit) -> bool {
        if !face.masked {
            return true;
        }
        let material = &self.materials[face.material as usize];
        let mut alpha = material.base_color.w;
        if let (Some(texture), Some(uvs)) = (
            material.base_color_texture,
            self.uvs.get(face.index as usize),
        ) {
            alpha *=
                self.textures[texture as usize].alpha(interpolate(uvs.base_color, [hit.u, hit.v]));
        }
        material.alpha_cutoff.is_none_or(|cutoff| alpha >= cutoff)
    }
}

impl core::fmt::Debug for TriangleMesh {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("TriangleMesh")
            .field("triangles", &self.faces.len())
            .field("materials", &self.materials.len())
            .field("textures", &self.textures.len())
            .field("bounds", &self.bounds)
            .field("problems", &self.problems)
            .finish_non_exhaustive()
    }
}

/// Returns `true` if the coordinates of a triangle are finite and small enough for rays.
fn is_within_reach(corners: &[Vec3; 3]) -> bool {
    (corners.iter()).all(|v| v.is_finite() && v.abs().max_element() < MAX_COORDINATE)
}

/// Returns `true` if a ray can hit the triangle.
pub(super) fn has_area(corners: &[Vec3; 3]) -> bool {
    normal(corners).is_some()
}

/// Returns `true` if a mesh keeps the triangle.
pub(super) fn is_usable(corners: &[Vec3; 3]) -> bool {
    is_within_reach(corners) && normal(corners).is_some()
}

/// Clamps the values of a material to their ranges.
fn repair(material: &mut Material, textures: usize, problems: &mut MeshProblems) {
    let inside = |x: f32| {
        if x.is_finite() {
            x.clamp(0.0, 1.0)
        } else {
            0.0
        }
    };
    let before = (material.base_color, material.metallic);
    let rgb = material.base_color.truncate();
    let alpha = if material.base_color.w.is_finite() {
        material.base_color.w
    } else {
        1.0
    };
    material.base_color = Vec3::new(inside(rgb.x), inside(rgb.y), inside(rgb.z)).extend(alpha);
    material.metallic = inside(material.metallic);
    if before != (material.base_color, material.metallic) {
        problems.albedo_clamped += 1;
    }
    if !(material.emissive.is_finite() && material.emissive.min_element() >= 0.0) {
        material.emissive = Vec3::ZERO;
        problems.bad_emission += 1;
    } else if material.emissive.max_element() > MAX_RADIANCE {
        material.emissive = material.emissive.min(Vec3::splat(MAX_RADIANCE));
        problems.bad_emission += 1;
    }
    if material.alpha_cutoff.is_some_and(|c| !c.is_finite()) {
        material.alpha_cutoff = None;
    }
    let bad = |t: Option<u32>| t.is_some_and(|t| t as usize >= textures);
    if material.textures().into_iter().any(bad) {
        problems.bad_texture += 1;
    }
    for texture in [
        &mut material.base_color_texture,
        &mut material.metallic_texture,
        &mut material.emissive_texture,
    ] {
        if bad(*texture) {
            *texture = None;
        }
    }
}
