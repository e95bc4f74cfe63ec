//! `bake`: a level or a recipe to a `.mgi` file, with statistics.

use super::error::ToolError;
use super::output::{self, Table};
use super::{input, progress};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use glam::Vec3;
use meshless_gi::internals::asset::check_writable;
use meshless_gi::internals::bake::{Settings, cast_gather_rays};
use meshless_gi::internals::scene::load_geometry_within;
use meshless_gi::{
    BakeError, BakeSceneError, BakeStats, Baked, LoadedGeometry, OccluderDesc, Preset, Recipe,
    RecipeError, Sky, TransportMethod, TriangleMesh, bake_scene,
};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// More threads help nobody.
pub const MAX_THREADS: i64 = 1024;

#[derive(clap::Args)]
pub struct Args {
    /// The level: triangles (.glb, .gltf), points (.ply), both (a .json whose geometry names them),
    /// or a recipe (.gi.ron) that names one.
    scene: PathBuf,
    /// Where the bake goes.
    #[arg(short, long, value_name = "OUT.mgi")]
    output: PathBuf,
    /// A recipe for the level; the options below go before what it says.
    #[arg(long, value_name = "FILE")]
    recipe: Option<PathBuf>,
    #[command(flatten)]
    options: Options,
    /// Threads; 0 for one a processor. The result does not depend on it.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=MAX_THREADS))]
    threads: u32,
    /// Write statistics as JSON.
    #[arg(long, value_name = "FILE.json")]
    stats: Option<PathBuf>,
    /// Afterwards cast the gather's rays again and do nothing else with them: what is the least
    /// that the bake could take.
    #[arg(long)]
    yardstick: bool,
}

