//! Sweep of a report: computes the reference once, then bakes and measures variants within a time
//! limit.

use super::measure::{Measured, Row};
use super::test_set::{TestSet, TestSetSize};
use super::variant::{self, BOUNCES, Factor, Variant};
use crate::accuracy::GroundTruth;
use meshless_gi::internals::bake::BakeSettings;
use meshless_gi::{
    AssetError, BakeSceneError, BakeStats, Baked, Light, Progress, Recipe, RecipeError,
    TriangleMesh, bake_scene,
};
use std::time::{Duration, Instant};

/// Function that returns the variants for the settings of the baseline.
pub type VariantFn = fn(&BakeSettings) -> Vec<Variant>;

/// Extent of a report.
#[derive(Clone, Debug)]
pub struct Sweep {
    /// Size of the reference.
    pub test_set: TestSetSize,
    /// Baseline. It is baked first, and all other variants derive from it.
    pub baseline: Variant,
    /// Further variants, most important first.
    pub create_variants: VariantFn,
    /// Time limit. A bake starts only if it will probably end within this time from the start of
    /// the sweep.
    pub limit: Duration,
    /// Ground truth of another program. Presets are also compared with it.
    pub known: Vec<ExternalReference>,
    /// Viewpoints, as in a recipe. They are searched for if empty.
    pub viewpoints: Vec<[f32; 3]>,
    /// Number of threads. 0 means one per processor.
    pub threads: usize,
}

impl Sweep {
    /// Returns a sweep with a few bakes.
    #[must_use]
    pub fn quick() -> Self {
        Self {
            test_set: TestSetSize {
                light_sources: 4,
                positions: 150,
                paths: 4096,
            },
            baseline: variant::baseline(),
            create_variants: variant::quick,
            limit: Duration::from_mins(10),
            known: Vec::new(),
            viewpoints: Vec::new(),
            threads: 0,
        }
    }

    /// Returns a sweep over all variants.
    #[must_use]
    pub fn full() -> Self {
        Self {
            test_set: TestSetSize {
                light_sources: 6,
                positions: 250,
                paths: 16_384,
            },
            create_variants: variant::full,
            limit: Duration::from_mins(25),
            ..Self::quick()
        }
    }
}

/// Ground truth of another program for the scene under some lights.
#[derive(Clone, Debug)]
pub struct ExternalReference {
    /// Name of the lights.
    pub name: String,
    /// Lights.
    pub lights: Vec<Light>,
    /// Reference under these lights.
    pub truth: GroundTruth,
}

/// Errors of a sweep.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReportError {
    /// Lights that reach no surface.
    #[error(
        "no light reaches a surface: the scene is empty, or its open space was not found; check the geometry or set `viewpoints`"
    )]
    NoLight,
    /// Failed bake.
    #[error("{name}: {source}")]
    Bake {
        /// Name of the variant.
        name: String,
        /// Reason of the failure.
        source: BakeSceneError,
    },
    /// Bake that could not be written.
    #[error("{name}: {source}")]
    Write {
        /// Name of the variant.
        name: String,
        /// Reason of the failure.
        source: AssetError,
    },
    /// Settings in a bake that this version does not write: a defect of this crate.
    #[error("{name}: the bake's own settings: {source}")]
    Settings {
        /// Name of the variant.
        name: String,
        /// Reason of the failure.
        source: RecipeError,
    },
    /// Measurement that is not finite: a defect of this crate. Please report it with the scene.
    #[error("{name}: the measured error is not finite")]
    NotFinite {
        /// Name of the variant.
        name: String,
    },
    /// Failure to start threads.
    #[error("cannot start threads: {0}")]
    Threads(String),
}

/// Progress of a sweep.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// Number of finished steps.
    pub done: usize,
    /// Total number of steps.
    pub steps: usize,
    /// Description of the current step.
    pub what: String,
}

/// Cost of accuracy on a scene.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// Rows of all measured variants, the baseline first.
    pub rows: Vec<Row>,
    /// Names of the variants that were skipped for lack of time.
    pub left_out: Vec<String>,
    /// Number of reflections of the reference.
    pub bounces: u32,
    /// Standard error of the reference over its values, with `bounces` reflections and with all.
    pub noise: (f64, f64),
    /// Number of positions of the reference.
    pub positions: usize,
    /// Number of lights of the reference.
    pub light_sources: usize,
    /// Number of threads of bakes and frames.
    pub threads: usize,
    /// Number of triangles of the scene.
    pub triangles: usize,
    /// Time of the reference, seconds.
    pub reference_seconds: f64,
    /// Total time, seconds.
    pub seconds: f64,
}

