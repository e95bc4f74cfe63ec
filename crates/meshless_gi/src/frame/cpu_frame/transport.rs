//! Transport of the senders' light: to all points, to the senders for one bounce, to the probes.

use super::{CpuFrame, sender_inputs};
use crate::asset::SceneData;
use crate::frame::{
    SolveParams, SolveSchedule, VectorIrradiance, apply, apply_one, bounce, compress, flatten,
    fmm_down, fmm_up, pull, push,
};
use crate::transport::fmm::Passes;
use crate::transport::fmm::passes::Field;
use crate::transport::{Link, Row};
use std::ops::Range;

impl CpuFrame {
    /// Computes one reflection: transports the senders' light to the senders and adds the reflected
    /// light to their direct light.
    pub(super) fn sweep(
        &mut self,
        scene: &SceneData,
        params: &SolveParams,
        steps: &SolveSchedule,
        octree: &mut Option<Passes<'_, f32>>,
    ) {
        self.transport(scene, params, steps, octree, ReceiverSet::Senders);
        bounce::sweep(
            params,
            &sender_inputs(&self.surfaces, &self.occluded, scene),
            &scene.pull,
            &self.direct,
            &self.values,
            &mut self.senders,
        );
        for level in &steps.pull {
            pull::pull(&scene.pull, level.clone(), &mut self.senders);
        }
    }

    /// Runs push or compress, then apply and flatten. With an octree, runs its two passes instead.
    pub(super) fn transport(
        &mut self,
        scene: &SceneData,
        params: &SolveParams,
        steps: &SolveSchedule,
        octree: &mut Option<Passes<'_, f32>>,
        receiver_set: ReceiverSet,
    ) {
        let operator = &scene.operator;
        let (points, levels): (Range<usize>, _) = match receiver_set {
            ReceiverSet::All => (0..scene.points.len(), &steps.levels),
            ReceiverSet::Senders => (0..scene.senders(), &steps.senders),
        };
        if let (Some(passes), Some(operator)) = (octree, &scene.fmm) {
            fmm_up::fmm_up(passes, &self.senders);
            let sky = scene.senders();
            fmm_down::fmm_down(passes, operator, &self.senders, sky, &mut self.values);
            // Points finer than senders take their parents' mean, because no row is used.
            for level in levels.iter().skip(steps.senders.len()) {
                let rows = &scene.operator.rows;
                flatten::averages(
                    params,
                    rows,
                    &scene.parents,
                    level.clone(),
                    &mut self.values,
                );
            }
        } else if steps.differences {
            for level in &steps.senders {
                push::push(
                    &scene.parents,
                    level.clone(),
                    &self.senders,
                    &mut self.differences,
                );
            }
            // The sky is not a basis function of any level.
            let sky = scene.senders();
            self.differences[sky] = self.senders[sky];
            operate(
                steps,
                params,
                &operator.rows,
                &operator.links,
                points.clone(),
                &self.differences,
                &mut self.applied,
            );
            flatten::differences(&scene.parents, points, &self.applied, &mut self.values);
        } else {
            let coefficients = match &operator.compression {
                Some(compression) => {
                    compress::compress(compression, &self.senders, &mut self.components);
                    &self.components
                }
                None => &self.senders,
            };
            let links = match &self.occluded {
                Some(occluded) => &occluded.links,
                None => &operator.links,
            };
            operate(
                steps,
                params,
                &operator.rows,
                links,
                points,
                coefficients,
                &mut self.values,
            );
            for level in levels {
                flatten::averages(
                    params,
                    &operator.rows,
                    &scene.parents,
                    level.clone(),
                    &mut self.values,
                );
            }
        }
    }

    /// Transports the senders' light to the probes.
    pub(super) fn transport_to_probes(
        &mut self,
        scene: &SceneData,
        params: &SolveParams,
        steps: &SolveSchedule,
    ) {
        if let Some(probes) = &scene.probes {
            let all = 0..probes.rows.len();
            let links = match &self.occluded {
                Some(occluded) => &occluded.probe_links,
                None => &probes.links,
            };
            let rows = &probes.rows;
            let (senders, out) = (&self.senders, &mut self.probes);
            operate(steps, params, rows, links, all, senders, out);
        }
    }
}

/// Receivers of a transport.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum ReceiverSet {
    /// All points.
    All,
    /// The senders, for their next reflection.
    Senders,
}

/// Applies the operator, in one channel or in three.
fn operate(
    steps: &SolveSchedule,
    params: &SolveParams,
    rows: &[Row],
    links: &[Link],
    points: Range<usize>,
    coefficients: &[[f32; 4]],
    out: &mut [VectorIrradiance],
) {
    let apply = match steps.one {
        true => apply_one::apply_one,
        false => apply::apply,
    };
    apply(params, rows, links, points, coefficients, out);
}

/// Returns the buffers of the passes. Returns `None` if the octree does not transport the light.
pub(super) fn octree<'a>(scene: &'a SceneData, steps: &SolveSchedule) -> Option<Passes<'a, f32>> {
    let operator = scene.fmm.as_ref().filter(|_| steps.octree)?;
    Some(Passes::new(Field::from_operator(operator)))
}
