//! What to bake and how: the recipe that a user writes (RON, or options of the tool), and the
//! settings that follow from it and from the scene's size.

use super::occluders::{OccluderDesc, check_shapes};
use super::octree::OctreeSettings;
use super::probes::ProbeSettings;
use super::quality_level::QualityParameters;
use super::sky::Sky;
use super::visibility::VisibilityRecipe;
use crate::asset::Places;
use crate::scene::{Geometry, SkyRadiance};
use crate::transport::Link;
use glam::Vec3;
use serde::{Deserialize, Serialize};

/// How much care a bake takes; what is left out of a recipe follows from it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Preset {
    /// To look at while building a level.
    Draft,
    /// To ship.
    #[default]
    Medium,
    /// When the error must halve.
    High,
}

/// Which links are kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum TransportMethod {
    /// Rows keep their mass, with a bound on what they blur, see [`crate::transport::bounded`].
    #[default]
    Bounded,
    /// \[L08\] Figure 5 as published, see [`crate::transport::l08`].
    L08,
    /// Bases of direct light for clusters of senders, after \[P14\] §4.3, see
    /// [`crate::transport::pca`]. Receivers are those of `Bounded`.
    Pca,
    /// An octree of points in place of links, after \[G08\], see [`crate::transport::fmm`]: the
    /// frame carries light by the fast multipole method.
    Fmm,
}

/// Where the second and later bounces are computed (design D2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum BounceMode {
    /// In the frame, by sweeps over the senders: materials may change.
    #[default]
    Live,
    /// In the bake, by the Neumann series on the coarsest points: fewest steps a frame. Needs
    /// [`TransportMethod::Bounded`].
    Baked,
}

/// A recipe. Everything has a default; `Recipe::default()` bakes any level.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Recipe {
    /// The level, relative to the recipe's own file. Needed in a `.gi.ron` file, not used by a
    /// library call.
    pub scene: Option<String>,
    /// How much care to take.
    pub preset: Preset,
    /// Places in free space from which light can be seen, meters; found by itself where empty
    /// (\[L08\] §2.3).
    pub viewpoints: Vec<[f32; 3]>,
    /// Disk radius of the coarsest level, meters.
    pub coarse_radius: Option<f32>,
    /// Levels of the hierarchy, 1 to 12.
    pub levels: Option<u32>,
    /// How many of them, from the coarsest, are senders.
    pub sender_levels: Option<u32>,
    /// Levels that are added where light asks for more detail, 0 to 8 (not with `L08`).
    pub extra_levels: Option<u32>,
    /// Most points of all added levels together.
    pub extra_points: Option<u32>,
    /// Rays a gather, 16 to 65536; points of added levels take half.
    pub rays: Option<u32>,
    /// Places that each sender of the finest sender level is lit at, 1 to 64: more make light move
    /// more smoothly, and cost as many shadow rays for each lamp that moves.
    pub places: Option<u32>,
    /// Diffuse reflections, 1 to 64.
    pub bounces: Option<u32>,
    /// Where the later bounces are computed.
    pub bounce_mode: BounceMode,
    /// Which links are kept.
    pub rule: TransportMethod,
    /// Threshold of the rule: the bound on what a row blurs (`Bounded`) or leaves out (`Pca`), or ε
    /// of \[L08\] Figure 5.
    pub epsilon: Option<f32>,
    /// Difference to the parents' value below which a receiver needs no row (not with `L08`).
    pub tolerance: Option<f32>,
    /// Takes as much care as it needs for an estimated NRMSE of at most this, whatever the preset
    /// says: bakes coarsely first, and finer until it is met.
    pub max_error: Option<f32>,
    /// Vectors of a cluster's basis of direct light, 1 to 1000 (`Pca`).
    pub coefficients: Option<u32>,
    /// Senders of a cluster, about, 1 to 65536 (`Pca`); where left out, so many that there are
    /// about 64 clusters.
    pub cluster_points: Option<u32>,
    /// Example lamps that the bases are made from, 0 to 65536 (`Pca`).
    pub lamps: Option<u32>,
    /// Order of the expansions, 0 to 16; kernels take 6 at most (`Fmm`).
    pub order: Option<u32>,
    /// Most points of a leaf of the octree, 1 to 4096 (`Fmm`).
    pub leaf: Option<u32>,
    /// Places that each sender of the finest sender level shines from, 1 to 64 (`Fmm`).
    pub sources: Option<u32>,
    /// Rays that decide what two nodes of the octree see of each other, 1 to 4096 (`Fmm`).
    pub pair_rays: Option<u32>,
    /// Bakes the links of `Bounded` on the same points too, for devices and frames that do not hold
    /// the octree (`Fmm`).
    pub fallback: bool,
    /// Bakes what the senders and one level behind them see, for lights with soft shadows; left
    /// out: such lights cast none.
    pub soft_shadows: Option<VisibilityRecipe>,
    /// Light in free space, for what moves (rule `Bounded`).
    pub probes: Option<ProbeSettings>,
    /// Which skies may light the level (`Harmonics` with rule `Bounded` only).
    pub sky: Sky,
    /// Base colors and emission may change in the running game (rule `Bounded`, bounce mode
    /// `Live`).
    pub live_materials: bool,
    /// Doors, lifts and what else comes and goes in the running game, 64 at most: the light through
    /// them gets a gain (rule `Bounded`, bounce mode `Live`).
    pub occluders: Vec<OccluderDesc>,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Whether functions stop at walls (design D7). Off is the paper's way, and leaks.
    pub walls: Option<bool>,
}

