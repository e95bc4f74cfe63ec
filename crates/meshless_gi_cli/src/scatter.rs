//! `scatter`: scatters points evenly over a scene and writes a `.ply` file.

use super::error::ToolError;
use super::{output, progress, source};
use meshless_gi::TriangleMesh;
use meshless_gi::internals::asset::{check_writable, write_file};
use meshless_gi::internals::samples::scatter;
use meshless_gi::internals::scene::{PlyEncoding, statue_room, write_ply};
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Args {
    /// Scene (.glb, .gltf, .ply, .json). Default: the built-in statue in a Cornell box.
    scene: Option<PathBuf>,
    /// Path of the point cloud to write.
    #[arg(short, long, value_name = "OUT.ply")]
    output: PathBuf,
    /// Minimum distance between points of one surface, in meters.
    #[arg(long, value_name = "S", default_value_t = 0.02, allow_hyphen_values = true, value_parser = spacing)]
    spacing: f32,
    /// Seed of all random numbers.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Write ASCII numbers instead of binary ones.
    #[arg(long)]
    ascii: bool,
}

fn spacing(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(s) if s > 0.0 && f32::is_finite(s) => Ok(s),
        _ => Err("expected a length above 0".into()),
    }
}

pub fn run(args: &Args) -> Result<(), ToolError> {
    check_writable(&args.output).map_err(|error| ToolError::write(&args.output, &error))?;
    let mesh = match &args.scene {
        Some(path) => source::load(path, &[])?,
        None => statue_room(),
    };
    let encoding = match args.ascii {
        true => PlyEncoding::Ascii,
        false => PlyEncoding::LittleEndian,
    };
    let step = progress::Step::new("scattering points");
    let count = write(&mesh, args.spacing, args.seed, encoding, &args.output)?;
    drop(step);
    output::print(&format!(
        "{}: {} points\n",
        args.output.display(),
        output::count(count as u64)
    ))
}

/// Scatters points over a mesh, writes them to `path` and returns their number.
pub fn write(
    mesh: &TriangleMesh,
    spacing: f32,
    seed: u64,
    encoding: PlyEncoding,
    path: &Path,
) -> Result<usize, ToolError> {
    let points = scatter(mesh, spacing, seed).ok_or_else(|| {
        ToolError::Usage(format!(
            "spacing of {spacing} m gives too many points in this scene; increase --spacing"
        ))
    })?;
    let mut bytes = Vec::new();
    let (normals, albedo) = (
        points.normals.unwrap_or_default(),
        points.albedo.unwrap_or_default(),
    );
    write_ply(&mut bytes, encoding, &points.positions, &normals, &albedo)
        .map_err(|error| ToolError::write(path, &error))?;
    write_file(path, &bytes).map_err(|error| ToolError::write(path, &error))?;
    Ok(points.positions.len())
}
