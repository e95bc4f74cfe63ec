//! First stage: viewpoints, the lit area, and the settings that follow from them.

use super::context::{BakeContext, StageCost};
use super::link_method::LinkMethod;
use super::precision_check::check_precision;
use super::quality_level::QualityParameters;
use super::{BakeError, BakeSettings, BakeStage, reached_area};
use crate::samples::{find_viewpoints, trace_particles};
use glam::Vec3;
use std::time::Instant;

/// Result of the stage.
pub(super) struct Survey {
    /// Origins of importance particles, in meters.
    pub viewpoints: Vec<Vec3>,
    /// `true` if particles drop their first bounces.
    pub drop_first: bool,
    /// Settings of the bake.
    pub settings: BakeSettings,
    /// Links of the transport method, with its parameters.
    pub method: LinkMethod,
}

/// Finds viewpoints if the recipe has none, measures the lit area and fills in the settings.
pub(super) fn survey(
    context: &BakeContext<'_>,
    quality: &QualityParameters,
) -> Result<(Survey, StageCost), BakeError> {
    let began = Instant::now();
    let (geometry, recipe) = (context.source.geometry, context.recipe);
    let warning = check_precision(&geometry.bounds())?;
    context.report(BakeStage::Points, 0.0)?;
    let (viewpoints, search_rays) = if recipe.viewpoints.is_empty() {
        find_viewpoints(geometry, recipe.seed)
    } else {
        (recipe.viewpoints.iter().map(|&v| v.into()).collect(), 0)
    };
    let pilot = trace_particles(geometry, &viewpoints, 0..512, recipe.seed ^ 0x70_69, false);
    if pilot.candidates.is_empty() {
        return Err(BakeError::NoReachableSurface {
            viewpoints: viewpoints.len(),
        });
    }
    // Scenes where particles rarely survive their dropped bounces drop none ([L08] drops three of
    // thirty).
    let drop_first = pilot.candidates.len() >= 512 * 8;
    let (area, area_rays) = reached_area(geometry, &viewpoints, drop_first, recipe.seed);
    let settings = recipe.settings_with(area, quality)?;
    let cost = StageCost {
        warnings: warning.into_iter().collect(),
        ..StageCost::new(began, search_rays + pilot.rays + area_rays)
    };
    let survey = Survey {
        viewpoints,
        drop_first,
        method: settings.transport.link_method(),
        settings,
    };
    Ok((survey, cost))
}