impl From<Preset> for Recipe {
    /// The recipe with this preset and defaults.
    fn from(preset: Preset) -> Self {
        Self {
            preset,
            ..Self::default()
        }
    }
}

/// A recipe that cannot be followed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RecipeError {
    /// A value outside of what it may be.
    #[error("`{field}` is {value}, but must be {allowed}")]
    OutOfRange {
        /// The field.
        field: &'static str,
        /// What it said.
        value: String,
        /// What it may say.
        allowed: &'static str,
    },
    /// Text that is no recipe.
    #[error("the recipe cannot be read: {0}")]
    Syntax(String),
}

/// A recipe with everything filled in: what a bake does. Equal settings on equal geometry give
/// equal bytes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// See [`Recipe::coarse_radius`].
    pub coarse_radius: f32,
    /// See [`Recipe::levels`].
    pub levels: u32,
    /// See [`Recipe::sender_levels`].
    pub sender_levels: u32,
    /// See [`Recipe::extra_levels`].
    pub extra_levels: u32,
    /// See [`Recipe::extra_points`].
    pub extra_points: u32,
    /// See [`Recipe::rays`].
    pub rays: u32,
    /// See [`Recipe::places`].
    pub places: u32,
    /// See [`Recipe::bounces`].
    pub bounces: u32,
    /// See [`Recipe::bounce_mode`].
    pub bounce_mode: BounceMode,
    /// See [`Recipe::rule`].
    pub rule: TransportMethod,
    /// See [`Recipe::epsilon`].
    pub epsilon: f32,
    /// See [`Recipe::tolerance`].
    pub tolerance: f32,
    /// See [`Recipe::coefficients`]; 0 under every other rule.
    pub coefficients: u32,
    /// See [`Recipe::cluster_points`]; 0 under every other rule.
    pub cluster_points: u32,
    /// See [`Recipe::lamps`]; 0 under every other rule.
    pub lamps: u32,
    /// See [`Recipe::seed`].
    pub seed: u64,
    /// See [`Recipe::walls`].
    pub walls: bool,
    /// The octree of rule `fmm`; nothing under every other rule.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub octree: Option<OctreeSettings>,
    /// See [`Recipe::soft_shadows`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub soft_shadows: Option<VisibilityRecipe>,
    /// See [`Recipe::probes`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub probes: Option<ProbeSettings>,
    /// See [`Recipe::sky`].
    #[serde(default, skip_serializing_if = "Sky::is_uniform")]
    pub sky: Sky,
    /// See [`Recipe::live_materials`].
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub live_materials: bool,
    /// See [`Recipe::occluders`].
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub occluders: Vec<OccluderDesc>,
}

/// Share of the plane that disks of radius R fill when no more fit: points = FILL · area / R²,
/// measured for dart throwing.
const FILL: f32 = 0.7;

/// Clusters of senders under rule `pca`, about: as \[P14\] §6 has them, a few more.
const CLUSTERS: f32 = 64.0;
/// Senders that make a cluster of their own at least.
const MIN_CLUSTER: f32 = 16.0;

impl Recipe {
    /// Reads a recipe from RON.
    ///
    /// # Errors
    /// [`RecipeError::Syntax`] with the place, [`RecipeError::OutOfRange`] for a value that makes no sense.
    pub fn from_ron(text: &str) -> Result<Self, RecipeError> {
        let recipe: Self = ron::Options::default()
            .with_default_extension(ron::extensions::Extensions::IMPLICIT_SOME)
            .from_str(text)
            .map_err(|e| RecipeError::Syntax(e.to_string()))?;
        recipe.check()?;
        Ok(recipe)
    }

