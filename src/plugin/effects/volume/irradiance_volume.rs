//! Indirect light for surfaces outside the G-buffer. The probe light of a baked scene is in one of
//! Bevy's irradiance volumes. Kernel [`volume`](meshless_gi::internals::frame::volume) writes it
//! whenever the light changes. [`crate::plugin::fog`] reads it too.
//!
//! Bevy adds a volume to every pixel of every camera that shows it, including those of the
//! G-buffer. For cameras with our display it is removed there ([`crate::plugin::deferred`]), or
//! hidden.

use crate::plan::SceneId;
use crate::plugin::asset::GiBakedScene;
use crate::plugin::camera::GiCamera;
use crate::plugin::deferred::ReadyDisplays;
use crate::plugin::effects::fog::fog_volumes::ExtractedFogs;
use crate::plugin::effects::rsm::map_cameras::GiRsmCamera;
use crate::plugin::extract::{ExtractedGi, GbufferComponents, draws_gbuffer, in_view};
use crate::plugin::scene::GiScene;
use crate::plugin::settings::GiSettings;
use crate::plugin::validation::{GiWarning, GiWarnings, add_warnings};
use bevy::asset::{AssetId, Assets, RenderAssetUsages};
use bevy::camera::primitives::Frustum;
use bevy::camera::visibility::{RenderLayers, VisibleEntities};
use bevy::camera::{Camera, Camera3d};
use bevy::ecs::hierarchy::ChildOf;
use bevy::ecs::prelude::*;
use bevy::image::{Image, ImageSampler};
use bevy::light::IrradianceVolume;
use bevy::light::cluster::ClusterVisibilityClass;
use bevy::reflect::prelude::*;
use bevy::render::Extract;
use bevy::render::render_asset::RenderAssets;
use bevy::render::render_resource::{Extent3d, TextureDimension, TextureFormat, TextureUsages};
use bevy::render::texture::GpuImage;
use bevy::render::view::Msaa;
use bevy::transform::components::Transform;
use meshless_gi::internals::frame::VoxelGrid;
use std::any::TypeId;
use std::sync::Arc;

/// Irradiance volume for surfaces outside the G-buffer. It lights everything in cameras without
/// [`GiCamera`], such as forward cameras and those with several samples per pixel. It also lights
/// transparent and forward surfaces in views with it, and Bevy's volumetric fog in all views. Add
/// it to the entity with [`GiScene`]. The bake needs probes (recipe field `probes`).
///
/// The plugin spawns a child with an [`IrradianceVolume`] below the root and writes its voxels in
/// frames in which the light changes. Baked walls have the same light as in a deferred camera.
/// Surfaces away from walls are lit by interpolation between voxels, which is coarser. Walls of any
/// thickness block light of the next room. For this, the plugin replaces Bevy's shader module for
/// irradiance volumes as soon as the component exists. The replacement leaves out voxels behind
/// walls, and other volumes do not change. Pipelines are compiled once more, so add the component
/// while a scene loads. On devices that sample one volume at a time, only the nearest one counts.
/// Use one volume per room there.
#[derive(Component, Reflect, Clone, Copy, Debug, PartialEq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
pub struct GiIrradianceVolume {
    /// Edge length of a voxel in meters, in the space of the bake. `None` (default) uses half of
    /// the distance between the bake's probes.
    pub voxel_size: Option<f32>,
    /// Maximum number of voxels, at most 2²⁰. Larger volumes get larger voxels. Default: 2¹⁶.
    ///
    /// Memory per voxel: 48 bytes of texture, 4 bytes per probe (at most 32 probes), and near walls
    /// 8 bytes per wall function and 8 bytes of wall distances.
    pub max_voxels: u32,
}

impl Default for GiIrradianceVolume {
    fn default() -> Self {
        Self {
            voxel_size: None,
            max_voxels: 1 << 16,
        }
    }
}

impl GiIrradianceVolume {
    /// Returns `true` if both settings give the same voxels. NaN equals NaN.
    fn same_voxels(&self, other: &Self) -> bool {
        let bits = |v: &Self| (v.voxel_size.map(f32::to_bits), v.max_voxels);
        bits(self) == bits(other)
    }
}

/// Child with the volume, and the inputs of the volume.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
pub(crate) struct Voxels {
    pub shape: VoxelGrid,
    /// Key of the bake, which changes with a new bake under the same handle, and the requested
    /// settings.
    bake: (AssetId<GiBakedScene>, usize),
    requested: GiIrradianceVolume,
}

/// Returns the key of the bake that an asset holds now.
fn bake_key(id: AssetId<GiBakedScene>, asset: &GiBakedScene) -> (AssetId<GiBakedScene>, usize) {
    (id, Arc::as_ptr(&asset.scene) as usize)
}

