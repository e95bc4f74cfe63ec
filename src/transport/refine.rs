//! Which receivers get a row of their own, and their rows: the driver of rule `bounded`.
//!
//! Like [L08] Figure 5 it goes down the receiver hierarchy level by level and refines only where it must. Where [L08] looks at single links,
//! this looks at what the rows would say for a set of training lights: a receiver whose parents already say the same, within a tolerance
//! relative to the light's root mean square, takes its value from them (the `flatten` kernel interpolates) and its children are not looked
//! at. Rows that are kept stand alone: they replace the interpolated value, not a difference to it, so nothing cancels and nothing is lost.

use super::bounded::{CutMeasure, CutScratch, SenderTree, cut_row};
use super::gather::{GatherScene, Gathered, Gathering, gather};
use crate::basis::{Hierarchy, HierarchySettings, WeightEntry, Weights};
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
    /// Bound on what a row blurs, relative to the light's root mean square, see [`super::bounded`].
    pub epsilon: f32,
    /// Difference to the parents' value, relative to the root mean square of the light, below which a receiver needs no row.
    pub tolerance: f32,
    /// Levels whose points always get a row.
    pub always: usize,
    /// Levels that may be added, where receivers differ from their parents.
    pub extra_levels: usize,
    /// Most points that all added levels may have together.
    pub extra_points: usize,
}

/// What refinement works on, and what it adds to.
pub struct Receivers<'a> {
    /// The points; finer levels are added at the end.
    pub hierarchy: &'a mut Hierarchy,
    /// Their parents, those of the nearest coarser level; rows are added with the levels.
    pub parents: &'a mut Weights,
    /// How the hierarchy was built.
    pub building: &'a HierarchySettings,
}

struct Gather1 {
    row: RawRow,
    response: Response,
    error: f32,
    uncovered: f32,
    row_sum: f32,
    gather_time: Duration,
    other_time: Duration,
}

/// Gathers and cuts the rows of all receivers, and adds finer receivers where those of the finest level still differ from what their parents say. `progress` is told how much is done and may stop
/// the work by answering false; then nothing comes back.
pub fn refine_bounded(
    gathering: &Gathering<'_>,
    receivers: &mut Receivers<'_>,
    tree: &SenderTree,
    signals: &Signals,
    settings: &BoundedSettings,
    progress: &(dyn Fn(f32) -> bool + Sync),
) -> Option<Refined> {
    let senders = tree.parent.len();
    let mut out = Refined::default();
    let mut responses: Vec<Response> = Vec::new();
    let mut errors: Vec<f32> = Vec::new();
    let inverse_square =
        coarse_mean_squares(&gathering.scene(receivers.hierarchy), senders, signals)
            .map(|s| if s > 0.0 { 1.0 / s } else { 0.0 });
    let mut of_lights = [0.0; SIGNALS];
    of_lights.copy_from_slice(&inverse_square[..SIGNALS]);
    let measure = CutMeasure {
        signals,
        inverse_square: &of_lights,
        epsilon: settings.epsilon,
    };
    let mut uncovered = 0.0f64;
    let mut times = [Duration::ZERO; 2];
    let base_levels = receivers.hierarchy.levels.len();
    let mut extra_points = settings.extra_points;
    let mut l = 0;
    loop {
        if l == receivers.hierarchy.levels.len() {
            // Ask for more where the last level's receivers were far from their parents, the farthest first.
            if l >= base_levels + settings.extra_levels || extra_points == 0 {
                break;
            }
            let mut wanting: Vec<usize> = receivers
                .hierarchy
                .level(l - 1)
                .filter(|&i| errors[i] > settings.tolerance)
                .collect();
            wanting.sort_by(|&a, &b| errors[b].total_cmp(&errors[a]).then(a.cmp(&b)));
            wanting.truncate((extra_points / 4).max(1));
            let added = receivers.hierarchy.add_level(
                gathering.geometry,
                &wanting,
                extra_points,
                receivers.building,
            );
            if added == 0 {
                break;
            }
            extra_points -= added;
            receivers
                .hierarchy
                .append_parents(l, false, receivers.parents);
        }
        let hierarchy = &*receivers.hierarchy;
        let parents = &*receivers.parents;
        let scene = &gathering.scene(hierarchy);
        let points = hierarchy.len();
        let level = hierarchy.level(l);
        let wanted: Vec<bool> = level
            .clone()
            .map(|i| {
                let row = parents.row(i);
                l < settings.always
                    || row.is_empty()
                    || row
                        .iter()
                        .any(|w| errors[w.index as usize] > settings.tolerance)
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
                        let (halves, row_sum) = respond(gathered, signals);
                        let n = hierarchy.surfaces[i].normal.into();
                        let error = if parents.row(i).is_empty() {
                            f32::INFINITY
                        } else {
                            difference(
                                &halves,
                                &interpolate(&responses, parents.row(i)),
                                n,
                                &inverse_square,
                            )
                        };
                        let response = std::array::from_fn(|t| halves[0][t] + halves[1][t]);
                        let links = cut_row(gathered, tree, n, &measure, scratch);
                        Gather1 {
                            row: RawRow {
                                links,
                                active: true,
                            },
                            response,
                            error,
                            gather_time,
                            other_time: began.elapsed() - gather_time,
                            uncovered: gathered.uncovered,
                            row_sum: row_sum.dot(n),
                        }
                    })
                },
            ));
            if !progress((level.start + results.len()) as f32 / points as f32) {
                return None;
            }
        }
        for (i, result) in level.clone().zip(results) {
            let Some(one) = result else {
                let expected = interpolate(&responses, parents.row(i));
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
            let keep = l < settings.always || one.error > 0.5 * settings.tolerance;
            errors.push(one.error);
            if keep {
                out.sky.push(one.response[SIGNALS].into());
                responses.push(one.response);
                out.rows.push(one.row);
            } else {
                let expected = interpolate(&responses, parents.row(i));
                out.sky.push(expected[SIGNALS].into());
                responses.push(expected);
                out.rows.push(RawRow::default());
            }
        }
        l += 1;
    }
    out.rays = out.gathered * u64::from(gathering.rays);
    out.uncovered = uncovered / out.gathered.max(1) as f64;
    out.gather_share = share(times);
    Some(out)
}

