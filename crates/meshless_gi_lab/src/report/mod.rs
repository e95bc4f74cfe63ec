//! Cost of accuracy in time: one scene is baked by many recipes, all bakes are compared with one
//! reference, and a recommendation is derived.
//!
//! [`sweep`] computes the reference once. It then bakes a baseline and its variants, one factor at
//! a time. It measures each: seconds of the bake, milliseconds of a frame on the CPU, bytes, links,
//! errors. [`figures`] draws errors against each cost with their Pareto fronts. `markdown` writes
//! the recommended choices. A row has its own settings and measurements and does not refer to other
//! rows. The variants of a sweep are listed in `variant.rs`.

mod charts;
mod document;
mod format;
mod markdown;
mod measure;
mod octree;
mod rules;
mod sentences;
mod sweep;
mod tables;
mod test_set;
mod variant;

pub use charts::{Figure, figures};
pub use document::{SceneSection, document};
pub use markdown::{choice, pca_comparison, section, text};
pub use measure::{ExternalComparison, Row, RowSettings};
pub use octree::fmm_comparison;
pub use rules::{MethodComparison, Ratio, compare};
pub use sentences::split_sentences;
pub use sweep::{ExternalReference, Report, ReportError, Step, Sweep, VariantFn, sweep};
pub use test_set::{TestScore, TestSet, TestSetSize};
pub use variant::{BOUNCES, Factor, Run, Variant, baseline, full, quick};
