//! Sixth stage: energy checks of a packed operator, an upper bound on the gain of a bounce and the
//! reciprocity residual. The gain is the largest of all tiers.
//!
//! **Gain.** A bounce maps the senders' radiosities f to A f with A_jk = ρ_j |F_jk · n_j|. A sender
//! that `pull` fills is a mean of others, with weights that sum to one. A is not negative. For
//! every positive x the largest (A x)_j / x_j is therefore at least the spectral radius of A
//! (Collatz and Wielandt, [Var00] Chapter 2). Each x proves a bound. x = 1 gives that of the row
//! sums, and some steps of a power iteration tighten it. Operators of differences (\[L08\] Eq. (7),
//! (17)) have signs. Their bound is the largest sum of absolute values of a row of the whole step,
//! with differences resolved.
//!
//! **Bound.** A closed room that reflects all light can have a bound above 0.9995. The albedo of
//! each sender is then reduced until its row sums to at most 0.999, and the bake warns. Afterwards
//! no bounce adds energy, and every series and sweep converges.
//!
//! **Reciprocity.** Light from surface J to I and from I to J is equal for equal radiosity: Σ_{r ∈
//! I} F_rJ·n_r = Σ_{r ∈ J} F_rI·n_r. The sums are over the finest senders below two coarsest ones.
//! These represent equal areas, since they are as dense as their disks allow. The rest is noise of
//! rays and points.

use super::context::StageCost;
use super::energy_components as components;
use super::energy_fmm::bound_octree;
use super::fmm::Octree;
use super::packing::{LinkedPoints, Packed};
use crate::asset::{EnergyInfo, PointSurface};
use crate::transport::SenderForm;
use crate::transport::pca::Compression;
use glam::Vec3;
use rayon::prelude::*;
use std::time::Instant;

/// Largest allowed gain. A thousand bounces then keep a third of the light.
pub(super) const MAX_GAIN: f64 = 0.999;
/// Gains above this value are reduced.
pub(super) const MAX_UNCLAMPED_GAIN: f64 = 0.9995;
/// Number of steps that tighten the bound.
const STEPS: usize = 12;
/// Fraction of itself that each step keeps, so that it stays positive.
const RETAINED_FRACTION: f64 = 0.1;
/// Largest number of coarsest senders for the reciprocity residual.
const MAX_COARSEST_SENDERS: usize = 128;

/// Result of the stage.
pub(super) struct Bounded {
    /// Surfaces of all points, with reduced albedos.
    pub surfaces: Vec<PointSurface>,
    pub gain: Gain,
}

/// Gain of a bounce, and the reciprocity residual. See [`EnergyInfo`] for the fields.
#[derive(Clone, Copy)]
pub(super) struct Gain {
    pub estimated: bool,
    pub bound: f32,
    pub estimate: f32,
    pub clamped_senders: u64,
    pub albedo_scale: f32,
    pub reciprocity: f32,
}

impl Default for Gain {
    /// Creates the gain without bounces.
    fn default() -> Self {
        Self {
            estimated: false,
            bound: 0.0,
            estimate: 0.0,
            clamped_senders: 0,
            albedo_scale: 1.0,
            reciprocity: 0.0,
        }
    }
}

impl Gain {
    /// Returns the energy of a bake with the largest and the root-mean-square deviation of rows.
    pub fn energy(self, [row_deviation, row_deviation_rms]: [f32; 2]) -> EnergyInfo {
        EnergyInfo {
            spectral_radius_bound: self.bound,
            estimated: self.estimated,
            spectral_radius_estimate: self.estimate,
            clamped_senders: self.clamped_senders,
            albedo_scale: self.albedo_scale,
            row_deviation,
            row_deviation_rms,
            reciprocity: self.reciprocity,
        }
    }

    /// Returns the warning about reduced albedos.
    fn warning(&self, senders: usize) -> Option<String> {
        (self.clamped_senders > 0).then(|| {
            format!(
                "closed scene with albedo near 1: the bounce series converges too slowly; reduced the albedo of {} of {senders} senders by at most {:.2} % (gain limited to {MAX_GAIN})",
                self.clamped_senders,
                100.0 * (1.0 - self.albedo_scale)
            )
        })
    }
}