impl Voxels {
    /// Returns the volume of a bake. `None` if it has no probes.
    fn new(
        requested: &GiIrradianceVolume,
        asset: &GiBakedScene,
        id: AssetId<GiBakedScene>,
    ) -> Option<Self> {
        Some(Self {
            shape: VoxelGrid::from_scene(
                asset.scene.data(),
                requested.voxel_size,
                requested.max_voxels,
            )?,
            bake: bake_key(id, asset),
            requested: *requested,
        })
    }

    fn texture(&self) -> Image {
        let [width, height, depth] = self.shape.texels().to_array();
        let size = Extent3d {
            width,
            height,
            depth_or_array_layers: depth,
        };
        let mut image = Image::new_uninit(
            size,
            TextureDimension::D3,
            TextureFormat::Rgba16Float,
            RenderAssetUsages::RENDER_WORLD,
        );
        image.texture_descriptor.usage =
            TextureUsages::STORAGE_BINDING | TextureUsages::TEXTURE_BINDING;
        image.sampler = ImageSampler::linear();
        image
    }
}

/// Makes, replaces and removes the volumes of roots. Runs in
/// [`GiSystems::UpdateVolumes`](crate::plugin::GiSystems::UpdateVolumes).
pub(crate) fn update_irradiance_volumes(
    roots: Query<(Entity, &GiScene, &GiIrradianceVolume, Option<&RenderLayers>)>,
    made: Query<(Entity, &ChildOf, &Voxels, &RenderLayers)>,
    assets: Res<Assets<GiBakedScene>>,
    mut images: ResMut<Assets<Image>>,
    mut commands: Commands,
) {
    let mut standing = Vec::new();
    for (child, parent, voxels, layers) in &made {
        let root = parent.parent();
        let still = |(_, gi, requested, own): &(
            _,
            &GiScene,
            &GiIrradianceVolume,
            Option<&RenderLayers>,
        )| {
            let now = assets.get(&gi.0).map(|asset| bake_key(gi.0.id(), asset));
            (now == Some(voxels.bake) && requested.same_voxels(&voxels.requested))
                .then(|| own.cloned().unwrap_or_default())
        };
        match roots.get(root).ok().as_ref().and_then(still) {
            Some(own) if !standing.contains(&root) => {
                standing.push(root);
                if own != *layers {
                    commands.entity(child).insert(own);
                }
            }
            _ => commands.entity(child).despawn(),
        }
    }
    for (root, gi, requested, layers) in &roots {
        if standing.contains(&root) {
            continue;
        }
        let asset = assets.get(&gi.0);
        let Some(voxels) = asset.and_then(|asset| Voxels::new(requested, asset, gi.0.id())) else {
            continue;
        };
        commands.spawn((
            ChildOf(root),
            voxels,
            Transform::from_translation(voxels.shape.center()).with_scale(voxels.shape.edges()),
            IrradianceVolume {
                voxels: images.add(voxels.texture()),
                intensity: 1.0,
                affects_lightmapped_meshes: false,
            },
            layers.cloned().unwrap_or_default(),
        ));
    }
}

/// Cameras with a display of their own.
type WithDisplay = Or<(With<GiCamera>, With<GiRsmCamera>)>;

/// Query data of a camera's display.
pub(crate) type DisplayQuery = (
    Option<&'static GiCamera>,
    Option<&'static Msaa>,
    GbufferComponents,
);

/// Query item of [`DisplayQuery`].
pub(crate) type DisplayItem<'a> = (
    Option<&'a GiCamera>,
    Option<&'a Msaa>,
    (bool, bool, bool, bool),
);

/// Returns `true` if the camera shows indirect light over its G-buffer.
pub(crate) fn displays((display, msaa, gbuffer_components): DisplayItem<'_>) -> bool {
    display.is_some_and(|d| d.enabled) && draws_gbuffer(gbuffer_components, msaa)
}

/// Hides our volumes from cameras with a display of their own, unless [`crate::plugin::deferred`]
/// takes them out of the G-buffer. Cameras of lights' maps do not show them. The same holds for
/// cameras whose display is off or impossible. Runs in
/// [`GiSystems::FilterVolumes`](crate::plugin::GiSystems::FilterVolumes).
pub(crate) fn hide_irradiance_volumes(
    volumes: Query<(), With<Voxels>>,
    ready: Res<ReadyDisplays>,
    mut cameras: Query<(Entity, &mut VisibleEntities, DisplayQuery), WithDisplay>,
) {
    if volumes.is_empty() {
        return;
    }
    for (camera, mut seen, parts) in &mut cameras {
        if displays(parts) && ready.contains(camera) {
            continue;
        }
        let class = TypeId::of::<ClusterVisibilityClass>();
        if seen.get(class).iter().any(|e| volumes.contains(*e)) {
            seen.get_mut(class).retain(|e| !volumes.contains(*e));
        }
    }
}

