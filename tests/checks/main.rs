//! Tests without a device and a window: shader layouts, bounce counts, transport method `fmm`, and
//! the published package.

mod bounce_count;
mod fmm_rule;
mod package;
mod shader_layout;
