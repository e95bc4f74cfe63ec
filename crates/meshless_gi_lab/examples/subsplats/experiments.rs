//! Experiments: views of every scene, tests of discontinuities along a path ([N09] Fig. 9),
//! resolutions and thresholds (Table 2, Fig. 10), thresholds of light, bumps.

use super::bumps::{self, BumpResult};
use super::gloss;
use super::subsplat_support::{LitScene, Measured, View};
use meshless_gi::{DepthTest, NormalTest, SubsplatSettings};
use std::error::Error;

/// Size of the screen, in pixels.
pub const SCREEN: [u32; 2] = [1920, 1080];
/// Size of the pictures along the path, in pixels.
pub const SMALL: [u32; 2] = [960, 540];
/// Number of positions of the path.
pub const PATH_POSITIONS: u32 = 8;
/// Measured finest levels.
pub const FINEST: [u32; 3] = [1, 2, 3];
/// Measured thresholds of the normal.
pub const NORMALS: [f32; 6] = [0.1, 0.25, 0.5, 1.0, 1.4, 2.0];
/// Measured thresholds of light.
pub const LIGHTS: [f32; 6] = [0.01, 0.015, 0.02, 0.03, 0.05, f32::INFINITY];

/// Results of one view of a scene at screen size, with the default settings.
pub struct Row {
    pub scene: String,
    pub view: usize,
    pub measured: Measured,
    /// Seconds at full resolution and with subsplats.
    pub seconds: [f64; 2],
}

/// Results of two tests with their thresholds along the path.
pub struct Pair {
    pub depth: DepthTest,
    pub normal: NormalTest,
    /// Results of each position.
    pub positions: Vec<Measured>,
    /// Mean number of subsplats without the test of diagonals, and mean FLIP.
    pub straight: (f64, f64),
}

impl Pair {
    pub fn count(&self) -> f64 {
        mean(&self.positions, |m| f64::from(m.counts.total()))
    }

    pub fn flip(&self) -> f64 {
        mean(&self.positions, |m| f64::from(m.flip))
    }
}

/// Results of a finest level and a threshold of the normal.
pub struct Cell {
    pub finest: u32,
    pub normal: f32,
    pub measured: Measured,
    pub seconds: [f64; 2],
}

/// Results of a threshold of light.
pub struct Light {
    pub scene: String,
    pub light: f32,
    pub measured: Measured,
}

/// All results.
pub struct Found {
    pub rows: Vec<Row>,
    /// Scene of the other experiments.
    pub on: String,
    pub pairs: Vec<Pair>,
    pub cells: Vec<Cell>,
    pub lights: Vec<Light>,
    pub bumpy: Vec<BumpResult>,
    pub gloss: gloss::Found,
}

fn mean(all: &[Measured], of: impl Fn(&Measured) -> f64) -> f64 {
    all.iter().map(of).sum::<f64>() / all.len().max(1) as f64
}

pub fn all(stages: &[LitScene]) -> Result<Found, Box<dyn Error>> {
    let last = stages.last().ok_or("no scene")?;
    let bumpy = bumps::measure();
    eprintln!("bumps are measured");
    let gloss = gloss::measure();
    let (mut rows, mut lights, mut cells) = (Vec::new(), Vec::new(), Vec::new());
    for (s, stage) in stages.iter().enumerate() {
        for i in 0..stage.scene.views.len() {
            let view = stage.view(i, SCREEN);
            let settings = SubsplatSettings::default();
            let full = view.full_seconds();
            rows.push(Row {
                scene: stage.scene.name.clone(),
                view: i,
                measured: view.measure(&settings),
                seconds: [full, view.subsplat_seconds(&settings)],
            });
            if i == 0 {
                lights.extend(LIGHTS.map(|light| Light {
                    scene: stage.scene.name.clone(),
                    light,
                    measured: view.measure(&SubsplatSettings {
                        radiance_threshold: light,
                        ..settings
                    }),
                }));
                if s + 1 == stages.len() {
                    cells = table(&view, full);
                }
            }
            eprintln!(
                "{} {i}: {:?}",
                stage.scene.name,
                rows[rows.len() - 1].measured
            );
        }
    }
    Ok(Found {
        rows,
        on: last.scene.name.clone(),
        pairs: measure_along_path(last),
        cells,
        lights,
        bumpy,
        gloss,
    })
}

/// Returns settings that refine by discontinuities alone, as in [N09].
fn discontinuity_settings(depth: DepthTest, normal: NormalTest) -> SubsplatSettings {
    SubsplatSettings {
        depth,
        normal,
        radiance_threshold: f32::INFINITY,
        ..SubsplatSettings::default()
    }
}

fn table(view: &View<'_>, full: f64) -> Vec<Cell> {
    let mut out = Vec::new();
    for finest in FINEST {
        for normal in NORMALS {
            let plain = SubsplatSettings::default();
            let settings = SubsplatSettings {
                finest_level: finest,
                ..discontinuity_settings(plain.depth, NormalTest::MinMax(normal))
            };
            out.push(Cell {
                finest,
                normal,
                measured: view.measure(&settings),
                seconds: [full, view.subsplat_seconds(&settings)],
            });
        }
    }
    out
}

/// Returns views on a path from the first view to the second, with interpolated targets.
fn path(stage: &LitScene) -> Vec<View<'_>> {
    let [(a, at), (b, bt), _] = stage.scene.views;
    let position = |k: u32| {
        let t = k as f32 / (PATH_POSITIONS - 1) as f32;
        View::new(stage, a.lerp(b, t), at.lerp(bt, t), SMALL)
    };
    (0..PATH_POSITIONS).map(position).collect()
}

fn measure_along_path(stage: &LitScene) -> Vec<Pair> {
    let views = path(stage);
    let with = |settings: &SubsplatSettings, step: usize| -> Vec<Measured> {
        let chosen = views.iter().step_by(step);
        chosen.map(|view| view.measure(settings)).collect()
    };
    let flip = |settings: &SubsplatSettings| mean(&with(settings, 2), |m| f64::from(m.flip));
    let plain = SubsplatSettings::default();
    let goal = flip(&discontinuity_settings(plain.depth, plain.normal));
    let mut out = Vec::new();
    for normal in 0..2 {
        for depth in 0..3 {
            // One factor scales both thresholds.
            let at = |factor: f32| {
                let depth = match depth {
                    0 => DepthTest::Plane(0.05 * factor),
                    1 => DepthTest::MinMax(0.1 * factor),
                    _ => DepthTest::Derivative(0.02 * factor),
                };
                let normal = match normal {
                    0 => NormalTest::MinMax((1.0 * factor).min(2.0)),
                    _ => NormalTest::Curvature((0.5 * factor).min(2.0)),
                };
                discontinuity_settings(depth, normal)
            };
            let (mut low, mut high) = (-4.0f32, 4.0f32);
            for _ in 0..5 {
                let middle = 0.5 * (low + high);
                // Larger thresholds give fewer subsplats and a larger difference.
                if flip(&at(middle.exp2())) > goal {
                    high = middle;
                } else {
                    low = middle;
                }
            }
            let settings = at((0.5 * (low + high)).exp2());
            let straight = with(
                &SubsplatSettings {
                    diagonal: false,
                    ..settings
                },
                1,
            );
            out.push(Pair {
                depth: settings.depth,
                normal: settings.normal,
                positions: with(&settings, 1),
                straight: (
                    mean(&straight, |m| f64::from(m.counts.total())),
                    mean(&straight, |m| f64::from(m.flip)),
                ),
            });
            eprintln!("{:?} {:?}", settings.depth, settings.normal);
        }
    }
    out
}
