//! [`GiFrameStats`]: numbers and reasons of the last rendered frame.

use super::frame_record::FrameRecord;
use crate::plan::{LightId, Pass, SceneId, SkipReason, ViewId};
use bevy::ecs::prelude::*;
use bevy::reflect::prelude::*;
use meshless_gi::BakedScene;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::sync::{Arc, Mutex, PoisonError};

/// Statistics of one rendered frame.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct FrameStats {
    /// Number of rendered frames since the start, this one included.
    pub frame: u64,
    /// Number of pipelines that exist.
    pub pipelines: u32,
    /// Number of buffers that exist.
    pub buffers: u32,
    /// Size of these buffers, bytes.
    pub bytes: u64,
    /// Size of each bake on the device, bytes, by the root of its scene.
    pub scene_bytes: BTreeMap<Entity, u64>,
    /// Number of baked scenes that any pass touched.
    pub active_scenes: u32,
    /// Tier of the operator of each scene that was solved, by its root.
    pub solved: BTreeMap<Entity, u32>,
    /// Number of light slots that were projected.
    pub projected_slots: u32,
    /// Number of evaluations of the views that are shown by subsplats. It is a few frames old.
    pub subsplats: u32,
    /// Number of pixels of these views.
    pub subsplat_pixels: u32,
    /// Number of dispatches (draws, for `composite`; both, for `fog`) of each stage that ran, in
    /// the order of the frame.
    pub dispatches: Vec<(&'static str, u32)>,
    /// Passes that ran, in their order.
    pub passes: Vec<FramePass>,
    /// Scenes and lights without a pass, with the reason, one line each.
    pub skipped: Vec<String>,
}

/// Pass of a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct FramePass {
    /// Effect that requested the pass, for example `transport`.
    pub effect: &'static str,
    /// Stage of the frame, for example `apply`.
    pub stage: &'static str,
    /// Root of the scene. `None` for work that belongs to no bake.
    pub scene: Option<Entity>,
    /// Camera. `None` for work that all cameras share.
    pub camera: Option<Entity>,
    /// Light whose reflective shadow maps the pass draws. `None` for all other passes.
    pub light: Option<Entity>,
    /// Reason why it ran.
    pub reason: String,
}

impl FrameStats {
    /// Returns the number of dispatches of a stage. 0 if it did not run.
    #[must_use]
    pub fn dispatches_of(&self, stage: &str) -> u32 {
        let found = self.dispatches.iter().find(|(name, _)| *name == stage);
        found.map_or(0, |(_, count)| *count)
    }
}

fn root(scene: SceneId) -> Option<Entity> {
    Entity::try_from_bits(scene.0).filter(|_| scene != SceneId::WORLD)
}

fn camera(view: ViewId) -> Option<Entity> {
    Entity::try_from_bits(view.0)
}

fn light(light: LightId) -> Option<Entity> {
    Entity::try_from_bits(light.0)
}

fn by_root<T: Copy>(values: &BTreeMap<u64, T>) -> BTreeMap<Entity, T> {
    let values = values.iter();
    let values = values.filter_map(|(bits, value)| Some((Entity::try_from_bits(*bits)?, *value)));
    values.collect()
}

impl From<&Pass> for FramePass {
    fn from(pass: &Pass) -> Self {
        Self {
            effect: pass.effect,
            stage: pass.stage.name(),
            scene: root(pass.scene),
            camera: pass.view.and_then(camera),
            light: pass.light.and_then(light),
            reason: pass.reason.to_string(),
        }
    }
}

impl From<&FrameRecord> for FrameStats {
    fn from(record: &FrameRecord) -> Self {
        let (subsplats, subsplat_pixels) = record.subsplat_totals();
        let plan = &record.plan;
        let dispatches = record.dispatches.iter();
        let entity = |bits: u64| match Entity::try_from_bits(bits) {
            Some(entity) => entity.to_string(),
            None => "none".into(),
        };
        let scenes = (plan.skipped.iter()).map(|(scene, view, reason)| match view {
            Some(view) => {
                let (scene, camera) = (entity(scene.0), entity(view.0));
                format!("scene {scene}, camera {camera}: {reason}")
            }
            None => format!("scene {}: {reason}", entity(scene.0)),
        });
        let without_maps = |(id, reason): &(LightId, SkipReason)| {
            format!("bounce of light {}: {reason}", entity(id.0))
        };
        Self {
            frame: record.frame,
            pipelines: record.pipelines,
            buffers: record.buffers,
            bytes: record.bytes,
            scene_bytes: by_root(&record.scene_bytes),
            active_scenes: record.active_scenes,
            solved: by_root(&record.solved),
            projected_slots: record.projected_slots,
            subsplats,
            subsplat_pixels,
            dispatches: dispatches.map(|(stage, n)| (stage.name(), *n)).collect(),
            passes: plan.passes.iter().map(FramePass::from).collect(),
            skipped: scenes
                .chain(plan.without_maps.iter().map(without_maps))
                .collect(),
        }
    }
}

