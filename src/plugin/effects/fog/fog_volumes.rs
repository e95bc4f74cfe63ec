//! Fog that a scene lights. Bevy draws its volumetric fog with lights and the camera's ambient
//! light. After that, kernel [`fog`](meshless_gi::internals::frame::fog) adds the scene's indirect
//! light that the fog sends to the eye. It reads this light from the scene's
//! [`GiIrradianceVolume`].
//!
//! Fog is lit only where Bevy draws it: it needs a [`VolumetricLight`] somewhere, and
//! [`VolumetricFog`] on the camera.

use crate::plan::{FogState, SceneId, ViewId};
use crate::plugin::camera::GiDebugView;
use crate::plugin::effects::fog::volumetric_fog::GiVolumetricFog;
use crate::plugin::effects::rsm::map_cameras::GiRsmCamera;
use crate::plugin::effects::volume::irradiance_volume::{
    DisplayItem, DisplayQuery, Voxels, displays,
};
use crate::plugin::extract::{ExtractedGi, in_view};
use crate::plugin::settings::GiSettings;
use crate::plugin::validation::{GiWarning, GiWarnings, add_warnings};
use bevy::asset::AssetId;
use bevy::camera::primitives::{Aabb, Frustum};
use bevy::camera::visibility::RenderLayers;
use bevy::camera::{Camera, Camera3d};
use bevy::color::{Color, ColorToComponents, LinearRgba};
use bevy::ecs::hierarchy::ChildOf;
use bevy::ecs::prelude::*;
use bevy::image::Image;
use bevy::light::{FogVolume, VolumetricFog, VolumetricLight};
use bevy::math::{Affine3A, Vec3, Vec3A};
use bevy::render::Extract;
use bevy::transform::components::GlobalTransform;
use meshless_gi::internals::frame::Fog;

/// A scene that lights fog.
pub(crate) struct FogScene {
    pub scene: SceneId,
    /// Bounds in the scene's local space.
    pub bounds: [Vec3; 2],
    /// The bounds in the world, as a transform of a cube with edges of 1.
    pub cube: Affine3A,
    /// Multiplies the light that fog scatters.
    pub strength: f32,
}

/// A fog volume that a scene lights, and the image of its density.
pub(crate) struct LitFog {
    /// Index of the scene in [`ExtractedFogs::scenes`].
    pub scene: usize,
    pub fog: Fog,
    pub density: Option<AssetId<Image>>,
}

/// Camera that shows fog.
pub(crate) struct ExtractedFogView {
    id: ViewId,
    pixels: u64,
    pub steps: u32,
    pub intensity: f32,
    pub lit: Vec<LitFog>,
}

/// Cameras that show fog, and the scenes that light it. If several scenes overlap, the first one
/// lights the fog.
#[derive(Resource, Default)]
pub(crate) struct ExtractedFogs {
    pub scenes: Vec<FogScene>,
    views: Vec<ExtractedFogView>,
}

impl ExtractedFogs {
    /// Returns `true` if a camera shows fog that this scene lights.
    pub fn shows_scene(&self, scene: SceneId) -> bool {
        let lights = |fog: &LitFog| self.scenes[fog.scene].scene == scene;
        self.views.iter().any(|view| view.lit.iter().any(lights))
    }

    /// Returns the fog that a camera shows.
    pub fn view(&self, id: ViewId) -> Option<&ExtractedFogView> {
        self.views.iter().find(|view| view.id == id)
    }

    /// Returns the states of fog for the plan.
    pub fn describe(&self) -> Vec<FogState> {
        let of = |view: &ExtractedFogView, scene: usize| FogState {
            view: view.id,
            scene: self.scenes[scene].scene,
            volumes: view.lit.iter().filter(|f| f.scene == scene).count(),
            pixels: view.pixels,
        };
        let every = |view| (0..self.scenes.len()).map(move |scene| of(view, scene));
        let all = self.views.iter().flat_map(every);
        all.filter(|state| state.volumes > 0).collect()
    }
}

/// Returns the factor of the light in a camera's fog. `None` if the camera shows no such light.
fn display_intensity(camera: &Camera, parts: DisplayItem<'_>) -> Option<f32> {
    let intensity = match parts.0 {
        None => 1.0,
        Some(ours) if ours.debug_view == GiDebugView::Final && displays(parts) => {
            ours.intensity.max(0.0)
        }
        Some(_) => return None,
    };
    camera.is_active.then_some(intensity)
}

