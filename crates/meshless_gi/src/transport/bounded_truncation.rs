//! Method `bounded`: rows that keep their mass, with a bound on their blur (design D3).
//!
//! A row is a cut through the sender hierarchy. It starts with all gathered finest senders. Groups
//! of siblings then move their mass to their parent, in ascending order of the change. This
//! replaces Σ_c a_c f_c by f_k Σ_c a_c. The change is Σ_c a_c (f_c − f_k). It is measured with the
//! training lights: root mean square over the lights, relative to each light's root mean square
//! over the coarsest points. Merging stops when the root of the sum of squares over all groups
//! reaches ε. Mass is moved and never dropped, so the row sum stays as gathered. Truncation
//! therefore neither darkens nor brightens.
//!
//! A squared change is estimated as four times the product of the values by the even and the odd
//! rays. Their noise is independent and cancels in the mean, so noise does not create links (design
//! D4). The estimate includes a part of the change for senders that are lit alone with their
//! exposure ([`Training::exposure`]). This part covers lights that differ from the training lights.
//!
//! \[L08\] drops links below a fixed ε instead. That method is the baseline, see
//! [`super::l08_truncation`].

use super::gather::Gathered;
use super::training::{TRAINING_LIGHTS, Training};
use glam::Vec3A;

/// Weight of the change for senders that are lit alone. Measured on three scenes: half of it loses
/// light on a scale of centimeters next to ledges. Four times as much doubles the links and does
/// not reduce the error.
const SINGLE_SENDER_WEIGHT: f32 = 0.25;

/// Sender hierarchy as a tree. Every sender below the coarsest level belongs to the parent with the
/// largest weight.
#[derive(Debug)]
pub struct SenderTree {
    /// Parent of each sender, its own index at a root.
    pub parent: Vec<u32>,
    /// Number of children of each sender.
    pub children: Vec<u32>,
    /// Bounds of the senders' levels.
    pub level_starts: Vec<u32>,
}

impl SenderTree {
    /// Creates the tree from each sender's parent (its own index at a root). `level_starts` bounds
    /// the sender levels.
    #[must_use]
    pub fn new(parents: &[u32], level_starts: &[u32]) -> Self {
        let parent = parents.to_vec();
        let mut children = vec![0; parent.len()];
        for (i, &p) in parent.iter().enumerate() {
            if p as usize != i {
                children[p as usize] += 1;
            }
        }
        Self {
            parent,
            children,
            level_starts: level_starts.to_vec(),
        }
    }

    /// Returns the level of sender `k`.
    #[must_use]
    pub fn level_of(&self, k: u32) -> usize {
        self.level_starts.partition_point(|&start| start <= k) - 1
    }
}

/// Marker of the end of a list of children.
const END: u32 = u32::MAX;

/// Scratch memory of [`cut_row`], one per thread.
#[derive(Default)]
pub struct CutScratch {
    /// State of each sender: 0 not in the row, 1 has mass in the row, 2 split (some descendants are
    /// kept finer).
    state: Vec<u8>,
    /// First child in the row of each sender, or [`END`].
    first_child: Vec<u32>,
    /// Next child of the same parent, or [`END`].
    next_sibling: Vec<u32>,
    /// Senders with children in the row.
    parents: Vec<u32>,
    /// Children of one parent.
    members: Vec<u32>,
    groups: Vec<Group>,
    /// Rank in the upper 32 bits, index of the group in the lower 32 bits.
    order: Vec<u64>,
}

impl CutScratch {
    /// Writes the children in the list that starts at `first` to `members`, ascending.
    fn list_members(&mut self, first: u32) {
        self.members.clear();
        let mut child = first;
        while child != END {
            self.members.push(child);
            child = self.next_sibling[child as usize];
        }
    }
}

struct Group {
    parent: u32,
    first: u32,
    change: f32,
}

/// Error measure of a cut.
#[derive(Clone, Copy)]
pub struct CutMeasure<'a> {
    /// Training data.
    pub training: &'a Training,
    /// Bound on the change, relative to the root mean square of the light.
    pub epsilon: f32,
}

