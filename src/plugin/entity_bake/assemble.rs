//! Joins collected meshes to one mesh. Its order depends on the content alone, not on the order in
//! which entities were spawned: equal scenes have equal hashes and equal bakes.

use super::super::bake_error::GiBakeError;
use super::collect::{Collected, Instance};
use super::material::{ENCODINGS, SurfaceMaterial};
use super::mesh_data::MeshData;
use super::texture::{Encoding, texture};
use super::warning::GiBakeWarning as Warning;
use bevy::math::{Vec2, Vec3, Vec4};
use bevy::platform::collections::HashMap;
use meshless_gi::internals::scene::MeshProblems;
use meshless_gi::{Material, Texture, TriangleMesh, TriangleUvs};

/// Largest number of triangles of a bake.
const MAX_TRIANGLES: u64 = 1 << 25;

/// Steps of a vertex color's channels: 6 bits, so that smooth colors make few materials.
const COLOR_STEPS: f32 = 63.0;

/// A vertex color, quantized: square roots of linear RGB, and linear alpha.
type Tint = [u8; 4];

/// The tint of meshes without vertex colors.
const WHITE: Tint = [COLOR_STEPS as u8; 4];

/// Triangles of an instance in the root's space.
struct Piece {
    triangles: Vec<[Vec3; 3]>,
    /// Empty where the material has no texture.
    uvs: Vec<TriangleUvs>,
    /// Empty where the mesh has no vertex colors.
    tints: Vec<Tint>,
    material: usize,
    node: u32,
    /// Hash of everything above but the node.
    hash: [u8; 32],
}

/// A texture and its hash.
struct HashedTexture {
    texture: Texture,
    hash: [u8; 32],
}

/// Joins `collected` to one mesh and adds warnings to `warnings`.
pub(super) fn assemble(
    collected: &Collected,
    warnings: &mut Vec<Warning>,
) -> Result<TriangleMesh, GiBakeError> {
    let instances = collected.instances.iter();
    let count: u64 = instances
        .map(|i| collected.meshes[i.mesh].triangles.len() as u64)
        .sum();
    if count > MAX_TRIANGLES {
        return Err(GiBakeError::TooManyTriangles {
            root: collected.root.clone(),
            count,
            limit: MAX_TRIANGLES,
        });
    }
    let textures = Textures::read(collected);
    let surfaces: Vec<[u8; 32]> = (collected.materials.iter())
        .map(|surface| surface_hash(surface, &textures))
        .collect();
    let mut pieces = Vec::with_capacity(collected.instances.len());
    for instance in &collected.instances {
        let mesh = &collected.meshes[instance.mesh];
        let surface = &collected.materials[instance.material];
        let (piece, bad) = piece(instance, mesh, surface, &surfaces[instance.material]);
        if bad + mesh.bad_indices > 0 {
            warnings.push(Warning::BadTriangles {
                entity: instance.entity.clone(),
                count: bad + mesh.bad_indices,
            });
        }
        if bad == 0 && piece.triangles.is_empty() && !mesh.triangles.is_empty() {
            warnings.push(Warning::NoArea {
                entity: instance.entity.clone(),
            });
        }
        pieces.push(piece);
    }
    // Stable: pieces of equal content are interchangeable.
    pieces.sort_by_key(|piece| piece.hash);
    let mesh = join(pieces, collected, &surfaces, textures);
    if mesh.is_empty() {
        return Err(GiBakeError::Empty {
            root: collected.root.clone(),
            warnings: [&collected.warnings[..], warnings].concat(),
        });
    }
    warnings.extend(range_warnings(mesh.problems(), &collected.root));
    Ok(mesh)
}

/// The textures of all materials, by image and encoding.
struct Textures(HashMap<(usize, Encoding), HashedTexture>);

