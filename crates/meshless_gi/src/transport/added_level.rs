//! Levels that refinement adds where they reduce the error.
//!
//! The residual r_l of a receiver of level l is the error of all coarser levels at its position. An
//! added level reduces the error r_{l+1} of level l between its points. The order of convergence of
//! two levels predicts this error: r_{l+1} = r_l · min(1, r_l / r_{l−1}). Where irradiance is
//! smooth, residuals decrease by a factor of four per level, and r_l overstates the error. At
//! shadow edges and in corners they do not decrease.

use super::gather::GatherSettings;
use super::refine::Receivers;
use crate::basis::{Hierarchy, WeightEntry};
use rayon::prelude::*;

/// Adds a level around the receivers of the finest level with an expected residual above the
/// tolerance. Receivers with the largest expected residual come first. `errors` are the squared
/// residuals of all receivers. `tolerance` is squared as well. Returns the number of points of the
/// new level.
pub(super) fn add_level(
    gathering: &GatherSettings<'_>,
    receivers: &mut Receivers<'_>,
    errors: &[f32],
    tolerance: f32,
    max_points: usize,
) -> usize {
    let l = receivers.hierarchy.levels.len();
    let level = receivers.hierarchy.level(l - 1);
    let expected: Vec<f32> = level
        .clone()
        .zip(local_means(receivers.hierarchy, errors))
        .map(|(i, mean)| {
            let coarser = receivers.parents.row(i);
            mean.map_or(errors[i], |mean| {
                expected_error(mean, mean_error(coarser, 0, errors))
            })
        })
        .collect();
    let expected = |i: usize| expected[i - level.start];
    let mut selected: Vec<usize> = level.clone().filter(|&i| expected(i) > tolerance).collect();
    selected.sort_by(|&a, &b| expected(b).total_cmp(&expected(a)).then(a.cmp(&b)));
    selected.truncate(max_points / 4);
    if selected.is_empty() {
        return 0;
    }
    let added = receivers.hierarchy.add_level(
        gathering.geometry,
        &selected,
        max_points,
        receivers.building,
    );
    if added > 0 {
        receivers
            .hierarchy
            .append_parents(l, false, receivers.parents);
    }
    added
}

/// Computes local means of the squared residuals at the receivers of the finest level. A single
/// squared residual is a product of two noisy sums, so selection of the largest would select noise.
/// An entry is `None` if the receiver has no residual.
fn local_means(hierarchy: &Hierarchy, errors: &[f32]) -> Vec<Option<f32>> {
    let l = hierarchy.levels.len() - 1;
    let level = hierarchy.level(l);
    level
        .clone()
        .into_par_iter()
        .map_init(Vec::new, |found, i| {
            let surface = &hierarchy.surfaces[i];
            hierarchy.levels[l].weights(surface.position, surface.normal, found);
            mean_error(found, level.start, errors).filter(|_| errors[i].is_finite())
        })
        .collect()
}

/// Computes the weighted mean of the finite squared residuals. Indices of `weights` are relative to
/// `first`. Returns `None` if no residual is finite.
fn mean_error(weights: &[WeightEntry], first: usize, errors: &[f32]) -> Option<f32> {
    let (mut sum, mut total) = (0.0, 0.0);
    for w in weights {
        let error = errors[first + w.index as usize];
        if error.is_finite() {
            sum += w.weight * error;
            total += w.weight;
        }
    }
    (total > 0.0).then(|| sum / total)
}

/// Predicts the squared residual of the next level. `own` is the mean at the finest level and
/// `coarser` the mean at its parents. Noise can make both negative.
fn expected_error(own: f32, coarser: Option<f32>) -> f32 {
    match coarser {
        Some(coarser) if coarser > own => own * (own / coarser).max(0.0),
        _ => own,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn expected_residuals_follow_order_of_convergence() {
        // Residuals 0.4 and 0.1 predict 0.025. All values are squared.
        assert!((expected_error(0.01, Some(0.16)) - 0.000_625).abs() < 1e-9);
        // Residuals at an edge do not decrease. A residual above the coarser one is not
        // extrapolated.
        assert_eq!(expected_error(0.01, Some(0.01)), 0.01);
        assert_eq!(expected_error(0.04, Some(0.01)), 0.04);
        // No coarser residual, or noise.
        assert_eq!(expected_error(0.01, None), 0.01);
        assert_eq!(expected_error(0.01, Some(-0.2)), 0.01);
        assert!(expected_error(-0.01, Some(0.2)) <= 0.0);
    }

    #[test]
    fn mean_errors_leave_out_receivers_without_residual() {
        let weights =
            [(0, 0.5), (1, 0.25), (2, 0.25)].map(|(index, weight)| WeightEntry { index, weight });
        let errors = [9.0, 0.2, 0.4, f32::INFINITY];
        let mean = mean_error(&weights, 1, &errors).unwrap();
        assert!(
            (mean - (0.5 * 0.2 + 0.25 * 0.4) / 0.75).abs() < 1e-6,
            "{mean}"
        );
        assert_eq!(mean_error(&weights[2..], 1, &errors), None);
    }
}