/// A volume of the main world whose texture is there, as the render world needs it.
pub(crate) struct ExtractedVolume {
    scene: SceneId,
    pub voxels: Voxels,
    pub texture: wgpu::TextureView,
    sampler: wgpu::Sampler,
    pub is_visible: bool,
}

impl ExtractedVolume {
    pub fn shape(&self) -> &VoxelGrid {
        &self.voxels.shape
    }

    pub fn sampler(&self) -> &wgpu::Sampler {
        &self.sampler
    }
}

/// All of them.
#[derive(Resource, Default)]
pub(crate) struct ExtractedVolumes {
    all: Vec<ExtractedVolume>,
    /// Cameras of the main world with the plugin's display, `true` for those that show a volume.
    /// Empty without volumes.
    displays: Vec<(Entity, bool)>,
}

impl ExtractedVolumes {
    /// Returns `true` if this camera of the main world shows a volume. `None` if it lacks the
    /// plugin's display, or without volumes.
    pub fn display(&self, camera: Entity) -> Option<bool> {
        let found = self.displays.iter().find(|(id, _)| *id == camera);
        found.map(|(_, sees)| *sees)
    }

    /// The volume of a scene.
    pub fn find(&self, scene: SceneId) -> Option<&ExtractedVolume> {
        self.all.iter().find(|v| v.scene == scene)
    }
}

type ForwardCameras<'w, 's> = Query<
    'w,
    's,
    (
        &'static Camera,
        &'static Frustum,
        Option<&'static RenderLayers>,
    ),
    (With<Camera3d>, Without<GiCamera>, Without<GiRsmCamera>),
>;

/// Runs in [`GiRenderSystems::Extract`](crate::GiRenderSystems::Extract), behind the scenes and the
/// fog.
pub(crate) fn extract_volumes(
    mut out: ResMut<ExtractedVolumes>,
    world: Res<ExtractedGi>,
    fogs: Res<ExtractedFogs>,
    volumes: Extract<Query<(Entity, &ChildOf, &Voxels, &IrradianceVolume)>>,
    cameras: Extract<ForwardCameras>,
    displays: Extract<Query<(Entity, &Camera, &VisibleEntities, DisplayQuery)>>,
    images: Option<Res<RenderAssets<GpuImage>>>,
) {
    out.all.clear();
    out.displays.clear();
    if volumes.is_empty() {
        return;
    }
    let class = TypeId::of::<ClusterVisibilityClass>();
    for (id, camera, seen, parts) in &displays {
        if camera.is_active && self::displays(parts) {
            let sees = seen.get(class).iter().any(|e| volumes.contains(*e));
            out.displays.push((id, sees));
        }
    }
    for (entity, parent, voxels, volume) in &volumes {
        let id = SceneId(parent.parent().to_bits());
        let texture = images.as_ref().and_then(|i| i.get(&volume.voxels));
        let scene = world.scenes.iter().find(|s| s.id == id);
        let (Some(texture), Some(scene)) = (texture, scene) else {
            continue;
        };
        let sees = |(camera, frustum, layers): (&Camera, &Frustum, Option<&RenderLayers>)| {
            camera.is_active && in_view(scene, frustum, &layers.cloned().unwrap_or_default())
        };
        let shows = |(id, _, seen, _): (Entity, _, &VisibleEntities, _)| {
            out.display(id) == Some(true) && seen.get(class).contains(&entity)
        };
        let is_visible =
            cameras.iter().any(sees) || displays.iter().any(shows) || fogs.shows_scene(id);
        out.all.push(ExtractedVolume {
            scene: id,
            voxels: *voxels,
            texture: wgpu::TextureView::clone(&texture.texture_view),
            sampler: wgpu::Sampler::clone(&texture.sampler),
            is_visible,
        });
    }
}

/// Warns once if there is a volume and the bake has no probes to fill it. Runs in
/// [`GiSystems::Validate`](crate::plugin::GiSystems::Validate).
pub(crate) fn check_volumes(
    settings: Res<GiSettings>,
    roots: Query<&GiScene, With<GiIrradianceVolume>>,
    assets: Res<Assets<GiBakedScene>>,
    mut findings: ResMut<GiWarnings>,
) {
    let empty = |gi: &GiScene| (assets.get(&gi.0)).is_some_and(|a| a.scene.data().probes.is_none());
    if settings.warn_double_counting && roots.iter().any(empty) {
        add_warnings(vec![GiWarning::NoProbes], &mut findings);
    }
}
