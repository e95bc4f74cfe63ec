//! Description of a frame for the plan, without an engine and without a device.

use super::{
    BounceSelection, ColorModeSelection, FmmLimit, FrameStage, Inventory, SkipReason, TierSelection,
};
use std::collections::BTreeSet;
use std::fmt;

/// Identifier of a baked scene's instance. The caller chooses the number. The plugin takes the
/// entity's bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SceneId(pub u64);

impl SceneId {
    /// Scene for passes that belong to no bake: those of dynamic objects, and of views without a
    /// bake.
    pub const WORLD: Self = Self(u64::MAX);
}

impl fmt::Display for SceneId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::WORLD => f.write_str("the world"),
            Self(id) => write!(f, "scene {id:x}"),
        }
    }
}

/// Identifier of a light that requests a bounce off dynamic objects: the caller's number, and an
/// index for an entity with several lights.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct LightId(pub u64, pub u8);

impl fmt::Display for LightId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:x}.{}", self.0, self.1)
    }
}

/// Identifier of a view (a camera with indirect light).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ViewId(pub u64);

/// Change of a light slot since the device last computed it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SlotChange {
    /// Same light as before.
    #[default]
    None,
    /// Another color or intensity. The projection stays valid.
    Color,
    /// Another position, direction or range, or a new light. It must be projected again.
    Geometry,
}

/// Requests of lights with soft shadows in a scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SoftShadowState {
    /// Number of lights that cast them in the scene.
    pub lights: usize,
    /// `true` if the bake's points have visibility.
    pub has_visibility: bool,
    /// `true` if the device holds the shadowed irradiance of these lights in their current state.
    pub held: bool,
    /// Bytes of the largest buffer on the device, if it is too large.
    pub largest_buffer: u64,
    /// Number of points with visibility.
    pub points: u64,
}

/// Requests of cameras without a G-buffer, and of fog: the scene's probe irradiance as a volume.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct VolumeState {
    /// `true` if the scene is to have a volume and there is a texture for it.
    pub requested: bool,
    /// `true` if the scene is in the view of one of those cameras, or fog in it of any camera.
    pub is_visible: bool,
    /// `true` if the texture holds the light of an earlier frame for the current volume.
    pub held: bool,
    /// Number of voxels.
    pub voxels: u64,
}

/// State of a baked scene in the world.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneState {
    /// Identifier of the scene.
    pub id: SceneId,
    /// `true` if the baked asset is loaded.
    pub loaded: bool,
    /// `true` if the device holds this very bake (not an older one).
    pub resident: bool,
    /// `true` if the world shows the scene (it is not hidden).
    pub shown: bool,
    /// Bytes of the largest buffer that the scene needs on the device. [`u64::MAX`] if another
    /// limit excludes the scene.
    pub largest_buffer: u64,
    /// Changes, one entry per light slot. If the device does not hold the bake, every slot with
    /// light is [`SlotChange::Geometry`].
    pub slots: Vec<SlotChange>,
    /// `true` if sky radiance, emission, number of bounces or tier differ from the device's.
    pub settings_changed: bool,
    /// `true` if the scene's transport is out of date for another reason (a slot was freed).
    pub stale: bool,
    /// Number of frames since the scene was last in a view.
    pub idle_frames: u32,
    /// `true` if the coefficients are requested on the CPU (for gizmos).
    pub read_back: bool,
    /// `true` if the dynamic materials differ from those on the device.
    pub materials_changed: bool,
    /// Number of occluders that differ from the device's.
    pub occluders_changed: usize,
    /// Number of link terms that occluders intersect.
    pub occluded_link_terms: u64,
    /// `true` if the bake has probes.
    pub probes: bool,
    /// Number of links in the rows of the probes.
    pub probe_links: u64,
    /// Requests of cameras without a G-buffer, and of fog.
    pub volume: VolumeState,
    /// Treatment of the sky.
    pub sky: SkyUse,
    /// Requests of lights with soft shadows.
    pub soft: SoftShadowState,
    /// Operator tier of its frames, with the reason. `None` until the bake is loaded.
    pub tier: Option<TierSelection>,
    /// Number of channels in which links are applied, with the reason. `None` until the bake is
    /// loaded.
    pub channels: Option<ColorModeSelection>,
    /// Number of reflections, with the reason. `None` until the bake is loaded, or if it holds its
    /// bounces.
    pub bounces: Option<BounceSelection>,
    /// Number of shadow rays per projection of a light slot.
    pub rays: u64,
    /// Limit because of which its frames use links in place of its octree
    /// ([`fmm_fallback_reason`](super::fmm_fallback_reason)). `None` if they do not, or if there is
    /// no octree.
    pub no_octree: Option<FmmLimit>,
}

