//! Probe placement: positions between surfaces that dynamic objects can reach. They are the centers
//! of the probes' basis.
//!
//! Candidates lie on light paths: importance particles (\[L08\] §2.3) and short paths upwards from
//! the surfaces that they reach. A candidate never lies inside solid geometry. It becomes a probe
//! if no *visible* probe is within the spacing. Both sides of a thin wall then get their own
//! probes, and so do regions around corners. Candidates with the largest clearance come first.

use super::{Random, cosine_hemisphere, lattice, tangents, trace_particles, uniform_sphere};
use crate::scene::{Geometry, Ray};
use glam::{IVec3, Vec2, Vec3};
use rayon::prelude::*;
use std::collections::HashMap;

/// Number of particles per round.
const PATHS: u64 = 2_048;
/// Largest number of rounds.
const MAX_ROUNDS: u64 = 24;
/// Fraction of new probes, relative to all probes, below which the current round is the last.
const MIN_NEW_FRACTION: f64 = 0.004;
/// Number of rays that measure the clearance of a candidate.
const CLEARANCE_RAYS: u32 = 14;
/// Largest number of candidates per round.
const MAX_CANDIDATES: usize = 1 << 15;

/// Settings of the placement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProbePlacementSettings {
    /// Smallest distance of two probes that are visible from each other, meters. Must be above
    /// zero.
    pub spacing: f32,
    /// Largest number of probes.
    pub max: usize,
    /// Seed of the random numbers.
    pub seed: u64,
    /// `true` if particles drop their first bounces.
    pub drop_first: bool,
}

/// Placed probes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ProbePlacement {
    /// Positions of the probes, meters.
    pub probes: Vec<Vec3>,
    /// Other positions between surfaces, meters.
    pub crossed: Vec<Vec3>,
    /// `true` if the limit was reached.
    pub truncated: bool,
    /// Number of rays cast.
    pub rays: u64,
}

/// Places probes in the space of `geometry` that can be reached from `viewpoints`. The result does
/// not depend on the number of threads.
#[must_use]
pub fn place_probes(
    geometry: &dyn Geometry,
    viewpoints: &[Vec3],
    settings: &ProbePlacementSettings,
) -> ProbePlacement {
    let mut out = ProbePlacement::default();
    // Both sides of an occluder get their own probes, because it can be closed.
    let shut = geometry.with_occluders_closed().unwrap_or(geometry);
    let spacing = settings.spacing;
    let mut cells: HashMap<IVec3, Vec<u32>> = HashMap::new();
    let cell = |x: Vec3| (x / spacing).floor().as_ivec3();
    for round in 0..MAX_ROUNDS {
        let (mut candidates, rays) = candidates(geometry, viewpoints, settings, round);
        out.rays += rays;
        candidates.sort_by(|a, b| b.0.total_cmp(&a.0));
        let before = out.probes.len();
        for &(_, x) in &candidates {
            let center = cell(x);
            let near = (0..27).flat_map(|k| {
                let beside = center + IVec3::new(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1);
                cells.get(&beside).into_iter().flatten()
            });
            let mut known = false;
            for &i in near {
                let way = out.probes[i as usize] - x;
                let square = way.length_squared();
                if square >= spacing * spacing {
                    continue;
                }
                let length = square.sqrt();
                out.rays += 1;
                known = length < 1e-3 * spacing || !shut.is_occluded(x, out.probes[i as usize]);
                if known {
                    break;
                }
            }
            if known {
                continue;
            }
            if out.probes.len() >= settings.max {
                out.truncated = true;
                break;
            }
            cells
                .entry(center)
                .or_default()
                .push(out.probes.len() as u32);
            out.probes.push(x);
        }
        out.crossed.extend(candidates.iter().map(|c| c.1));
        let new = out.probes.len() - before;
        if out.truncated
            || candidates.is_empty()
            || (new as f64) < MIN_NEW_FRACTION * out.probes.len() as f64
        {
            break;
        }
    }
    out
}

