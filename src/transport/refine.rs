//! Which receivers get a row of their own, and their rows: the driver of rule `bounded`.
//!
//! Like [L08] Figure 5 it goes down the receiver hierarchy level by level and refines only where it must. Where [L08] looks at single links,
//! this looks at what the rows would say for a set of training lights: a receiver whose parents already say the same, within a tolerance
//! relative to the light's root mean square, takes its value from them (the `flatten` kernel interpolates) and its children are not looked
//! at. Rows that are kept stand alone: they replace the interpolated value, not a difference to it, so nothing cancels and nothing is lost.

use super::bounded::{CutScratch, SenderTree, cut_row};
use super::gather::{GatherScene, Gathered, gather};
use crate::basis::Weights;
use glam::{Vec3, Vec3A};
use rayon::prelude::*;
use std::time::{Duration, Instant};

/// Training lights a bake uses.
pub const SIGNALS: usize = 16;

/// The vector irradiance at a point for each training light, and for a sky of unit radiosity.
type Response = [Vec3A; SIGNALS + 1];

/// Radiosity of every sender for every training light, W/m².
pub type Signals = [[f32; SIGNALS]];

/// A row before packing.
#[derive(Clone, Debug, Default)]
pub struct RawRow {
    /// Senders and their F_ij, senders ascending.
    pub links: Vec<(u32, Vec3A)>,
    /// False where the point takes its value from its parents.
    pub active: bool,
}

/// The rows of all points and what came with them.
#[derive(Debug, Default)]
pub struct Refined {
    /// One a point.
    pub rows: Vec<RawRow>,
    /// (1/π) ∫ ω dω over the sky, for every point.
    pub sky: Vec<Vec3>,
    /// Mean share of the gathered light that met a surface which no sender covers.
    pub uncovered: f64,
    /// Receivers that were gathered.
    pub gathered: u64,
    /// Rays cast.
    pub rays: u64,
    /// Largest row sum Σ F·n that was seen.
    pub largest_row_sum: f32,
    /// Share of the processor time that went into gathering; the rest went into deciding.
    pub gather_share: f64,
}

/// What rule `bounded` may lose.
#[derive(Clone, Copy, Debug)]
pub struct BoundedSettings {
    /// Bound on what a row blurs, relative to its mass, see [`super::bounded`].
    pub epsilon: f32,
    /// Difference to the parents' value, relative to the root mean square of the light, below which a receiver needs no row.
    pub tolerance: f32,
    /// Levels whose points always get a row.
    pub always: usize,
}

struct Gather1 {
    row: RawRow,
    response: Response,
    sky: Vec3A,
    uncovered: f32,
    row_sum: f32,
    gather_time: Duration,
    other_time: Duration,
}

