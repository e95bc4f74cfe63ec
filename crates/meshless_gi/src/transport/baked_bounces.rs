//! Baked bounces: the Neumann series S = T + T² + … of \[L08\] Eq. (15), with reflectance.
//!
//! \[L08\] §3.2 computes "the second and subsequent bounces (T² and onwards) using only the
//! coarsest functions as receivers". Here the series is computed between the gathers:
//! D = Σ_{m=1}^{k} (ρG)^m. D maps the senders' direct radiosity to the later radiosity of the
//! coarsest points. The frame interpolates D f to finer senders, adds it to the senders and applies
//! G once. All receivers, not only the coarsest, then receive later bounces through their own rows.

use super::refine::RawRow;
use super::{BounceLink, BounceOperator};
use crate::basis::Weights;
use glam::{Vec3, Vec3A};
use rayon::prelude::*;

/// Input of the series.
pub struct BounceScene<'a> {
    /// Rows of at least the coarsest points, method `bounded`.
    pub rows: &'a [RawRow],
    /// Normals of the coarsest points.
    pub normals: &'a [Vec3],
    /// Albedos of the coarsest points, averaged over their supports.
    pub albedo: &'a [Vec3],
    /// Parents of every sender in the next coarser level.
    pub parents: &'a Weights,
    /// Number of senders.
    pub senders: usize,
}

/// Computes the series up to `bounces` bounces beyond the first. Drops entries of at most `epsilon`
/// times the largest of their row in all channels. Scales the other entries of the row, so that
/// each row keeps its sum.
#[must_use]
pub fn bounce_operator(scene: &BounceScene<'_>, bounces: u32, epsilon: f32) -> BounceOperator {
    let coarsest = scene.normals.len();
    let lift = interpolation(scene);
    // R = ρG of the coarsest rows, without albedo: k ← sender.
    let gain = |k: usize| {
        let n = Vec3A::from(scene.normals[k]);
        scene.rows[k].links.iter().map(move |&(j, f)| (j, f.dot(n)))
    };
    // R P: k ← k', over interpolated senders.
    let coarse: Vec<Vec<f32>> = (0..coarsest)
        .into_par_iter()
        .map(|k| {
            let mut row = vec![0.0; coarsest];
            for (j, g) in gain(k) {
                for &(c, w) in &lift[j as usize] {
                    row[c as usize] += g * w;
                }
            }
            row
        })
        .collect();
    let channels: Vec<Vec<Vec<f32>>> = (0..3)
        .map(|channel| {
            let first: Vec<Vec<f32>> = (0..coarsest)
                .map(|k| {
                    let mut row = vec![0.0; scene.senders];
                    for (j, g) in gain(k) {
                        row[j as usize] = scene.albedo[k][channel] * g;
                    }
                    row
                })
                .collect();
            let mut term = first.clone();
            let mut sum = first;
            for _ in 1..bounces {
                term = (0..coarsest)
                    .into_par_iter()
                    .map(|k| {
                        let mut row = vec![0.0; scene.senders];
                        for (c, &g) in coarse[k].iter().enumerate() {
                            let g = g * scene.albedo[k][channel];
                            if g != 0.0 {
                                for (r, t) in row.iter_mut().zip(&term[c]) {
                                    *r += g * t;
                                }
                            }
                        }
                        row
                    })
                    .collect();
                for (s, t) in sum.iter_mut().zip(&term) {
                    for (s, t) in s.iter_mut().zip(t) {
                        *s += t;
                    }
                }
            }
            sum
        })
        .collect();
    truncate(&channels, scene.senders, bounces, epsilon)
}

/// Computes the weights of the coarsest points in the interpolated value of each sender.
fn interpolation(scene: &BounceScene<'_>) -> Vec<Vec<(u32, f32)>> {
    let coarsest = scene.normals.len();
    let mut lift: Vec<Vec<(u32, f32)>> = Vec::with_capacity(scene.senders);
    for j in 0..scene.senders {
        if j < coarsest {
            lift.push(vec![(j as u32, 1.0)]);
            continue;
        }
        let mut sums: Vec<(u32, f32)> = Vec::new();
        for w in scene.parents.row(j) {
            for &(k, v) in &lift[w.index as usize] {
                match sums.binary_search_by_key(&k, |s| s.0) {
                    Ok(at) => sums[at].1 += w.weight * v,
                    Err(at) => sums.insert(at, (k, w.weight * v)),
                }
            }
        }
        lift.push(sums);
    }
    lift
}

/// Keeps entries above `epsilon` times the largest of their row in at least one channel. Scales
/// them, so that each row keeps its sum.
fn truncate(
    channels: &[Vec<Vec<f32>>],
    senders: usize,
    bounces: u32,
    epsilon: f32,
) -> BounceOperator {
    let coarsest = channels[0].len();
    let mut out = BounceOperator {
        starts: vec![0],
        links: Vec::new(),
        bounces,
    };
    for k in 0..coarsest {
        let mut keep_scale = Vec3::ZERO;
        let mut threshold = [0.0f32; 3];
        for (channel, rows) in channels.iter().enumerate() {
            threshold[channel] = epsilon * rows[k].iter().fold(0.0f32, |a, g| a.max(g.abs()));
        }
        let kept = |j: usize| (0..3).any(|c| channels[c][k][j].abs() > threshold[c]);
        for (channel, rows) in channels.iter().enumerate() {
            let all: f32 = rows[k].iter().sum();
            let some: f32 = (0..senders).filter(|&j| kept(j)).map(|j| rows[k][j]).sum();
            keep_scale[channel] = if some > 0.0 { all / some } else { 1.0 };
        }
        for j in (0..senders).filter(|&j| kept(j)) {
            out.links.push(BounceLink {
                gain: [0, 1, 2].map(|c| channels[c][k][j] * keep_scale[c]),
                sender: j as u32,
            });
        }
        out.starts.push(out.links.len() as u32);
    }
    out
}