/// Truncates the gathered row of a receiver with normal `n`. Moves mass to ancestors in `gathered`
/// and returns the kept links, senders ascending.
pub fn cut_row(
    gathered: &mut Gathered,
    tree: &SenderTree,
    n: Vec3A,
    measure: &CutMeasure<'_>,
    scratch: &mut CutScratch,
) -> Vec<(u32, Vec3A)> {
    scratch.state.resize(tree.parent.len(), 0);
    scratch.first_child.resize(tree.parent.len(), END);
    scratch.next_sibling.resize(tree.parent.len(), END);
    let budget = measure.epsilon * measure.epsilon;
    let mut spent = 0.0;
    for &j in &gathered.touched {
        scratch.state[j as usize] = 1;
    }
    let levels = tree.level_starts.len() - 1;
    for level in (1..levels).rev() {
        list_groups(gathered, tree, level, n, measure.training, scratch);
        scratch.order.sort_unstable();
        // Budget of this level. Coarser levels use the rest.
        let share = budget * (levels - level) as f32 / (levels - 1) as f32;
        for k in 0..scratch.order.len() {
            let group = &scratch.groups[scratch.order[k] as u32 as usize];
            let p = group.parent as usize;
            if spent + group.change <= share {
                spent += group.change;
                scratch.list_members(group.first);
                for &m in &scratch.members {
                    let sums = std::mem::replace(&mut gathered.sums[m as usize], [Vec3A::ZERO; 2]);
                    gathered.sums[p][0] += sums[0];
                    gathered.sums[p][1] += sums[1];
                    scratch.state[m as usize] = 0;
                }
                if scratch.state[p] == 0 {
                    scratch.state[p] = 1;
                }
            } else {
                scratch.state[p] = 2;
            }
        }
    }
    let mut links = Vec::with_capacity(gathered.touched.len());
    for_each_set(&scratch.state, |j| {
        let link = gathered.link(j as u32);
        if link != Vec3A::ZERO {
            links.push((j as u32, link));
        }
        gathered.sums[j] = [Vec3A::ZERO; 2];
    });
    scratch.state.fill(0);
    links.reverse();
    links.shrink_to_fit();
    links
}

/// Lists the groups of siblings of `level` that can be merged, with their ranks. Marks the parents
/// of the other groups as split.
fn list_groups(
    gathered: &Gathered,
    tree: &SenderTree,
    level: usize,
    n: Vec3A,
    training: &Training,
    scratch: &mut CutScratch,
) {
    let range = tree.level_starts[level] as usize..tree.level_starts[level + 1] as usize;
    // Descending, since each child is inserted in front of its siblings.
    scratch.parents.clear();
    for_each_set(&scratch.state[range.clone()], |k| {
        let j = range.start + k;
        let parent = tree.parent[j] as usize;
        if parent != j {
            let first = &mut scratch.first_child[parent];
            if *first == END {
                scratch.parents.push(parent as u32);
            }
            scratch.next_sibling[j] = std::mem::replace(first, j as u32);
        }
    });
    scratch.parents.sort_unstable();
    scratch.groups.clear();
    scratch.order.clear();
    for k in 0..scratch.parents.len() {
        let parent = scratch.parents[k];
        let first = std::mem::replace(&mut scratch.first_child[parent as usize], END);
        scratch.list_members(first);
        let members = &scratch.members;
        if members.iter().any(|&m| scratch.state[m as usize] == 2) {
            scratch.state[parent as usize] = 2;
            continue;
        }
        let change = group_change(gathered, tree, n, training, parent, members);
        // Change per removed link. A single child removes no link here but permits merges at
        // coarser levels. Changes are not negative, so their bits sort like their values. Groups of
        // equal rank keep their order.
        let rank = change / (members.len() as f32 - 0.75);
        let index = scratch.groups.len() as u64;
        (scratch.order).push(u64::from(rank.abs().to_bits()) << 32 | index);
        scratch.groups.push(Group {
            parent,
            first,
            change,
        });
    }
}

/// Calls `each` with the indices of the nonzero states in descending order. Skips zeros in blocks
/// of eight.
fn for_each_set(states: &[u8], mut each: impl FnMut(usize)) {
    let (rest, eights) = states.as_rchunks::<8>();
    for (k, eight) in eights.iter().enumerate().rev() {
        if u64::from_ne_bytes(*eight) != 0 {
            for b in (0..8).rev().filter(|&b| eight[b] != 0) {
                each(rest.len() + 8 * k + b);
            }
        }
    }
    for k in (0..rest.len()).rev().filter(|&k| rest[k] != 0) {
        each(k);
    }
}

