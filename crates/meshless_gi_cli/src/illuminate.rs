//! `illuminate`: computes the light at every point of a bake or of a point cloud, and writes it as
//! a colored point cloud and into the bake.

use super::error::ToolError;
use super::eval::{geometry, viewpoints};
use super::{input, output, progress};
use glam::{DVec3, Vec3};
use meshless_gi::internals::asset::{check_writable, write_file};
use meshless_gi::internals::scene::{PlyEncoding, SceneDescription, read_ply_within, write_ply};
use meshless_gi::{BakedScene, Bounces, Evaluated, Evaluator, PointCloud, TriangleMesh};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Args {
    /// Bake to evaluate.
    bake: PathBuf,
    /// Scene description: lights, and the geometry files of the bake.
    #[arg(long, value_name = "SCENE.json")]
    scene: PathBuf,
    /// Point cloud to light. Default: the points of the bake.
    #[arg(long, value_name = "CLOUD.ply")]
    points: Option<PathBuf>,
    /// Path of the point cloud to write. Its colors are the reflected light, linear, scaled so that
    /// the brightest 1 % is white.
    #[arg(short, long, value_name = "OUT.ply")]
    output: PathBuf,
    /// Write the irradiance in W/m² as color instead, not scaled.
    #[arg(long)]
    irradiance: bool,
    /// Path of an additional bake to write, with the irradiance of its points.
    #[arg(
        long,
        alias = "store",
        value_name = "OUT.mgi",
        conflicts_with = "points"
    )]
    output_bake: Option<PathBuf>,
    /// Write ASCII numbers instead of binary ones.
    #[arg(long)]
    ascii: bool,
}

/// Positions, normals and albedos of the points to light.
struct Surface {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    albedo: Vec<Vec3>,
}

impl Surface {
    /// Returns the points of the bake.
    fn from_bake(baked: &BakedScene) -> Self {
        Self {
            positions: baked.data().points.iter().map(|p| p.x()).collect(),
            normals: baked.data().points.iter().map(|p| p.n()).collect(),
            albedo: baked
                .data()
                .surfaces
                .iter()
                .map(|s| s.albedo.into())
                .collect(),
        }
    }

    /// Reads a point cloud. Points without normals face the viewpoints of the bake.
    fn from_cloud(path: &Path, baked: &BakedScene) -> Result<Self, ToolError> {
        let points = read_ply_within(path, &mut input::budget())?;
        let cloud = PointCloud::new(points, &viewpoints(baked))
            .map_err(|error| ToolError::input(path, &error))?;
        Ok(Self {
            positions: cloud.positions,
            normals: cloud.normals,
            albedo: cloud.albedo,
        })
    }
}

pub fn run(args: &Args) -> Result<(), ToolError> {
    for path in std::iter::once(&args.output).chain(&args.output_bake) {
        check_writable(path).map_err(|error| ToolError::write(path, &error))?;
    }
    let baked = input::bake(&args.bake)?;
    let mut budget = input::budget();
    let description = SceneDescription::read_within(&args.scene, &mut budget)?;
    let surface = match &args.points {
        Some(path) => Surface::from_cloud(path, &baked)?,
        None => Surface::from_bake(&baked),
    };
    let meshes = geometry(&baked, &description, &mut budget)?;
    let irradiance = illuminate(&baked, &meshes, &description, &surface);
    let colors = match args.irradiance {
        true => irradiance.clone(),
        false => scaled_radiosity(&irradiance, &surface.albedo),
    };
    let encoding = match args.ascii {
        true => PlyEncoding::Ascii,
        false => PlyEncoding::LittleEndian,
    };
    let mut bytes = Vec::new();
    write_ply(
        &mut bytes,
        encoding,
        &surface.positions,
        &surface.normals,
        &colors,
    )
    .and_then(|()| write_file(&args.output, &bytes))
    .map_err(|error| ToolError::write(&args.output, &error))?;
    let count = irradiance.len();
    let mean = irradiance.iter().map(|e| e.as_dvec3()).sum::<DVec3>() / count.max(1) as f64;
    let mut summary = format!(
        "{}: {} points, mean irradiance {:.4} {:.4} {:.4} W/m²\n",
        args.output.display(),
        output::count(count as u64),
        mean.x,
        mean.y,
        mean.z
    );
    if let Some(path) = &args.output_bake {
        let illuminated = baked.with_illumination(irradiance.iter().map(Vec3::to_array).collect());
        let size = (illuminated.write(path)).map_err(|error| ToolError::asset(path, &error))?;
        summary += &format!("{}: {}\n", path.display(), output::bytes(size));
    }
    output::print(&summary)
}

/// Returns the irradiance at each point of `surface`. Points that the bake does not cover get
/// direct light only.
fn illuminate(
    baked: &BakedScene,
    meshes: &[TriangleMesh],
    description: &SceneDescription,
    surface: &Surface,
) -> Vec<Vec3> {
    let count = surface.positions.len();
    let step = progress::Step::new(format!("{} points", output::count(count as u64)));
    let bounces = Bounces::Count(baked.info().bounces);
    let evaluator = Evaluator::new(baked, meshes, &description.lights, bounces);
    let values: Vec<Evaluated> = (0..count)
        .into_par_iter()
        .map(|i| evaluator.at(surface.positions[i], surface.normals[i], i as u64))
        .collect();
    drop(step);
    let uncovered = values.iter().filter(|e| e.indirect.is_none()).count();
    if uncovered > 0 {
        output::note(&format!(
            "{} points are not covered by the bake: they have direct light only",
            output::count(uncovered as u64)
        ));
    }
    let total = |e: &Evaluated| e.direct + e.indirect.unwrap_or_default();
    values.iter().map(total).collect()
}

/// Returns the reflected light of each point, scaled so that the brightest 1 % is white.
fn scaled_radiosity(irradiance: &[Vec3], albedo: &[Vec3]) -> Vec<Vec3> {
    let reflected: Vec<Vec3> = irradiance
        .iter()
        .zip(albedo)
        .map(|(e, a)| *e * *a)
        .collect();
    let mut sorted: Vec<f32> = reflected.iter().map(|b| b.max_element()).collect();
    sorted.sort_by(f32::total_cmp);
    let white = sorted.get(sorted.len() * 99 / 100).copied().unwrap_or(0.0);
    let scale = if white > 0.0 { 1.0 / white } else { 0.0 };
    let color = |b: &Vec3| (*b * scale).min(Vec3::ONE);
    reflected.iter().map(color).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exposure_maps_brightest_percent_to_white() {
        let light: Vec<Vec3> = (0..200).map(|i| Vec3::splat(i as f32)).collect();
        let half = vec![Vec3::new(0.5, 0.25, 0.0); 200];
        let colors = scaled_radiosity(&light, &half);
        let same = |a: Vec3, b: Vec3| assert!(a.abs_diff_eq(b, 1e-5), "{a} {b}");
        same(colors[199], Vec3::new(1.0, 0.25 * 199.0 / 99.0, 0.0));
        same(colors[99], Vec3::new(0.5, 0.25, 0.0));
        assert_eq!(
            scaled_radiosity(&[Vec3::ZERO; 3], &half[..3]),
            [Vec3::ZERO; 3]
        );
        assert!(scaled_radiosity(&[], &[]).is_empty());
    }
}
