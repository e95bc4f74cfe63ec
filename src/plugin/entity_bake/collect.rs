//! Copies meshes, materials and images out of the world, for the bake's thread.

use super::super::bake_task::NamedMaterials;
use super::label;
use super::material::{
    SurfaceMaterial, SurfaceTexture, TEXTURES, channels_of, factors, images_of, is_double_sided,
    neutral,
};
use super::mesh_data::{MeshData, MeshProblem};
use super::reflection::{gltf_material_name, has_custom_material};
use super::texture::unreadable;
use super::wait::{State, asset_state, scene_state};
use super::walk::{StaticMesh, Walk};
use super::warning::GiBakeWarning as Warning;
use crate::plugin::effects::materials::dynamic_materials::GiDynamicMaterials;
use bevy::asset::{Asset, AssetId, AssetServer, Assets, Handle};
use bevy::ecs::prelude::*;
use bevy::image::Image;
use bevy::math::DMat4;
use bevy::mesh::Mesh;
use bevy::pbr::{MeshMaterial3d, StandardMaterial};
use bevy::platform::collections::{HashMap, HashSet};
use meshless_gi::internals::scene::MeshNode;

/// Copies of everything that a bake of a root reads.
pub(super) struct Collected {
    /// The root: entity and name.
    pub(super) root: String,
    pub(super) meshes: Vec<MeshData>,
    pub(super) materials: Vec<SurfaceMaterial>,
    pub(super) images: Vec<Image>,
    pub(super) instances: Vec<Instance>,
    pub(super) nodes: Vec<MeshNode>,
    /// Names of materials and their assets. Empty if names are not requested.
    pub(super) named: NamedMaterials,
    pub(super) warnings: Vec<Warning>,
}

/// A mesh with a transform.
pub(super) struct Instance {
    /// Entity and name.
    pub(super) entity: String,
    /// Index into [`Collected::meshes`].
    pub(super) mesh: usize,
    /// Index into [`Collected::materials`].
    pub(super) material: usize,
    /// Transform from the mesh's space to that of the root.
    pub(super) to_root: DMat4,
    /// Index into [`Collected::nodes`].
    pub(super) node: u32,
}

/// Copies the scene that `walk` found. `with_names` gives the materials names.
pub(super) fn collect(world: &World, walk: Walk, with_names: bool) -> Collected {
    let given = world.get::<GiDynamicMaterials>(walk.root);
    let mut collector = Collector {
        world,
        with_names,
        given: given.map_or(&[], |given| &given.0),
        meshes: HashMap::default(),
        materials: HashMap::default(),
        images: HashMap::default(),
        names: HashSet::default(),
        out: Collected {
            root: label(world, walk.root),
            meshes: Vec::new(),
            materials: Vec::new(),
            images: Vec::new(),
            instances: Vec::new(),
            nodes: walk.nodes,
            named: Vec::new(),
            warnings: Vec::new(),
        },
    };
    for &entity in &walk.scenes {
        if let State::Missing(reason) = scene_state(world, entity) {
            let entity = label(world, entity);
            collector.warn(Warning::SceneMissing { entity, reason });
        }
    }
    #[cfg(feature = "point_clouds")]
    for &entity in &walk.point_clouds {
        let entity = label(world, entity);
        collector.warn(Warning::PointCloud { entity });
    }
    for found in &walk.meshes {
        collector.instance(found);
    }
    collector.out
}

struct Collector<'w> {
    world: &'w World,
    with_names: bool,
    /// Names that the app has set on the root.
    given: &'w [(String, Handle<StandardMaterial>)],
    /// `None` for meshes that can't be read.
    meshes: HashMap<AssetId<Mesh>, Option<usize>>,
    /// Materials by asset and sides. Without an asset the key has the neutral material.
    materials: HashMap<(Option<AssetId<StandardMaterial>>, bool), usize>,
    /// `None` for images that can't be read.
    images: HashMap<AssetId<Image>, Option<usize>>,
    /// Names of materials that are in use.
    names: HashSet<String>,
    out: Collected,
}

