//! Soft shadows of Bevy's rectangle and point lights: the component that asks for them, the lamps
//! as the render world needs them, and what scenes and views hold of them on the device. The
//! kernels are [`soft_shadow`](meshless_gi::internals::frame::soft_shadow) and [`subtract_shadow`](meshless_gi::internals::frame::subtract_shadow).
//!
//! Bevy draws such a lamp without shadows. What of its light does not get there is taken from the
//! picture, pixel by pixel: its own light is replaced, not doubled, and nothing but it is touched.

use super::asset::GiBakedScene;
use super::composite::screen_texture;
use super::extract::{LightKey, LightKind, LightParts, LightPartsItem};
use super::scene::GiScene;
use super::settings::GiSettings;
use super::transform::SimilarityTransform;
use super::validation::{GiWarning, GiWarnings, add_warnings};
use crate::gpu::{
    GpuCounters, GpuError, KernelPipelines, SceneBuffers, SoftShadowBuffers, SplatTargets,
    SubtractShadowBuffers, ViewBuffers,
};
use crate::plan::{SceneId, SoftState, same_soft_shadow, soft_light_affects};
use bevy::asset::Assets;
use bevy::camera::visibility::{InheritedVisibility, RenderLayers};
use bevy::ecs::prelude::*;
use bevy::light::{DirectionalLight, PointLight, RectLight, SpotLight};
use bevy::pbr::{AreaLightLuts, MAX_RECT_LIGHTS};
use bevy::reflect::prelude::*;
use bevy::render::Extract;
use bevy::render::render_asset::RenderAssets;
use bevy::render::texture::GpuImage;
use meshless_gi::internals::frame::SoftLight;
use meshless_gi::{BakedScene, Bounds, Light};
use std::collections::BTreeMap;

/// This lamp casts soft shadows, without a shadow map: on baked surfaces, from baked surfaces. Goes
/// on a [`RectLight`] or a [`PointLight`] whose `shadow_maps_enabled` is off; a point light is a
/// sphere of its `radius`. The bake must remember what its points see (recipe field
/// `soft_shadows`).
///
/// Taken away is the light that Bevy draws and that does not get there: of a rectangle all of it,
/// of a point light what is diffuse; its highlights stay. What moves, and what no basis function
/// reaches, keeps Bevy's light and casts no such shadow. Indirect light has its own shadows, with
/// or without this.
#[derive(Component, Reflect, Clone, Copy, Debug, PartialEq, Eq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
pub struct GiSoftShadow {
    /// Samples of the lamp, about, 1 to 256. Each costs two look-ups of what every point remembers,
    /// in frames in which the lamp moves.
    pub samples: u32,
}

impl Default for GiSoftShadow {
    fn default() -> Self {
        Self { samples: 25 }
    }
}

/// A lamp with soft shadows, in world space.
pub(crate) struct ExtractedSoftLight {
    key: LightKey,
    layers: RenderLayers,
    light: SoftLight,
}

/// All of them, always in the same order.
#[derive(Resource, Default)]
pub(crate) struct ExtractedSoft {
    lights: Vec<ExtractedSoftLight>,
    /// The tables by which Bevy draws rectangles.
    tables: Option<wgpu::TextureView>,
}

/// The tables by which Bevy draws rectangle lights; none where it draws no such light, for without
/// its feature `area_light_luts` it holds a placeholder.
fn tables_of(
    luts: Option<&AreaLightLuts>,
    images: Option<&RenderAssets<GpuImage>>,
) -> Option<wgpu::TextureView> {
    let (luts, images) = luts.zip(images)?;
    let image = images.get(&luts.image)?;
    let there = image.texture_descriptor.size.width > 1;
    there.then(|| wgpu::TextureView::clone(&image.texture_view))
}

