//! Measurements of [`meshless_gi`]: metrics, ground truth, alternative bases, renderings and
//! charts. The tool's commands `report` and `demo` and the repository's tests use it. Games do not
//! need it.
//!
//! | module | content |
//! |---|---|
//! | [`accuracy`] | metrics, closed forms, ground truth, alternative bases, a renderer, charts |
//! | [`fixtures`] | scenes that tests and generators of documents share |
//! | [`pictures`] | indirect light in views of scenes, of bakes and of the path tracer |
//! | [`report`] | sweeps over recipes, Pareto fronts, charts and a text |
#![warn(missing_docs)]
#![cfg_attr(not(test), warn(clippy::too_many_lines))]

pub mod accuracy;
pub mod fixtures;
pub mod pictures;
pub mod report;
