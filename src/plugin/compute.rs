//! Plan of the frame, and the recording of the passes that all views share, before any camera
//! draws.

use super::extract::ExtractedScene;
use super::gpu_timings::DeviceCosts;
use super::observe::ExtractedWorld;
use super::readback::SharedCoefficients;
use super::record::{FramePoint, Recorder, SceneContext, record_scene};
use super::render_state::GiRender;
use crate::gpu::{GpuError, KernelPipelines};
use crate::plan::Plan;
use bevy::ecs::prelude::*;
use bevy::log::{error, warn};
use bevy::render::diagnostic::RecordDiagnostics;
use bevy::render::renderer::{RenderContext, RenderDevice, RenderQueue};

/// Checks that the device meets the requirements of the kernels.
pub(crate) fn device_able(device: &RenderDevice) -> Result<(), GpuError> {
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
    world: ExtractedWorld,
    mut render: ResMut<GiRender>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
    (coefficients, costs): (Res<SharedCoefficients>, Res<DeviceCosts>),
    mut ctx: RenderContext,
) {
    let render = &mut *render;
    if device.is_changed() {
        // Buffers of a lost device are of no use.
        costs.forget();
        *render = GiRender {
            frame: render.frame,
            effects: render.effects,
            ..GiRender::default()
        };
    }
    render.frame += 1;
    let state = render.observe(&world, largest_binding(&device), &coefficients);
    render.plan = Plan::new(render.effects, &state);
    costs.price(&mut render.plan);
    render.prepare(&world.maps, device.wgpu_device(), &coefficients);
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
                render.unable = true;
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
    for scene in &world.gi.scenes {
        render.record_scene(scene, &world, &queue, encoder, recorder, &coefficients);
    }
    whole.end(encoder);
}

impl GiRender {
    /// Records the passes of a scene, and releases it if one of them fails.
    fn record_scene(
        &mut self,
        scene: &ExtractedScene,
        world: &ExtractedWorld,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        recorder: Recorder<'_>,
        coefficients: &SharedCoefficients,
    ) {
        let (Some(runtime), Some(kernels)) = (self.scenes.get_mut(&scene.id), &self.kernels) else {
            return;
        };
        let read_back = runtime.read_back.take();
        let had_values = read_back.is_some();
        let mut ctx = SceneContext {
            kernels,
            queue,
            encoder,
            scene,
            volumes: &world.volumes,
            read_back,
            runtime,
        };
        let recorded = record_scene(self.effects, &self.plan, &mut ctx, recorder);
        if had_values && runtime.read_back.is_none() {
            coefficients.forget(scene.id.0);
        }
        if let Err(error) = recorded {
            let root = Entity::from_bits(scene.id.0);
            warn!("baked scene {root}: indirect lighting is off: {error}");
            let bytes = match error {
                GpuError::TooLarge { bytes, .. } => bytes,
                _ => u64::MAX,
            };
            runtime.too_large = Some((bytes, runtime.changes.slots.len()));
            self.release(scene.id);
        }
    }
}
