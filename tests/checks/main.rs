//! Tests without a device and a window: layouts, rules of the plan, and the package.

mod bounce_count;
mod fmm_rule;
mod package;
mod shader_layout;
