//! Truncated row of one receiver, and its residual.

use super::bounded_truncation::{CutMeasure, CutScratch, SenderTree, cut_row};
use super::gather::{GatherScene, Gathered, gather};
use super::moved_mass::TruncationMass;
use super::occluded_links::{LinkTerm, cut_parts};
use super::pca::{CompressScratch, LightBasis};
use super::quantized_row::QuantizedRow;
use super::refine::RawRow;
use super::residual::{Predictors, Response, RowResidual, difference, interpolate, respond};
use crate::basis::Weights;
use glam::Vec3A;
use std::time::{Duration, Instant};

/// Result of one receiver.
pub(super) struct ReceiverRow {
    pub row: RawRow,
    pub quantized: QuantizedRow,
    pub response: Response,
    pub sky: Vec3A,
    pub error: f32,
    pub uncovered: f32,
    pub unlit: f32,
    pub row_sum: f32,
    /// Durations of the gather and of the remaining work.
    pub times: [Duration; 2],
}

/// Scratch memory of one thread.
pub(super) struct ReceiverScratch {
    gathered: Gathered,
    cut: CutScratch,
    compress: CompressScratch,
    residual: RowResidual,
    /// Gathered senders and the normal components of their links, before truncation.
    masses: Vec<(u32, f32)>,
    kept: Vec<bool>,
}

impl ReceiverScratch {
    /// Creates scratch memory for `senders` senders.
    pub fn new(senders: usize) -> Self {
        Self {
            gathered: Gathered::new(senders),
            cut: CutScratch::default(),
            compress: CompressScratch::default(),
            residual: RowResidual::new(senders),
            masses: Vec::new(),
            kept: vec![false; senders],
        }
    }
}

/// Input of all receivers of a level.
pub(super) struct ReceiverLevel<'a> {
    pub scene: &'a GatherScene<'a>,
    pub parents: &'a Weights,
    /// Rows of coarser levels.
    pub rows: &'a [RawRow],
    pub predictors: &'a Predictors,
    pub tree: &'a SenderTree,
    pub measure: &'a CutMeasure<'a>,
    pub basis: Option<&'a LightBasis>,
    /// `true` if residuals are computed.
    pub has_residuals: bool,
    /// `true` if the next level predicts from this one.
    pub has_finer_level: bool,
    /// Mass that truncation moves. `None` if it is not recorded.
    pub truncation: Option<&'a TruncationMass>,
}

impl ReceiverLevel<'_> {
    /// Gathers and truncates the row of receiver `i`.
    pub fn receive(&self, i: usize, scratch: &mut ReceiverScratch) -> ReceiverRow {
        let began = Instant::now();
        gather(self.scene, i, &mut scratch.gathered);
        let gather_time = began.elapsed();
        let n: Vec3A = self.scene.hierarchy.surfaces[i].normal.into();
        let (response, row_sum) = respond(&scratch.gathered, &self.measure.training.signals);
        let sky = scratch.gathered.sky;
        let has_residual = self.has_residuals && !self.parents.row(i).is_empty();
        // Runs before truncation, which changes the gathered sums.
        if has_residual {
            scratch.residual.set(&scratch.gathered, n);
        }
        let quantized = match self.has_finer_level {
            true => QuantizedRow::new(&scratch.gathered),
            false => QuantizedRow::default(),
        };
        let (links, parts) = self.truncate(n, scratch);
        let error = match has_residual {
            true => self.residual(i, n, &response, &mut scratch.residual),
            false => f32::INFINITY,
        };
        ReceiverRow {
            row: RawRow {
                links,
                parts,
                active: true,
            },
            quantized,
            response,
            sky,
            error,
            uncovered: scratch.gathered.uncovered,
            unlit: scratch.gathered.unlit,
            row_sum: row_sum.dot(n),
            times: [gather_time, began.elapsed() - gather_time],
        }
    }

    /// Truncates the gathered row. Returns its links and their terms by occluders.
    fn truncate(
        &self,
        n: Vec3A,
        scratch: &mut ReceiverScratch,
    ) -> (Vec<(u32, Vec3A)>, Vec<LinkTerm>) {
        let ReceiverScratch {
            gathered,
            cut,
            compress,
            masses,
            kept,
            ..
        } = scratch;
        masses.clear();
        if self.truncation.is_some() {
            let touched = gathered.touched.iter();
            masses.extend(touched.map(|&j| (j, gathered.link(j).dot(n))));
        }
        let links = match self.basis {
            Some(basis) => basis.compress(gathered, n, self.measure.epsilon, compress),
            None => cut_row(gathered, self.tree, n, self.measure, cut),
        };
        let mut parts = Vec::new();
        if self.truncation.is_some() || !gathered.parts.is_empty() {
            for &(k, _) in &links {
                kept[k as usize] = true;
            }
            if let Some(truncation) = self.truncation {
                add_masses(truncation, self.tree, masses, kept);
            }
            if self.basis.is_none() {
                parts = cut_parts(self.tree, &gathered.parts, |k| kept[k as usize]);
            }
            for &(k, _) in &links {
                kept[k as usize] = false;
            }
        }
        (links, parts)
    }

    /// Computes the squared residual of receiver `i`.
    fn residual(&self, i: usize, n: Vec3A, response: &Response, residual: &mut RowResidual) -> f32 {
        let training = self.measure.training;
        let expected = interpolate(&self.predictors.responses, self.parents.row(i));
        let coherent = difference(response, &expected, n, training.sky);
        let (rows, predictors) = (self.rows, self.predictors);
        coherent + residual.links(rows, predictors, self.parents, i, n, &training.exposure)
    }
}

/// Adds each sender's mass to the nearest `kept` sender among itself and its ancestors.
fn add_masses(
    truncation: &TruncationMass,
    tree: &SenderTree,
    masses: &[(u32, f32)],
    kept: &[bool],
) {
    for &(j, mass) in masses {
        let mut k = j;
        while !kept[k as usize] && tree.parent[k as usize] != k {
            k = tree.parent[k as usize];
        }
        if kept[k as usize] {
            truncation.add(tree, j, k, mass);
        }
    }
}
