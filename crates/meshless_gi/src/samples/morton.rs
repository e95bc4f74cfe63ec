//! Order along Morton's curve through the scene's bounding box: points that are close in space are
//! close in memory. Consecutive receivers then cast rays through the same part of the tree and hit
//! the same senders, in the bake and on the GPU.

use super::Candidate;
use crate::scene::Bounds;
use glam::Vec3;

/// Largest integer coordinate along each axis.
const MAX_COORDINATE: f32 = 2_097_151.0;

/// Computes the position of `x` on Morton's curve through `bounds`.
#[must_use]
pub fn morton(x: Vec3, bounds: &Bounds) -> u64 {
    let size = bounds.size().max(Vec3::splat(f32::MIN_POSITIVE));
    let at = ((x - bounds.min) / size).clamp(Vec3::ZERO, Vec3::ONE) * MAX_COORDINATE;
    let interleave_zeros = |v: f32| {
        let mut v = v as u64;
        v = (v | v << 32) & 0x001f_0000_0000_ffff;
        v = (v | v << 16) & 0x001f_0000_ff00_00ff;
        v = (v | v << 8) & 0x100f_00f0_0f00_f00f;
        v = (v | v << 4) & 0x10c3_0c30_c30c_30c3;
        (v | v << 2) & 0x1249_2492_4924_9249
    };
    interleave_zeros(at.x) | interleave_zeros(at.y) << 1 | interleave_zeros(at.z) << 2
}

/// Sorts candidates in Morton order. The sort is stable.
pub fn order(candidates: &mut [Candidate], bounds: &Bounds) {
    candidates.sort_by_cached_key(|c| morton(c.surface.position, bounds));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn morton_order_visits_octants_consecutively() {
        let bounds = Bounds {
            min: Vec3::splat(-1.0),
            max: Vec3::ONE,
        };
        // 512 cells of the box in Morton order. Each run of eight fills a cube of two by two by two
        // cells. Each run of 64 fills a cube of four by four by four.
        let mut cells: Vec<Vec3> = (0..512)
            .map(|i| Vec3::new((i % 8) as f32, (i / 8 % 8) as f32, (i / 64) as f32))
            .collect();
        cells.sort_by_key(|c| morton((c + 0.5) / 4.0 - 1.0, &bounds));
        for (run, edge) in [(8, 2.0), (64, 4.0)] {
            for cells in cells.chunks(run) {
                let low = cells.iter().copied().reduce(Vec3::min).unwrap();
                let high = cells.iter().copied().reduce(Vec3::max).unwrap();
                assert_eq!(high - low, Vec3::splat(edge - 1.0));
            }
        }
        // Positions outside the box and a flat box do not panic.
        assert_eq!(
            morton(Vec3::splat(9.0), &bounds),
            morton(Vec3::ONE, &bounds)
        );
        let flat = Bounds {
            min: Vec3::ZERO,
            max: Vec3::X,
        };
        assert!(morton(Vec3::X, &flat) > morton(Vec3::ZERO, &flat));
    }
}
