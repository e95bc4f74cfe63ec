//! What this frame's scene calls for: which passes run, for which scene and view, and why (design
//! D9).
//!
//! Where it stands: after `bake`, before `gpu` and `plugin`. It knows neither an engine nor a
//! device: a caller describes the frame in plain words ([`FrameState`]), gets a [`Plan`], and
//! records exactly the passes that the plan lists.
//!
//! Rules, and each has a test:
//!
//! | the frame | what runs |
//! |---|---|
//! | no camera asks, or no baked scene is in view, or its asset is not there | nothing: no buffer, no pipeline |
//! | a scene is in view for the first time, or was baked again | upload, project every slot that shines, transport, display |
//! | one of eight lights moved | its slots are projected, transport, display |
//! | a light changed its color, or the sky or the emission changed | transport, display; nothing is projected |
//! | all lights at rest | display alone |
//! | a scene has been out of view for a while | its buffers go |
//! | a light asks for the bounce of what moves, and something moves in its reach | its maps, and its virtual point lights over each view |
//! | a light casts soft shadows on a bake that remembers what its points see | what it does not reach, when it changed; it is taken from each view |
//! | no light does, or the bake does not remember | nothing: no visibility on the device, no pass |
//! | a volume for forward cameras is asked for, and one of them sees the scene | its voxels, when the light changed |
//! | a camera sees fog that lies in a scene with a volume | the volume's voxels, when the light changed; its light is added to that camera's picture |
//! | no fog is there, or it lies elsewhere | nothing: no pass, no buffer |
//! | nothing moves, or not in its reach, or the light is off | no map, no camera that draws it, no buffer |
//!
//! With which tier of the operator a scene is solved [`TierController`] says, as the game asks for
//! it (design D11); the plan names it beside its reason.
//!
//! In how many channels its operator is applied [`ColorModeSelector`] says, as what shines and what
//! it shines on ask for it; with how many reflections [`BounceSelector`], as what surfaces return
//! asks for it.
//!
//! What the world has is counted in an [`Inventory`], frame by frame; what passes cost a
//! [`CostModel`] learns from the device's clock; which changes of a [`Decision`] are worth a line
//! in the log a [`DecisionLog`] knows.
//!
//! The effects are the rows of a table ([`Effect`]), which the plugin holds in `plugin/effects`.

mod bounce_count;
mod change_detector;
mod channels;
mod cost;
mod decision;
mod effect;
mod inventory;
mod inventory_tracker;
mod lights;
mod octree;
mod pass;
mod passes;
mod picked;
mod rsm_views;
mod settings;
mod stage;
mod state;
mod tier_controller;

pub use bounce_count::{
    BounceSelection, BounceSelector, MAX_AUTO_BOUNCES, MAX_TRUNCATED_FRACTION,
    bounces_for_spectral_radius,
};
pub use change_detector::ChangeDetector;
pub use channels::{
    ColorModeSelection, ColorModeSelector, MONOCHROME_HYSTERESIS_FRAMES, SceneChromaticity,
};
pub use cost::{Cost, CostModel, TimingScope, Work};
pub use decision::{Decision, DecisionKind, DecisionLog, NameOf};
pub use effect::{Effect, PassKind, kind_of};
pub use inventory::{Cameras, ChangeCounts, ColorUniformity, Inventory, LightKind, SkyKind};
pub use inventory_tracker::{InventoryTracker, SceneSnapshot, WorldSnapshot};
pub use lights::{
    SlotTable, Slots, light_affects, same_color, same_projection, same_soft_shadow,
    soft_light_affects,
};
pub use octree::{FmmLimit, falls_back, octree_fits};
pub use pass::{Pass, RunReason, SkipReason};
pub use passes::Plan;
pub use picked::TierSelection;
pub use rsm_views::{Lens, MAX_RSM_HALF_ANGLE, MapView, RSM_NEAR_PLANE, RSM_SIZE_STEP, map_views};
pub use settings::{GiBounceCount, GiColorMode, GiQuality};
pub use stage::FrameStage;
pub use state::{
    BounceState, DisplayUse, FogState, FrameState, LightId, SceneId, SceneState, SkyUse,
    SlotChange, SoftState, ViewId, ViewState, VolumeState,
};
pub use tier_controller::{TierCandidate, TierController};