/// Reduces albedos so that no bounce adds energy.
pub(super) fn bound_energy(packed: &Packed, octree: Option<&Octree>) -> (Bounded, StageCost) {
    let began = Instant::now();
    let (linked, surfaces) = (&packed.linked, packed.surfaces.clone());
    let mut bounded = match &linked.operator.compression {
        Some(compression) => bound_components(linked, surfaces, compression),
        None => bound_links(linked, surfaces),
    };
    let mut warnings: Vec<String> = (bounded.gain.warning(linked.senders()))
        .into_iter()
        .collect();
    if let Some(octree) = octree {
        bounded = bound_octree(linked, bounded, octree);
        warnings.extend(bounded.gain.warning(linked.senders()));
    }
    let cost = StageCost {
        warnings,
        ..StageCost::new(began, 0)
    };
    (bounded, cost)
}

/// Enforces the energy bound of an operator of averages or differences.
fn bound_links(linked: &LinkedPoints, mut surfaces: Vec<PointSurface>) -> Bounded {
    let mut senders = Senders::new(linked);
    // A frame of a low tier leaves out some rows. Each tier is measured, the whole operator last.
    let tiers: Vec<u32> = (1..=senders.tier).collect();
    let mut all_sums = Vec::new();
    let mut reciprocity = 0.0;
    for &tier in &tiers {
        senders.tier = tier;
        let (sums, residual) = senders.sums(linked);
        all_sums.push(sums);
        reciprocity = residual;
    }
    let mut gains = |surfaces: &[PointSurface]| -> (f64, f64) {
        let (mut gain, mut found) = (0.0f64, 0.0);
        for (&tier, sums) in tiers.iter().zip(&all_sums) {
            senders.tier = tier;
            let (bound, grown) = senders.gain(linked, surfaces, sums);
            gain = gain.max(bound);
            found = grown;
        }
        (gain, found)
    };
    let (mut gain, mut found) = gains(&surfaces);
    let (mut clamped_senders, mut albedo_scale) = (0, 1.0);
    if gain > MAX_UNCLAMPED_GAIN {
        let senders = all_sums.first().map_or(0, Vec::len);
        for (j, surface) in surfaces.iter_mut().enumerate().take(senders) {
            let sum = all_sums.iter().map(|sums| sums[j]).fold(0.0, f64::max);
            let mut lowered = false;
            for albedo in &mut surface.albedo {
                let row = f64::from(*albedo) * sum;
                if row > MAX_GAIN {
                    let factor = MAX_GAIN / row;
                    // Rounded down, so that the product does not exceed the limit.
                    *albedo = (f64::from(*albedo) * factor) as f32 * (1.0 - f32::EPSILON);
                    albedo_scale = f64::min(albedo_scale, factor);
                    lowered = true;
                }
            }
            clamped_senders += u64::from(lowered);
        }
        (gain, found) = gains(&surfaces);
    }
    let gain = Gain {
        estimated: false,
        // Rounded up, since it is a bound.
        bound: (gain as f32).next_up(),
        estimate: found as f32,
        clamped_senders,
        albedo_scale: albedo_scale as f32,
        reciprocity: reciprocity as f32,
    };
    Bounded { surfaces, gain }
}

/// Computes the reciprocity residual of `groups` groups of senders, relative to the exchanged
/// light. `light(a, b)` is the light of group b at group a.
pub(super) fn reciprocity_residual(groups: usize, light: impl Fn(usize, usize) -> f64) -> f64 {
    let (mut differences, mut means) = (0.0, 0.0);
    for a in 0..groups {
        for b in 0..a {
            let (there, back) = (light(a, b), light(b, a));
            differences += (there - back).powi(2);
            means += (0.5 * (there + back)).powi(2);
        }
    }
    match means > 0.0 {
        true => (differences / means).sqrt(),
        false => 0.0,
    }
}

/// Enforces the energy bound of an operator of components. See
/// [`energy_components`](super::energy_components).
fn bound_components(
    linked: &LinkedPoints,
    mut surfaces: Vec<PointSurface>,
    compression: &Compression,
) -> Bounded {
    let tiers = linked.operator.tiers();
    let gain = |surfaces: &[PointSurface]| {
        let all = (1..=tiers).map(|tier| components::gain(linked, surfaces, compression, tier));
        all.fold(0.0, f64::max)
    };
    let mut found = gain(&surfaces);
    let (mut clamped_senders, mut albedo_scale) = (0, 1.0);
    if found > MAX_UNCLAMPED_GAIN {
        albedo_scale = MAX_GAIN / found;
        clamped_senders = components::lower(&mut surfaces[..linked.senders()], albedo_scale);
        found = gain(&surfaces);
    }
    let gain = Gain {
        estimated: true,
        bound: (found as f32).next_up(),
        estimate: found as f32,
        clamped_senders,
        albedo_scale: albedo_scale as f32,
        reciprocity: components::reciprocity(linked, compression) as f32,
    };
    Bounded { surfaces, gain }
}

