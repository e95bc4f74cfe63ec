//! Which receivers get a row, and where there are more of them: the driver of rule `bounded`.
//!
//! Like [L08] Figure 5 it goes down the receiver hierarchy level by level and refines only where it
//! must. Where [L08] looks at single links, this looks at what a whole row says: each receiver is
//! gathered and what its parents say is subtracted ([L08] Eq. (17)); the error that their mean
//! would make is estimated from the difference (see [`super::training`]). Receivers of a level that
//! covers everything whose error is below a tolerance take their parents' mean (the `flatten`
//! kernel interpolates). Rows that are kept stand alone: they replace the interpolated value, so
//! nothing cancels and nothing is lost.
//!
//! Where receivers of the finest level still differ from their parents, a finer level is added
//! around them, and so on: beside ledges and in corners light changes over centimeters. A receiver
//! of level l stands for a surface of R_l², so the tolerance doubles from level to level: what
//! remains is spread evenly over the surface.

use super::bounded::{CutMeasure, CutScratch, SenderTree, cut_row};
use super::gather::{GatherScene, GatherSettings, Gathered, gather};
use super::occluded_links::{Part, cut_parts};
use super::pca::{CompressScratch, LightBasis};
use super::quantized_row::QuantizedRow;
use super::training::{TRAINING_LIGHTS, Training, TrainingRadiosity};
use super::truncation_mass::TruncationMass;
use crate::basis::{Hierarchy, HierarchySettings, WeightEntry, Weights};
use glam::{Vec3, Vec3A};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// The vector irradiance at a point for each training lamp, and for a sky of unit radiosity, by the
/// even and by the odd rays.
type Response = [[Vec3A; TRAINING_LIGHTS + 1]; 2];

/// A row before packing.
#[derive(Clone, Debug, Default)]
pub struct RawRow {
    /// Senders and their F_ij, senders ascending.
    pub links: Vec<(u32, Vec3A)>,
    /// What of them, of the sky and of its terms crosses occluders: ascending by sender, then by
    /// occluders.
    pub parts: Vec<Part>,
    /// False where the point takes its value from its parents.
    pub active: bool,
}

/// The rows of all points and what came with them.
#[derive(Debug, Default)]
pub struct RefinedOperator {
    /// One a point.
    pub rows: Vec<RawRow>,
    /// (1/π) ∫ ω dω over the sky, for every point.
    pub sky: Vec<Vec3>,
    /// For every point, the share of its gathered light that met a surface which no sender covers,
    /// or an unlit back; 0 where nothing was gathered.
    pub missed: Vec<f32>,
    /// Mean share of the gathered light that met a surface which no sender covers.
    pub uncovered: f64,
    /// Receivers that were gathered.
    pub gathered: u64,
    /// Rays cast.
    pub rays: u64,
    /// Largest row sum Σ F·n that was seen.
    pub largest_row_sum: f32,
    /// What the rows of the senders' points handed over.
    pub handed: Option<TruncationMass>,
    /// Share of the processor time that went into gathering; the rest went into deciding.
    pub gather_share: f64,
}

impl RefinedOperator {
    /// For so many points, none of which has a row, or knows of the sky.
    #[must_use]
    pub fn without_rows(points: usize) -> Self {
        Self {
            rows: vec![RawRow::default(); points],
            sky: vec![Vec3::ZERO; points],
            missed: vec![0.0; points],
            ..Self::default()
        }
    }
}

