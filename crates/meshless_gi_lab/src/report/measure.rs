//! Measurements of one bake: its costs (bake time, file size, frame time) and its errors.

use super::sweep::ExternalReference;
use super::test_set::{TestScore, TestSet};
use super::variant::{BOUNCES, Factor, Run, Variant};
use crate::accuracy::BOUNCES as BOUNCES_OF_TRUTH;
use glam::Vec3;
use meshless_gi::internals::bake::BakeSettings;
use meshless_gi::{
    BakeStats, BakedScene, Bounces, CpuFrame, Evaluator, FrameLight, FrameSettings, Light,
    TransportMethod, TriangleMesh,
};
use serde::Serialize;
use std::time::{Duration, Instant};

/// Maximum number of frames of which the median time is taken.
const FRAMES: usize = 9;
/// Time after which no more frames are measured. At least three are measured.
const MEASUREMENT_TIME: Duration = Duration::from_secs(2);
/// Number of positions in the measurement of the display time.
const SPLAT_POSITIONS: usize = 20_000;

/// Baked and measured configuration.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RowSettings {
    /// Difference from the baseline.
    pub factor: Factor,
    /// Short name of the variant.
    pub name: String,
    /// Recipe as a user writes it.
    pub recipe: String,
    /// Operator tier of the frame, from 1.
    pub tier: u32,
    /// Settings of the bake after all defaults are applied. `bounces` is that of the frame.
    #[serde(flatten)]
    pub baked: BakeSettings,
}

/// Row of a report. All numbers are finite.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Baked and measured configuration.
    pub settings: RowSettings,
    /// Bake time, seconds, without reading the scene and writing the file.
    pub bake_seconds: f64,
    /// Median CPU time of a frame after one light has moved, milliseconds: projection, all
    /// reflections, the operator, flattening.
    pub frame_ms: f64,
    /// Display time of a thousand positions on one thread, milliseconds.
    pub splat_ms_per_1000: f64,
    /// Size of the container, bytes.
    pub bytes: u64,
    /// Number of links that the frame used.
    pub links: u64,
    /// Number of points of all levels.
    pub points: u64,
    /// Number of senders.
    pub senders: u64,
    /// NRMSE of indirect irradiance against the reference with 4 reflections. The noise of the
    /// reference is subtracted.
    pub nrmse: f64,
    /// Half width of the 95 % confidence interval of `nrmse`.
    pub nrmse_interval: f64,
    /// 99th percentile of the errors, over the root mean square of the reference.
    pub p99: f64,
    /// Mean error over the mean.
    pub bias: f64,
    /// NRMSE against the reference with all reflections.
    pub nrmse_all: f64,
    /// Fraction of the positions that no basis function covers.
    pub uncovered: f64,
    /// NRMSE estimate of the bake itself.
    pub estimated_nrmse: f64,
    /// Half width of the 95 % confidence interval of `estimated_nrmse`.
    pub estimated_nrmse_interval: f64,
    /// Largest rounding error of a link in half precision, over the largest link of its row.
    pub link_error: f64,
    /// Comparisons with another program's ground truth, for presets only. Empty if there is none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub known: Vec<ExternalComparison>,
}

/// Errors against another program's ground truth with the same number of reflections.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ExternalComparison {
    /// Name of the lights.
    pub name: String,
    /// [`Row::nrmse`] against this ground truth.
    pub nrmse: f64,
    /// [`Row::bias`] against this ground truth.
    pub bias: f64,
    /// [`Row::p99`] against this ground truth.
    pub p99: f64,
}

/// Bake that is measured under one or several runs.
pub struct Measured<'a> {
    /// Baked scene.
    pub scene: &'a BakedScene,
    /// Statistics of the bake.
    pub stats: &'a BakeStats,
    /// Settings of the bake.
    pub settings: &'a BakeSettings,
    /// Size of its container, bytes.
    pub bytes: u64,
    /// Display time of a thousand positions, milliseconds.
    pub splat_ms_per_1000: f64,
}

impl<'a> Measured<'a> {
    /// Measures the values that do not depend on the run.
    #[must_use]
    pub fn new(
        scene: &'a BakedScene,
        stats: &'a BakeStats,
        settings: &'a BakeSettings,
        bytes: u64,
        test_set: &TestSet,
    ) -> Self {
        Self {
            scene,
            stats,
            settings,
            bytes,
            splat_ms_per_1000: splat_ms_per_1000(scene, test_set),
        }
    }

