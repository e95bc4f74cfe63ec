//! Bake of a scene: from geometry and a recipe to a [`BakedScene`].
//!
//! A bake is a pipeline. Each stage takes the results of earlier stages and returns its own, with
//! its cost (`context`): survey (`survey`) → points (`point_set`) → rows (`transport_stage`) →
//! octree (`fmm`) → packed rows (`packing`) → energy bound (`energy`) → baked bounces (`bounces`)
//! → visibility (`visibility`) → scene, estimated error and description (`assembly`).
//!
//! Equal input gives equal bytes for any number of threads (design D5). Chunks are fixed, sums are
//! ordered and random numbers are counted. The bake uses the rayon pool of its caller.

mod assembly;
mod bake_error;
mod bake_scene;
mod bake_settings;
mod basis_training;
mod bounces;
mod closed_form;
mod context;
mod energy;
mod energy_components;
mod energy_fmm;
mod estimate;
mod fmm;
mod link_method;
mod materials;
mod occluders;
mod packing;
mod pipeline;
mod point_set;
mod precision_check;
mod probes;
mod progress;
mod quality_level;
mod ray_baseline;
mod recipe;
mod recipe_text;
mod sky;
mod staleness;
mod stats;
mod survey;
mod training_lights;
mod transport_method;
mod transport_stage;
mod visibility;

pub use crate::transport::pca::VisibilityRecipe;
pub use bake_error::BakeError;
pub use bake_scene::{BakeSceneError, bake_scene, bake_scene_with_origin};
pub use bake_settings::{BakeSettings, reached_area};
pub use estimate::{ErrorEstimate, estimate_errors};
pub use occluders::{OccluderBox, OccluderDesc};
pub use probes::ProbeSettings;
pub use progress::{BakeStage, Progress};
pub use ray_baseline::cast_gather_rays;
pub use recipe::{BounceMode, Preset, Recipe, RecipeError};
pub use sky::SkyModel;
pub use staleness::{BAKE_VERSION, BakeInputs, Staleness, canonical_recipe, is_stale};
pub use stats::{BakeStats, StageSeconds};
pub use transport_method::{FmmRecipe, PcaRecipe, TransportMethod};

use crate::asset::BakedScene;
use crate::scene::{Bvh, Geometry, Occluder, OccluderGeometry};

/// Input of a bake.
pub struct BakeSource<'a> {
    /// Geometry that rays intersect.
    pub geometry: &'a dyn Geometry,
    /// Triangles of the same geometry, for the frame's shadow rays.
    pub bvh: Bvh,
    /// Number of triangles or other primitives, for the statistics.
    pub primitives: u64,
    /// Hash of the geometry and its materials, for the fingerprint.
    pub content_hash: [u8; 32],
    /// Parts of the scene that are not in the geometry, named by the recipe's occluders.
    pub occluders: Vec<Occluder>,
}

/// Digests of what a bake was made from, for a later comparison. They do not affect the bake.
#[derive(Clone, Debug, Default)]
pub struct BakeOrigin {
    /// See [`BakeInfo::scene_digest`](crate::BakeInfo::scene_digest).
    pub scene_digest: String,
    /// See [`BakeInfo::request`](crate::BakeInfo::request).
    pub request: String,
}

/// Result of a bake.
#[derive(Debug)]
#[non_exhaustive]
pub struct Baked {
    /// Data that a frame reads.
    pub scene: BakedScene,
    /// Times and counts of the bake.
    pub stats: BakeStats,
}

/// Bakes `source` with the settings of `recipe`.
///
/// # Errors
/// See [`BakeError`]. It does not panic for any input.
pub fn bake(
    source: &BakeSource<'_>,
    recipe: &Recipe,
    progress: &Progress,
) -> Result<Baked, BakeError> {
    bake_with_origin(source, recipe, &BakeOrigin::default(), progress)
}

/// Bakes as [`bake`]. Stores `origin` in the description of the bake.
fn bake_with_origin(
    source: &BakeSource<'_>,
    recipe: &Recipe,
    origin: &BakeOrigin,
    progress: &Progress,
) -> Result<Baked, BakeError> {
    recipe.check()?;
    let occluders = occluders::find(&recipe.occluders, &source.occluders, source.geometry)?;
    if !occluders.is_empty() {
        let shapes: Vec<_> = occluders.iter().map(Occluder::shapes).collect();
        let open = BakeSource {
            geometry: &OccluderGeometry::new(source.geometry, &occluders),
            bvh: source.bvh.clone().with_occluders(&shapes),
            occluders,
            ..*source
        };
        return pipeline::bake_to_target(&open, recipe, origin, progress);
    }
    pipeline::bake_to_target(source, recipe, origin, progress)
}
