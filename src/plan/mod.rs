//! Planning of a frame: the passes that run, their scenes and views, and the reasons (design D9).
//!
//! The module follows `bake` and precedes `gpu` and `plugin`. It depends on neither an engine nor a
//! device. A caller describes the frame as a [`FrameState`], gets a [`Plan`], and records exactly
//! the passes that the plan lists.
//!
//! Passes by state of the frame, each with a test:
//!
//! | the frame | what runs |
//! |---|---|
//! | no camera requests indirect light, or no baked scene is in view, or its asset is not there | nothing: no buffer, no pipeline |
//! | a scene is in view for the first time, or was baked again | upload, project every slot that shines, transport, display |
//! | one of eight lights moved | its slots are projected, transport, display |
//! | a light changed its color, or the sky or the emission changed | transport, display; nothing is projected |
//! | all lights at rest | display alone |
//! | a scene has been out of view for a while | its buffers are released |
//! | a light requests a bounce off dynamic objects, and one is in its reach | its maps, and its virtual point lights over each view |
//! | a light casts soft shadows on a bake with visibility | the shadowed irradiance, when it changed, which is subtracted from each view |
//! | no light casts soft shadows, or the bake has no visibility | nothing: no visibility on the device, no pass |
//! | a volume for forward cameras is requested, and the scene is in the view of one of them | its voxels, when the light changed |
//! | a camera sees fog in a scene with a volume | the volume's voxels, when the light changed, and the fog's light in that camera's picture |
//! | no fog is there, or it is outside such scenes | nothing: no pass, no buffer |
//! | no dynamic object is in the light's reach, or the light is off | no map, no camera that draws it, no buffer |
//!
//! [`TierController`] selects the operator tier of a scene, as the game requests it (design D11).
//! [`ColorModeSelector`] selects the number of channels, from the colors of light and surfaces.
//! [`BounceSelector`] selects the number of reflections, from the reflectance of the surfaces. The
//! plan stores each choice with its reason.
//!
//! [`Inventory`] counts the contents of the world, frame by frame. [`CostModel`] predicts the costs
//! of passes from the device's timestamps. [`DecisionLog`] selects the changes of a [`Decision`]
//! that are logged.
//!
//! The effects are the rows of a table ([`Effect`]), which the plugin holds in `plugin/effects`.

mod bounce_count;
mod change_detector;
mod channels;
mod cost_model;
mod decision;
mod effect;
mod fmm;
mod frame_plan;
mod inventory;
mod inventory_tracker;
mod light_kind;
mod light_slots;
mod pass;
mod rsm_views;
mod settings;
mod stage;
mod state;
mod tier_controller;
mod tier_selection;

pub use bounce_count::{
    BounceSelection, BounceSelector, MAX_AUTO_BOUNCES, MAX_TRUNCATED_FRACTION,
    bounces_for_spectral_radius,
};
pub use change_detector::{ChangeDetector, MapChangeDetector};
pub use channels::{
    ColorModeSelection, ColorModeSelector, MONOCHROME_HYSTERESIS_FRAMES, SceneChromaticity,
};
pub use cost_model::{Cost, CostModel, SolveCost, TimingScope, Work};
pub use decision::{Decision, DecisionKind, DecisionLog, NameOf};
pub use effect::{Effect, PassKind, Timing, kind_of};
pub use fmm::{FmmLimit, fmm_fallback_reason, octree_fits};
pub use frame_plan::Plan;
pub use inventory::{Cameras, ChangeCounts, ColorUniformity, Inventory, SkyKind};
pub use inventory_tracker::{InventoryTracker, SceneSnapshot, WorldSnapshot};
pub use light_kind::LightKind;
pub use light_slots::{
    SlotTable, Slots, light_affects, same_color, same_projection, same_soft_shadow,
    soft_light_affects,
};
pub use pass::{Pass, RunReason, SkipReason};
pub use rsm_views::{Lens, MAX_RSM_HALF_ANGLE, MapView, RSM_NEAR_PLANE, RSM_SIZE_STEP, map_views};
pub use settings::{GiBounceCount, GiColorMode, GiQuality};
pub use stage::FrameStage;
pub use state::{
    BounceState, DisplayUse, FogState, FrameState, LightId, SceneId, SceneState, SkyUse,
    SlotChange, SoftShadowState, ViewId, ViewState, VolumeState,
};
pub use tier_controller::{TierCandidate, TierController};
pub use tier_selection::TierSelection;