/// The first of two times over their sum.
pub(super) fn share([first, second]: [Duration; 2]) -> f64 {
    first.as_secs_f64() / (first + second).as_secs_f64().max(1e-9)
}

/// What the even and the odd rays of a gathered row say for each training light, and the row's mass. The sky is not split.
fn respond(gathered: &Gathered, signals: &Signals) -> ([Response; 2], Vec3A) {
    let mut response = [[Vec3A::ZERO; SIGNALS + 1]; 2];
    let mut row_sum = Vec3A::ZERO;
    for &j in &gathered.touched {
        let sums = gathered.sums[j as usize];
        row_sum += sums[0] + sums[1];
        for (half, link) in response.iter_mut().zip(sums) {
            for (e, &b) in half.iter_mut().zip(&signals[j as usize]) {
                *e += link * b;
            }
        }
    }
    response[0][SIGNALS] = 0.5 * gathered.sky;
    response[1][SIGNALS] = 0.5 * gathered.sky;
    (response, row_sum)
}

/// What a point's parents say.
fn interpolate(responses: &[Response], parents: &[WeightEntry]) -> Response {
    let mut expected = [Vec3A::ZERO; SIGNALS + 1];
    for w in parents {
        for (e, p) in expected.iter_mut().zip(&responses[w.index as usize]) {
            *e += w.weight * *p;
        }
    }
    expected
}

/// Mean square irradiance of each training light over the coarsest points: the scale that errors are measured on.
fn coarse_mean_squares(
    scene: &GatherScene<'_>,
    senders: usize,
    signals: &Signals,
) -> [f32; SIGNALS + 1] {
    let level = scene.hierarchy.level(0);
    let squares: Vec<[f32; SIGNALS + 1]> = level
        .clone()
        .into_par_iter()
        .map_init(
            || Gathered::new(senders),
            |gathered, i| {
                gather(scene, i, gathered);
                let n = Vec3A::from(scene.hierarchy.surfaces[i].normal);
                let [even, odd] = respond(gathered, signals).0;
                std::array::from_fn(|t| (even[t] + odd[t]).dot(n).powi(2))
            },
        )
        .collect();
    let mut sums = [0.0f64; SIGNALS + 1];
    for point in squares {
        for (s, e) in sums.iter_mut().zip(point) {
            *s += f64::from(e);
        }
    }
    sums.map(|s| (s / level.len().max(1) as f64) as f32)
}

/// Root mean square over the training lights of the difference, relative to each light's root mean square: the product of what the two halves
/// say, whose noise is independent. The part along the normal counts whole; the tangential part, which only normal maps see, a tenth of its square.
fn difference(
    halves: &[Response; 2],
    expected: &Response,
    n: Vec3A,
    inverse_square: &[f32; SIGNALS + 1],
) -> f32 {
    let mut sum = 0.0;
    for t in 0..=SIGNALS {
        let a = 2.0 * halves[0][t] - expected[t];
        let b = 2.0 * halves[1][t] - expected[t];
        sum += (0.9 * a.dot(n) * b.dot(n) + 0.1 * a.dot(b)) * inverse_square[t];
    }
    (sum / (SIGNALS + 1) as f32).max(0.0).sqrt()
}