    /// Measures one run.
    #[must_use]
    pub fn row(&self, variant: &Variant, test_set: &TestSet) -> Row {
        let settings = frame_settings(self.scene, variant.run);
        let TestScore {
            errors,
            interval,
            all,
            uncovered,
        } = test_set.score(self.scene, &settings);
        let info = &self.scene.info();
        let tier = variant.run.tier.clamp(1, info.tiers.len().max(1) as u32);
        let used = info.tiers.get(tier as usize - 1).copied();
        let used = used.unwrap_or_default();
        Row {
            settings: RowSettings {
                factor: variant.factor,
                name: variant.name.clone(),
                recipe: variant.recipe_text(),
                tier,
                baked: BakeSettings {
                    bounces: variant.run.bounces,
                    ..self.settings.clone()
                },
            },
            bake_seconds: self.stats.seconds.total,
            frame_ms: frame_ms(self.scene, &settings, test_set),
            splat_ms_per_1000: self.splat_ms_per_1000,
            bytes: self.bytes,
            links: used.links,
            points: self.stats.points_per_level.iter().sum(),
            senders: self.stats.senders,
            nrmse: errors.nrmse,
            nrmse_interval: interval,
            p99: errors.p99,
            bias: errors.bias,
            nrmse_all: all.nrmse,
            uncovered,
            estimated_nrmse: f64::from(used.estimated_nrmse),
            estimated_nrmse_interval: f64::from(used.estimated_nrmse_interval),
            link_error: f64::from(info.link_error),
            known: Vec::new(),
        }
    }

    /// Compares the bake with the external reference `known` of its scene.
    #[must_use]
    pub fn compare(&self, mesh: &TriangleMesh, known: &ExternalReference) -> ExternalComparison {
        let k = BOUNCES_OF_TRUTH.iter().position(|b| *b == Some(BOUNCES));
        let evaluator = Evaluator::new(
            self.scene,
            std::slice::from_ref(mesh),
            &known.lights,
            Bounces::Count(BOUNCES),
        );
        let found = known.truth.compare(&evaluator, k.unwrap_or(0)).indirect;
        ExternalComparison {
            name: known.name.clone(),
            nrmse: found.nrmse,
            bias: found.bias,
            p99: found.p99,
        }
    }
}

impl Row {
    /// Returns the error, or its upper bound if it is below the confidence interval.
    #[must_use]
    pub fn error_or_bound(&self) -> f64 {
        self.nrmse.max(self.nrmse_interval)
    }

    /// Returns `true` if the bake is by `method`, with any parameters.
    #[must_use]
    pub fn has_method(&self, method: &TransportMethod) -> bool {
        self.settings.baked.transport.is_same_method(method)
    }

    /// Returns `true` if all values are finite. Reports require it.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        [
            self.bake_seconds,
            self.frame_ms,
            self.splat_ms_per_1000,
            self.nrmse,
            self.nrmse_interval,
            self.p99,
            self.bias,
            self.nrmse_all,
            self.uncovered,
            self.estimated_nrmse,
            self.estimated_nrmse_interval,
            self.link_error,
        ]
        .iter()
        .chain(self.known.iter().flat_map(|k| [&k.nrmse, &k.bias, &k.p99]))
        .all(|v| v.is_finite())
    }
}

/// Returns the settings of a frame.
fn frame_settings(scene: &BakedScene, run: Run) -> FrameSettings {
    FrameSettings {
        baked_bounces: scene.info().bounces == run.bounces,
        emission: 0.0,
        tier: run.tier,
        ..FrameSettings::bounces(run.bounces)
    }
}

/// Measures the milliseconds of a frame in which one light has moved.
fn frame_ms(scene: &BakedScene, settings: &FrameSettings, test_set: &TestSet) -> f64 {
    let Some(&Light::Point {
        position,
        intensity,
        range,
    }) = test_set.light_sources().first()
    else {
        return 0.0;
    };
    let bounds = scene.info().bounds.map(Vec3::from_array);
    let step = 1e-4 * (bounds[1] - bounds[0]).max_element();
    let mut frame = CpuFrame::new(scene);
    let mut times = Vec::new();
    let began = Instant::now();
    // The first frame allocates and is not counted.
    for k in 0..=FRAMES {
        if times.len() >= 3 && began.elapsed() > MEASUREMENT_TIME {
            break;
        }
        let position = position + Vec3::splat(step * k as f32);
        let light_source = FrameLight::point(position, intensity, range);
        let start = Instant::now();
        frame.set_lights(scene, &[light_source]);
        frame.solve(scene, settings);
        if k > 0 {
            times.push(start.elapsed().as_secs_f64() * 1e3);
        }
    }
    median(&mut times)
}

/// Measures the milliseconds of the display of a thousand positions.
fn splat_ms_per_1000(scene: &BakedScene, test_set: &TestSet) -> f64 {
    let positions: Vec<_> = test_set.positions().collect();
    let frame = CpuFrame::new(scene);
    let rounds = SPLAT_POSITIONS.div_ceil(positions.len().max(1));
    let mut times: Vec<f64> = (0..rounds)
        .map(|_| {
            let start = Instant::now();
            for &(x, n) in &positions {
                // Prevents the compiler from removing the evaluation.
                std::hint::black_box(frame.irradiance(scene, x, n));
            }
            start.elapsed().as_secs_f64() * 1e6 / positions.len().max(1) as f64
        })
        .collect();
    median(&mut times)
}

fn median(times: &mut [f64]) -> f64 {
    times.sort_by(f64::total_cmp);
    times.get(times.len() / 2).copied().unwrap_or(0.0)
}
