//! One bounce from dynamic objects: markers, lights with reflective shadow maps, and the cameras of
//! the maps, in the main world.
//!
//! A bake has the light that static surfaces reflect. [`GiReflector`] marks dynamic objects. A
//! light with [`GiReflectiveShadowMap`] draws only these objects into small G-buffers (reflective
//! shadow maps, \[N09\] §3). Each map has its own camera ([`GiRsmCamera`]). This file spawns,
//! positions ([`map_views`]) and deactivates the cameras. `map_schedule` runs them.
//!
//! The cameras select dynamic objects by the [`RenderLayers`] layer [`GiRsmCamera::RENDER_LAYER`],
//! which is added to the meshes below a reflector.

use crate::plan::LightKind;
use crate::plan::{Lens, MapView, SkipReason, map_views};
use crate::plugin::camera::GiCamera;
use crate::plugin::effects::rsm::reflective_shadow_map::GiReflectiveShadowMap;
use crate::plugin::effects::rsm::reflector::GiReflector;
use crate::plugin::extract::{LightKey, LightParts, LightPartsItem};
use bevy::asset::Assets;
use bevy::camera::primitives::{Aabb, MeshAabb};
use bevy::camera::visibility::{InheritedVisibility, RenderLayers};
use bevy::camera::{
    Camera, Camera3d, Camera3dDepthTextureUsage, OrthographicProjection, PerspectiveProjection,
    Projection, RenderTarget, ScalingMode,
};
use bevy::core_pipeline::prepass::DeferredPrepass;
use bevy::core_pipeline::tonemapping::{DebandDither, Tonemapping};
use bevy::ecs::entity::EntityHashSet;
use bevy::ecs::prelude::*;
use bevy::ecs::system::SystemParam;
use bevy::light::cluster::ClusterConfig;
use bevy::light::{DirectionalLight, PointLight, SpotLight};
use bevy::math::{UVec2, Vec3};
use bevy::mesh::{Mesh, Mesh3d};
use bevy::reflect::prelude::*;
use bevy::render::camera::CameraRenderGraph;
use bevy::render::render_resource::TextureUsages;
use bevy::render::view::{Msaa, NoIndirectDrawing};
use bevy::transform::components::{GlobalTransform, Transform};
use meshless_gi::{Bounds, FrameLight};

/// Camera that draws one reflective shadow map. The plugin spawns, positions and despawns it. It is
/// inactive if there is nothing to draw. Queries of a game for cameras may need
/// `Without<GiRsmCamera>`.
#[derive(Component, Reflect, Clone, Copy, Debug, PartialEq, Eq)]
#[reflect(Component, Clone, Debug, PartialEq)]
#[component(immutable)]
pub struct GiRsmCamera {
    /// Light of the map.
    pub light: Entity,
    /// Kind of the light.
    kind: LightKind,
    /// Index of the map among the light's maps.
    pub map: u32,
}

impl GiRsmCamera {
    /// Render layer of dynamic objects, reserved for the plugin. Only these cameras use it.
    pub const RENDER_LAYER: usize = 61;

    /// Order of the first of these cameras. Orders count up from it, so that maps are drawn before
    /// the cameras of the game.
    pub const FIRST_ORDER: isize = -1_000_000;
}

/// A mesh to which the plugin added [`GiRsmCamera::RENDER_LAYER`].
#[derive(Component)]
pub(crate) struct RsmMesh {
    /// The mesh had no `RenderLayers` before.
    had_no_layers: bool,
}

