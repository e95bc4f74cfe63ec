//! Visibility with fewer components than were baked. Used to measure the error by the number of
//! components (\[P14\] Fig. 4) from one bake.
//!
//! Principal components are nested: the first k of a hundred are those of a bake with k, with the
//! same clusters. The mean square of the dropped components is added to the squared error, per
//! direction of a cluster. Each point's part of the error follows its own loss.

use super::visibility::{
    Visibility, VisibilityCluster, VisiblePoint, from_short, from_snorm, pack, to_snorm,
};
use super::visibility_bake::weights;

impl Visibility {
    /// Keeps the first `max` components of each cluster and updates the errors.
    #[must_use]
    pub fn truncated(&self, max: u32) -> Self {
        let mut out = Self {
            grid: self.grid,
            points: self.points.clone(),
            ..Self::default()
        };
        let weights = weights(self.grid);
        let dropped = self.dropped(max);
        // Per cluster: the squared error summed over directions, and the squared length of each
        // dropped component. Both are weighted like irradiance.
        let mut lengths: Vec<(f32, Vec<f32>)> = Vec::with_capacity(dropped.len());
        for (cluster, squares) in self.clusters.iter().zip(&dropped) {
            let count = cluster.components.min(max) as usize;
            let scales = &self.scales[cluster.scales as usize..][..cluster.components as usize + 2];
            let words = cluster.words();
            let basis = &self.basis[cluster.basis as usize..][..words * self.grid.len()];
            let (mut own_square, mut long) = (0.0, vec![0.0; squares.len()]);
            let errors: Vec<f32> = (basis.chunks_exact(words).zip(&weights))
                .map(|(of, w)| {
                    let own = scales[1] * from_snorm((of[0] >> 16) as u16);
                    own_square += (w * own) * (w * own);
                    let mut square = own * own;
                    for (j, (s, long)) in squares.iter().zip(&mut long).enumerate() {
                        let at = count + j;
                        let v = from_short(of[1 + at / 4].to_le_bytes()[at % 4]);
                        square += v * v * s;
                        *long += (w * v) * (w * v);
                    }
                    square.sqrt()
                })
                .collect();
            lengths.push((own_square, long));
            let largest = errors.iter().fold(0.0f32, |max, e| max.max(*e));
            for (of, error) in basis.chunks_exact(words).zip(errors) {
                let share = if largest > 0.0 { error / largest } else { 0.0 };
                out.basis.extend(pack(&[of[0] as u16, to_snorm(share)]));
                for first in (0..count).step_by(4) {
                    let mut four = of[1 + first / 4].to_le_bytes();
                    four[(count - first).min(4)..].fill(0);
                    out.basis.push(u32::from_le_bytes(four));
                }
            }
            out.scales.extend([scales[0], largest]);
            out.scales.extend(&scales[2..2 + count]);
            out.clusters.push(VisibilityCluster {
                components: count as u32,
                ..*cluster
            });
        }
        // Order of `layout`: by cluster, then by index of the point.
        let mut order: Vec<usize> = (0..self.points.len()).collect();
        order.sort_by_key(|&i| self.points[i].cluster);
        let mut kept = Vec::new();
        let mut decoded = [0.0; Self::MAX_COMPONENTS as usize + 2];
        for i in order {
            let point = &mut out.points[i];
            let (own, long) = &lengths[point.cluster as usize];
            let count = self.decode(i, &mut decoded);
            let lost = |values: &mut dyn Iterator<Item = f32>| -> f32 {
                values.zip(long).map(|(v, long)| v * long).sum()
            };
            let mean = lost(&mut dropped[point.cluster as usize].iter().copied());
            let values = decoded[..count].iter().skip(2 + max as usize);
            let square = lost(&mut values.map(|v| v * v));
            let part = point.error as f32 / VisiblePoint::ONE as f32;
            if !long.is_empty() {
                point.error = VisiblePoint::error_of(part * part * own + square, own + mean);
            }
            for (w, mask) in point.mask.iter_mut().enumerate() {
                let below = max.saturating_sub(32 * w as u32).min(32);
                *mask &= ((1u64 << below) - 1) as u32;
            }
            // Keeps the first of the point's coefficients.
            kept.extend((0..point.count()).map(|k| self.coefficient(point.first + k)));
        }
        out.coefficients = pack(&kept).collect();
        // Cannot fail, since no array is longer than before.
        let _ = out.layout();
        out
    }

    /// Computes the mean square of each dropped component's scaled coefficients, per cluster. The
    /// components from `max` on are dropped.
    fn dropped(&self, max: u32) -> Vec<Vec<f32>> {
        let mut sums: Vec<Vec<f32>> = (self.clusters.iter())
            .map(|c| vec![0.0; c.components.saturating_sub(max) as usize])
            .collect();
        let mut points = vec![0.0f32; self.clusters.len()];
        let mut decoded = [0.0; Self::MAX_COMPONENTS as usize + 2];
        for (i, point) in self.points.iter().enumerate() {
            let cluster = point.cluster as usize;
            let count = self.decode(i, &mut decoded);
            points[cluster] += 1.0;
            let values = decoded[..count].iter().skip(2 + max as usize);
            (sums[cluster].iter_mut().zip(values)).for_each(|(sum, v)| *sum += v * v);
        }
        for (sums, points) in sums.iter_mut().zip(points) {
            sums.iter_mut().for_each(|sum| *sum /= points.max(1.0));
        }
        sums
    }
}