impl SceneState {
    /// Creates a scene that is loaded and shown, has no data on the device, and has no lights.
    #[must_use]
    pub fn new(id: SceneId) -> Self {
        Self {
            id,
            loaded: true,
            resident: false,
            shown: true,
            largest_buffer: 0,
            slots: Vec::new(),
            settings_changed: false,
            stale: false,
            idle_frames: 0,
            read_back: false,
            materials_changed: false,
            occluders_changed: 0,
            occluded_link_terms: 0,
            probes: false,
            probe_links: 0,
            volume: VolumeState::default(),
            sky: SkyUse::Uniform,
            soft: SoftShadowState::default(),
            tier: None,
            channels: None,
            bounces: None,
            rays: 0,
            no_octree: None,
        }
    }
}

/// Treatment of a scene's sky.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SkyUse {
    /// The sky is uniform, or there is none.
    #[default]
    Uniform,
    /// The sky varies, and the bake has its terms.
    Terms,
    /// The sky varies, and the bake has a uniform sky only. The mean is used.
    Mean,
}

impl fmt::Display for SkyUse {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Uniform => "a uniform sky",
            Self::Terms => "eight terms of a sky that varies",
            Self::Mean => "the mean of its sky: the bake stores a uniform sky only",
        })
    }
}

/// Pixels at which a view evaluates indirect light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DisplayUse {
    /// A fraction of the pixels, with interpolation in between.
    #[default]
    Subsplats,
    /// All pixels, as its settings request.
    Full,
    /// All pixels, because the device has no room for the buffers of subsplats.
    BuffersTooLarge,
}

impl DisplayUse {
    /// Returns the choice in words.
    #[must_use]
    pub fn choice(self) -> &'static str {
        match self {
            Self::Subsplats => "subsplats",
            Self::Full | Self::BuffersTooLarge => "every pixel",
        }
    }

    /// Returns the reason of the choice.
    #[must_use]
    pub fn description(self) -> &'static str {
        match self {
            Self::Subsplats => "light varies less than pixels do",
            Self::Full => "requested",
            Self::BuffersTooLarge => "the subsplat buffers exceed a limit of the device",
        }
    }
}

/// State of a camera with display settings.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewState {
    /// Identifier of the view.
    pub id: ViewId,
    /// `true` if its settings turn indirect light on.
    pub enabled: bool,
    /// `true` if it draws a G-buffer (deferred, high dynamic range, one sample per pixel).
    pub has_gbuffer: bool,
    /// `true` if it shows the specular reflection of virtual lights.
    pub specular: bool,
    /// `true` if it shows the full picture with direct light, from which soft shadows are
    /// subtracted.
    pub lit: bool,
    /// `true` if its irradiance is added to a picture. `false` for a forward camera, whose surfaces
    /// read the irradiance.
    pub has_picture: bool,
    /// Number of pixels that it draws.
    pub pixels: u64,
    /// Pixels at which it evaluates indirect light.
    pub display: DisplayUse,
    /// Stages whose buffers the device cannot hold at the size of the view.
    pub refused: BTreeSet<FrameStage>,
    /// Scenes whose box meets its frustum.
    pub sees: Vec<SceneId>,
}

impl ViewState {
    /// Creates a deferred view of no pixels that shows the final picture and contains no scene.
    #[must_use]
    pub fn new(id: ViewId) -> Self {
        Self {
            id,
            enabled: true,
            has_gbuffer: true,
            specular: false,
            lit: true,
            has_picture: true,
            pixels: 0,
            display: DisplayUse::Subsplats,
            refused: BTreeSet::new(),
            sees: Vec::new(),
        }
    }

    /// Returns `true` if it shows indirect light over its surfaces.
    #[must_use]
    pub fn displays(&self) -> bool {
        self.enabled && self.has_gbuffer
    }

    /// Returns `true` if it shows the light of this scene over its surfaces.
    #[must_use]
    pub fn shows(&self, scene: SceneId) -> bool {
        self.displays() && self.sees.contains(&scene)
    }
}

