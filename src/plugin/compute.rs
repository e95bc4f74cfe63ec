//! Plan of the frame, and the recording of the passes that all views share, before any camera
//! draws.

use super::effects::inspection::coefficients::SharedCoefficients;
use super::extract::ExtractedScene;
use super::gpu_timings::DeviceCosts;
use super::observe::{ExtractedResources, ExtractedWorld};
use super::record::{FramePoint, Recorder, SceneContext, record_scene};
use super::render_state::GiRender;
use crate::gpu::{GpuError, KernelPipelines};
use crate::plan::Plan;
use bevy::ecs::prelude::*;
use bevy::log::{error, warn};
use bevy::render::diagnostic::RecordDiagnostics;
use bevy::render::renderer::{RenderContext, RenderDevice, RenderQueue};

/// Checks that the device meets the requirements of the kernels.
pub(crate) fn check_device(device: &RenderDevice) -> Result<(), GpuError> {
    KernelPipelines::new(device.wgpu_device()).map(drop)
}

/// Bytes of the largest storage buffer that the device binds.
pub(super) fn largest_binding(device: &RenderDevice) -> u64 {
    let limits = device.limits();
    (limits.max_storage_buffer_binding_size).min(limits.max_buffer_size)
}

/// Plans the frame and records the passes of all scenes. Runs in
/// [`GiRenderSystems::Solve`](super::GiRenderSystems::Solve).
pub(crate) fn compute(
    extracted: ExtractedResources,
    mut render: ResMut<GiRender>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
    (coefficients, costs): (Res<SharedCoefficients>, Res<DeviceCosts>),
    mut ctx: RenderContext,
) {
    let world = ExtractedWorld::from(extracted);
    let render = &mut *render;
    if device.is_changed() {
        // Buffers of a lost device are of no use.
        costs.reset();
        *render = GiRender {
            frame: render.frame,
            effects: render.effects,
            ..GiRender::default()
        };
    }
    render.frame += 1;
    let mut state = render.observe(&world, largest_binding(&device));
    render.plan = Plan::new(render.effects, &state);
    costs.write_costs(&mut render.plan);
    render.prepare(&world.maps, device.wgpu_device());
    if render.plan.is_empty() {
        if render.scenes.values().all(|s| s.frame.is_none()) {
            render.kernels = None;
        }
        return;
    }
    if render.kernels.is_none() {
        match KernelPipelines::new(device.wgpu_device()) {
            Ok(kernels) => render.kernels = Some(kernels),
            Err(error) => {
                // `finish` has checked the first device. A new one after a loss may differ.
                render.is_device_unsupported = true;
                error!("indirect lighting stays off: {error}");
                render.plan = Plan::default();
                return;
            }
        }
    }
    let recorder = ctx.diagnostic_recorder();
    let recorder = recorder.as_deref();
    let encoder = ctx.command_encoder();
    let whole = recorder.time_span(encoder, FramePoint::Scenes.span());
    let mut failed = false;
    for (scene, state) in world.gi.scenes.iter().zip(&mut state.scenes) {
        let coefficients = &coefficients;
        let recorded = render.record_scene(scene, &world, &queue, encoder, recorder, coefficients);
        if let Err(bytes) = recorded {
            state.largest_buffer = bytes;
            failed = true;
        }
    }
    whole.end(encoder);
    if failed {
        // The passes of other scenes are the same. Views do not show the failed ones.
        render.plan = Plan::new(render.effects, &state);
        costs.write_costs(&mut render.plan);
    }
}

impl GiRender {
    /// Records the passes of a scene.
    ///
    /// # Errors
    /// Returns the bytes of the buffer that does not fit the device if a pass fails, `u64::MAX` for
    /// another limit. The scene is released then.
    fn record_scene(
        &mut self,
        scene: &ExtractedScene,
        world: &ExtractedWorld,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        recorder: Recorder<'_>,
        coefficients: &SharedCoefficients,
    ) -> Result<(), u64> {
        let (Some(runtime), Some(kernels)) = (self.scenes.get_mut(&scene.id), &self.kernels) else {
            return Ok(());
        };
        let mut ctx = SceneContext {
            kernels,
            queue,
            encoder,
            scene,
            volumes: &world.volumes,
            coefficients,
            earlier: runtime.states.take_transient(),
            runtime,
        };
        let recorded = record_scene(self.effects, &self.plan, &mut ctx, recorder);
        let Err(error) = recorded else {
            return Ok(());
        };
        let root = Entity::from_bits(scene.id.0);
        warn!("baked scene {root}: indirect lighting is off: {error}");
        let bytes = match error {
            GpuError::TooLarge { bytes, .. } => bytes,
            _ => u64::MAX,
        };
        runtime.too_large = Some((bytes, runtime.changes.slots.len()));
        self.release(scene.id);
        Err(bytes)
    }
}