/// Entries of one bounce, for the senders that `pull` does not fill.
struct Senders {
    count: usize,
    /// Tier of the frame. Rows of higher tiers are left out.
    tier: u32,
    /// `true` for senders that `pull` does not fill.
    own: Vec<bool>,
    /// Coarsest ancestor of each sender.
    root: Vec<u32>,
}

impl Senders {
    fn new(linked: &LinkedPoints) -> Self {
        let count = linked.senders();
        let finest = linked.finest_senders().start;
        let own = (0..count)
            .map(|j| j >= finest || linked.pull.row(j).is_empty())
            .collect();
        // A sender with several parents belongs to the one with the largest weight.
        let mut best: Vec<(f32, u32)> = (0..count as u32).map(|j| (0.0, j)).collect();
        let mut root: Vec<u32> = (0..count as u32).collect();
        for k in 0..count {
            root[k] = match best[k].1 {
                parent if parent as usize == k => k as u32,
                parent => root[parent as usize],
            };
            for w in linked.pull.row(k) {
                let child = &mut best[w.index as usize];
                if w.weight > child.0 {
                    *child = (w.weight, k as u32);
                }
            }
        }
        let rows = linked.operator.rows[..count].iter();
        let tier = rows.map(|r| r.tier).max().unwrap_or(0).max(1);
        Self {
            count,
            tier,
            own,
            root,
        }
    }

    /// Calls `each` with every sender k and F_jk·n_j, as a frame sums them for point `j`, without
    /// the sky. Operators of averages only.
    fn links(
        &self,
        linked: &LinkedPoints,
        j: usize,
        n: Vec3,
        weight: f64,
        each: &mut impl FnMut(usize, f64),
    ) {
        let row = &linked.operator.rows[j];
        if row.tier == 0 || row.tier > self.tier {
            // Parents have lower indices, so the loop ends.
            for w in linked.parents.row(j) {
                let weight = weight * f64::from(w.weight);
                self.links(linked, w.index as usize, n, weight, each);
            }
            return;
        }
        let links = &linked.operator.links[row.start as usize..][..row.count as usize];
        let scale = weight * f64::from(row.scale);
        for link in links {
            let k = link.sender() as usize;
            if k < self.count {
                each(k, scale * f64::from(link.vector().dot(n)));
            }
        }
    }

    /// Computes row `j` of a whole step in the form of differences, over the senders that `pull`
    /// does not fill: apply, flatten, push and pull in reverse.
    fn resolve_row(&self, linked: &LinkedPoints, j: usize, row: &mut [f64]) {
        row.fill(0.0);
        let n = linked.points[j].n();
        let mut add = |i: usize, weight: f64| {
            let r = &linked.operator.rows[i];
            for link in &linked.operator.links[r.start as usize..][..r.count as usize] {
                let k = link.sender() as usize;
                if k < self.count {
                    row[k] += weight * f64::from(r.scale) * f64::from(link.vector().dot(n));
                }
            }
        };
        add(j, 1.0);
        for w in linked.parents.row(j) {
            add(w.index as usize, f64::from(w.weight));
        }
        // α_k = f_k − Σ w α_parent: fine to coarse.
        for k in (0..self.count).rev() {
            let value = row[k];
            if value != 0.0 {
                for w in linked.parents.row(k) {
                    row[w.index as usize] -= value * f64::from(w.weight);
                }
            }
        }
        for k in 0..self.count {
            if !self.own[k] {
                let value = std::mem::take(&mut row[k]);
                for w in linked.pull.row(k) {
                    row[w.index as usize] += value * f64::from(w.weight);
                }
            }
        }
    }

