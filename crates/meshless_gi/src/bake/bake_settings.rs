//! Settings of a bake: a recipe with every value filled in from the quality level and the scene.

use super::VisibilityRecipe;
use super::occluders::OccluderDesc;
use super::probes::ProbeSettings;
use super::quality_level::QualityParameters;
use super::recipe::{BounceMode, Recipe, RecipeError, ron_options};
use super::sky::SkyModel;
use super::transport_method::TransportMethod;
use crate::samples::{DiskSettings, fill_level};
use crate::scene::{Geometry, SkyRadiance};
use crate::transport::Link;
use glam::Vec3;
use serde::{Deserialize, Serialize};

/// Settings of a bake. Equal settings on equal geometry give equal bytes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BakeSettings {
    /// See [`Recipe::coarse_radius`].
    pub coarse_radius: f32,
    /// See [`Recipe::levels`].
    pub levels: u32,
    /// See [`Recipe::sender_levels`].
    pub sender_levels: u32,
    /// See [`Recipe::refinement_levels`].
    #[serde(alias = "extra_levels")]
    pub refinement_levels: u32,
    /// See [`Recipe::max_refinement_points`].
    #[serde(alias = "extra_points")]
    pub max_refinement_points: u32,
    /// See [`Recipe::rays_per_point`].
    #[serde(alias = "rays")]
    pub rays_per_point: u32,
    /// See [`Recipe::samples_per_sender`].
    #[serde(alias = "places")]
    pub samples_per_sender: u32,
    /// See [`Recipe::bounces`].
    pub bounces: u32,
    /// See [`Recipe::bounce_mode`].
    pub bounce_mode: BounceMode,
    /// See [`Recipe::transport`].
    #[serde(alias = "rule")]
    pub transport: TransportMethod,
    /// See [`Recipe::truncation_error`].
    #[serde(alias = "epsilon")]
    pub truncation_error: f32,
    /// See [`Recipe::link_step`].
    #[serde(default)]
    pub link_step: f32,
    /// See [`Recipe::receiver_tolerance`].
    #[serde(alias = "tolerance")]
    pub receiver_tolerance: f32,
    /// See [`Recipe::seed`].
    pub seed: u64,
    /// See [`Recipe::clip_planes`].
    #[serde(alias = "walls")]
    pub clip_planes: bool,
    /// See [`Recipe::soft_shadows`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub soft_shadows: Option<VisibilityRecipe>,
    /// See [`Recipe::probes`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub probes: Option<ProbeSettings>,
    /// See [`Recipe::sky`].
    #[serde(default, skip_serializing_if = "SkyModel::is_uniform")]
    pub sky: SkyModel,
    /// See [`Recipe::dynamic_materials`].
    #[serde(
        alias = "live_materials",
        default,
        skip_serializing_if = "std::ops::Not::not"
    )]
    pub dynamic_materials: bool,
    /// See [`Recipe::occluders`].
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub occluders: Vec<OccluderDesc>,
}

/// Ratio of the area of a dense Poisson-disk set to its covering, so that points =
/// `PACKING_DENSITY` · area / R². Measured for dart throwing.
const PACKING_DENSITY: f32 = 0.7;

impl Recipe {
    /// Returns the settings for a scene with `area` m² of lit surfaces. The preset sets values that
    /// are left out.
    ///
    /// # Errors
    /// [`RecipeError::OutOfRange`] if values contradict each other.
    pub fn settings(&self, area: f32) -> Result<BakeSettings, RecipeError> {
        self.settings_with(area, &self.preset.parameters())
    }

