//! Counters of a rendered frame, from the buffers and passes of the render world.

use super::GiFrameStats;
use super::effects::count_stages;
use super::frame_record::FrameRecord;
use super::readback::SharedCoefficients;
use super::render_state::GiRender;
use crate::gpu::{GpuCounters, KernelPipelines};
use bevy::ecs::prelude::*;
use std::collections::BTreeMap;
use std::sync::Arc;

impl GiRender {
    /// Counts the buffers on the device, and the work since the last call.
    fn count(&mut self) -> FrameRecord {
        let mut total = self.retired;
        let mut counters = FrameRecord {
            frame: self.frame,
            pipelines: self
                .kernels
                .as_ref()
                .map_or(0, KernelPipelines::pipeline_count),
            active_scenes: self.plan.active_scenes().len() as u32,
            plan: self.plan.clone(),
            solved: self.solved_tiers(),
            ..FrameRecord::default()
        };
        self.count_scenes(&mut total, &mut counters);
        if let Some(reflections) = &self.reflections {
            total.add(&reflections.counters());
            let (buffers, bytes) = reflections.size();
            counters.buffers += buffers;
            counters.bytes += bytes;
        }
        for (id, view) in &mut self.views {
            if let Some(counts) = view.subsplats().and_then(|s| s.counts()) {
                counters.subsplats.insert(id.0, counts);
            }
            counters.buffers += view.buffer_count();
            counters.bytes += view.bytes();
        }
        for buffers in self.fogs.values() {
            counters.buffers += buffers.count();
            counters.bytes += buffers.bytes();
        }
        let recorded = total.difference_from(&self.counted);
        counters.dispatches = count_stages(self.effects, &self.plan, &recorded);
        counters.projected_slots = recorded.projected as u32;
        self.counted = total;
        counters
    }

    /// Adds the buffers of the scenes.
    fn count_scenes(&self, total: &mut GpuCounters, counters: &mut FrameRecord) {
        for (id, runtime) in &self.scenes {
            let mut of_scene = 0;
            if let Some(frame) = &runtime.frame {
                total.add(&frame.counters());
                counters.buffers += frame.buffers().count() as u32;
                of_scene += frame.buffers().bytes();
            }
            if let Some((counted, buffers, bytes)) = runtime.soft.size() {
                total.add(&counted);
                counters.buffers += buffers;
                of_scene += bytes;
            }
            let (buffers, bytes) = runtime.volume.size();
            counters.buffers += buffers;
            of_scene += bytes;
            if let Some(read_back) = &runtime.read_back {
                counters.buffers += 1;
                of_scene += read_back.bytes();
            }
            counters.bytes += of_scene;
            if runtime.frame.is_some() {
                counters.scene_bytes.insert(id.0, of_scene);
                let bake = Arc::as_ptr(&runtime.bake) as usize;
                counters.scene_bakes.insert(id.0, bake);
            }
        }
    }

    /// Tiers of the scenes that the frame solved, by the bits of their roots.
    fn solved_tiers(&self) -> BTreeMap<u64, u32> {
        let tiers = self
            .scenes
            .iter()
            .map(|(id, scene)| (id.0, scene.solved_tier));
        tiers.filter_map(|(id, tier)| Some((id, tier?))).collect()
    }
}

/// Publishes the counters of a submitted frame to the main world, and maps buffers that were copied
/// for the CPU.
pub(crate) fn publish(
    mut render: ResMut<GiRender>,
    status: Res<GiFrameStats>,
    coefficients: Res<SharedCoefficients>,
) {
    status.set(render.count());
    for (id, runtime) in &mut render.scenes {
        if let Some(read_back) = &mut runtime.read_back {
            read_back.fetch(id.0, &coefficients);
        }
    }
    for view in render.views.values_mut() {
        if let Some(subsplats) = view.subsplats() {
            subsplats.fetch();
        }
    }
}
