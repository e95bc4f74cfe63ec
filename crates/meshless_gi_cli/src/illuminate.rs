//! `illuminate`: the light at every point of a bake, or of a cloud, under a scene's lights: a
//! `.ply` file with the light as color, and the bake with the light in it.

use super::error::ToolError;
use super::eval::{geometry, viewpoints};
use super::{input, output, progress};
use glam::Vec3;
use meshless_gi::internals::asset::{check_writable, write_file};
use meshless_gi::internals::scene::{PlyEncoding, SceneDescription, read_ply_within, write_ply};
use meshless_gi::{Bounces, Evaluated, Evaluator, PointCloud};
use rayon::prelude::*;
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Args {
    /// The bake.
    bake: PathBuf,
    /// Lights, and the geometry files that were baked.
    #[arg(long, value_name = "SCENE.json")]
    scene: PathBuf,
    /// The cloud whose points are lit; left out: the bake's own points.
    #[arg(long, value_name = "CLOUD.ply")]
    points: Option<PathBuf>,
    /// Where the lit points go. Their color is what they reflect, over what the brightest hundredth
    /// of them does at least; linear.
    #[arg(short, long, value_name = "OUT.ply")]
    output: PathBuf,
    /// The irradiance, W/m², as color, neither reflected nor scaled.
    #[arg(long)]
    irradiance: bool,
    /// Writes the bake again, with the irradiance of its own points in it.
    #[arg(long, value_name = "OUT.mgi", conflicts_with = "points")]
    store: Option<PathBuf>,
    /// Write text and no binary numbers.
    #[arg(long)]
    ascii: bool,
}

/// Places, normals and reflectances.
struct Surface {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    albedo: Vec<Vec3>,
}

pub fn run(args: &Args) -> Result<(), ToolError> {
    for path in std::iter::once(&args.output).chain(&args.store) {
        check_writable(path).map_err(|why| ToolError::write(path, &why))?;
    }
    let mut baked = input::bake(&args.bake)?;
    let mut budget = input::budget();
    let description = SceneDescription::read_within(&args.scene, &mut budget)?;
    let surface = match &args.points {
        Some(path) => {
            let cloud = PointCloud::new(
                read_ply_within(path, &mut input::budget())?,
                &viewpoints(&baked),
            )
            .map_err(|why| ToolError::input(path, &why))?;
            Surface {
                positions: cloud.positions,
                normals: cloud.normals,
                albedo: cloud.albedo,
            }
        }
        None => Surface {
            positions: baked.points.iter().map(|p| p.x()).collect(),
            normals: baked.points.iter().map(|p| p.n()).collect(),
            albedo: baked.surfaces.iter().map(|s| s.albedo.into()).collect(),
        },
    };
    let meshes = geometry(&baked, &description, &mut budget)?;
    let count = surface.positions.len();
    let step = progress::Step::new(format!("{} points", output::count(count as u64)));
    let bounces = Bounces::Count(baked.info.bounces);
    let evaluator = Evaluator::new(&baked, &meshes, &description.lights, bounces);
    let found: Vec<Evaluated> = (0..count)
        .into_par_iter()
        .map(|i| evaluator.at(surface.positions[i], surface.normals[i], i as u64))
        .collect();
    drop(step);
    let lit = |e: &Evaluated| e.direct + e.indirect.unwrap_or_default();
    let light: Vec<Vec3> = found.iter().map(lit).collect();
    let uncovered = found.iter().filter(|e| e.indirect.is_none()).count();
    if uncovered > 0 {
        output::note(&format!(
            "{} points are not covered by the bake: they have direct light only",
            output::count(uncovered as u64)
        ));
    }
    let colors = match args.irradiance {
        true => light.clone(),
        false => shown(&light, &surface.albedo),
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
    .map_err(|why| ToolError::write(&args.output, &why))?;
    let mean = light.iter().map(|e| e.as_dvec3()).sum::<glam::DVec3>() / count.max(1) as f64;
    let mut said = format!(
        "{}: {} points, mean irradiance {:.4} {:.4} {:.4} W/m²\n",
        args.output.display(),
        output::count(count as u64),
        mean.x,
        mean.y,
        mean.z
    );
    if let Some(path) = &args.store {
        drop(evaluator);
        baked.illumination = light.iter().map(Vec3::to_array).collect();
        let size = (baked.write(path)).map_err(|why| ToolError::asset(path, &why))?;
        said += &format!("{}: {}\n", path.display(), output::bytes(size));
    }
    output::print(&said)
}

/// What points reflect, so that a hundredth of them is as bright as can be shown.
fn shown(light: &[Vec3], albedo: &[Vec3]) -> Vec<Vec3> {
    let reflected: Vec<Vec3> = light.iter().zip(albedo).map(|(e, a)| *e * *a).collect();
    let mut bright: Vec<f32> = reflected.iter().map(|b| b.max_element()).collect();
    bright.sort_by(f32::total_cmp);
    let most = bright.get(bright.len() * 99 / 100).copied().unwrap_or(0.0);
    let scale = if most > 0.0 { 1.0 / most } else { 0.0 };
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
        let colors = shown(&light, &half);
        let same = |a: Vec3, b: Vec3| assert!(a.abs_diff_eq(b, 1e-5), "{a} {b}");
        same(colors[199], Vec3::new(1.0, 0.25 * 199.0 / 99.0, 0.0));
        same(colors[99], Vec3::new(0.5, 0.25, 0.0));
        assert_eq!(shown(&[Vec3::ZERO; 3], &half[..3]), [Vec3::ZERO; 3]);
        assert!(shown(&[], &[]).is_empty());
    }
}
