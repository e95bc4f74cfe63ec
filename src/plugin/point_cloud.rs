//! Point clouds in a game: an asset for `.ply` files, and the component that draws one.
//!
//! A cloud is drawn as the surface that rays hit in the bake: the flat cell of each point
//! ([`PointCloud::outline`]). Cells have the point's own color and normals that change smoothly
//! from cell to cell ([`PointCloud::corner_normals`]). The result is an ordinary deferred mesh.
//! Bevy's lights and shadow maps, a bake's indirect light and the bounce from dynamic objects
//! affect it as any other mesh.
//!
//! Each cell has a face on either side, and the back face lies a little behind the front face. At
//! the edge of a bent surface, the backs of cells that stick out are visible. They would be dark if
//! no light reached them.

use super::GiSystems;
use bevy::app::{App, Update};
use bevy::asset::RenderAssetUsages;
use bevy::asset::io::Reader;
use bevy::asset::{Asset, AssetApp, AssetEvent, AssetId, AssetLoader, Assets, Handle, LoadContext};
use bevy::camera::visibility::{RenderLayers, Visibility};
use bevy::color::Color;
use bevy::ecs::prelude::*;
use bevy::light::{NotShadowCaster, NotShadowReceiver};
use bevy::log::{debug, warn};
use bevy::math::Vec3;
use bevy::mesh::{Indices, Mesh, Mesh3d, PrimitiveTopology};
use bevy::pbr::{MeshMaterial3d, StandardMaterial};
use bevy::reflect::prelude::*;
use bevy::transform::components::Transform;
use meshless_gi::internals::scene::{LoadedPoints, load_ply_bytes};
use meshless_gi::{PointCloud, SceneError};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Point cloud, and its meshes and material. Load it with
/// `asset_server.load::<GiPointCloudAsset>("statue.ply")`.
#[derive(Asset, Reflect, Clone, Debug)]
#[reflect(opaque)]
#[reflect(Clone, Debug)]
pub struct GiPointCloudAsset {
    /// The points, in the cloud's own space: meters, linear albedo.
    pub cloud: Arc<PointCloud>,
    /// Meshes of the cells, in the points' colors. Each has at most 100,000 points, because devices
    /// limit the size of a mesh. Labeled assets `Mesh0`, `Mesh1`, …
    #[dependency]
    pub meshes: Vec<Handle<Mesh>>,
    /// White, rough material. Labeled asset `Material`.
    #[dependency]
    pub material: Handle<StandardMaterial>,
}

/// Draws a point cloud. Inserts a [`Mesh3d`] and a [`MeshMaterial3d`] when the cloud has loaded,
/// and replaces them when the handle or the cloud changes. An existing material stays.
#[derive(Component, Reflect, Clone, Debug, Default, PartialEq, Eq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
#[require(Transform, Visibility)]
pub struct GiPointCloud(pub Handle<GiPointCloudAsset>);

/// Loads `.ply` files as [`GiPointCloudAsset`].
#[derive(Clone, Copy, Debug, Default, TypePath)]
pub struct GiPointCloudLoader;

/// Settings of [`GiPointCloudLoader`], for `.meta` files.
#[derive(Reflect, Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[reflect(Default, Clone, Debug, PartialEq)]
#[serde(default)]
pub struct GiPointCloudLoaderSettings {
    /// Positions in empty space, meters. In a file without normals, a closed surface around one of
    /// them faces it. All other surfaces face outwards.
    pub viewpoints: Vec<[f32; 3]>,
}