fn rgb(color: Color) -> Vec3 {
    LinearRgba::from(color).to_vec3()
}

/// Converts Bevy's fog to the type of the core. Returns `None` if it has no fog.
fn convert_fog(fog: &FogVolume, transform: &GlobalTransform) -> Option<Fog> {
    let affine = transform.affine();
    let found = Fog {
        world_from_local: affine.into(),
        color: rgb(fog.fog_color) * rgb(fog.light_tint) * fog.light_intensity,
        density: fog.density_factor,
        absorption: fog.absorption,
        scattering: fog.scattering,
        asymmetry: fog.scattering_asymmetry,
        texture: (fog.density_texture.is_some()).then_some(fog.density_texture_offset),
    };
    let offset = found.texture.unwrap_or_default();
    let numbers = [
        found.density,
        found.absorption,
        found.scattering,
        found.asymmetry,
    ];
    let finite = found.color.is_finite()
        && offset.is_finite()
        && affine.is_finite()
        && numbers.iter().all(|n| n.is_finite());
    let there = affine.matrix3.determinant() != 0.0
        && found.density > 0.0
        && found.scattering > 0.0
        && found.absorption >= 0.0;
    (finite && there).then_some(found)
}

/// Returns `true` if two cubes with edges of 1 may overlap: neither lies beyond a side of the
/// other.
pub(crate) fn cubes_overlap(a: &Affine3A, b: &Affine3A) -> bool {
    let within = |of: &Affine3A, other: &Affine3A| {
        let transform = of.inverse() * *other;
        let half = (0..3).fold(Vec3A::ZERO, |sum, k| {
            sum + 0.5 * transform.matrix3.col(k).abs()
        });
        (transform.translation.abs() - half)
            .cmplt(Vec3A::splat(0.5))
            .all()
    };
    within(a, b) && within(b, a)
}

type FogCameras<'w, 's> = Query<
    'w,
    's,
    (
        Entity,
        &'static Camera,
        &'static VolumetricFog,
        &'static Frustum,
        Option<&'static RenderLayers>,
        DisplayQuery,
    ),
    (With<Camera3d>, Without<GiRsmCamera>),
>;

/// Runs in [`GiRenderSystems::Extract`](crate::GiRenderSystems::Extract), behind the scenes and
/// before the volumes.
pub(crate) fn extract_fogs(
    mut out: ResMut<ExtractedFogs>,
    world: Res<ExtractedGi>,
    volumes: Extract<Query<&ChildOf, With<Voxels>>>,
    roots: Extract<Query<&GiVolumetricFog>>,
    fogs: Extract<Query<(&FogVolume, &GlobalTransform)>>,
    light_sources: Extract<Query<(), With<VolumetricLight>>>,
    cameras: Extract<FogCameras>,
) {
    let ExtractedFogs { scenes, views } = &mut *out;
    scenes.clear();
    views.clear();
    if volumes.is_empty() || fogs.is_empty() || light_sources.is_empty() {
        return;
    }
    let mut at = Vec::new();
    for (k, scene) in world.scenes.iter().enumerate().filter(|(_, s)| s.shown) {
        let own = volumes
            .iter()
            .find(|parent| parent.parent().to_bits() == scene.id.0);
        let (Some(parent), Some(bake), Some(placement)) = (own, &scene.bake, &scene.placement)
        else {
            continue;
        };
        let strength = roots.get(parent.parent()).map_or(0.0, |fog| fog.intensity);
        if strength > 0.0 && strength.is_finite() {
            let bounds = bake.info().bounds.map(Vec3::from_array);
            let [low, high] = bounds;
            let middle = Affine3A::from_translation(0.5 * (low + high));
            let cube = placement.world_from_local * middle * Affine3A::from_scale(high - low);
            // A fog volume without height has no air.
            if cube.matrix3.determinant() == 0.0 {
                continue;
            }
            scenes.push(FogScene {
                scene: scene.id,
                bounds,
                cube,
                strength,
            });
            at.push(k);
        }
    }
    for (id, camera, settings, frustum, layers, parts) in &cameras {
        let Some(intensity) = display_intensity(camera, parts) else {
            continue;
        };
        let layers = layers.cloned().unwrap_or_default();
        let mut lit = Vec::new();
        for (volume, transform) in &fogs {
            let (Some(fog), affine) = (convert_fog(volume, transform), transform.affine()) else {
                continue;
            };
            let cube = Aabb {
                center: Vec3A::ZERO,
                half_extents: Vec3A::splat(0.5),
            };
            if !frustum.intersects_obb(&cube, &affine, true, false) {
                continue;
            }
            for (index, k) in at.iter().enumerate() {
                if in_view(&world.scenes[*k], frustum, &layers)
                    && cubes_overlap(&scenes[index].cube, &affine)
                {
                    lit.push(LitFog {
                        scene: index,
                        fog,
                        density: volume.density_texture.as_ref().map(|image| image.id()),
                    });
                }
            }
        }
        if !lit.is_empty() {
            views.push(ExtractedFogView {
                id: ViewId(id.to_bits()),
                pixels: (camera.physical_viewport_size())
                    .map_or(0, |size| u64::from(size.x) * u64::from(size.y)),
                steps: settings.step_count,
                intensity,
                lit,
            });
        }
    }
}