/// Runs in [`GiRenderSystems::Extract`](super::GiRenderSystems::Extract).
pub(crate) fn extract_soft(
    mut out: ResMut<ExtractedSoft>,
    points: Extract<Query<(LightParts, &PointLight, &GiSoftShadow)>>,
    rects: Extract<Query<(LightParts, &RectLight, &GiSoftShadow)>>,
    all_rects: Extract<Query<&InheritedVisibility, With<RectLight>>>,
    luts: Option<Res<AreaLightLuts>>,
    images: Option<Res<RenderAssets<GpuImage>>>,
) {
    out.lights.clear();
    out.tables = match rects.is_empty() {
        true => None,
        false => tables_of(luts.as_deref(), images.as_deref()),
    };
    let drawn = out.tables.is_some();
    let mut push = |parts: &LightPartsItem, kind, light| {
        out.lights.push(ExtractedSoftLight {
            key: (parts.entity.to_bits(), kind),
            layers: parts.layers.cloned().unwrap_or_default(),
            light,
        });
    };
    for (parts, light, soft) in &points {
        if parts.is_visible() && !light.shadow_maps_enabled {
            let core = parts.point_times(light, 1.0);
            push(&parts, LightKind::Point, sphere(&core, light.radius, soft));
        }
    }
    // Of more than these Bevy draws some, and nobody can tell which.
    let few = all_rects.iter().filter(|v| v.get()).count() <= MAX_RECT_LIGHTS;
    if few && drawn {
        for (parts, light, soft) in &rects {
            if let (true, Some(core)) = (parts.is_visible(), parts.rect_times(light, 1.0)) {
                let light = rectangle(&core, light.range, soft);
                push(&parts, LightKind::Rect, light);
            }
        }
    }
    out.lights.sort_unstable_by_key(|light| light.key);
}

fn sphere(light: &Light, radius: f32, soft: &GiSoftShadow) -> SoftLight {
    match *light {
        Light::Point {
            position,
            intensity,
            range,
        } => SoftLight::sphere(position, radius, intensity, range, soft.samples),
        _ => SoftLight::default(),
    }
}

fn rectangle(light: &Light, range: f32, soft: &GiSoftShadow) -> SoftLight {
    // Bevy's shortest range is a centimeter.
    SoftLight::from_light(light, soft.samples)
        .map_or_else(SoftLight::default, |l| l.within(range.max(0.01)))
}

/// What an instance of a baked scene knows of lamps with soft shadows.
#[derive(Default)]
pub(crate) struct SceneSoft {
    /// Those that shine there, in its local space.
    wanted: Vec<(RenderLayers, SoftLight)>,
    /// What the device holds, and for which lamps.
    held: Option<(SoftShadowBuffers, Vec<SoftLight>)>,
    /// Bytes of a buffer that did not fit the device.
    too_large: u64,
}

impl SceneSoft {
    /// Looks at the lamps of the frame, and says what they ask of the scene.
    pub fn observe(
        &mut self,
        world: &ExtractedSoft,
        bake: &BakedScene,
        bounds: Bounds,
        layers: &RenderLayers,
        placement: &SimilarityTransform,
    ) -> SoftState {
        let local_from_world = placement.matrix();
        self.wanted.clear();
        for light in world.lights.iter().filter(|l| l.layers.intersects(layers)) {
            let local = light.light.to_local(&local_from_world);
            if soft_light_affects(&local, bounds) {
                self.wanted.push((light.layers.clone(), local));
            }
        }
        let tolerance = 1e-5 * bounds.size().length();
        let alike = |(_, held): &(SoftShadowBuffers, Vec<SoftLight>)| {
            same_soft_shadow(held, &self.lights(), tolerance)
        };
        SoftState {
            lights: self.wanted.len(),
            remembers: bake.visibility.is_some(),
            held: self.held.as_ref().is_some_and(alike),
            largest_buffer: self.too_large,
            points: (bake.visibility.as_ref()).map_or(0, |v| v.points.len() as u64),
        }
    }

