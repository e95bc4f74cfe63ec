//! Nearest neighbors of a point by a balanced k-d tree. Used for normals, areas and ray offsets of
//! a point cloud.
//!
//! Ranges are split at the median, so that any distribution gives a tree of depth log₂ N. This
//! includes a million points at one position. The tree is only an order of the points. The middle
//! entry of a range splits it, along the longest side of the range's box.

use glam::Vec3;

/// Largest range that is searched linearly.
const LEAF: usize = 8;
/// Largest range that is built serially.
const PARALLEL: usize = 1 << 14;

/// Point with its index.
#[derive(Clone, Copy, Debug)]
struct IndexedPoint {
    x: Vec3,
    index: u32,
}

/// Neighbor of a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Neighbor {
    /// Index among the points of the tree.
    pub(super) index: u32,
    /// Squared distance, m².
    pub(super) square: f32,
}

/// Balanced k-d tree.
#[derive(Clone, Debug)]
pub(super) struct PointTree {
    entries: Vec<IndexedPoint>,
    /// Split axis of the entry in the middle of a range.
    axes: Vec<u8>,
}

impl PointTree {
    /// Builds a tree of finite points. The same points give the same tree.
    pub(super) fn new(points: &[Vec3]) -> Self {
        let mut entries: Vec<IndexedPoint> = points
            .iter()
            .zip(0u32..)
            .map(|(x, index)| IndexedPoint { x: *x, index })
            .collect();
        let mut axes = vec![0; entries.len()];
        split(&mut entries, &mut axes);
        Self { entries, axes }
    }

    /// Writes at most `count` nearest points of `x` to `out`, nearest first, without the point
    /// `without`. `out` is cleared first.
    pub(super) fn nearest(
        &self,
        x: Vec3,
        count: usize,
        without: Option<u32>,
        out: &mut Vec<Neighbor>,
    ) {
        out.clear();
        if count > 0 {
            self.search(0, self.entries.len(), x, count, without, out);
        }
    }

    /// Returns the point nearest to `x` within the square root of `square`. It equals the first
    /// result of [`nearest`](Self::nearest), but farther points are not searched.
    pub(super) fn nearest_within(&self, x: Vec3, square: f32) -> Option<Neighbor> {
        let mut best = Neighbor {
            index: u32::MAX,
            square,
        };
        self.search_within(&self.entries, &self.axes, x, &mut best);
        (best.index != u32::MAX).then_some(best)
    }

    fn search_within(&self, entries: &[IndexedPoint], axes: &[u8], x: Vec3, best: &mut Neighbor) {
        let offer = |entry: &IndexedPoint, best: &mut Neighbor| {
            let square = entry.x.distance_squared(x);
            if square < best.square {
                let index = entry.index;
                *best = Neighbor { index, square };
            }
        };
        if entries.len() <= LEAF {
            for entry in entries {
                offer(entry, best);
            }
            return;
        }
        let middle = entries.len() / 2;
        let axis = usize::from(axes[middle]);
        let beyond = x[axis] - entries[middle].x[axis];
        let low = (&entries[..middle], &axes[..middle]);
        let high = (&entries[middle + 1..], &axes[middle + 1..]);
        let (near, far) = if beyond < 0.0 {
            (low, high)
        } else {
            (high, low)
        };
        self.search_within(near.0, near.1, x, best);
        if beyond * beyond < best.square {
            offer(&entries[middle], best);
            self.search_within(far.0, far.1, x, best);
        }
    }

    fn search(
        &self,
        from: usize,
        to: usize,
        x: Vec3,
        count: usize,
        without: Option<u32>,
        out: &mut Vec<Neighbor>,
    ) {
        let offer = |entry: &IndexedPoint, out: &mut Vec<Neighbor>| {
            let square = entry.x.distance_squared(x);
            if Some(entry.index) == without
                || (out.len() == count && square >= out[count - 1].square)
            {
                return;
            }
            let index = out.partition_point(|n| n.square <= square);
            out.truncate(count - 1);
            out.insert(
                index,
                Neighbor {
                    index: entry.index,
                    square,
                },
            );
        };
        if to - from <= LEAF {
            for entry in &self.entries[from..to] {
                offer(entry, out);
            }
            return;
        }
        let middle = from + (to - from) / 2;
        let pivot = &self.entries[middle];
        let axis = usize::from(self.axes[middle]);
        let beyond = x[axis] - pivot.x[axis];
        let (near, far) = if beyond < 0.0 {
            ((from, middle), (middle + 1, to))
        } else {
            ((middle + 1, to), (from, middle))
        };
        self.search(near.0, near.1, x, count, without, out);
        offer(pivot, out);
        if out.len() < count || beyond * beyond < out[count - 1].square {
            self.search(far.0, far.1, x, count, without, out);
        }
    }
}

fn split(entries: &mut [IndexedPoint], axes: &mut [u8]) {
    if entries.len() <= LEAF {
        return;
    }
    let (low, high) = entries
        .iter()
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), e| {
            (low.min(e.x), high.max(e.x))
        });
    let axis = (high - low).max_position();
    let middle = entries.len() / 2;
    entries.select_nth_unstable_by(middle, |a, b| {
        a.x[axis].total_cmp(&b.x[axis]).then(a.index.cmp(&b.index))
    });
    axes[middle] = axis as u8;
    let (left, right) = entries.split_at_mut(middle);
    let (left_axes, right_axes) = axes.split_at_mut(middle);
    let (right, right_axes) = (&mut right[1..], &mut right_axes[1..]);
    if left.len() > PARALLEL {
        rayon::join(|| split(left, left_axes), || split(right, right_axes));
    } else {
        split(left, left_axes);
        split(right, right_axes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Random;

    #[test]
    fn nearest_points_match_brute_force() {
        let random = |n: u64, snap: f32| -> Vec<Vec3> {
            (0..n)
                .map(|i| {
                    let mut r = Random::new(3, n, i);
                    let x = Vec3::new(r.unit(), r.unit() * r.unit(), r.unit() * 0.01);
                    (x * snap).round() / snap
                })
                .collect()
        };
        for (count, snap) in [
            (1, 1e6),
            (2, 1e6),
            (9, 1e6),
            (500, 1e6),
            (3000, 8.0),
            (300, 1.0),
        ] {
            let points = random(count, snap);
            let tree = PointTree::new(&points);
            let mut found = Vec::new();
            for (i, x) in points.iter().enumerate().step_by(7) {
                for k in [0, 1, 5, 24] {
                    tree.nearest(*x, k, Some(i as u32), &mut found);
                    let mut all: Vec<f32> = (0..points.len())
                        .filter(|j| *j != i)
                        .map(|j| points[j].distance_squared(*x))
                        .collect();
                    all.sort_by(f32::total_cmp);
                    all.truncate(k);
                    assert!(
                        found.iter().map(|n| n.square).eq(all),
                        "{count} points, {k} of {i}"
                    );
                    let mut seen: Vec<u32> = found.iter().map(|n| n.index).collect();
                    seen.sort_unstable();
                    seen.dedup();
                    assert!(seen.len() == found.len() && !seen.contains(&(i as u32)));
                }
                let position = *x + Vec3::new(0.03, -0.01, 0.02);
                tree.nearest(position, 1, None, &mut found);
                let nearest = found[0].square;
                for (limit, some) in [
                    (f32::INFINITY, true),
                    (1.01 * nearest, true),
                    (nearest, false),
                ] {
                    let within = tree.nearest_within(position, limit).map(|n| n.square);
                    assert_eq!(within, some.then_some(nearest), "{count} points, from {i}");
                }
            }
        }
    }
}
