//! Effects that carry the light on where anything that feeds it changed: the senders' surfaces
//! after materials changed, links that occluders are in the way of, and the operator.

use super::effect::active_scenes;
use super::{FrameStage, FrameState, Plan, RunReason, SkipReason, SkyUse, SlotChange};

pub(super) fn materials(state: &FrameState, plan: &mut Plan) {
    for scene in active_scenes(state).filter(|s| s.materials_changed) {
        let reason = RunReason::MaterialsChanged;
        plan.push("materials", FrameStage::MATERIALS, scene.id, reason);
    }
}

pub(super) fn occluders(state: &FrameState, plan: &mut Plan) {
    for scene in active_scenes(state).filter(|s| s.occluders_changed > 0) {
        let reason = RunReason::OccludersMoved(scene.occluders_changed);
        plan.push("occluders", FrameStage::OCCLUDE, scene.id, reason);
    }
}

pub(super) fn transport(state: &FrameState, plan: &mut Plan) {
    for scene in active_scenes(state) {
        if let Some(picked) = &scene.tier {
            plan.tiers.push((scene.id, picked.clone()));
        }
        // An octree takes all three.
        let octree = (scene.tier.as_ref()).is_some_and(|picked| picked.octree);
        if let (Some(picked), false) = (scene.channels, octree && scene.no_octree.is_none()) {
            plan.channels.push((scene.id, picked));
        }
        if let Some(picked) = scene.bounces {
            plan.reflections.push((scene.id, picked));
        }
        if let Some(why) = scene.no_octree {
            plan.linked.push((scene.id, why));
        }
        if scene.sky != SkyUse::Uniform {
            plan.skies.push((scene.id, scene.sky));
        }
        let of = |change| scene.slots.iter().filter(|s| **s == change).count();
        let reason = if !scene.resident {
            RunReason::NewBake
        } else if scene.occluders_changed > 0 {
            RunReason::OccludersMoved(scene.occluders_changed)
        } else if of(SlotChange::Geometry) > 0 {
            RunReason::LightsMoved(of(SlotChange::Geometry))
        } else if of(SlotChange::Color) > 0 {
            RunReason::LightsRecolored(of(SlotChange::Color))
        } else if scene.settings_changed {
            RunReason::SettingsChanged
        } else if scene.materials_changed {
            RunReason::MaterialsChanged
        } else if scene.stale {
            RunReason::LightRemoved
        } else {
            plan.skipped.push((scene.id, None, SkipReason::AtRest));
            continue;
        };
        for stage in [
            FrameStage::PULL_PUSH,
            FrameStage::APPLY,
            FrameStage::FLATTEN,
        ] {
            plan.push("transport", stage, scene.id, reason.clone());
        }
    }
}