/// What goes before the recipe. Left out: as the recipe says, or as follows from the scene's size.
#[derive(clap::Args)]
struct Options {
    /// How much care to take [draft, medium, high; medium if left out].
    #[arg(long, hide_possible_values = true, value_parser = preset())]
    preset: Option<Preset>,
    /// A place in free space from which light can be seen, meters; may be given several times.
    /// Points without normals face it.
    #[arg(long = "viewpoint", value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = viewpoint)]
    viewpoints: Vec<[f32; 3]>,
    /// Disk radius of the coarsest level, meters.
    #[arg(long, value_name = "R", allow_hyphen_values = true)]
    coarse_radius: Option<f32>,
    /// Levels of points, 1 to 12.
    #[arg(long, value_name = "N", allow_hyphen_values = true)]
    levels: Option<u32>,
    /// How many of them, from the coarsest, send light.
    #[arg(long, value_name = "N", allow_hyphen_values = true)]
    sender_levels: Option<u32>,
    /// Rays a point, 16 to 65536.
    #[arg(long, value_name = "N", allow_hyphen_values = true)]
    rays: Option<u32>,
    /// Diffuse reflections, 1 to 64.
    #[arg(long, value_name = "N", allow_hyphen_values = true)]
    bounces: Option<u32>,
    /// What carries light [bounded, l08, pca, fmm; bounded if left out].
    #[arg(long, hide_possible_values = true, value_parser = rule())]
    rule: Option<TransportMethod>,
    /// Rule pca: vectors of a cluster's basis of direct light, 1 to 1000 (10 if left out).
    #[arg(long, value_name = "N", allow_hyphen_values = true)]
    coefficients: Option<u32>,
    /// Rule pca: senders of a cluster, about [a 64th of them].
    #[arg(long, value_name = "N", allow_hyphen_values = true)]
    cluster_points: Option<u32>,
    /// Rule pca: example lamps that the bases are made from (1000 if left out).
    #[arg(long, value_name = "N", allow_hyphen_values = true)]
    lamps: Option<u32>,
    /// Rule fmm: order of the expansions, 0 to 16 (2 if left out; kernels take 6 at most).
    #[arg(long, value_name = "N", allow_hyphen_values = true)]
    order: Option<u32>,
    /// Rule fmm: most points of a leaf of the octree, 1 to 4096 (24 if left out).
    #[arg(long, value_name = "N", allow_hyphen_values = true)]
    leaf: Option<u32>,
    /// Rule fmm: places that each sender shines from, 1 to 64 (4 if left out).
    #[arg(long, value_name = "N", allow_hyphen_values = true)]
    sources: Option<u32>,
    /// Rule fmm: rays that decide what two nodes see of each other, 1 to 4096 (16 if left out).
    #[arg(long, value_name = "N", allow_hyphen_values = true)]
    pair_rays: Option<u32>,
    /// Rule fmm: bake the links of rule bounded too, for devices and frames that do not hold the
    /// octree.
    #[arg(long)]
    fallback: bool,
    /// Threshold of the rule, 0 to 1.
    #[arg(long, value_name = "E", allow_hyphen_values = true)]
    epsilon: Option<f32>,
    /// Bake again, finer, until the estimated error (NRMSE, 0.05 for 5 %) is at most this.
    #[arg(long, value_name = "E", allow_hyphen_values = true)]
    max_error: Option<f32>,
    /// Bake light in free space, for what moves.
    #[arg(long)]
    probes: bool,
    /// Light in free space: distance between its probes, meters [about 2000 in the box around the
    /// level]. Implies `--probes`.
    #[arg(long, value_name = "M", allow_hyphen_values = true)]
    probe_spacing: Option<f32>,
    /// Which skies may light the level: the same radiance from everywhere, or one that varies
    /// (spherical harmonics).
    #[arg(long, value_name = "KIND", value_parser = sky())]
    sky: Option<Sky>,
    /// Bake what materials cover each sender, for base colors and emission that change in the
    /// running game.
    #[arg(long)]
    live_materials: bool,
    /// A door or a lift that the running game opens and shuts: the name of a node of the level;
    /// again for several, 64 at most.
    #[arg(long = "occluder", value_name = "NAME")]
    occluders: Vec<String>,
    /// Bake what points see, for lights with soft shadows.
    #[arg(long)]
    soft_shadows: bool,
    /// Soft shadows: directions a point, 16 to 16384 (4012 if left out; the paper has 2016).
    #[arg(
        long,
        value_name = "N",
        requires = "soft_shadows",
        allow_hyphen_values = true
    )]
    visibility_directions: Option<u32>,
    /// Soft shadows: most coefficients a point, 1 to 128 (50 if left out).
    #[arg(
        long,
        value_name = "N",
        requires = "soft_shadows",
        allow_hyphen_values = true
    )]
    visibility_coefficients: Option<u32>,
    /// Soft shadows: points of a cluster, about, 16 to 65536 (400 if left out).
    #[arg(
        long,
        value_name = "N",
        requires = "soft_shadows",
        allow_hyphen_values = true
    )]
    visibility_cluster: Option<u32>,
    /// Soft shadows: clusters whose depths are more wrong are cut in two, 0.001 to 1 (0.03 if left
    /// out; 1 for none).
    #[arg(
        long,
        value_name = "E",
        requires = "soft_shadows",
        allow_hyphen_values = true
    )]
    visibility_error: Option<f32>,
    /// Seed of all random numbers.
    #[arg(long, value_name = "N", allow_hyphen_values = true)]
    seed: Option<u64>,
}

fn preset() -> impl TypedValueParser<Value = Preset> {
    PossibleValuesParser::new(["draft", "medium", "high"]).map(|word| match word.as_str() {
        "draft" => Preset::Draft,
        "high" => Preset::High,
        _ => Preset::Medium,
    })
}

fn rule() -> impl TypedValueParser<Value = TransportMethod> {
    PossibleValuesParser::new(["bounded", "l08", "pca", "fmm"]).map(|word| match word.as_str() {
        "l08" => TransportMethod::L08,
        "pca" => TransportMethod::Pca,
        "fmm" => TransportMethod::Fmm,
        _ => TransportMethod::Bounded,
    })
}

fn sky() -> impl TypedValueParser<Value = Sky> {
    PossibleValuesParser::new(["uniform", "harmonics"]).map(|word| match word.as_str() {
        "harmonics" => Sky::Harmonics,
        _ => Sky::Uniform,
    })
}

