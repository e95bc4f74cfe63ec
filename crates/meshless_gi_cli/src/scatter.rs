//! `scatter`: points spread evenly over a level, as a `.ply` file.

use super::error::ToolError;
use super::{bake, output, progress};
use meshless_gi::TriangleMesh;
use meshless_gi::internals::asset::{check_writable, write_file};
use meshless_gi::internals::samples::scatter;
use meshless_gi::internals::scene::{PlyEncoding, statue_room, write_ply};
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Args {
    /// The level (.glb, .gltf, .ply, .json); left out: the built-in statue in a Cornell box.
    level: Option<PathBuf>,
    /// Where the points go.
    #[arg(short, long, value_name = "OUT.ply")]
    output: PathBuf,
    /// Points of one surface are at least this far apart, meters.
    #[arg(long, value_name = "S", default_value_t = 0.02, allow_hyphen_values = true, value_parser = spacing)]
    spacing: f32,
    /// Seed of all random numbers.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Write text and no binary numbers.
    #[arg(long)]
    ascii: bool,
}

fn spacing(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(s) if s > 0.0 && f32::is_finite(s) => Ok(s),
        _ => Err("a length above 0 is needed".into()),
    }
}

pub fn run(args: &Args) -> Result<(), ToolError> {
    check_writable(&args.output).map_err(|why| ToolError::write(&args.output, &why))?;
    let level = match &args.level {
        Some(path) => bake::load(path, &[])?,
        None => statue_room(),
    };
    let encoding = match args.ascii {
        true => PlyEncoding::Ascii,
        false => PlyEncoding::LittleEndian,
    };
    let step = progress::Step::new("scattering points");
    let count = write(&level, args.spacing, args.seed, encoding, &args.output)?;
    drop(step);
    output::print(&format!(
        "{}: {} points\n",
        args.output.display(),
        output::count(count as u64)
    ))
}

/// Scatters points over a level and writes them; says how many.
pub fn write(
    level: &TriangleMesh,
    spacing: f32,
    seed: u64,
    encoding: PlyEncoding,
    path: &Path,
) -> Result<usize, ToolError> {
    let points = scatter(level, spacing, seed).ok_or_else(|| {
        ToolError::Usage(format!(
            "points {spacing} m apart would be too many for this level"
        ))
    })?;
    let mut bytes = Vec::new();
    let (normals, albedo) = (
        points.normals.unwrap_or_default(),
        points.albedo.unwrap_or_default(),
    );
    write_ply(&mut bytes, encoding, &points.positions, &normals, &albedo)
        .map_err(|why| ToolError::write(path, &why))?;
    write_file(path, &bytes).map_err(|why| ToolError::write(path, &why))?;
    Ok(points.positions.len())
}