impl Textures {
    fn read(collected: &Collected) -> Self {
        let mut all = HashMap::default();
        for surface in &collected.materials {
            for (used, encoding) in surface.textures.iter().zip(ENCODINGS) {
                let Some(used) = used else {
                    continue;
                };
                let key = (used.image, encoding);
                if all.contains_key(&key) {
                    continue;
                }
                if let Some(texture) = texture(&collected.images[used.image], encoding) {
                    let mut hasher = blake3::Hasher::new();
                    texture.add_to_hash(&mut hasher);
                    let hash = *hasher.finalize().as_bytes();
                    all.insert(key, HashedTexture { texture, hash });
                }
            }
        }
        Self(all)
    }

    /// The textures of a material.
    fn textures_of(&self, surface: &SurfaceMaterial) -> [Option<&HashedTexture>; 3] {
        std::array::from_fn(|k| self.0.get(&(surface.textures[k]?.image, ENCODINGS[k])))
    }
}

/// Hash of a material with its textures and its name. Materials with equal hashes are the same.
fn surface_hash(surface: &SurfaceMaterial, textures: &Textures) -> [u8; 32] {
    let mut hasher = blake3::Hasher::new();
    surface.material.add_to_hash(&mut hasher);
    for texture in textures.textures_of(surface) {
        hasher.update(&texture.map_or([0; 32], |t| t.hash));
    }
    hasher.update(surface.material.name.as_bytes());
    *hasher.finalize().as_bytes()
}

/// Returns the triangles of an instance, and the number of triangles that are not finite or too far
/// away.
fn piece(
    instance: &Instance,
    mesh: &MeshData,
    surface: &SurfaceMaterial,
    surface_hash: &[u8; 32],
) -> (Piece, u64) {
    let to_root = |p: &Vec3| instance.to_root.transform_point3(p.as_dvec3()).as_vec3();
    let in_root: Vec<Vec3> = mesh.positions.iter().map(to_root).collect();
    let mirrored = instance.to_root.determinant() < 0.0;
    let is_textured = surface.textures.iter().any(Option::is_some);
    let mut out = Piece {
        triangles: Vec::with_capacity(mesh.triangles.len()),
        uvs: Vec::new(),
        tints: Vec::new(),
        material: instance.material,
        node: instance.node,
        hash: [0; 32],
    };
    let mut bad = 0;
    for &(mut corners) in &mesh.triangles {
        if mirrored {
            // The front stays the front.
            corners.swap(1, 2);
        }
        let triangle = corners.map(|v| in_root[v as usize]);
        if !TriangleMesh::is_valid_triangle(&triangle) {
            // Triangles without area are common in good meshes.
            bad += u64::from(!is_usable(&triangle));
            continue;
        }
        out.triangles.push(triangle);
        if is_textured {
            out.uvs.push(coordinates(corners, mesh, surface));
        }
        if !mesh.colors.is_empty() {
            out.tints.push(tint(corners, mesh));
        }
    }
    let mut hasher = blake3::Hasher::new();
    hasher.update(surface_hash);
    hasher.update(&(out.triangles.len() as u64).to_le_bytes());
    for (i, triangle) in out.triangles.iter().enumerate() {
        hasher.update(bytemuck::cast_slice(triangle));
        if let Some(uvs) = out.uvs.get(i) {
            for corners in [uvs.base_color, uvs.metallic, uvs.emissive] {
                hasher.update(bytemuck::cast_slice(&corners));
            }
        }
        hasher.update(out.tints.get(i).unwrap_or(&WHITE));
    }
    out.hash = *hasher.finalize().as_bytes();
    (out, bad)
}

/// Returns `true` if coordinates are finite and within range. The area of the triangle may still be
/// 0.
fn is_usable(triangle: &[Vec3; 3]) -> bool {
    let [a, ..] = *triangle;
    // A triangle with an area, at each corner.
    let near = |p: Vec3| {
        let step = 1e-3 * p.abs().max_element().max(1.0);
        TriangleMesh::is_valid_triangle(&[p, p + step * Vec3::X, p + step * Vec3::Y])
    };
    a.is_finite() && triangle.iter().all(|p| near(*p))
}

