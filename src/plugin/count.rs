//! Counters of a rendered frame, from the buffers and passes of the render world.

use super::GiFrameStats;
use super::effect_states::EffectStates;
use super::effects::count_stages;
use super::effects::display::splatting::ViewSubsplats;
use super::frame_record::FrameRecord;
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
            effects: self.effects,
            plan: self.plan.clone(),
            solved: self.solved_tiers(),
            ..FrameRecord::default()
        };
        self.count_scenes(&mut total, &mut counters);
        total.add(&self.states.counters());
        for states in self.post_process.values().chain([&self.states]) {
            let (buffers, bytes) = states.size();
            counters.buffers += buffers;
            counters.bytes += bytes;
        }
        for (id, view) in &self.views {
            let subsplats = view.states.get::<ViewSubsplats>();
            if let Some(counts) = subsplats.and_then(ViewSubsplats::counts) {
                counters.subsplats.insert(id.0, counts);
            }
            counters.buffers += view.buffer_count();
            counters.bytes += view.bytes();
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
            total.add(&runtime.states.counters());
            let (buffers, bytes) = runtime.states.size();
            counters.buffers += buffers;
            of_scene += bytes;
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
pub(crate) fn publish(mut render: ResMut<GiRender>, status: Res<GiFrameStats>) {
    status.set(render.count());
    let GiRender {
        scenes,
        views,
        post_process,
        states,
        ..
    } = &mut *render;
    let of_scenes = scenes.values_mut().map(|scene| &mut scene.states);
    let of_views = views.values_mut().map(|view| &mut view.states);
    let all = of_scenes.chain(of_views).chain(post_process.values_mut());
    all.chain([states]).for_each(EffectStates::finish_frame);
}