    fn lights(&self) -> Vec<SoftLight> {
        self.wanted.iter().map(|(_, light)| *light).collect()
    }

    /// Records what is missing of the lamps at the scene's points.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], see [`SoftShadowBuffers::new`]: the plan knows of it from then on.
    pub fn record(
        &mut self,
        kernels: &KernelPipelines,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        scene: &SceneBuffers,
        bake: &BakedScene,
    ) -> Result<(), GpuError> {
        let lights = self.lights();
        let Some(visibility) = &bake.visibility else {
            return Ok(());
        };
        let mut record = || -> Result<(), GpuError> {
            if self.held.is_none() {
                let device = kernels.device();
                let buffers =
                    SoftShadowBuffers::new(device, queue, scene, visibility, lights.len())?;
                self.held = Some((buffers, Vec::new()));
            }
            if let Some((buffers, held)) = &mut self.held {
                buffers.record(kernels, queue, encoder, scene, &lights)?;
                held.clone_from(&lights);
            }
            Ok(())
        };
        let recorded = record();
        if let Err(GpuError::TooLarge { bytes, .. }) = &recorded {
            self.too_large = *bytes;
        }
        recorded
    }

    /// True while lamps cast soft shadows here.
    pub fn asked(&self) -> bool {
        !self.wanted.is_empty()
    }

    /// Frees what the device holds, and says what was recorded with it.
    pub fn release(&mut self) -> Option<GpuCounters> {
        self.held.take().map(|(buffers, _)| buffers.counters())
    }

    /// What was recorded, and buffers and bytes of it.
    pub fn size(&self) -> Option<(GpuCounters, u32, u64)> {
        let (buffers, _) = self.held.as_ref()?;
        Some((buffers.counters(), buffers.count(), buffers.bytes()))
    }
}

/// One scene in a view, as its soft shadows need it.
pub(crate) struct Shaded<'a> {
    pub id: SceneId,
    pub soft: &'a SceneSoft,
    pub scene: &'a SceneBuffers,
    pub view: &'a ViewBuffers,
}

/// What a view holds on the device of lamps with soft shadows: radiance to take, twice where it
/// sees several scenes.
pub(crate) struct ViewShade {
    size: [u32; 2],
    radiance: [Option<wgpu::TextureView>; 2],
    scenes: BTreeMap<SceneId, SubtractShadowBuffers>,
    last: usize,
}

