//! Selection of the operator's tier for each scene (design D11): runs the
//! [`TierController`] of each root and passes it the measured costs of solves.
//!
//! The quality is set on the root and not on a camera, because a scene is solved once for all
//! cameras.
//!
//! The cost of a solve is measured by GPU timestamps. The app must add Bevy's
//! `RenderDiagnosticsPlugin`. Its span `render/meshless_gi_compute/solve_<root>/elapsed_gpu`
//! contains projection and solve of one root. Without timestamps (Bevy has none on Metal and
//! WebGPU) the controller keeps all links.

use super::GiFrameStats;
use super::asset::GiBakedScene;
use super::compute::largest_binding;
use super::frame_record::FrameRecord;
use super::scene::GiScene;
use super::solver::GiSolver;
use crate::plan::{
    BounceSelector, GiQuality, TierCandidate, TierController, TierSelection, fmm_fallback_reason,
};
use bevy::asset::Assets;
use bevy::diagnostic::{DiagnosticPath, DiagnosticsStore};
use bevy::ecs::entity::EntityHashMap;
use bevy::ecs::prelude::*;
use bevy::ecs::system::SystemParam;
use bevy::reflect::prelude::*;
use bevy::render::renderer::RenderDevice;
use meshless_gi::BakedScene;
use std::fmt;
use std::sync::Arc;
use std::time::Instant;

/// Tier that [`GiQuality`] selects, with the reason. Output of the plugin, required by [`GiScene`].
#[derive(Component, Reflect, Clone, Debug, Default, PartialEq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct GiActiveTier {
    /// Tier of the next frames, from 1. The value is 0 while the bake is not loaded.
    pub tier: u32,
    /// Number of tiers of the bake.
    pub tiers: u32,
    /// The tier is the octree of the method `fmm`.
    pub octree: bool,
    /// Links that a solve reads.
    pub work: u64,
    /// The quality setting names the tier.
    pub forced: bool,
    /// The reason.
    pub reason: String,
    /// Number of changes of the tier since the quality, the bake or the bounces changed.
    pub changes: u64,
}

impl GiActiveTier {
    /// Returns the tier of the next frames and the reason. `None` while the bake is not loaded.
    #[doc(hidden)]
    #[must_use]
    pub fn selection(&self) -> Option<TierSelection> {
        (self.tier > 0).then(|| TierSelection {
            tier: self.tier,
            tiers: self.tiers,
            octree: self.octree,
            work: self.work,
            forced: self.forced,
            reason: self.reason.clone(),
        })
    }

    /// Number of changes of the tier since the quality, the bake or the bounces changed.
    #[must_use]
    pub fn changes(&self) -> u64 {
        self.changes
    }
}

impl From<&TierController> for GiActiveTier {
    fn from(controller: &TierController) -> Self {
        let selection = controller.selection();
        Self {
            tier: selection.tier,
            tiers: selection.tiers,
            octree: selection.octree,
            work: selection.work,
            forced: selection.forced,
            reason: selection.reason,
            changes: controller.changes(),
        }
    }
}

/// Inputs of a tier selection. A change of one of them starts a new selection.
#[derive(Clone, Copy, PartialEq)]
struct SelectionInputs {
    /// Address of the bake.
    bake: usize,
    quality: [u64; 2],
    sweeps: u32,
    /// The octree of method `Fmm` exceeds a limit of the device, so links are used.
    links_only: bool,
}

impl SelectionInputs {
    fn new(
        bake: &Arc<BakedScene>,
        quality: GiQuality,
        solver: &GiSolver,
        max_binding: u64,
    ) -> Self {
        let sweeps = match bake.data().bounces {
            Some(_) => 0,
            // Dynamic materials may need more. The measured cost of solves includes them.
            None => {
                let selected = BounceSelector::new().select(solver.bounces, bake, &[]);
                selected.map_or(0, |selected| selected.bounces - 1)
            }
        };
        Self {
            bake: Arc::as_ptr(bake) as usize,
            quality: bits(quality),
            sweeps,
            links_only: fmm_fallback_reason(bake, max_binding).is_some(),
        }
    }
}

/// Tier selection of one scene.
struct Selection {
    controller: TierController,
    inputs: SelectionInputs,
    /// Time of the last measured cost.
    last_sample: Option<Instant>,
}

impl Selection {
    fn new(inputs: SelectionInputs, quality: GiQuality, bake: &BakedScene) -> Self {
        let mut candidates = TierCandidate::all_of(bake, inputs.sweeps);
        candidates.retain(|candidate| !(inputs.links_only && candidate.octree));
        Self {
            controller: TierController::new(quality, candidates),
            inputs,
            last_sample: None,
        }
    }
}

