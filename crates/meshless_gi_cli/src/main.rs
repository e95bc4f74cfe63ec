//! The tool: bakes levels, reports what accuracy costs, evaluates, exports, inspects and validates
//! bakes, and shows what it is about without a file and without a GPU.
//!
//! Exit codes: 0 done; 1 the input is not valid (what and where is on standard error); 2 wrong
//! usage; 3 could not read or write. Standard output carries results only; work that takes longer
//! shows its progress on standard error where that is a terminal.

mod bake;
mod demo;
mod error;
mod eval;
mod export;
mod illuminate;
mod input;
mod inspect;
mod output;
mod picture;
mod points;
mod progress;
mod report;
mod scatter;
mod validate;

use clap::{Parser, Subcommand};
use error::ToolError;
use std::io::Write;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;

/// Bakes indirect light and looks into bakes.
#[derive(Parser)]
#[command(
    name = "meshless_gi",
    version,
    after_help = "Exit codes: 0 done, 1 the input is not valid, 2 wrong usage, 3 could not read or write."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Largest input, a file and all files that it names [8GiB; 4GiB for a bake, in memory too].
    #[arg(long, global = true, value_name = "BYTES", allow_hyphen_values = true, value_parser = input::size)]
    max_input: Option<u64>,
}

#[derive(Subcommand)]
enum Command {
    /// Bake a level: triangles (.glb, .gltf), points (.ply), or a recipe (.gi.ron) that names one.
    Bake(bake::Args),
    /// Direct and indirect irradiance at given points, by the way that a frame takes.
    Eval(eval::Args),
    /// Light for fixed lights in a file that Bevy reads without this crate.
    Export(export::Args),
    /// The light at every point of a bake or of a cloud, as a point cloud with the light as color.
    Illuminate(illuminate::Args),
    /// Bake the built-in Cornell box and show it with and without indirect light, beside the
    /// reference. Needs no file and no GPU.
    Demo(demo::Args),
    /// What accuracy costs in time: bakes a level by many recipes and says what to choose.
    Report(report::Args),
    /// Points spread evenly over a level, as a point cloud (.ply).
    Scatter(scatter::Args),
    /// What is in a bake.
    Inspect(inspect::Args),
    /// Whether a bake is whole: exit code 0, or 1 with the list of what is wrong.
    Validate(validate::Args),
}

fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(why) => {
            // Help and the version come this way too. Whoever closed the pipe does not want to read
            // them.
            let _ = why.print();
            return ExitCode::from(if why.use_stderr() { error::USAGE } else { 0 });
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
    let failed = match catch_unwind(AssertUnwindSafe(run)) {
        Ok(Ok(())) => return ExitCode::SUCCESS,
        Ok(Err(failed)) => failed,
        // The panic has told its place already.
        Err(_) => ToolError::Input("this is a defect of meshless_gi; please report it".into()),
    };
    // Without a standard error there is nobody to tell.
    let _ = writeln!(std::io::stderr(), "error: {failed}");
    ExitCode::from(failed.code())
}