/// State of a light that requests a bounce off dynamic objects.
#[derive(Clone, Debug, PartialEq)]
pub struct BounceState {
    /// Identifier of the light.
    pub id: LightId,
    /// Number of reflective shadow maps that show dynamic objects in its light
    /// ([`map_views`](super::map_views)). The error is the reason why there is none.
    pub maps: Result<u32, SkipReason>,
    /// Number of texels of a map.
    pub texels_per_map: u64,
    /// Views that may show its light.
    pub views: Vec<ViewId>,
}

/// Fog in a camera's view, in a scene with a volume. The camera needs no display settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FogState {
    /// Camera with the fog in its view.
    pub view: ViewId,
    /// Scene of the fog.
    pub scene: SceneId,
    /// Number of fog volumes.
    pub volumes: usize,
    /// Number of pixels that the camera draws.
    pub pixels: u64,
}

/// State of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameState {
    /// `true` if the device supports the kernels.
    pub is_device_supported: bool,
    /// Largest buffer that the device binds, bytes.
    pub largest_binding: u64,
    /// Number of frames out of view after which a scene's buffers are released.
    pub unload_after_frames: u32,
    /// Baked scenes of the world.
    pub scenes: Vec<SceneState>,
    /// Cameras with display settings.
    pub views: Vec<ViewState>,
    /// Lights that request a bounce off dynamic objects.
    pub bounces: Vec<BounceState>,
    /// `true` if the virtual lights on the device are still valid for all of them.
    pub virtual_lights_valid: bool,
    /// Fog by camera and scene.
    pub fogs: Vec<FogState>,
    /// Inventory of the world.
    pub inventory: Inventory,
}

impl FrameState {
    /// Finds a baked scene.
    #[must_use]
    pub fn scene(&self, id: SceneId) -> Option<&SceneState> {
        self.scenes.iter().find(|s| s.id == id)
    }

    /// Number of pixels that a view draws, or 0 for a view without display settings.
    #[must_use]
    pub fn pixels(&self, view: Option<ViewId>) -> u64 {
        let found = self.views.iter().find(|v| Some(v.id) == view);
        found.map_or(0, |v| v.pixels)
    }

    /// Checks that a scene takes part in the frame.
    ///
    /// # Errors
    /// The reason why it does not.
    pub fn check_active(&self, scene: &SceneState) -> Result<(), SkipReason> {
        if !self.is_device_supported {
            Err(SkipReason::DeviceUnsupported)
        } else if !scene.loaded {
            Err(SkipReason::AssetMissing)
        } else if scene.largest_buffer == u64::MAX {
            Err(SkipReason::BeyondLimits)
        } else if scene.largest_buffer > self.largest_binding {
            Err(SkipReason::TooLarge {
                needs: scene.largest_buffer,
                has: self.largest_binding,
            })
        } else if !scene.shown {
            Err(SkipReason::Hidden)
        } else if !self.is_displayed(scene) {
            Err(SkipReason::NotInView)
        } else {
            Ok(())
        }
    }

    /// Returns the scenes that take part in the frame.
    pub fn active_scenes(&self) -> impl Iterator<Item = &SceneState> {
        self.scenes.iter().filter(|s| self.check_active(s).is_ok())
    }

    /// Returns `true` if a view shows the scene over its G-buffer, or a camera without a G-buffer
    /// or with fog shows its volume.
    fn is_displayed(&self, scene: &SceneState) -> bool {
        scene.volume.requested && scene.volume.is_visible || self.is_shown(scene.id)
    }

    /// Returns `true` if a view shows the scene over its G-buffer.
    #[must_use]
    pub fn is_shown(&self, scene: SceneId) -> bool {
        self.views.iter().any(|view| view.shows(scene))
    }

    /// Returns the number of maps that a light's bounce takes.
    ///
    /// # Errors
    /// Returns the reason why there is none.
    pub fn maps_of(&self, light: &BounceState) -> Result<u32, SkipReason> {
        let shown = |id: &ViewId| self.views.iter().any(|v| v.id == *id && v.displays());
        match light.maps {
            _ if !self.is_device_supported => Err(SkipReason::DeviceUnsupported),
            Ok(_) if !light.views.iter().any(shown) => Err(SkipReason::NotInView),
            maps => maps,
        }
    }
}

impl Default for FrameState {
    /// Creates a frame with a capable device, WebGPU's default binding size and an empty world.
    fn default() -> Self {
        Self {
            is_device_supported: true,
            largest_binding: 128 << 20,
            unload_after_frames: 120,
            scenes: Vec::new(),
            views: Vec::new(),
            bounces: Vec::new(),
            virtual_lights_valid: false,
            fogs: Vec::new(),
            inventory: Inventory::default(),
        }
    }
}
