//! What a plan is made of: passes, and the reasons why they run or do not.

use super::{LightId, SceneId, ViewId};
use std::fmt;

/// A stage of the frame, in the order of the frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Stage {
    /// The bake goes to the device.
    Upload,
    /// The senders' surfaces, where materials changed.
    Materials,
    /// The links that doors and lifts are in the way of, where one of those moved.
    Occlude,
    /// Lights onto the points, slot by slot.
    Project,
    /// Radiosity of the lit points, pull-push to the senders, and the live bounces between them.
    PullPush,
    /// The operator times the senders' coefficients.
    Apply,
    /// Every point gets its value: inactive ones from their parents.
    Flatten,
    /// Light in free space: the operator's rows of the probes, and the probes over what a view
    /// shows off the surfaces.
    Probe,
    /// Light in free space as a volume, for cameras without a G-buffer.
    Volume,
    /// What lamps with soft shadows do not reach, at the points that remember what they see.
    SoftShadow,
    /// Reflective shadow maps of a light, what moves drawn from there, become virtual point lights.
    Rsm,
    /// The flat basis over the pixels of a view: their irradiance.
    Splat,
    /// The virtual point lights over the pixels of a view.
    Vpl,
    /// Irradiance times base color, added to the picture.
    Composite,
    /// What glossy surfaces of a view show of the virtual point lights.
    VplSpecular,
    /// Light of lamps with soft shadows that does not get there, taken from the picture of a view.
    SubtractShadow,
    /// Light in free space that fog sends to the eye, added to the picture of a view.
    Fog,
    /// Coefficients back to the CPU.
    ReadBack,
}

impl Stage {
    /// All stages, in order.
    pub const ALL: [Self; 18] = [
        Self::Upload,
        Self::Materials,
        Self::Occlude,
        Self::Project,
        Self::PullPush,
        Self::Apply,
        Self::Flatten,
        Self::Probe,
        Self::Volume,
        Self::SoftShadow,
        Self::Rsm,
        Self::Splat,
        Self::Vpl,
        Self::Composite,
        Self::VplSpecular,
        Self::SubtractShadow,
        Self::Fog,
        Self::ReadBack,
    ];

    /// The name that diagnostics and logs use.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Upload => "upload",
            Self::Materials => "materials",
            Self::Occlude => "occlude",
            Self::Project => "project",
            Self::PullPush => "pull_push",
            Self::Apply => "apply",
            Self::Flatten => "flatten",
            Self::Probe => "probe",
            Self::Volume => "volume",
            Self::SoftShadow => "soft_shadow",
            Self::Rsm => "rsm",
            Self::Splat => "splat",
            Self::Vpl => "vpl",
            Self::Composite => "composite",
            Self::VplSpecular => "vpl_specular",
            Self::SubtractShadow => "subtract_shadow",
            Self::Fog => "fog",
            Self::ReadBack => "read_back",
        }
    }
}