/// Dynamic objects and their meshes.
#[derive(SystemParam)]
#[allow(clippy::type_complexity, reason = "filters of queries")]
pub(crate) struct DynamicMeshes<'w, 's> {
    reflectors: Query<'w, 's, Entity, With<GiReflector>>,
    children: Query<'w, 's, &'static Children>,
    meshes: Query<'w, 's, (Option<&'static RenderLayers>, Has<RsmMesh>), With<Mesh3d>>,
    marked: Query<'w, 's, (Entity, &'static RsmMesh, Option<&'static RenderLayers>)>,
    without_bounds: Query<'w, 's, (Entity, &'static Mesh3d), (With<RsmMesh>, Without<Aabb>)>,
}

/// Adds the render layer of dynamic objects to the meshes below [`GiReflector`]s, and removes it
/// from other meshes.
pub(crate) fn update_rsm_layers(
    mut commands: Commands,
    dynamic: DynamicMeshes,
    assets: Option<Res<Assets<Mesh>>>,
    mut below: Local<EntityHashSet>,
) {
    let DynamicMeshes {
        reflectors,
        children,
        meshes,
        marked,
        without_bounds,
    } = dynamic;
    if reflectors.is_empty() && marked.is_empty() {
        return;
    }
    let capture = RenderLayers::layer(GiRsmCamera::RENDER_LAYER);
    below.clear();
    for reflector in &reflectors {
        let family = std::iter::once(reflector).chain(children.iter_descendants(reflector));
        below.extend(family.filter(|e| meshes.contains(*e)));
    }
    for &entity in below.iter() {
        let Ok((layers, had)) = meshes.get(entity) else {
            continue;
        };
        if !had || !layers.is_some_and(|l| l.intersects(&capture)) {
            let had_no_layers = layers.is_none();
            let layers = layers
                .cloned()
                .unwrap_or_default()
                .with(GiRsmCamera::RENDER_LAYER);
            commands
                .entity(entity)
                .insert((layers, RsmMesh { had_no_layers }));
        }
    }
    // Bevy computes no bounds for meshes that it does not cull. The cameras need them.
    for (entity, mesh) in &without_bounds {
        if let Some(aabb) = (assets.as_ref()).and_then(|a| a.get(mesh)?.compute_aabb()) {
            commands.entity(entity).insert(aabb);
        }
    }
    for (entity, mark, layers) in &marked {
        if below.contains(&entity) {
            continue;
        }
        let mut entity = commands.entity(entity);
        entity.remove::<RsmMesh>();
        if let Some(layers) = layers {
            let own = layers.clone().without(GiRsmCamera::RENDER_LAYER);
            if mark.had_no_layers && own == RenderLayers::default() {
                entity.remove::<RenderLayers>();
            } else {
                entity.insert(own);
            }
        }
    }
}

/// A light with a reflective shadow map, and the cameras of its maps in this frame.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct RsmRequest {
    pub key: LightKey,
    /// Light in world space.
    pub light: FrameLight,
    pub layers: RenderLayers,
    pub settings: GiReflectiveShadowMap,
    /// Views of its maps.
    pub views: Vec<MapView>,
    pub maps: Result<Vec<Entity>, SkipReason>,
}

/// All lights with reflective shadow maps in this frame.
#[derive(Resource, Clone, Debug, Default)]
pub(crate) struct RsmRequests {
    pub lights: Vec<RsmRequest>,
    /// `true` if an object may look different from the last frame in the maps.
    pub objects_changed: bool,
}

type Captures<'w, 's> = Query<
    'w,
    's,
    (
        Entity,
        &'static GiRsmCamera,
        &'static mut Camera,
        &'static mut RenderTarget,
        &'static mut Projection,
        &'static mut Transform,
        &'static mut GlobalTransform,
    ),
>;

/// Lights with [`GiReflectiveShadowMap`].
#[derive(SystemParam)]
#[allow(clippy::type_complexity, reason = "filters of queries")]
pub(crate) struct RsmLights<'w, 's> {
    points: Query<
        'w,
        's,
        (
            LightParts,
            &'static PointLight,
            &'static GiReflectiveShadowMap,
        ),
        Without<GiRsmCamera>,
    >,
    spots: Query<
        'w,
        's,
        (
            LightParts,
            &'static SpotLight,
            &'static GiReflectiveShadowMap,
        ),
        Without<GiRsmCamera>,
    >,
    directionals: Query<
        'w,
        's,
        (
            LightParts,
            &'static DirectionalLight,
            &'static GiReflectiveShadowMap,
        ),
        Without<GiRsmCamera>,
    >,
}

impl RsmLights<'_, '_> {
    /// Returns all lights, sorted by their keys. The order of the world's entities varies.
    fn collect(&self) -> Vec<RsmRequest> {
        let mut lights = Vec::new();
        let mut add = |kind, parts: &LightPartsItem, light, settings: &GiReflectiveShadowMap| {
            lights.push(RsmRequest {
                key: (parts.entity.to_bits(), kind),
                light: FrameLight::expand(&light, 1)[0],
                layers: parts.layers.cloned().unwrap_or_default(),
                settings: settings.clone(),
                views: Vec::new(),
                maps: Err(SkipReason::NotInView),
            });
        };
        for (parts, light, settings) in &self.points {
            add(LightKind::Point, &parts, parts.point(light), settings);
        }
        for (parts, light, settings) in &self.spots {
            add(LightKind::Spot, &parts, parts.spot(light), settings);
        }
        for (parts, light, settings) in &self.directionals {
            let light = parts.directional(light);
            add(LightKind::Directional, &parts, light, settings);
        }
        lights.sort_unstable_by_key(|light| light.key);
        lights
    }
}

type DynamicBounds<'w, 's> = Query<
    'w,
    's,
    (
        &'static GlobalTransform,
        &'static Aabb,
        &'static InheritedVisibility,
    ),
    (With<RsmMesh>, Without<GiRsmCamera>),
>;

/// Positions the camera of one map, or spawns it, and returns it.
fn place_camera(
    commands: &mut Commands,
    captures: &mut Captures,
    capture: GiRsmCamera,
    view: &MapView,
    texels: u32,
    order: isize,
) -> Entity {
    let existing = captures.iter_mut().find(|(_, c, ..)| **c == capture);
    let Some((entity, _, mut camera, mut target, mut lens, mut at, mut global)) = existing else {
        return commands
            .spawn((capture, camera_bundle(view, texels, order)))
            .id();
    };
    if !camera.is_active || camera.order != order {
        (camera.is_active, camera.order) = (true, order);
    }
    let size = UVec2::splat(texels);
    if !matches!(*target, RenderTarget::None { size: old } if old == size) {
        *target = RenderTarget::None { size };
        // Bevy reads the size of a target without an image when the projection changes.
        lens.set_changed();
    }
    set_lens(&mut lens, view.lens);
    let to = transform(view);
    if *at != to {
        (*at, *global) = (to, to.into());
    }
    entity
}

/// Positions the cameras of the reflective shadow maps, and deactivates those that have nothing to
/// draw.
pub(crate) fn update_rsm_cameras(
    mut commands: Commands,
    mut requests: ResMut<RsmRequests>,
    cameras: Query<(&Camera, &GiCamera), Without<GiRsmCamera>>,
    lights: RsmLights,
    dynamic: DynamicBounds,
    mut captures: Captures,
) {
    requests.lights = lights.collect();
    if requests.lights.is_empty() && captures.is_empty() {
        return;
    }
    let shown = cameras.iter().any(|(c, gi)| c.is_active && gi.enabled);
    let boxes: Vec<Bounds> = match shown && !requests.lights.is_empty() {
        true => (dynamic.iter())
            .filter(|(.., visible)| visible.get())
            .map(|(at, aabb, _)| bounds(at, aabb))
            .collect(),
        false => Vec::new(),
    };

    let mut order = GiRsmCamera::FIRST_ORDER;
    let requests = &mut *requests;
    for light in requests.lights.iter_mut().filter(|_| shown) {
        let texels = light.settings.texels();
        light.maps = map_views(&light.light, &boxes, texels).map(|views| {
            let mut placed = |(map, view): (usize, &MapView)| {
                order += 1;
                let capture = GiRsmCamera {
                    light: Entity::from_bits(light.key.0),
                    kind: light.key.1,
                    map: map as u32,
                };
                place_camera(&mut commands, &mut captures, capture, view, texels, order)
            };
            let drawn = views.iter().enumerate().map(&mut placed).collect();
            light.views = views;
            drawn
        });
    }
    for (entity, capture, mut camera, ..) in &mut captures {
        let key = (capture.light.to_bits(), capture.kind);
        let light = requests.lights.iter().find(|light| light.key == key);
        match light.map(|light| &light.maps) {
            None => commands.entity(entity).despawn(),
            Some(Ok(maps)) if maps.contains(&entity) => {}
            Some(_) if camera.is_active => camera.is_active = false,
            Some(_) => {}
        }
    }
}

/// The box of a mesh in world space.
fn bounds(at: &GlobalTransform, aabb: &Aabb) -> Bounds {
    let affine = at.affine();
    let middle = Vec3::from(affine.transform_point3a(aabb.center));
    let half = Vec3::from(affine.matrix3.abs() * aabb.half_extents);
    Bounds {
        min: middle - half,
        max: middle + half,
    }
}

fn transform(view: &MapView) -> Transform {
    Transform::from_translation(view.position).with_rotation(view.rotation)
}

fn set_lens(projection: &mut Mut<Projection>, lens: Lens) {
    let same = match (&**projection, lens) {
        (Projection::Perspective(p), Lens::Perspective { fov, near, far }) => {
            (p.fov, p.near, p.far) == (fov, near, far)
        }
        (Projection::Orthographic(p), Lens::Orthographic { size, far }) => {
            p.far == far
                && matches!(p.scaling_mode, ScalingMode::Fixed { width, .. } if width == size)
        }
        _ => false,
    };
    if !same {
        **projection = self::projection(lens);
    }
}

fn projection(lens: Lens) -> Projection {
    match lens {
        Lens::Perspective { fov, near, far } => Projection::Perspective(PerspectiveProjection {
            fov,
            near,
            far,
            near_clip_plane: Vec3::NEG_Z.extend(-near),
            ..PerspectiveProjection::default()
        }),
        Lens::Orthographic { size, far } => Projection::Orthographic(OrthographicProjection {
            near: 0.0,
            far,
            scaling_mode: ScalingMode::Fixed {
                width: size,
                height: size,
            },
            ..OrthographicProjection::default_3d()
        }),
    }
}

/// A camera that draws deferred surfaces and depth, has no picture, and takes part in nothing else.
fn camera_bundle(view: &MapView, texels: u32, order: isize) -> impl Bundle {
    let at = transform(view);
    (
        Camera3d {
            // `map_schedule` binds it itself, which saves a depth prepass and its copy.
            depth_texture_usages: Camera3dDepthTextureUsage::from(
                TextureUsages::RENDER_ATTACHMENT | TextureUsages::TEXTURE_BINDING,
            ),
            ..Camera3d::default()
        },
        Camera {
            order,
            ..Camera::default()
        },
        RenderTarget::None {
            size: UVec2::splat(texels),
        },
        CameraRenderGraph::new(crate::plugin::effects::rsm::map_schedule::RsmSchedule),
        projection(view.lens),
        (at, GlobalTransform::from(at)),
        RenderLayers::layer(GiRsmCamera::RENDER_LAYER),
        DeferredPrepass,
        Msaa::Off,
        NoIndirectDrawing,
        ClusterConfig::Single,
        (Tonemapping::None, DebandDither::Disabled),
        Name::new("meshless_gi reflective shadow map"),
    )
}
