//! `eval`: direct and indirect irradiance of a bake at given points, computed as a frame does.

use super::error::ToolError;
use super::points::{self, COLUMNS, ShadingPoint};
use super::{input, output, progress};
use glam::Vec3;
use meshless_gi::internals::asset::{check_writable, write_file};
use meshless_gi::internals::scene::{InputBudget, SceneDescription, load_geometry_within};
use meshless_gi::{BakedScene, Bounces, Evaluated, Evaluator, FrameSettings, Light, TriangleMesh};
use rayon::prelude::*;
use std::fmt::Write;
use std::path::PathBuf;

/// Maximum number of simulated bounces. `all` takes at most this number of steps.
const MAX_BOUNCES: u32 = FrameSettings::MAX_SWEEPS + 1;

#[derive(clap::Args)]
pub struct Args {
    /// Bake to evaluate.
    bake: PathBuf,
    /// Scene description: lights, and the geometry files of the bake.
    #[arg(long, value_name = "SCENE.json")]
    scene: PathBuf,
    /// Points: a CSV file with a header and at least the columns px,py,pz,nx,ny,nz.
    #[arg(long, value_name = "POINTS.csv")]
    points: PathBuf,
    /// Path of the CSV file to write: irradiances in the order of the points, in W/m², on the side
    /// of the normal.
    #[arg(short, long, value_name = "OUT.csv")]
    output: PathBuf,
    /// Number of diffuse bounces, or `all`. Default: the number in the recipe of the bake.
    #[arg(long, value_name = "N|all", allow_hyphen_values = true, value_parser = parse_bounces)]
    bounces: Option<Bounces>,
    /// Tier of the operator, from 1 (fewest links). `inspect` lists the tiers. Default: all links.
    #[arg(long, value_name = "N")]
    tier: Option<u32>,
}

pub fn parse_bounces(text: &str) -> Result<Bounces, String> {
    match (text, text.parse()) {
        ("all", _) => Ok(Bounces::All),
        (_, Ok(count @ 1..=MAX_BOUNCES)) => Ok(Bounces::Count(count)),
        _ => Err(format!(
            "expected a number from 1 to {MAX_BOUNCES}, or `all`"
        )),
    }
}

pub fn run(args: &Args) -> Result<(), ToolError> {
    let baked = input::bake(&args.bake)?;
    let tiers = baked.data().tiers();
    if let Some(tier) = args.tier
        && !(1..=tiers).contains(&tier)
    {
        let problem = format!("has no tier {tier}; choose one of the tiers 1 to {tiers}");
        return Err(ToolError::input(&args.bake, &problem));
    }
    let mut budget = input::budget();
    let description = SceneDescription::read_within(&args.scene, &mut budget)?;
    let points = points::read(&args.points)?;
    check_writable(&args.output).map_err(|error| ToolError::write(&args.output, &error))?;
    let varies = |light: &Light| matches!(light, Light::Sky { radiance } if !radiance.is_uniform());
    if baked.data().sky.is_none() && description.lights.iter().any(varies) {
        return Err(ToolError::Input(
            "the sky varies, but the bake has a uniform sky; bake with `--sky harmonics`".into(),
        ));
    }
    let meshes = geometry(&baked, &description, &mut budget)?;

    let step = progress::Step::new(format!("{} points", output::count(points.len() as u64)));
    let bounces = args.bounces.unwrap_or(Bounces::Count(baked.info().bounces));
    let tier = args.tier.unwrap_or(tiers);
    let evaluator = Evaluator::with_tier(&baked, &meshes, &description.lights, bounces, tier);
    let values: Vec<Evaluated> = points
        .par_iter()
        .enumerate()
        .map(|(i, point)| evaluator.at(point.position, point.normal, i as u64))
        .collect();
    drop(step);
    write_file(&args.output, table(&points, &values).as_bytes())
        .map_err(|error| ToolError::write(&args.output, &error))
}

/// Returns the viewpoints of the bake, in meters. Points without normals face them.
pub fn viewpoints(baked: &BakedScene) -> Vec<Vec3> {
    (baked.info().viewpoints.iter())
        .map(|&v| v.into())
        .collect()
}

/// Reads the geometry for the direct light of emissive surfaces and of the sky. Missing files are
/// accepted if there is neither.
pub fn geometry(
    baked: &BakedScene,
    description: &SceneDescription,
    budget: &mut InputBudget,
) -> Result<Vec<TriangleMesh>, ToolError> {
    let sky = description
        .lights
        .iter()
        .any(|light| matches!(light, Light::Sky { .. }));
    let needed = sky || baked.data().surfaces.iter().any(|s| s.emission != [0.0; 3]);
    let viewpoints = viewpoints(baked);
    let mut meshes = Vec::new();
    for path in &description.geometry {
        match load_geometry_within(path, &viewpoints, budget) {
            Ok(loaded) => meshes.push(loaded.mesh),
            Err(error) if error.is_io() && !needed => {
                output::note(&format!("{error}; skipped, the bake does not need it"));
            }
            Err(error) => return Err(error.into()),
        }
    }
    if needed && meshes.is_empty() {
        return Err(ToolError::Input(
            "the scene description names no geometry; add it for direct light of the sky and of emissive surfaces".into(),
        ));
    }
    let triangles: u64 = meshes.iter().map(|m| m.len() as u64).sum();
    if !meshes.is_empty() && triangles != baked.info().triangles {
        output::note(&format!(
            "the scene has {} triangles, the bake was made from {}; it may belong to another scene",
            output::count(triangles),
            output::count(baked.info().triangles)
        ));
    }
    Ok(meshes)
}

fn table(points: &[ShadingPoint], values: &[Evaluated]) -> String {
    let mut out = COLUMNS.join(",");
    out += ",direct_r,direct_g,direct_b,indirect_r,indirect_g,indirect_b,covered\n";
    for (point, value) in points.iter().zip(values) {
        let (d, i) = (value.direct, value.indirect.unwrap_or_default());
        let covered = u8::from(value.indirect.is_some());
        out += &point.text.join(",");
        // Writing to a string cannot fail.
        let _ = writeln!(
            out,
            ",{},{},{},{},{},{},{covered}",
            d.x, d.y, d.z, i.x, i.y, i.z
        );
    }
    out
}
