//! Effect `soft_shadows`: irradiance that is shadowed from lights with soft shadows, at the points
//! with baked visibility.
//!
//! Reads: the lights with soft shadows in a scene, whether the bake has visibility, and whether the
//! device holds the result for these lights. Runs when one of them changed and a view shows it.
//! Kernel: `soft_shadow`. The effect `subtract_shadow` subtracts the result from the views.

pub(crate) mod soft_lights;

use super::{Effect, PassKind, Record, Recording};
use crate::gpu;
use crate::gpu::{GpuCounters, GpuError, KernelPipelines, SceneBuffers, SoftShadowBuffers};
use crate::plan::{
    FrameStage, FrameState, Pass, Plan, RunReason, SceneState, SkipReason, SoftShadowState, Timing,
    ViewState, Work, soft_light_affects,
};
use crate::plugin::effect_states::EffectState;
use crate::plugin::effects::soft_shadows::soft_lights::ExtractedSoft;
use crate::plugin::extract::ExtractedScene;
use crate::plugin::observe::ExtractedWorld;
use crate::plugin::record::SceneContext;
use crate::plugin::render_state::{SceneRuntime, bounds};
use crate::plugin::transform::SimilarityTransform;
use crate::plugin::{GiRenderSystems, GiSoftShadow, GiSystems, validation};
use bevy::app::{App, Last, SubApp};
use bevy::camera::visibility::RenderLayers;
use bevy::ecs::prelude::*;
use bevy::log::warn;
use bevy::math::Mat4;
use bevy::render::ExtractSchedule;
use meshless_gi::internals::frame::SoftLight;
use meshless_gi::{BakedScene, Bounds};

pub(super) const EFFECT: Effect = Effect {
    name: "soft_shadows",
    summary: "updates the irradiance that is shadowed from lights with soft shadows",
    schedule,
    passes: &[PassKind {
        stage: FrameStage::SOFT_SHADOW,
        per_view: false,
        timing: Timing::With(FrameStage::SOFT_SHADOW),
        work: |state, pass| {
            let soft = state.scene(pass.scene).map(|scene| scene.soft);
            soft.map_or(Work::Uncounted, |soft| {
                Work::Sights(soft.points * soft.lights as u64)
            })
        },
        record: Recording {
            kernels: &[gpu::EntryPoint::SoftShadow],
            draws: None,
            how: Record::Scene(record),
        },
    }],
};

/// Checks that the bake and the device support soft shadows in a scene.
pub(super) fn check_supported(state: &FrameState, scene: &SceneState) -> Result<(), SkipReason> {
    if !scene.soft.has_visibility {
        Err(SkipReason::NoVisibility)
    } else if scene.soft.largest_buffer > state.largest_binding {
        Err(SkipReason::TooLarge {
            needs: scene.soft.largest_buffer,
            has: state.largest_binding,
        })
    } else {
        Ok(())
    }
}

/// Adds the component and its check to the main world.
pub(super) fn add_to_app(app: &mut App) {
    app.register_type::<GiSoftShadow>().add_systems(
        Last,
        (soft_lights::check_soft.after(validation::check)).in_set(GiSystems::Validate),
    );
}

/// Adds the extraction to the render world.
pub(super) fn add_to_render_app(render_app: &mut SubApp) {
    render_app.init_resource::<ExtractedSoft>().add_systems(
        ExtractSchedule,
        soft_lights::extract_soft.in_set(GiRenderSystems::Extract),
    );
}

fn schedule(state: &FrameState, plan: &mut Plan) {
    for scene in state.active_scenes().filter(|s| s.soft.lights > 0) {
        let shown = |view: &ViewState| view.lit && view.shows(scene.id);
        let reason = match check_supported(state, scene) {
            Err(reason) => {
                plan.skipped.push((scene.id, None, reason));
                continue;
            }
            Ok(()) if !state.views.iter().any(shown) => continue,
            Ok(()) if !scene.resident => RunReason::NewBake,
            Ok(()) if !scene.soft.held => RunReason::SoftLightsChanged(scene.soft.lights),
            Ok(()) => continue,
        };
        plan.push(EFFECT.name, FrameStage::SOFT_SHADOW, scene.id, reason);
    }
}

