//! Energy checks of operators of components, see [`energy`](super::energy). Their rows do not refer
//! to single senders.
//!
//! **Rows.** Uniform light of 1 W/m² has known coefficients. Σ_c F_ic·n_i D_c 1 is the sum of the
//! row, and the closed form applies to it.
//!
//! **Gain.** The product of bases has signs. Theorems on non-negative matrices ([Var00] Chapter 2)
//! do not apply, and sums of absolute values exceed twice the gain. A power iteration of the whole
//! step (compress, apply, flatten, reflect) finds the largest eigenvalue. It is an estimate from
//! below and not a bound. If it is above 0.9995, all albedos are reduced by the same factor, to a
//! gain of 0.999.
//!
//! **Reciprocity** is measured for pairs of clusters: uniform light of each one on the senders of
//! the other.

use super::energy::reciprocity_residual;
use super::packing::LinkedPoints;
use crate::asset::PointSurface;
use crate::frame::{VectorIrradiance, apply, compress};
use crate::transport::pca::Compression;
use rayon::prelude::*;

/// Number of steps of the power iteration.
const STEPS: usize = 24;

/// Computes the normal component of every packed row under uniform light, including the sky.
pub(super) fn even_sums(linked: &LinkedPoints, compression: &Compression) -> Vec<f64> {
    let ones = compression.of_ones();
    let operator = &linked.operator;
    (operator.rows.par_iter().zip(&linked.points))
        .map(|(row, point)| {
            let links = &operator.links[row.start as usize..][..row.count as usize];
            let sum = |l: &crate::transport::Link| {
                f64::from(l.vector().dot(point.n())) * ones[l.sender() as usize]
            };
            f64::from(row.scale) * links.iter().map(sum).sum::<f64>()
        })
        .collect()
}

/// Estimates the largest eigenvalue of a bounce in a frame of this tier by power iteration. Returns
/// the largest of all color channels.
pub(super) fn gain(
    linked: &LinkedPoints,
    surfaces: &[PointSurface],
    compression: &Compression,
    tier: u32,
) -> f64 {
    let senders = linked.senders();
    let mut own = vec![false; senders];
    let sky = senders as u32;
    for &j in compression.members.iter().filter(|&&j| j != sky) {
        own[j as usize] = true;
    }
    let (rows, links) = (&linked.operator.rows, &linked.operator.links);
    let mut light = vec![[0.0f32; 4]; senders + 1];
    for (light, own) in light.iter_mut().zip(&own) {
        *light = if *own { [1.0, 1.0, 1.0, 0.0] } else { [0.0; 4] };
    }
    let mut components = vec![[0.0f32; 4]; compression.columns.len()];
    let mut found = 0.0;
    for _ in 0..STEPS {
        compress::compress(compression, &light, &mut components);
        let mut values: Vec<VectorIrradiance> = rows[..senders]
            .par_iter()
            .map(|row| match row.used(tier) {
                true => apply::apply_row(row, links, &components),
                false => VectorIrradiance::default(),
            })
            .collect();
        // Parents have lower indices.
        for i in 0..senders {
            if !rows[i].used(tier) {
                let mut sum = VectorIrradiance::default();
                for w in linked.parents.row(i) {
                    sum.add_scaled(w.weight, &values[w.index as usize]);
                }
                values[i] = sum;
            }
        }
        let (mut before, mut after) = ([0.0f64; 3], [0.0f64; 3]);
        for j in (0..senders).filter(|&j| own[j]) {
            let e = values[j].dot(linked.points[j].n());
            for c in 0..3 {
                before[c] += f64::from(light[j][c]).powi(2);
                // Like a sweep: negative radiosity is clamped to zero.
                light[j][c] = surfaces[j].albedo[c] * e[c].max(0.0);
                after[c] += f64::from(light[j][c]).powi(2);
            }
        }
        let gains = [0, 1, 2].map(|c| match before[c] > 0.0 {
            true => (after[c] / before[c]).sqrt(),
            false => 0.0,
        });
        found = gains.into_iter().fold(0.0, f64::max);
        // Normalizes each color channel to length one.
        for light in &mut light {
            for c in 0..3 {
                if after[c] > 0.0 {
                    light[c] /= after[c].sqrt() as f32;
                }
            }
        }
    }
    found
}

/// Multiplies every sender's albedo by `factor`. Returns the number of senders with a positive
/// albedo.
pub(super) fn lower(surfaces: &mut [PointSurface], factor: f64) -> u64 {
    let mut lowered = 0;
    for surface in surfaces {
        lowered += u64::from(surface.albedo.iter().any(|a| *a > 0.0));
        for albedo in &mut surface.albedo {
            *albedo = (f64::from(*albedo) * factor) as f32;
        }
    }
    lowered
}

/// Computes the reciprocity residual between clusters, relative to the exchanged light.
pub(super) fn reciprocity(linked: &LinkedPoints, compression: &Compression) -> f64 {
    let ones = compression.of_ones();
    let sky = compression.columns.len() - 1;
    // Cluster of each column and of each sender.
    let mut cluster_of_column = vec![0; sky];
    let mut clusters = 0;
    let mut cluster_of = vec![usize::MAX; linked.senders()];
    for (c, column) in compression.columns[..sky].iter().enumerate() {
        if c == 0 || column.member != compression.columns[c - 1].member {
            clusters += 1;
            let members = &compression.members[column.member as usize..][..column.count as usize];
            members
                .iter()
                .for_each(|&j| cluster_of[j as usize] = clusters - 1);
        }
        cluster_of_column[c] = clusters - 1;
    }
    let mut between = vec![0.0f64; clusters * clusters];
    let operator = &linked.operator;
    for (j, &s) in cluster_of.iter().enumerate().filter(|c| *c.1 != usize::MAX) {
        let row = &operator.rows[j];
        let links = &operator.links[row.start as usize..][..row.count as usize];
        for link in links.iter().filter(|l| (l.sender() as usize) < sky) {
            let c = link.sender() as usize;
            let f = f64::from(row.scale * link.vector().dot(linked.points[j].n()));
            between[s * clusters + cluster_of_column[c]] += f * ones[c];
        }
    }
    reciprocity_residual(clusters, |a, b| between[a * clusters + b])
}
