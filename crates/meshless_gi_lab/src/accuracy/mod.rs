//! Accuracy measurements: metrics, closed forms, ground truth from files, alternative bases, a CPU
//! renderer, and charts. The reference integrator is tested against the closed forms. A statistical
//! test compares two noisy estimates.

mod alternative_bases;
mod basis_comparison;
mod chart;
pub mod closed_form;
mod dense;
mod flip;
mod ground_truth;
mod metrics;
mod pareto;
mod penumbra;
mod point_set;
mod raycast_gbuffer;
mod render;
mod sphere_over_disk;
mod statistical_test;
mod visible_errors;

pub use alternative_bases::{
    GaussianBasis, MultilevelBasis, PointBasis, PointBasisError, PointSample, ShepardBasis,
    SurfaceField, check_samples, site_distance,
};
pub use basis_comparison::{
    ComparisonRow, Quantity, SurfaceErrors, compare_bases, exact_samples, solve_in,
};
pub use chart::{Axis, Chart, Format, Mark, Scale, Series, Style};
pub use flip::{flip, flip_map};
pub use ground_truth::{BOUNCES, Comparison, GroundTruth, GroundTruthError};
pub use metrics::{Errors, errors, leak_ratio};
pub use pareto::{interpolate_log, pareto_front};
pub use penumbra::{
    PENUMBRA, PenumbraSample, occluded_irradiances_by_rays, penumbra_samples, shadow_errors,
    shadowed_irradiance,
};
pub use point_set::{Basis, PointSet};
pub use raycast_gbuffer::RaycastView;
pub use render::{Camera, Image, render};
pub use sphere_over_disk::{Site, Solution, SphereOverDisk, SphereOverDiskError};
pub use statistical_test::{Estimates, TestStatistics, test_equality};
pub use visible_errors::{VisibleErrors, visible_errors};
