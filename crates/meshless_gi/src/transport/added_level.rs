//! Levels that refinement adds around receivers with a large residual.

use super::gather::GatherSettings;
use super::refine::Receivers;
use rayon::prelude::*;

/// Adds a level around the receivers of the finest level whose error is above `tolerance`, largest
/// errors first. Returns its number of points.
pub(super) fn add_level(
    gathering: &GatherSettings<'_>,
    receivers: &mut Receivers<'_>,
    errors: &[f32],
    tolerance: f32,
    max_points: usize,
) -> usize {
    let l = receivers.hierarchy.levels.len();
    let hierarchy = &*receivers.hierarchy;
    let level = hierarchy.level(l - 1);
    // A single error is a product of two noisy sums. Selecting the largest would select noise, so
    // each error is replaced by its local mean.
    let means: Vec<f32> = level
        .clone()
        .into_par_iter()
        .map_init(Vec::new, |found, i| {
            let s = &hierarchy.surfaces[i];
            hierarchy.levels[l - 1].weights(s.position, s.normal, found);
            let (mut sum, mut weights) = (0.0, 0.0);
            for w in found.iter() {
                let error = errors[level.start + w.index as usize];
                if error.is_finite() {
                    sum += w.weight * error;
                    weights += w.weight;
                }
            }
            if errors[i].is_finite() && weights > 0.0 {
                sum / weights
            } else {
                errors[i]
            }
        })
        .collect();
    let mean = |i: usize| means[i - level.start];
    let mut selected: Vec<usize> = level.clone().filter(|&i| mean(i) > tolerance).collect();
    selected.sort_by(|&a, &b| mean(b).total_cmp(&mean(a)).then(a.cmp(&b)));
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