    /// Checks every value on its own.
    ///
    /// # Errors
    /// [`RecipeError::OutOfRange`].
    pub fn check(&self) -> Result<(), RecipeError> {
        fn within<T: PartialOrd + Copy + ToString>(
            field: &'static str,
            value: Option<T>,
            low: T,
            high: T,
            allowed: &'static str,
        ) -> Result<(), RecipeError> {
            match value {
                Some(v) if !(v >= low && v <= high) => Err(RecipeError::OutOfRange {
                    field,
                    value: v.to_string(),
                    allowed,
                }),
                _ => Ok(()),
            }
        }
        within(
            "coarse_radius",
            self.coarse_radius,
            1e-9,
            1e9,
            "a length from 1e-9 to 1e9 meters",
        )?;
        within("levels", self.levels, 1, 12, "1 to 12")?;
        within(
            "sender_levels",
            self.sender_levels,
            1,
            12,
            "1 to 12 and at most `levels`",
        )?;
        within("extra_levels", self.extra_levels, 0, 8, "0 to 8")?;
        within(
            "extra_points",
            self.extra_points,
            0,
            1 << 22,
            "0 to 4194304",
        )?;
        within("rays", self.rays, 16, 65_536, "16 to 65536")?;
        if let Some(soft) = &self.soft_shadows {
            soft.check()?;
        }
        if let Some(probes) = &self.probes {
            probes.check()?;
            if self.rule != TransportMethod::Bounded {
                return Err(RecipeError::OutOfRange {
                    field: "probes",
                    value: format!("there with rule {:?}", self.rule),
                    allowed: "there with rule Bounded only",
                });
            }
        }
        if self.sky == Sky::Harmonics && self.rule != TransportMethod::Bounded {
            return Err(RecipeError::OutOfRange {
                field: "sky",
                value: format!("Harmonics with rule {:?}", self.rule),
                allowed: "Uniform, or Harmonics with rule Bounded",
            });
        }
        let live = self.rule == TransportMethod::Bounded && self.bounce_mode == BounceMode::Live;
        if self.live_materials && !live {
            return Err(RecipeError::OutOfRange {
                field: "live_materials",
                value: format!(
                    "on with rule {:?} and bounces {:?}",
                    self.rule, self.bounce_mode
                ),
                allowed: "on with rule Bounded and bounces Live only",
            });
        }
        if !self.occluders.is_empty() && !live {
            return Err(RecipeError::OutOfRange {
                field: "occluders",
                value: format!(
                    "there with rule {:?} and bounces {:?}",
                    self.rule, self.bounce_mode
                ),
                allowed: "there with rule Bounded and bounces Live only",
            });
        }
        check_shapes(&self.occluders)?;
        within("places", self.places, 1, Places::MAX, "1 to 64")?;
        within("bounces", self.bounces, 1, 64, "1 to 64")?;
        within("epsilon", self.epsilon, 0.0, 1.0, "0 to 1")?;
        within("tolerance", self.tolerance, 0.0, 1.0, "0 to 1")?;
        within("coefficients", self.coefficients, 1, 1000, "1 to 1000")?;
        within(
            "cluster_points",
            self.cluster_points,
            1,
            65_536,
            "1 to 65536",
        )?;
        within("lamps", self.lamps, 0, 65_536, "0 to 65536")?;
        within("order", self.order, 0, 16, "0 to 16")?;
        within("leaf", self.leaf, 1, 4096, "1 to 4096")?;
        within("sources", self.sources, 1, 64, "1 to 64")?;
        within("pair_rays", self.pair_rays, 1, 4096, "1 to 4096")?;
        within("max_error", self.max_error, 1e-4, 1.0, "0.0001 to 1")?;
        if let Some(v) = self
            .viewpoints
            .iter()
            .find(|v| !v.iter().all(|c| c.is_finite()))
        {
            return Err(RecipeError::OutOfRange {
                field: "viewpoints",
                value: format!("{v:?}"),
                allowed: "finite coordinates",
            });
        }
        let allowed = match self.rule {
            TransportMethod::Bounded => None,
            TransportMethod::L08 => Some("Live with rule L08, whose rows are differences"),
            TransportMethod::Pca => Some("Live with rule Pca, whose rows are components"),
            TransportMethod::Fmm => {
                Some("Live with rule Fmm, whose octree is run for every reflection")
            }
        };
        if let (BounceMode::Baked, Some(allowed)) = (self.bounce_mode, allowed) {
            return Err(RecipeError::OutOfRange {
                field: "bounce_mode",
                value: "Baked".into(),
                allowed,
            });
        }
        Ok(())
    }