/// Last bake and its recipe. The next variant reuses it if its recipe is the same.
struct Last {
    recipe: Recipe,
    baked: Baked,
    settings: BakeSettings,
    bytes: u64,
}

impl Last {
    fn stats(&self) -> &BakeStats {
        &self.baked.stats
    }
}

/// Sweeps `mesh`. `on_step` is called before each step, with the progress of its bake.
///
/// # Errors
/// See [`ReportError`].
pub fn sweep(
    mesh: &TriangleMesh,
    sweep: &Sweep,
    progress: &Progress,
    on_step: &(dyn Fn(&Step) + Sync),
) -> Result<Report, ReportError> {
    // One thread pool for all measurements. Bakes start the same number of threads of their own.
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(sweep.threads)
        .build()
        .map_err(|e| ReportError::Threads(e.to_string()))?;
    pool.install(|| run(mesh, sweep, progress, on_step))
}

fn run(
    mesh: &TriangleMesh,
    sweep: &Sweep,
    progress: &Progress,
    on_step: &(dyn Fn(&Step) + Sync),
) -> Result<Report, ReportError> {
    let began = Instant::now();
    let report_step = |done: usize, steps: usize, what: String| {
        on_step(&Step { done, steps, what });
    };
    report_step(0, 2, "reference".into());
    let test_set = TestSet::new(mesh, &sweep.viewpoints, &sweep.test_set, BOUNCES)
        .ok_or(ReportError::NoLight)?;
    let mut report = Report {
        bounces: test_set.bounces(),
        noise: test_set.noise(),
        positions: test_set.positions().count(),
        light_sources: test_set.light_sources().len(),
        threads: rayon::current_num_threads(),
        triangles: mesh.len(),
        reference_seconds: began.elapsed().as_secs_f64(),
        ..Report::default()
    };
    let external = (mesh, &sweep.known[..]);
    report_step(1, 2, sweep.baseline.name.clone());
    let mut last = bake(mesh, sweep, &sweep.baseline, progress)?;
    measure(&mut report, &last, &sweep.baseline, &test_set, external)?;
    let unit = last.stats().seconds.total;
    let variants = (sweep.create_variants)(&last.settings);
    for (k, variant) in variants.iter().enumerate() {
        if variant.recipe != last.recipe {
            let until = began.elapsed().as_secs_f64() + unit * variant.cost;
            if until > sweep.limit.as_secs_f64() {
                report.left_out.push(variant.name.clone());
                continue;
            }
            report_step(k + 2, variants.len() + 2, variant.name.clone());
            last = bake(mesh, sweep, variant, progress)?;
        }
        measure(&mut report, &last, variant, &test_set, external)?;
    }
    report.seconds = began.elapsed().as_secs_f64();
    Ok(report)
}

fn bake(
    mesh: &TriangleMesh,
    sweep: &Sweep,
    variant: &Variant,
    progress: &Progress,
) -> Result<Last, ReportError> {
    let name = || variant.name.clone();
    let failed = |source| ReportError::Bake {
        name: name(),
        source,
    };
    let recipe = Recipe {
        viewpoints: sweep.viewpoints.clone(),
        ..variant.recipe.clone()
    };
    let baked = bake_scene(mesh, &recipe, sweep.threads, progress).map_err(failed)?;
    let bytes = baked
        .scene
        .to_bytes()
        .map_err(|source| ReportError::Write {
            name: name(),
            source,
        })?
        .len() as u64;
    let settings = BakeSettings::from_ron(&baked.scene.info().recipe).map_err(|source| {
        ReportError::Settings {
            name: name(),
            source,
        }
    })?;
    Ok(Last {
        recipe: variant.recipe.clone(),
        baked,
        settings,
        bytes,
    })
}

fn measure(
    report: &mut Report,
    last: &Last,
    variant: &Variant,
    test_set: &TestSet,
    (mesh, known): (&TriangleMesh, &[ExternalReference]),
) -> Result<(), ReportError> {
    let measured = Measured::new(
        &last.baked.scene,
        last.stats(),
        &last.settings,
        last.bytes,
        test_set,
    );
    let mut row = measured.row(variant, test_set);
    if variant.factor == Factor::Preset {
        row.known = known
            .iter()
            .map(|known| measured.compare(mesh, known))
            .collect();
    }
    if !row.is_finite() {
        return Err(ReportError::NotFinite {
            name: variant.name.clone(),
        });
    }
    report.rows.push(row);
    Ok(())
}
