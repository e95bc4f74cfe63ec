//! Reading `.glb` and `.gltf` scenes (glTF 2.0): triangles of the default scene in world space,
//! materials and lights.
//!
//! The gltf crate parses the JSON. Every index, offset and length is validated here, because the
//! readers of that crate do not validate them. Supported content and its conversion:
//!
//! | glTF | here |
//! |---|---|
//! | nodes, instances, mirrored scales | triangles in meters, winding reversed with the mirror |
//! | triangles, strips, fans, with and without indices | triangles |
//! | points, lines | left out and noted |
//! | base color and metallic factor, texture | [`Material`]; metal has no diffuse reflection |
//! | emissive factor, texture, strength | [`Material`] |
//! | KHR_materials_pbrSpecularGlossiness | diffuse part, less the specular factor |
//! | alphaMode MASK; BLEND | cut out below the cutoff; below 0.5 |
//! | KHR_texture_transform, KHR_mesh_quantization | applied |
//! | KHR_lights_punctual | [`Light`], candela as W/sr and lux as W/m² without conversion |
//! | skins, morph targets | the pose that the vertices are stored in, noted |
//! | cameras, animations, normals, vertex colors | not read |
//!
//! Photometric units of lights are not converted, because a bake depends only on ratios of light.

mod accessor;
mod claims;
mod container;
mod document;
mod external_files;
mod material;

use super::occluder::MeshNode;
use super::{InputBudget, Light, LoadedScene, Material, SceneError, TriangleMesh, TriangleUvs};
use ::gltf::json::extensions::scene::khr_lights_punctual as punctual;
use ::gltf::json::mesh::{Mode, Primitive, Semantic};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Root, scene};
use accessor::Buffers;
use document::{assemble, first_nodes, load_buffers, local_transform, used_textures};
pub use external_files::external_files;
use glam::{DMat4, DQuat, DVec3, Vec2, Vec3};
use material::PlacedMaterial;
use std::borrow::Cow;
use std::path::Path;

/// Largest number of triangles.
const MAX_TRIANGLES: u64 = 1 << 25;
/// Largest number of texels.
const MAX_TEXELS: u64 = 1 << 29;
/// Largest number of JSON objects. A parsed node takes up to a hundred times the bytes of its text.
const MAX_OBJECTS: u64 = 1 << 22;
/// Largest depth of nested nodes.
const MAX_NODE_DEPTH: usize = 256;
/// Extensions that a file may list as required. They are supported here or do not affect diffuse
/// light.
const SUPPORTED_EXTENSIONS: [&str; 4] = [
    "KHR_lights_punctual",
    "KHR_texture_transform",
    "KHR_mesh_quantization",
    "KHR_xmp_json_ld",
];

/// Callback that returns the bytes of a referenced file. Its argument is the name relative to the
/// scene.
pub type Resolver<'a> = dyn FnMut(&str) -> Result<Vec<u8>, SceneError> + 'a;

/// Reads a scene. Returns [`SceneError::Io`] if a file cannot be read. All other errors are about
/// the content of the files.
pub fn load_gltf(path: impl AsRef<Path>) -> Result<LoadedScene, SceneError> {
    load_gltf_within(path, &mut InputBudget::default())
}

/// Reads a scene like [`load_gltf`]. The file and the files that it references are together within
/// `budget`.
///
/// # Errors
/// Those of [`load_gltf`].
pub fn load_gltf_within(
    path: impl AsRef<Path>,
    budget: &mut InputBudget,
) -> Result<LoadedScene, SceneError> {
    let path = path.as_ref();
    let mut read = |path: &Path| {
        let bytes = budget.read(path);
        bytes.map_err(|error| SceneError::reading(path, error))
    };
    let bytes = read(path)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    load_gltf_bytes(&bytes, &path.display().to_string(), &mut |name| {
        read(&folder.join(name))
    })
}

