//! Cost of accuracy in time: one scene baked by many recipes, every bake examined against one
//! reference, and what follows for who has to choose.
//!
//! [`sweep`] computes the reference once, then bakes a baseline and its variants, one factor at a
//! time, and measures each: seconds of the bake, milliseconds of a frame on the CPU, bytes, links,
//! errors. [`figures`] draws errors against each cost with their Pareto fronts, `markdown` says
//! what to choose. A row has its settings and its measurements and nothing of other rows: what is
//! swept is the list in `variant.rs`.

mod charts;
mod document;
mod format;
mod markdown;
mod measure;
mod octree;
mod rules;
mod sweep;
mod tables;
mod test_set;
mod variant;

pub use charts::{Figure, figures};
pub use document::{SceneSection, document};
pub use markdown::{beside_bases, choice, section, text};
pub use measure::{Beside, Row, RowSettings};
pub use octree::beside_octree;
pub use rules::{Compared, Ratio, compare};
pub use sweep::{Choose, ExternalReference, Report, ReportError, Step, Sweep, sweep};
pub use test_set::{TestScore, TestSet, TestSetSize};
pub use variant::{BOUNCES, Factor, Run, Variant, baseline, full, quick};