/// Statistics of the last rendered frame, in both worlds. Read them with [`get`](Self::get), or
/// from Bevy's diagnostics.
#[derive(Resource, Reflect, Clone, Default)]
#[reflect(opaque)]
#[reflect(Resource, Default, Clone)]
pub struct GiFrameStats(Arc<Mutex<Arc<FrameRecord>>>);

impl GiFrameStats {
    /// Returns numbers, passes and reasons.
    #[must_use]
    pub fn get(&self) -> FrameStats {
        (&*self.record()).into()
    }

    /// Returns the plan as text, as the overlay of the examples shows it: inventory of the world,
    /// passes with their reasons and costs, skipped work, and choices that a setting made. Entities
    /// are given by their bits, as hexadecimal numbers.
    #[must_use]
    pub fn plan_text(&self) -> String {
        let record = self.record();
        let mut text = record.plan.to_string();
        for decision in record.plan.decisions() {
            if let Some(setting) = decision.forced {
                let _ = writeln!(text, "{}: set by {setting}", decision.kind);
            }
        }
        text
    }

    /// Counters and plan, shared.
    #[doc(hidden)]
    #[must_use]
    pub fn record(&self) -> Arc<FrameRecord> {
        self.0
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone()
    }

    /// Returns the bytes on the device of the scene on the root with these bits. `None` if the
    /// device does not hold `bake`.
    pub(crate) fn bytes_of(&self, root: u64, bake: &Arc<BakedScene>) -> Option<u64> {
        let record = self.record();
        let held = record.scene_bakes.get(&root)?;
        let bytes = record.scene_bytes.get(&root).copied();
        bytes.filter(|_| *held == Arc::as_ptr(bake) as usize)
    }

    pub(crate) fn set(&self, record: FrameRecord) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Arc::new(record);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::{FrameStage, Plan, RunReason};

    fn entity(index: u32) -> Entity {
        Entity::from_raw_u32(index).expect("a valid index")
    }

    /// A record with one pass of a scene and one of the world, and two skips.
    fn record() -> FrameRecord {
        let [scene, view, lit] = [1, 2, 3].map(|i| entity(i).to_bits());
        let mut plan = Plan::default();
        let (apply, rsm) = (FrameStage::APPLY, FrameStage::RSM);
        plan.push("transport", apply, SceneId(scene), RunReason::NewBake);
        let pass = plan.push("bounce", rsm, SceneId::WORLD, RunReason::NewBake);
        pass.view = Some(ViewId(view));
        pass.light = Some(LightId(lit, 0));
        let hidden = (SceneId(scene), Some(ViewId(view)), SkipReason::Hidden);
        plan.skipped.push(hidden);
        plan.without_maps
            .push((LightId(lit, 0), SkipReason::LightDark));
        FrameRecord {
            frame: 7,
            scene_bytes: [(scene, 100)].into(),
            solved: [(scene, 2)].into(),
            dispatches: [(rsm, 1), (apply, 3)].into(),
            plan,
            ..FrameRecord::default()
        }
    }

    #[test]
    fn frame_stats_has_entities_and_reasons_of_the_plan() {
        let status = GiFrameStats::default();
        status.set(record());
        let stats = status.get();
        let [scene, view, lit] = [1, 2, 3].map(|i| Some(entity(i)));
        assert_eq!(stats.frame, 7);
        assert_eq!(stats.dispatches, [("apply", 3), ("rsm", 1)]);
        assert_eq!(stats.dispatches_of("apply"), 3);
        assert_eq!(stats.dispatches_of("fog"), 0);
        assert_eq!(stats.scene_bytes[&entity(1)], 100);
        assert_eq!(stats.solved[&entity(1)], 2);
        let [apply, rsm] = &stats.passes[..] else {
            panic!("{:?}", stats.passes);
        };
        assert_eq!((apply.effect, apply.stage), ("transport", "apply"));
        assert_eq!(
            (apply.scene, apply.camera, apply.light),
            (scene, None, None)
        );
        assert_eq!((rsm.scene, rsm.camera, rsm.light), (None, view, lit));
        assert_eq!(apply.reason, RunReason::NewBake.to_string());
        let [scene, view, lit] = [1, 2, 3].map(entity);
        let (hidden, dark) = (SkipReason::Hidden, SkipReason::LightDark);
        assert_eq!(
            stats.skipped,
            [
                format!("scene {scene}, camera {view}: {hidden}"),
                format!("bounce of light {lit}: {dark}"),
            ]
        );
    }

    #[test]
    fn plan_text_lists_passes_and_choices_of_settings() {
        let status = GiFrameStats::default();
        status.set(record());
        let text = status.plan_text();
        assert!(text.contains("run  apply of scene"), "{text}");
        assert!(
            text.contains("set by the visibility of the scene"),
            "{text}"
        );
    }
}