/// Reads a scene from bytes. `file` is the file name in errors. `resolve` returns the bytes of the
/// files that the scene references.
pub fn load_gltf_bytes(
    bytes: &[u8],
    file: &str,
    resolve: &mut Resolver<'_>,
) -> Result<LoadedScene, SceneError> {
    let format = |reason: String| SceneError::Format {
        file: file.into(),
        reason,
    };
    let (json, binary) = container::split(bytes).map_err(format)?;
    let too_large = |what, count, limit| SceneError::TooLarge {
        file: file.into(),
        what,
        count,
        limit,
    };
    let objects = claims::objects(json);
    if objects > MAX_OBJECTS {
        return Err(too_large("JSON objects", objects, MAX_OBJECTS));
    }
    let root: Root =
        ::gltf::json::deserialize::from_slice(json).map_err(|e| format(e.to_string()))?;
    if !root.asset.version.starts_with("2.") {
        return Err(format(format!(
            "glTF version {}, only 2 can be read",
            root.asset.version
        )));
    }
    let readable = |name: &String| {
        SUPPORTED_EXTENSIONS.contains(&name.as_str()) || name.starts_with("KHR_materials_")
    };
    if let Some(name) = root.extensions_required.iter().find(|name| !readable(name)) {
        return Err(format(format!(
            "it can't be read without {name}, which is not supported"
        )));
    }
    let buffers = Buffers {
        bytes: load_buffers(&root, binary, file, resolve)?,
        root: &root,
    };
    let first = first_nodes(&root).map_err(format)?;
    let triangles = claims::triangles(&buffers, &first);
    if triangles > MAX_TRIANGLES {
        return Err(too_large("triangles", triangles, MAX_TRIANGLES));
    }
    let mut builder = Builder::new(file, &buffers, resolve)?;
    for node in first {
        builder.node(node, DMat4::IDENTITY, None, 0)?;
    }
    builder.finish()
}

/// Collector of triangles and lights during the node traversal.
struct Builder<'a> {
    file: &'a str,
    buffers: &'a Buffers<'a>,
    visited: Vec<bool>,
    triangles: Vec<[Vec3; 3]>,
    material_of: Vec<u32>,
    uvs: Vec<TriangleUvs>,
    nodes: Vec<MeshNode>,
    /// Node of each triangle that the mesh keeps.
    node_of: Vec<u32>,
    materials: Vec<PlacedMaterial>,
    textures: Vec<super::Texture>,
    lights: Vec<Light>,
    light_names: Vec<String>,
    bad_indices: u64,
    notes: Vec<String>,
}

impl<'a> Builder<'a> {
    fn new(
        file: &'a str,
        buffers: &'a Buffers<'a>,
        resolve: &mut Resolver<'_>,
    ) -> Result<Self, SceneError> {
        let root = buffers.root;
        let mut materials = Vec::with_capacity(root.materials.len() + 1);
        for (i, m) in root.materials.iter().enumerate() {
            let placed = material::material(m, root.textures.len()).map_err(|reason| {
                SceneError::Format {
                    file: file.into(),
                    reason: format!("material {i}: {reason}"),
                }
            })?;
            materials.push(placed);
        }
        materials.push(material::plain());
        let textures = used_textures(file, buffers, &mut materials, resolve)?;
        Ok(Self {
            file,
            buffers,
            visited: vec![false; root.nodes.len()],
            triangles: Vec::new(),
            material_of: Vec::new(),
            uvs: Vec::new(),
            nodes: Vec::new(),
            node_of: Vec::new(),
            materials,
            textures,
            lights: Vec::new(),
            light_names: Vec::new(),
            bad_indices: 0,
            notes: Vec::new(),
        })
    }

    fn note(&mut self, text: String) {
        if !self.notes.contains(&text) && self.notes.len() < 100 {
            self.notes.push(text);
        }
    }

    fn wrong(&self, reason: String) -> SceneError {
        SceneError::Format {
            file: self.file.into(),
            reason,
        }
    }

