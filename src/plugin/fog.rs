//! Fog that a level lights: Bevy draws its volumetric fog with lamps and the camera's ambient
//! light; behind that, kernel [`fog`](meshless_gi::internals::frame::fog) adds what the fog sends to the eye
//! of the level's light in free space, which it reads from the level's [`GiIrradianceVolume`].
//!
//! Where Bevy draws no fog there is none: it needs a [`VolumetricLight`] somewhere, and
//! [`VolumetricFog`] on the camera.

use super::camera::GiDebugView;
use super::compute::GiRender;
use super::extract::{ExtractedGi, in_view};
use super::gpu_timings::view_span;
use super::rsm::GiRsmCamera;
use super::settings::GiSettings;
use super::validation::{GiWarning, GiWarnings, add_warnings};
use super::volume::{DisplayParts, ExtractedVolumes, FoundParts, Voxels, displays};
use super::volumetric_fog::GiVolumetricFog;
use crate::gpu::{FogTextures, draw_fog};
use crate::plan::{FogState, FrameStage, Pass, SceneId, ViewId};
use bevy::asset::AssetId;
use bevy::camera::primitives::{Aabb, Frustum};
use bevy::camera::visibility::RenderLayers;
use bevy::camera::{Camera, Camera3d};
use bevy::color::{Color, ColorToComponents, LinearRgba};
use bevy::ecs::hierarchy::ChildOf;
use bevy::ecs::prelude::*;
use bevy::image::Image;
use bevy::light::{FogVolume, VolumetricFog, VolumetricLight};
use bevy::math::{Affine3A, Mat4, Vec3, Vec3A};
use bevy::render::Extract;
use bevy::render::camera::{ExtractedCamera, TemporalJitter};
use bevy::render::diagnostic::RecordDiagnostics;
use bevy::render::render_asset::RenderAssets;
use bevy::render::render_resource::RenderPassDescriptor;
use bevy::render::renderer::{RenderContext, RenderDevice, RenderQueue, ViewQuery};
use bevy::render::texture::{FallbackImage, GpuImage};
use bevy::render::view::{ExtractedView, Msaa, ViewDepthTexture, ViewTarget};
use bevy::transform::components::GlobalTransform;
use meshless_gi::internals::frame::{Fog, FogInscatterParams, FogParams, FogView};

/// A level that lights fog: its bounds, in its own space, and as a cube with edges of 1 that is
/// placed in the world.
struct Level {
    scene: SceneId,
    bounds: [Vec3; 2],
    cube: Affine3A,
    strength: f32,
}

/// A fog volume that a level lights, and the image of its density.
struct LitFog {
    level: usize,
    fog: Fog,
    density: Option<AssetId<Image>>,
}

/// A camera that looks through fog.
struct ExtractedFogView {
    id: ViewId,
    pixels: u64,
    steps: u32,
    intensity: f32,
    lit: Vec<LitFog>,
}

/// All of them, and the levels that light fog: where several lie in one place the first of them
/// does.
#[derive(Resource, Default)]
pub(crate) struct ExtractedFogs {
    levels: Vec<Level>,
    views: Vec<ExtractedFogView>,
}

impl ExtractedFogs {
    /// Whether a camera sees fog that this scene lights.
    pub fn sees(&self, scene: SceneId) -> bool {
        let lights = |fog: &LitFog| self.levels[fog.level].scene == scene;
        self.views.iter().any(|view| view.lit.iter().any(lights))
    }

    /// What the plan is to know.
    pub fn describe(&self) -> Vec<FogState> {
        let of = |view: &ExtractedFogView, level: usize| FogState {
            view: view.id,
            scene: self.levels[level].scene,
            volumes: view.lit.iter().filter(|f| f.level == level).count(),
            pixels: view.pixels,
        };
        let every = |view| (0..self.levels.len()).map(move |level| of(view, level));
        let all = self.views.iter().flat_map(every);
        all.filter(|state| state.volumes > 0).collect()
    }
}

