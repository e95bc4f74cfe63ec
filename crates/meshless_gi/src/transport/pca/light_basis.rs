//! Light basis per cluster of senders, and rows of the operator in these bases ([P14] §4.3).
//!
//! The first principal components of a training set of lights on a cluster are its basis D_s
//! (§4.3.1). A row F_i is projected onto it directly after the gather: S_i,(s,j) = Σ_k F_ik
//! D_s[j,k]. The full matrix is never stored. §4.3.2 lights the scene with one basis vector after
//! the other instead.
//!
//! Deviations. The mean over the training set is not subtracted (Eq. (10)), since transport is
//! linear. Twice the light must give twice the result, and zero light must give zero. Instead, the
//! first vector of each basis is constant, and the mean over the cluster is subtracted from each
//! light of the training set. Uniform light, the energy of any white room, is then exact for any
//! training set. All other vectors have no mass. Lights are scaled by their returned light, so that
//! a light next to a wall does not dominate. Senders have radiosity and links depend on geometry
//! only (design D1), so albedo and emission can change. The training set has radiosity too, with
//! the albedo of one color channel per light.
//!
//! Small entries are dropped (§4.4), those with the smallest effect on the training set first. This
//! stops when the root of their sum of squares reaches ε of the light. The effect of an entry is
//! the product of its values by the even and the odd rays, as in
//! [`bounded`](crate::transport::bounded_truncation). Noise therefore does not create links.
//! Entries of constant vectors are kept, so nothing darkens or brightens.

use super::{Clusters, decompose};
use crate::basis::{WeightEntry, Weights};
use crate::transport::{Gathered, Link};
use glam::Vec3A;
use rayon::prelude::*;

/// Weight of the squared tangential components of a row, as in refinement. Only normal maps use
/// these components.
const TANGENTIAL: f32 = 0.1;

/// Radiosity under the training lights.
pub struct TrainingSet {
    /// Senders that are not means of others. Clusters consist of them.
    pub own: Vec<u32>,
    /// Radiosity of every sender in `own`, light after light, in W/m² or relative.
    pub light: Vec<f32>,
}

/// Bases of all clusters.
#[derive(Debug, Default)]
pub struct LightBasis {
    /// Senders, cluster after cluster.
    members: Vec<u32>,
    /// Start of each cluster's senders, and the end.
    starts: Vec<u32>,
    /// Start of each cluster's columns, and the end.
    columns: Vec<u32>,
    /// Vectors, column after column.
    vectors: Vec<f32>,
    /// Start of each cluster's vectors.
    first: Vec<usize>,
    /// The same vectors, sender after sender: for each member, all values of its cluster.
    by_member: Vec<f32>,
    /// Mean square of each column's coefficient over the training set.
    squares: Vec<f32>,
    /// Index among `members` and cluster of each sender. `None` for senders that are means.
    slot: Vec<Option<(u32, u32)>>,
    /// Weights of the senders that are means.
    means: Weights,
    /// Root of the part of the training set's squares that is outside the bases.
    missed: f64,
}

/// Scratch memory of [`LightBasis::compress`], one per thread.
#[derive(Default)]
pub struct CompressScratch {
    /// Even and odd sums of each column.
    sums: Vec<[Vec3A; 2]>,
    /// Clusters with hits.
    hit_clusters: Vec<u32>,
    marks: Vec<bool>,
    /// Squared effect of an entry, and its column.
    order: Vec<(f32, u32)>,
    kept: Vec<bool>,
}