/// Reason that a `.ply` file cannot be loaded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GiPointCloudLoadError {
    /// The file could not be read.
    #[error("the points could not be read: {0}")]
    Io(#[from] std::io::Error),
    /// The file's content is not valid, or its points do not form a surface.
    #[error(transparent)]
    Scene(#[from] SceneError),
}

impl AssetLoader for GiPointCloudLoader {
    type Asset = GiPointCloudAsset;
    type Settings = GiPointCloudLoaderSettings;
    type Error = GiPointCloudLoadError;

    async fn load(
        &self,
        reader: &mut dyn Reader,
        settings: &Self::Settings,
        context: &mut LoadContext<'_>,
    ) -> Result<GiPointCloudAsset, GiPointCloudLoadError> {
        let mut bytes = Vec::new();
        reader.read_to_end(&mut bytes).await?;
        let name = context.path().to_string();
        let viewpoints: Vec<Vec3> = settings.viewpoints.iter().map(|&v| v.into()).collect();
        let LoadedPoints { cloud, notes } = load_ply_bytes(&bytes, &name, &viewpoints)?;
        drop(bytes);
        debug!("`{name}`: {} points", cloud.len());
        for note in notes {
            warn!("`{name}`: {note}");
        }
        let meshes = (cells(&cloud).into_iter().enumerate())
            .map(|(k, mesh)| context.add_labeled_asset(format!("Mesh{k}"), mesh))
            .collect();
        let material = context.add_labeled_asset("Material", material());
        Ok(GiPointCloudAsset {
            cloud: Arc::new(cloud),
            meshes,
            material,
        })
    }

    fn extensions(&self) -> &[&str] {
        &["ply"]
    }
}

impl GiPointCloudAsset {
    /// A cloud that a game made itself.
    #[must_use]
    pub fn new(
        cloud: PointCloud,
        meshes: &mut Assets<Mesh>,
        materials: &mut Assets<StandardMaterial>,
    ) -> Self {
        Self {
            meshes: cells(&cloud)
                .into_iter()
                .map(|mesh| meshes.add(mesh))
                .collect(),
            material: materials.add(material()),
            cloud: Arc::new(cloud),
        }
    }
}

/// Registers the types, the asset, its loader and the systems of point clouds.
pub(super) fn build(app: &mut App) {
    app.register_type::<GiPointCloud>()
        .register_type::<PointCloudPart>()
        .register_type::<GiPointCloudLoaderSettings>()
        .init_asset::<GiPointCloudAsset>()
        .register_asset_reflect::<GiPointCloudAsset>()
        .register_asset_loader(GiPointCloudLoader)
        // After assets have come, and before transforms and bounds of new meshes are made.
        .add_systems(
            Update,
            (spawn_point_cloud_meshes, sync_point_cloud_parts)
                .chain()
                .in_set(GiSystems::UpdatePointClouds),
        );
}

/// Material of points: a rough dielectric, because a point has only a color.
fn material() -> StandardMaterial {
    StandardMaterial {
        base_color: Color::WHITE,
        perceptual_roughness: 1.0,
        reflectance: 0.0,
        ..StandardMaterial::default()
    }
}

/// Distance between the back and the front of a cell, in spacings. It exceeds the relief of curved
/// surfaces and is too small to be visible.
const CELL_THICKNESS: f32 = 0.1;

/// Most points of a mesh: some 60 MB of vertices, a quarter of the largest buffer that every WebGPU
/// device has.
const MAX_POINTS: usize = 100_000;

/// The cells of all points in meshes of bounded size.
fn cells(cloud: &PointCloud) -> Vec<Mesh> {
    let smooth = cloud.corner_normals();
    let parts = cloud.parts(MAX_POINTS);
    parts
        .iter()
        .map(|part| cell_mesh(cloud, &smooth, part))
        .collect()
}

/// The cells of some points, front and back: corners with their normals and the point's color.
fn cell_mesh(cloud: &PointCloud, smooth: &[Vec3], part: &[u32]) -> Mesh {
    let (mut positions, mut normals, mut colors) = (Vec::new(), Vec::new(), Vec::new());
    let mut indices: Vec<u32> = Vec::new();
    for i in part.iter().map(|i| *i as usize) {
        let outline = cloud.outline(i);
        let own = &smooth[cloud.corners_of(i)];
        let [r, g, b] = cloud.albedo[i].to_array();
        let back = cloud.normals[i] * (-CELL_THICKNESS * cloud.spacing(i));
        for (side, offset) in [(1.0, Vec3::ZERO), (-1.0, back)] {
            let first = positions.len() as u32;
            for (corner, normal) in outline.iter().zip(own) {
                positions.push((*corner + offset).to_array());
                normals.push((side * *normal).to_array());
                colors.push([r, g, b, 1.0]);
            }
            for k in 2..outline.len() as u32 {
                let (a, b) = if side > 0.0 { (k - 1, k) } else { (k, k - 1) };
                indices.extend([first, first + a, first + b]);
            }
        }
    }
    Mesh::new(
        PrimitiveTopology::TriangleList,
        RenderAssetUsages::default(),
    )
    .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, positions)
    .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, normals)
    .with_inserted_attribute(Mesh::ATTRIBUTE_COLOR, colors)
    .with_inserted_indices(Indices::U32(indices))
}