/// What multiplies the light in a camera's fog; none where it shows none of it.
fn shown(camera: &Camera, parts: FoundParts<'_>) -> Option<f32> {
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

/// Bevy's fog in the core's terms; none where that is no fog.
fn fog_of(fog: &FogVolume, transform: &GlobalTransform) -> Option<Fog> {
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

/// Whether two cubes with edges of 1 may overlap: neither lies beyond a side of the other.
fn meet(a: &Affine3A, b: &Affine3A) -> bool {
    let within = |of: &Affine3A, other: &Affine3A| {
        let place = of.inverse() * *other;
        let half = (0..3).fold(Vec3A::ZERO, |sum, k| sum + 0.5 * place.matrix3.col(k).abs());
        (place.translation.abs() - half)
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
        DisplayParts,
    ),
    (With<Camera3d>, Without<GiRsmCamera>),
>;

/// Runs in [`GiRenderSystems::Extract`](super::GiRenderSystems::Extract), behind the scenes and before the
/// volumes.
pub(crate) fn extract_fogs(
    mut out: ResMut<ExtractedFogs>,
    world: Res<ExtractedGi>,
    volumes: Extract<Query<&ChildOf, With<Voxels>>>,
    roots: Extract<Query<&GiVolumetricFog>>,
    fogs: Extract<Query<(&FogVolume, &GlobalTransform)>>,
    lamps: Extract<Query<(), With<VolumetricLight>>>,
    cameras: Extract<FogCameras>,
) {
    let ExtractedFogs { levels, views } = &mut *out;
    levels.clear();
    views.clear();
    if volumes.is_empty() || fogs.is_empty() || lamps.is_empty() {
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
            let bounds = bake.info.bounds.map(Vec3::from_array);
            let [low, high] = bounds;
            let middle = Affine3A::from_translation(0.5 * (low + high));
            let cube = placement.world_from_local * middle * Affine3A::from_scale(high - low);
            // A level without a height has no air.
            if cube.matrix3.determinant() == 0.0 {
                continue;
            }
            levels.push(Level {
                scene: scene.id,
                bounds,
                cube,
                strength,
            });
            at.push(k);
        }
    }
    for (id, camera, settings, frustum, layers, parts) in &cameras {
        let Some(intensity) = shown(camera, parts) else {
            continue;
        };
        let layers = layers.cloned().unwrap_or_default();
        let mut lit = Vec::new();
        for (volume, transform) in &fogs {
            let (Some(fog), affine) = (fog_of(volume, transform), transform.affine()) else {
                continue;
            };
            let cube = Aabb {
                center: Vec3A::ZERO,
                half_extents: Vec3A::splat(0.5),
            };
            if !frustum.intersects_obb(&cube, &affine, true, false) {
                continue;
            }
            for (level, k) in at.iter().enumerate() {
                if in_view(&world.scenes[*k], frustum, &layers)
                    && meet(&levels[level].cube, &affine)
                {
                    lit.push(LitFog {
                        level,
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

type View = (
    &'static ExtractedView,
    &'static ExtractedCamera,
    &'static ViewTarget,
    &'static ViewDepthTexture,
    &'static Msaa,
    Option<&'static TemporalJitter>,
);

/// Runs in [`GiRenderSystems::CompositeFog`](super::GiRenderSystems::CompositeFog).
#[allow(
    clippy::too_many_arguments,
    reason = "a system's parameters are its inputs"
)]
pub(crate) fn draw(
    view: ViewQuery<View>,
    fogs: Res<ExtractedFogs>,
    volumes: Res<ExtractedVolumes>,
    world: Res<ExtractedGi>,
    mut render: ResMut<GiRender>,
    images: Res<RenderAssets<GpuImage>>,
    fallback: Res<FallbackImage>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
    mut ctx: RenderContext,
) {
    let (view, camera, target, depth, msaa, jitter) = view.into_inner();
    let id = ViewId(view.retained_view_entity.main_entity.to_bits());
    let render = &mut *render;
    let Some(fogged) = fogs.views.iter().find(|v| v.id == id) else {
        return;
    };
    let Some(kernels) = &render.kernels else {
        return;
    };
    // From clip space to the world; jittered where the depth was.
    let mut clip_from_view = view.clip_from_view;
    if let (Some(jitter), Some(size)) = (jitter, camera.physical_viewport_size) {
        jitter.jitter_projection(&mut clip_from_view, size.as_vec2());
    }
    // Levels whose light is there.
    let lights_of = |scene: SceneId| {
        let passes = &render.plan.passes;
        let here = |p: &Pass| p.stage == FrameStage::FOG && p.view == Some(id) && p.scene == scene;
        let volume = volumes.find(scene).filter(|_| passes.iter().any(here))?;
        let written = render.scenes.get(&scene)?.volume.texture(volume)?;
        Some((volume, written))
    };
    // Levels and asymmetries, with what a level sends through fog of that one and the volume that
    // says so.
    let mut lights: Vec<(usize, f32)> = Vec::new();
    let (mut sent, mut volumes_of) = (Vec::new(), Vec::new());
    let mut params = Vec::new();
    let mut textures = Vec::new();
    for lit in &fogged.lit {
        let level = &fogs.levels[lit.level];
        let scene = world.scenes.iter().find(|s| s.id == level.scene);
        let placement = scene.and_then(|s| s.placement);
        let (Some(placement), Some((volume, written))) = (placement, lights_of(level.scene)) else {
            continue;
        };
        // As Bevy has it: until its texture is there, fog is even.
        let density = lit.density.and_then(|image| images.get(image));
        let fog = Fog {
            texture: lit.fog.texture.filter(|_| density.is_some()),
            ..lit.fog
        };
        let seen = FogView {
            view_from_clip: clip_from_view.inverse(),
            world_from_view: view.world_from_view.to_matrix(),
            viewport: view.viewport.as_vec4().to_array(),
            exposure: camera.exposure * fogged.intensity * level.strength,
            steps: fogged.steps,
        };
        let world_from_local = Mat4::from(placement.world_from_local);
        let key = (lit.level, fog.asymmetry);
        let light = lights.iter().position(|k| *k == key).unwrap_or_else(|| {
            let shape = volume.shape();
            let of = FogInscatterParams::new(&seen, fog.asymmetry, shape, &world_from_local);
            lights.push(key);
            sent.push(of);
            volumes_of.push(written);
            lights.len() - 1
        });
        let place = Affine3A::from_mat4(fog.world_from_local);
        let earlier: Vec<Mat4> = (fogs.levels[..lit.level].iter())
            .filter(|other| meet(&other.cube, &level.cube) && meet(&other.cube, &place))
            .filter(|other| lights_of(other.scene).is_some())
            .map(|other| other.cube.into())
            .collect();
        params.push(FogParams::new(
            &seen,
            &fog,
            volume.shape(),
            level.bounds,
            &world_from_local,
            &earlier,
        ));
        let density = density.unwrap_or(&fallback.d3);
        textures.push((light, written, volume.sampler(), density));
    }
    let readable = wgpu::TextureUsages::TEXTURE_BINDING;
    if params.is_empty() || !depth.texture.usage().contains(readable) {
        render.fogs.remove(&id);
        return;
    }
    let buffers = render.fogs.entry(id).or_default();
    buffers.write(device.wgpu_device(), &queue, &sent, &params);
    let recorder = ctx.diagnostic_recorder();
    let recorder = recorder.as_deref();
    let whole = recorder.time_span(ctx.command_encoder(), "meshless_gi_fog");
    let timed = recorder.time_span(ctx.command_encoder(), view_span(FrameStage::FOG, id));
    let recorded = buffers.record(kernels, ctx.command_encoder(), &volumes_of);
    let mut pass = ctx
        .command_encoder()
        .begin_render_pass(&RenderPassDescriptor {
            label: Some("meshless_gi fog"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                // Several samples a pixel are one by now.
                view: target.main_texture_view(),
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Load,
                    store: wgpu::StoreOp::Store,
                },
            })],
            depth_stencil_attachment: None,
            timestamp_writes: None,
            occlusion_query_set: None,
            multiview_mask: None,
        });
    let [x, y, width, height] = view.viewport.to_array();
    pass.set_viewport(x as f32, y as f32, width as f32, height as f32, 0.0, 1.0);
    pass.set_scissor_rect(x, y, width, height);
    for (which, (light, voxels, between, density)) in textures.iter().enumerate() {
        let textures = FogTextures {
            depth: depth.view(),
            sampled: *msaa != Msaa::Off,
            voxels,
            between,
            density: (&density.texture_view, &density.sampler),
        };
        let format = view.target_format;
        draw_fog(
            kernels, &mut pass, format, buffers, which, *light, &textures,
        );
    }
    drop(pass);
    timed.end(ctx.command_encoder());
    whole.end(ctx.command_encoder());
    render.retired.add(&recorded);
    render.retired.fogs += params.len() as u64;
}

/// Says once where ambient light is in fog that a level lights. Runs in
/// [`GiSystems::Validate`](super::GiSystems::Validate).
pub(crate) fn check_fog(
    settings: Res<GiSettings>,
    lit: Query<&GiVolumetricFog>,
    volumes: Query<(), With<Voxels>>,
    fogs: Query<(), With<FogVolume>>,
    lamps: Query<(), With<VolumetricLight>>,
    cameras: Query<(&Camera, &VolumetricFog, DisplayParts), Without<GiRsmCamera>>,
    mut findings: ResMut<GiWarnings>,
) {
    let there = !volumes.is_empty() && !fogs.is_empty() && !lamps.is_empty();
    let shines = |(camera, fog, parts): (&Camera, &VolumetricFog, _)| {
        let ambient = fog.ambient_intensity > 0.0 && rgb(fog.ambient_color) != Vec3::ZERO;
        ambient && shown(camera, parts).is_some()
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
        assert!(meet(&one, &cube(0.9, 0.0, 1.0)));
        assert!(!meet(&one, &cube(1.1, 0.0, 1.0)));
        // One within the other, either way.
        assert!(meet(&one, &cube(3.0, 0.3, 20.0)) && meet(&cube(3.0, 0.3, 20.0), &one));
        // A corner reaches farther than a side.
        assert!(meet(&one, &cube(1.1, 0.8, 1.0)));
    }

    #[test]
    fn invalid_fog_volumes_are_skipped() {
        let place = GlobalTransform::from(Transform::from_xyz(1.0, 2.0, 3.0));
        let fog = FogVolume::default();
        assert!(fog_of(&fog, &place).is_some());
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
            assert!(fog_of(none, &place).is_none(), "{k}");
        }
        for none in [Vec3::new(1.0, 0.0, 1.0), Vec3::splat(f32::NAN)] {
            let flat = GlobalTransform::from(Transform::from_scale(none));
            assert!(fog_of(&fog, &flat).is_none());
        }
    }
}
