//! Progress of a bake, as a component that user interfaces and inspectors read.

use bevy::ecs::prelude::*;
use bevy::reflect::prelude::*;
use meshless_gi::{BakeStage, Progress};

/// Progress of the bake of its entity. Added when a bake starts, updated in
/// [`GiSystems::CollectBakes`](super::GiSystems::CollectBakes), removed when the bake ends.
#[derive(Component, Reflect, Clone, Copy, Debug, Default, PartialEq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct GiBakeProgress {
    /// Current stage.
    pub stage: BakeStage,
    /// Completed part of the stage, 0 to 1.
    pub fraction: f32,
}

impl From<&Progress> for GiBakeProgress {
    fn from(progress: &Progress) -> Self {
        let (stage, fraction) = progress.get();
        Self { stage, fraction }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stage_of_a_new_bake_is_geometry() {
        let progress = GiBakeProgress::from(&Progress::default());
        assert_eq!(progress.stage, BakeStage::Geometry);
        assert_eq!(progress.stage.to_string(), BakeStage::Geometry.name());
        assert_eq!(GiBakeProgress::default().stage, BakeStage::Waiting);
    }
}