/// Cost of a solve in milliseconds as a function of the links that it reads.
pub type SolveCostFn = dyn Fn(u64) -> f32 + Send + Sync;

/// Source of the cost of solves.
#[derive(Resource, Reflect, Clone, Default)]
#[reflect(opaque)]
#[reflect(Resource, Default, Clone, Debug)]
pub enum SolveCostSource {
    /// GPU timestamps.
    #[default]
    Timestamps,
    /// Function of the number of links that a solve reads. Links of a sweep count once per sweep.
    /// It is called after each frame that solved the scene. For tests.
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

/// Measured costs of solves.
#[derive(SystemParam)]
pub(crate) struct SolveCosts<'w> {
    source: Res<'w, SolveCostSource>,
    stats: Res<'w, GiFrameStats>,
    diagnostics: Option<Res<'w, DiagnosticsStore>>,
}

impl SolveCosts<'_> {
    /// Cost of the root's last solve in milliseconds. `None` if there is no new measurement.
    fn sample(
        &self,
        root: Entity,
        solved: Option<&FrameRecord>,
        selection: &mut Selection,
    ) -> Option<f32> {
        match &*self.source {
            SolveCostSource::Given(cost) => {
                let &tier = solved?.solved.get(&root.to_bits())?;
                let tiers = selection.controller.tiers();
                let last = tiers.len().checked_sub(1)?;
                let candidate = tiers.get((tier.max(1) as usize - 1).min(last))?;
                Some(cost(candidate.work))
            }
            SolveCostSource::Timestamps => {
                let path = DiagnosticPath::from_components([
                    "render",
                    "meshless_gi_compute",
                    &span_name(root.to_bits()),
                    "elapsed_gpu",
                ]);
                let measured = self.diagnostics.as_ref()?.get(&path)?.measurement()?;
                let new = selection.last_sample.replace(measured.time) != Some(measured.time);
                new.then_some(measured.value as f32)
            }
        }
    }
}

/// State that [`select_tiers`] keeps between frames.
#[derive(Default)]
pub(crate) struct Selections {
    of_roots: EntityHashMap<Selection>,
    last_frame: u64,
}

/// Selects the tier of each root. Runs in
/// [`GiSystems::SelectTiers`](super::GiSystems::SelectTiers).
pub(crate) fn select_tiers(
    mut roots: Query<(Entity, &GiScene, &GiQuality, &GiSolver, &mut GiActiveTier)>,
    assets: Res<Assets<GiBakedScene>>,
    costs: SolveCosts,
    device: Option<Res<RenderDevice>>,
    mut selections: Local<Selections>,
) {
    let Selections {
        of_roots,
        last_frame,
    } = &mut *selections;
    of_roots.retain(|root, _| roots.contains(*root));
    // Only a budget reads the solves of the last frame.
    let has_budget = |q: &GiQuality| matches!(q, GiQuality::GpuBudget(_));
    let solved = roots
        .iter()
        .any(|(_, _, quality, ..)| has_budget(quality))
        .then(|| costs.stats.record())
        .filter(|stats| stats.frame != *last_frame);
    let max_binding = device.as_ref().map_or(u64::MAX, |d| largest_binding(d));
    for (root, gi, quality, solver, mut tier) in &mut roots {
        let Some(asset) = assets.get(&gi.0) else {
            of_roots.remove(&root);
            tier.set_if_neq(GiActiveTier::default());
            continue;
        };
        let inputs = SelectionInputs::new(&asset.scene, *quality, solver, max_binding);
        if of_roots.get(&root).map(|selection| selection.inputs) != Some(inputs) {
            let selection = Selection::new(inputs, *quality, &asset.scene);
            tier.set_if_neq((&selection.controller).into());
            of_roots.insert(root, selection);
        }
        let Some(selection) = of_roots.get_mut(&root).filter(|_| has_budget(quality)) else {
            continue;
        };
        if let Some(sample) = costs.sample(root, solved.as_deref(), selection) {
            selection.controller.record_sample(sample);
            tier.set_if_neq((&selection.controller).into());
        }
    }
    if let Some(stats) = solved {
        *last_frame = stats.frame;
    }
}

/// Bits of a quality, so that NaN equals NaN.
fn bits(quality: GiQuality) -> [u64; 2] {
    match quality {
        GiQuality::Full => [0, 0],
        GiQuality::Tier(n) => [1, n.into()],
        GiQuality::MaxError(error) => [2, error.to_bits().into()],
        GiQuality::GpuBudget(budget) => [3, budget.as_nanos() as u64],
    }
}
