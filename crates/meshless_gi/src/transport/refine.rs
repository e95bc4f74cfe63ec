//! Adaptive refinement of receivers for methods `bounded` and `pca`.
//!
//! The driver visits the receiver hierarchy level by level, like \[L08\] Figure 5. \[L08\] tests
//! single links. This method tests whole rows. Each receiver is gathered, and its parents'
//! prediction is subtracted (\[L08\] Eq. (17)). The error of the prediction is estimated from that
//! residual (see [`super::training`]). Receivers of a level that covers all surfaces take their
//! parents' mean if their error is below a tolerance (kernel `flatten`). Kept rows replace the
//! prediction, so nothing cancels and no light is lost.
//!
//! A finer level is added around receivers of the finest level with a large residual. Next to
//! ledges and in corners, irradiance changes over centimeters. A receiver of level l represents a
//! surface of R_l², so the tolerance doubles from level to level. The remaining error is then
//! distributed evenly over the surface.

use super::added_level::add_level;
use super::bounded_truncation::{CutMeasure, SenderTree};
use super::gather::{GatherScene, GatherSettings};
use super::moved_mass::TruncationMass;
use super::occluded_links::LinkTerm;
use super::pca::LightBasis;
use super::quantized_row::QuantizedRow;
use super::receiver::{ReceiverLevel, ReceiverRow, ReceiverScratch};
use super::residual::{Predictors, interpolate, interpolate_sky};
use super::training::Training;
use crate::basis::{Hierarchy, HierarchySettings, Weights};
use glam::{Vec3, Vec3A};
use rayon::prelude::*;
use std::time::Duration;

/// Row before packing.
#[derive(Clone, Debug, Default)]
pub struct RawRow {
    /// Senders and their F_ij, in ascending order of senders.
    pub links: Vec<(u32, Vec3A)>,
    /// Terms that cross occluders, of the links, of the sky and of the sky's terms. In ascending
    /// order of senders, then of occluders.
    pub parts: Vec<LinkTerm>,
    /// `false` if the point takes its value from its parents.
    pub active: bool,
}

/// Rows of all points.
#[derive(Debug, Default)]
pub struct RefinedOperator {
    /// One row per point.
    pub rows: Vec<RawRow>,
    /// (1/π) ∫ ω dω over the visible sky, per point.
    pub sky: Vec<Vec3>,
    /// Part of each point's gathered light that hit a surface without a sender or an unlit back
    /// side. 0 if nothing was gathered.
    pub missed: Vec<f32>,
    /// Mean part of the gathered light that hit a surface without a sender.
    pub uncovered: f64,
    /// Number of receivers that were gathered.
    pub gathered: u64,
    /// Number of rays cast.
    pub rays: u64,
    /// Largest row sum Σ F·n.
    pub largest_row_sum: f32,
    /// Mass that truncation moved in the rows of senders. `None` with method `pca`.
    pub truncation_mass: Option<TruncationMass>,
    /// Part of the processor time for gathering. Refinement uses the rest.
    pub gather_share: f64,
}

impl RefinedOperator {
    /// Creates an operator without rows and without sky visibility for `points` points.
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

/// Tolerances of methods `bounded` and `pca`.
#[derive(Clone, Copy, Debug)]
pub struct BoundedSettings {
    /// Bound on the blur of a row, relative to the light's root mean square. See
    /// [`super::bounded_truncation`].
    pub epsilon: f32,
    /// Residual, relative to the light's root mean square, below which a receiver has neither a row
    /// nor finer receivers. Applies to levels that cover all surfaces.
    pub tolerance: f32,
    /// Number of coarsest levels with a row at every point.
    pub always: usize,
    /// Largest number of added levels.
    pub extra_levels: usize,
    /// Largest number of points of all added levels together.
    pub extra_points: usize,
    /// Number of gather rays per receiver of the added levels.
    pub extra_rays: u32,
}

/// Receivers of the refinement.
pub struct Receivers<'a> {
    /// Points. Finer levels are appended.
    pub hierarchy: &'a mut Hierarchy,
    /// Parents of the points in the nearest coarser level. Rows are appended with the levels.
    pub parents: &'a mut Weights,
    /// Settings that the hierarchy was built with.
    pub building: &'a HierarchySettings,
}