/// What rule `bounded` may lose.
#[derive(Clone, Copy, Debug)]
pub struct BoundedSettings {
    /// Bound on what a row blurs, relative to the light's root mean square, see [`super::bounded`].
    pub epsilon: f32,
    /// Difference to the parents' value, relative to the root mean square of the light, below which
    /// a receiver of the finest level that covers everything needs no row and no finer receivers
    /// around it.
    pub tolerance: f32,
    /// Levels whose points always get a row.
    pub always: usize,
    /// Levels that may be added, where receivers differ from their parents.
    pub extra_levels: usize,
    /// Most points that all added levels may have together.
    pub extra_points: usize,
    /// Rays a receiver of the added levels.
    pub extra_rays: u32,
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

/// What came of one receiver.
struct Gather1 {
    row: RawRow,
    leaves: QuantizedRow,
    response: Response,
    sky: Vec3A,
    error: f32,
    uncovered: f32,
    unlit: f32,
    row_sum: f32,
    gather_time: Duration,
    other_time: Duration,
}

/// Room for one receiver; one a thread.
struct Room {
    gathered: Gathered,
    cut: CutScratch,
    compress: CompressScratch,
    compared: Compared,
    /// The gathered senders and their links' normal components, before the cut.
    masses: Vec<(u32, f32)>,
    kept: Vec<bool>,
}

/// A row along its point's normal beside what its parents say.
struct Compared {
    /// Twice the gathered even and odd sums, for each sender that was met.
    halves: Vec<(u32, [f32; 2])>,
    /// Per sender: what the parents say of its link.
    expected: Vec<f32>,
    /// Senders that the parents know.
    foreseen: Vec<u32>,
}

/// What is known of the points so far.
#[derive(Default)]
struct Known {
    responses: Vec<Response>,
    /// Square of the difference to what the parents say; its noise may make it negative.
    errors: Vec<f32>,
    /// The gathered rows before they were cut; nothing for points that inherit.
    leaves: Vec<QuantizedRow>,
}

/// Gathers and cuts the rows of all receivers, and adds finer receivers where those of the finest
/// level still differ from what their parents say. With a `basis` rows are written in it (rule
/// `pca`) and not cut. `progress` is told how much is done and may stop the work by answering
/// false; then nothing comes back.
pub fn refine_bounded(
    gathering: &GatherSettings<'_>,
    receivers: &mut Receivers<'_>,
    tree: &SenderTree,
    training: &Training,
    settings: &BoundedSettings,
    basis: Option<&LightBasis>,
    progress: &(dyn Fn(f32) -> bool + Sync),
) -> Option<RefinedOperator> {
    let senders = tree.parent.len();
    let mut out = RefinedOperator::default();
    let mut known = Known::default();
    let handed = TruncationMass::new(tree);
    let measure = CutMeasure {
        training,
        epsilon: settings.epsilon,
    };
    let mut uncovered = 0.0f64;
    let mut times = [Duration::ZERO; 2];
    let base_levels = receivers.hierarchy.levels.len();
    // Squared, as errors are.
    let tolerance = |l: usize| {
        let steps = (l + 1).saturating_sub(base_levels) as i32;
        (settings.tolerance * 2f32.powi(steps)).powi(2)
    };
    let mut extra_points = settings.extra_points;
    let mut l = 0;
    loop {
        if l == receivers.hierarchy.levels.len() {
            if l >= base_levels + settings.extra_levels {
                break;
            }
            let last = l + 1 == base_levels + settings.extra_levels;
            let most = if last {
                extra_points
            } else {
                extra_points.div_ceil(2)
            };
            let added = add_level(gathering, receivers, &known.errors, tolerance(l - 1), most);
            if added == 0 {
                break;
            }
            extra_points -= added;
        }
        let hierarchy = &*receivers.hierarchy;
        let parents = &*receivers.parents;
        let rays = if l < base_levels {
            gathering.rays
        } else {
            settings.extra_rays
        };
        let scene = &GatherScene {
            rays,
            ..gathering.scene(hierarchy)
        };
        let points = hierarchy.len();
        let level = hierarchy.level(l);
        // Whether anybody asks for the errors: this level about its own rows, or the next.
        let last = l + 1 == base_levels + settings.extra_levels;
        let judged =
            (settings.always..base_levels).contains(&l) || (l + 1 >= settings.always && !last);
        let wanted: Vec<bool> = level
            .clone()
            .map(|i| {
                let row = parents.row(i);
                l < settings.always
                    || row.is_empty()
                    || row
                        .iter()
                        .any(|w| known.errors[w.index as usize] > tolerance(l - 1))
            })
            .collect();
        let mut results: Vec<Option<Gather1>> = Vec::with_capacity(level.len());
        const CHUNK: usize = 1024;
        for chunk in level.clone().collect::<Vec<_>>().chunks(CHUNK) {
            results.par_extend(chunk.par_iter().map_init(
                || Room {
                    gathered: Gathered::new(senders),
                    cut: CutScratch::default(),
                    compress: CompressScratch::default(),
                    compared: Compared {
                        halves: Vec::new(),
                        expected: vec![0.0; senders],
                        foreseen: Vec::new(),
                    },
                    masses: Vec::new(),
                    kept: vec![false; senders],
                },
                |room, &i| {
                    wanted[i - level.start].then(|| {
                        let handed = (l < settings.always && basis.is_none()).then_some(&handed);
                        receive(
                            scene, parents, &out, &known, tree, &measure, basis, judged, !last,
                            handed, i, room,
                        )
                    })
                },
            ));
            if !progress((level.start + results.len()) as f32 / points as f32) {
                return None;
            }
        }
        for (i, result) in level.clone().zip(results) {
            let inherited = |known: &mut Known, out: &mut RefinedOperator| {
                let row = parents.row(i);
                out.sky.push(interpolate_sky(&out.sky, row).into());
                out.rows.push(RawRow::default());
                known.responses.push(interpolate(&known.responses, row));
                known.leaves.push(QuantizedRow::default());
            };
            let Some(one) = result else {
                inherited(&mut known, &mut out);
                out.missed.push(0.0);
                known.errors.push(0.0);
                continue;
            };
            out.gathered += 1;
            out.rays += u64::from(rays);
            times[0] += one.gather_time;
            times[1] += one.other_time;
            uncovered += f64::from(one.uncovered);
            out.missed.push(one.uncovered + one.unlit);
            out.largest_row_sum = out.largest_row_sum.max(one.row_sum);
            known.errors.push(one.error);
            if l < settings.always || l >= base_levels || one.error > 0.25 * tolerance(l) {
                out.sky.push(one.sky.into());
                out.rows.push(one.row);
                known.responses.push(one.response);
                known.leaves.push(one.leaves);
            } else {
                inherited(&mut known, &mut out);
            }
        }
        l += 1;
    }
    out.uncovered = uncovered / out.gathered.max(1) as f64;
    out.handed = basis.is_none().then_some(handed);
    out.gather_share = share(times);
    Some(out)
}

/// Adds a level around the receivers of the finest level whose error is above `tolerance`, those
/// with the largest errors first. Returns how many points it has.
fn add_level(
    gathering: &GatherSettings<'_>,
    receivers: &mut Receivers<'_>,
    errors: &[f32],
    tolerance: f32,
    most: usize,
) -> usize {
    let l = receivers.hierarchy.levels.len();
    let hierarchy = &*receivers.hierarchy;
    let level = hierarchy.level(l - 1);
    // A single error is a product of two noisy sums, and the largest of many would be those with
    // the luckiest noise: the mean around each one is asked.
    let means: Vec<f32> = level
        .clone()
        .into_par_iter()
        .map_init(Vec::new, |found, i| {
            let s = &hierarchy.surfaces[i];
            hierarchy.levels[l - 1].weights(s.position, s.normal, found);
            let (mut sum, mut weights) = (0.0, 0.0);
            for w in found.iter() {
                let error = errors[level.start + w.index as usize];
                if error.is_finite() {
                    sum += w.weight * error;
                    weights += w.weight;
                }
            }
            if errors[i].is_finite() && weights > 0.0 {
                sum / weights
            } else {
                errors[i]
            }
        })
        .collect();
    let mean = |i: usize| means[i - level.start];
    let mut wanting: Vec<usize> = level.clone().filter(|&i| mean(i) > tolerance).collect();
    wanting.sort_by(|&a, &b| mean(b).total_cmp(&mean(a)).then(a.cmp(&b)));
    wanting.truncate(most / 4);
    if wanting.is_empty() {
        return 0;
    }
    let added =
        receivers
            .hierarchy
            .add_level(gathering.geometry, &wanting, most, receivers.building);
    if added > 0 {
        receivers
            .hierarchy
            .append_parents(l, false, receivers.parents);
    }
    added
}

/// Gathers and cuts one receiver.
#[expect(
    clippy::too_many_arguments,
    reason = "one receiver among all the others"
)]
fn receive(
    scene: &GatherScene<'_>,
    parents: &Weights,
    done: &RefinedOperator,
    known: &Known,
    tree: &SenderTree,
    measure: &CutMeasure<'_>,
    basis: Option<&LightBasis>,
    judged: bool,
    keep: bool,
    handed: Option<&TruncationMass>,
    i: usize,
    room: &mut Room,
) -> Gather1 {
    let began = Instant::now();
    let Room {
        gathered,
        cut,
        compress,
        compared,
        masses,
        kept,
    } = room;
    gather(scene, i, gathered);
    let gather_time = began.elapsed();
    let training = measure.training;
    let n: Vec3A = scene.hierarchy.surfaces[i].normal.into();
    let (response, row_sum) = respond(gathered, &training.signals);
    let sky = gathered.sky;
    let row = parents.row(i);
    let mut error = f32::INFINITY;
    let judged = judged && !row.is_empty();
    compared.halves.clear();
    if judged {
        let touched = gathered.touched.iter();
        compared.halves.extend(touched.map(|&j| {
            let sums = gathered.sums[j as usize];
            (j, sums.map(|half| 2.0 * half.dot(n)))
        }));
    }
    // Nobody asks the last level.
    let leaves = if keep {
        QuantizedRow::new(gathered)
    } else {
        QuantizedRow::default()
    };
    masses.clear();
    if handed.is_some() {
        let touched = gathered.touched.iter();
        masses.extend(touched.map(|&j| (j, gathered.link(j).dot(n))));
    }
    let links = match basis {
        Some(basis) => basis.compress(gathered, n, measure.epsilon, compress),
        None => cut_row(gathered, tree, n, measure, cut),
    };
    let mut parts = Vec::new();
    if handed.is_some() || !gathered.parts.is_empty() {
        for &(k, _) in &links {
            kept[k as usize] = true;
        }
        if let Some(handed) = handed {
            note_handed(handed, tree, masses, kept);
        }
        if basis.is_none() {
            parts = cut_parts(tree, &gathered.parts, |k| kept[k as usize]);
        }
        for &(k, _) in &links {
            kept[k as usize] = false;
        }
    }
    if judged {
        let coherent = difference(
            &response,
            &interpolate(&known.responses, row),
            n,
            training.sky,
        );
        error =
            coherent + single_errors(compared, done, known, parents, row, n, &training.exposure);
    }
    Gather1 {
        row: RawRow {
            links,
            parts,
            active: true,
        },
        leaves,
        response,
        sky,
        error,
        uncovered: gathered.uncovered,
        unlit: gathered.unlit,
        row_sum: row_sum.dot(n),
        gather_time,
        other_time: began.elapsed() - gather_time,
    }
}

