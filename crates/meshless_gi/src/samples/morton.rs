//! An order in which what is near in space is near in memory: Morton's curve through the scene's
//! box. Receivers that follow each other then cast rays through the same part of the tree and meet
//! the same senders, in the bake and on the GPU.

use super::Candidate;
use crate::scene::Bounds;
use glam::Vec3;

/// Steps along each axis.
const STEPS: f32 = 2_097_151.0;

/// The position of `x` on Morton's curve through `bounds`.
#[must_use]
pub fn morton(x: Vec3, bounds: &Bounds) -> u64 {
    let size = bounds.size().max(Vec3::splat(f32::MIN_POSITIVE));
    let at = ((x - bounds.min) / size).clamp(Vec3::ZERO, Vec3::ONE) * STEPS;
    let spread = |v: f32| {
        let mut v = v as u64;
        v = (v | v << 32) & 0x001f_0000_0000_ffff;
        v = (v | v << 16) & 0x001f_0000_ff00_00ff;
        v = (v | v << 8) & 0x100f_00f0_0f00_f00f;
        v = (v | v << 4) & 0x10c3_0c30_c30c_30c3;
        (v | v << 2) & 0x1249_2492_4924_9249
    };
    spread(at.x) | spread(at.y) << 1 | spread(at.z) << 2
}

/// Puts candidates in that order; equal positions keep theirs.
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
        // 512 cells of the box in the curve's order: each run of eight fills a cube of two by two
        // by two, and so do the runs of 64.
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
        // Outside of the box and in a flat one: a position, and no panic.
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