fn record(ctx: &mut SceneContext<'_>, pass: &Pass) -> Result<Option<()>, GpuError> {
    let Some(frame) = &ctx.runtime.frame else {
        return Ok(None);
    };
    let (scene, bake) = (frame.buffers(), &ctx.runtime.bake);
    let soft = ctx.runtime.states.get_or_default::<SceneSoft>();
    match soft.record(ctx.kernels, ctx.queue, ctx.encoder, scene, bake) {
        Ok(lights) => ctx.runtime.changes.soft_lights = lights,
        Err(error) => {
            let root = Entity::from_bits(pass.scene.0);
            warn!("baked scene {root}: lights cast no soft shadows: {error}");
        }
    }
    Ok(Some(()))
}

/// Describes the lights with soft shadows of a scene in view. Releases the buffers if there are
/// none, and returns the counters of the released ones.
pub(crate) fn observe(
    runtime: &mut SceneRuntime,
    scene: &ExtractedScene,
    placement: &SimilarityTransform,
    world: &ExtractedWorld,
    state: &mut SceneState,
) -> GpuCounters {
    let bounds = bounds(&runtime.bake);
    let soft = runtime.states.get_or_default::<SceneSoft>();
    soft.select_lights(&world.soft, bounds, &scene.layers, &placement.matrix());
    if soft.lights.is_empty() {
        runtime.changes.soft_lights = None;
    }
    state.soft = SoftShadowState {
        held: !(runtime.changes).soft_lights_changed(&soft.local_lights(), bounds),
        ..soft.describe(&runtime.bake)
    };
    let released = (soft.buffers).take_if(|_| soft.lights.is_empty());
    released.map_or_else(GpuCounters::default, |buffers| buffers.counters())
}

/// Lights with soft shadows of a scene, and their buffers.
#[derive(Default)]
pub(crate) struct SceneSoft {
    /// The lights of the scene, in its local space.
    pub lights: Vec<(RenderLayers, SoftLight)>,
    pub buffers: Option<SoftShadowBuffers>,
    /// Bytes of a buffer that did not fit the device.
    too_large: u64,
}

impl SceneSoft {
    /// Selects the lights of the frame that affect the scene.
    fn select_lights(
        &mut self,
        world: &ExtractedSoft,
        bounds: Bounds,
        layers: &RenderLayers,
        local_from_world: &Mat4,
    ) {
        self.lights.clear();
        for light in world.lights.iter().filter(|l| l.layers.intersects(layers)) {
            let local = light.light.to_local(local_from_world);
            if soft_light_affects(&local, bounds) {
                self.lights.push((light.layers.clone(), local));
            }
        }
    }

    /// Describes the lights for the plan. The change detector completes the description.
    fn describe(&self, bake: &BakedScene) -> SoftShadowState {
        SoftShadowState {
            lights: self.lights.len(),
            has_visibility: bake.data().visibility.is_some(),
            held: false,
            largest_buffer: self.too_large,
            points: (bake.data().visibility.as_ref()).map_or(0, |v| v.points.len() as u64),
        }
    }

    /// Returns the lights in the scene's local space.
    fn local_lights(&self) -> Vec<SoftLight> {
        self.lights.iter().map(|(_, light)| *light).collect()
    }

    /// Records the irradiance that is shadowed from the lights, at the points with visibility.
    /// Returns the lights. `None` if the bake has no visibility.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], see [`SoftShadowBuffers::new`]. The plan skips the effect from then
    /// on.
    fn record(
        &mut self,
        kernels: &KernelPipelines,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        scene: &SceneBuffers,
        bake: &BakedScene,
    ) -> Result<Option<Vec<SoftLight>>, GpuError> {
        let lights = self.local_lights();
        let Some(visibility) = &bake.data().visibility else {
            return Ok(None);
        };
        let mut record = || -> Result<(), GpuError> {
            let buffers = match &mut self.buffers {
                Some(buffers) => buffers,
                none => none.insert(SoftShadowBuffers::new(
                    kernels.device(),
                    queue,
                    scene,
                    visibility,
                    lights.len(),
                )?),
            };
            buffers.record(kernels, queue, encoder, scene, &lights)
        };
        match record() {
            Ok(()) => Ok(Some(lights)),
            Err(error) => {
                if let GpuError::TooLarge { bytes, .. } = &error {
                    self.too_large = *bytes;
                }
                Err(error)
            }
        }
    }
}