/// Notes where each sender's mass went: to the nearest of itself and its ancestors that has a link,
/// and is `kept`.
fn note_handed(handed: &TruncationMass, tree: &SenderTree, masses: &[(u32, f32)], kept: &[bool]) {
    for &(j, mass) in masses {
        let mut k = j;
        while !kept[k as usize] && tree.parent[k as usize] != k {
            k = tree.parent[k as usize];
        }
        if kept[k as usize] {
            handed.add(tree, j, k, mass);
        }
    }
}

/// What single senders' links differ from those that the parents in `row` say, squared and weighed
/// by exposure: the parents' rows before they were cut, and those of the points that they in turn
/// inherit from. The product of what the even and the odd rays say.
fn single_errors(
    compared: &mut Compared,
    done: &RefinedOperator,
    known: &Known,
    parents: &Weights,
    row: &[WeightEntry],
    n: Vec3A,
    exposure: &[f32],
) -> f32 {
    let Compared {
        halves,
        expected,
        foreseen,
    } = compared;
    foreseen.clear();
    let n = Vec3::from(n);
    let mut open: BTreeMap<u32, f32> = row.iter().map(|w| (w.index, w.weight)).collect();
    // Parents have lower indices than their children: taken from the top, each point comes once.
    while let Some((k, weight)) = open.pop_last() {
        known.leaves[k as usize].for_each(n, weight, |j, part| {
            let e = &mut expected[j as usize];
            if *e == 0.0 {
                foreseen.push(j);
            }
            *e += part;
        });
        if !done.rows[k as usize].active {
            for w in parents.row(k as usize) {
                *open.entry(w.index).or_default() += weight * w.weight;
            }
        }
    }
    let mut sum = 0.0;
    for &(j, [a, b]) in &*halves {
        let e = std::mem::take(&mut expected[j as usize]);
        sum += (a - e) * (b - e) * exposure[j as usize];
    }
    // Those that the parents know and no ray met.
    for &j in &*foreseen {
        let e = std::mem::take(&mut expected[j as usize]);
        sum += e * e * exposure[j as usize];
    }
    sum
}

