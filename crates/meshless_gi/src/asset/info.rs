//! Facts about a bake: inputs, error and sizes. All are equal for equal input on any machine.

use super::scene_data::SceneData;
use crate::transport::Link;
use serde::{Deserialize, Serialize};

/// Size and error of a tier. They include the rows of all lower tiers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct TierInfo {
    /// Rows.
    pub rows: u64,
    /// Links. For the octree of method `fmm`, entries of the lists.
    pub links: u64,
    /// Estimated error as [`BakeInfo::estimated_nrmse`], with the same lights and positions for all
    /// tiers.
    pub estimated_nrmse: f32,
    /// Half width of its 95 % prediction interval for one more light.
    pub estimated_nrmse_interval: f32,
}

impl TierInfo {
    /// Returns the tiers of a scene, without measured errors.
    #[must_use]
    pub fn from_scene(scene: &SceneData) -> Vec<Self> {
        let sizes = scene.tier_sizes().into_iter();
        sizes
            .map(|(rows, links)| Self {
                rows,
                links,
                ..Self::default()
            })
            .collect()
    }

    /// Returns the size of its links in memory and on the device, bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.links * size_of::<Link>() as u64
    }
}

/// Facts about a bake. Stored in the asset, printed by `inspect`. It contains no times, so that
/// equal bakes have equal bytes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct BakeInfo {
    /// Version of this crate that baked it.
    pub version: String,
    /// Version of the bake, [`BAKE_VERSION`](crate::bake::BAKE_VERSION). 0 in files older than this
    /// field.
    #[serde(default)]
    pub bake_version: u32,
    /// BLAKE3, as hex, of everything the bake depended on: geometry, settings and bake version.
    pub fingerprint: String,
    /// BLAKE3, as hex, of the geometry and its materials. Empty in files older than this field.
    #[serde(default)]
    pub content_hash: String,
    /// Scene that the recipe names, relative to the recipe. `None` for geometry that was given
    /// without a name.
    #[serde(default, alias = "level")]
    pub scene: Option<String>,
    /// BLAKE3, as hex, of the bytes of the scene's file and of all files that it names: a digest
    /// that needs no parsing. Empty if the bake was given geometry and no files.
    #[serde(default, alias = "level_digest")]
    pub scene_digest: String,
    /// Recipe as it was given, without its `scene`, as RON. Empty in files older than this field.
    #[serde(default)]
    pub given_recipe: String,
    /// Recipe with every default filled in, as RON.
    pub recipe: String,
    /// Triangles (or other primitives) of the source.
    pub triangles: u64,
    /// Rays cast by the bake.
    pub rays: u64,
    /// Box around the geometry, meters: smallest and largest corner.
    pub bounds: [[f32; 3]; 2],
    /// Start positions of the importance particles, meters.
    pub viewpoints: Vec<[f32; 3]>,
    /// Estimated NRMSE of the indirect irradiance, from unbiased Monte Carlo at random surface
    /// points for random lights.
    pub estimated_nrmse: f32,
    /// Half width of the 95 % prediction interval around `estimated_nrmse`. It contains the error
    /// of one more light, since errors differ between lights.
    pub estimated_nrmse_interval: f32,
    /// Tiers of the operator, the one with the fewest links first. The last is the whole operator
    /// (design D11).
    pub tiers: Vec<TierInfo>,
    /// Diffuse reflections of a frame that the recipe requests.
    pub bounces: u32,
    /// Largest packing error of a link, relative to the largest link of its row.
    pub link_error: f32,
    /// Fraction of the gathered light from surfaces that no sender covers.
    pub uncovered: f32,
    /// Largest row sum of F·n in the gather.
    pub largest_row_sum: f32,
    /// Spectral radius and energy checks of the bounces.
    #[serde(default)]
    pub energy: EnergyInfo,
    /// BLAKE3, as hex, of the request of a bake from entities: geometry, materials, recipe and
    /// version. Empty for other bakes.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub request: String,
}

/// Bound on the gain of one reflection, and deviations of the operator from energy conservation and
/// reciprocity. Measured on the packed operator that a frame uses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
#[non_exhaustive]
pub struct EnergyInfo {
    /// Proved upper bound on the gain of one diffuse reflection in a frame of any tier. The gain is
    /// the spectral radius of ρG on the senders. The bound is below 1, so that light decays. It is
    /// only an estimate if `estimated`.
    #[serde(alias = "gain")]
    pub spectral_radius_bound: f32,
    /// `true` if the gain is an estimate. Operators of components have signs, so that nothing is
    /// proved.
    pub estimated: bool,
    /// Estimate of the spectral radius by power iteration.
    #[serde(alias = "gain_found")]
    pub spectral_radius_estimate: f32,
    /// Senders with a lowered albedo, which limits the gain to 0.999. Needed for closed scenes with
    /// albedos near 1, in which light would not decay.
    #[serde(alias = "guarded")]
    pub clamped_senders: u64,
    /// Smallest factor by which an albedo was lowered. 1 if none was.
    #[serde(alias = "guard_factor")]
    pub albedo_scale: f32,
    /// Largest deviation of a row from the hemisphere's closed form. Links, sky, and the part that
    /// no sender covers should sum to one.
    pub row_deviation: f32,
    /// Root mean square of the deviation over all rows.
    pub row_deviation_rms: f32,
    /// Root mean square of the difference between the light that pairs of surfaces send each other.
    /// It is relative to the root mean square of the mean, and due to noise of rays and points.
    pub reciprocity: f32,
}
