//! Logs the plan's decisions at level DEBUG, each when it changes ([`DecisionLog`]).

use super::GiFrameStats;
use super::scene_log::entity_label;
use crate::plan::DecisionLog;
use bevy::ecs::name::Name;
use bevy::ecs::prelude::*;
use bevy::log::debug;

/// Runs in [`GiSystems::CollectBakes`](super::GiSystems::CollectBakes).
pub(crate) fn log_decisions(
    status: Res<GiFrameStats>,
    names: Query<&Name>,
    mut log: Local<DecisionLog>,
    mut last: Local<u64>,
) {
    let counters = status.record();
    if counters.frame == *last {
        return;
    }
    *last = counters.frame;
    let label = |bits: u64| {
        let entity = Entity::try_from_bits(bits)?;
        Some(entity_label(entity, names.get(entity).ok()))
    };
    for line in log.observe(counters.plan.decisions(), &label) {
        debug!("{line}");
    }
}
