//! Rule `bounded`: rows that lose nothing, with a bound on what they blur (design D3).
//!
//! A row is a cut through the sender hierarchy: below some senders everything is handed to them, Σ_c a_c f_c becomes f_k Σ_c a_c. That changes
//! Σ_c a_c (f_c − f_k), which the training lights measure: root mean square over the lights, relative to each light's own root mean square over
//! the level. Of all cuts the row takes the one with the least Σ (changes squared) + price · links, found from the leaves to the roots, as decision
//! trees are pruned. The price of a link is the same in all rows, so that no link could save more elsewhere; where the changes of a row would sum to
//! more than ε² its price falls until they do not. Mass is handed over, never thrown away: the row sum stays as it was gathered, so truncation
//! neither darkens nor brightens.
//!
//! A squared change is estimated as the product of what the even rays and the odd rays say of it, four times: the noise of the two is
//! independent and cancels in the mean, so that noise does not make links (design D4). To it comes a share of what the group
//! would change if each sender were lit on its own, as strongly as lamps light it at all ([`Training::exposure`]): it guards against lights unlike
//! the training lights.
//!
//! \[L08\]'s rule drops links below a fixed ε instead and is kept as the baseline, see [`super::l08`].

use super::gather::Gathered;
use super::training::{SIGNALS, Training};
use glam::Vec3A;

/// Share of the single senders' change in the estimate. Measured on three levels: half of it lets centimetre-scale light beside ledges go
/// unseen, four times as much makes twice the links for no less error.
const GUARD: f32 = 0.25;

/// What a link has to save, in squares of ε. A row that keeps fifty links then pays as much for them as it may lose.
const PRICE: f32 = 0.02;

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
    /// From each sender's parent (its own index at a root). `level_starts` bounds the sender levels.
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

    /// The level of sender `k`.
    #[must_use]
    pub fn level_of(&self, k: u32) -> usize {
        self.level_starts.partition_point(|&start| start <= k) - 1
    }
}

/// Room for [`cut_row`]; one a thread.
#[derive(Default)]
pub struct CutScratch {
    /// Per sender: its node and one more; 0 where the row has none.
    node_of: Vec<u32>,
    /// Senders of the level at hand, and parents that wait for theirs.
    level: Vec<u32>,
    waiting: Vec<u32>,
    /// The senders that were met and all above them, from the finest level up.
    nodes: Vec<Node>,
    /// What each node and those below it give the receiver, by training light, from the even and from the odd rays.
    responses: Vec<[[f32; SIGNALS]; 2]>,
}

/// A sender that a row met, or one above such.
struct Node {
    sender: u32,
    /// Its parent's node; its own at a root.
    parent: u32,
    /// Whether rays met it itself, and nothing finer.
    own: bool,
    /// Whether it is above others.
    inner: bool,
    /// What it and those below it weigh along the receiver's normal, by half of the rays.
    mass: [f32; 2],
    /// Over its children: Σ a b E², Σ a E², Σ b E², with the two halves' masses and the exposures.
    exposed: [f32; 3],
    /// What single senders change when everything below is handed to it, a share of which counts.
    single: f32,
    /// What handing everything below to it changes, squared.
    change: f32,
    /// The best of what is below it.
    best: Cut,
    /// Whether everything below belongs to its link.
    merged: bool,
}

/// A cut of what is below a node.
#[derive(Clone, Copy, Default)]
struct Cut {
    change: f32,
    links: u32,
}

impl Cut {
    fn cost(self, price: f32) -> f32 {
        self.change + price * self.links as f32
    }

    fn add(&mut self, other: Self) {
        self.change += other.change;
        self.links += other.links;
    }
}

/// What the cut of a row is measured by.
#[derive(Clone, Copy)]
pub struct CutMeasure<'a> {
    /// The lights to come.
    pub training: &'a Training,
    /// Bound on the change, relative to the root mean square of the light.
    pub epsilon: f32,
}

