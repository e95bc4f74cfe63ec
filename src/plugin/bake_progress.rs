//! Progress of a bake, as a component that user interfaces and inspectors read.

use bevy::ecs::prelude::*;
use bevy::reflect::prelude::*;
use meshless_gi::{BakeStage, Progress};
use std::fmt;

/// Progress of the bake of its entity. Added when a bake starts, updated in
/// [`GiSystems::CollectBakes`](super::GiSystems::CollectBakes), removed when the bake ends.
#[derive(Component, Reflect, Clone, Copy, Debug, Default, PartialEq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct GiBakeProgress {
    /// Current stage.
    pub stage: GiBakeStage,
    /// Completed part of the stage, 0 to 1.
    pub fraction: f32,
}

/// Stages of a bake in a running app, in their order.
#[derive(Reflect, Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[reflect(Default, Clone, Debug, PartialEq, Hash)]
#[non_exhaustive]
pub enum GiBakeStage {
    /// Waiting for scenes, meshes, materials and images below the root.
    #[default]
    Waiting,
    /// Collecting triangles and building the ray-casting hierarchy.
    Geometry,
    /// Scattering points.
    Points,
    /// Gathering and refining the operator.
    Transport,
    /// Gathering the light of probes.
    Probes,
    /// Baking further bounces.
    Bounces,
    /// Baking visibility for soft shadows.
    Visibility,
    /// Measuring the error.
    ErrorEstimate,
}

impl GiBakeStage {
    /// Short description for a user interface.
    #[must_use]
    pub fn name(self) -> &'static str {
        let stage = match self {
            Self::Waiting => return "waiting for assets",
            Self::Geometry => BakeStage::Bvh,
            Self::Points => BakeStage::Points,
            Self::Transport => BakeStage::Transport,
            Self::Probes => BakeStage::Probes,
            Self::Bounces => BakeStage::Bounces,
            Self::Visibility => BakeStage::Visibility,
            Self::ErrorEstimate => BakeStage::ErrorEstimate,
        };
        stage.name()
    }
}

impl fmt::Display for GiBakeStage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl From<BakeStage> for GiBakeStage {
    fn from(stage: BakeStage) -> Self {
        match stage {
            BakeStage::Bvh => Self::Geometry,
            BakeStage::Points => Self::Points,
            BakeStage::Transport => Self::Transport,
            BakeStage::Probes => Self::Probes,
            BakeStage::Bounces => Self::Bounces,
            BakeStage::Visibility => Self::Visibility,
            _ => Self::ErrorEstimate,
        }
    }
}

impl From<&Progress> for GiBakeProgress {
    fn from(progress: &Progress) -> Self {
        let (stage, fraction) = progress.get();
        Self {
            stage: stage.into(),
            fraction,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stage_of_a_new_bake_is_geometry() {
        let progress = GiBakeProgress::from(&Progress::default());
        assert_eq!(progress.stage, GiBakeStage::Geometry);
        assert_eq!(progress.stage.to_string(), BakeStage::Bvh.name());
        assert_eq!(GiBakeProgress::default().stage, GiBakeStage::Waiting);
    }
}
