//! Third stage: gathered and refined rows of the operator, and of probes.

use super::context::{BakeContext, StageCost};
use super::link_method::LinkMethod;
use super::point_set::PointSet;
use super::probes::{BakedProbes, ProbeInput, bake_probes};
use super::survey::Survey;
use super::{BakeError, BakeStage, PcaRecipe, SkyModel, basis_training, training_lights};
use crate::basis::LevelBasis;
use crate::transport::pca::Compression;
use crate::transport::{
    BoundedSettings, GatherSettings, Receivers, RefinedOperator, SenderTree, Training,
    l08_truncation, precision_of, refine_bounded,
};
use std::time::Instant;

/// Result of the stage.
pub(super) struct Transport {
    /// Points, with the levels that refinement added.
    pub points: PointSet,
    /// Rows of all points.
    pub rows: Rows,
    /// Flat basis of all points.
    pub flat: LevelBasis,
}

/// Rows of one method, and results that only some methods have.
#[derive(Default)]
pub(super) struct Rows {
    pub refined: RefinedOperator,
    /// Light bases of method `pca`.
    pub compression: Option<Compression>,
    pub basis: BasisCounts,
    /// Probes, if the recipe has any.
    pub probes: Option<BakedProbes>,
    /// Precision of links to each sender, the sky last.
    pub precision: Vec<u8>,
    /// Number of rays of the training.
    training_rays: u64,
}

/// Counts of the light bases of method `pca`.
#[derive(Clone, Copy, Default)]
pub(super) struct BasisCounts {
    pub clusters: u64,
    pub components: u64,
    /// See [`BakeStats::basis_missed`](super::BakeStats::basis_missed).
    pub missed: f64,
}

/// Gathers and refines the rows of all points.
pub(super) fn build_transport(
    context: &BakeContext<'_>,
    survey: &Survey,
    points: PointSet,
) -> Result<(Transport, StageCost), BakeError> {
    let began = Instant::now();
    context.report(BakeStage::Transport, 0.0)?;
    let geometry = context.source.geometry;
    let settings = &survey.settings;
    let gathering = GatherSettings {
        geometry,
        sender_levels: settings.sender_levels as usize,
        rays: settings.rays_per_point,
        seed: settings.seed,
        deposit: survey.method.deposit(),
    };
    let stage = TransportStage {
        context,
        survey,
        gathering,
    };
    let (points, rows) = match survey.method {
        LinkMethod::Differences => stage.differences(points)?,
        LinkMethod::Components(pca) => stage.averages(points, Some(&pca))?,
        method if method.has_links() => stage.averages(points, None)?,
        _ => {
            let refined = RefinedOperator::without_rows(points.hierarchy.len());
            let rows = Rows {
                refined,
                ..Rows::default()
            };
            (points, rows)
        }
    };
    let (flat, flat_rays) = points
        .hierarchy
        .flat(geometry, &survey.viewpoints, &points.building);
    let probes = rows.probes.as_ref();
    let probe_rays = probes.map_or(0, |probes| probes.rays);
    let rays = rows.training_rays + rows.refined.rays + probe_rays + flat_rays;
    let cost = StageCost {
        warnings: probes.and_then(|p| p.warning.clone()).into_iter().collect(),
        ..StageCost::new(began, rays)
    };
    let transport = Transport { points, rows, flat };
    Ok((transport, cost))
}

/// Input of the methods.
struct TransportStage<'a> {
    context: &'a BakeContext<'a>,
    survey: &'a Survey,
    gathering: GatherSettings<'a>,
}

impl TransportStage<'_> {
    fn report(&self, done: f32) -> bool {
        self.context.progress.set(BakeStage::Transport, done)
    }

    /// Gathers and refines rows that keep their mass: links to averages of senders, or to
    /// components of light bases.
    fn averages(
        &self,
        mut points: PointSet,
        pca: Option<&PcaRecipe>,
    ) -> Result<(PointSet, Rows), BakeError> {
        let settings = &self.survey.settings;
        let sender_levels = settings.sender_levels as usize;
        let starts = &points.hierarchy.level_starts[..=sender_levels];
        let tree = SenderTree::new(&points.tree, starts);
        let (training, mut training_rays) =
            training_lights::train(&self.gathering, &points, self.survey, &tree);
        let basis = pca.map(|pca| {
            let (basis, rays) =
                basis_training::light_basis(&self.gathering, &points, self.survey, pca);
            training_rays += rays;
            basis
        });
        let refined = refine_bounded(
            &self.gathering,
            &mut Receivers {
                hierarchy: &mut points.hierarchy,
                parents: &mut points.parents,
                building: &points.building,
            },
            &tree,
            &training,
            &BoundedSettings {
                epsilon: settings.truncation_error,
                tolerance: settings.receiver_tolerance,
                always: sender_levels.max(1),
                extra_levels: settings.refinement_levels as usize,
                extra_points: settings.max_refinement_points as usize,
                extra_rays: settings.rays_of_level(settings.levels as usize),
            },
            basis.as_ref(),
            &|done| self.report(done),
        )
        .ok_or(BakeError::Canceled)?;
        let probes = self.probes(&points, &tree, &training)?;
        let basis = basis.as_ref();
        let compression = basis.map(|basis| Compression::new(basis, points.pull.len()));
        if let Some(mass) = &refined.truncation_mass {
            points.pull = mass.pull(&tree, &points.visible_areas);
        }
        let exposures = training.exposure.iter().chain([&training.sky]);
        let rows = Rows {
            refined,
            compression,
            basis: basis.map_or_else(BasisCounts::default, |basis| BasisCounts {
                clusters: basis.clusters() as u64,
                components: basis.columns() as u64,
                missed: basis.missed(),
            }),
            probes,
            precision: exposures.map(|&e| precision_of(e)).collect(),
            training_rays,
        };
        Ok((points, rows))
    }

    /// Bakes the probes, if the recipe has any.
    fn probes(
        &self,
        points: &PointSet,
        tree: &SenderTree,
        training: &Training,
    ) -> Result<Option<BakedProbes>, BakeError> {
        let settings = &self.survey.settings;
        let Some(probes) = &settings.probes else {
            return Ok(None);
        };
        let input = ProbeInput {
            gathering: &self.gathering,
            hierarchy: &points.hierarchy,
            viewpoints: &self.survey.viewpoints,
            tree,
            training,
            epsilon: settings.truncation_error,
            sky_terms: settings.sky == SkyModel::Harmonics,
            drop_first: self.survey.drop_first,
        };
        bake_probes(probes, &input, self.context.progress).map(Some)
    }

    /// Computes rows of differences, as published in \[L08\].
    fn differences(&self, points: PointSet) -> Result<(PointSet, Rows), BakeError> {
        let settings = &self.survey.settings;
        let neighbors =
            l08_truncation::neighbors(&points.hierarchy, settings.sender_levels as usize);
        let refined = l08_truncation::refine_l08(
            &self.gathering.scene(&points.hierarchy),
            &points.parents,
            &neighbors,
            settings.truncation_error,
            &|done| self.report(done),
        );
        let rows = Rows {
            refined: refined.ok_or(BakeError::Canceled)?,
            ..Rows::default()
        };
        Ok((points, rows))
    }
}
