//! Method `l08`: the adaptive refinement of \[L08\] Figure 5 as published. It is the baseline for
//! method `bounded`.
//!
//! Links are differences on both sides. Senders have differences to coarser levels (\[L08\] Eq.
//! (7)). Receivers encode the residual of their parents' prediction (Eq. (17)). A link to a
//! coarsest sender is kept if its magnitude exceeds ε. A link to a finer sender must also vary by
//! more than ε among the sender's neighbors. The children of a receiver are gathered if any of its
//! links was kept.
//!
//! Deviations: reflectance is not part of the link (design D1). The receivers of a level are
//! processed in parallel. Figure 5 permits this, since its queue is in the order of levels.

use super::gather::{GatherScene, Gathered, gather};
use super::refine::{RawRow, RefinedOperator, first_fraction};
use crate::basis::Weights;
use glam::{Vec3, Vec3A};
use rayon::prelude::*;
use std::time::{Duration, Instant};

/// Returns the functions of the same level that cover each sender's point. These are the neighbors
/// of \[L08\] §2.1 ("B_i(p_n) ≠ 0").
#[must_use]
pub fn neighbors(hierarchy: &crate::basis::Hierarchy, sender_levels: usize) -> Vec<Vec<u32>> {
    let count = hierarchy.level_starts[sender_levels] as usize;
    (0..count)
        .into_par_iter()
        .map(|i| {
            let l = hierarchy.level_of(i);
            let first = hierarchy.level_starts[l];
            let mut found = Vec::new();
            let surface = &hierarchy.surfaces[i];
            hierarchy.senders[l].raw_weights(surface.position, surface.normal, &mut found);
            found
                .iter()
                .map(|w| w.index + first)
                .filter(|&k| k as usize != i)
                .collect()
        })
        .collect()
}

/// Result of one receiver.
struct ReceiverRow {
    row: RawRow,
    sky: Vec3A,
    uncovered: f32,
    unlit: f32,
    row_sum: f32,
    /// Durations of the gather and of the remaining work.
    times: [Duration; 2],
}

/// Input of all receivers of a level.
struct ReceiverLevel<'a> {
    scene: &'a GatherScene<'a>,
    parents: &'a Weights,
    neighbors: &'a [Vec<u32>],
    epsilon: f32,
    /// Rows of coarser levels.
    rows: &'a [RawRow],
}

impl ReceiverLevel<'_> {
    /// Gathers receiver `i` and selects its links. `links` is zero for all senders before and
    /// after.
    fn receive(&self, i: usize, gathered: &mut Gathered, links: &mut [Vec3A]) -> ReceiverRow {
        let began = Instant::now();
        gather(self.scene, i, gathered);
        let gather_time = began.elapsed();
        let coarsest = self.scene.hierarchy.level_starts[1];
        let mut touched = gathered.touched.clone();
        for &j in &touched {
            links[j as usize] = gathered.link(j);
        }
        // The coarsest level partitions the hits, so its links sum to the row's mass.
        let sum: Vec3A = touched
            .iter()
            .filter(|&&j| j < coarsest)
            .map(|&j| links[j as usize])
            .sum();
        // [L08] Eq. (17): subtract the parents' prediction.
        for w in self.parents.row(i) {
            for &(j, link) in &self.rows[w.index as usize].links {
                links[j as usize] -= w.weight * link;
                touched.push(j);
            }
        }
        touched.sort_unstable();
        touched.dedup();
        let mut kept = Vec::new();
        for &j in &touched {
            let link = links[j as usize];
            let varies = |k: &u32| (link - links[*k as usize]).length() > self.epsilon;
            let keep = link.length() > self.epsilon
                && (j < coarsest || self.neighbors[j as usize].iter().any(varies));
            if keep {
                kept.push((j, link));
            }
        }
        for &j in &touched {
            links[j as usize] = Vec3A::ZERO;
        }
        ReceiverRow {
            row: RawRow {
                active: !kept.is_empty(),
                links: kept,
                ..RawRow::default()
            },
            sky: gathered.sky,
            uncovered: gathered.uncovered,
            unlit: gathered.unlit,
            row_sum: sum.dot(self.scene.hierarchy.surfaces[i].normal.into()),
            times: [gather_time, began.elapsed() - gather_time],
        }
    }
}

/// Computes the rows of \[L08\] Figure 5 with threshold `epsilon`. `parents` are those of all
/// coarser levels. `progress` receives the completed part and returns `false` to cancel. Returns
/// `None` if canceled.
pub fn refine_l08(
    scene: &GatherScene<'_>,
    parents: &Weights,
    neighbors: &[Vec<u32>],
    epsilon: f32,
    progress: &(dyn Fn(f32) -> bool + Sync),
) -> Option<RefinedOperator> {
    let hierarchy = scene.hierarchy;
    let points = hierarchy.len();
    let senders = neighbors.len();
    let mut out = RefinedOperator {
        rows: Vec::with_capacity(points),
        sky: Vec::with_capacity(points),
        ..RefinedOperator::default()
    };
    let mut uncovered = 0.0f64;
    let mut times = [Duration::ZERO; 2];
    let mut queued = vec![false; points];
    queued[..hierarchy.level_starts[1] as usize].fill(true);
    for l in 0..hierarchy.levels.len() {
        let level = hierarchy.level(l);
        let input = ReceiverLevel {
            scene,
            parents,
            neighbors,
            epsilon,
            rows: &out.rows,
        };
        let mut results: Vec<Option<ReceiverRow>> = Vec::with_capacity(level.len());
        for chunk in level.clone().collect::<Vec<_>>().chunks(1024) {
            results.par_extend(chunk.par_iter().map_init(
                || (Gathered::new(senders), vec![Vec3A::ZERO; senders]),
                |(gathered, links), &i| queued[i].then(|| input.receive(i, gathered, links)),
            ));
            if !progress((level.start + results.len()) as f32 / points as f32) {
                return None;
            }
        }
        for (i, result) in level.clone().zip(results) {
            let Some(one) = result else {
                inherit(&mut out, parents, i);
                continue;
            };
            times[0] += one.times[0];
            times[1] += one.times[1];
            out.gathered += 1;
            uncovered += f64::from(one.uncovered);
            out.missed.push(one.uncovered + one.unlit);
            out.largest_row_sum = out.largest_row_sum.max(one.row_sum);
            out.sky.push(one.sky.into());
            out.rows.push(one.row);
        }
        if l + 1 < hierarchy.levels.len() {
            for child in hierarchy.level(l + 1) {
                queued[child] = parents.row(child).iter().any(|w| {
                    level.contains(&(w.index as usize)) && out.rows[w.index as usize].active
                });
            }
        }
    }
    out.rays = out.gathered * u64::from(scene.rays);
    out.uncovered = uncovered / out.gathered.max(1) as f64;
    out.gather_share = first_fraction(times);
    Some(out)
}

/// Stores an empty row for point `i`, which is not gathered. Its sky visibility is the mean of its
/// parents. The weights of each coarser level that covers the point sum to one.
fn inherit(out: &mut RefinedOperator, parents: &Weights, i: usize) {
    out.missed.push(0.0);
    let row = parents.row(i);
    let total: f32 = row.iter().map(|w| w.weight).sum();
    let sum: Vec3 = row
        .iter()
        .map(|w| w.weight * out.sky[w.index as usize])
        .sum();
    out.sky
        .push(if total > 0.0 { sum / total } else { Vec3::ZERO });
    out.rows.push(RawRow::default());
}