    /// Returns the settings. `quality` sets values that are left out.
    pub(super) fn settings_with(
        &self,
        area: f32,
        quality: &QualityParameters,
    ) -> Result<BakeSettings, RecipeError> {
        self.check()?;
        let quality = &self.transport.defaults(quality);
        let levels = self.levels.unwrap_or(5);
        let sender_levels = self
            .sender_levels
            .unwrap_or(quality.sender_levels.min(levels));
        if sender_levels > levels {
            let allowed = "at most `levels`";
            return Err(RecipeError::out_of_range(
                "sender_levels",
                sender_levels,
                allowed,
            ));
        }
        let fine = (PACKING_DENSITY * area / quality.points).sqrt();
        let coarse_radius = self
            .coarse_radius
            .unwrap_or(fine * (1u32 << (levels - 1)) as f32);
        if !(coarse_radius.is_finite() && coarse_radius > 0.0) {
            let allowed = "a length above 0; the scene seems to have no surface that light reaches";
            return Err(RecipeError::out_of_range(
                "coarse_radius",
                coarse_radius,
                allowed,
            ));
        }
        // Approximate number of senders of the finest sender level.
        let radius = coarse_radius / (1u32 << (sender_levels.max(1) - 1)) as f32;
        let senders = PACKING_DENSITY * area / (radius * radius);
        let has_quantized_links = self.transport.has_quantized_links();
        Ok(BakeSettings {
            coarse_radius,
            levels,
            sender_levels,
            refinement_levels: self.refinement_levels.unwrap_or(quality.refinement_levels),
            max_refinement_points: (self.max_refinement_points)
                .unwrap_or(quality.max_refinement_points as u32),
            rays_per_point: self.rays_per_point.unwrap_or(quality.rays_per_point),
            samples_per_sender: (self.samples_per_sender).unwrap_or(quality.samples_per_sender),
            bounces: self.bounces.unwrap_or(4),
            bounce_mode: self.bounce_mode,
            transport: self.transport.with_cluster_size(senders),
            truncation_error: self.truncation_error.unwrap_or(quality.truncation_error),
            link_step: (self.link_step.filter(|_| has_quantized_links))
                .unwrap_or(quality.link_step),
            receiver_tolerance: self
                .receiver_tolerance
                .unwrap_or(quality.receiver_tolerance),
            seed: self.seed,
            clip_planes: self.clip_planes.unwrap_or(true),
            soft_shadows: self.soft_shadows,
            probes: self.probes,
            sky: self.sky,
            dynamic_materials: self.dynamic_materials,
            occluders: self.occluders.clone(),
        })
    }
}

impl BakeSettings {
    /// Reads the settings that a bake stores in its [`BakeInfo`](crate::asset::BakeInfo).
    ///
    /// # Errors
    /// [`RecipeError::Syntax`].
    pub fn from_ron(text: &str) -> Result<Self, RecipeError> {
        let read = ron_options().from_str(text);
        read.map_err(|e| RecipeError::Syntax(e.to_string()))
    }

    /// Returns the settings as RON text.
    #[must_use]
    pub fn to_ron(&self) -> String {
        ron_options().to_string(self).unwrap_or_default()
    }

    /// Returns the number of gather rays per point of a level. Added levels have many points that
    /// cover little surface each, and use half of the rays.
    #[must_use]
    pub fn rays_of_level(&self, level: usize) -> u32 {
        match level < self.levels as usize {
            true => self.rays_per_point,
            false => (self.rays_per_point / 2).max(16),
        }
    }

    /// Returns the largest number of points of each level. Sender indices have 16 bits. Memory
    /// limits the other levels.
    #[must_use]
    pub fn max_points(&self) -> Vec<usize> {
        // Levels grow by a factor of four. This gives the fraction of all senders that level l of s
        // sender levels has.
        let sky = match self.sky {
            SkyModel::Uniform => 1,
            SkyModel::Harmonics => 1 + SkyRadiance::TERMS,
        };
        let senders = (Link::MAX_SENDERS - sky) as f64;
        let total: f64 = (0..self.sender_levels).map(|l| 4f64.powi(l as i32)).sum();
        (0..self.levels)
            .map(|l| {
                if l < self.sender_levels {
                    ((senders * 4f64.powi(l as i32) / total) as usize).max(1)
                } else {
                    1 << 22
                }
            })
            .collect()
    }
}

/// Measures the area in m² of the surfaces that light reaches, from a pilot level of coarse disks.
/// Also returns the number of rays cast.
#[must_use]
pub fn reached_area(
    geometry: &dyn Geometry,
    viewpoints: &[Vec3],
    drop_first: bool,
    seed: u64,
) -> (f32, u64) {
    let size = geometry.bounds().size();
    // About a thousand disks on a box of this size.
    let box_area = 2.0 * (size.x * size.y + size.y * size.z + size.z * size.x);
    let radius = (PACKING_DENSITY * box_area / 1000.0).sqrt();
    if radius <= 0.0 || !radius.is_finite() {
        return (0.0, 0);
    }
    let disks = fill_level(
        geometry,
        viewpoints,
        &DiskSettings {
            radius,
            open_only: false,
            max: 1 << 18,
            seed: seed ^ 0x61_72_65_61,
            drop_first,
        },
    );
    (
        disks.points.len() as f32 * radius * radius / PACKING_DENSITY,
        disks.rays,
    )
}
