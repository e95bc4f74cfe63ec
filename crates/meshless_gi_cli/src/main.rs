//! Command-line tool `meshless_gi`: bakes scenes, and evaluates, exports, inspects and validates
//! bakes. Needs no GPU.
//!
//! Exit codes: 0 done, 1 the input is not valid (standard error names the file and the error), 2
//! wrong usage, 3 could not read or write. Results go to standard output. Progress goes to standard
//! error if that is a terminal.

mod animation;
mod bake;
mod bake_options;
mod demo;
mod demo_frame;
mod error;
mod eval;
mod export;
mod field_help;
mod illuminate;
mod input;
mod inspect;
mod output;
mod picture;
mod points;
mod progress;
mod ray_baseline;
mod report;
mod scatter;
mod source;
mod validate;

use clap::{Parser, Subcommand};
use error::ToolError;
use std::io::Write;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;

/// Bakes indirect light, and evaluates and inspects bakes.
#[derive(Parser)]
#[command(
    name = "meshless_gi",
    version,
    after_help = "Exit codes: 0 done, 1 the input is not valid, 2 wrong usage, 3 could not read or write."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Maximum size of an input: a scene with all files that it names, or a bake on disk and in
    /// memory. Default 8GiB for scenes, 4GiB for bakes.
    #[arg(long, global = true, value_name = "BYTES", allow_hyphen_values = true, value_parser = input::size)]
    max_input: Option<u64>,
}

#[derive(Subcommand)]
enum Command {
    /// Bake a scene: triangles (.glb, .gltf), points (.ply), or a recipe (.gi.ron) that names one.
    Bake(Box<bake::Args>),
    /// Compute direct and indirect irradiance at given points, as a frame does.
    Eval(eval::Args),
    /// Write the light of fixed lights as an irradiance volume that Bevy reads without the plugin.
    Export(export::Args),
    /// Write the light at every point of a bake or of a point cloud as a colored point cloud.
    Illuminate(illuminate::Args),
    /// Bake the built-in Cornell box and draw it with direct light, with indirect light and by the
    /// reference integrator. Needs no file and no GPU.
    Demo(demo::Args),
    /// Measure error against time and bytes: bake a scene by many recipes and recommend one.
    Report(report::Args),
    /// Scatter points evenly over a scene and write them as a point cloud (.ply).
    Scatter(scatter::Args),
    /// Print the content of a bake.
    Inspect(inspect::Args),
    /// Check a bake, and whether it is up to date. Exit code 0, or 1 with a list of problems.
    Validate(validate::Args),
}

fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(message) => {
            // Help and version arrive here too. A closed pipe is not an error.
            let _ = message.print();
            let usage = message.use_stderr();
            return ExitCode::from(if usage { error::USAGE } else { 0 });
        }
    };
    input::set_limit(cli.max_input);
    let run = || match cli.command {
        Command::Bake(args) => bake::run(&args),
        Command::Demo(args) => demo::run(&args),
        Command::Eval(args) => eval::run(&args),
        Command::Export(args) => export::run(&args),
        Command::Illuminate(args) => illuminate::run(&args),
        Command::Inspect(args) => inspect::run(&args),
        Command::Report(args) => report::run(&args),
        Command::Scatter(args) => scatter::run(&args),
        Command::Validate(args) => validate::run(&args),
    };
    let error = match catch_unwind(AssertUnwindSafe(run)) {
        Ok(Ok(())) => return ExitCode::SUCCESS,
        Ok(Err(error)) => error,
        // The panic's message is on standard error already.
        Err(_) => ToolError::Input("defect of meshless_gi; please report it".into()),
    };
    // Standard error may be closed.
    let _ = writeln!(std::io::stderr(), "error: {error}");
    ExitCode::from(error.code())
}
