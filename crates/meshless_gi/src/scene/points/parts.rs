//! Splits a cloud into spatially compact parts of bounded size, so that a renderer or an upload can
//! process a cloud in steps.

use glam::Vec3;

/// Splits points into parts of at most `max` indices. A range above this size is halved across the
/// longest side of its box. No part is empty and every index occurs once. The indices of a part
/// ascend.
pub(super) fn parts(points: &[Vec3], max: usize) -> Vec<Vec<u32>> {
    let max = max.max(1);
    let mut whole: Vec<u32> = (0..points.len() as u32).collect();
    let mut parts = Vec::new();
    divide(points, &mut whole, max, &mut parts);
    parts
}

fn divide(points: &[Vec3], part: &mut [u32], max: usize, parts: &mut Vec<Vec<u32>>) {
    if part.is_empty() {
        return;
    }
    if part.len() <= max {
        part.sort_unstable();
        parts.push(part.to_vec());
        return;
    }
    let of = |i: &u32| points[*i as usize];
    let (low, high) = part
        .iter()
        .map(of)
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), x| {
            (low.min(x), high.max(x))
        });
    let axis = (high - low).max_position();
    let middle = part.len() / 2;
    // Equal positions are ordered by index, so that the result is deterministic.
    part.select_nth_unstable_by(middle, |a, b| {
        of(a)[axis].total_cmp(&of(b)[axis]).then(a.cmp(b))
    });
    let (first, second) = part.split_at_mut(middle);
    divide(points, first, max, parts);
    divide(points, second, max, parts);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn point_cloud_parts_have_bounded_size() {
        let points: Vec<Vec3> = (0..1000u32)
            .map(|i| Vec3::new((i * 7 % 1000) as f32, (i % 3) as f32, 0.0))
            .collect();
        let found = parts(&points, 300);
        assert_eq!(found.len(), 4);
        let mut all: Vec<u32> = found.concat();
        all.sort_unstable();
        assert!(all.into_iter().eq(0..1000), "each once");
        let span = |part: &Vec<u32>| {
            let x = || part.iter().map(|i| points[*i as usize].x);
            [x().fold(f32::MAX, f32::min), x().fold(f32::MIN, f32::max)]
        };
        for pair in found.windows(2) {
            assert!(span(&pair[0])[1] < span(&pair[1])[0], "cut along x");
        }
        assert!(found.iter().all(|p| p.is_sorted() && p.len() <= 300));
        assert_eq!(parts(&points, 1000).len(), 1);
        // Points at one position, and no points.
        assert_eq!(parts(&[Vec3::ONE; 5], 1).len(), 5);
        assert!(parts(&[], 3).is_empty());
    }
}
