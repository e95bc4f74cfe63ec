//! Effect `volume`: probe irradiance as a volume, for cameras without a G-buffer and for fog.
//!
//! Reads: the volume of a scene and the cameras that show it, the state of its texture, and the
//! solve of the scene in this frame. Kernel: `volume`.

pub(crate) mod irradiance_volume;
pub(crate) mod shader;

use super::fog::fog_volumes::extract_fogs;
use super::transport::solve_reason;
use super::{Effect, PassKind, Record, Recording};
use crate::gpu;
use crate::gpu::{KernelPipelines, VolumeBuffers};
use crate::plan::{
    FrameStage, FrameState, Plan, RunReason, SceneId, SceneState, SkipReason, Timing, VolumeState,
    Work,
};
use crate::plugin::effect_states::EffectState;
use crate::plugin::effects::volume::irradiance_volume::{ExtractedVolume, ExtractedVolumes};
use crate::plugin::extract::ExtractedScene;
use crate::plugin::observe::ExtractedWorld;
use crate::plugin::record::SceneContext;
use crate::plugin::render_state::SceneRuntime;
use crate::plugin::transform::SimilarityTransform;
use crate::plugin::{GiIrradianceVolume, GiRenderSystems, GiSystems, extract, validation};
use bevy::app::{App, Last, PostUpdate, SubApp};
use bevy::asset::{AssetEventSystems, Assets};
use bevy::camera::visibility::VisibilitySystems;
use bevy::ecs::prelude::*;
use bevy::image::Image;
use bevy::log::warn;
use bevy::math::Mat4;
use bevy::render::ExtractSchedule;
use bevy::transform::TransformSystems;
use meshless_gi::BakedScene;
use meshless_gi::internals::frame::{VolumeParams, VoxelGrid, VoxelWeights};

pub(super) const EFFECT: Effect = Effect {
    name: "volume",
    summary: "writes probe irradiance into a volume, for cameras without a G-buffer and for fog",
    schedule,
    passes: &[PassKind {
        stage: FrameStage::VOLUME,
        per_view: false,
        timing: Timing::With(FrameStage::VOLUME),
        work: |state, pass| {
            let volume = state.scene(pass.scene).map(|scene| scene.volume);
            volume.map_or(Work::Uncounted, |volume| Work::Voxels(volume.voxels))
        },
        record: Recording {
            kernels: &[gpu::EntryPoint::Volume],
            draws: None,
            how: Record::Scene(|ctx, _| Ok(SceneVolume::record(ctx))),
        },
    }],
};

/// Adds the component, its textures and its check to the main world.
pub(super) fn add_to_app(app: &mut App) {
    app.register_type::<GiIrradianceVolume>()
        .add_systems(
            PostUpdate,
            (
                irradiance_volume::update_irradiance_volumes
                    .in_set(GiSystems::UpdateVolumes)
                    .before(TransformSystems::Propagate)
                    .before(AssetEventSystems)
                    .run_if(resource_exists::<Assets<Image>>),
                shader::replace
                    .in_set(GiSystems::UpdateVolumes)
                    .before(AssetEventSystems),
                irradiance_volume::hide_irradiance_volumes
                    .in_set(GiSystems::FilterVolumes)
                    .after(VisibilitySystems::CheckVisibility),
            ),
        )
        .add_systems(
            Last,
            (irradiance_volume::check_volumes.after(validation::check)).in_set(GiSystems::Validate),
        );
}

/// Adds the extraction to the render world. It reads the fog, which a volume may light.
pub(super) fn add_to_render_app(render_app: &mut SubApp) {
    render_app.init_resource::<ExtractedVolumes>().add_systems(
        ExtractSchedule,
        irradiance_volume::extract_volumes
            .after(extract::extract)
            .after(extract_fogs)
            .in_set(GiRenderSystems::Extract),
    );
}

fn schedule(state: &FrameState, plan: &mut Plan) {
    for scene in (state.active_scenes()).filter(|s| s.volume.requested && s.volume.is_visible) {
        let reason = match solve_reason(scene) {
            _ if !scene.probes => {
                plan.skipped.push((scene.id, None, SkipReason::NoProbes));
                continue;
            }
            Some(reason) => reason,
            None if !scene.volume.held => RunReason::NewVolume,
            None => continue,
        };
        plan.push(EFFECT.name, FrameStage::VOLUME, scene.id, reason);
    }
}

