//! Result of a bake in a running app.

use super::entity_bake::GiBakeWarning;
use bevy::reflect::prelude::*;

/// Figures of a bake that has ended well.
#[derive(Reflect, Clone, Debug, Default, PartialEq)]
#[reflect(Default, Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct GiBakeSummary {
    /// Duration of the bake, or of loading it, in seconds.
    pub seconds: f64,
    /// The bake's own estimate of its error (NRMSE of indirect irradiance).
    pub estimated_nrmse: f32,
    /// Triangles of the scene.
    pub triangles: u64,
    /// Points of the basis.
    pub points: u64,
    /// Links of the operator.
    pub links: u64,
    /// `true` if the file of [`GiBakeRequest::save_to`](super::GiBakeRequest)
    /// matched and was loaded instead of baking.
    pub loaded: bool,
    /// Everything that was left out, replaced, or not saved. Each entry is in the log too.
    pub warnings: Vec<GiBakeWarning>,
}