/// Gathers and cuts the rows of all receivers. `parents` are those of the nearest coarser level. `progress` is told how much is done and may stop
/// the work by answering false; then nothing comes back.
pub fn refine_bounded(
    scene: &GatherScene<'_>,
    parents: &Weights,
    tree: &SenderTree,
    signals: &Signals,
    settings: &BoundedSettings,
    progress: &(dyn Fn(f32) -> bool + Sync),
) -> Option<Refined> {
    let hierarchy = scene.hierarchy;
    let points = hierarchy.len();
    let senders = tree.parent.len();
    let mut out = Refined {
        rows: Vec::with_capacity(points),
        sky: Vec::with_capacity(points),
        ..Refined::default()
    };
    let mut responses: Vec<Response> = Vec::with_capacity(points);
    let mut errors: Vec<f32> = Vec::with_capacity(points);
    // Root mean square of each training light over the points that always have a row; known once those are gathered.
    let mut inverse_square = [0.0f32; SIGNALS + 1];
    let mut uncovered = 0.0f64;
    let mut times = [Duration::ZERO; 2];
    for l in 0..hierarchy.levels.len() {
        let level = hierarchy.level(l);
        let wanted: Vec<bool> = level
            .clone()
            .map(|i| {
                let row = parents.row(i);
                l < settings.always
                    || row.is_empty()
                    || row.iter().any(|w| errors[w.index as usize] > settings.tolerance)
            })
            .collect();
        let mut results: Vec<Option<Gather1>> = Vec::with_capacity(level.len());
        const CHUNK: usize = 1024;
        for chunk in level.clone().collect::<Vec<_>>().chunks(CHUNK) {
            results.par_extend(chunk.par_iter().map_init(
                || (Gathered::new(senders), CutScratch::default()),
                |(gathered, scratch), &i| {
                    wanted[i - level.start].then(|| {
                        let began = Instant::now();
                        gather(scene, i, gathered);
                        let gather_time = began.elapsed();
                        let mut response = [Vec3A::ZERO; SIGNALS + 1];
                        let mut row_sum = Vec3A::ZERO;
                        for &j in &gathered.touched {
                            let link = gathered.link(j);
                            row_sum += link;
                            for (e, &b) in response.iter_mut().zip(&signals[j as usize]) {
                                *e += link * b;
                            }
                        }
                        response[SIGNALS] = gathered.sky;
                        let links = cut_row(gathered, tree, settings.epsilon, scratch);
                        Gather1 {
                            row: RawRow { links, active: true },
                            response,
                            gather_time,
                            other_time: began.elapsed() - gather_time,
                            sky: gathered.sky,
                            uncovered: gathered.uncovered,
                            row_sum: row_sum.dot(hierarchy.surfaces[i].normal.into()),
                        }
                    })
                },
            ));
            if !progress((level.start + results.len()) as f32 / points as f32) {
                return None;
            }
        }
        for (i, result) in level.clone().zip(results) {
            let n = Vec3A::from(hierarchy.surfaces[i].normal);
            let mut expected = [Vec3A::ZERO; SIGNALS + 1];
            let row = parents.row(i);
            for w in row {
                for (e, p) in expected.iter_mut().zip(&responses[w.index as usize]) {
                    *e += w.weight * *p;
                }
            }
            let Some(one) = result else {
                out.sky.push(expected[SIGNALS].into());
                out.rows.push(RawRow::default());
                responses.push(expected);
                errors.push(0.0);
                continue;
            };
            out.gathered += 1;
            times[0] += one.gather_time;
            times[1] += one.other_time;
            uncovered += f64::from(one.uncovered);
            out.largest_row_sum = out.largest_row_sum.max(one.row_sum);
            let error = if row.is_empty() {
                f32::INFINITY
            } else {
                difference(&one.response, &expected, n, &inverse_square)
            };
            let keep = l < settings.always || error > 0.5 * settings.tolerance;
            errors.push(error);
            if keep {
                out.sky.push(one.sky.into());
                responses.push(one.response);
                out.rows.push(one.row);
            } else {
                out.sky.push(expected[SIGNALS].into());
                responses.push(expected);
                out.rows.push(RawRow::default());
            }
        }
        if l < settings.always {
            inverse_square = mean_squares(&responses, hierarchy).map(|s| if s > 0.0 { 1.0 / s } else { 0.0 });
        }
    }
    out.rays = out.gathered * u64::from(scene.rays);
    out.uncovered = uncovered / out.gathered.max(1) as f64;
    out.gather_share = share(times);
    Some(out)
}

/// The first of two times over their sum.
pub(super) fn share([first, second]: [Duration; 2]) -> f64 {
    first.as_secs_f64() / (first + second).as_secs_f64().max(1e-9)
}

fn mean_squares(responses: &[Response], hierarchy: &crate::basis::Hierarchy) -> [f32; SIGNALS + 1] {
    let mut sums = [0.0f64; SIGNALS + 1];
    for (response, surface) in responses.iter().zip(&hierarchy.surfaces) {
        for (s, e) in sums.iter_mut().zip(response) {
            *s += f64::from(e.dot(surface.normal.into())).powi(2);
        }
    }
    sums.map(|s| (s / responses.len().max(1) as f64) as f32)
}

/// Root mean square over the training lights of the difference, relative to each light's root mean square. The part along the normal counts
/// whole; the tangential part, which only normal maps see, a tenth of its square.
fn difference(a: &Response, b: &Response, n: Vec3A, inverse_square: &[f32; SIGNALS + 1]) -> f32 {
    let mut sum = 0.0;
    for ((a, b), inverse) in a.iter().zip(b).zip(inverse_square) {
        let d = *a - *b;
        sum += (0.9 * d.dot(n).powi(2) + 0.1 * d.length_squared()) * inverse;
    }
    (sum / (SIGNALS + 1) as f32).sqrt()
}
