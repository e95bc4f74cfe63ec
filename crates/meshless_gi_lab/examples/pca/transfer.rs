//! Transfer by principal components ([P14] §4.3): error, bytes and time by the number of
//! coefficients, compared with the sparse operator. The reference integrator gives the errors.

use meshless_gi::{
    Baked, BakedScene, FrameSettings, PcaRecipe, Preset, Progress, Recipe, TransportMethod,
    TriangleMesh, bake_scene,
};
use meshless_gi_lab::accuracy::{Axis, Chart, Format, Series, Style};
use meshless_gi_lab::report::{BOUNCES, TestSet, TestSetSize};
use std::error::Error;

/// Numbers of vectors of a basis.
const COEFFICIENTS: [u32; 7] = [1, 3, 10, 20, 30, 50, 100];
/// Numbers of senders per cluster.
const CLUSTERS: [u32; 3] = [50, 120, 400];
/// Size of the test set: lights that no bake used, and lit positions.
const TEST_SET: TestSetSize = TestSetSize {
    light_sources: 4,
    positions: 150,
    paths: 4096,
};

/// Results of one bake.
pub struct Made {
    pub preset: Preset,
    /// Number of coefficients. `None` for links to senders (method `bounded`).
    pub coefficients: Option<u32>,
    pub senders: usize,
    pub clusters: u64,
    pub columns: u64,
    /// Root mean square fraction of the training lights' direct light that the bases cannot
    /// represent.
    pub missed: f64,
    pub links: usize,
    /// Bytes of the operator: links, rows, and columns with their values.
    pub bytes: usize,
    /// Seconds of the bake. `None` if it was read from a file.
    pub seconds: Option<f64>,
    pub error: f64,
    pub interval: f64,
}

/// Measurements of one scene.
pub struct Transfer {
    pub name: String,
    /// Links to senders at draft. `by_count` has a series by the number of coefficients for each
    /// size of clusters.
    pub senders: Made,
    pub by_count: Vec<(u32, Vec<Made>)>,
    /// Links to senders, and ten coefficients in about 64 clusters, at medium.
    pub medium: [Made; 2],
}

fn made(
    test_set: &TestSet,
    preset: Preset,
    coefficients: Option<u32>,
    scene: &BakedScene,
    baked: Option<&Baked>,
) -> Made {
    let score = test_set.score(scene, &FrameSettings::bounces(BOUNCES));
    let operator = &scene.data().operator;
    let columns = operator.compression.as_ref().map_or(0, |c| c.bytes());
    Made {
        preset,
        coefficients,
        senders: scene.data().senders(),
        clusters: baked.map_or(0, |b| b.stats.clusters),
        columns: baked.map_or(0, |b| b.stats.components),
        missed: baked.map_or(0.0, |b| b.stats.basis_missed),
        links: operator.links.len(),
        bytes: size_of_val(&operator.links[..])
            + size_of_val(&operator.rows[..])
            + columns as usize,
        seconds: baked.map(|b| b.stats.seconds.total),
        error: score.errors.nrmse,
        interval: score.interval,
    }
}

/// Measures a scene. `medium` is its bake by method `bounded` at medium, which took `seconds`.
pub fn measure(
    name: &str,
    mesh: &TriangleMesh,
    medium: &BakedScene,
    seconds: Option<f64>,
) -> Result<Transfer, Box<dyn Error>> {
    let test_set =
        TestSet::new(mesh, &[], &TEST_SET, BOUNCES).ok_or("no light reaches a surface")?;
    let bake = |recipe: Recipe| -> Result<Made, Box<dyn Error>> {
        let baked = bake_scene(mesh, &recipe, 0, &Progress::default())?;
        let coefficients = match recipe.transport {
            TransportMethod::Pca(pca) => Some(pca.coefficients),
            _ => None,
        };
        let made = made(
            &test_set,
            recipe.preset,
            coefficients,
            &baked.scene,
            Some(&baked),
        );
        eprintln!(
            "{name}, {:?}, {:?} coefficients in {} clusters: {:.4}",
            made.preset, made.coefficients, made.clusters, made.error
        );
        Ok(made)
    };
    let draft = Recipe {
        preset: Preset::Draft,
        ..Recipe::default()
    };
    let mut by_count = Vec::new();
    for cluster_points in CLUSTERS {
        let mut of_size = Vec::new();
        for coefficients in COEFFICIENTS {
            of_size.push(bake(Recipe {
                transport: TransportMethod::Pca(PcaRecipe {
                    coefficients,
                    cluster_size: Some(cluster_points),
                    ..PcaRecipe::default()
                }),
                ..draft.clone()
            })?);
        }
        by_count.push((cluster_points, of_size));
    }
    let bases = bake(Recipe {
        transport: TransportMethod::pca(),
        ..Recipe::default()
    })?;
    let whole = Made {
        seconds,
        ..made(&test_set, Preset::Medium, None, medium, None)
    };
    Ok(Transfer {
        name: name.into(),
        senders: bake(draft)?,
        by_count,
        medium: [whole, bases],
    })
}

/// Returns the charts of error and size by the number of coefficients.
pub fn charts(t: &Transfer) -> [(String, Chart); 2] {
    let chart = |title: &str, label: &str, format, of: fn(&Made) -> f64| Chart {
        title: format!("{}: {title} by the number of coefficients", t.name),
        caption:
            "Preset Draft. Both axes are logarithmic. The horizontal line is the method bounded."
                .into(),
        x: Axis::log("coefficients of a cluster", Format::Number),
        y: Axis::log(label, format),
        series: (t.by_count.iter())
            .map(|(_, made)| {
                let name = format!("{} clusters", made[0].clusters);
                let counts = made
                    .iter()
                    .map(|m| (f64::from(m.coefficients.unwrap_or(0)), of(m)));
                Series::new(name, Style::LineAndPoints, counts)
            })
            .collect(),
        guides: vec![(of(&t.senders), "rule bounded".into())],
    };
    [
        (
            format!("transfer_error_{}.svg", t.name),
            chart("error", "error (NRMSE)", Format::Percent, |m| m.error),
        ),
        (
            format!("transfer_size_{}.svg", t.name),
            chart("operator", "bytes of the operator", Format::Si, |m| {
                m.bytes as f64
            }),
        ),
    ]
}