/// Number of functions of probes and surfaces evaluated in a frame while a volume's weights are
/// computed. They take some milliseconds of one core.
const EVALUATIONS_PER_FRAME: u64 = 1 << 19;

/// Parameters and texture of a volume.
pub(crate) type VolumeTarget = (VolumeParams, wgpu::TextureView);

/// Volume that a scene is to have.
struct VolumeRequest<'a> {
    volume: &'a ExtractedVolume,
    target: VolumeTarget,
}

impl<'a> VolumeRequest<'a> {
    /// Finds the volume of a scene. `None` if it has none.
    fn new(world: &'a ExtractedVolumes, id: SceneId, local_from_world: &Mat4) -> Option<Self> {
        let volume = world.find(id)?;
        let params = VolumeParams::new(volume.shape(), local_from_world);
        Some(Self {
            volume,
            target: (params, volume.texture.clone()),
        })
    }
}

/// Returns `true` if a camera shows the scene by its volume, or fog in it.
pub(crate) fn is_visible(world: &ExtractedVolumes, id: SceneId) -> bool {
    world.find(id).is_some_and(|volume| volume.is_visible)
}

/// Describes the volume of a scene in view. Releases it if the scene has none.
pub(crate) fn observe(
    runtime: &mut SceneRuntime,
    scene: &ExtractedScene,
    placement: &SimilarityTransform,
    world: &ExtractedWorld,
    state: &mut SceneState,
) {
    match VolumeRequest::new(&world.volumes, scene.id, &placement.matrix()) {
        Some(requested) => {
            let volume = runtime.states.get_or_default::<SceneVolume>();
            state.volume = VolumeState {
                held: !runtime.changes.volume_changed(&requested.target),
                ..volume.describe(&requested)
            };
        }
        None => {
            runtime.states.take::<SceneVolume>();
            runtime.changes.volume = None;
        }
    }
}

/// Device data of a scene's volume without its texture.
#[derive(Default)]
pub(crate) struct SceneVolume {
    /// Weights, computed over several frames. `None` once the device has them.
    weights: Option<VoxelWeights>,
    buffers: Option<VolumeBuffers>,
    /// A volume that the device does not hold.
    refused: Option<VoxelGrid>,
}

impl SceneVolume {
    /// Describes a volume for the plan. The change detector completes the description.
    fn describe(&self, requested: &VolumeRequest<'_>) -> VolumeState {
        let shape = *requested.volume.shape();
        VolumeState {
            requested: self.refused != Some(shape),
            is_visible: requested.volume.is_visible,
            held: false,
            voxels: u64::from(shape.voxels()),
        }
    }

    /// Continues the search for the volume's weights, and records its voxels once all are found.
    /// Returns `None` if the scene has no volume, or is not on the device.
    fn record(ctx: &mut SceneContext<'_>) -> Option<()> {
        let SceneRuntime {
            states,
            frame,
            bake,
            changes,
            ..
        } = &mut *ctx.runtime;
        let (placement, frame) = (ctx.scene.placement.as_ref()?, frame.as_mut()?);
        let VolumeRequest {
            volume: extracted,
            target,
        } = VolumeRequest::new(ctx.volumes, ctx.scene.id, &placement.matrix())?;
        let volume = states.get_or_default::<Self>();
        volume.prepare(*extracted.shape(), bake, ctx.kernels, ctx.queue);
        if let Some(buffers) = &volume.buffers {
            let (params, texture) = &target;
            frame.volume(
                ctx.kernels,
                ctx.queue,
                ctx.encoder,
                buffers,
                params,
                texture,
            );
            changes.volume = Some(target);
        }
        Some(())
    }

    /// Continues the preparation of a volume. Its buffers exist once the preparation is complete.
    fn prepare(
        &mut self,
        shape: VoxelGrid,
        bake: &BakedScene,
        kernels: &KernelPipelines,
        queue: &wgpu::Queue,
    ) {
        if self.buffers.as_ref().is_some_and(|b| *b.shape() == shape) {
            return;
        }
        self.buffers = None;
        if bake.data().probes.is_none() {
            return;
        }
        let begun = self.weights.take().filter(|p| *p.shape() == shape);
        let mut weights = begun.unwrap_or_else(|| VoxelWeights::new(shape));
        if !weights.find(bake.data(), EVALUATIONS_PER_FRAME) {
            self.weights = Some(weights);
            return;
        }
        match VolumeBuffers::new(kernels.device(), queue, &weights) {
            Ok(buffers) => self.buffers = Some(buffers),
            Err(error) => {
                warn!("a volume for forward cameras and fog is disabled: {error}");
                self.refused = Some(shape);
            }
        }
    }
}

