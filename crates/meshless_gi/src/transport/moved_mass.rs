//! Mass that truncation moves to coarse senders, and the pull weights that follow from it (design
//! D3).
//!
//! A row that moves mass to a parent replaces its children by the parent's mean. Not all children
//! are equally visible to receivers: children that face a lit yard are themselves visible from the
//! yard. A mean by area would darken their contribution by some percent. The mean is therefore
//! weighted by the mass that the rows of the senders' own points moved. Over all these rows,
//! truncation then loses no light: Σ_i Σ_c a_ic f_c = Σ_i a_ik f_k with f_k = Σ_c m_c f_c / Σ_c m_c
//! and m_c = Σ_i a_ic.

use super::SenderTree;
use crate::basis::{WeightEntry, Weights};
use std::sync::atomic::{AtomicU64, Ordering};

/// Fixed-point steps per unit of mass. Integer sums do not depend on the order (design D5). The
/// mass of a row is at most one, and 2²⁴ rows fit.
const FIXED_POINT_SCALE: f32 = (1u64 << 40) as f32;
/// Weight of the visible areas, relative to the moved mass.
const VISIBLE_AREA_WEIGHT: f32 = 0.01;

/// Moved mass of every sender, by the level of the ancestor that received it.
#[derive(Debug)]
pub struct TruncationMass {
    levels: Vec<Vec<AtomicU64>>,
}

impl TruncationMass {
    /// Creates empty sums.
    #[must_use]
    pub fn new(tree: &SenderTree) -> Self {
        let level = || tree.parent.iter().map(|_| AtomicU64::new(0)).collect();
        let levels = tree.level_starts.len() - 1;
        Self {
            levels: (0..levels).map(|_| level()).collect(),
        }
    }

    /// Adds `mass` of sender `j` in a row that moved it to the ancestor `k`.
    pub fn add(&self, tree: &SenderTree, j: u32, k: u32, mass: f32) {
        if j != k && mass > 0.0 {
            let level = &self.levels[tree.level_of(k)];
            level[j as usize].fetch_add((mass * FIXED_POINT_SCALE) as u64, Ordering::Relaxed);
        }
    }

    /// Computes the pull weights. Each sender is the mean of its descendants, weighted by the mass
    /// that they moved to it. Without any mass, its children are weighted by `shown`. For every
    /// level, `shown` has the area of each sender that is visible to receivers beyond the level's
    /// functions. Rows of senders without children are empty.
    #[must_use]
    pub fn pull(&self, tree: &SenderTree, shown: &[Vec<f32>]) -> Weights {
        let mut rows: Vec<Vec<WeightEntry>> = vec![Vec::new(); tree.parent.len()];
        let mut sums = vec![[0.0f32; 2]; tree.parent.len()];
        // Visits every pair of a sender and its ancestor.
        let pairs = |visit: &mut dyn FnMut(usize, usize, f32, f32)| {
            for (j, &parent) in tree.parent.iter().enumerate() {
                let mut k = j;
                while tree.parent[k] as usize != k {
                    k = tree.parent[k] as usize;
                    let level = tree.level_of(k as u32);
                    let mass = self.levels[level][j].load(Ordering::Relaxed) as f32;
                    let own = k == parent as usize;
                    let general = if own { shown[level][j] } else { 0.0 };
                    visit(j, k, mass, general);
                }
            }
        };
        pairs(&mut |_, k, mass, general| {
            sums[k][0] += mass;
            sums[k][1] += general;
        });
        pairs(&mut |j, k, mass, general| {
            let [moved_mass, shown] = sums[k];
            let general = if shown > 0.0 { general / shown } else { 0.0 };
            let weight = if moved_mass > 0.0 {
                (1.0 - VISIBLE_AREA_WEIGHT) * mass / moved_mass + VISIBLE_AREA_WEIGHT * general
            } else {
                general
            };
            if weight > 0.0 {
                rows[k].push(WeightEntry {
                    index: j as u32,
                    weight,
                });
            }
        });
        for row in &mut rows {
            let sum: f32 = row.iter().map(|w| w.weight).sum();
            for w in row.iter_mut() {
                w.weight /= sum;
            }
        }
        Weights::from_rows(rows)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truncation_mass_mean_equals_moved_mass() {
        // Two roots, two children each, two grandchildren below the first child.
        let tree = SenderTree::new(&[0, 1, 0, 0, 1, 1, 2, 2], &[0, 2, 6, 8]);
        let shown = vec![vec![1.0; 8]; 3];
        let moved_mass = TruncationMass::new(&tree);
        moved_mass.add(&tree, 6, 2, 0.25);
        moved_mass.add(&tree, 7, 2, 0.75);
        moved_mass.add(&tree, 6, 0, 0.3);
        moved_mass.add(&tree, 3, 0, 0.1);
        moved_mass.add(&tree, 3, 3, 0.5);
        let pull = moved_mass.pull(&tree, &shown);
        let weight = |k: usize, j: u32| {
            let entry = pull.row(k).iter().find(|w| w.index == j);
            entry.map_or(0.0, |w| w.weight)
        };
        for k in [0, 1, 2] {
            let sum: f32 = pull.row(k).iter().map(|w| w.weight).sum();
            assert!((sum - 1.0).abs() < 1e-6, "{k}: {sum}");
        }
        assert!((weight(2, 7) - 0.75).abs() < 0.01 && (weight(2, 6) - 0.25).abs() < 0.01);
        assert!((weight(0, 6) - 0.75).abs() < 0.01 && (weight(0, 3) - 0.25).abs() < 0.01);
        // No mass was moved to the second root, so the visible areas of its children are the
        // weights.
        assert_eq!([weight(1, 4), weight(1, 5)], [0.5, 0.5]);
        assert!(pull.row(3).is_empty() && pull.row(7).is_empty());
    }
}
