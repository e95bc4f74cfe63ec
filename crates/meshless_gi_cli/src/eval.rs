//! `eval`: direct and indirect irradiance of a bake at given points, by the way that a frame takes.

use super::error::ToolError;
use super::points::{self, COLUMNS, Place};
use super::{input, output, progress};
use glam::Vec3;
use meshless_gi::internals::asset::{check_writable, write_file};
use meshless_gi::internals::scene::{InputBudget, SceneDescription, load_geometry_within};
use meshless_gi::{BakedScene, Bounces, Evaluated, Evaluator, FrameSettings, Light, TriangleMesh};
use rayon::prelude::*;
use std::fmt::Write;
use std::path::PathBuf;

/// Reflections that are simulated one by one; `all` takes no more steps than these.
const MAX_BOUNCES: u32 = FrameSettings::MAX_SWEEPS + 1;

#[derive(clap::Args)]
pub struct Args {
    /// The bake.
    bake: PathBuf,
    /// Lights, and the geometry files that were baked.
    #[arg(long, value_name = "SCENE.json")]
    scene: PathBuf,
    /// Points: a header, and at least the columns px,py,pz,nx,ny,nz.
    #[arg(long, value_name = "POINTS.csv")]
    points: PathBuf,
    /// Where the irradiances go, in the order of the points; W/m² on the side of the normal.
    #[arg(short, long, value_name = "OUT.csv")]
    output: PathBuf,
    /// Diffuse reflections that count, 1 or more, or `all`; left out: as many as the bake asks for.
    #[arg(long, value_name = "N|all", allow_hyphen_values = true, value_parser = parse_bounces)]
    bounces: Option<Bounces>,
    /// Tier of the operator, from 1 (the fewest links) on, see `inspect`; left out: all links.
    #[arg(long, value_name = "N")]
    tier: Option<u32>,
}

pub fn parse_bounces(text: &str) -> Result<Bounces, String> {
    match (text, text.parse()) {
        ("all", _) => Ok(Bounces::All),
        (_, Ok(count @ 1..=MAX_BOUNCES)) => Ok(Bounces::Count(count)),
        _ => Err(format!(
            "a number from 1 to {MAX_BOUNCES}, or `all`, is needed"
        )),
    }
}

pub fn run(args: &Args) -> Result<(), ToolError> {
    let baked = input::bake(&args.bake)?;
    let tiers = baked.tiers();
    if let Some(tier) = args.tier
        && !(1..=tiers).contains(&tier)
    {
        let why = match tiers {
            1 => format!("has no tier {tier}: there is one, number 1"),
            _ => format!("has no tier {tier}: there are {tiers}, 1 to {tiers}"),
        };
        return Err(ToolError::input(&args.bake, &why));
    }
    let mut budget = input::budget();
    let description = SceneDescription::read_within(&args.scene, &mut budget)?;
    let places = points::read(&args.points)?;
    check_writable(&args.output).map_err(|why| ToolError::write(&args.output, &why))?;
    let varies = |light: &Light| matches!(light, Light::Sky { radiance } if !radiance.is_uniform());
    if baked.sky.is_none() && description.lights.iter().any(varies) {
        return Err(ToolError::Input(
            "the bake knows a uniform sky only: bake with `--sky harmonics` for one that varies"
                .into(),
        ));
    }
    let meshes = geometry(&baked, &description, &mut budget)?;

    let step = progress::Step::new(format!("{} points", output::count(places.len() as u64)));
    let bounces = args.bounces.unwrap_or(Bounces::Count(baked.info.bounces));
    let tier = args.tier.unwrap_or(tiers);
    let evaluator = Evaluator::with_tier(&baked, &meshes, &description.lights, bounces, tier);
    let values: Vec<Evaluated> = places
        .par_iter()
        .enumerate()
        .map(|(i, place)| evaluator.at(place.position, place.normal, i as u64))
        .collect();
    drop(step);
    write_file(&args.output, table(&places, &values).as_bytes())
        .map_err(|why| ToolError::write(&args.output, &why))
}

/// Where the bake was seen from, meters: what points without normals face.
pub fn viewpoints(baked: &BakedScene) -> Vec<Vec3> {
    (baked.info.viewpoints.iter()).map(|&v| v.into()).collect()
}

/// The geometry, for what emissive surfaces and the sky send directly. Where there are neither, it
/// may be missing.
pub fn geometry(
    baked: &BakedScene,
    description: &SceneDescription,
    budget: &mut InputBudget,
) -> Result<Vec<TriangleMesh>, ToolError> {
    let sky = description
        .lights
        .iter()
        .any(|light| matches!(light, Light::Sky { .. }));
    let needed = sky || baked.surfaces.iter().any(|s| s.emission != [0.0; 3]);
    let viewpoints = viewpoints(baked);
    let mut meshes = Vec::new();
    for path in &description.geometry {
        match load_geometry_within(path, &viewpoints, budget) {
            Ok(level) => meshes.push(level.mesh),
            Err(why) if why.is_io() && !needed => {
                output::note(&format!("{why}; nothing in the bake needs it"));
            }
            Err(why) => return Err(why.into()),
        }
    }
    if needed && meshes.is_empty() {
        return Err(ToolError::Input(
            "the scene names no geometry: without it the direct light of the sky and of emissive surfaces is not known".into(),
        ));
    }
    let triangles: u64 = meshes.iter().map(|m| m.len() as u64).sum();
    if !meshes.is_empty() && triangles != baked.info.triangles {
        output::note(&format!(
            "the scene has {} triangles, the bake was made from {}: it may be of another level",
            output::count(triangles),
            output::count(baked.info.triangles)
        ));
    }
    Ok(meshes)
}

fn table(places: &[Place], values: &[Evaluated]) -> String {
    let mut out = COLUMNS.join(",");
    out += ",direct_r,direct_g,direct_b,indirect_r,indirect_g,indirect_b,covered\n";
    for (place, value) in places.iter().zip(values) {
        let (d, i) = (value.direct, value.indirect.unwrap_or_default());
        let covered = u8::from(value.indirect.is_some());
        out += &place.text.join(",");
        // Writing to a text cannot fail.
        let _ = writeln!(
            out,
            ",{},{},{},{},{},{},{covered}",
            d.x, d.y, d.z, i.x, i.y, i.z
        );
    }
    out
}