impl LightBasis {
    /// Creates bases of at most `coefficients` vectors (at least one) for `clusters` of the
    /// training set's senders. `pull` has the weights of the other senders.
    #[must_use]
    pub fn new(
        examples: &TrainingSet,
        clusters: &Clusters,
        coefficients: usize,
        pull: &Weights,
        seed: u64,
    ) -> Self {
        let own = examples.own.len();
        let sources = examples.light.len() / own.max(1);
        let coefficients = coefficients
            .min((Link::MAX_SENDERS - 1) / clusters.len().max(1))
            .max(1);
        let found: Vec<(Vec<f32>, Vec<f32>, [f64; 2])> = (0..clusters.len())
            .into_par_iter()
            .map(|s| {
                let members = clusters.members_of(s);
                let n = members.len();
                let mut rows = Vec::with_capacity(sources * n);
                // Squares in the constant vector, and all squares.
                let (mut even, mut all) = (0.0f64, 0.0f64);
                for light in examples.light.chunks_exact(own.max(1)) {
                    let at = rows.len();
                    rows.extend(members.iter().map(|&k| light[k as usize]));
                    let row = &mut rows[at..];
                    all += row.iter().map(|v| f64::from(v * v)).sum::<f64>();
                    let sum: f64 = row.iter().map(|v| f64::from(*v)).sum();
                    even += sum * sum / n as f64;
                    let mean = (sum / n as f64) as f32;
                    row.iter_mut().for_each(|v| *v -= mean);
                }
                let rest = decompose(&rows, n, coefficients - 1, seed ^ (s as u64) << 32);
                let mut vectors = vec![1.0 / (n as f32).sqrt(); n];
                vectors.extend(&rest.vectors);
                let share = 1.0 / sources.max(1) as f64;
                let mut squares = vec![(even * share) as f32];
                squares.extend(rest.values.iter().map(|v| v * v * share as f32));
                let held = even + rest.values.iter().map(|v| f64::from(v * v)).sum::<f64>();
                (vectors, squares, [all, all - held])
            })
            .collect();
        let mut out = Self {
            starts: clusters.starts.clone(),
            members: (clusters.members.iter())
                .map(|&k| examples.own[k as usize])
                .collect(),
            columns: vec![0],
            ..Self::default()
        };
        let (mut all, mut missed) = (0.0, 0.0);
        for (s, (vectors, squares, [whole, left])) in found.into_iter().enumerate() {
            let n = clusters.members_of(s).len();
            out.first.push(out.vectors.len());
            out.by_member
                .extend((0..n).flat_map(|k| vectors.iter().skip(k).step_by(n)));
            out.vectors.extend(vectors);
            out.squares.extend(squares);
            out.columns.push(out.squares.len() as u32);
            (all, missed) = (all + whole, missed + left.max(0.0));
        }
        out.missed = match all > 0.0 {
            true => (missed / all).sqrt(),
            false => 0.0,
        };
        out.slot = vec![None; pull.len()];
        for s in 0..out.clusters() {
            for at in out.starts[s]..out.starts[s + 1] {
                out.slot[out.members[at as usize] as usize] = Some((at, s as u32));
            }
        }
        out.means = resolve(pull, &out.slot);
        out
    }

    /// Returns the number of clusters.
    #[must_use]
    pub fn clusters(&self) -> usize {
        self.first.len()
    }

    /// Returns the number of columns of the operator, without the sky.
    #[must_use]
    pub fn columns(&self) -> usize {
        self.squares.len()
    }

    /// Returns the root of the part of the training set's squares that is outside the bases,
    /// dimensionless.
    #[must_use]
    pub fn missed(&self) -> f64 {
        self.missed
    }

    /// Returns the senders of cluster `s`.
    #[must_use]
    pub fn members_of(&self, s: usize) -> &[u32] {
        &self.members[self.starts[s] as usize..self.starts[s + 1] as usize]
    }

    /// Returns the basis of cluster `s`: orthonormal vectors, the constant vector first.
    pub fn vectors_of(&self, s: usize) -> impl ExactSizeIterator<Item = &[f32]> {
        let n = self.members_of(s).len();
        let count = self.count(s);
        self.vectors[self.first[s]..][..n * count].chunks_exact(n)
    }

    fn count(&self, s: usize) -> usize {
        (self.columns[s + 1] - self.columns[s]) as usize
    }

    /// Projects the gathered row of a receiver with normal `n` onto the bases. Returns columns and
    /// their S_i, in ascending order of columns. Drops entries with a total effect below `epsilon`
    /// of the light. An ε of 0 keeps all.
    pub fn compress(
        &self,
        gathered: &Gathered,
        n: Vec3A,
        epsilon: f32,
        scratch: &mut CompressScratch,
    ) -> Vec<(u32, Vec3A)> {
        let CompressScratch {
            sums,
            hit_clusters,
            marks,
            order,
            kept,
        } = scratch;
        sums.resize(self.columns(), [Vec3A::ZERO; 2]);
        kept.resize(self.columns(), false);
        marks.resize(self.clusters(), false);
        hit_clusters.clear();
        let mut add = |j: usize, [even, odd]: [Vec3A; 2]| {
            let Some((at, s)) = self.slot[j] else { return };
            if !std::mem::replace(&mut marks[s as usize], true) {
                hit_clusters.push(s);
            }
            let (s, count) = (s as usize, self.count(s as usize));
            let local = at as usize - self.starts[s] as usize;
            let values = &self.by_member[self.first[s] + local * count..][..count];
            for (sum, &d) in sums[self.columns[s] as usize..].iter_mut().zip(values) {
                sum[0] += d * even;
                sum[1] += d * odd;
            }
        };
        for &j in &gathered.touched {
            let halves = gathered.sums[j as usize];
            if self.slot[j as usize].is_some() {
                add(j as usize, halves);
                continue;
            }
            for w in self.means.row(j as usize) {
                add(w.index as usize, halves.map(|h| w.weight * h));
            }
        }
        hit_clusters.sort_unstable();
        order.clear();
        for &s in &*hit_clusters {
            marks[s as usize] = false;
            let columns = self.columns[s as usize]..self.columns[s as usize + 1];
            kept[columns.start as usize] = true;
            for c in columns.skip(1) {
                let [a, b] = sums[c as usize];
                let square = (1.0 - TANGENTIAL) * a.dot(n) * b.dot(n) + TANGENTIAL * a.dot(b);
                order.push((4.0 * square.max(0.0) * self.squares[c as usize], c));
            }
        }
        order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let (budget, mut spent) = (epsilon * epsilon, 0.0);
        for &(square, c) in &*order {
            spent += square;
            // Columns without light in the training set have no effect. With ε = 0 all are kept.
            kept[c as usize] = epsilon <= 0.0 || (spent > budget && square > 0.0);
        }
        let mut links = Vec::new();
        for &s in &*hit_clusters {
            for c in self.columns[s as usize]..self.columns[s as usize + 1] {
                let [even, odd] = std::mem::replace(&mut sums[c as usize], [Vec3A::ZERO; 2]);
                let link = even + odd;
                if std::mem::take(&mut kept[c as usize]) && link != Vec3A::ZERO {
                    links.push((c, link));
                }
            }
        }
        links.shrink_to_fit();
        links
    }
}

