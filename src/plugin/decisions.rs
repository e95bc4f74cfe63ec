//! Tells the log what the plan has decided, where that changed ([`DecisionLog`]).

use super::diagnostics::MeshlessGiStatus;
use crate::plan::DecisionLog;
use bevy::ecs::prelude::*;
use bevy::log::info;

/// Runs in [`MeshlessGiSystems::Collect`](super::MeshlessGiSystems::Collect).
pub(crate) fn tell(
    status: Res<MeshlessGiStatus>,
    mut log: Local<DecisionLog>,
    mut last: Local<u64>,
) {
    let counters = status.get();
    if counters.frame == *last {
        return;
    }
    *last = counters.frame;
    let lines = log.observe(counters.plan.decisions());
    if !lines.is_empty() {
        info!("indirect light, as planned: {}", lines.join("; "));
    }
}
