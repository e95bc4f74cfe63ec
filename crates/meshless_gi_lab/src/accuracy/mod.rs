//! Metrics of design and documents, the closed forms that the reference integrator is tested against, a test
//! whether two noisy estimates agree, ground truth from files, alternative bases, a renderer for pictures on
//! the CPU, and charts.

mod agreement;
mod alternative_bases;
mod basis_comparison;
mod chart;
pub mod closed_form;
mod dense;
mod drawn;
mod flip;
mod metrics;
mod pareto;
mod penumbra;
mod point_set;
mod render;
mod sphere_over_disk;
mod truth;

pub use agreement::{Estimates, TestStatistics, agreement};
pub use alternative_bases::{
    GaussianBasis, MultilevelBasis, PointBasis, PointBasisError, PointSample, ShepardBasis,
    SurfaceField, check_samples, site_distance,
};
pub use basis_comparison::{
    ComparisonRow, Quantity, SurfaceErrors, compare_bases, exact_samples, solve_in,
};
pub use chart::{Axis, Chart, Format, Mark, Scale, Series, Style};
pub use drawn::RaycastView;
pub use flip::{flip, flip_map};
pub use metrics::{Errors, errors, leak_ratio};
pub use pareto::{interpolate_log, pareto_front};
pub use penumbra::{
    PENUMBRA, PenumbraSample, deficits_by_rays, shadow_errors, shadow_places, shadowed_irradiance,
};
pub use point_set::{Basis, PointSet};
pub use render::{Camera, Image, render};
pub use sphere_over_disk::{Site, Solution, SphereOverDisk, SphereOverDiskError};
pub use truth::{BOUNCES, Comparison, GroundTruth, GroundTruthError};
