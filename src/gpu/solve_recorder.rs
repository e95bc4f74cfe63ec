//! Recording of the steps of a solve as dispatches.

use super::dispatch::MAX_GROUPS;
use super::pipelines::KernelPipelines;
use super::scene_buffers::SceneBuffers;
use super::spans::SpanList;
use super::{EntryPoint, GpuCounters};
use meshless_gi::internals::frame::SolveSchedule;

/// Returns the buffers of the operator's input and output in the form of its senders.
fn operands(b: &SceneBuffers) -> [&wgpu::Buffer; 2] {
    match (&b.differences, &b.components) {
        (Some([senders, receivers]), _) => [senders, receivers],
        (None, Some(c)) => [&c.components, &b.values],
        (None, None) => [&b.senders, &b.values],
    }
}

/// Records the steps of a solve. Each dispatch reads the output of earlier dispatches in the same
/// pass.
pub(super) struct SolveRecorder<'a> {
    pub kernels: &'a KernelPipelines,
    pub b: &'a SceneBuffers,
    pub counters: &'a mut GpuCounters,
}

impl SolveRecorder<'_> {
    pub fn radiosity(&mut self, pass: &mut wgpu::ComputePass<'_>) {
        let b = self.b;
        let bind = self.kernels.bind(
            EntryPoint::Radiosity,
            &[
                (0, b.params.as_entire_binding()),
                (2, b.lights.as_entire_binding()),
                (3, b.projected.as_entire_binding()),
                (4, b.points.as_entire_binding()),
                (5, b.surfaces.as_entire_binding()),
                (6, b.senders.as_entire_binding()),
                (7, b.sky_visibility().as_entire_binding()),
            ],
        );
        // The sky's coefficient is written even without points.
        let senders = b.shape.senders().max(1) as u32;
        self.dispatch(pass, EntryPoint::Radiosity, &bind, &[], senders);
    }

    /// Pulls the levels, finest first.
    pub fn pull(&mut self, pass: &mut wgpu::ComputePass<'_>, levels: std::ops::Range<usize>) {
        if levels.is_empty() {
            return;
        }
        let b = self.b;
        let bind = self.kernels.bind(
            EntryPoint::Pull,
            &[
                (1, self.span()),
                (2, b.pull_starts.as_entire_binding()),
                (3, b.pull_entries.as_entire_binding()),
                (4, b.senders.as_entire_binding()),
            ],
        );
        for level in levels.rev() {
            self.spans(pass, EntryPoint::Pull, &bind, &b.levels, level..level + 1);
        }
    }

    /// Pushes or compresses the senders and applies the operator, or runs both passes of the
    /// octree. `sweep` restricts it to the senders' rows.
    pub fn apply_operator(
        &mut self,
        pass: &mut wgpu::ComputePass<'_>,
        steps: &SolveSchedule,
        tier: u32,
        sweep: bool,
    ) {
        let b = self.b;
        if let Some(octree) = b.fmm.as_ref().filter(|_| steps.octree) {
            octree.record_upward(self.kernels, pass, self.counters, &b.senders);
            let (from, to) = (&b.senders, &b.values);
            octree.record_downward(self.kernels, pass, self.counters, from, to);
            return;
        }
        let [coefficients, applied] = operands(b);
        if steps.differences {
            self.push(pass, steps.senders.len(), coefficients);
        }
        if steps.components {
            self.compress(pass);
        }
        let lists = match sweep {
            true => &b.sender_parts,
            false => &b.tier_parts,
        };
        if let Some(list) = lists.get((tier as usize).wrapping_sub(1)) {
            let (rows, values) = ([&b.rows, &b.order], [coefficients, applied]);
            self.apply(pass, steps.one, rows, &b.links, list, values);
        }
    }

    /// Computes the points' values after [`apply_operator`](Self::apply_operator). `sweep`
    /// restricts it to the senders.
    pub fn flatten(
        &mut self,
        pass: &mut wgpu::ComputePass<'_>,
        steps: &SolveSchedule,
        sweep: bool,
    ) {
        let b = self.b;
        let (senders, all) = (steps.senders.len(), steps.levels.len());
        if steps.octree && b.fmm.is_some() {
            // Only points finer than senders take the mean of their parents.
            let finer = if sweep { 0..0 } else { senders..all };
            self.averages(pass, finer);
        } else if steps.differences {
            let [_, applied] = operands(b);
            let bind = self.kernels.bind(
                EntryPoint::Differences,
                &[
                    (1, self.span()),
                    (3, b.parent_starts.as_entire_binding()),
                    (4, b.parent_entries.as_entire_binding()),
                    (5, applied.as_entire_binding()),
                    (6, b.values.as_entire_binding()),
                ],
            );
            let list = usize::from(sweep);
            self.spans(
                pass,
                EntryPoint::Differences,
                &bind,
                &b.whole,
                list..list + 1,
            );
        } else {
            self.averages(pass, 0..if sweep { senders } else { all });
        }
    }

    /// Applies the probes' rows to the senders.
    pub fn apply_probes(&mut self, pass: &mut wgpu::ComputePass<'_>, steps: &SolveSchedule) {
        let b = self.b;
        let Some(probes) = &b.probes else { return };
        self.apply(
            pass,
            steps.one,
            [&probes.rows, &probes.order],
            &probes.links,
            &probes.parts,
            [&b.senders, &probes.values],
        );
    }

    /// Applies the operator in all channels or in `one`. Reads `rows` and their order, and the
    /// links chunk by chunk with the span of each. The first of `values` is the input, the second
    /// the output.
    pub fn apply(
        &mut self,
        pass: &mut wgpu::ComputePass<'_>,
        one: bool,
        rows: [&wgpu::Buffer; 2],
        links: &[wgpu::Buffer],
        list: &SpanList,
        values: [&wgpu::Buffer; 2],
    ) {
        let entry_point = match one {
            true => EntryPoint::ApplyOne,
            false => EntryPoint::Apply,
        };
        for (part, links) in links.iter().enumerate() {
            let mut resources = vec![
                (1, self.span()),
                (2, rows[0].as_entire_binding()),
                (3, links.as_entire_binding()),
                (4, values[0].as_entire_binding()),
                (5, values[1].as_entire_binding()),
                (6, rows[1].as_entire_binding()),
            ];
            if one {
                resources.push((0, self.b.params.as_entire_binding()));
            }
            let bind = self.kernels.bind(entry_point, &resources);
            self.spans(pass, entry_point, &bind, list, part..part + 1);
        }
    }

    /// Sets points without a used row to the mean of their parents, level by level.
    pub fn averages(&mut self, pass: &mut wgpu::ComputePass<'_>, levels: std::ops::Range<usize>) {
        if levels.is_empty() {
            return;
        }
        let b = self.b;
        let bind = self.kernels.bind(
            EntryPoint::Averages,
            &[
                (0, b.params.as_entire_binding()),
                (1, self.span()),
                (2, b.rows.as_entire_binding()),
                (3, b.parent_starts.as_entire_binding()),
                (4, b.parent_entries.as_entire_binding()),
                (6, b.values.as_entire_binding()),
            ],
        );
        self.spans(pass, EntryPoint::Averages, &bind, &b.levels, levels);
    }

    pub fn push(
        &mut self,
        pass: &mut wgpu::ComputePass<'_>,
        levels: usize,
        differences: &wgpu::Buffer,
    ) {
        let b = self.b;
        let bind = self.kernels.bind(
            EntryPoint::Push,
            &[
                (0, b.params.as_entire_binding()),
                (1, self.span()),
                (2, b.parent_starts.as_entire_binding()),
                (3, b.parent_entries.as_entire_binding()),
                (4, b.senders.as_entire_binding()),
                (5, differences.as_entire_binding()),
            ],
        );
        self.spans(pass, EntryPoint::Push, &bind, &b.levels, 0..levels);
    }

    pub fn compress(&mut self, pass: &mut wgpu::ComputePass<'_>) {
        let b = self.b;
        let Some(c) = &b.components else { return };
        let bind = self.kernels.bind(
            EntryPoint::Compress,
            &[
                (2, c.columns.as_entire_binding()),
                (3, c.members.as_entire_binding()),
                (4, c.values.as_entire_binding()),
                (5, b.senders.as_entire_binding()),
                (6, c.components.as_entire_binding()),
            ],
        );
        self.dispatch(
            pass,
            EntryPoint::Compress,
            &bind,
            &[],
            b.shape.columns as u32,
        );
    }

    pub fn sweep(&mut self, pass: &mut wgpu::ComputePass<'_>, direct: &wgpu::Buffer) {
        let b = self.b;
        let bind = self.kernels.bind(
            EntryPoint::Sweep,
            &[
                (0, b.params.as_entire_binding()),
                (2, b.points.as_entire_binding()),
                (3, b.surfaces.as_entire_binding()),
                (4, b.pull_starts.as_entire_binding()),
                (5, direct.as_entire_binding()),
                (6, b.values.as_entire_binding()),
                (7, b.senders.as_entire_binding()),
                (13, b.sky_visibility().as_entire_binding()),
            ],
        );
        self.dispatch(
            pass,
            EntryPoint::Sweep,
            &bind,
            &[],
            b.shape.senders() as u32,
        );
    }

    pub fn baked(
        &mut self,
        pass: &mut wgpu::ComputePass<'_>,
        direct: &wgpu::Buffer,
        levels: usize,
    ) {
        let b = self.b;
        let Some(bounces) = &b.bounces else { return };
        let further = &bounces.further;
        let bind = self.kernels.bind(
            EntryPoint::Gather,
            &[
                (0, b.params.as_entire_binding()),
                (5, direct.as_entire_binding()),
                (8, bounces.starts.as_entire_binding()),
                (9, bounces.links.as_entire_binding()),
                (10, further.as_entire_binding()),
            ],
        );
        let coarsest = b.levels.at.first().map_or(0, |(_, span)| span.count);
        self.dispatch(pass, EntryPoint::Gather, &bind, &[], coarsest);
        if levels > 1 {
            let bind = self.kernels.bind(
                EntryPoint::Interpolate,
                &[
                    (0, b.params.as_entire_binding()),
                    (1, self.span()),
                    (10, further.as_entire_binding()),
                    (11, b.parent_starts.as_entire_binding()),
                    (12, b.parent_entries.as_entire_binding()),
                ],
            );
            self.spans(pass, EntryPoint::Interpolate, &bind, &b.levels, 1..levels);
        }
        let bind = self.kernels.bind(
            EntryPoint::Add,
            &[
                (0, b.params.as_entire_binding()),
                (5, direct.as_entire_binding()),
                (7, b.senders.as_entire_binding()),
                (10, further.as_entire_binding()),
            ],
        );
        self.dispatch(pass, EntryPoint::Add, &bind, &[], b.shape.senders() as u32);
    }

    /// Records one dispatch for each of the spans `which` of a list.
    pub fn spans(
        &mut self,
        pass: &mut wgpu::ComputePass<'_>,
        entry_point: EntryPoint,
        bind: &wgpu::BindGroup,
        list: &SpanList,
        which: std::ops::Range<usize>,
    ) {
        for &(offset, span) in &list.at[which] {
            self.dispatch(pass, entry_point, bind, &[offset], span.count);
        }
    }

    pub fn dispatch(
        &mut self,
        pass: &mut wgpu::ComputePass<'_>,
        entry_point: EntryPoint,
        bind: &wgpu::BindGroup,
        offsets: &[u32],
        items: u32,
    ) {
        if items == 0 {
            return;
        }
        let groups = items.div_ceil(entry_point.entry().1.items);
        pass.set_pipeline(&self.kernels.compute_kernel(entry_point).pipeline);
        pass.set_bind_group(0, bind, offsets);
        let (x, y) = (groups.min(MAX_GROUPS), groups.div_ceil(MAX_GROUPS));
        pass.dispatch_workgroups(x, y, 1);
        self.counters.dispatches[entry_point as usize] += 1;
    }

    pub fn span(&self) -> wgpu::BindingResource<'_> {
        wgpu::BindingResource::Buffer(wgpu::BufferBinding {
            buffer: &self.b.spans,
            offset: 0,
            size: std::num::NonZeroU64::new(size_of::<meshless_gi::internals::frame::Span>() as u64),
        })
    }
}
