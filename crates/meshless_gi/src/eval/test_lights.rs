//! Light positions for error measurements: positions with clearance that no bake used. The error
//! estimate of a bake and the test set of a report sample them in the same way. Both thus measure
//! the same quantity.

use crate::samples::{Candidate, Random, lattice, uniform_sphere};
use crate::scene::{Bounds, Geometry, Hit, Ray, Surface};
use glam::{Vec2, Vec3};

/// Number of directions in which clearance is measured.
const CLEARANCE_RAYS: u32 = 96;

/// Number of rays that [`sample_open_positions`] casts per candidate.
pub const RAYS_PER_POSITION: u64 = CLEARANCE_RAYS as u64;

/// Returns `count` light positions. Each is the one with the largest clearance of
/// `candidates_per_light` random candidates. A light that almost touches a wall is not
/// representative, and its reference is noisy. Returns no positions if there are no candidates.
#[must_use]
pub fn sample_open_positions(
    geometry: &dyn Geometry,
    candidates: &[Candidate],
    count: usize,
    candidates_per_light: usize,
    random: &mut Random,
) -> Vec<Vec3> {
    if candidates.is_empty() {
        return Vec::new();
    }
    let size = geometry.bounds().size().max_element();
    let clearance = |p: Vec3| {
        (0..CLEARANCE_RAYS)
            .filter_map(|k| {
                let direction = uniform_sphere(lattice(k, CLEARANCE_RAYS, Vec2::splat(0.5)));
                geometry.cast(&Ray::new(p, direction)).map(|hit| hit.t)
            })
            .fold(size, f32::min)
    };
    (0..count)
        .filter_map(|_| {
            (0..candidates_per_light)
                .map(|_| candidates[random.below(candidates.len())].free)
                .map(|p| (clearance(p), p))
                .max_by(|a, b| a.0.total_cmp(&b.0))
        })
        .map(|best| best.1)
        .collect()
}

/// Geometry without its own emission. Errors are those of light from lights.
pub struct NonEmissive<'a> {
    /// Geometry with its emission.
    pub geometry: &'a dyn Geometry,
}

impl Geometry for NonEmissive<'_> {
    fn bounds(&self) -> Bounds {
        self.geometry.bounds()
    }

    fn cast(&self, ray: &Ray) -> Option<Hit> {
        self.geometry.cast(ray)
    }

    fn is_occluded(&self, from: Vec3, to: Vec3) -> bool {
        self.geometry.is_occluded(from, to)
    }

    fn surface(&self, ray: &Ray, hit: &Hit) -> Surface {
        Surface {
            emission: Vec3::ZERO,
            ..self.geometry.surface(ray, hit)
        }
    }

    fn ray_offset(&self, p: Vec3) -> f32 {
        self.geometry.ray_offset(p)
    }

    fn surface_relief(&self, p: Vec3) -> f32 {
        self.geometry.surface_relief(p)
    }
}
