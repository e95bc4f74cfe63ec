//! Second stage: points, their hierarchy, light samples of senders, and weights between levels.

use super::context::{BakeContext, StageCost};
use super::survey::Survey;
use super::{BakeError, BakeSettings, BakeStage};
use crate::asset::LightSamples;
use crate::basis::{Hierarchy, HierarchySettings, SenderLevel, Weights, place_light_samples};
use crate::scene::Geometry;
use std::time::Instant;

/// Result of the stage.
pub(super) struct PointSet {
    /// Points and basis functions of all levels.
    pub hierarchy: Hierarchy,
    /// Settings that the hierarchy was built with.
    pub building: HierarchySettings,
    /// Light samples of the finest senders.
    pub light_samples: LightSamples,
    /// Weights that fill coarse senders from finer ones.
    pub pull: Weights,
    /// Weights that fill points from coarser levels.
    pub parents: Weights,
    /// Parent of each sender in the tree of senders.
    pub tree: Vec<u32>,
    /// Areas of the senders of each level, as visible to receivers beyond the level's functions.
    /// Empty without a tree.
    pub visible_areas: Vec<Vec<f32>>,
}

/// Scatters points and connects their levels.
pub(super) fn build_points(
    context: &BakeContext<'_>,
    survey: &Survey,
) -> Result<(PointSet, StageCost), BakeError> {
    let began = Instant::now();
    let Survey {
        viewpoints,
        settings,
        method,
        ..
    } = survey;
    let geometry = context.source.geometry;
    let building = HierarchySettings {
        coarse_radius: settings.coarse_radius,
        levels: settings.levels as usize,
        sender_levels: settings.sender_levels as usize,
        max: settings.max_points(),
        seed: settings.seed,
        sender_overlap: method.sender_overlap(),
        clip: settings.clip_planes,
        drop_first: survey.drop_first,
        separate_emitters: method.separates_emitters(),
    };
    let mut hierarchy = Hierarchy::build(geometry, viewpoints, &building, &|done| {
        context.progress.set(BakeStage::Points, 0.9 * done)
    })
    .ok_or(BakeError::Canceled)?;
    if hierarchy.is_empty() {
        return Err(BakeError::NoReachableSurface {
            viewpoints: viewpoints.len(),
        });
    }
    let (light_samples, sample_rays) = sample_senders(geometry, &mut hierarchy, settings);
    let tree = hierarchy.tree();
    let (pull, visible_areas, area_rays) = if method.has_sender_tree() {
        let (areas, rays) = hierarchy.visible_areas(geometry, viewpoints, &tree, &building);
        (hierarchy.tree_pull(&tree, &areas), areas, rays)
    } else {
        (hierarchy.pull(), Vec::new(), 0)
    };
    let parents = hierarchy.parents(method.has_all_parents());
    let cost = StageCost::new(began, hierarchy.rays + sample_rays + area_rays);
    let points = PointSet {
        hierarchy,
        building,
        light_samples,
        pull,
        parents,
        tree,
        visible_areas,
    };
    Ok((points, cost))
}

/// Computes the light samples of the finest senders. Also returns the number of rays cast. Surfaces
/// of these senders get the mean reflectance and emission of their samples. One sample per sender
/// is the sender's own point, as in \[L08\], and is not stored.
fn sample_senders(
    geometry: &dyn Geometry,
    hierarchy: &mut Hierarchy,
    settings: &BakeSettings,
) -> (LightSamples, u64) {
    if settings.samples_per_sender <= 1 {
        return (LightSamples::default(), 0);
    }
    let finest = settings.sender_levels as usize - 1;
    let level = hierarchy.level(finest);
    let (list, rays) = place_light_samples(
        geometry,
        &SenderLevel {
            basis: &hierarchy.senders[finest],
            emissive: hierarchy.emissive.get(level.clone()).unwrap_or(&[]),
        },
        &mut hierarchy.surfaces[level],
        settings.samples_per_sender,
        settings.seed,
    );
    let per_sender = settings.samples_per_sender;
    (LightSamples { per_sender, list }, rays)
}