    /// Computes Σ_k |F_jk·n_j| of every sender, and the reciprocity residual. In the form of
    /// differences the sum has only the senders that `pull` does not fill.
    fn sums(&self, linked: &LinkedPoints) -> (Vec<f64>, f64) {
        let coarsest = linked.level(0).len().min(self.count);
        let stride = coarsest.div_ceil(MAX_COARSEST_SENDERS).max(1);
        let chosen = coarsest.div_ceil(stride);
        let index_of = |j: usize| {
            let root = self.root[j] as usize;
            (root < coarsest && root.is_multiple_of(stride)).then_some(root / stride)
        };
        let averages = linked.operator.form == SenderForm::Averages;
        let dense = if averages { 0 } else { self.count };
        // Sum, and the part from each selected surface if there is one above the sender.
        let rows: Vec<(f64, Vec<f64>)> = (0..self.count)
            .into_par_iter()
            .map_init(
                || vec![0.0; dense],
                |row, j| {
                    if !averages && !self.own[j] {
                        return (0.0, Vec::new());
                    }
                    let is_needed = self.own[j] && index_of(j).is_some();
                    let mut from = vec![0.0; if is_needed { chosen } else { 0 }];
                    let mut sum = 0.0;
                    let mut add = |k: usize, f: f64| {
                        sum += f.abs();
                        if let (true, Some(index)) = (is_needed, index_of(k)) {
                            from[index] += f;
                        }
                    };
                    if averages {
                        self.links(linked, j, linked.points[j].n(), 1.0, &mut add);
                    } else {
                        self.resolve_row(linked, j, row);
                        row.iter().enumerate().for_each(|(k, &f)| add(k, f));
                    }
                    (sum, from)
                },
            )
            .collect();
        let mut between = vec![vec![0.0; chosen]; chosen];
        for (j, (_, from)) in rows.iter().enumerate() {
            if let (false, Some(index)) = (from.is_empty(), index_of(j)) {
                // A sender of a coarser level represents four times the area.
                let level = linked.level_starts.partition_point(|&s| s as usize <= j);
                let area = 4f64.powi(linked.sender_levels as i32 - level as i32);
                for (sum, f) in between[index].iter_mut().zip(from) {
                    *sum += area * f;
                }
            }
        }
        let residual = reciprocity_residual(chosen, |a, b| between[a][b]);
        (rows.into_iter().map(|row| row.0).collect(), residual)
    }

    /// Computes the proved bound on the gain of a bounce, and an estimate of the gain.
    fn gain(&self, linked: &LinkedPoints, surfaces: &[PointSurface], sums: &[f64]) -> (f64, f64) {
        let albedo = |j: usize| surfaces[j].albedo.map(f64::from);
        let owners = (0..self.count).filter(|&j| self.own[j]);
        let mut bound = owners
            .flat_map(|j| albedo(j).map(|a| a * sums[j]))
            .fold(0.0, f64::max);
        if linked.operator.form == SenderForm::Differences {
            // With signs, only the row sums give a bound.
            return (bound, bound);
        }
        // |F_jk·n_j| of the senders that `pull` does not fill.
        let rows: Vec<Vec<(u32, f64)>> = (0..self.count)
            .into_par_iter()
            .map(|j| {
                let mut row = Vec::new();
                if self.own[j] {
                    let n = linked.points[j].n();
                    self.links(linked, j, n, 1.0, &mut |k, f| row.push((k as u32, f.abs())));
                }
                row
            })
            .collect();
        let mut x = vec![[1.0f64; 3]; self.count];
        let mut grown = bound;
        for _ in 0..STEPS {
            // Fine to coarse: means of finished children.
            for k in (0..self.count).rev() {
                if !self.own[k] {
                    let mut mean = [0.0; 3];
                    for w in linked.pull.row(k) {
                        for (m, v) in mean.iter_mut().zip(x[w.index as usize]) {
                            *m += f64::from(w.weight) * v;
                        }
                    }
                    x[k] = mean;
                }
            }
            let y: Vec<[f64; 3]> = (rows.par_iter().enumerate())
                .map(|(j, row)| {
                    let mut sum = [0.0; 3];
                    for &(k, f) in row {
                        for (s, v) in sum.iter_mut().zip(x[k as usize]) {
                            *s += f * v;
                        }
                    }
                    let albedo = albedo(j);
                    [0, 1, 2].map(|c| albedo[c] * sum[c])
                })
                .collect();
            let (mut largest, mut before, mut after) = (0.0f64, [0.0; 3], [0.0; 3]);
            for j in (0..self.count).filter(|&j| self.own[j]) {
                for c in 0..3 {
                    largest = largest.max(y[j][c] / x[j][c]);
                    before[c] += x[j][c];
                    after[c] += y[j][c];
                }
            }
            bound = bound.min(largest);
            grown = (0..3).map(|c| after[c] / before[c]).fold(0.0, f64::max);
            if bound <= 0.0 {
                break;
            }
            for (x, y) in x.iter_mut().zip(&y) {
                for c in 0..3 {
                    // Values neither overflow nor vanish.
                    x[c] = (RETAINED_FRACTION * x[c] + (1.0 - RETAINED_FRACTION) * y[c] / bound)
                        .max(1e-100);
                }
            }
        }
        (bound, grown)
    }
}
