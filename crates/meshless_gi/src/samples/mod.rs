//! Where light is known: surface points that light can reach, spread as Poisson disks, and how to find the ones near a place.

mod direction;
mod distance;
mod free_space;
mod grid;
mod morton;
mod openness;
mod particles;
mod place;
mod point;
mod poisson;
mod random;
mod scatter;
mod viewpoints;

pub use direction::{cosine_hemisphere, gather_direction, lattice, tangents, uniform_sphere};
pub use distance::{F_SQUASH, dist, dist_squared, distance_5d};
pub use free_space::{ProbePlacement, ProbePlacementSettings, fill_free_space};
pub use grid::{GridSlot, HashedGrid};
pub use morton::{morton, order};
pub use openness::{OPENNESS_RAYS, openness};
pub use particles::{Candidate, TracedParticles, local_candidates, trace_particles};
pub use place::LightSample;
pub use point::Point;
pub use poisson::{DiskSettings, PoissonSamples, fill_level, thin_out, throw_darts};
pub use random::{Random, mix};
pub use scatter::scatter;
pub use viewpoints::find_viewpoints;
