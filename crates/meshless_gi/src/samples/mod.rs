//! Sample points: surface points that light can reach, spread as Poisson disks, and lookup of
//! points near a position.

mod direction;
mod distance;
mod grid;
mod layer;
mod light_sample;
mod morton;
mod openness;
mod particles;
mod point;
mod poisson;
mod probe_placement;
mod random;
#[cfg(feature = "point_clouds")]
mod scatter;
mod viewpoints;

pub use direction::{
    cosine_hemisphere, gather_direction, gather_weight, lattice, tangents, uniform_sphere,
};
pub use distance::{F_SQUASH, dist, dist_squared, distance_5d};
pub use grid::{GridSlot, HashedGrid};
pub use layer::{SurfaceLayer, free_height, has_similar_height};
pub use light_sample::LightSample;
pub use morton::{morton, order};
pub use openness::{OPENNESS_RAYS, openness};
pub use particles::{Candidate, TracedParticles, local_candidates, trace_particles};
pub use point::Point;
pub use poisson::{DiskSettings, PoissonSamples, fill_level, thin_out, throw_darts};
pub use probe_placement::{ProbePlacement, ProbePlacementSettings, place_probes};
pub use random::{Random, mix};
#[cfg(feature = "point_clouds")]
pub use scatter::scatter;
pub use viewpoints::find_viewpoints;
