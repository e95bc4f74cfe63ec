//! Which tier of its bake's operator a scene is lit with (design D11): asks the
//! [picker](crate::plan::TierController) of each root, and tells it what solves cost.
//!
//! The request stands on the level's root and not on a camera: a scene is solved once for all
//! cameras that show it.
//!
//! The cost of a solve is what the device's clock says, by way of Bevy's `RenderDiagnosticsPlugin`,
//! which the app has to add: the span `render/meshless_gi_compute/solve_<root>/elapsed_gpu` holds
//! projection and solve of one root. Where there are no such timestamps (Metal and WebGPU have none
//! in Bevy) nothing is known of the cost, and the picker stays with all links and says so.

use super::asset::GiBakedScene;
use super::compute::largest_binding;
use super::diagnostics::GiFrameStats;
use super::scene::GiScene;
use super::solver::GiSolver;
use crate::plan::{
    BounceSelector, GiQuality, TierCandidate, TierController, TierSelection, falls_back,
};
use bevy::asset::Assets;
use bevy::diagnostic::{DiagnosticPath, DiagnosticsStore};
use bevy::ecs::entity::EntityHashMap;
use bevy::ecs::prelude::*;
use bevy::reflect::prelude::*;
use bevy::render::renderer::RenderDevice;
use std::fmt;
use std::sync::Arc;
use std::time::Instant;

/// The tier that [`GiQuality`] selects, with the reason. Output of the plugin; comes with
/// [`GiScene`].
#[derive(Component, Reflect, Clone, Debug, Default, PartialEq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
pub struct GiActiveTier {
    /// Tier of the next frames, from 1; 0 while the bake is not loaded.
    pub tier: u32,
    /// Number of tiers of the bake.
    pub tiers: u32,
    /// The tier is the octree of rule `fmm`.
    pub octree: bool,
    /// Links that a solve reads.
    pub work: u64,
    /// The quality setting names the tier.
    pub forced: bool,
    /// The reason.
    pub why: String,
    /// Number of changes of the tier since the quality, the bake or the bounces changed.
    pub changes: u64,
}

impl GiActiveTier {
    /// The tier of the next frames and the reason; `None` while the bake is not loaded.
    #[must_use]
    pub fn picked(&self) -> Option<TierSelection> {
        (self.tier > 0).then(|| TierSelection {
            tier: self.tier,
            tiers: self.tiers,
            octree: self.octree,
            work: self.work,
            forced: self.forced,
            why: self.why.clone(),
        })
    }

    /// Number of changes of the tier since the quality, the bake or the bounces changed.
    #[must_use]
    pub fn changes(&self) -> u64 {
        self.changes
    }
}

impl From<&TierController> for GiActiveTier {
    fn from(picker: &TierController) -> Self {
        let picked = picker.picked();
        Self {
            tier: picked.tier,
            tiers: picked.tiers,
            octree: picked.octree,
            work: picked.work,
            forced: picked.forced,
            why: picked.why,
            changes: picker.changes(),
        }
    }
}

/// The picker of one scene.
pub(crate) struct Picking {
    picker: TierController,
    /// Bake, quality, sweeps and transport that the picker was made for.
    made_for: (usize, [u64; 2], u32, bool),
    /// Time of the last cost that was measured.
    seen: Option<Instant>,
}

/// What a solve costs, milliseconds, by the links that it reads.
pub type SolveCostFn = dyn Fn(u64) -> f32 + Send + Sync;

/// Where the cost of solves is known from.
#[derive(Resource, Reflect, Clone, Default)]
#[reflect(opaque)]
#[reflect(Resource, Default, Clone, Debug)]
pub enum SolveCostSource {
    /// The device's timestamps.
    #[default]
    Timestamps,
    /// A function of the links that a solve reads, those of the sweeps as often as they run; asked
    /// after each frame that solved the scene. For a game that measures by itself, and for tests.
    Given(Arc<SolveCostFn>),
}

impl fmt::Debug for SolveCostSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Timestamps => "Timestamps",
            Self::Given(_) => "Given",
        })
    }
}