/// Computes the squared change if the group is merged, relative to the lights' mean squares.
fn group_change(
    gathered: &Gathered,
    tree: &SenderTree,
    n: Vec3A,
    training: &Training,
    parent: u32,
    members: &[u32],
) -> f32 {
    let of_parent = &training.signals[parent as usize];
    let mut even = [0.0f32; TRAINING_LIGHTS];
    let mut odd = [0.0f32; TRAINING_LIGHTS];
    let mut sums = [0.0f32; 2];
    for &m in members {
        let [a, b] = gathered.sums[m as usize];
        let (a, b) = (a.dot(n), b.dot(n));
        sums[0] += a;
        sums[1] += b;
        for (((e, o), f), p) in even
            .iter_mut()
            .zip(&mut odd)
            .zip(&training.signals[m as usize])
            .zip(of_parent)
        {
            let d = f - p;
            *e += a * d;
            *o += b * d;
        }
    }
    let mut coherent = 0.0;
    for (e, o) in even.iter().zip(&odd) {
        coherent += 4.0 * e * o;
    }
    // Σ (a − mean)(b − mean) E² over all children. Those without hits have a = b = 0.
    let [a_mean, b_mean] = sums.map(|s| s / tree.children[parent as usize] as f32);
    let both = |a: f32, b: f32| 4.0 * a * b;
    let mean_product = both(a_mean, b_mean);
    let mut single = mean_product * training.family[parent as usize];
    for &m in members {
        let [a, b] = gathered.sums[m as usize];
        let (a, b) = (a.dot(n), b.dot(n));
        single += (both(a - a_mean, b - b_mean) - mean_product) * training.exposure[m as usize];
    }
    (coherent / TRAINING_LIGHTS as f32 + SINGLE_SENDER_WEIGHT * single).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Random;

    /// Creates two coarse senders with four children each and eight grandchildren per child.
    fn tree() -> SenderTree {
        let starts = [0u32, 2, 10, 74];
        let parents: Vec<u32> = (0..74)
            .map(|i| match i {
                0..2 => i,
                2..10 => (i - 2) / 4,
                _ => 2 + (i - 10) / 8,
            })
            .collect();
        SenderTree::new(&parents, &starts)
    }

    fn fill(gathered: &mut Gathered, seed: u64, even: bool) {
        let mut random = Random::new(seed, 1, 2);
        for j in 10..74u32 {
            let v = if even {
                Vec3A::Z * 0.01
            } else {
                Vec3A::new(random.unit(), random.unit(), random.unit()) * 0.02
            };
            if even || random.unit() < 0.7 {
                gathered.deposit(j, 0, 0.5 * v);
                gathered.deposit(j, 1, 0.5 * v);
            }
        }
    }

    /// Creates signals of the training lights: random at the finest senders, means at their
    /// ancestors.
    fn training(tree: &SenderTree, amplitude: f32) -> Training {
        let mut random = Random::new(5, 9, 9);
        let mut f = vec![[0.0f32; TRAINING_LIGHTS]; 74];
        for row in &mut f[10..] {
            *row = [(); TRAINING_LIGHTS].map(|()| 1.0 + amplitude * (random.unit() - 0.5));
        }
        for k in (0..10).rev() {
            let own: Vec<usize> = (0..74)
                .filter(|&c| c != k && tree.parent[c] as usize == k)
                .collect();
            f[k] = std::array::from_fn(|t| {
                own.iter().map(|&c| f[c][t]).sum::<f32>() / own.len() as f32
            });
        }
        let exposure = f
            .iter()
            .map(|row| row.iter().map(|f| f * f).sum::<f32>() / TRAINING_LIGHTS as f32)
            .collect();
        Training::new(f, exposure, 0.0, tree)
    }

    #[test]
    fn bounded_rows_keep_mass_within_error_bound() {
        let tree = tree();
        let training = training(&tree, 2.0);
        let f = &training.signals;
        let mut gathered = Gathered::new(74);
        let mut scratch = CutScratch::default();
        let mut sizes = [0; 6];
        for (epsilon, size) in [0.0, 0.02, 0.05, 0.1, 0.3, 10.0]
            .into_iter()
            .zip(&mut sizes)
        {
            for seed in 0..50 {
                fill(&mut gathered, seed, false);
                let before: Vec3A = gathered.touched.iter().map(|&j| gathered.link(j)).sum();
                let finest: Vec<_> = gathered
                    .touched
                    .iter()
                    .map(|&j| (j, gathered.link(j)))
                    .collect();
                let measure = CutMeasure {
                    training: &training,
                    epsilon,
                };
                let links = cut_row(&mut gathered, &tree, Vec3A::Z, &measure, &mut scratch);
                let after: Vec3A = links.iter().map(|l| l.1).sum();
                assert!(
                    (before - after).length() < 1e-5,
                    "ε {epsilon}: {before} became {after}"
                );
                assert!(links.is_sorted_by_key(|l| l.0));
                // The two halves are equal here, so the estimate of the change is exact. Changes of
                // groups add coherently at worst, and there are ten groups.
                #[expect(
                    clippy::needless_range_loop,
                    reason = "t is the index of a light in every sender's row"
                )]
                for t in 0..TRAINING_LIGHTS {
                    let full: f32 = finest.iter().map(|&(j, a)| a.z * f[j as usize][t]).sum();
                    let cut: f32 = links.iter().map(|&(j, a)| a.z * f[j as usize][t]).sum();
                    let bound = epsilon * (10.0 * TRAINING_LIGHTS as f32).sqrt() + 1e-5;
                    assert!(
                        (full - cut).abs() <= bound,
                        "ε {epsilon}: {full} became {cut}"
                    );
                }
                *size += links.len();
                gathered.reset();
            }
        }
        assert!(sizes.is_sorted_by(|a, b| a >= b), "{sizes:?}");
        assert!(sizes[0] > 3 * sizes[5], "{sizes:?}");
    }

    #[test]
    fn bounded_uniform_row_collapses_without_loss() {
        let tree = tree();
        let mut gathered = Gathered::new(74);
        fill(&mut gathered, 0, true);
        let training = training(&tree, 2.0);
        let measure = CutMeasure {
            training: &training,
            epsilon: 1e-3,
        };
        let links = cut_row(
            &mut gathered,
            &tree,
            Vec3A::Z,
            &measure,
            &mut CutScratch::default(),
        );
        assert_eq!(links.iter().map(|l| l.0).collect::<Vec<_>>(), [0, 1]);
        assert!((links[0].1 - Vec3A::Z * 0.32).length() < 1e-5);
    }
}
