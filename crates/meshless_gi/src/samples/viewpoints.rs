//! Viewpoints for a scene without given ones: positions between surfaces that light can reach.
//!
//! [L08] §2.3 requires one valid viewpoint from the user, so that the inside of solids gets no
//! points. We test positions all over the scene's bounding box and keep those whose rays mostly hit
//! the front of surfaces. Rays from inside a solid hit backs. The winding of a scene can be
//! unreliable: backs then are hit as often as fronts. Its positions are rated by the distance of
//! the hits instead. The viewpoints of a scene that is open all around (a single object) lie
//! outside its box.

use super::{Random, uniform_sphere};
use crate::scene::{Geometry, Ray};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Number of tested positions.
const TESTED_POSITIONS: u64 = 2048;
/// Number of rays per position.
const RAYS: u32 = 32;
/// Largest number of viewpoints.
const MAX_VIEWPOINTS: usize = 64;

/// Visibility from one position.
struct View {
    position: Vec3,
    hits: u32,
    fronts: u32,
    /// Harmonic mean distance of the hits, meters. Small inside thin solids.
    openness: f32,
}

/// Finds viewpoints. Also returns the number of rays cast. The list is empty only if the bounds of
/// the geometry have zero size or are not finite.
#[must_use]
pub fn find_viewpoints(geometry: &dyn Geometry, seed: u64) -> (Vec<Vec3>, u64) {
    let bounds = geometry.bounds();
    let size = bounds.size();
    if !size.is_finite() || size.max_element() <= 0.0 {
        return (Vec::new(), 0);
    }
    let inside = trace_views(geometry, seed, |r| {
        bounds.min + size * Vec3::new(r.unit(), r.unit(), r.unit())
    });
    let mut rays = TESTED_POSITIONS * u64::from(RAYS);
    let seen: u32 = inside.iter().map(|v| v.hits).sum();
    let fronts: u32 = inside.iter().map(|v| v.fronts).sum();
    // Winding is reliable if fronts clearly prevail. With reliable winding, rays from outside
    // solids hit fronts.
    let trusted = f64::from(fronts) > 0.6 * f64::from(seen);
    let enclosed = RAYS / 4;
    let mut kept: Vec<&View> = inside
        .iter()
        .filter(|v| v.hits >= enclosed && (!trusted || 10 * v.fronts >= 9 * v.hits))
        .collect();
    kept.sort_by(|a, b| b.openness.total_cmp(&a.openness));
    if !trusted {
        // Without winding: keep the half with the largest distances.
        kept.truncate(kept.len().div_ceil(2));
    }
    let mut out = select_far_apart(kept.iter().map(|v| v.position), MAX_VIEWPOINTS);
    if out.is_empty() {
        // Open all around: take positions on a sphere outside the bounding box.
        let radius = 0.75 * size.length();
        let outside = trace_views(geometry, seed ^ 1, |r| {
            bounds.center() + radius * uniform_sphere(Vec2::new(r.unit(), r.unit()))
        });
        rays += TESTED_POSITIONS * u64::from(RAYS);
        out = select_far_apart(
            outside.iter().filter(|v| v.hits > 0).map(|v| v.position),
            MAX_VIEWPOINTS,
        );
        if out.is_empty() {
            // Random rays miss a thin distant object: take positions on the sphere without a hit.
            out = select_far_apart(outside.iter().map(|v| v.position), MAX_VIEWPOINTS);
        }
    }
    (out, rays)
}

fn trace_views(
    geometry: &dyn Geometry,
    seed: u64,
    position: impl Fn(&mut Random) -> Vec3 + Sync,
) -> Vec<View> {
    (0..TESTED_POSITIONS)
        .into_par_iter()
        .map(|k| {
            let mut random = Random::new(seed, 0x76_69_65_77, k);
            let position = position(&mut random);
            let mut view = View {
                position,
                hits: 0,
                fronts: 0,
                openness: 0.0,
            };
            let mut inverse = 0.0;
            for _ in 0..RAYS {
                let ray = Ray::new(
                    position,
                    uniform_sphere(Vec2::new(random.unit(), random.unit())),
                );
                if let Some(hit) = geometry.cast(&ray) {
                    view.hits += 1;
                    view.fronts += u32::from(geometry.surface(&ray, &hit).front);
                    inverse += 1.0 / hit.t.max(f32::MIN_POSITIVE);
                }
            }
            view.openness = if inverse > 0.0 {
                view.hits as f32 / inverse
            } else {
                0.0
            };
            view
        })
        .collect()
}

/// Selects at most `count` of the positions, each as far as possible from the previous ones
/// (farthest point first).
fn select_far_apart(positions: impl Iterator<Item = Vec3>, count: usize) -> Vec<Vec3> {
    let mut left: Vec<(Vec3, f32)> = positions.map(|p| (p, f32::INFINITY)).collect();
    let mut out: Vec<Vec3> = Vec::new();
    while out.len() < count && !left.is_empty() {
        let next = if out.is_empty() {
            0
        } else {
            let mut best = 0;
            for (i, p) in left.iter().enumerate() {
                if p.1 > left[best].1 {
                    best = i;
                }
            }
            best
        };
        let position = left.swap_remove(next).0;
        for p in &mut left {
            p.1 = p.1.min(p.0.distance_squared(position));
        }
        out.push(position);
    }
    out
}
