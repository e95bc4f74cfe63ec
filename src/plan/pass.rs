//! Passes of a plan, and the reasons why they run or do not.

use super::{DisplayUse, FrameStage, LightId, SceneId, TimingScope, ViewId};
use std::fmt;

/// Reason why a pass runs.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum RunReason {
    /// The device does not hold this bake yet, or holds an older one.
    NewBake,
    /// Number of light slots that are new or have moved.
    LightsMoved(usize),
    /// Number of light slots that changed their color, where none moved.
    LightsRecolored(usize),
    /// Sky, emission, bounces or the tier changed.
    SettingsChanged,
    /// Base colors or emission of materials are not those that the device has.
    MaterialsChanged,
    /// Number of occluders that moved or changed their transmittance.
    OccludersMoved(usize),
    /// A light was removed.
    LightRemoved,
    /// The scene is in this view.
    InView,
    /// The coefficients were requested on the CPU.
    ReadBackRequested,
    /// Number of reflective shadow maps with a dynamic object in the light's reach.
    ObjectsInRange(u32),
    /// Number of lights with soft shadows, after one was added, removed, moved or recolored.
    SoftLightsChanged(usize),
    /// A volume is new, or has another transform.
    NewVolume,
    /// Number of fog volumes in the view and in the scene.
    FogInView(usize),
}

impl fmt::Display for RunReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NewBake => f.write_str("the device does not hold this bake"),
            Self::LightsMoved(n) => write!(f, "{n} light slot(s) new or moved"),
            Self::LightsRecolored(n) => write!(f, "{n} light slot(s) changed color"),
            Self::SettingsChanged => f.write_str("sky, emission, bounces or tier changed"),
            Self::MaterialsChanged => f.write_str("materials changed color or emission"),
            Self::OccludersMoved(n) => write!(f, "{n} occluder(s) opened or shut"),
            Self::LightRemoved => f.write_str("a light was removed"),
            Self::InView => f.write_str("the scene is in the view"),
            Self::ReadBackRequested => f.write_str("the coefficients are inspected"),
            Self::SoftLightsChanged(n) => write!(f, "soft shadows changed, {n} light(s) cast them"),
            Self::NewVolume => f.write_str("the volume is new or was moved"),
            Self::FogInView(n) => write!(f, "{n} fog volume(s) of the view lie in the scene"),
            Self::ObjectsInRange(maps) => {
                write!(f, "dynamic objects are in range, {maps} map(s) show them")
            }
        }
    }
}

/// Reason why something does not run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[non_exhaustive]
pub enum SkipReason {
    /// The device lacks compute shaders or large enough limits.
    DeviceUnsupported,
    /// The asset is not loaded.
    AssetMissing,
    /// The scene is hidden.
    Hidden,
    /// The scene needs a larger buffer than the device binds.
    TooLarge {
        /// Bytes that the scene needs in one buffer.
        needs: u64,
        /// Bytes that the device binds.
        has: u64,
    },
    /// The device lacks another limit that the scene needs.
    BeyondLimits,
    /// The device cannot hold the buffers of an effect at the size of the view.
    ViewBeyondLimits,
    /// The scene is in the view of no camera with indirect light.
    NotInView,
    /// The view's settings turn indirect light off.
    ViewDisabled,
    /// The view draws no G-buffer to composite over.
    NoGbuffer,
    /// Nothing changed since the last time.
    AtRest,
    /// A light has a reflective shadow map, and nothing moves.
    NothingMoves,
    /// The light's range has no dynamic object.
    OutOfReach,
    /// The light is off.
    LightDark,
    /// This kind of light casts no reflective shadow maps.
    NoMaps,
    /// A light casts soft shadows, and this bake has no visibility.
    NoVisibility,
    /// A volume is requested, and the bake has no probes.
    NoProbes,
}

impl fmt::Display for SkipReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::DeviceUnsupported => f.write_str("the device cannot run the kernels"),
            Self::AssetMissing => f.write_str("the baked asset is not loaded"),
            Self::Hidden => f.write_str("the scene is hidden"),
            Self::TooLarge { needs, has } => {
                write!(
                    f,
                    "the scene needs a buffer of {needs} bytes, the device binds {has}"
                )
            }
            Self::BeyondLimits => {
                f.write_str("the scene exceeds a limit of the device, see the log")
            }
            Self::ViewBeyondLimits => {
                f.write_str("the view exceeds a limit of the device, see the log")
            }
            Self::NotInView => {
                f.write_str("the scene is in the view of no camera with indirect light")
            }
            Self::ViewDisabled => f.write_str("indirect light is off in the view's settings"),
            Self::NoGbuffer => f.write_str("the view draws no G-buffer"),
            Self::AtRest => f.write_str("nothing changed"),
            Self::NothingMoves => f.write_str("no dynamic objects"),
            Self::OutOfReach => f.write_str("no dynamic object is in range"),
            Self::LightDark => f.write_str("the light is off"),
            Self::NoVisibility => {
                f.write_str("a light casts soft shadows, and the bake holds no visibility")
            }
            Self::NoProbes => f.write_str("the scene has a volume, but the bake has no probes"),
            Self::NoMaps => f.write_str("lights of this kind cast no reflective shadow maps"),
        }
    }
}

/// Pass of the frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pass {
    /// Effect that added it, by its [`Effect::name`](super::Effect::name).
    pub effect: &'static str,
    /// Stage of the pass.
    pub stage: FrameStage,
    /// Scene of the pass. [`SceneId::WORLD`] for work that belongs to no bake.
    pub scene: SceneId,
    /// Light of the pass ([`FrameStage::RSM`] only).
    pub light: Option<LightId>,
    /// View of the pass. `None` for work that all views share.
    pub view: Option<ViewId>,
    /// Light slots ([`FrameStage::PROJECT`] only).
    pub slots: Vec<u32>,
    /// Reason why it runs.
    pub reason: RunReason,
    /// Pixels at which the view evaluates its layers. `None` for a pass that is no layer.
    pub display: Option<DisplayUse>,
    /// Scope in which the device's clock times it. `None` if no clock does.
    pub timing: Option<TimingScope>,
}

impl fmt::Display for Pass {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} of ", self.stage.name())?;
        match self.light {
            Some(light) => write!(f, "light {light}")?,
            None => write!(f, "{}", self.scene)?,
        }
        if let Some(view) = self.view {
            write!(f, " in view {:x}", view.0)?;
        }
        write!(f, " ({}): {}", self.effect, self.reason)
    }
}