fn coordinates(corners: [u32; 3], mesh: &MeshData, surface: &SurfaceMaterial) -> TriangleUvs {
    let of = |k: usize| {
        let Some(texture) = surface.textures[k] else {
            return [Vec2::ZERO; 3];
        };
        let uvs = &mesh.uvs[texture.channel];
        corners.map(|v| {
            let uv = uvs.get(v as usize).copied().unwrap_or_default();
            surface.uv_transform.transform_point2(uv)
        })
    };
    TriangleUvs {
        base_color: of(0),
        metallic: of(1),
        emissive: of(2),
    }
}

/// The mean vertex color of a triangle.
fn tint(corners: [u32; 3], mesh: &MeshData) -> Tint {
    let color = |v: u32| Vec4::from_array(*mesh.colors.get(v as usize).unwrap_or(&[1.0; 4]));
    let mean: Vec4 = corners.map(color).iter().sum::<Vec4>() / 3.0;
    let channel = |v: f32| (COLOR_STEPS * v.clamp(0.0, 1.0) + 0.5) as u8;
    let [r, g, b, a] = mean.to_array();
    [r.sqrt(), g.sqrt(), b.sqrt(), a].map(channel)
}

/// The linear color of a tint.
fn tint_color(tint: Tint) -> Vec4 {
    let [r, g, b, a] = tint.map(|v| f32::from(v) / COLOR_STEPS);
    Vec4::new(r * r, g * g, b * b, a)
}

/// Appends all pieces, with the materials and textures that they use in the order of their use.
fn join(
    pieces: Vec<Piece>,
    collected: &Collected,
    surfaces: &[[u8; 32]],
    textures: Textures,
) -> TriangleMesh {
    let is_textured = (collected.materials.iter())
        .any(|surface| textures.textures_of(surface).iter().any(Option::is_some));
    let (mut triangles, mut material_of, mut uvs) = (Vec::new(), Vec::new(), Vec::new());
    let mut node_of = Vec::new();
    let mut materials: Vec<Material> = Vec::new();
    let mut kept: Vec<Texture> = Vec::new();
    let mut texture_index: HashMap<[u8; 32], u32> = HashMap::default();
    let mut material_index: HashMap<([u8; 32], Tint), u32> = HashMap::default();
    for piece in &pieces {
        let surface = &collected.materials[piece.material];
        for (i, triangle) in piece.triangles.iter().enumerate() {
            let tint = piece.tints.get(i).copied().unwrap_or(WHITE);
            let key = (surfaces[piece.material], tint);
            let material = *material_index.entry(key).or_insert_with(|| {
                let slots = textures.textures_of(surface).map(|hashed| {
                    let hashed = hashed?;
                    Some(*texture_index.entry(hashed.hash).or_insert_with(|| {
                        kept.push(hashed.texture.clone());
                        kept.len() as u32 - 1
                    }))
                });
                materials.push(Material {
                    base_color: surface.material.base_color * tint_color(tint),
                    base_color_texture: slots[0],
                    metallic_texture: slots[1],
                    emissive_texture: slots[2],
                    ..surface.material.clone()
                });
                materials.len() as u32 - 1
            });
            triangles.push(*triangle);
            material_of.push(material);
            node_of.push(piece.node);
            if is_textured {
                uvs.push(piece.uvs.get(i).copied().unwrap_or_default());
            }
        }
    }
    let mut mesh = TriangleMesh::textured(triangles, material_of, materials, uvs, kept);
    mesh.set_nodes(collected.nodes.clone(), node_of);
    mesh
}

fn range_warnings(problems: &MeshProblems, root: &str) -> Vec<Warning> {
    let warning = |count: u64, problem| Warning::MaterialRange {
        root: root.into(),
        count,
        problem,
    };
    [
        (
            problems.albedo_clamped,
            "base color or metallic outside of [0, 1], clamped",
        ),
        (
            problems.bad_emission,
            "emissive not finite, negative or above 1e18; set to 0 or clamped",
        ),
    ]
    .into_iter()
    .filter(|(count, _)| *count > 0)
    .map(|(count, problem)| warning(count, problem))
    .collect()
}