impl CutMeasure<'_> {
    /// What a link has to save, as a squared change.
    #[must_use]
    pub fn price(&self) -> f32 {
        PRICE * self.epsilon * self.epsilon
    }
}

/// Cuts the gathered row of a receiver with normal `n`: hands mass up in `gathered` and returns the links kept, senders ascending.
pub fn cut_row(
    gathered: &mut Gathered,
    tree: &SenderTree,
    n: Vec3A,
    measure: &CutMeasure<'_>,
    scratch: &mut CutScratch,
) -> Vec<(u32, Vec3A)> {
    let training = measure.training;
    find_nodes(gathered, tree, n, training, scratch);
    let CutScratch {
        node_of,
        nodes,
        responses,
        ..
    } = scratch;
    for at in 0..nodes.len() {
        hand_up(at, nodes, responses, tree, training);
    }
    // Free links lose nothing but what measures as nothing.
    let bound = measure.epsilon * measure.epsilon;
    let mut price = measure.price();
    for _ in 0..CHEAPER {
        if decide(nodes, price) <= bound {
            break;
        }
        price *= 0.25;
    }
    if decide(nodes, price) > bound {
        decide(nodes, 0.0);
    }
    // From the coarsest down: what is below a link belongs to it.
    for at in (0..nodes.len()).rev() {
        let parent = nodes[at].parent as usize;
        nodes[at].merged |= parent != at && nodes[parent].merged;
    }
    let mut links = Vec::new();
    for node in &*nodes {
        let j = node.sender as usize;
        node_of[j] = 0;
        let parent = &nodes[node.parent as usize];
        let sums = std::mem::replace(&mut gathered.sums[j], [Vec3A::ZERO; 2]);
        if parent.merged && parent.sender != node.sender {
            // Parents come later.
            for (sum, own) in gathered.sums[parent.sender as usize].iter_mut().zip(sums) {
                *sum += own;
            }
            continue;
        }
        let link = sums[0] + sums[1];
        if link != Vec3A::ZERO {
            links.push((node.sender, link));
        }
    }
    links.sort_unstable_by_key(|link| link.0);
    links.shrink_to_fit();
    links
}

/// Times that the price of a row's links falls to a quarter before they are free.
const CHEAPER: usize = 8;

/// Lists the senders that were met and all above them.
fn find_nodes(
    gathered: &Gathered,
    tree: &SenderTree,
    n: Vec3A,
    training: &Training,
    scratch: &mut CutScratch,
) {
    let CutScratch {
        node_of,
        level,
        waiting,
        nodes,
        responses,
    } = scratch;
    node_of.resize(tree.parent.len(), 0);
    nodes.clear();
    responses.clear();
    waiting.clear();
    waiting.extend_from_slice(&gathered.touched);
    for &start in tree.level_starts[..tree.level_starts.len() - 1]
        .iter()
        .rev()
    {
        level.clear();
        level.extend(waiting.iter().filter(|&&j| j >= start));
        waiting.retain(|&j| j < start);
        level.sort_unstable();
        level.dedup();
        for &j in &*level {
            let sums = gathered.sums[j as usize];
            let mass = sums.map(|sum| sum.dot(n));
            let f = &training.signals[j as usize];
            responses.push(mass.map(|a| f.map(|f| a * f)));
            node_of[j as usize] = nodes.len() as u32 + 1;
            nodes.push(Node {
                sender: j,
                parent: 0,
                own: sums != [Vec3A::ZERO; 2],
                inner: false,
                mass,
                exposed: [0.0; 3],
                single: 0.0,
                change: 0.0,
                best: Cut::default(),
                merged: false,
            });
            let parent = tree.parent[j as usize];
            if parent != j {
                waiting.push(parent);
            }
        }
    }
    for node in nodes {
        node.parent = node_of[tree.parent[node.sender as usize] as usize] - 1;
    }
}