impl EffectState for SceneVolume {
    fn size(&self) -> (u32, u64) {
        let Some(buffers) = &self.buffers else {
            return (0, 0);
        };
        let texture = 8 * u64::from(buffers.shape().texels().element_product());
        (buffers.count(), buffers.bytes() + texture)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::{SceneId, SlotChange, ViewId, ViewState, VolumeState};
    use crate::plugin::effects::{pass_of, plan_frame};

    const A: SceneId = SceneId(1);

    /// Returns a scene on the device with probes, and no view with a G-buffer.
    fn static_state() -> FrameState {
        FrameState {
            scenes: vec![SceneState {
                resident: true,
                probes: true,
                slots: vec![SlotChange::None; 2],
                ..SceneState::new(A)
            }],
            ..FrameState::default()
        }
    }

    fn deferred() -> ViewState {
        ViewState {
            pixels: 1000,
            sees: vec![A],
            ..ViewState::new(ViewId(3))
        }
    }

    fn stages(state: &FrameState) -> Vec<FrameStage> {
        plan_frame(state).passes.iter().map(|p| p.stage).collect()
    }

    #[test]
    fn probe_passes_run_for_bakes_with_probes() {
        let mut state = static_state();
        state.views.push(deferred());
        state.scenes[0].probes = false;
        assert_eq!(stages(&state), [FrameStage::SPLAT, FrameStage::COMPOSITE]);
        state.scenes[0].probes = true;
        assert_eq!(
            stages(&state),
            [
                FrameStage::SPLAT,
                FrameStage::PROBE_PIXELS,
                FrameStage::COMPOSITE
            ]
        );
        state.scenes[0].slots[1] = SlotChange::Geometry;
        assert_eq!(
            stages(&state),
            [
                FrameStage::PROJECT,
                FrameStage::PULL_PUSH,
                FrameStage::APPLY,
                FrameStage::FLATTEN,
                FrameStage::PROBE,
                FrameStage::SPLAT,
                FrameStage::PROBE_PIXELS,
                FrameStage::COMPOSITE
            ]
        );
    }

    #[test]
    fn volume_is_written_on_light_change() {
        let mut state = static_state();
        // Without a volume and a camera.
        assert_eq!(stages(&state), []);
        assert_eq!(
            plan_frame(&state).skipped,
            [(A, None, SkipReason::NotInView)]
        );
        // First a volume out of view, then a view without a volume.
        state.scenes[0].volume.requested = true;
        assert_eq!(stages(&state), []);
        state.scenes[0].volume = VolumeState {
            is_visible: true,
            ..VolumeState::default()
        };
        assert_eq!(stages(&state), []);
        // A new volume of a scene at rest, and one that is written.
        state.scenes[0].volume.requested = true;
        assert_eq!(stages(&state), [FrameStage::VOLUME]);
        let plan = plan_frame(&state);
        assert_eq!(
            pass_of(&plan, FrameStage::VOLUME, A).reason,
            RunReason::NewVolume
        );
        state.scenes[0].volume.held = true;
        assert_eq!(stages(&state), []);
        // A moving light adds one pass after the transport of its light.
        state.scenes[0].slots[1] = SlotChange::Geometry;
        assert_eq!(
            stages(&state),
            [
                FrameStage::PROJECT,
                FrameStage::PULL_PUSH,
                FrameStage::APPLY,
                FrameStage::FLATTEN,
                FrameStage::PROBE,
                FrameStage::VOLUME
            ]
        );
        // A deferred camera in the same frame has its own display.
        state.views.push(deferred());
        state.scenes[0].slots[1] = SlotChange::None;
        assert_eq!(
            stages(&state),
            [
                FrameStage::SPLAT,
                FrameStage::PROBE_PIXELS,
                FrameStage::COMPOSITE
            ]
        );
        // A bake without probes skips the effect with a reason.
        state.scenes[0].probes = false;
        state.scenes[0].volume.held = false;
        assert_eq!(stages(&state), [FrameStage::SPLAT, FrameStage::COMPOSITE]);
        let reason = (A, None, SkipReason::NoProbes);
        assert!(plan_frame(&state).skipped.contains(&reason));
    }
}