impl Collector<'_> {
    fn warn(&mut self, warning: Warning) {
        self.out.warnings.push(warning);
    }

    fn instance(&mut self, found: &StaticMesh) {
        let mirrored = found.to_root.determinant() < 0.0;
        let own = self
            .world
            .get::<MeshMaterial3d<StandardMaterial>>(found.entity);
        if own.is_none() && !has_custom_material(self.world, found.entity) {
            return;
        }
        let Some(mesh) = self.mesh(found) else {
            return;
        };
        let material = match own {
            Some(handle) => self.material(&handle.0, found.entity, mirrored),
            None => {
                let entity = label(self.world, found.entity);
                self.warn(Warning::CustomMaterial { entity });
                self.neutral()
            }
        };
        let surface = &self.out.materials[material];
        let used = surface.textures.iter().flatten();
        let uvs = &self.out.meshes[mesh].uvs;
        if used.clone().any(|texture| uvs[texture.channel].is_empty()) {
            self.warn(Warning::NoTextureCoordinates {
                entity: label(self.world, found.entity),
                mesh: asset_name(self.world, found.mesh.id()),
            });
        }
        self.out.instances.push(Instance {
            entity: label(self.world, found.entity),
            mesh,
            material,
            to_root: found.to_root,
            node: found.node,
        });
    }

    fn mesh(&mut self, found: &StaticMesh) -> Option<usize> {
        let id = found.mesh.id();
        if let Some(known) = self.meshes.get(&id) {
            return *known;
        }
        let all = self.world.get_resource::<Assets<Mesh>>();
        let read = match all.and_then(|all| all.get(id)) {
            Some(mesh) => MeshData::read(mesh),
            None => Err(MeshProblem::Unreadable(missing(self.world, id))),
        };
        let index = match read {
            Ok(mesh) => {
                self.out.meshes.push(mesh);
                Some(self.out.meshes.len() - 1)
            }
            Err(problem) => {
                let entity = label(self.world, found.entity);
                let mesh = asset_name(self.world, id);
                self.warn(match problem {
                    MeshProblem::InRenderWorld => Warning::MeshInRenderWorld { entity, mesh },
                    MeshProblem::NoTriangles(topology) => Warning::NoTriangles {
                        entity,
                        mesh,
                        topology,
                    },
                    MeshProblem::Unreadable(reason) => Warning::MeshUnreadable {
                        entity,
                        mesh,
                        reason,
                    },
                });
                None
            }
        };
        self.meshes.insert(id, index);
        index
    }

    fn neutral(&mut self) -> usize {
        let materials = &mut self.out.materials;
        *self.materials.entry((None, true)).or_insert_with(|| {
            materials.push(neutral());
            materials.len() - 1
        })
    }

    fn material(
        &mut self,
        handle: &Handle<StandardMaterial>,
        entity: Entity,
        mirrored: bool,
    ) -> usize {
        let all = self.world.get_resource::<Assets<StandardMaterial>>();
        let Some(material) = all.and_then(|all| all.get(handle.id())) else {
            let missing = Warning::MaterialMissing {
                entity: label(self.world, entity),
                material: asset_name(self.world, handle.id()),
            };
            self.warn(missing);
            return self.neutral();
        };
        let double_sided = is_double_sided(material, mirrored);
        if let Some(&known) = self.materials.get(&(Some(handle.id()), double_sided)) {
            return known;
        }
        let channels = channels_of(material);
        let mut textures = [None; 3];
        for (k, image) in images_of(material).into_iter().enumerate() {
            textures[k] = image
                .and_then(|image| self.image(image.id(), entity, handle.id(), TEXTURES[k]))
                .map(|image| SurfaceTexture {
                    image,
                    channel: channels[k],
                });
        }
        let mut own = factors(material, double_sided);
        if self.with_names {
            own.name = self.name(handle, entity, double_sided);
        }
        self.out.materials.push(SurfaceMaterial {
            material: own,
            textures,
            uv_transform: material.uv_transform,
        });
        let index = self.out.materials.len() - 1;
        self.materials
            .insert((Some(handle.id()), double_sided), index);
        index
    }

    /// A name that no other material has. The two variants of an asset, one-sided and double-sided,
    /// share theirs.
    fn name(
        &mut self,
        handle: &Handle<StandardMaterial>,
        entity: Entity,
        double_sided: bool,
    ) -> String {
        let variant = self.materials.get(&(Some(handle.id()), !double_sided));
        if let Some(&variant) = variant {
            return self.out.materials[variant].material.name.clone();
        }
        let given = self.given.iter().find(|(_, asset)| asset == handle);
        let first = (given.map(|(name, _)| name.clone()))
            .or_else(|| gltf_material_name(self.world, entity))
            .or_else(|| path(self.world, handle.id()));
        let base = first.unwrap_or_else(|| format!("material {}", self.out.named.len()));
        let mut name = base.clone();
        let mut count = 1;
        while !self.names.insert(name.clone()) {
            count += 1;
            name = format!("{base} {count}");
        }
        self.out.named.push((name.clone(), handle.clone()));
        name
    }

    fn image(
        &mut self,
        id: AssetId<Image>,
        entity: Entity,
        material: AssetId<StandardMaterial>,
        texture: &'static str,
    ) -> Option<usize> {
        if let Some(Some(known)) = self.images.get(&id) {
            return Some(*known);
        }
        let all = self.world.get_resource::<Assets<Image>>();
        let problem = match all.and_then(|all| all.get(id)) {
            None => missing(self.world, id),
            Some(image) => match unreadable(image) {
                Some(problem) => problem,
                None => {
                    self.out.images.push(image.clone());
                    let index = self.out.images.len() - 1;
                    self.images.insert(id, Some(index));
                    return Some(index);
                }
            },
        };
        self.images.insert(id, None);
        self.warn(Warning::ImageUnreadable {
            entity: label(self.world, entity),
            material: asset_name(self.world, material),
            texture,
            image: asset_name(self.world, id),
            reason: problem,
        });
        None
    }
}

/// Reason why an asset is not there.
fn missing<A: Asset>(world: &World, id: AssetId<A>) -> String {
    match asset_state(world, id) {
        State::Missing(reason) => reason,
        State::Ready | State::Pending => "it is not loaded".into(),
    }
}

fn path<A: Asset>(world: &World, id: AssetId<A>) -> Option<String> {
    let server = world.get_resource::<AssetServer>()?;
    server.get_path(id).map(|path| path.to_string())
}

/// The path of an asset, or its identifier.
fn asset_name<A: Asset>(world: &World, id: AssetId<A>) -> String {
    match path(world, id) {
        Some(path) => format!("`{path}`"),
        None => match id {
            AssetId::Index { index, .. } => {
                let bits = index.to_bits();
                format!("{}v{}", bits & u64::from(u32::MAX), bits >> 32)
            }
            AssetId::Uuid { uuid } => uuid.to_string(),
        },
    }
}
