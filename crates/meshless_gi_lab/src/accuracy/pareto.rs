//! Pareto front of many measurements, and interpolation along a front.

/// Returns the indices of the points on the Pareto front, ordered by the first coordinate. Less is
/// better. On the front, no other point is at least as good in both coordinates and better in one.
/// The first of equal points is taken, and points that are not finite are ignored.
#[must_use]
pub fn pareto_front(positions: &[(f64, f64)]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..positions.len())
        .filter(|&i| positions[i].0.is_finite() && positions[i].1.is_finite())
        .collect();
    // Ordered by cost, then by error. Equal points keep their order.
    order.sort_by(|&a, &b| {
        let (a, b) = (positions[a], positions[b]);
        a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1))
    });
    let mut best = f64::INFINITY;
    order.retain(|&i| {
        let better = positions[i].1 < best;
        best = best.min(positions[i].1);
        better
    });
    order
}

/// Returns the value at `x` of a falling curve through `front`, with straight lines between the
/// logarithms. `front` is ordered by x, and its coordinates are above 0. Returns `None` outside of
/// it.
#[must_use]
pub fn interpolate_log(front: &[(f64, f64)], x: f64) -> Option<f64> {
    let (first, last) = (front.first()?, front.last()?);
    if !(x >= first.0 && x <= last.0 && first.0 > 0.0 && front.iter().all(|p| p.1 > 0.0)) {
        return None;
    }
    let after = front.partition_point(|p| p.0 < x).max(1);
    let Some(&(x1, y1)) = front.get(after) else {
        return Some(last.1);
    };
    let (x0, y0) = front[after - 1];
    // Exact at its points, where logarithms would round.
    if x >= x1 {
        return Some(y1);
    }
    if x <= x0 {
        return Some(y0);
    }
    let t = libm::log(x / x0) / libm::log(x1 / x0);
    Some(libm::exp((1.0 - t) * libm::log(y0) + t * libm::log(y1)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pareto_front_contains_undominated_points() {
        let positions = [
            (3.0, 3.0),
            (1.0, 9.0),
            (2.0, 4.0),
            (2.0, 5.0),
            (4.0, 4.0),
            (f64::NAN, 0.0),
            (9.0, 1.0),
            (9.0, 1.0),
            (10.0, 1.0),
            (0.5, f64::INFINITY),
        ];
        assert_eq!(pareto_front(&positions), [1, 2, 0, 6]);
        assert!(pareto_front(&[]).is_empty());
        // Compares with the definition, on many points.
        let many: Vec<(f64, f64)> = (0..200u32)
            .map(|i| (f64::from(i * 7919 % 101), f64::from(i * 104_729 % 97)))
            .collect();
        let front = pareto_front(&many);
        for (i, a) in many.iter().enumerate() {
            let beaten = many
                .iter()
                .enumerate()
                .any(|(j, b)| b.0 <= a.0 && b.1 <= a.1 && (b != a || j < i));
            assert_eq!(front.contains(&i), !beaten, "{i}");
        }
    }

    #[test]
    fn pareto_front_interpolates_between_points() {
        let front = [(1.0, 100.0), (100.0, 1.0), (1000.0, 0.5)];
        let at = |x| interpolate_log(&front, x);
        assert!((at(10.0).unwrap() - 10.0).abs() < 1e-9);
        assert_eq!((at(1.0), at(1000.0)), (Some(100.0), Some(0.5)));
        assert_eq!((at(0.9), at(1001.0), at(f64::NAN)), (None, None, None));
        assert_eq!(interpolate_log(&[], 1.0), None);
        assert_eq!(interpolate_log(&[(2.0, 3.0)], 2.0), Some(3.0));
        assert_eq!(interpolate_log(&[(0.0, 3.0), (1.0, 1.0)], 0.5), None);
    }
}