/// Warns once if fog that a scene lights also has ambient light. Runs in
/// [`GiSystems::Validate`](crate::plugin::GiSystems::Validate).
pub(crate) fn check_fog(
    settings: Res<GiSettings>,
    lit: Query<&GiVolumetricFog>,
    volumes: Query<(), With<Voxels>>,
    fogs: Query<(), With<FogVolume>>,
    light_sources: Query<(), With<VolumetricLight>>,
    cameras: Query<(&Camera, &VolumetricFog, DisplayQuery), Without<GiRsmCamera>>,
    mut findings: ResMut<GiWarnings>,
) {
    let there = !volumes.is_empty() && !fogs.is_empty() && !light_sources.is_empty();
    let shines = |(camera, fog, parts): (&Camera, &VolumetricFog, _)| {
        let ambient = fog.ambient_intensity > 0.0 && rgb(fog.ambient_color) != Vec3::ZERO;
        ambient && display_intensity(camera, parts).is_some()
    };
    if settings.warn_double_counting
        && there
        && lit.iter().any(|fog| fog.intensity > 0.0)
        && cameras.iter().any(shines)
    {
        add_warnings(vec![GiWarning::FogAmbient], &mut findings);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::math::Quat;
    use bevy::transform::components::Transform;

    #[test]
    fn fog_boxes_overlap_unless_separated_by_side() {
        let cube = |x: f32, turn: f32, size: f32| {
            Affine3A::from_scale_rotation_translation(
                Vec3::splat(size),
                Quat::from_rotation_z(turn),
                Vec3::new(x, 0.0, 0.0),
            )
        };
        let one = cube(0.0, 0.0, 1.0);
        assert!(cubes_overlap(&one, &cube(0.9, 0.0, 1.0)));
        assert!(!cubes_overlap(&one, &cube(1.1, 0.0, 1.0)));
        // One within the other, either way.
        assert!(
            cubes_overlap(&one, &cube(3.0, 0.3, 20.0))
                && cubes_overlap(&cube(3.0, 0.3, 20.0), &one)
        );
        // A corner reaches farther than a side.
        assert!(cubes_overlap(&one, &cube(1.1, 0.8, 1.0)));
    }

    #[test]
    fn invalid_fog_volumes_are_skipped() {
        let transform = GlobalTransform::from(Transform::from_xyz(1.0, 2.0, 3.0));
        let fog = FogVolume::default();
        assert!(convert_fog(&fog, &transform).is_some());
        let no = [
            FogVolume {
                density_factor: 0.0,
                ..fog.clone()
            },
            FogVolume {
                density_factor: f32::NAN,
                ..fog.clone()
            },
            FogVolume {
                scattering: 0.0,
                ..fog.clone()
            },
            FogVolume {
                absorption: -1.0,
                ..fog.clone()
            },
            FogVolume {
                light_intensity: f32::INFINITY,
                ..fog.clone()
            },
        ];
        for (k, none) in no.iter().enumerate() {
            assert!(convert_fog(none, &transform).is_none(), "{k}");
        }
        for none in [Vec3::new(1.0, 0.0, 1.0), Vec3::splat(f32::NAN)] {
            let flat = GlobalTransform::from(Transform::from_scale(none));
            assert!(convert_fog(&fog, &flat).is_none());
        }
    }
}