/// Draws a part of the point cloud of its parent, whose first part the parent draws itself: clouds
/// of more than 100,000 points have such children. They go with the cloud, and have its material,
/// its `RenderLayers`, `NotShadowCaster` and `NotShadowReceiver`.
#[derive(Component, Reflect, Clone, Copy, Debug, Default, PartialEq, Eq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
pub struct PointCloudPart;

/// Inserts the meshes of point clouds, and removes them from entities without a cloud.
#[allow(clippy::type_complexity, reason = "data of a query")]
fn spawn_point_cloud_meshes(
    mut commands: Commands,
    assets: Res<Assets<GiPointCloudAsset>>,
    mut events: MessageReader<AssetEvent<GiPointCloudAsset>>,
    mut removed: RemovedComponents<GiPointCloud>,
    clouds: Query<(
        Entity,
        Ref<GiPointCloud>,
        Option<&Mesh3d>,
        Has<MeshMaterial3d<StandardMaterial>>,
    )>,
    parts: Query<(Entity, &ChildOf), With<PointCloudPart>>,
) {
    let clear = |commands: &mut Commands, cloud: Entity| {
        for (part, _) in parts.iter().filter(|(_, of)| of.parent() == cloud) {
            commands.entity(part).despawn();
        }
    };
    for id in removed.read().filter(|id| !clouds.contains(*id)) {
        clear(&mut commands, id);
        if let Ok(mut entity) = commands.get_entity(id) {
            entity.try_remove::<Mesh3d>();
        }
    }
    let news: Vec<AssetId<GiPointCloudAsset>> = events
        .read()
        .filter_map(|event| match event {
            AssetEvent::Added { id } | AssetEvent::Modified { id } => Some(*id),
            _ => None,
        })
        .collect();
    for (id, cloud, mesh, has_material) in &clouds {
        if !cloud.is_changed() && !news.contains(&cloud.0.id()) {
            continue;
        }
        let points = assets.get(&cloud.0);
        let Some((points, [first, others @ ..])) = points.map(|p| (p, p.meshes.as_slice())) else {
            continue;
        };
        clear(&mut commands, id);
        for mesh in others {
            commands.spawn((PointCloudPart, Mesh3d(mesh.clone()), ChildOf(id)));
        }
        let mut entity = commands.entity(id);
        if mesh.is_none_or(|mesh| mesh.0 != *first) {
            entity.insert(Mesh3d(first.clone()));
        }
        if !has_material {
            entity.insert(MeshMaterial3d(points.material.clone()));
        }
    }
}

/// Components that the parts of a cloud copy from it.
type CopiedComponents = (
    Option<&'static MeshMaterial3d<StandardMaterial>>,
    Option<&'static RenderLayers>,
    Has<NotShadowCaster>,
    Has<NotShadowReceiver>,
);

/// Copies the render components of clouds to their parts. Runs after [`spawn_point_cloud_meshes`].
fn sync_point_cloud_parts(
    mut commands: Commands,
    parts: Query<(Entity, &ChildOf, CopiedComponents), With<PointCloudPart>>,
    clouds: Query<CopiedComponents, Without<PointCloudPart>>,
) {
    for (part, of, own) in &parts {
        let Ok(cloud) = clouds.get(of.parent()) else {
            continue;
        };
        if own == cloud {
            continue;
        }
        let mut part = commands.entity(part);
        let (material, layers, no_caster, no_receiver) = cloud;
        match material {
            Some(material) => part.insert(material.clone()),
            None => part.remove::<MeshMaterial3d<StandardMaterial>>(),
        };
        match layers {
            Some(layers) => part.insert(layers.clone()),
            None => part.remove::<RenderLayers>(),
        };
        match no_caster {
            true => part.insert(NotShadowCaster),
            false => part.remove::<NotShadowCaster>(),
        };
        match no_receiver {
            true => part.insert(NotShadowReceiver),
            false => part.remove::<NotShadowReceiver>(),
        };
    }
}
