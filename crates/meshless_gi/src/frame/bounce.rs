//! Kernel `bounce`: radiosity of the senders after further reflections. Runtime bounces: one Jacobi
//! step of f = f⁰ + ρ G f on the finest sender level (design D2 (b)). Baked bounces: f = f⁰ + P D
//! f⁰, with D on the coarsest points only (\[L08\] §3.2, design D2 (a)).

use super::layout::{SolveParams, VectorIrradiance};
use super::radiosity::{SenderInputs, sky_at};
use crate::basis::Weights;
use crate::transport::BounceLink;
use glam::{Vec3, Vec4};
use rayon::prelude::*;
use std::ops::Range;

/// Computes one bounce, f_j = f⁰_j + ρ_j max(0, E⃗_j·n_j). Updates the senders of the finest
/// sender level and coarser senders without a row in `pull`. The direct sky irradiance is
/// subtracted from E⃗_j, because f⁰_j already reflects it. Rows of differences have no link to the
/// sky.
pub fn sweep(
    params: &SolveParams,
    inputs: &SenderInputs<'_>,
    pull: &Weights,
    direct: &[[f32; 4]],
    irradiance: &[VectorIrradiance],
    senders: &mut [[f32; 4]],
) {
    for j in 0..params.senders as usize {
        if (j as u32) < params.finest_sender && !pull.row(j).is_empty() {
            continue;
        }
        let mut e = irradiance[j].dot(inputs.points[j].n());
        if params.differences == 0 {
            e -= sky_at(params, inputs, j);
        }
        let e = e.max(Vec3::ZERO);
        let further = Vec3::from_array(inputs.surfaces[j].albedo) * e;
        senders[j] = (Vec4::from_array(direct[j]) + further.extend(0.0)).to_array();
    }
}

/// Computes the first step of baked bounces: the further radiosity d_k = Σ_j D_kj f⁰_j of the
/// coarsest points, W/m².
pub fn gather(starts: &[u32], links: &[BounceLink], direct: &[[f32; 4]], further: &mut [[f32; 4]]) {
    let count = starts.len() - 1;
    further[..count]
        .par_iter_mut()
        .with_min_len(16)
        .enumerate()
        .for_each(|(k, d)| {
            let mut sum = Vec3::ZERO;
            for link in &links[starts[k] as usize..starts[k + 1] as usize] {
                sum += Vec3::from_array(link.gain)
                    * Vec4::from_array(direct[link.sender as usize]).truncate();
            }
            *d = sum.extend(0.0).to_array();
        });
}

/// Computes the second step of baked bounces: interpolates d to the senders of `level`, coarse
/// levels first. If the parents are those of all coarser levels, only the coarsest ones count,
/// because d has no differences on the others.
pub fn interpolate(
    params: &SolveParams,
    parents: &Weights,
    level: Range<usize>,
    further: &mut [[f32; 4]],
) {
    for j in level {
        let mut sum = Vec4::ZERO;
        for entry in parents.row(j) {
            if params.differences == 0 || entry.index < params.coarsest_points {
                sum += entry.weight * Vec4::from_array(further[entry.index as usize]);
            }
        }
        further[j] = sum.to_array();
    }
}

/// Computes the last step of baked bounces: f_j = f⁰_j + d_j.
pub fn add(
    params: &SolveParams,
    direct: &[[f32; 4]],
    further: &[[f32; 4]],
    senders: &mut [[f32; 4]],
) {
    for j in 0..params.senders as usize {
        senders[j] = (Vec4::from_array(direct[j]) + Vec4::from_array(further[j])).to_array();
    }
}