/// Why a pass runs.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Reason {
    /// The device does not hold this bake yet, or holds an older one.
    NewBake,
    /// These many light slots are new or have moved.
    LightsMoved(usize),
    /// These many light slots changed their color, and none moved.
    LightsRecolored(usize),
    /// Sky, emission, bounces or the tier changed.
    SettingsChanged,
    /// Base colors or emission of materials are not those that the device has.
    MaterialsChanged,
    /// So many occluders opened or shut, or moved between.
    OccludersMoved(usize),
    /// A light went away.
    LightRemoved,
    /// The scene is in this view.
    InView,
    /// Somebody asked for the coefficients.
    Asked,
    /// Something that moves is in the light's reach, in so many maps.
    Moving(u32),
    /// Lamps with soft shadows came, went, moved or changed color; there are so many now.
    SoftLightsChanged(usize),
    /// A volume is new, or stands differently in the world.
    NewVolume,
    /// So many fog volumes are in the view and in the scene.
    FogInView(usize),
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NewBake => f.write_str("the device does not hold this bake"),
            Self::LightsMoved(n) => write!(f, "{n} light slot(s) new or moved"),
            Self::LightsRecolored(n) => write!(f, "{n} light slot(s) changed color"),
            Self::SettingsChanged => f.write_str("sky, emission, bounces or tier changed"),
            Self::MaterialsChanged => f.write_str("materials changed color or emission"),
            Self::OccludersMoved(n) => write!(f, "{n} occluder(s) opened or shut"),
            Self::LightRemoved => f.write_str("a light went away"),
            Self::InView => f.write_str("the scene is in the view"),
            Self::Asked => f.write_str("the coefficients were asked for"),
            Self::SoftLightsChanged(n) => write!(f, "soft shadows changed, {n} light(s) cast them"),
            Self::NewVolume => f.write_str("the volume does not hold this light yet"),
            Self::FogInView(n) => write!(f, "{n} fog volume(s) of the view lie in the scene"),
            Self::Moving(maps) => write!(f, "what moves is in reach, {maps} map(s) show it"),
        }
    }
}

/// Why something does not run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Skip {
    /// The device lacks compute shaders or large enough limits.
    DeviceUnable,
    /// The asset is not loaded (yet).
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
    /// No camera asks for indirect light and sees the scene.
    NotInView,
    /// The view's settings turn indirect light off.
    ViewDisabled,
    /// The view draws no G-buffer to composite over.
    NoGbuffer,
    /// Nothing changed since the last time.
    AtRest,
    /// A light asks for the bounce of what moves, and nothing does.
    NothingMoves,
    /// Nothing that moves is in the light's reach.
    OutOfReach,
    /// The light is off.
    LightDark,
    /// This kind of light casts no reflective shadow maps.
    NoMaps,
    /// A light casts soft shadows, and the points of this bake do not remember what they see.
    NoVisibility,
    /// A volume is asked for, and the bake knows no light in free space.
    NoFreeSpace,
}

impl fmt::Display for Skip {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::DeviceUnable => f.write_str("the device cannot run the kernels"),
            Self::AssetMissing => f.write_str("the baked asset is not loaded"),
            Self::Hidden => f.write_str("the scene is hidden"),
            Self::TooLarge { needs, has } => {
                write!(
                    f,
                    "the scene needs a buffer of {needs} bytes, the device binds {has}"
                )
            }
            Self::BeyondLimits => {
                f.write_str("the device's limits do not hold the scene: the log says which")
            }
            Self::NotInView => f.write_str("no camera that asks for indirect light sees the scene"),
            Self::ViewDisabled => f.write_str("indirect light is off in the view's settings"),
            Self::NoGbuffer => f.write_str("the view draws no G-buffer"),
            Self::AtRest => f.write_str("nothing changed"),
            Self::NothingMoves => f.write_str("nothing moves"),
            Self::OutOfReach => f.write_str("nothing that moves is in reach"),
            Self::LightDark => f.write_str("the light is off"),
            Self::NoVisibility => {
                f.write_str("a light casts soft shadows, and the bake holds no visibility")
            }
            Self::NoFreeSpace => {
                f.write_str("a volume is asked for, and the bake knows no light in free space")
            }
            Self::NoMaps => f.write_str("lights of this kind cast no reflective shadow maps"),
        }
    }
}

/// One pass of the frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pass {
    /// The effect that asked for it (its name in [`EFFECTS`](super::EFFECTS)).
    pub effect: &'static str,
    /// What runs.
    pub stage: Stage,
    /// For which scene; [`SceneId::WORLD`] for what belongs to no bake.
    pub scene: SceneId,
    /// For which light ([`Stage::Rsm`] only).
    pub light: Option<LightId>,
    /// For which view; `None` for work that all views share.
    pub view: Option<ViewId>,
    /// Which light slots ([`Stage::Project`] only).
    pub slots: Vec<u32>,
    /// Why.
    pub reason: Reason,
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