/// Measures what handing everything below node `at` to it changes, and adds the node to its parent. Children come before their parents.
fn hand_up(
    at: usize,
    nodes: &mut [Node],
    responses: &mut [[[f32; SIGNALS]; 2]],
    tree: &SenderTree,
    training: &Training,
) {
    let node = &mut nodes[at];
    let k = node.sender as usize;
    if node.inner {
        let [even, odd] = &responses[at];
        let [a, b] = node.mass;
        let mut coherent = 0.0;
        for ((e, o), f) in even.iter().zip(odd).zip(&training.signals[k]) {
            coherent += 4.0 * (e - a * f) * (o - b * f);
        }
        // Σ (a − mean)(b − mean) E² over all children; those that were not met have a = b = 0.
        let [a, b] = node.mass.map(|sum| sum / tree.children[k] as f32);
        let [both, of_a, of_b] = node.exposed;
        node.single += 4.0 * (both - a * of_b - b * of_a + a * b * training.family[k]);
        node.change = (coherent / SIGNALS as f32 + GUARD * node.single).max(0.0);
    }
    let parent = node.parent as usize;
    if parent == at {
        return;
    }
    let ([a, b], single) = (node.mass, node.single);
    let exposure = training.exposure[k];
    let response = responses[at];
    let above = &mut nodes[parent];
    above.inner = true;
    above.mass[0] += a;
    above.mass[1] += b;
    above.single += single;
    for (sum, part) in above.exposed.iter_mut().zip([a * b, a, b]) {
        *sum += part * exposure;
    }
    for (sums, half) in responses[parent].iter_mut().zip(response) {
        for (sum, part) in sums.iter_mut().zip(half) {
            *sum += part;
        }
    }
}