    fn node(
        &mut self,
        index: usize,
        parent: DMat4,
        above: Option<u32>,
        depth: usize,
    ) -> Result<(), SceneError> {
        let root = self.buffers.root;
        let Some(node) = root.nodes.get(index) else {
            return Err(self.wrong(format!("node {index} is not there")));
        };
        if depth > MAX_NODE_DEPTH {
            return Err(self.wrong(format!("nodes are nested more than {MAX_NODE_DEPTH} deep")));
        }
        if std::mem::replace(&mut self.visited[index], true) {
            return Err(self.wrong(format!("node {index} has more than one parent")));
        }
        let transform = parent * local_transform(node);
        let own = self.nodes.len() as u32;
        self.nodes.push(MeshNode {
            name: node.name.clone().unwrap_or_default(),
            parent: above,
        });
        if let Some(mesh) = node.mesh {
            if node.skin.is_some() {
                self.note("skinned meshes use the pose of the stored vertices".into());
            }
            let first = self.triangles.len();
            self.mesh(mesh.value(), &transform)?;
            let kept = self.triangles[first..]
                .iter()
                .filter(|t| TriangleMesh::is_valid_triangle(t))
                .count();
            self.node_of.extend(std::iter::repeat_n(own, kept));
        }
        if let Some(light) = node
            .extensions
            .as_ref()
            .and_then(|e| e.khr_lights_punctual.as_ref())
        {
            self.light(light.light.value(), &transform, node.name.as_deref())?;
        }
        for child in node.children.iter().flatten() {
            self.node(child.value(), transform, Some(own), depth + 1)?;
        }
        Ok(())
    }

    fn mesh(&mut self, index: usize, transform: &DMat4) -> Result<(), SceneError> {
        let root = self.buffers.root;
        let Some(mesh) = root.meshes.get(index) else {
            return Err(self.wrong(format!("mesh {index} is not there")));
        };
        for (p, primitive) in mesh.primitives.iter().enumerate() {
            self.primitive(primitive, transform)
                .map_err(|reason| SceneError::Mesh {
                    file: self.file.into(),
                    mesh: mesh
                        .name
                        .as_ref()
                        .map_or(index.to_string(), |n| format!("{index} ({n})")),
                    primitive: p,
                    reason,
                })?;
        }
        Ok(())
    }

    fn primitive(&mut self, primitive: &Primitive, transform: &DMat4) -> Result<(), String> {
        let Checked::Valid(mode) = primitive.mode else {
            return Err("its mode is not known".into());
        };
        if !matches!(
            mode,
            Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan
        ) {
            self.note("points and lines are left out".into());
            return Ok(());
        }
        if primitive.targets.as_ref().is_some_and(|t| !t.is_empty()) {
            self.note("morphed meshes use the pose of the stored vertices".into());
        }
        let material = match primitive.material {
            None => self.materials.len() - 1,
            Some(m) if m.value() < self.materials.len() - 1 => m.value(),
            Some(m) => {
                return Err(format!("material {} is not there", m.value()));
            }
        };
        let positions = primitive
            .attributes
            .get(&Checked::Valid(Semantic::Positions))
            .ok_or("it has no positions")?;
        let positions = self.buffers.vectors::<3>(*positions)?;
        let order = match primitive.indices {
            Some(index) => self.buffers.indices(index)?,
            None => (0..positions.len() as u32).collect(),
        };
        let corners = assemble(mode, &order);
        let world: Vec<Vec3> = positions
            .iter()
            .map(|p| {
                transform
                    .transform_point3(Vec3::from_array(*p).as_dvec3())
                    .as_vec3()
            })
            .collect();
        let uvs = self.coordinates(primitive, material)?;
        // A mirroring transform reverses the winding, so that the front side is unchanged.
        let mirrored = transform.determinant() < 0.0;
        for mut corner in corners {
            if mirrored {
                corner.swap(1, 2);
            }
            let [Some(&a), Some(&b), Some(&c)] = corner.map(|v| world.get(v as usize)) else {
                self.bad_indices += 1;
                continue;
            };
            self.triangles.push([a, b, c]);
            self.material_of.push(material as u32);
            if !self.textures.is_empty() {
                let at =
                    |set: &[Vec2]| corner.map(|v| set.get(v as usize).copied().unwrap_or_default());
                self.uvs.push(TriangleUvs {
                    base_color: at(&uvs[0]),
                    metallic: at(&uvs[1]),
                    emissive: at(&uvs[2]),
                });
            }
        }
        Ok(())
    }