/// Name of the span of a root's solves.
pub(crate) fn span_name(root: u64) -> String {
    format!("solve_{root:x}")
}

/// Runs in [`GiSystems::SelectTiers`](super::GiSystems::SelectTiers).
#[expect(
    clippy::too_many_arguments,
    reason = "a system's parameters are its inputs"
)]
pub(crate) fn pick(
    mut roots: Query<(Entity, &GiScene, &GiQuality, &GiSolver, &mut GiActiveTier)>,
    assets: Res<Assets<GiBakedScene>>,
    status: Res<GiFrameStats>,
    store: Option<Res<DiagnosticsStore>>,
    cost: Res<SolveCostSource>,
    device: Option<Res<RenderDevice>>,
    mut pickings: Local<EntityHashMap<Picking>>,
    mut last_frame: Local<u64>,
) {
    pickings.retain(|root, _| roots.contains(*root));
    // Only a budget asks what was solved.
    let asks = |q: &GiQuality| matches!(q, GiQuality::GpuBudget(_));
    let counters = roots
        .iter()
        .any(|(_, _, quality, ..)| asks(quality))
        .then(|| status.get())
        .filter(|c| c.frame != *last_frame);
    for (root, gi, quality, solver, mut tier) in &mut roots {
        let Some(asset) = assets.get(&gi.0) else {
            pickings.remove(&root);
            tier.set_if_neq(GiActiveTier::default());
            continue;
        };
        let bake = &asset.scene;
        let sweeps = match bake.bounces {
            Some(_) => 0,
            // Live materials may ask for more: what a solve takes says so.
            None => {
                let picked = BounceSelector::new().pick(solver.bounces, bake, &[]);
                picked.map_or(0, |picked| picked.bounces - 1)
            }
        };
        let room = device.as_ref().map_or(u64::MAX, |d| largest_binding(d));
        // What does not run is no choice.
        let linked = falls_back(bake, room).is_some();
        let made_for = (Arc::as_ptr(bake) as usize, bits(*quality), sweeps, linked);
        if pickings.get(&root).map(|picking| picking.made_for) != Some(made_for) {
            let mut choices = TierCandidate::of(bake, sweeps);
            choices.retain(|choice| !(linked && choice.octree));
            let picking = Picking {
                picker: TierController::new(*quality, choices),
                made_for,
                seen: None,
            };
            tier.set_if_neq((&picking.picker).into());
            pickings.insert(root, picking);
        }
        let picking = pickings.get_mut(&root).filter(|_| asks(quality));
        let Some(Picking { picker, seen, .. }) = picking else {
            continue;
        };
        let sample = match &*cost {
            SolveCostSource::Given(of) => {
                let solved = counters
                    .as_ref()
                    .and_then(|c| c.solved.get(&root.to_bits()));
                let choice = solved.and_then(|&t| {
                    let last = picker.tiers().len().checked_sub(1)?;
                    picker.tiers().get((t.max(1) as usize - 1).min(last))
                });
                choice.map(|choice| of(choice.work))
            }
            SolveCostSource::Timestamps => {
                let path = DiagnosticPath::from_components([
                    "render",
                    "meshless_gi_compute",
                    &span_name(root.to_bits()),
                    "elapsed_gpu",
                ]);
                let measured = store.as_ref().and_then(|s| s.get(&path)?.measurement());
                measured
                    .filter(|m| seen.replace(m.time) != Some(m.time))
                    .map(|m| m.value as f32)
            }
        };
        let Some(sample) = sample else { continue };
        picker.measured(sample);
        tier.set_if_neq((&*picker).into());
    }
    if let Some(counters) = counters {
        *last_frame = counters.frame;
    }
}

/// A request as bits, so that one that is no number equals itself.
fn bits(quality: GiQuality) -> [u64; 2] {
    match quality {
        GiQuality::Full => [0, 0],
        GiQuality::Tier(n) => [1, n.into()],
        GiQuality::MaxError(error) => [2, error.to_bits().into()],
        GiQuality::GpuBudget(budget) => [3, budget.as_nanos() as u64],
    }
}