/// Says of every node whether one link to it is worth as much as the best cut below it, and how much the best of all changes.
fn decide(nodes: &mut [Node], price: f32) -> f32 {
    for node in &mut *nodes {
        node.best = Cut {
            change: 0.0,
            links: u32::from(node.own),
        };
    }
    let mut change = 0.0;
    for at in 0..nodes.len() {
        let node = &mut nodes[at];
        let one = Cut {
            change: node.change,
            links: 1,
        };
        node.merged = one.cost(price) <= node.best.cost(price);
        if node.merged {
            node.best = one;
        }
        let (parent, best) = (node.parent as usize, node.best);
        if parent == at {
            change += best.change;
        } else {
            nodes[parent].best.add(best);
        }
    }
    change
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Random;

    /// Two coarse senders, four children each, eight grandchildren each.
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

    /// A signal per training light: random at the finest senders, means above.
    fn training(tree: &SenderTree, amplitude: f32) -> Training {
        let mut random = Random::new(5, 9, 9);
        let mut f = vec![[0.0f32; SIGNALS]; 74];
        for row in &mut f[10..] {
            *row = [(); SIGNALS].map(|()| 1.0 + amplitude * (random.unit() - 0.5));
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
            .map(|row| row.iter().map(|f| f * f).sum::<f32>() / SIGNALS as f32)
            .collect();
        Training::new(f, exposure, 0.0, tree)
    }

    #[test]
    fn rows_keep_their_mass_and_the_bound() {
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
                // The two halves are equal here, so what the rule measures is exact; groups add at worst coherently, and there are ten.
                #[expect(
                    clippy::needless_range_loop,
                    reason = "t picks one light out of every sender's row"
                )]
                for t in 0..SIGNALS {
                    let full: f32 = finest.iter().map(|&(j, a)| a.z * f[j as usize][t]).sum();
                    let cut: f32 = links.iter().map(|&(j, a)| a.z * f[j as usize][t]).sum();
                    let bound = epsilon * (10.0 * SIGNALS as f32).sqrt() + 1e-5;
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

    /// Links and squared change of every way to cut what is below sender `k` (three levels at most), by the definition.
    fn cuts(k: u32, tree: &SenderTree, training: &Training, masses: &[f32]) -> Vec<(f32, f32)> {
        let children: Vec<u32> = (0..masses.len() as u32)
            .filter(|&c| c != k && tree.parent[c as usize] == k)
            .collect();
        if children.is_empty() {
            return match masses[k as usize] > 0.0 {
                true => vec![(1.0, 0.0)],
                false => vec![(0.0, 0.0)],
            };
        }
        let mut all = vec![(0.0, 0.0)];
        for &c in &children {
            let of_child = cuts(c, tree, training, masses);
            all = all
                .iter()
                .flat_map(|a| of_child.iter().map(move |b| (a.0 + b.0, a.1 + b.1)))
                .collect();
        }
        let below = |j: u32| {
            let mut up = j;
            while up != k && tree.parent[up as usize] != up {
                up = tree.parent[up as usize];
            }
            up == k
        };
        let of_k = &training.signals[k as usize];
        let change = (0..SIGNALS).map(|t| {
            let lost = (0..masses.len() as u32)
                .filter(|&j| below(j))
                .map(|j| masses[j as usize] * (training.signals[j as usize][t] - of_k[t]));
            lost.sum::<f32>().powi(2)
        });
        all.push((1.0, change.sum::<f32>() / SIGNALS as f32));
        all
    }

    #[test]
    fn no_cut_is_better_than_the_one_taken() {
        // Two roots, two children each, three grandchildren each.
        let parents: Vec<u32> = (0..18)
            .map(|i| match i {
                0..2 => i,
                2..6 => (i - 2) / 2,
                _ => 2 + (i - 6) / 3,
            })
            .collect();
        let tree = SenderTree::new(&parents, &[0, 2, 6, 18]);
        let mut random = Random::new(8, 8, 8);
        let signals: Vec<[f32; SIGNALS]> = (0..18)
            .map(|_| [(); SIGNALS].map(|()| random.unit()))
            .collect();
        // Nothing is exposed: the guard, which knows no definition to compare with, is left out.
        let training = Training::new(signals, vec![0.0; 18], 0.0, &tree);
        let mut gathered = Gathered::new(18);
        let mut scratch = CutScratch::default();
        let mut sizes = std::collections::BTreeSet::new();
        for epsilon in [0.02, 0.05, 0.1, 0.2, 0.4] {
            for _ in 0..20 {
                let mut masses = vec![0.0; 18];
                for j in 6..18u32 {
                    let mass = 0.1 * random.unit();
                    masses[j as usize] = mass;
                    gathered.deposit(j, 0, Vec3A::Z * (0.5 * mass));
                    gathered.deposit(j, 1, Vec3A::Z * (0.5 * mass));
                }
                let measure = CutMeasure {
                    training: &training,
                    epsilon,
                };
                let links = cut_row(&mut gathered, &tree, Vec3A::Z, &measure, &mut scratch);
                gathered.reset();
                let best = |price: f32| {
                    let roots = [0, 1].map(|k| cuts(k, &tree, &training, &masses));
                    let cost = |c: &(f32, f32)| c.1 + price * c.0;
                    let least = roots.map(|all| {
                        let by_cost =
                            |a: &&(f32, f32), b: &&(f32, f32)| cost(a).total_cmp(&cost(b));
                        *all.iter().min_by(by_cost).unwrap()
                    });
                    (least[0].0 + least[1].0, least[0].1 + least[1].1)
                };
                // The price of all rows, or a lower one where the bound asks for it.
                let mut price = measure.price();
                while best(price).1 > epsilon * epsilon {
                    price *= 0.25;
                }
                assert_eq!(links.len() as f32, best(price).0, "ε {epsilon}");
                sizes.insert(links.len());
            }
        }
        assert!(sizes.len() > 4, "all alike: {sizes:?}");
    }

    #[test]
    fn an_even_row_collapses_and_loses_nothing() {
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
