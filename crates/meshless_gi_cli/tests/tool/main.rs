//! Tests of the command line tool.

mod support;

mod commands;
mod damaged_scenes;
mod export;
mod input_limits;
mod points;
mod report;
mod validate;