/// Returns candidates with their clearance, at most half the spacing, meters. Also returns the
/// number of rays cast.
fn candidates(
    geometry: &dyn Geometry,
    viewpoints: &[Vec3],
    settings: &ProbePlacementSettings,
    round: u64,
) -> (Vec<(f32, Vec3)>, u64) {
    let seed = settings.seed ^ 0x6672_6565_0000 ^ round;
    let traced = trace_particles(
        geometry,
        viewpoints,
        round * PATHS..(round + 1) * PATHS,
        seed,
        settings.drop_first,
    );
    let stride = traced.candidates.len().div_ceil(MAX_CANDIDATES / 2).max(1);
    let few: Vec<_> = traced.candidates.iter().step_by(stride).collect();
    let reach = 0.5 * settings.spacing;
    let shut = geometry.with_occluders_closed().unwrap_or(geometry);
    let found: Vec<[(f32, Vec3); 2]> = few
        .par_iter()
        .enumerate()
        .map(|(i, c)| {
            let mut random = Random::new(seed, 0x73_70, i as u64);
            // Random position on the path to the surface.
            let start = 2.0 * c.free - c.surface.position;
            let along = start.lerp(c.surface.position, 0.02 + 0.96 * random.unit());
            // Random position on a short path above the surface, in the region of dynamic objects.
            let (x, n) = (c.surface.position, c.surface.normal);
            let (t, b) = tangents(n);
            let d = cosine_hemisphere(Vec2::new(random.unit(), random.unit()));
            let way = (t * d.x + b * d.y + n * d.z).normalize_or(n);
            let up = Ray::segment(x + n * geometry.ray_offset(x), way, 2.0 * settings.spacing);
            let room = geometry
                .cast(&up)
                .map_or(2.0 * settings.spacing, |hit| hit.t);
            let above = up.at(room * (0.02 + 0.96 * random.unit()));
            [along, above].map(|x| (clearance(shut, x, reach), x))
        })
        .collect();
    let rays = traced.rays + found.len() as u64 * u64::from(1 + 2 * CLEARANCE_RAYS);
    let sound = |c: &(f32, Vec3)| c.1.is_finite() && c.0 > 0.0;
    (found.into_iter().flatten().filter(sound).collect(), rays)
}

/// Estimates the distance to the nearest geometry with a few rays, at most `reach`, meters.
fn clearance(geometry: &dyn Geometry, x: Vec3, reach: f32) -> f32 {
    (0..CLEARANCE_RAYS).fold(reach, |free, k| {
        let way = uniform_sphere(lattice(k, CLEARANCE_RAYS, Vec2::ZERO)).normalize_or(Vec3::Y);
        let ray = Ray::segment(x, way, free);
        geometry.cast(&ray).map_or(free, |hit| hit.t.min(free))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Bounds, Quad, TriangleMesh};

    fn settings(spacing: f32) -> ProbePlacementSettings {
        ProbePlacementSettings {
            spacing,
            max: 1 << 16,
            seed: 3,
            drop_first: true,
        }
    }

    #[test]
    fn probe_placement_covers_only_open_positions() {
        let mesh = TriangleMesh::from_quads(&Quad::cornell_box());
        let eye = [Vec3::new(0.0, 1.0, 0.9)];
        let found = place_probes(&mesh, &eye, &settings(0.25));
        assert!(!found.truncated);
        // The box is open on one side: positions up to 0.5 m outside of it count.
        let Bounds { min, max } = mesh.bounds();
        let inside = |x: Vec3| {
            let within = |m: f32| (min - m).cmple(x).all() && x.cmple(max + m).all();
            within(0.0) || x.z > max.z && within(0.5)
        };
        assert!(found.probes.iter().all(|&x| inside(x)));
        for (i, &a) in found.probes.iter().enumerate() {
            for &b in &found.probes[..i] {
                assert!(a.distance(b) >= 0.25 || mesh.is_occluded(a, b), "{a} {b}");
            }
        }
        // Every lit position has a visible probe within the spacing plus a margin.
        let eight = |k: i32| Vec3::new((k % 2) as f32, (k / 2 % 2) as f32, (k / 4) as f32);
        let far = (0..8).filter(|&k| {
            let x = Vec3::new(-0.95, 0.05, -0.95) + eight(k) * 1.9;
            let seen = |&p: &Vec3| p.distance(x) < 0.33 && !mesh.is_occluded(x, p);
            !found.probes.iter().any(seen)
        });
        assert_eq!(far.count(), 0);
        assert_eq!(found, place_probes(&mesh, &eye, &settings(0.25)));
        // Half the spacing gives about eight times as many probes.
        let twice = place_probes(&mesh, &eye, &settings(0.125)).probes.len();
        let ratio = twice as f64 / found.probes.len() as f64;
        assert!((4.0..12.0).contains(&ratio), "{ratio}");
        let few = ProbePlacementSettings {
            max: 5,
            ..settings(0.25)
        };
        let few = place_probes(&mesh, &eye, &few);
        assert!(few.truncated && few.probes.len() == 5);
        assert!(place_probes(&mesh, &[], &settings(0.25)).probes.is_empty());
    }
}
