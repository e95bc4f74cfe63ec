//! `export`: writes the light of fixed lights as an irradiance volume that Bevy reads without the
//! plugin.

use super::error::ToolError;
use super::eval::parse_bounces;
use super::input;
use super::output::{self, Table};
use super::progress;
use meshless_gi::internals::asset::check_writable;
use meshless_gi::internals::frame::volume_weights::MAX_VOLUME_VOXELS;
use meshless_gi::internals::scene::SceneDescription;
use meshless_gi::{Bounces, ExportedVolume, VolumeExport};
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Args {
    /// Bake with probes (`bake --probes`).
    bake: PathBuf,
    /// Scene description with the lights. Its geometry is not read.
    #[arg(long, value_name = "SCENE.json")]
    scene: PathBuf,
    /// Path of the texture to write. Its transform and intensity go to OUT.ron.
    #[arg(long, value_name = "OUT.ktx2")]
    irradiance_volume: PathBuf,
    /// Edge of a voxel, in meters. Default: half of the distance between probes.
    #[arg(long, alias = "voxel", value_name = "M", allow_hyphen_values = true, value_parser = voxel_size)]
    voxel_size: Option<f32>,
    /// Maximum number of voxels. Voxels are enlarged to meet it.
    #[arg(long, value_name = "N", default_value_t = 1 << 16, value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_VOLUME_VOXELS)))]
    max_voxels: u32,
    /// Number of diffuse bounces, or `all`. Default: the number in the recipe of the bake.
    #[arg(long, value_name = "N|all", allow_hyphen_values = true, value_parser = parse_bounces)]
    bounces: Option<Bounces>,
    /// Luminance of an emissive factor of 1, in cd/m².
    #[arg(long, alias = "emission", value_name = "E", default_value_t = 1.0, allow_hyphen_values = true, value_parser = emissive_luminance)]
    emissive_luminance: f32,
}

fn emissive_luminance(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(luminance) if luminance >= 0.0 && f32::is_finite(luminance) => Ok(luminance),
        _ => Err("expected a number of 0 or more".into()),
    }
}

fn voxel_size(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(edge) if edge > 0.0 && f32::is_finite(edge) => Ok(edge),
        _ => Err("expected a length above 0".into()),
    }
}

pub fn run(args: &Args) -> Result<(), ToolError> {
    let texture = &args.irradiance_volume;
    if texture.extension().is_none_or(|e| e != "ktx2") {
        return Err(ToolError::Usage(format!(
            "{}: not a .ktx2 file name; choose a name that ends in .ktx2",
            texture.display()
        )));
    }
    let placement = texture.with_extension("ron");
    for path in [texture, &placement] {
        check_writable(path).map_err(|error| ToolError::write(path, &error))?;
    }
    let baked = input::bake(&args.bake)?;
    let description = SceneDescription::read_within(&args.scene, &mut input::budget())?;
    let step = progress::Step::new("computing the light of the voxels");
    let export = VolumeExport {
        voxel: args.voxel_size,
        max_voxels: args.max_voxels,
        bounces: args.bounces,
        emission: args.emissive_luminance,
    };
    let volume = ExportedVolume::new(&baked, &description.lights, &export)
        .map_err(|error| ToolError::input(&args.bake, &error))?;
    drop(step);
    let lights = args.scene.file_name().unwrap_or_default();
    let bytes = volume
        .write(texture, &lights.to_string_lossy())
        .map_err(|error| ToolError::write(texture, &error))?;
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