fn viewpoint(text: &str) -> Result<[f32; 3], String> {
    let mut parts = text.split(',').map(|c| c.trim().parse::<f32>());
    match (parts.next(), parts.next(), parts.next(), parts.next()) {
        (Some(Ok(x)), Some(Ok(y)), Some(Ok(z)), None)
            if [x, y, z].iter().all(|c| c.is_finite()) =>
        {
            Ok([x, y, z])
        }
        _ => Err("three finite numbers with commas between them are needed, as in -1,2.5,0".into()),
    }
}

impl Options {
    /// Puts the options into a recipe.
    fn apply(&self, recipe: &mut Recipe) {
        fn over<T: Copy>(to: &mut Option<T>, option: Option<T>) {
            *to = option.or(*to);
        }
        recipe.preset = self.preset.unwrap_or(recipe.preset);
        recipe.rule = self.rule.unwrap_or(recipe.rule);
        recipe.seed = self.seed.unwrap_or(recipe.seed);
        recipe.sky = self.sky.unwrap_or(recipe.sky);
        recipe.live_materials |= self.live_materials;
        for name in &self.occluders {
            // One that the recipe knows already has its boxes there.
            if !recipe.occluders.iter().any(|o| o.name == *name) {
                recipe.occluders.push(OccluderDesc::node(name));
            }
        }
        if !self.viewpoints.is_empty() {
            recipe.viewpoints.clone_from(&self.viewpoints);
        }
        over(&mut recipe.coarse_radius, self.coarse_radius);
        over(&mut recipe.levels, self.levels);
        over(&mut recipe.sender_levels, self.sender_levels);
        if self.probes || self.probe_spacing.is_some() {
            let probes = recipe.probes.get_or_insert_default();
            over(&mut probes.spacing, self.probe_spacing);
        }
        if self.soft_shadows {
            let soft = recipe.soft_shadows.get_or_insert_default();
            soft.directions = self.visibility_directions.unwrap_or(soft.directions);
            soft.coefficients = self.visibility_coefficients.unwrap_or(soft.coefficients);
            soft.cluster_points = self.visibility_cluster.unwrap_or(soft.cluster_points);
            soft.error = self.visibility_error.unwrap_or(soft.error);
        }
        over(&mut recipe.rays, self.rays);
        over(&mut recipe.bounces, self.bounces);
        over(&mut recipe.coefficients, self.coefficients);
        over(&mut recipe.cluster_points, self.cluster_points);
        over(&mut recipe.lamps, self.lamps);
        over(&mut recipe.order, self.order);
        over(&mut recipe.leaf, self.leaf);
        over(&mut recipe.sources, self.sources);
        over(&mut recipe.pair_rays, self.pair_rays);
        recipe.fallback |= self.fallback;
        over(&mut recipe.epsilon, self.epsilon);
        over(&mut recipe.max_error, self.max_error);
    }
}

/// What the statistics file holds.
#[derive(Serialize)]
struct Statistics<'a> {
    #[serde(flatten)]
    bake: &'a BakeStats,
    #[serde(flatten)]
    yardstick: Option<Yardstick>,
}

/// The gather's rays, cast again and nothing else.
#[derive(Clone, Copy, Serialize)]
struct Yardstick {
    /// Seconds for as many rays as the gather cast.
    yardstick_seconds: f64,
    /// Rays that were cast to measure it.
    yardstick_rays: u64,
    /// The bake's total over that.
    total_over_yardstick: f64,
}