/// Gathers and truncates the rows of all receivers. Adds finer receivers where the residual of the
/// finest level is large. Writes rows in `basis` if it is set (method `pca`). `progress` receives
/// the completed part and returns `false` to cancel. Returns `None` if canceled.
pub fn refine_bounded(
    gathering: &GatherSettings<'_>,
    receivers: &mut Receivers<'_>,
    tree: &SenderTree,
    training: &Training,
    settings: &BoundedSettings,
    basis: Option<&LightBasis>,
    progress: &(dyn Fn(f32) -> bool + Sync),
) -> Option<RefinedOperator> {
    let mut refinement = Refinement {
        gathering,
        tree,
        measure: CutMeasure {
            training,
            epsilon: settings.epsilon,
        },
        settings,
        basis,
        base_levels: receivers.hierarchy.levels.len(),
        truncation: TruncationMass::new(tree),
        out: RefinedOperator::default(),
        predictors: Predictors::default(),
        uncovered: 0.0,
        times: [Duration::ZERO; 2],
    };
    let mut points_left = settings.extra_points;
    for l in 0.. {
        if l == receivers.hierarchy.levels.len() {
            let added = refinement.add_level(l, receivers, points_left);
            if added == 0 {
                break;
            }
            points_left -= added;
        }
        let rows = refinement.gather_level(l, receivers, progress)?;
        refinement.accept_level(l, receivers, rows);
    }
    Some(refinement.finish())
}

/// State of the refinement.
struct Refinement<'a> {
    gathering: &'a GatherSettings<'a>,
    tree: &'a SenderTree,
    measure: CutMeasure<'a>,
    settings: &'a BoundedSettings,
    basis: Option<&'a LightBasis>,
    /// Number of levels before refinement.
    base_levels: usize,
    truncation: TruncationMass,
    out: RefinedOperator,
    predictors: Predictors,
    uncovered: f64,
    times: [Duration; 2],
}

