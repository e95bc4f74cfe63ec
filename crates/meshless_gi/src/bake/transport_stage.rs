//! Third stage: gathered and refined rows of the operator, and of probes.

use super::context::{BakeContext, StageCost};
use super::link_method::LinkMethod;
use super::point_set::PointSet;
use super::probes::{BakedProbes, ProbeInput, bake_probes};
use super::survey::Survey;
use super::{BakeError, BakeStage, FmmRecipe, SkyModel, basis_training, training_lights};
use crate::basis::LevelBasis;
use crate::transport::pca::{Compression, LightBasis};
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
    pub rows: RefinedOperator,
    /// Other results, which depend on the method.
    pub method: MethodResults,
    /// Flat basis of all points.
    pub flat: LevelBasis,
}

/// Results of a method, without its rows.
pub(super) enum MethodResults {
    /// Links to averages of senders.
    Averages(TrainingResults),
    /// Links to components of light bases.
    Components(TrainingResults, LightBases),
    /// Links to differences of senders.
    Differences,
    /// Octree without links.
    Octree,
}

impl MethodResults {
    fn training(&self) -> Option<&TrainingResults> {
        match self {
            Self::Averages(training) | Self::Components(training, _) => Some(training),
            Self::Differences | Self::Octree => None,
        }
    }

    /// Returns the results of training and the light bases. Each is `None` if the method has none.
    pub fn into_parts(self) -> (Option<TrainingResults>, Option<LightBases>) {
        match self {
            Self::Averages(training) => (Some(training), None),
            Self::Components(training, bases) => (Some(training), Some(bases)),
            Self::Differences | Self::Octree => (None, None),
        }
    }
}

/// Results of training lights.
pub(super) struct TrainingResults {
    /// Probes, if the recipe has any.
    pub probes: Option<BakedProbes>,
    /// Precision of links to each sender, the sky last.
    pub precision: Vec<u8>,
    /// Number of rays of the training, of light bases too. Excludes rows and probes.
    rays: u64,
}

/// Light bases of method `pca`.
pub(super) struct LightBases {
    pub compression: Compression,
    pub counts: BasisCounts,
}

impl LightBases {
    fn new(basis: &LightBasis, senders: usize) -> Self {
        Self {
            compression: Compression::new(basis, senders),
            counts: BasisCounts {
                clusters: basis.clusters() as u64,
                components: basis.columns() as u64,
                missed: basis.missed(),
            },
        }
    }
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
    mut points: PointSet,
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
    let (rows, method) = match survey.method {
        LinkMethod::Averages
        | LinkMethod::Octree(FmmRecipe {
            fallback_links: true,
            ..
        }) => {
            let (rows, training) = stage.bounded(&mut points, None)?;
            (rows, MethodResults::Averages(training))
        }
        LinkMethod::Components(pca) => {
            let (basis, rays) =
                basis_training::light_basis(&stage.gathering, &points, survey, &pca);
            let (rows, mut training) = stage.bounded(&mut points, Some(&basis))?;
            training.rays += rays;
            let bases = LightBases::new(&basis, points.pull.len());
            (rows, MethodResults::Components(training, bases))
        }
        LinkMethod::Differences => (stage.differences(&points)?, MethodResults::Differences),
        LinkMethod::Octree(FmmRecipe {
            fallback_links: false,
            ..
        }) => {
            let rows = RefinedOperator::without_rows(points.hierarchy.len());
            (rows, MethodResults::Octree)
        }
    };
    let (flat, flat_rays) = points
        .hierarchy
        .flat(geometry, &survey.viewpoints, &points.building);
    let training = method.training();
    let training_rays = training.map_or(0, |training| training.rays);
    let probes = training.and_then(|training| training.probes.as_ref());
    let probe_rays = probes.map_or(0, |probes| probes.rays);
    let rays = training_rays + rows.rays + probe_rays + flat_rays;
    let cost = StageCost {
        warnings: probes.and_then(|p| p.warning.clone()).into_iter().collect(),
        ..StageCost::new(began, rays)
    };
    let transport = Transport {
        points,
        rows,
        method,
        flat,
    };
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
    /// components of light bases if there is a `basis`.
    fn bounded(
        &self,
        points: &mut PointSet,
        basis: Option<&LightBasis>,
    ) -> Result<(RefinedOperator, TrainingResults), BakeError> {
        let settings = &self.survey.settings;
        let sender_levels = settings.sender_levels as usize;
        let starts = &points.hierarchy.level_starts[..=sender_levels];
        let tree = SenderTree::new(&points.tree, starts);
        let (training, rays) = training_lights::train(&self.gathering, points, self.survey, &tree);
        let rows = refine_bounded(
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
            basis,
            &|done| self.report(done),
        )
        .ok_or(BakeError::Canceled)?;
        let probes = self.probes(points, &tree, &training)?;
        if let Some(mass) = &rows.truncation_mass {
            points.pull = mass.pull(&tree, &points.visible_areas);
        }
        let exposures = training.exposure.iter().chain([&training.sky]);
        let results = TrainingResults {
            probes,
            precision: exposures.map(|&e| precision_of(e)).collect(),
            rays,
        };
        Ok((rows, results))
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
    fn differences(&self, points: &PointSet) -> Result<RefinedOperator, BakeError> {
        let settings = &self.survey.settings;
        let neighbors =
            l08_truncation::neighbors(&points.hierarchy, settings.sender_levels as usize);
        l08_truncation::refine_l08(
            &self.gathering.scene(&points.hierarchy),
            &points.parents,
            &neighbors,
            settings.truncation_error,
            &|done| self.report(done),
        )
        .ok_or(BakeError::Canceled)
    }
}
