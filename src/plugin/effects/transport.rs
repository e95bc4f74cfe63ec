//! Effect `transport`: applies the operator when its input changed.
//!
//! Reads: changes of light slots, settings, materials and occluders since the last solve, and the
//! selected tier, channels and number of reflections. Kernels: `radiosity`, `pull`, `push`,
//! `compress`, `bounce`; `apply`, `apply_one`, `fmm_up`, `fmm_down`; `flatten`.

use super::{Effect, PassKind, Record, Recording, project_lights};
use crate::gpu;
use crate::gpu::GpuError;
use crate::plan::{
    FrameStage, FrameState, Pass, Plan, RunReason, SceneState, SkipReason, SkyUse, SlotChange,
    Timing, Work,
};
use crate::plugin::record::SceneContext;
use meshless_gi::Channels;

pub(super) const EFFECT: Effect = Effect {
    name: "transport",
    summary: "applies the operator when its input changed",
    schedule,
    passes: &[
        PassKind {
            stage: FrameStage::PULL_PUSH,
            per_view: false,
            timing: Timing::Solve(FrameStage::APPLY),
            work: |_, _| Work::Uncounted,
            record: Recording {
                kernels: &[
                    gpu::EntryPoint::Radiosity,
                    gpu::EntryPoint::Pull,
                    gpu::EntryPoint::Push,
                    gpu::EntryPoint::Compress,
                    gpu::EntryPoint::Sweep,
                    gpu::EntryPoint::Gather,
                    gpu::EntryPoint::Interpolate,
                    gpu::EntryPoint::Add,
                ],
                draws: None,
                how: Record::Scene(record_bounces),
            },
        },
        PassKind {
            stage: FrameStage::APPLY,
            per_view: false,
            timing: Timing::Solve(FrameStage::APPLY),
            work: |state, pass| {
                state.scene(pass.scene).map_or(Work::Uncounted, |scene| {
                    let links = scene.tier.as_ref().map_or(0, |selection| selection.work);
                    links_work(scene, links)
                })
            },
            record: Recording {
                // Expansions of the octree replace the operator.
                kernels: &[
                    gpu::EntryPoint::Apply,
                    gpu::EntryPoint::ApplyOne,
                    gpu::EntryPoint::FmmUp,
                    gpu::EntryPoint::FmmReceive,
                    gpu::EntryPoint::FmmEvaluate,
                ],
                draws: None,
                how: Record::Scene(record_apply),
            },
        },
        PassKind {
            stage: FrameStage::FLATTEN,
            per_view: false,
            timing: Timing::Solve(FrameStage::APPLY),
            work: |_, _| Work::Uncounted,
            record: Recording {
                kernels: &[gpu::EntryPoint::Averages, gpu::EntryPoint::Differences],
                draws: None,
                how: Record::Scene(record_flatten),
            },
        },
    ],
};

/// Links of a scene, in the number of channels in which they are applied.
pub(super) fn links_work(scene: &SceneState, links: u64) -> Work {
    match scene.channels.map(|selection| selection.channels) {
        Some(Channels::One(_)) if !uses_octree(scene) => Work::OneChannel(links),
        _ => Work::Links(links),
    }
}

/// Returns `true` if an octree replaces the links. An octree transports all three channels.
fn uses_octree(scene: &SceneState) -> bool {
    scene
        .tier
        .as_ref()
        .is_some_and(|selection| selection.octree)
        && scene.no_octree.is_none()
}

fn schedule(state: &FrameState, plan: &mut Plan) {
    for scene in state.active_scenes() {
        add_selections(scene, plan);
        let Some(reason) = solve_reason(scene) else {
            plan.skipped.push((scene.id, None, SkipReason::AtRest));
            continue;
        };
        for kind in EFFECT.passes {
            plan.push(EFFECT.name, kind.stage, scene.id, reason.clone());
        }
    }
}

/// Adds the selections of tier, channels, reflections and sky to the plan.
fn add_selections(scene: &SceneState, plan: &mut Plan) {
    if let Some(selection) = &scene.tier {
        plan.tiers.push((scene.id, selection.clone()));
    }
    if let (Some(selection), false) = (scene.channels, uses_octree(scene)) {
        plan.channels.push((scene.id, selection));
    }
    if let Some(selection) = scene.bounces {
        plan.reflections.push((scene.id, selection));
    }
    if let Some(limit) = scene.no_octree {
        plan.linked.push((scene.id, limit));
    }
    if scene.sky != SkyUse::Uniform {
        plan.skies.push((scene.id, scene.sky));
    }
}

/// Returns the reason for a solve of an active scene, and for the passes that follow it. `None` if
/// the device's values are up to date.
pub(super) fn solve_reason(scene: &SceneState) -> Option<RunReason> {
    let count = |change| scene.slots.iter().filter(|s| **s == change).count();
    Some(if !scene.resident {
        RunReason::NewBake
    } else if scene.occluders_changed > 0 {
        RunReason::OccludersMoved(scene.occluders_changed)
    } else if count(SlotChange::Geometry) > 0 {
        RunReason::LightsMoved(count(SlotChange::Geometry))
    } else if count(SlotChange::Color) > 0 {
        RunReason::LightsRecolored(count(SlotChange::Color))
    } else if scene.settings_changed {
        RunReason::SettingsChanged
    } else if scene.materials_changed {
        RunReason::MaterialsChanged
    } else if scene.stale {
        RunReason::LightRemoved
    } else {
        return None;
    })
}

fn record_bounces(ctx: &mut SceneContext<'_>, _: &Pass) -> Result<Option<()>, GpuError> {
    project_lights::upload(ctx)?;
    let Some(frame) = &mut ctx.runtime.frame else {
        return Ok(None);
    };
    let settings = ctx.scene.frame_settings();
    frame.pull_push(ctx.kernels, ctx.queue, ctx.encoder, &settings);
    Ok(Some(()))
}

fn record_apply(ctx: &mut SceneContext<'_>, _: &Pass) -> Result<Option<()>, GpuError> {
    let settings = ctx.scene.frame_settings();
    let Some(frame) = &mut ctx.runtime.frame else {
        return Ok(None);
    };
    frame.apply(ctx.kernels, ctx.encoder, &settings);
    ctx.runtime.solved_tier = Some(settings.tier);
    ctx.runtime.changes.slots.mark_applied();
    ctx.runtime.changes.solved = Some((settings, ctx.scene.solver.color_mode));
    // The volume holds the irradiance of an earlier frame until its pass is recorded.
    ctx.runtime.changes.volume = None;
    Ok(Some(()))
}

fn record_flatten(ctx: &mut SceneContext<'_>, _: &Pass) -> Result<Option<()>, GpuError> {
    let Some(frame) = &mut ctx.runtime.frame else {
        return Ok(None);
    };
    frame.flatten(ctx.kernels, ctx.encoder, &ctx.scene.frame_settings());
    Ok(Some(()))
}