impl EffectState for SceneSoft {
    fn size(&self) -> (u32, u64) {
        let buffers = self.buffers.as_ref();
        buffers.map_or((0, 0), |buffers| (buffers.count(), buffers.bytes()))
    }

    fn counters(&self) -> GpuCounters {
        let buffers = self.buffers.as_ref();
        buffers.map_or_else(GpuCounters::default, SoftShadowBuffers::counters)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::{SceneId, SoftShadowState, ViewId};
    use crate::plugin::effects::{pass_of, plan_frame};

    const A: SceneId = SceneId(1);

    fn view(id: u64, lit: bool) -> ViewState {
        ViewState {
            lit,
            pixels: 1000,
            sees: vec![A],
            ..ViewState::new(ViewId(id))
        }
    }

    /// A scene on the device, a view of it, and no lights.
    fn static_state() -> FrameState {
        FrameState {
            scenes: vec![SceneState {
                resident: true,
                ..SceneState::new(A)
            }],
            views: vec![view(7, true)],
            ..FrameState::default()
        }
    }

    fn stages(state: &FrameState) -> Vec<FrameStage> {
        let plan = plan_frame(state);
        let all = plan.passes.iter().map(|p| p.stage);
        let transport = [
            FrameStage::PULL_PUSH,
            FrameStage::APPLY,
            FrameStage::FLATTEN,
        ];
        all.filter(|s| !transport.contains(s)).collect()
    }

    #[test]
    fn soft_shadows_run_once_for_casting_lights() {
        let mut state = static_state();
        // The bake has visibility, but no light casts soft shadows.
        state.scenes[0].soft.has_visibility = true;
        let none = plan_frame(&state);
        assert_eq!(
            none.count(FrameStage::SOFT_SHADOW) + none.count(FrameStage::SUBTRACT_SHADOW),
            0
        );
        // A light with soft shadows has moved.
        state.scenes[0].soft.lights = 2;
        let plan = plan_frame(&state);
        assert_eq!(
            stages(&state),
            [
                FrameStage::SOFT_SHADOW,
                FrameStage::SPLAT,
                FrameStage::COMPOSITE,
                FrameStage::SUBTRACT_SHADOW
            ]
        );
        assert_eq!(
            pass_of(&plan, FrameStage::SOFT_SHADOW, A).reason,
            RunReason::SoftLightsChanged(2)
        );
        assert_eq!(
            pass_of(&plan, FrameStage::SUBTRACT_SHADOW, A).view,
            Some(ViewId(7))
        );
        // At rest, the device keeps the missing light. It is subtracted from every view with the
        // final picture.
        state.scenes[0].soft.held = true;
        state.views.push(view(8, true));
        state.views.push(view(9, false));
        let plan = plan_frame(&state);
        assert_eq!(
            [
                FrameStage::SOFT_SHADOW,
                FrameStage::SPLAT,
                FrameStage::SUBTRACT_SHADOW
            ]
            .map(|s| plan.count(s)),
            [0, 3, 2]
        );
        // A bake that comes back has nothing of it.
        state.scenes[0].resident = false;
        assert_eq!(
            pass_of(&plan_frame(&state), FrameStage::SOFT_SHADOW, A).reason,
            RunReason::NewBake
        );
    }

    #[test]
    fn soft_shadows_without_data_state_reason() {
        type Change = fn(&mut FrameState);
        let requested = SoftShadowState {
            lights: 1,
            has_visibility: true,
            ..SoftShadowState::default()
        };
        let cases: [(Change, Option<SkipReason>); 3] = [
            (
                |s| s.scenes[0].soft.has_visibility = false,
                Some(SkipReason::NoVisibility),
            ),
            (
                |s| s.scenes[0].soft.largest_buffer = 1 << 40,
                Some(SkipReason::TooLarge {
                    needs: 1 << 40,
                    has: 128 << 20,
                }),
            ),
            (|s| s.views[0].lit = false, None),
        ];
        for (change, reason) in cases {
            let mut state = static_state();
            state.scenes[0].soft = requested;
            change(&mut state);
            let plan = plan_frame(&state);
            assert_eq!(
                stages(&state),
                [FrameStage::SPLAT, FrameStage::COMPOSITE],
                "{plan}"
            );
            let is_skipped = reason.is_none_or(|reason| plan.skipped.contains(&(A, None, reason)));
            assert!(is_skipped, "{plan}");
        }
    }
}
