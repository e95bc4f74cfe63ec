//! [`Plan`]: the passes of one frame, the reasons why they run or do not, their costs, and the
//! inventory of the world. It is made from a table of [`Effect`]s.

use super::cost_model::{Cost, TimingScope, compute_work};
use super::{
    BounceSelection, ColorModeSelection, DisplayUse, Effect, FmmLimit, FrameStage, FrameState,
    Inventory, LightId, Pass, RunReason, SceneId, SkipReason, SkyUse, TierSelection, ViewId,
    ViewState,
};
use std::fmt;

/// Passes of one frame in order, and the reasons why others do not run.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Plan {
    /// Passes that run, in order.
    pub passes: Vec<Pass>,
    /// Scenes that do not run, with the reason. A view is named if it is the cause.
    pub skipped: Vec<(SceneId, Option<ViewId>, SkipReason)>,
    /// Lights that request a bounce off dynamic objects and draw no maps, with the reason. The
    /// virtual lights of [`SkipReason::AtRest`] are those of an earlier frame.
    pub without_maps: Vec<(LightId, SkipReason)>,
    /// Operator tier of each scene that runs, with the reason.
    pub tiers: Vec<(SceneId, TierSelection)>,
    /// Number of channels in which links are applied, with the reason.
    pub channels: Vec<(SceneId, ColorModeSelection)>,
    /// Number of diffuse reflections, with the reason. Omits bakes that hold their bounces.
    pub reflections: Vec<(SceneId, BounceSelection)>,
    /// Scenes that use links because the device does not hold their octree, with the limit.
    pub linked: Vec<(SceneId, FmmLimit)>,
    /// Scenes with a varying sky, and its treatment.
    pub skies: Vec<(SceneId, SkyUse)>,
    /// Views with layers, and the pixels at which they evaluate them.
    pub displays: Vec<(ViewId, DisplayUse)>,
    /// Scenes whose buffers are released, because no view contained them for long or their bake is
    /// gone.
    pub release: Vec<SceneId>,
    /// Costs of the passes, one entry per timing scope, in the order of the passes.
    pub costs: Vec<(TimingScope, Cost)>,
    /// Inventory of the world.
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
        plan.passes.sort_by_key(|pass| pass.stage);
        plan.costs = compute_work(effects, state, &mut plan.passes);
        plan
    }

    /// Returns `true` if nothing runs.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.passes.is_empty()
    }

    /// Returns the cost of this pass and of all passes in its timing scope. `None` if it is not
    /// timed.
    #[must_use]
    pub fn cost_of(&self, pass: &Pass) -> Option<&Cost> {
        let timed = pass.timing?;
        self.costs.iter().find(|(t, _)| *t == timed).map(|(_, c)| c)
    }

    /// Returns the passes of a light, in order.
    pub fn of_light(&self, light: LightId) -> impl Iterator<Item = &Pass> {
        self.passes.iter().filter(move |p| p.light == Some(light))
    }

    /// Returns the passes of a scene that all views share, in order.
    pub fn of_scene(&self, scene: SceneId) -> impl Iterator<Item = &Pass> {
        let own = move |p: &&Pass| p.scene == scene && p.view.is_none();
        self.passes.iter().filter(own)
    }

    /// Returns the passes of a view, in order.
    pub fn of_view(&self, view: ViewId) -> impl Iterator<Item = &Pass> {
        self.passes.iter().filter(move |p| p.view == Some(view))
    }

    /// Returns the number of passes of this stage.
    #[must_use]
    pub fn count(&self, stage: FrameStage) -> usize {
        self.passes.iter().filter(|p| p.stage == stage).count()
    }

    /// Returns the number of light slots that are projected, over all scenes.
    #[must_use]
    pub fn projected_slots(&self) -> usize {
        self.passes.iter().map(|p| p.slots.len()).sum()
    }

    /// Returns the baked scenes that have a pass, in ascending order.
    #[must_use]
    pub fn active_scenes(&self) -> Vec<SceneId> {
        let mut ids: Vec<_> = self.passes.iter().map(|p| p.scene).collect();
        ids.retain(|id| *id != SceneId::WORLD);
        ids.sort_unstable();
        ids.dedup();
        ids
    }

    /// Adds a pass of an effect, for all views.
    pub fn push(
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
            display: None,
            timing: None,
        });
        self.passes.last_mut().expect("just pushed")
    }

    /// Adds a layer of a view: a pass whose irradiance is evaluated together with that of the
    /// view's other layers.
    pub fn push_layer(
        &mut self,
        effect: &'static str,
        stage: FrameStage,
        scene: SceneId,
        view: &ViewState,
    ) {
        let pass = self.push(effect, stage, scene, RunReason::InView);
        (pass.view, pass.display) = (Some(view.id), Some(view.display));
        if self.displays.iter().all(|(id, _)| *id != view.id) {
            self.displays.push((view.id, view.display));
        }
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
        for (scene, view, reason) in &self.skipped {
            write!(f, "skip {scene}")?;
            if let Some(view) = view {
                write!(f, " in view {:x}", view.0)?;
            }
            writeln!(f, ": {reason}")?;
        }
        for (light, reason) in &self.without_maps {
            writeln!(f, "skip maps of light {light}: {reason}")?;
        }
        for (scene, selection) in &self.tiers {
            writeln!(f, "use  {scene} with {selection}")?;
        }
        for (scene, selection) in &self.channels {
            writeln!(f, "use  {scene} in {selection}")?;
        }
        for (scene, selection) in &self.reflections {
            writeln!(f, "use  {scene} with {selection}")?;
        }
        for (scene, reason) in &self.linked {
            writeln!(f, "use  {scene} with its links: {reason}")?;
        }
        for (scene, sky) in &self.skies {
            writeln!(f, "use  {scene} with {sky}")?;
        }
        for (view, display) in &self.displays {
            let (choice, reason) = (display.choice(), display.description());
            writeln!(f, "use  view {:x} with {choice}: {reason}", view.0)?;
        }
        for scene in &self.release {
            writeln!(f, "free {scene}")?;
        }
        Ok(())
    }
}