impl ViewShade {
    /// Records the radiance to take of every pixel, with room made where there is none. Answers
    /// with what was recorded; the view holds nothing where there is nothing to take.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] for more lamps than the device binds.
    #[expect(
        clippy::too_many_arguments,
        reason = "a view, what shades it, and what it is recorded with"
    )]
    pub fn record(
        held: &mut Option<Self>,
        kernels: &KernelPipelines,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        (depth, gbuffer): (&wgpu::TextureView, &wgpu::TextureView),
        size: [u32; 2],
        layers: &RenderLayers,
        world: &ExtractedSoft,
        scenes: &[Shaded<'_>],
    ) -> Result<GpuCounters, GpuError> {
        let mut recorded = GpuCounters::default();
        let ready: Vec<(&Shaded<'_>, &SoftShadowBuffers)> = (scenes.iter())
            .filter_map(|s| s.soft.held.as_ref().map(|(buffers, _)| (s, buffers)))
            .collect();
        if ready.is_empty() {
            *held = None;
            return Ok(recorded);
        }
        let device = kernels.device();
        let view = match held.take() {
            Some(view) if view.size == size => held.insert(view),
            _ => held.insert(Self {
                size,
                radiance: [None, None],
                scenes: BTreeMap::new(),
                last: 0,
            }),
        };
        (view.scenes).retain(|id, _| ready.iter().any(|(s, _)| s.id == *id));
        for (turn, made) in view.radiance.iter_mut().enumerate() {
            match turn < ready.len() {
                true => {
                    made.get_or_insert_with(|| {
                        screen_texture(device, "meshless_gi subtract_shadow", size)
                    });
                }
                false => *made = None,
            }
        }
        for (turn, (shaded, soft)) in ready.into_iter().enumerate() {
            // Those that Bevy draws in this view.
            let lights: Vec<SoftLight> = (shaded.soft.wanted.iter())
                .filter(|(of, _)| of.intersects(layers))
                .map(|(_, light)| *light)
                .collect();
            let buffers = match view.scenes.entry(shaded.id) {
                std::collections::btree_map::Entry::Occupied(there) => there.into_mut(),
                std::collections::btree_map::Entry::Vacant(free) => {
                    free.insert(SubtractShadowBuffers::new(device, lights.len())?)
                }
            };
            let gloss = world.tables.is_some();
            buffers.write(kernels, queue, shaded.scene, &lights, gloss)?;
            let [first, second] = [&view.radiance[turn % 2], &view.radiance[1 - turn % 2]];
            let Some(output) = first else { continue };
            let before = buffers.counters();
            buffers.record(
                kernels,
                encoder,
                shaded.scene,
                soft,
                shaded.view,
                &SplatTargets {
                    depth,
                    gbuffer,
                    earlier: second.as_ref().filter(|_| turn > 0),
                    output,
                },
                world.tables.as_ref(),
            );
            recorded.add(&buffers.counters().since(&before));
            view.last = turn % 2;
        }
        Ok(recorded)
    }

    /// What was recorded last.
    pub fn radiance(&self) -> Option<&wgpu::TextureView> {
        self.radiance[self.last].as_ref()
    }

    /// Buffers, and bytes of them and the textures.
    pub fn size(&self) -> (u32, u64) {
        let texture = 8 * u64::from(self.size[0]) * u64::from(self.size[1]);
        let textures = self.radiance.iter().flatten().count() as u64 * texture;
        let (count, bytes) =
            (self.scenes.values()).fold((0, 0), |(n, b), s| (n + s.count(), b + s.bytes()));
        (count, textures + bytes)
    }
}

/// Says once what lamps with [`GiSoftShadow`] lack. Runs in
/// [`GiSystems::Validate`](super::GiSystems::Validate).
#[allow(
    clippy::type_complexity,
    reason = "a system's parameters are its inputs"
)]
pub(crate) fn check_soft(
    settings: Res<GiSettings>,
    lamps: Query<
        (
            Option<&PointLight>,
            Has<RectLight>,
            Has<SpotLight>,
            Has<DirectionalLight>,
        ),
        With<GiSoftShadow>,
    >,
    rects: Query<&InheritedVisibility, With<RectLight>>,
    scenes: Query<&GiScene>,
    assets: Option<Res<Assets<GiBakedScene>>>,
    mut findings: ResMut<GiWarnings>,
) {
    if !settings.warn_double_counting || lamps.is_empty() {
        return;
    }
    let mut found = Vec::new();
    for (point, rect, spot, directional) in &lamps {
        if spot || directional || (point.is_none() && !rect) {
            found.push(GiWarning::SoftShadowKind);
        }
        if point.is_some_and(|light| light.shadow_maps_enabled) {
            found.push(GiWarning::SoftShadowTwice);
        }
    }
    if lamps.iter().any(|(_, rect, ..)| rect)
        && rects.iter().filter(|v| v.get()).count() > MAX_RECT_LIGHTS
    {
        found.push(GiWarning::SoftShadowCount);
    }
    let forgetful = |gi: &GiScene| {
        let asset = assets.as_ref().and_then(|a| a.get(&gi.0));
        asset.is_some_and(|asset| asset.scene.visibility.is_none())
    };
    if scenes.iter().any(forgetful) {
        found.push(GiWarning::NoVisibility);
    }
    add_warnings(found, &mut findings);
}