/// The first of two times over their sum.
pub(super) fn share([first, second]: [Duration; 2]) -> f64 {
    first.as_secs_f64() / (first + second).as_secs_f64().max(1e-9)
}

/// What the even and the odd rays of a gathered row say for each training lamp, and the row's mass.
/// The sky is not split.
fn respond(gathered: &Gathered, signals: &TrainingRadiosity) -> (Response, Vec3A) {
    let mut response = [[Vec3A::ZERO; TRAINING_LIGHTS + 1]; 2];
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
    response[0][TRAINING_LIGHTS] = 0.5 * gathered.sky;
    response[1][TRAINING_LIGHTS] = 0.5 * gathered.sky;
    (response, row_sum)
}

/// What a point's parents say.
fn interpolate(responses: &[Response], parents: &[WeightEntry]) -> Response {
    let mut expected = [[Vec3A::ZERO; TRAINING_LIGHTS + 1]; 2];
    for w in parents {
        for (expected, parent) in expected.iter_mut().zip(&responses[w.index as usize]) {
            for (e, p) in expected.iter_mut().zip(parent) {
                *e += w.weight * *p;
            }
        }
    }
    expected
}

/// What a point's parents see of the sky.
fn interpolate_sky(sky: &[Vec3], parents: &[WeightEntry]) -> Vec3A {
    parents
        .iter()
        .map(|w| w.weight * Vec3A::from(sky[w.index as usize]))
        .sum()
}

/// Mean square over the training lamps of the difference: the product of what the two halves say,
/// whose noise is independent. The part along the normal counts whole; the tangential part, which
/// only normal maps see, a tenth of its square.
fn difference(found: &Response, expected: &Response, n: Vec3A, sky: f32) -> f32 {
    let mut sum = 0.0;
    for t in 0..=TRAINING_LIGHTS {
        let a = found[0][t] - expected[0][t];
        let b = found[1][t] - expected[1][t];
        let scale = if t < TRAINING_LIGHTS { 1.0 } else { sky };
        sum += (0.9 * a.dot(n) * b.dot(n) + 0.1 * a.dot(b)) * scale;
    }
    4.0 * sum / (TRAINING_LIGHTS + 1) as f32
}
