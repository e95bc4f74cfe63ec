//! Principal components ([P14]) measured by the number of coefficients: soft shadows of a panel
//! from precomputed visibility, and transfer by bases of direct light. The reference integrator
//! gives the errors. Writes the document, its charts and pictures:
//!
//! ```text
//! cargo run --release -p meshless_gi_lab --example pca -- -o docs/reports
//! [--part visibility|transfer|scene] [--bakes FOLDER] [path/to/scene]
//! ```
//!
//! writes `docs/reports/pca_visibility.md`, `docs/reports/pca_transfer.md` and `docs/reports/pca/`,
//! or only one of the three parts. `FOLDER/NAME.mgi` replaces a bake at medium, and is written if
//! it does not exist. On the scene (a `.glb`, or a folder with `L0.json` that names one) both kinds
//! of operator are compared. The default is the Cornell box.

mod comparison;
mod document;
mod picture;
mod transfer;
mod visibility;

use glam::Vec3;
use meshless_gi::internals::frame::project::extent;
use meshless_gi::internals::scene::SceneDescription;
use meshless_gi::{
    BakedScene, Light, Limits, Preset, Progress, Recipe, TriangleMesh, bake_scene, load_gltf,
};
use meshless_gi_lab::report::split_sentences;
use std::error::Error;
use std::path::{Path, PathBuf};
use visibility::{SplitResult, VisibilityTiming};

/// Names of the published scenes.
const SCENES: [&str; 2] = ["cornell", "rooms_open"];
/// Parts: the document on visibility, and two of the document on transfer.
const PARTS: [&str; 3] = ["visibility", "transfer", "scene"];

fn main() -> Result<(), Box<dyn Error>> {
    let usage = "usage: pca -o FOLDER [--part visibility|transfer|scene] [--bakes FOLDER] [SCENE.glb|FOLDER]";
    let (mut folder, mut bakes, mut scene, mut part) = (None, None, None, None);
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "-o" => folder = Some(PathBuf::from(args.next().ok_or(usage)?)),
            "--bakes" => bakes = Some(PathBuf::from(args.next().ok_or(usage)?)),
            "--part" => part = Some(args.next().ok_or(usage)?),
            _ if arg.starts_with('-') || scene.is_some() => return Err(usage.into()),
            _ => scene = Some(PathBuf::from(arg)),
        }
    }
    let wanted = part.as_deref().map_or(Ok([true; 3]), |part| {
        let of = PARTS.map(|p| p == part);
        if of.contains(&true) {
            Ok(of)
        } else {
            Err(usage)
        }
    })?;
    let folder = folder.ok_or(usage)?;
    let (name, compared) = named(&scene.unwrap_or_else(|| file(SCENES[0])))?;
    let pictures = folder.join("pca");
    std::fs::create_dir_all(&pictures)?;
    let transfer = folder.join("pca_transfer.md");
    let mut parts = document::parts(&std::fs::read_to_string(&transfer).unwrap_or_default());
    let (mut found, mut transfers) = (Vec::new(), Vec::new());
    for name in SCENES {
        let mesh = load_gltf(file(name))?.mesh;
        if !wanted[0] && !wanted[1] {
            continue;
        }
        let (scene, seconds) = baked(name, &mesh, bakes.as_deref())?;
        if wanted[0] {
            found.push(visibility::measure(name, &mesh, &scene, &pictures)?);
        }
        if wanted[1] {
            transfers.push(transfer::measure(name, &mesh, &scene, seconds)?);
        }
    }
    if wanted[0] {
        let mut timings: Vec<VisibilityTiming> =
            found.iter_mut().flat_map(|f| f.timings.drain(..)).collect();
        let (more, split_results) = measure_splits(&name, &compared)?;
        timings.extend(more);
        std::fs::write(pictures.join("coefficients.svg"), document::chart(&found))?;
        let text = document::text(&found, &timings, &name, &split_results);
        std::fs::write(folder.join("pca_visibility.md"), split_sentences(&text))?;
    }
    if wanted[1] {
        for (file, chart) in transfers.iter().flat_map(transfer::charts) {
            std::fs::write(pictures.join(file), chart.svg())?;
        }
        parts[0] = document::transfer(&transfers);
    }
    if wanted[2] {
        let report = comparison::measure(&name, &compared)?;
        let figures = comparison::charts(&name, &report);
        for figure in &figures {
            std::fs::write(pictures.join(&figure.file), figure.chart.svg())?;
        }
        parts[1] = comparison::section(&name, &report, &figures);
    }
    if wanted[1] || wanted[2] {
        std::fs::write(transfer, split_sentences(&parts.join("\n")))?;
    }
    Ok(())
}

/// Compares ray visibility with baked visibility at draft on a scene, below a panel at the first
/// viewpoint. Also measures the effect of split clusters.
fn measure_splits(
    name: &str,
    mesh: &TriangleMesh,
) -> Result<(Vec<VisibilityTiming>, Vec<SplitResult>), Box<dyn Error>> {
    let recipe = Recipe {
        preset: Preset::Draft,
        ..Recipe::default()
    };
    let baked = bake_scene(mesh, &recipe, 0, &Progress::default())?;
    let scene = baked.scene;
    let center = scene.info().viewpoints.first().ok_or("no viewpoint")?;
    let half = 0.02 * extent(scene.data());
    let panel = Light::Rect {
        center: (*center).into(),
        u: Vec3::X * half,
        v: Vec3::Z * half,
        radiance: Vec3::ONE,
    };
    visibility::split_results(name, mesh, &scene, &panel)
}

/// Returns the path of a published scene.
fn file(name: &str) -> PathBuf {
    let file = format!("tests/data/{name}/{name}.glb");
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join(file)
}

/// Reads a scene from its file, or from a folder with a description of it.
fn named(path: &Path) -> Result<(String, TriangleMesh), Box<dyn Error>> {
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let description = path.join("L0.json");
    let mesh = match path.is_dir() {
        true => {
            let scene = SceneDescription::read(&description)?;
            load_gltf(scene.geometry.first().ok_or("a scene without geometry")?)?.mesh
        }
        false => load_gltf(path)?.mesh,
    };
    Ok((name.into_owned(), mesh))
}

/// Returns the bake at medium and its seconds. The seconds are `None` if it was read from a file.
fn baked(
    name: &str,
    mesh: &TriangleMesh,
    bakes: Option<&Path>,
) -> Result<(BakedScene, Option<f64>), Box<dyn Error>> {
    let file = bakes.map(|folder| folder.join(format!("{name}.mgi")));
    if let Some(file) = file.as_deref().filter(|f| f.exists()) {
        return Ok((BakedScene::read(file, &Limits::default())?, None));
    }
    eprintln!("baking {name}");
    let baked = bake_scene(mesh, &Recipe::default(), 0, &Progress::default())?;
    if let Some(file) = file {
        baked.scene.write(&file)?;
    }
    Ok((baked.scene, Some(baked.stats.seconds.total)))
}
