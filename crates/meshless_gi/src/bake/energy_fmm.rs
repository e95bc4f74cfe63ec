//! Energy checks of the octree of method `fmm`, see [`energy`](super::energy).
//!
//! **Gain.** Expansions have signs, so theorems on non-negative matrices ([Var00] Chapter 2) do not
//! apply. A power iteration finds the largest eigenvalue of a bounce. It is an estimate from below
//! and not a bound. If it is above 0.9995, all albedos are reduced by the same factor, to a gain of
//! 0.999.
//!
//! **Reciprocity** is measured for groups of neighboring senders: uniform light of one group on
//! another, times the area.

use super::energy::{Bounded, Gain, MAX_GAIN, MAX_UNCLAMPED_GAIN, reciprocity_residual};
use super::energy_components::lower;
use super::fmm::Octree;
use super::packing::LinkedPoints;
use crate::asset::PointSurface;
use crate::transport::fmm::Passes;
use crate::transport::fmm::passes::{Field, component_along};

/// Number of steps of the power iteration.
const STEPS: usize = 12;
/// Number of sender groups for the reciprocity residual, three at a time.
const SENDER_GROUPS: usize = 12;

/// Reduces the albedos that the links left, and returns the gain of the octree, combined with that
/// of the links.
pub(super) fn bound_octree(linked: &LinkedPoints, links: Bounded, octree: &Octree) -> Bounded {
    let mut surfaces = links.surfaces;
    let before = match linked.has_links() {
        true => links.gain,
        false => Gain::default(),
    };
    let mut passes = Passes::new(Field::from_operator(&octree.operator));
    let mut found = gain(linked, &surfaces, octree, &mut passes);
    let (mut clamped_senders, mut albedo_scale) =
        (before.clamped_senders, f64::from(before.albedo_scale));
    if found > MAX_UNCLAMPED_GAIN {
        albedo_scale *= MAX_GAIN / found;
        clamped_senders = lower(&mut surfaces[..linked.senders()], MAX_GAIN / found);
        found = gain(linked, &surfaces, octree, &mut passes);
    }
    let reciprocity = reciprocity(linked, octree, &mut passes);
    let gain = Gain {
        estimated: true,
        bound: before.bound.max((found as f32).next_up()),
        estimate: before.estimate.max(found as f32),
        clamped_senders,
        albedo_scale: albedo_scale as f32,
        reciprocity: before.reciprocity.max(reciprocity as f32),
    };
    Bounded { surfaces, gain }
}

/// Computes the irradiance at the senders along their normals, clamped to zero.
fn arriving_sums(
    octree: &Octree,
    passes: &mut Passes<'_, f32>,
    light: &[[f32; 4]],
) -> Vec<[f32; 4]> {
    passes.run(light);
    let mut out = vec![[0.0; 4]; light.len()];
    for node in octree.operator.nodes.iter().filter(|n| n.is_leaf()) {
        for i in node.receiver_range() {
            let point = &octree.operator.points[i];
            if let Some(out) = out.get_mut(point.point as usize) {
                *out = component_along(point.normal, &passes.values[i]).map(|e| point.factor * e);
            }
        }
    }
    out
}

/// Estimates the largest eigenvalue of a bounce by power iteration. Returns the largest of all
/// color channels.
fn gain(
    linked: &LinkedPoints,
    surfaces: &[PointSurface],
    octree: &Octree,
    passes: &mut Passes<'_, f32>,
) -> f64 {
    let finest = linked.finest_senders();
    let mut light = vec![[0.0f32; 4]; linked.senders()];
    light[finest.clone()].fill([1.0, 1.0, 1.0, 0.0]);
    let mut found = 0.0;
    for _ in 0..STEPS {
        let e = arriving_sums(octree, passes, &light);
        let (mut before, mut after) = ([0.0f64; 3], [0.0f64; 3]);
        for j in finest.clone() {
            for c in 0..3 {
                before[c] += f64::from(light[j][c]).powi(2);
                light[j][c] = surfaces[j].albedo[c] * e[j][c];
                after[c] += f64::from(light[j][c]).powi(2);
            }
        }
        let gains = [0, 1, 2].map(|c| match before[c] > 0.0 {
            true => (after[c] / before[c]).sqrt(),
            false => 0.0,
        });
        found = gains.into_iter().fold(0.0, f64::max);
        // Normalizes each color channel to length one.
        for light in &mut light[finest.clone()] {
            for c in 0..3 {
                if after[c] > 0.0 {
                    light[c] /= after[c].sqrt() as f32;
                }
            }
        }
    }
    found
}

/// Computes the reciprocity residual between groups of senders, relative to the exchanged light.
fn reciprocity(linked: &LinkedPoints, octree: &Octree, passes: &mut Passes<'_, f32>) -> f64 {
    let finest = linked.finest_senders();
    let run = |j: usize| (j - finest.start) * SENDER_GROUPS / finest.len().max(1);
    let mut between = [[0.0f64; SENDER_GROUPS]; SENDER_GROUPS];
    for three in 0..SENDER_GROUPS / 3 {
        let mut light = vec![[0.0f32; 4]; linked.senders()];
        for j in finest.clone().filter(|&j| run(j) / 3 == three) {
            light[j][run(j) % 3] = 1.0;
        }
        let e = arriving_sums(octree, passes, &light);
        for j in finest.clone() {
            for c in 0..3 {
                between[run(j)][3 * three + c] += f64::from(octree.areas[j]) * f64::from(e[j][c]);
            }
        }
    }
    reciprocity_residual(SENDER_GROUPS, |a, b| between[a][b])
}