/// Expands senders that are means of others to senders that are not.
fn resolve(pull: &Weights, slot: &[Option<(u32, u32)>]) -> Weights {
    let mut rows: Vec<Vec<WeightEntry>> = vec![Vec::new(); pull.len()];
    // Children have higher indices than their parents.
    for k in (0..pull.len()).rev() {
        if slot[k].is_some() {
            continue;
        }
        let mut row = Vec::new();
        for w in pull.row(k) {
            match slot[w.index as usize] {
                Some(_) => row.push(*w),
                None => row.extend(rows[w.index as usize].iter().map(|v| WeightEntry {
                    index: v.index,
                    weight: w.weight * v.weight,
                })),
            }
        }
        rows[k] = row;
    }
    Weights::from_rows(rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Random;
    use crate::transport::pca::Compression;

    /// Number of senders: two means, then nineteen senders in clusters of one, eight and ten.
    const SENDERS: usize = 21;

    fn pull() -> Weights {
        let row = |range: std::ops::Range<u32>| -> Vec<WeightEntry> {
            let weight = 1.0 / range.len() as f32;
            range.map(|index| WeightEntry { index, weight }).collect()
        };
        let none = std::iter::repeat_n(Vec::new(), SENDERS - 2);
        // The first is the mean of the second and of a sender.
        Weights::from_rows([row(1..3), row(5..9)].into_iter().chain(none))
    }

    fn clusters() -> Clusters {
        let of = |k: u32| u32::from(k > 0) + u32::from(k > 8);
        Clusters {
            roots: vec![0, 1, 9],
            starts: vec![0, 1, 9, 19],
            members: (0..19).collect(),
            of_point: (0..19).map(of).collect(),
        }
    }

    fn basis(
        coefficients: usize,
        sources: usize,
        light: impl Fn(usize, usize) -> f32,
    ) -> LightBasis {
        let examples = TrainingSet {
            own: (2..SENDERS as u32).collect(),
            light: (0..sources)
                .flat_map(|l| (0..19).map(move |k| (l, k)))
                .map(|(l, k)| light(l, k))
                .collect(),
        };
        LightBasis::new(&examples, &clusters(), coefficients, &pull(), 1)
    }

    fn noise(l: usize, k: usize) -> f32 {
        Random::new(4, l as u64, k as u64).unit()
    }

    fn gathered(seed: u64) -> Gathered {
        let mut random = Random::new(seed, 0, 0);
        let mut out = Gathered::new(SENDERS);
        for j in 0..SENDERS as u32 {
            let v = Vec3A::new(random.unit(), random.unit(), random.unit()) * 0.03;
            (0..2).for_each(|half| out.deposit(j, half, v));
        }
        out
    }

    /// Computes the values of the projected row and of the gathered row for `light`.
    fn both(basis: &LightBasis, row: &[(u32, Vec3A)], of: &Gathered, light: &[f32]) -> [Vec3A; 2] {
        let mut all = [0.0; SENDERS];
        all[2..].copy_from_slice(light);
        for k in [1, 0] {
            all[k] = pull()
                .row(k)
                .iter()
                .map(|w| w.weight * all[w.index as usize])
                .sum();
        }
        let compression = Compression::new(basis, SENDERS);
        let estimate = row
            .iter()
            .map(|&(c, f)| {
                let senders = compression.column(c as usize);
                f * senders.map(|(j, v)| v * all[j as usize]).sum::<f32>()
            })
            .sum();
        [
            estimate,
            (0..SENDERS).map(|j| of.link(j as u32) * all[j]).sum(),
        ]
    }

    #[test]
    fn light_basis_uniform_light_is_exact() {
        type Light = fn(usize, usize) -> f32;
        let lights: [(usize, Light); 5] = [
            (0, |_, _| 0.0),
            // A sealed room, one light, proportional lights, independent lights.
            (30, |_, _| 0.0),
            (1, noise),
            (30, |l, k| (l + 1) as f32 * noise(0, k)),
            (30, noise),
        ];
        for (sources, light) in lights {
            for coefficients in [1, 4, 100] {
                let basis = basis(coefficients, sources, light);
                let row =
                    basis.compress(&gathered(3), Vec3A::Z, 0.5, &mut CompressScratch::default());
                assert!(row.is_sorted_by_key(|l| l.0) && row.len() >= 3);
                for scale in [1.0, 2.0] {
                    let [estimate, exact] = both(&basis, &row, &gathered(3), &[scale; 19]);
                    assert!(
                        (estimate - exact).length() < 1e-3 * exact.length(),
                        "{estimate} {exact}"
                    );
                }
            }
        }
    }

    #[test]
    fn light_basis_reproduces_training_light() {
        let three = |l: usize, k: usize| {
            (0..3)
                .map(|c| noise(l, 100 + c) * noise(50 + c, k))
                .sum::<f32>()
        };
        let mut scratch = CompressScratch::default();
        for (coefficients, light, max) in [
            (4, &three as &dyn Fn(usize, usize) -> f32, 2e-3),
            (10, &noise, 2e-3),
        ] {
            let basis = basis(coefficients, 40, light);
            assert!(basis.missed() < 1e-3, "{}", basis.missed());
            let new: Vec<f32> = (0..19).map(|k| light(77, k)).collect();
            let row = basis.compress(&gathered(5), Vec3A::Z, 0.0, &mut scratch);
            let [estimate, exact] = both(&basis, &row, &gathered(5), &new);
            assert!(
                (estimate - exact).length() < max * exact.length(),
                "{estimate} {exact}"
            );
        }
        // Too few vectors do not represent all light, and `missed` returns the lost part.
        let poor = basis(2, 40, noise);
        assert!(poor.missed() > 0.1);
        let new: Vec<f32> = (0..19).map(|k| noise(77, k)).collect();
        let row = poor.compress(&gathered(5), Vec3A::Z, 0.0, &mut scratch);
        let [estimate, exact] = both(&poor, &row, &gathered(5), &new);
        assert!(
            (estimate - exact).length() > 4e-3 * exact.length(),
            "{estimate} {exact}"
        );
    }

    #[test]
    fn light_basis_size_is_bounded_by_senders() {
        // A cluster of one sender has the constant vector only. Proportional lights add one vector.
        // Fewer lights than vectors add at most one vector per light.
        let counts = |b: &LightBasis| [0, 1, 2].map(|s| b.vectors_of(s).len());
        assert_eq!(counts(&basis(100, 40, noise)), [1, 8, 10]);
        assert_eq!(counts(&basis(100, 3, noise)), [1, 4, 4]);
        assert_eq!(counts(&basis(100, 0, noise)), [1, 1, 1]);
        assert_eq!(counts(&basis(100, 40, |_, _| 0.0)), [1, 1, 1]);
        assert_eq!(counts(&basis(100, 40, |l, _| l as f32)), [1, 1, 1]);
        assert_eq!(
            counts(&basis(100, 40, |l, k| l as f32 * noise(0, k))),
            [1, 2, 2]
        );
    }

    #[test]
    fn light_basis_drops_small_vectors_within_bound() {
        let basis = basis(10, 200, |l, k| noise(l, k) * 0.3f32.powi((k % 8) as i32));
        let mut scratch = CompressScratch::default();
        let mut sizes = Vec::new();
        for epsilon in [0.0, 0.003, 0.01, 0.03, 1.0] {
            let row = basis.compress(&gathered(9), Vec3A::Z, epsilon, &mut scratch);
            let mut square = 0.0;
            for l in 300..400 {
                let light: Vec<f32> = (0..19)
                    .map(|k| noise(l, k) * 0.3f32.powi((k % 8) as i32))
                    .collect();
                let [estimate, exact] = both(&basis, &row, &gathered(9), &light);
                square += (estimate - exact).z.powi(2) / 100.0;
            }
            let bound = 1.5 * epsilon + 1e-4;
            assert!(square.sqrt() < bound, "{epsilon}: {}", square.sqrt());
            sizes.push(row.len());
        }
        assert!(
            sizes.is_sorted_by(|a, b| a >= b) && sizes[4] == 3,
            "{sizes:?}"
        );
        assert!(sizes[2] < sizes[0], "{sizes:?}");
    }
}
