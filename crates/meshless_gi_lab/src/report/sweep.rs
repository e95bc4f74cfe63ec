//! The sweep: the reference once, then bake after bake, each measured, within a limit of time.

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

/// Names the variants to try, for the settings that the baseline got.
pub type Choose = fn(&BakeSettings) -> Vec<Variant>;

/// Extent of a report.
#[derive(Clone, Debug)]
pub struct Sweep {
    /// The reference.
    pub test_set: TestSetSize,
    /// Baseline: baked first, and all others are variants of it.
    pub baseline: Variant,
    /// Further variants, most important first.
    pub choose: Choose,
    /// No bake begins that would probably end later than this after the start.
    pub limit: Duration,
    /// Ground truth of another program. Presets are compared with it too.
    pub known: Vec<ExternalReference>,
    /// Positions from which light can be seen, as in a recipe; found where empty.
    pub viewpoints: Vec<[f32; 3]>,
    /// Threads; 0 for one a processor.
    pub threads: usize,
}

impl Sweep {
    /// A handful of bakes.
    #[must_use]
    pub fn quick() -> Self {
        Self {
            test_set: TestSetSize {
                light_sources: 4,
                positions: 150,
                paths: 4096,
            },
            baseline: variant::baseline(),
            choose: variant::quick,
            limit: Duration::from_mins(10),
            known: Vec::new(),
            viewpoints: Vec::new(),
            threads: 0,
        }
    }

    /// Everything.
    #[must_use]
    pub fn full() -> Self {
        Self {
            test_set: TestSetSize {
                light_sources: 6,
                positions: 250,
                paths: 16_384,
            },
            choose: variant::full,
            limit: Duration::from_mins(25),
            ..Self::quick()
        }
    }
}

/// Another program's truth of the scene under some lights.
#[derive(Clone, Debug)]
pub struct ExternalReference {
    /// A word for the lights.
    pub name: String,
    /// Lights.
    pub lights: Vec<Light>,
    /// Reference under these lights.
    pub truth: GroundTruth,
}

/// Reason why there is no report.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReportError {
    /// No light was found that lights anything.
    #[error(
        "no light reaches a surface: the scene is empty, or its free space was not found; check the geometry or set `viewpoints`"
    )]
    Dark,
    /// A bake failed.
    #[error("{name}: {source}")]
    Bake {
        /// Name of the variant.
        name: String,
        /// Reason.
        source: BakeSceneError,
    },
    /// A bake could not be written.
    #[error("{name}: {source}")]
    Write {
        /// Name of the variant.
        name: String,
        /// Reason.
        source: AssetError,
    },
    /// A bake holds other settings than this version writes: a defect of this crate.
    #[error("{name}: the bake's own settings: {source}")]
    Settings {
        /// Name of the variant.
        name: String,
        /// Reason.
        source: RecipeError,
    },
    /// A measurement is no number: a defect of this crate. Please report it with the scene.
    #[error("{name}: the measured error is not finite")]
    NotFinite {
        /// Name of the variant.
        name: String,
    },
    /// No threads to work on.
    #[error("cannot start threads: {0}")]
    Threads(String),
}

/// Progress of a sweep.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// Steps done.
    pub done: usize,
    /// Steps in all.
    pub steps: usize,
    /// Current step.
    pub what: String,
}

/// Cost of accuracy on a scene.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// All that was tried, the baseline first.
    pub rows: Vec<Row>,
    /// Names of what was not tried for lack of time.
    pub left_out: Vec<String>,
    /// Reflections of the reference.
    pub bounces: u32,
    /// Standard error of the reference over its values, with as many reflections and with all.
    pub noise: (f64, f64),
    /// Positions and lights of the reference.
    pub positions: usize,
    /// See `positions`.
    pub light_sources: usize,
    /// Threads that baked and ran the frames.
    pub threads: usize,
    /// Triangles of the scene.
    pub triangles: usize,
    /// Seconds of the reference.
    pub reference_seconds: f64,
    /// Seconds in all.
    pub seconds: f64,
}

/// A finished bake and what it was made by: the next variant may want the same.
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

/// Sweeps `mesh`. `watch` is called before each step, with the progress of its bake.
///
/// # Errors
/// See [`ReportError`].
pub fn sweep(
    mesh: &TriangleMesh,
    sweep: &Sweep,
    progress: &Progress,
    watch: &(dyn Fn(&Step) + Sync),
) -> Result<Report, ReportError> {
    // One pool for all that is measured; bakes start as many threads of their own.
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(sweep.threads)
        .build()
        .map_err(|e| ReportError::Threads(e.to_string()))?;
    pool.install(|| run(mesh, sweep, progress, watch))
}

fn run(
    mesh: &TriangleMesh,
    sweep: &Sweep,
    progress: &Progress,
    watch: &(dyn Fn(&Step) + Sync),
) -> Result<Report, ReportError> {
    let began = Instant::now();
    let tell = |done: usize, steps: usize, what: String| {
        watch(&Step { done, steps, what });
    };
    tell(0, 2, "reference".into());
    let test_set =
        TestSet::new(mesh, &sweep.viewpoints, &sweep.test_set, BOUNCES).ok_or(ReportError::Dark)?;
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
    let beside = (mesh, &sweep.known[..]);
    tell(1, 2, sweep.baseline.name.clone());
    let mut last = bake(mesh, sweep, &sweep.baseline, progress)?;
    measure(&mut report, &last, &sweep.baseline, &test_set, beside)?;
    let unit = last.stats().seconds.total;
    let variants = (sweep.choose)(&last.settings);
    for (k, variant) in variants.iter().enumerate() {
        if variant.recipe != last.recipe {
            let until = began.elapsed().as_secs_f64() + unit * variant.cost;
            if until > sweep.limit.as_secs_f64() {
                report.left_out.push(variant.name.clone());
                continue;
            }
            tell(k + 2, variants.len() + 2, variant.name.clone());
            last = bake(mesh, sweep, variant, progress)?;
        }
        measure(&mut report, &last, variant, &test_set, beside)?;
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
