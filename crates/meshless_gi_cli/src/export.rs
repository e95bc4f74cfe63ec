//! `export`: light for fixed lights in a file that Bevy reads without this crate.

use super::error::ToolError;
use super::eval::parse_bounces;
use super::input;
use super::output::{self, Table};
use super::progress;
use meshless_gi::internals::asset::check_writable;
use meshless_gi::internals::frame::volume_weights::MAX_PLACES;
use meshless_gi::internals::scene::SceneDescription;
use meshless_gi::{Bounces, ExportedVolume, VolumeExport};
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Args {
    /// The bake, made with --probes.
    bake: PathBuf,
    /// Lights; the geometry is not read.
    #[arg(long, value_name = "SCENE.json")]
    scene: PathBuf,
    /// Where the volume goes; its place and its intensity go beside it, to OUT.ron.
    #[arg(long, value_name = "OUT.ktx2")]
    irradiance_volume: PathBuf,
    /// Edge of a voxel, meters [half of the distance between the bake's probes].
    #[arg(long, value_name = "M", allow_hyphen_values = true, value_parser = voxel)]
    voxel: Option<f32>,
    /// Most voxels; they become larger where they would be more.
    #[arg(long, value_name = "N", default_value_t = 1 << 16, value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_PLACES)))]
    max_voxels: u32,
    /// Diffuse reflections that count, 1 or more, or `all`; left out: as many as the bake asks for.
    #[arg(long, value_name = "N|all", allow_hyphen_values = true, value_parser = parse_bounces)]
    bounces: Option<Bounces>,
    /// What an emissive factor of 1 stands for, cd/m².
    #[arg(long, value_name = "E", default_value_t = 1.0, allow_hyphen_values = true, value_parser = emission)]
    emission: f32,
}

fn emission(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(emission) if emission >= 0.0 && f32::is_finite(emission) => Ok(emission),
        _ => Err("a number of 0 or more is needed".into()),
    }
}

fn voxel(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(edge) if edge > 0.0 && f32::is_finite(edge) => Ok(edge),
        _ => Err("a length above 0 is needed".into()),
    }
}

pub fn run(args: &Args) -> Result<(), ToolError> {
    let texture = &args.irradiance_volume;
    if texture.extension().is_none_or(|e| e != "ktx2") {
        return Err(ToolError::Usage(format!(
            "{}: the name of an irradiance volume ends in .ktx2",
            texture.display()
        )));
    }
    let placement = texture.with_extension("ron");
    for path in [texture, &placement] {
        check_writable(path).map_err(|why| ToolError::write(path, &why))?;
    }
    let baked = input::bake(&args.bake)?;
    let description = SceneDescription::read_within(&args.scene, &mut input::budget())?;
    let step = progress::Step::new("computing the light of the voxels");
    let export = VolumeExport {
        voxel: args.voxel,
        max_voxels: args.max_voxels,
        bounces: args.bounces,
        emission: args.emission,
    };
    let volume = ExportedVolume::new(&baked, &description.lights, &export)
        .map_err(|why| ToolError::input(&args.bake, &why))?;
    drop(step);
    let lights = args.scene.file_name().unwrap_or_default();
    let bytes = volume
        .write(texture, &lights.to_string_lossy())
        .map_err(|why| ToolError::write(texture, &why))?;
    let [x, y, z] = volume.shape.size().to_array();
    let [w, h, d] = volume.shape.voxel().to_array();
    let mut table = Table::default();
    let file = format!("{}, {}", texture.display(), output::bytes(bytes));
    table
        .row("file", file)
        .row("placement", placement.display().to_string())
        .row(
            "voxels",
            format!("{x} x {y} x {z}, of {w:.3} x {h:.3} x {d:.3} m"),
        )
        .row("intensity", volume.intensity.to_string());
    output::print(&table.text())
}
