//! Costs of the passes on this device. Bevy's `RenderDiagnosticsPlugin` has one span for each group
//! of passes that is timed together. These spans update a [`CostModel`], which estimates the costs
//! of the next plans.
//!
//! The app has to add that plugin. Without it, the costs stay unknown, and the plan reports this.
//! The same holds without timestamps inside command encoders, which Bevy lacks on Metal and WebGPU.

use super::GiFrameStats;
use super::frame_record::FrameRecord;
use super::quality::{SolveCostSource, span_name};
use crate::plan::{CostModel, FrameStage, Pass, Plan, RunReason, TimingScope, Work, kind_of};
use bevy::diagnostic::{DiagnosticPath, DiagnosticsStore};
use bevy::ecs::prelude::*;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Model of the costs, shared by both worlds.
#[derive(Resource, Clone, Default)]
pub(crate) struct DeviceCosts(Arc<Mutex<CostModel>>);

impl DeviceCosts {
    fn model(&self) -> MutexGuard<'_, CostModel> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Writes the known costs into the plan.
    pub fn write_costs(&self, plan: &mut Plan) {
        self.model().write_costs(plan);
    }

    /// Removes all costs. Used after a change of the device.
    pub fn reset(&self) {
        *self.model() = CostModel::new();
    }
}

/// Names of the spans that time a scope, outermost first, below the span of its point of the frame.
/// The passes of a solve share the span of the solve.
pub(crate) fn spans(scope: &TimingScope) -> Vec<String> {
    let solve = (scope.is_solve).then(|| span_name(scope.scene.0));
    solve.into_iter().chain([scope.span()]).collect()
}

/// Names of the spans that time a map of a light: of its drawing, and of its reading.
pub(crate) fn map_spans(pass: &Pass, index: usize) -> [String; 2] {
    let name = TimingScope::new(pass.stage, pass).span();
    ["draw", "read"].map(|part| format!("meshless_gi_{name}_{part}_{index}"))
}

/// Diagnostic paths of the milliseconds of a scope, whose sum is its time. Empty if no pass of the
/// frame has the scope.
fn paths(scope: &TimingScope, frame: &FrameRecord) -> Vec<DiagnosticPath> {
    let mut passes = frame.plan.passes.iter();
    let Some(pass) = passes.find(|pass| pass.timing == Some(*scope)) else {
        return Vec::new();
    };
    let Some(kind) = kind_of(frame.effects, pass) else {
        return Vec::new();
    };
    let path = |names: &[&str]| {
        let names = names.iter().copied();
        DiagnosticPath::from_components(["render"].into_iter().chain(names).chain(["elapsed_gpu"]))
    };
    if scope.light.is_none() {
        let names = spans(scope);
        let names = names.iter().map(String::as_str);
        let names = [kind.record.how.point().span()].into_iter().chain(names);
        return vec![path(&names.collect::<Vec<_>>())];
    }
    let RunReason::ObjectsInRange(maps) = pass.reason else {
        return Vec::new();
    };
    let maps = (0..maps as usize).map(|i| map_spans(pass, i));
    maps.flatten().map(|name| path(&[&name])).collect()
}

/// Returns the milliseconds of a scope, and the time of its last measurement. `None` without a
/// measurement of each of its spans.
fn measurement(
    store: &DiagnosticsStore,
    scope: &TimingScope,
    frame: &FrameRecord,
) -> Option<(Instant, f64)> {
    let mut sum = None;
    for path in paths(scope, frame) {
        let found = store.get(&path)?.measurement()?;
        let (last, ms) = sum.unwrap_or((found.time, 0.0));
        sum = Some((found.time.max(last), ms + found.value));
    }
    sum
}

/// Runs in [`GiSystems::CollectBakes`](super::GiSystems::CollectBakes).
pub(crate) fn record_timings(
    status: Res<GiFrameStats>,
    costs: Res<DeviceCosts>,
    given: Res<SolveCostSource>,
    store: Option<Res<DiagnosticsStore>>,
    mut seen: Local<BTreeMap<TimingScope, (Instant, u64)>>,
    mut last: Local<u64>,
) {
    let counters = status.record();
    if counters.frame == *last {
        return;
    }
    *last = counters.frame;
    let mut model = costs.model();
    model.record_plan(&counters.plan);
    for (timed, cost) in &counters.plan.costs {
        if let (
            SolveCostSource::Given(of),
            FrameStage::APPLY,
            Work::Links(links) | Work::OneChannel(links),
        ) = (&*given, timed.stage, cost.work)
        {
            model.record_time(*timed, of(links));
            continue;
        }
        let measured = store.as_ref();
        let measured = measured.and_then(|store| measurement(store, timed, &counters));
        if let Some((time, ms)) = measured
            && seen.insert(*timed, (time, counters.frame)).map(|s| s.0) != Some(time)
        {
            model.record_time(*timed, ms as f32);
        }
    }
    // Spans that no plan had for long are removed.
    seen.retain(|_, (_, frame)| *frame + 1000 > counters.frame);
}
