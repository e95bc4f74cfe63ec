//! The components and resources that a game sets: which scene has baked light, which camera shows
//! it, how lights take part.
//!
//! All are reflected and registered, so that scenes and inspectors see them. Light quantities are
//! Bevy's photometric ones (lux, cd/m²); the core's W stand for lumens one to one.

use super::asset::GiBakedScene;
use super::quality::{GiActiveTier, GiQuality};
use super::splatting::GiSplatting;
use crate::plan::ColorModeRequest;
use bevy::asset::Handle;
use bevy::camera::{Hdr, visibility::Visibility};
use bevy::color::LinearRgba;
use bevy::core_pipeline::prepass::{DeferredPrepass, DepthPrepass, NormalPrepass};
use bevy::ecs::lifecycle::HookContext;
use bevy::ecs::prelude::*;
use bevy::ecs::world::DeferredWorld;
use bevy::reflect::prelude::*;
use bevy::render::view::Msaa;
use bevy::transform::components::Transform;

/// Lights a scene indirectly with a bake. Goes on the scene's root: its
/// [`GlobalTransform`](bevy::transform::components::GlobalTransform) moves, turns and scales the
/// bake. A scale that is not the same along all axes cannot be followed; its mean is taken, with
/// one warning.
///
/// `RenderLayers` on the root say which cameras show the bake and which lights take part in it;
/// layer 0 without them.
#[derive(Component, Reflect, Clone, Debug, Default, PartialEq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
#[require(Transform, Visibility, GiLighting, GiQuality, GiActiveTier)]
pub struct GiScene(pub Handle<GiBakedScene>);

/// What lights a baked scene beside Bevy's lights. Goes beside [`GiScene`]; every value may change
/// in any frame.
#[derive(Component, Reflect, Clone, Debug, PartialEq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
pub struct GiLighting {
    /// Radiance of a uniform sky, cd/m²: it comes from every direction that meets nothing. Black
    /// for none. This replaces Bevy's ambient light, and unlike it knows where the walls are.
    pub sky: LinearRgba,
    /// Luminance, in cd/m², that a baked emissive value of 1 stands for. Bevy shows emissive
    /// materials as they are, whatever the exposure; the default is what looks the same at Bevy's
    /// default exposure (EV100 9.7): 1.2 · 2^9.7 ≈ 998. Set 0 to let emissive surfaces not light
    /// anything.
    pub emission: f32,
    /// Diffuse reflections, from 1 (direct light reflected once) to 256; none for as many as the
    /// level's surfaces call for: until further ones would add less than 3 % by the bake's own
    /// bound on what surfaces return, and never more than 16. A bake with baked bounces ignores it.
    pub bounces: Option<u32>,
    /// In how many channels the operator is applied. By default as many as the scene calls for.
    pub channels: GiColorMode,
}

/// In how many channels a bake's operator is applied. One costs less, and is right where every
/// surface is gray and all that shines has one color.
#[derive(Reflect, Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[reflect(Default, Clone, Debug, PartialEq, Hash)]
pub enum GiColorMode {
    /// One where that is right, three else. The plan says which, and why; a light of another color
    /// is seen in the frame in which it shines.
    #[default]
    Auto,
    /// Always three.
    Rgb,
    /// Always one. Where colors differ, green decides and indirect light is white.
    Monochrome,
}

impl From<GiColorMode> for ColorModeRequest {
    fn from(asked: GiColorMode) -> Self {
        match asked {
            GiColorMode::Auto => Self::Auto,
            GiColorMode::Rgb => Self::Three,
            GiColorMode::Monochrome => Self::One,
        }
    }
}

impl Default for GiLighting {
    fn default() -> Self {
        Self {
            sky: LinearRgba::BLACK,
            emission: 998.0,
            bounces: None,
            channels: GiColorMode::Auto,
        }
    }
}

/// Shows indirect light in a camera, and how. Brings the prepasses that the composite reads: it
/// works on deferred, high-dynamic-range cameras with one sample a pixel.
#[derive(Component, Reflect, Clone, Debug, PartialEq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
#[require(Hdr, DepthPrepass, NormalPrepass, DeferredPrepass, Msaa = Msaa::Off, GiSplatting)]
#[component(on_insert = one_sample_a_pixel)]
pub struct GiCamera {
    /// Off runs none of our passes, and what no other camera needs on the device goes. The
    /// prepasses stay: they belong to the camera.
    pub enabled: bool,
    /// Multiplies the indirect light. 1 is what physics says.
    pub intensity: f32,
    /// What to draw.
    pub view: GiDebugView,
}

/// A camera brings Bevy's default of four samples a pixel before ours is asked; deferred drawing
/// has one.
fn one_sample_a_pixel(mut world: DeferredWorld, context: HookContext) {
    if let Some(mut msaa) = world.get_mut::<Msaa>(context.entity) {
        msaa.set_if_neq(Msaa::Off);
    }
}

impl Default for GiCamera {
    fn default() -> Self {
        Self {
            enabled: true,
            intensity: 1.0,
            view: GiDebugView::Lit,
        }
    }
}

/// What a camera draws of the indirect light.
#[derive(Reflect, Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[reflect(Default, Clone, Debug, PartialEq, Hash)]
pub enum GiDebugView {
    /// Direct and indirect light together: the picture.
    #[default]
    Lit,
    /// Indirect light alone.
    Indirect,
    /// Indirect irradiance without the surfaces' colors, as a white surface would show it.
    Irradiance,
}

/// How a light takes part in indirect light. Optional, on any of Bevy's lights; a light without it
/// takes part fully.
#[derive(Component, Reflect, Clone, Debug, PartialEq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
pub struct GiLight {
    /// False: the light gives direct light only.
    pub enabled: bool,
    /// Multiplies the light's indirect share. 1 is what physics says.
    pub intensity: f32,
    /// Samples of a [`RectLight`](bevy::light::RectLight), about; each costs as much as a point
    /// light when the light moves.
    pub patches: u32,
}

impl Default for GiLight {
    fn default() -> Self {
        Self {
            enabled: true,
            intensity: 1.0,
            patches: 16,
        }
    }
}

/// Settings of the plugin as a whole.
#[derive(Resource, Reflect, Clone, Debug, PartialEq)]
#[reflect(Resource, Default, Clone, Debug, PartialEq)]
pub struct GiSettings {
    /// A scene that no camera has seen for this many frames gives its GPU memory back.
    pub keep_frames: u32,
    /// Warn when Bevy's own ambient light or a light probe would be counted beside ours.
    pub warn_double_counting: bool,
}

impl Default for GiSettings {
    fn default() -> Self {
        Self {
            keep_frames: 120,
            warn_double_counting: true,
        }
    }
}