    /// Fills in what is left out as the preset has it, for a surface of `area` m² reached by light.
    ///
    /// # Errors
    /// [`RecipeError::OutOfRange`] where values do not go together.
    pub fn settings(&self, area: f32) -> Result<Settings, RecipeError> {
        self.settings_with(area, &self.preset.care())
    }

    /// Fills in what is left out as `care` has it.
    pub(super) fn settings_with(
        &self,
        area: f32,
        care: &QualityParameters,
    ) -> Result<Settings, RecipeError> {
        self.check()?;
        let levels = self.levels.unwrap_or(5);
        let sender_levels = self.sender_levels.unwrap_or(care.sender_levels.min(levels));
        if sender_levels > levels {
            return Err(RecipeError::OutOfRange {
                field: "sender_levels",
                value: sender_levels.to_string(),
                allowed: "at most `levels`",
            });
        }
        let fine = (FILL * area / care.points).sqrt();
        let coarse_radius = self
            .coarse_radius
            .unwrap_or(fine * (1u32 << (levels - 1)) as f32);
        if !(coarse_radius.is_finite() && coarse_radius > 0.0) {
            return Err(RecipeError::OutOfRange {
                field: "coarse_radius",
                value: coarse_radius.to_string(),
                allowed: "a length above 0; the scene seems to have no surface that light reaches",
            });
        }
        // Senders of the finest level, about.
        let radius = coarse_radius / (1u32 << (sender_levels.max(1) - 1)) as f32;
        let senders = FILL * area / (radius * radius);
        let a_cluster = (senders / CLUSTERS).clamp(MIN_CLUSTER, 65_536.0) as u32;
        let pca = |value: Option<u32>, usual| match self.rule {
            TransportMethod::Pca => value.unwrap_or(usual),
            TransportMethod::Bounded | TransportMethod::L08 | TransportMethod::Fmm => 0,
        };
        Ok(Settings {
            coarse_radius,
            levels,
            sender_levels,
            extra_levels: self.extra_levels.unwrap_or(care.extra_levels),
            extra_points: self.extra_points.unwrap_or(care.extra_points as u32),
            rays: self.rays.unwrap_or(care.rays),
            places: self.places.unwrap_or(match self.rule {
                TransportMethod::Bounded | TransportMethod::Pca | TransportMethod::Fmm => {
                    care.places
                }
                // [L08] takes the light at a function's own point.
                TransportMethod::L08 => 1,
            }),
            bounces: self.bounces.unwrap_or(4),
            bounce_mode: self.bounce_mode,
            rule: self.rule,
            epsilon: self.epsilon.unwrap_or(match self.rule {
                TransportMethod::Bounded | TransportMethod::Pca | TransportMethod::Fmm => {
                    care.epsilon
                }
                // [L08] §4.2: 0.025 in all tests.
                TransportMethod::L08 => 0.025,
            }),
            tolerance: self.tolerance.unwrap_or(care.tolerance),
            coefficients: pca(self.coefficients, 10),
            cluster_points: pca(self.cluster_points, a_cluster),
            lamps: pca(self.lamps, 1000),
            seed: self.seed,
            walls: self.walls.unwrap_or(true),
            octree: (self.rule == TransportMethod::Fmm).then(|| OctreeSettings::of(self)),
            soft_shadows: self.soft_shadows,
            probes: self.probes,
            sky: self.sky,
            live_materials: self.live_materials,
            occluders: self.occluders.clone(),
        })
    }
}

impl Settings {
    /// Rays a gather at a point of this level. Levels that were added stand for little surface each
    /// and are many: half as many do.
    #[must_use]
    pub fn rays_of_level(&self, level: usize) -> u32 {
        match level < self.levels as usize {
            true => self.rays,
            false => (self.rays / 2).max(16),
        }
    }

    /// Most points of each level: senders must fit the operator's 16-bit index, all of them memory.
    #[must_use]
    pub fn most_points(&self) -> Vec<usize> {
        // Levels grow by four, so level l of s sender levels may have this share of all senders.
        let sky = match self.sky {
            Sky::Uniform => 1,
            Sky::Harmonics => 1 + SkyRadiance::TERMS,
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

/// Area, in m², of the surfaces that light reaches, from a pilot level of coarse disks. Also says
/// how many rays it took.
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
    let radius = (FILL * box_area / 1000.0).sqrt();
    if radius <= 0.0 || !radius.is_finite() {
        return (0.0, 0);
    }
    let disks = crate::samples::fill_level(
        geometry,
        viewpoints,
        &crate::samples::DiskSettings {
            radius,
            open_only: false,
            most: 1 << 18,
            seed: seed ^ 0x61_72_65_61,
            drop_first,
        },
    );
    (
        disks.points.len() as f32 * radius * radius / FILL,
        disks.rays,
    )
}
