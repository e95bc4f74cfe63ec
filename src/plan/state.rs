//! The frame as the plan sees it: a plain description, without an engine and without a device.

use super::{BounceSelection, ColorModeSelection, FmmLimit, Inventory, SkipReason, TierSelection};
use std::fmt;

/// Names a baked scene's instance. The caller chooses the number (the plugin takes the entity's
/// bits).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SceneId(pub u64);

impl SceneId {
    /// No baked scene: passes of what moves, and of views that show no bake, belong to the world as
    /// it is.
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

/// Names a light that asks for the bounce of what moves: the caller's number for it, and which of
/// its lights where it has several.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct LightId(pub u64, pub u8);

impl fmt::Display for LightId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:x}.{}", self.0, self.1)
    }
}

/// Names a view (a camera that asks for indirect light).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ViewId(pub u64);

/// How a light slot differs from what the device last computed for it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SlotChange {
    /// Not at all.
    #[default]
    None,
    /// Its color or strength: its projection stays valid.
    Color,
    /// Where it is, where it points or how far it reaches, or it is new: it must be projected
    /// again.
    Geometry,
}

/// What lights with soft shadows ask of a scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SoftState {
    /// How many lights cast them there.
    pub lights: usize,
    /// The bake's points remember what they see.
    pub remembers: bool,
    /// The device holds what these lights do not reach, where they are now.
    pub held: bool,
    /// Bytes of the largest buffer that this needs on the device, where it is known not to fit.
    pub largest_buffer: u64,
    /// Points that remember.
    pub points: u64,
}

/// What cameras without a G-buffer, and fog, ask of a scene: its light in free space as a volume.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct VolumeState {
    /// The scene is to have a volume, and there is a texture for it.
    pub asked: bool,
    /// One of those cameras sees the scene, or any camera fog in it.
    pub seen: bool,
    /// The texture holds the light of an earlier frame, for the volume as it is now.
    pub held: bool,
    /// How many voxels it has.
    pub voxels: u64,
}

/// One baked scene in the world.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneState {
    /// Which one.
    pub id: SceneId,
    /// The baked asset is loaded.
    pub loaded: bool,
    /// The device holds this very bake (not an older one).
    pub resident: bool,
    /// The world shows the scene (it is not hidden).
    pub shown: bool,
    /// Bytes of the largest buffer that the scene needs on the device; the largest number where it
    /// is another limit that refuses the scene.
    pub largest_buffer: u64,
    /// One entry a light slot. Where the device does not hold the bake, every slot that shines is
    /// [`SlotChange::Geometry`].
    pub slots: Vec<SlotChange>,
    /// The sky's radiance, the emission, the number of bounces or the tier differ from what the
    /// device last computed.
    pub settings_changed: bool,
    /// The scene's transport is not what the lights say for another reason (a slot was freed).
    pub stale: bool,
    /// Frames since the scene was last in a view.
    pub idle_frames: u32,
    /// Somebody wants the coefficients back on the CPU (the gizmos).
    pub read_back: bool,
    /// The materials of a bake that lets them change are not those that the device last had.
    pub materials_changed: bool,
    /// So many occluders of the bake do not stand as the device last had them.
    pub occluders_changed: usize,
    /// Parts of links that occluders are in the way of.
    pub passages: u64,
    /// The bake knows light in free space.
    pub probes: bool,
    /// Links of those rows.
    pub probe_links: u64,
    /// What cameras without a G-buffer, and fog, ask of it.
    pub volume: VolumeState,
    /// What becomes of the sky.
    pub sky: SkyUse,
    /// What lights with soft shadows ask of it.
    pub soft: SoftState,
    /// The tier of the operator that its frames use, and why; none where the bake is not known yet.
    pub tier: Option<TierSelection>,
    /// In how many channels links are applied, and why; none where the bake is not known yet.
    pub channels: Option<ColorModeSelection>,
    /// With how many reflections, and why; none where the bake is not known yet, or holds them.
    pub bounces: Option<BounceSelection>,
    /// Shadow rays that a light slot takes when it is projected.
    pub rays: u64,
    /// Why its frames go through links and not through its octree
    /// ([`falls_back`](super::falls_back)); none where they do not, or there is no octree.
    pub no_octree: Option<FmmLimit>,
}

impl SceneState {
    /// A scene that is loaded and shown, holds nothing on the device and has no lights.
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
            passages: 0,
            probes: false,
            probe_links: 0,
            volume: VolumeState::default(),
            sky: SkyUse::Uniform,
            soft: SoftState::default(),
            tier: None,
            channels: None,
            bounces: None,
            rays: 0,
            no_octree: None,
        }
    }
}

/// What becomes of a scene's sky.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SkyUse {
    /// It is the same in all directions, or there is none.
    #[default]
    Uniform,
    /// It varies, and the bake knows its terms.
    Terms,
    /// It varies, and the bake knows a uniform sky only: its mean shines.
    Mean,
}