pub fn run(args: &Args) -> Result<(), ToolError> {
    let began = Instant::now();
    let (recipe, level) = what_to_bake(args)?;
    // Before a long bake, not after it.
    for path in [Some(&args.output), args.stats.as_ref()]
        .into_iter()
        .flatten()
    {
        if [Some(&level), Some(&args.scene), args.recipe.as_ref()]
            .into_iter()
            .flatten()
            .any(|input| same_file(input, path))
        {
            return Err(ToolError::Usage(format!(
                "{} is both read and written",
                path.display()
            )));
        }
        check_writable(path).map_err(|why| ToolError::write(path, &why))?;
    }
    if args.stats.as_ref().is_some_and(|s| *s == args.output) {
        return Err(ToolError::Usage("-o and --stats name the same file".into()));
    }

    let mesh = load(&level, &recipe.viewpoints)?;
    let loaded = began.elapsed().as_secs_f64();
    let tree = mesh.bvh_time().as_secs_f64();
    let threads = args.threads as usize;
    let Baked { scene, mut stats } =
        progress::watch(|progress| bake_scene(&mesh, &recipe, threads, progress))
            .map_err(|why| failed(args, &level, &why))?;
    stats.seconds.load = loaded - tree;
    stats.seconds.bvh += tree;
    let writing = Instant::now();
    stats.bytes = scene
        .write(&args.output)
        .map_err(|why| ToolError::asset(&args.output, &why))?;
    stats.seconds.write = writing.elapsed().as_secs_f64();
    stats.seconds.total = began.elapsed().as_secs_f64();

    let yardstick = match args.yardstick {
        true => Some(measure(&mesh, &scene, &stats, threads)?),
        false => None,
    };
    for warning in &stats.warnings {
        output::note(warning);
    }
    if let Some(path) = &args.stats {
        let all = Statistics {
            bake: &stats,
            yardstick,
        };
        let mut text =
            serde_json::to_vec_pretty(&all).map_err(|why| ToolError::write(path, &why))?;
        text.push(b'\n');
        meshless_gi::internals::asset::write_file(path, &text)
            .map_err(|why| ToolError::write(path, &why))?;
    }
    output::print(&summary(&args.output, &stats, yardstick))
}

/// The recipe with the options in it, and the level's file.
fn what_to_bake(args: &Args) -> Result<(Recipe, PathBuf), ToolError> {
    let (mut recipe, level) = level_and_recipe(&args.scene, args.recipe.as_ref())?;
    args.options.apply(&mut recipe);
    if level == args.scene {
        // The level's name goes into the bake, and a recipe beside the level may name another one.
        recipe.scene = (level.file_name()).map(|name| name.to_string_lossy().into_owned());
    }
    sound(&recipe).map_err(|why| ToolError::Usage(why.to_string()))?;
    Ok((recipe, level))
}

/// The level's file, and the recipe beside it or in its place.
pub fn level_and_recipe(
    scene: &PathBuf,
    recipe: Option<&PathBuf>,
) -> Result<(Recipe, PathBuf), ToolError> {
    let name = scene.to_string_lossy().to_lowercase();
    let is_recipe = name.ends_with(".ron");
    let recipe_file = match (is_recipe, recipe) {
        (true, Some(_)) => {
            return Err(ToolError::Usage(format!(
                "{} is a recipe: --recipe would be a second one",
                scene.display()
            )));
        }
        (true, None) => Some(scene),
        (false, recipe) => recipe,
    };
    let recipe = match recipe_file {
        Some(path) => read_recipe(path)?,
        None => Recipe::default(),
    };
    let level = match (is_recipe, &recipe.scene) {
        (false, _) => scene.clone(),
        (true, Some(level)) => scene.parent().unwrap_or(Path::new("")).join(level),
        (true, None) => {
            return Err(ToolError::input(
                scene,
                &"the recipe names no level: add `scene: \"level.glb\"`",
            ));
        }
    };
    if level.to_string_lossy().to_lowercase().ends_with(".ron") {
        return Err(ToolError::input(
            scene,
            &format!("`scene` is {}, not a level", level.display()),
        ));
    }
    // What stands in a file is input, what stands on the command line is usage.
    if let Some(path) = recipe_file {
        sound(&recipe).map_err(|why| ToolError::input(path, &why))?;
    }
    Ok((recipe, level))
}

fn read_recipe(path: &Path) -> Result<Recipe, ToolError> {
    let text = String::from_utf8(input::bytes(path)?)
        .map_err(|_| ToolError::input(path, &"the recipe is not text"))?;
    Recipe::from_ron(&text).map_err(|why| ToolError::input(path, &why))
}

/// Each value on its own, and all together, for a level of any size.
fn sound(recipe: &Recipe) -> Result<(), RecipeError> {
    recipe.settings(1.0).map(|_| ())
}

fn same_file(a: &Path, b: &Path) -> bool {
    match (a.canonicalize(), b.canonicalize()) {
        (Ok(a), Ok(b)) => a == b,
        _ => false,
    }
}

