//! [`Plan`]: the passes of one frame, why they run and why others do not, what they cost, and what
//! the world has. A table of [`Effect`]s makes it.

use super::cost::{self, Cost, TimingScope};
use super::{
    BounceSelection, ColorModeSelection, DisplayUse, Effect, FmmLimit, FrameStage, FrameState,
    Inventory, LightId, Pass, RunReason, SceneId, SkipReason, SkyUse, TierSelection, ViewId,
};
use std::fmt;

/// The passes of one frame, in order, and why the rest does not run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plan {
    /// What runs, in order.
    pub passes: Vec<Pass>,
    /// What does not, and why. A view is named where the view is the cause.
    pub skipped: Vec<(SceneId, Option<ViewId>, SkipReason)>,
    /// Lights that ask for the bounce of what moves and get none, and why.
    pub dark: Vec<(LightId, SkipReason)>,
    /// Lights whose virtual lights the device holds from an earlier frame: nothing of them moved.
    pub resting: Vec<LightId>,
    /// The tiers of the operators that run, and why.
    pub tiers: Vec<(SceneId, TierSelection)>,
    /// In how many channels links are applied, and why.
    pub channels: Vec<(SceneId, ColorModeSelection)>,
    /// With how many reflections scenes are solved, and why; none for bakes that hold them.
    pub reflections: Vec<(SceneId, BounceSelection)>,
    /// Scenes whose light goes through links because the device does not hold their octree, and
    /// what it lacks.
    pub linked: Vec<(SceneId, FmmLimit)>,
    /// Scenes whose sky varies, and what becomes of it.
    pub skies: Vec<(SceneId, SkyUse)>,
    /// At which pixels the views that show indirect light evaluate it.
    pub displays: Vec<(ViewId, DisplayUse)>,
    /// Scenes whose buffers go, because no view has seen them for long or their bake is gone.
    pub release: Vec<SceneId>,
    /// What the passes cost, as far as is known: one entry for all that the device's clock times as
    /// one, in the order of the passes.
    pub costs: Vec<(TimingScope, Cost)>,
    /// What the world has.
    pub inventory: Inventory,
}

impl Plan {
    /// Plans a frame with a table of effects.
    #[must_use]
    pub fn new<R>(effects: &[Effect<R>], state: &FrameState) -> Self {
        let mut plan = Self {
            inventory: state.inventory.clone(),
            ..Self::default()
        };
        for effect in effects {
            (effect.schedule)(state, &mut plan);
        }
        plan.costs = cost::weigh(effects, state, &mut plan.passes);
        plan
    }