impl fmt::Display for SkyUse {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Uniform => "a uniform sky",
            Self::Terms => "eight terms of a sky that varies",
            Self::Mean => "the mean of its sky: the bake knows a uniform one only",
        })
    }
}

/// At which pixels a view evaluates indirect light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DisplayUse {
    /// At a fraction of them, and in between by interpolation.
    #[default]
    Subsplats,
    /// At all, as its settings say.
    Full,
    /// At all: the device has no room for what subsplats need.
    NoRoom,
}

impl DisplayUse {
    /// The choice in words.
    #[must_use]
    pub fn choice(self) -> &'static str {
        match self {
            Self::Subsplats => "subsplats",
            Self::Full | Self::NoRoom => "every pixel",
        }
    }

    /// Why.
    #[must_use]
    pub fn why(self) -> &'static str {
        match self {
            Self::Subsplats => "light varies less than pixels do",
            Self::Full => "it is asked for",
            Self::NoRoom => "the device has no room for subsplats",
        }
    }
}

/// One camera that carries the display settings.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewState {
    /// Which one.
    pub id: ViewId,
    /// Its settings say that indirect light is on.
    pub enabled: bool,
    /// It draws a G-buffer (deferred, high dynamic range, one sample a pixel).
    pub has_gbuffer: bool,
    /// It shows the gloss of virtual lights.
    pub gloss: bool,
    /// It shows the picture, direct light and all: what soft shadows are taken from.
    pub lit: bool,
    /// How many pixels it draws.
    pub pixels: u64,
    /// At which of them it evaluates light.
    pub display: DisplayUse,
    /// The scenes whose box meets its frustum.
    pub sees: Vec<SceneId>,
}

/// One light that asks for the bounce of what moves.
#[derive(Clone, Debug, PartialEq)]
pub struct BounceState {
    /// Which one.
    pub id: LightId,
    /// How many reflective shadow maps show what moves in its light; or why none does
    /// ([`map_views`](super::map_views)).
    pub maps: Result<u32, SkipReason>,
    /// The views that may show its light.
    pub views: Vec<ViewId>,
}

/// Fog in a camera's view that lies in a scene with a volume. The camera needs no display settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FogState {
    /// The camera.
    pub view: ViewId,
    /// The scene.
    pub scene: SceneId,
    /// How many fog volumes.
    pub volumes: usize,
    /// How many pixels the camera draws.
    pub pixels: u64,
}

/// The whole frame.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameState {
    /// The device has what the kernels need.
    pub device_able: bool,
    /// The largest buffer, in bytes, that the device binds.
    pub largest_binding: u64,
    /// A scene that no view has seen for this many frames gives its buffers back.
    pub unload_after_frames: u32,
    /// Every baked scene of the world.
    pub scenes: Vec<SceneState>,
    /// Every camera with display settings.
    pub views: Vec<ViewState>,
    /// Every light that asks for the bounce of what moves.
    pub bounces: Vec<BounceState>,
    /// The device holds the virtual lights of all of them as maps drawn now would make them.
    pub bounces_held: bool,
    /// Every camera's fog, scene by scene.
    pub fogs: Vec<FogState>,
    /// What the world has.
    pub inventory: Inventory,
}

impl FrameState {
    /// Finds a baked scene.
    #[must_use]
    pub fn scene(&self, id: SceneId) -> Option<&SceneState> {
        self.scenes.iter().find(|s| s.id == id)
    }

    /// Number of pixels that a view draws; 0 for a view without display settings.
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
        if !self.device_able {
            Err(SkipReason::DeviceUnable)
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

    /// The scenes that take part in the frame.
    pub fn active_scenes(&self) -> impl Iterator<Item = &SceneState> {
        self.scenes.iter().filter(|s| self.check_active(s).is_ok())
    }

    /// Returns `true` if a view shows the scene over its G-buffer, or a camera without a G-buffer
    /// or with fog shows its volume.
    fn is_displayed(&self, scene: &SceneState) -> bool {
        let shows = |v: &ViewState| v.enabled && v.has_gbuffer && v.sees.contains(&scene.id);
        scene.volume.asked && scene.volume.seen || self.views.iter().any(shows)
    }

    /// How many maps a light's bounce takes; or why it has none.
    ///
    /// # Errors
    /// The reason.
    pub fn maps_of(&self, light: &BounceState) -> Result<u32, SkipReason> {
        let shown =
            |id: &ViewId| (self.views.iter()).any(|v| v.id == *id && v.enabled && v.has_gbuffer);
        match light.maps {
            _ if !self.device_able => Err(SkipReason::DeviceUnable),
            Ok(_) if !light.views.iter().any(shown) => Err(SkipReason::NotInView),
            maps => maps,
        }
    }
}

impl Default for FrameState {
    /// An able device with WebGPU's default binding size and an empty world.
    fn default() -> Self {
        Self {
            device_able: true,
            largest_binding: 128 << 20,
            unload_after_frames: 120,
            scenes: Vec::new(),
            views: Vec::new(),
            bounces: Vec::new(),
            bounces_held: false,
            fogs: Vec::new(),
            inventory: Inventory::default(),
        }
    }
}
