//! How wrong it is: a reference integrator that shares nothing with the baked path but the geometry, the closed forms that it is tested against, the
//! metrics of design and docs, a test whether two noisy estimates agree, a baked scene evaluated at single places, a renderer for pictures on the
//! CPU, and charts of all that.

mod agreement;
mod basis_comparison;
mod chart;
pub mod closed_form;
mod direct;
mod drawn;
mod evaluate;
mod flip;
mod lamps;
mod metrics;
mod pareto;
mod penumbra;
mod point_set;
mod reference;
mod render;
mod sphere_over_disk;
mod truth;

pub use agreement::{Agreement, Estimates, agreement};
pub use basis_comparison::{
    ComparisonRow, Quantity, SurfaceErrors, compare_bases, exact_samples, solve_in,
};
pub use chart::{Axis, Chart, Format, Mark, Scale, Series, Style};
pub use direct::GlowLight;
pub use drawn::DrawnView;
pub use evaluate::{Bounces, Evaluated, Evaluator};
pub(crate) use evaluate::{PATCHES, solve};
pub use flip::{flip, flip_map};
pub use lamps::{Lit, RAYS_A_PLACE, roomy_places};
pub use metrics::{Errors, errors, leak_ratio};
pub use pareto::{interpolate_log, pareto_front};
pub use penumbra::{
    PENUMBRA, ShadowPlace, deficits_by_rays, shadow_errors, shadow_places, shadowed_irradiance,
};
pub use point_set::{Basis, PointSet};
pub use reference::{
    Irradiance, ReferenceSettings, direct_irradiance, irradiance, irradiance_at_all,
};
pub use render::{Camera, Image, render};
pub use sphere_over_disk::{Site, Solution, SphereOverDisk, SphereOverDiskError};
pub use truth::{BOUNCES, Comparison, Truth, TruthError};