/// Reads a level, and remarks on what was not taken as it stands there. Points without normals face
/// the `viewpoints` that they lie around.
pub fn load(path: &Path, viewpoints: &[[f32; 3]]) -> Result<TriangleMesh, ToolError> {
    let step = progress::Step::new(format!("reading {}", path.display()));
    let viewpoints: Vec<Vec3> = viewpoints.iter().map(|&v| v.into()).collect();
    let LoadedGeometry {
        mesh,
        points,
        problems,
        notes,
    } = load_geometry_within(path, &viewpoints, &mut input::budget())?;
    drop(step);
    if points > 0 {
        output::note(&format!(
            "{} points; their cells are {} triangles",
            output::count(points),
            output::count(mesh.len() as u64)
        ));
    }
    for note in &notes {
        output::note(note);
    }
    let told = |count: u64, what: &str| {
        if count > 0 {
            output::note(&format!("{} {what}", output::count(count)));
        }
    };
    told(
        problems.dropped(),
        "triangles without area or without numbers were left out",
    );
    told(
        problems.albedo_clamped,
        "materials reflected more than all light: clamped",
    );
    told(
        problems.bad_emission,
        "materials emitted what light can't be: their emission was dropped or lowered",
    );
    told(
        problems.bad_texture,
        "materials named textures that are not there",
    );
    Ok(mesh)
}

/// A bake that failed: the level's fault, or the recipe's.
fn failed(args: &Args, level: &Path, why: &BakeSceneError) -> ToolError {
    match why {
        BakeSceneError::Bake(BakeError::Recipe(why)) => match &args.recipe {
            Some(path) => ToolError::input(path, why),
            None => ToolError::input(&args.scene, why),
        },
        BakeSceneError::Threads(_) => ToolError::Usage(why.to_string()),
        _ => ToolError::input(level, why),
    }
}

fn measure(
    mesh: &TriangleMesh,
    scene: &meshless_gi::BakedScene,
    stats: &BakeStats,
    threads: usize,
) -> Result<Yardstick, ToolError> {
    let settings: Settings = ron::from_str(&scene.info.recipe)
        .map_err(|why| ToolError::Input(format!("the bake's own recipe: {why}")))?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|why| ToolError::Usage(why.to_string()))?;
    let step = progress::Step::new("casting the rays again");
    let began = Instant::now();
    let rays = pool.install(|| cast_gather_rays(mesh, scene, &settings));
    let seconds = began.elapsed().as_secs_f64();
    drop(step);
    // Receivers that turned out to need no row were gathered too.
    let yardstick_seconds = seconds * stats.gather_rays as f64 / rays.max(1) as f64;
    Ok(Yardstick {
        yardstick_seconds,
        yardstick_rays: rays,
        total_over_yardstick: stats.seconds.total / yardstick_seconds.max(1e-9),
    })
}

fn summary(path: &Path, stats: &BakeStats, yardstick: Option<Yardstick>) -> String {
    let s = &stats.seconds;
    let mut table = Table::default();
    table
        .row("file", format!("{}, {}", path.display(), output::bytes(stats.bytes)))
        .row("triangles", output::count(stats.triangles))
        .row("points", output::sum(&stats.points_per_level))
        .row("senders", output::count(stats.senders))
        .row("links", output::count(stats.links))
        .row(
            "rays",
            format!(
                "{}, {} of them gathered",
                output::count(stats.rays),
                output::count(stats.gather_rays)
            ),
        )
        .row(
            "estimated error",
            output::error(stats.estimated_nrmse, stats.estimated_nrmse_interval),
        )
        .row("gain", output::gain(&stats.energy))
        .row(
            "seconds",
            format!(
                "{:.2} on {} threads: load {:.2}, bvh {:.2}, points {:.2}, gather {:.2}, refine {:.2}, bounces {:.2}, estimate {:.2}, write {:.2}",
                s.total, stats.threads, s.load, s.bvh, s.points, s.gather, s.refine, s.bounces, s.estimate, s.write
            ),
        );
    if let Some(y) = yardstick {
        table.row(
            "yardstick",
            format!(
                "{:.2} s for the gather's rays alone; the bake took {:.1} times that",
                y.yardstick_seconds, y.total_over_yardstick
            ),
        );
    }
    table.text()
}