    /// True when nothing runs.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.passes.is_empty()
    }

    /// The pass of this stage for this scene that all views share, if there is one.
    #[must_use]
    pub fn find(&self, stage: FrameStage, scene: SceneId) -> Option<&Pass> {
        self.passes
            .iter()
            .find(|p| p.stage == stage && p.scene == scene)
    }

    /// What this pass costs, with all that is timed as one with it; none where no clock times it.
    #[must_use]
    pub fn cost_of(&self, pass: &Pass) -> Option<&Cost> {
        let timed = pass.timing?;
        self.costs.iter().find(|(t, _)| *t == timed).map(|(_, c)| c)
    }

    /// The maps of this light, if they are drawn.
    #[must_use]
    pub fn find_light(&self, light: LightId) -> Option<&Pass> {
        self.passes
            .iter()
            .find(|p| p.stage == FrameStage::RSM && p.light == Some(light))
    }

    /// Whether this light's bounce off what moves is to be seen: drawn now, or held.
    #[must_use]
    pub fn bounces(&self, light: LightId) -> bool {
        self.find_light(light).is_some() || self.resting.contains(&light)
    }

    /// The passes of a scene that all views share, in order.
    pub fn of_scene(&self, scene: SceneId) -> impl Iterator<Item = &Pass> {
        let own = move |p: &&Pass| p.scene == scene && p.view.is_none();
        self.passes.iter().filter(own)
    }

    /// The passes of a view, in order.
    pub fn of_view(&self, view: ViewId) -> impl Iterator<Item = &Pass> {
        self.passes.iter().filter(move |p| p.view == Some(view))
    }

    /// Returns `true` if the view shows indirect light over its surfaces.
    #[must_use]
    pub fn shows(&self, view: ViewId) -> bool {
        self.displays.iter().any(|(id, _)| *id == view)
    }

    /// Returns `true` if a pass of this stage runs in the view.
    #[must_use]
    pub fn runs_in_view(&self, stage: FrameStage, view: ViewId) -> bool {
        self.of_view(view).any(|p| p.stage == stage)
    }

    /// How many passes of this stage.
    #[must_use]
    pub fn count(&self, stage: FrameStage) -> usize {
        self.passes.iter().filter(|p| p.stage == stage).count()
    }

    /// How many light slots are projected, over all scenes.
    #[must_use]
    pub fn projected_slots(&self) -> usize {
        self.passes.iter().map(|p| p.slots.len()).sum()
    }

    /// The baked scenes that any pass touches, ascending.
    #[must_use]
    pub fn active_scenes(&self) -> Vec<SceneId> {
        let mut ids: Vec<_> = self.passes.iter().map(|p| p.scene).collect();
        ids.retain(|id| *id != SceneId::WORLD);
        ids.sort_unstable();
        ids.dedup();
        ids
    }

    /// Adds a pass of an effect, for all views.
    pub(crate) fn push(
        &mut self,
        effect: &'static str,
        stage: FrameStage,
        scene: SceneId,
        reason: RunReason,
    ) -> &mut Pass {
        self.passes.push(Pass {
            effect,
            stage,
            scene,
            light: None,
            view: None,
            slots: Vec::new(),
            reason,
            timing: None,
        });
        self.passes.last_mut().expect("just pushed")
    }
}

impl fmt::Display for Plan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.inventory.fmt(f)?;
        for (i, pass) in self.passes.iter().enumerate() {
            write!(f, "run  {pass}")?;
            let timed = pass.timing;
            let with = |p: &Pass| timed.is_some() && p.timing == timed;
            match (
                self.cost_of(pass),
                self.passes[..i].iter().find(|p| with(p)),
            ) {
                (_, Some(first)) => writeln!(f, "; timed with {}", first.stage.name())?,
                (Some(cost), None) => writeln!(f, "; {cost}")?,
                (None, None) => writeln!(f)?,
            }
        }
        for (scene, view, why) in &self.skipped {
            write!(f, "skip {scene}")?;
            if let Some(view) = view {
                write!(f, " in view {:x}", view.0)?;
            }
            writeln!(f, ": {why}")?;
        }
        for (light, why) in &self.dark {
            writeln!(f, "skip maps of light {light}: {why}")?;
        }
        for light in &self.resting {
            writeln!(f, "skip maps of light {light}: {}", SkipReason::AtRest)?;
        }
        for (scene, picked) in &self.tiers {
            writeln!(f, "use  {scene} with {picked}")?;
        }
        for (scene, picked) in &self.channels {
            writeln!(f, "use  {scene} in {picked}")?;
        }
        for (scene, picked) in &self.reflections {
            writeln!(f, "use  {scene} with {picked}")?;
        }
        for (scene, why) in &self.linked {
            writeln!(f, "use  {scene} with its links: {why}")?;
        }
        for (scene, sky) in &self.skies {
            writeln!(f, "use  {scene} with {sky}")?;
        }
        for (view, display) in &self.displays {
            let (choice, why) = (display.choice(), display.why());
            writeln!(f, "use  view {:x} with {choice}: {why}", view.0)?;
        }
        for scene in &self.release {
            writeln!(f, "free {scene}")?;
        }
        Ok(())
    }
}
