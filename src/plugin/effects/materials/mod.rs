//! Effect `materials`: uploads sender albedo and emission after a material change.
//!
//! Reads: whether the factors of a scene's materials differ from the uploaded ones. Copies buffers,
//! without a kernel.

pub(crate) mod dynamic_materials;

use super::{Effect, PassKind, Record, Recording};
use crate::gpu::GpuError;
use crate::plan::{FrameStage, FrameState, Pass, Plan, RunReason, Timing, Work};
use crate::plugin::record::SceneContext;
use crate::plugin::{GiDynamicMaterials, GiSystems, validation};
use bevy::app::{App, Last};
use bevy::asset::Assets;
use bevy::ecs::prelude::*;
use bevy::pbr::StandardMaterial;

pub(super) const EFFECT: Effect = Effect {
    name: "materials",
    summary: "uploads sender albedo and emission after a material change",
    schedule,
    passes: &[PassKind {
        stage: FrameStage::MATERIALS,
        per_view: false,
        timing: Timing::None,
        work: |_, _| Work::Uncounted,
        record: Recording {
            kernels: &[],
            draws: None,
            how: Record::Scene(record),
        },
    }],
};

/// Adds the component and its check to the main world.
pub(super) fn add_to_app(app: &mut App) {
    app.register_type::<GiDynamicMaterials>().add_systems(
        Last,
        dynamic_materials::check_textures
            .run_if(resource_exists::<Assets<StandardMaterial>>)
            .after(validation::check)
            .in_set(GiSystems::Validate),
    );
}

fn schedule(state: &FrameState, plan: &mut Plan) {
    for scene in state.active_scenes().filter(|s| s.materials_changed) {
        let (stage, reason) = (FrameStage::MATERIALS, RunReason::MaterialsChanged);
        plan.push(EFFECT.name, stage, scene.id, reason);
    }
}

fn record(ctx: &mut SceneContext<'_>, _: &Pass) -> Result<Option<()>, GpuError> {
    let factors = &ctx.scene.materials;
    let Some(frame) = &mut ctx.runtime.frame else {
        return Ok(None);
    };
    frame.set_materials(ctx.queue, &ctx.runtime.bake, factors);
    ctx.runtime.changes.factors.clone_from(factors);
    Ok(Some(()))
}