impl Refinement<'_> {
    /// Returns the largest number of levels.
    fn max_levels(&self) -> usize {
        self.base_levels + self.settings.extra_levels
    }

    /// Returns the squared tolerance of a level, in the unit of residuals.
    fn tolerance(&self, l: usize) -> f32 {
        let steps = (l + 1).saturating_sub(self.base_levels) as i32;
        (self.settings.tolerance * 2f32.powi(steps)).powi(2)
    }

    /// Returns the number of gather rays per point of a level.
    fn rays(&self, l: usize) -> u32 {
        match l < self.base_levels {
            true => self.gathering.rays,
            false => self.settings.extra_rays,
        }
    }

    /// Adds level `l` with at most `points_left` points. Returns its number of points.
    fn add_level(&self, l: usize, receivers: &mut Receivers<'_>, points_left: usize) -> usize {
        if l >= self.max_levels() {
            return 0;
        }
        let last = l + 1 == self.max_levels();
        let max_points = match last {
            true => points_left,
            false => points_left.div_ceil(2),
        };
        let tolerance = self.tolerance(l - 1);
        let errors = &self.predictors.errors;
        add_level(self.gathering, receivers, errors, tolerance, max_points)
    }

    /// Selects the receivers of a level. An entry is `true` if the receiver is gathered and `false`
    /// if it inherits.
    fn selected(&self, l: usize, receivers: &Receivers<'_>) -> Vec<bool> {
        let errors = &self.predictors.errors;
        let level = receivers.hierarchy.level(l);
        level
            .map(|i| {
                let row = receivers.parents.row(i);
                l < self.settings.always
                    || row.is_empty()
                    || (row.iter()).any(|w| errors[w.index as usize] > self.tolerance(l - 1))
            })
            .collect()
    }

    /// Gathers the rows of a level. An entry is `None` if the receiver inherits. Returns `None` if
    /// canceled.
    fn gather_level(
        &self,
        l: usize,
        receivers: &Receivers<'_>,
        progress: &(dyn Fn(f32) -> bool + Sync),
    ) -> Option<Vec<Option<ReceiverRow>>> {
        const CHUNK: usize = 1024;
        let always = self.settings.always;
        let has_finer_level = l + 1 != self.max_levels();
        let hierarchy = &*receivers.hierarchy;
        let input = ReceiverLevel {
            scene: &GatherScene {
                rays: self.rays(l),
                ..self.gathering.scene(hierarchy)
            },
            parents: receivers.parents,
            rows: &self.out.rows,
            predictors: &self.predictors,
            tree: self.tree,
            measure: &self.measure,
            basis: self.basis,
            // Residuals select the rows of this level. With the residuals of the next coarser
            // level, they also select the receivers of the next finer level.
            has_residuals: (always..self.base_levels).contains(&l)
                || (l + 2 >= always && has_finer_level),
            has_finer_level,
            truncation: (l < always && self.basis.is_none()).then_some(&self.truncation),
        };
        let selected = self.selected(l, receivers);
        let level = hierarchy.level(l);
        let senders = self.tree.parent.len();
        let mut rows: Vec<Option<ReceiverRow>> = Vec::with_capacity(level.len());
        for chunk in level.clone().collect::<Vec<_>>().chunks(CHUNK) {
            rows.par_extend(chunk.par_iter().map_init(
                || ReceiverScratch::new(senders),
                |scratch, &i| selected[i - level.start].then(|| input.receive(i, scratch)),
            ));
            if !progress((level.start + rows.len()) as f32 / hierarchy.len() as f32) {
                return None;
            }
        }
        Some(rows)
    }

    /// Stores the rows of a level. Drops rows with a small residual, so that their points inherit.
    fn accept_level(
        &mut self,
        l: usize,
        receivers: &Receivers<'_>,
        rows: Vec<Option<ReceiverRow>>,
    ) {
        for (i, row) in receivers.hierarchy.level(l).zip(rows) {
            let Some(row) = row else {
                self.inherit(receivers.parents, i);
                self.out.missed.push(0.0);
                self.predictors.errors.push(0.0);
                continue;
            };
            self.out.gathered += 1;
            self.out.rays += u64::from(self.rays(l));
            self.times[0] += row.times[0];
            self.times[1] += row.times[1];
            self.uncovered += f64::from(row.uncovered);
            self.out.missed.push(row.uncovered + row.unlit);
            self.out.largest_row_sum = self.out.largest_row_sum.max(row.row_sum);
            self.predictors.errors.push(row.error);
            let always = l < self.settings.always || l >= self.base_levels;
            if always || row.error > 0.25 * self.tolerance(l) {
                self.out.sky.push(row.sky.into());
                self.out.rows.push(row.row);
                self.predictors.responses.push(row.response);
                self.predictors.quantized.push(row.quantized);
            } else {
                self.inherit(receivers.parents, i);
            }
        }
    }

    /// Stores the mean of the parents for point `i`.
    fn inherit(&mut self, parents: &Weights, i: usize) {
        let row = parents.row(i);
        let sky = interpolate_sky(&self.out.sky, row);
        let response = interpolate(&self.predictors.responses, row);
        self.out.sky.push(sky.into());
        self.out.rows.push(RawRow::default());
        self.predictors.responses.push(response);
        self.predictors.quantized.push(QuantizedRow::default());
    }

    fn finish(mut self) -> RefinedOperator {
        self.out.uncovered = self.uncovered / self.out.gathered.max(1) as f64;
        self.out.gather_share = first_fraction(self.times);
        RefinedOperator {
            truncation_mass: self.basis.is_none().then_some(self.truncation),
            ..self.out
        }
    }
}

/// Returns the ratio of the first duration to the sum of both.
pub(super) fn first_fraction([first, second]: [Duration; 2]) -> f64 {
    first.as_secs_f64() / (first + second).as_secs_f64().max(1e-9)
}
