//! Rule `bounded`: rows that lose nothing, with a bound on what they blur (design D3).
//!
//! A row is a cut through the sender hierarchy. It starts as the full gather at the finest senders; then groups of siblings hand their
//! mass to their common parent, the groups that change least first. Handing a group over replaces Σ_c a_c f_c by a_k f_k with
//! a_k = Σ_c a_c, which is exact when a is even over the group; what it drops is d_c = a_c − a_k / n. The row stops when the root of
//! Σ |d|² over all groups handed over reaches ε times the row's own mass. Mass is handed over, never thrown away: the row sum stays as
//! it was gathered, so truncation neither darkens nor brightens.
//!
//! |d|² is estimated from the two halves of the gather, d_even · d_odd · 4: noise of the two is independent and cancels in the mean, so that
//! noise does not make links (design D4).
//!
//! [L08]'s rule drops links below a fixed ε instead and is kept as the baseline, see [`super::l08`].

use super::gather::Gathered;
use crate::basis::Weights;
use glam::Vec3A;

/// The sender hierarchy as a tree: every sender below the coarsest level belongs to the parent that weighs most.
#[derive(Debug)]
pub struct SenderTree {
    /// The parent of each sender; its own index at a root.
    pub parent: Vec<u32>,
    /// How many children each sender has.
    pub children: Vec<u32>,
    /// Level bounds of the senders.
    pub level_starts: Vec<u32>,
}

impl SenderTree {
    /// From the parent weights of the senders. `level_starts` bounds the sender levels.
    #[must_use]
    pub fn new(parents: &Weights, level_starts: &[u32]) -> Self {
        let count = level_starts[level_starts.len() - 1] as usize;
        let mut parent: Vec<u32> = (0..count as u32).collect();
        let mut children = vec![0; count];
        for i in 0..count {
            let level = level_starts.partition_point(|&s| s as usize <= i) - 1;
            // Only the very next level: the pull of a parent is over that one.
            let above = if level == 0 { 0..0 } else { level_starts[level - 1]..level_starts[level] };
            let mut best = 0.0;
            for w in parents.row(i) {
                if above.contains(&w.index) && w.weight > best {
                    best = w.weight;
                    parent[i] = w.index;
                }
            }
            if parent[i] as usize != i {
                children[parent[i] as usize] += 1;
            }
        }
        Self {
            parent,
            children,
            level_starts: level_starts.to_vec(),
        }
    }
}

/// Room for [`cut_row`]; one a thread.
#[derive(Default)]
pub struct CutScratch {
    /// Per sender: 0 nothing here, 1 carries mass in the row, 2 split (some descendants are kept finer).
    state: Vec<u8>,
    by_parent: Vec<(u32, u32)>,
    groups: Vec<Group>,
}

struct Group {
    parent: u32,
    first: u32,
    count: u32,
    dropped: f32,
    rank: f32,
}

/// Cuts the gathered row: hands mass up in `gathered` and returns the links kept, senders ascending. `epsilon` is the bound on the root of the
/// dropped square sum, relative to the row's mass.
pub fn cut_row(gathered: &mut Gathered, tree: &SenderTree, epsilon: f32, scratch: &mut CutScratch) -> Vec<(u32, Vec3A)> {
    scratch.state.resize(tree.parent.len(), 0);
    let total: Vec3A = gathered.touched.iter().map(|&j| gathered.link(j)).sum();
    let budget = (epsilon * total.length()).powi(2);
    let mut spent = 0.0;
    for &j in &gathered.touched {
        scratch.state[j as usize] = 1;
    }
    let mut everything = gathered.touched.clone();
    let levels = tree.level_starts.len() - 1;
    for level in (1..levels).rev() {
        let range = tree.level_starts[level]..tree.level_starts[level + 1];
        scratch.by_parent.clear();
        for &j in everything.iter().filter(|&&j| range.contains(&j) && scratch.state[j as usize] != 0) {
            if tree.parent[j as usize] != j {
                scratch.by_parent.push((tree.parent[j as usize], j));
            }
        }
        scratch.by_parent.sort_unstable();
        scratch.groups.clear();
        let mut first = 0;
        for members in scratch.by_parent.chunk_by(|a, b| a.0 == b.0) {
            let parent = members[0].0;
            let split = members.iter().any(|&(_, c)| scratch.state[c as usize] == 2);
            if !split {
                let n = tree.children[parent as usize] as f32;
                let mut mean = [Vec3A::ZERO; 2];
                for &(_, c) in members {
                    let [even, odd] = gathered.sums[c as usize];
                    mean[0] += even;
                    mean[1] += odd;
                }
                mean = [mean[0] / n, mean[1] / n];
                // Children that the gather did not touch have a = 0, so d = −mean.
                let absent = n - members.len() as f32;
                let mut dropped = absent * mean[0].dot(mean[1]);
                for &(_, c) in members {
                    let [even, odd] = gathered.sums[c as usize];
                    dropped += (even - mean[0]).dot(odd - mean[1]);
                }
                let dropped = (4.0 * dropped).max(0.0);
                scratch.groups.push(Group {
                    parent,
                    first: first as u32,
                    count: members.len() as u32,
                    dropped,
                    // What a link less costs; a lone child saves nothing here but opens the way further up.
                    rank: dropped / (members.len() as f32 - 0.75),
                });
            } else {
                scratch.state[parent as usize] = 2;
            }
            first += members.len();
        }
        scratch
            .groups
            .sort_unstable_by(|a, b| a.rank.total_cmp(&b.rank).then(a.parent.cmp(&b.parent)));
        // A share for this level; what it leaves goes on to the coarser ones.
        let share = budget * (levels - level) as f32 / (levels - 1) as f32;
        for group in &scratch.groups {
            let p = group.parent as usize;
            if spent + group.dropped <= share {
                spent += group.dropped;
                let range = group.first as usize..(group.first + group.count) as usize;
                for &(_, c) in &scratch.by_parent[range] {
                    let sums = std::mem::replace(&mut gathered.sums[c as usize], [Vec3A::ZERO; 2]);
                    gathered.sums[p][0] += sums[0];
                    gathered.sums[p][1] += sums[1];
                    scratch.state[c as usize] = 0;
                }
                if scratch.state[p] == 0 {
                    scratch.state[p] = 1;
                    everything.push(group.parent);
                }
            } else {
                if scratch.state[p] == 0 {
                    everything.push(group.parent);
                }
                scratch.state[p] = 2;
            }
        }
    }
    everything.sort_unstable();
    everything.dedup();
    let mut links = Vec::new();
    for &j in &everything {
        let link = gathered.link(j);
        if link != Vec3A::ZERO {
            links.push((j, link));
        }
        gathered.sums[j as usize] = [Vec3A::ZERO; 2];
        scratch.state[j as usize] = 0;
    }
    links
}