    /// Returns the transformed texture coordinates for each texture of a material.
    fn coordinates(
        &mut self,
        primitive: &Primitive,
        material: usize,
    ) -> Result<[Vec<Vec2>; 3], String> {
        let mut out = [const { Vec::new() }; 3];
        for (k, placement) in self.materials[material].placements.into_iter().enumerate() {
            let Some(set) = placement.set else {
                continue;
            };
            match primitive
                .attributes
                .get(&Checked::Valid(Semantic::TexCoords(set)))
            {
                Some(&accessor) => {
                    let read = self.buffers.vectors::<2>(accessor)?;
                    out[k] = read
                        .into_iter()
                        .map(|uv| placement.apply(Vec2::from_array(uv)))
                        .collect();
                }
                None => self.note(format!(
                    "a textured mesh has no texture coordinates {set}: 0 is used"
                )),
            }
        }
        Ok(out)
    }

    fn light(
        &mut self,
        index: usize,
        transform: &DMat4,
        node_name: Option<&str>,
    ) -> Result<(), SceneError> {
        let extension = self.buffers.root.extensions.as_ref();
        let lights = extension.and_then(|e| e.khr_lights_punctual.as_ref());
        let Some(light) = lights.and_then(|l| l.lights.get(index)) else {
            return Err(self.wrong(format!("light {index} is not there")));
        };
        let Checked::Valid(kind) = light.type_ else {
            return Err(self.wrong(format!("light {index} has an unknown type")));
        };
        let strength = Vec3::from_array(light.color) * light.intensity;
        let position = transform.w_axis.truncate().as_vec3();
        let direction = transform
            .transform_vector3(DVec3::NEG_Z)
            .normalize_or_zero()
            .as_vec3();
        if !(strength.is_finite()
            && strength.min_element() >= 0.0
            && position.is_finite()
            && direction != Vec3::ZERO)
        {
            return Err(self.wrong(format!(
                "light {index}: its strength or its position is not finite or out of range"
            )));
        }
        let range = light.range.filter(|r| *r > 0.0).unwrap_or(f32::INFINITY);
        self.lights.push(match kind {
            punctual::Type::Directional => Light::Directional {
                direction,
                irradiance: strength,
            },
            punctual::Type::Point => Light::Point {
                position,
                intensity: strength,
                range,
            },
            punctual::Type::Spot => {
                let (inner, outer) = light
                    .spot
                    .as_ref()
                    .map_or((0.0, core::f32::consts::FRAC_PI_4), |s| {
                        (s.inner_cone_angle, s.outer_cone_angle)
                    });
                if !(inner >= 0.0 && inner <= outer && outer <= core::f32::consts::PI) {
                    return Err(
                        self.wrong(format!("light {index}: a cone from {inner} to {outer} rad"))
                    );
                }
                Light::Spot {
                    position,
                    direction,
                    intensity: strength,
                    inner,
                    outer,
                    range,
                }
            }
        });
        let name = node_name.or(light.name.as_deref()).unwrap_or_default();
        self.light_names.push(name.to_owned());
        Ok(())
    }

    fn finish(self) -> Result<LoadedScene, SceneError> {
        let materials: Vec<Material> = self.materials.into_iter().map(|m| m.material).collect();
        let mut mesh = TriangleMesh::textured(
            self.triangles,
            self.material_of,
            materials,
            self.uvs,
            self.textures,
        );
        mesh.add_bad_indices(self.bad_indices);
        mesh.set_nodes(self.nodes, self.node_of);
        let problems = *mesh.problems();
        if mesh.is_empty() {
            return Err(SceneError::Empty {
                file: self.file.into(),
                dropped: problems.dropped(),
            });
        }
        Ok(LoadedScene {
            mesh,
            points: 0,
            lights: self.lights,
            light_names: self.light_names,
            problems,
            notes: self.notes,
        })
    }
}

#[cfg(test)]
mod tests;
