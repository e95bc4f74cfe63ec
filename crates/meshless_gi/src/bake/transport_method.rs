//! Representation of light transport: the method of a recipe, with its parameters.

use super::link_method::LinkMethod;
use super::quality_level::QualityParameters;
use super::recipe::{RecipeError, in_range};
#[cfg(feature = "bevy_reflect")]
use bevy_reflect::std_traits::ReflectDefault;
use serde::{Deserialize, Serialize};

/// Approximate number of sender clusters of method `pca`, a little more than in \[P14\] §6.
const CLUSTERS: f32 = 64.0;
/// Smallest automatic cluster, in senders.
const MIN_CLUSTER: f32 = 16.0;

/// Representation of the transport operator.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(
    feature = "bevy_reflect",
    derive(bevy_reflect::Reflect),
    reflect(Default, Clone, Debug, PartialEq, Hash)
)]
#[non_exhaustive]
pub enum TransportMethod {
    /// Links that keep the mass of each row, with a bound on the truncation error. See
    /// [`crate::transport::bounded_truncation`].
    #[default]
    Bounded,
    /// Links by \[L08\] Figure 5 as published. See [`crate::transport::l08_truncation`].
    L08,
    /// Bases of direct light for clusters of senders, after \[P14\] §4.3. See
    /// [`crate::transport::pca`]. Receivers are those of `Bounded`.
    Pca(PcaRecipe),
    /// Octree of points in place of links, after \[G08\]. See [`crate::transport::fmm`]. The frame
    /// computes transport by the fast multipole method.
    Fmm(FmmRecipe),
}

impl TransportMethod {
    /// Returns method `Pca` with default parameters.
    #[must_use]
    pub fn pca() -> Self {
        Self::Pca(PcaRecipe::default())
    }

    /// Returns method `Fmm` with default parameters.
    #[must_use]
    pub fn fmm() -> Self {
        Self::Fmm(FmmRecipe::default())
    }

    /// Returns `true` if both are the same method, with any parameters.
    #[must_use]
    pub fn is_same_method(&self, other: &Self) -> bool {
        self.name() == other.name()
    }

    /// Returns the name without parameters, as in a recipe.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Bounded => "Bounded",
            Self::L08 => "L08",
            Self::Pca(_) => "Pca",
            Self::Fmm(_) => "Fmm",
        }
    }

    /// Returns the links of the method, with its parameters.
    pub(super) fn link_method(self) -> LinkMethod {
        match self {
            Self::Bounded => LinkMethod::Averages,
            Self::L08 => LinkMethod::Differences,
            Self::Pca(pca) => LinkMethod::Components(pca),
            Self::Fmm(fmm) => LinkMethod::Octree(fmm),
        }
    }

    /// Returns the method with the cluster size for `senders` senders if it has none.
    pub(super) fn with_cluster_size(self, senders: f32) -> Self {
        let Self::Pca(pca) = self else {
            return self;
        };
        let usual = (senders / CLUSTERS).clamp(MIN_CLUSTER, 65_536.0) as u32;
        Self::Pca(PcaRecipe {
            cluster_size: Some(pca.cluster_size.unwrap_or(usual)),
            ..pca
        })
    }

    /// Returns `true` if links are quantized. Coefficients of light bases have no direction, and
    /// [L08] has links as published.
    pub(super) fn has_quantized_links(self) -> bool {
        matches!(self, Self::Bounded | Self::Fmm(_))
    }

    /// Returns the quality level with the defaults of the method.
    pub(super) fn defaults(self, quality: &QualityParameters) -> QualityParameters {
        let mut defaults = *quality;
        if !self.has_quantized_links() {
            defaults.link_step = 0.0;
        }
        if self == Self::L08 {
            // [L08] evaluates the light at the sender's own point, and ε = 0.025 in all tests
            // (§4.2).
            (defaults.samples_per_sender, defaults.truncation_error) = (1, 0.025);
        }
        defaults
    }

    /// Checks the parameters.
    pub(super) fn check(&self) -> Result<(), RecipeError> {
        match self {
            Self::Bounded | Self::L08 => Ok(()),
            Self::Pca(pca) => pca.check(),
            Self::Fmm(fmm) => fmm.check(),
        }
    }
}

/// Parameters of [`TransportMethod::Pca`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(
    feature = "bevy_reflect",
    derive(bevy_reflect::Reflect),
    reflect(Default, Clone, Debug, PartialEq, Hash)
)]
#[cfg_attr(feature = "documentation", derive(documented::DocumentedFields))]
#[serde(default, deny_unknown_fields)]
pub struct PcaRecipe {
    /// Vectors of the light basis of a cluster, 1 to 1000. Default 10. More reduce the error and
    /// add links.
    pub coefficients: u32,
    /// Approximate number of senders of a cluster, 1 to 65536. Default: about 64 clusters.
    #[serde(alias = "cluster_points")]
    pub cluster_size: Option<u32>,
    /// Number of lights that the bases are trained on, 0 to 65536. Default 1000.
    #[serde(alias = "lamps")]
    pub training_lights: u32,
}

impl Default for PcaRecipe {
    fn default() -> Self {
        Self {
            coefficients: 10,
            cluster_size: None,
            training_lights: 1000,
        }
    }
}

impl PcaRecipe {
    fn check(&self) -> Result<(), RecipeError> {
        let coefficients = Some(self.coefficients);
        in_range("transport.coefficients", coefficients, 1..=1000)?;
        in_range("transport.cluster_size", self.cluster_size, 1..=65_536)?;
        let lights = Some(self.training_lights);
        in_range("transport.training_lights", lights, 0..=65_536)
    }
}

/// Parameters of [`TransportMethod::Fmm`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(
    feature = "bevy_reflect",
    derive(bevy_reflect::Reflect),
    reflect(Default, Clone, Debug, PartialEq, Hash)
)]
#[cfg_attr(feature = "documentation", derive(documented::DocumentedFields))]
#[serde(default, deny_unknown_fields)]
pub struct FmmRecipe {
    /// Order of the expansions, 0 to 16. Default 2. GPU kernels support up to 6. Areas, visibility
    /// and sampling cause larger errors than the terms beyond order 2
    /// (docs/reports/fmm.md).
    pub order: u32,
    /// Largest number of points of an octree leaf, 1 to 4096. Default 24.
    #[serde(alias = "leaf")]
    pub leaf_size: u32,
    /// Number of points from which a sender of the finest sender level emits, 1 to 64. Default 4.
    #[serde(alias = "sources")]
    pub samples_per_sender: u32,
    /// Number of rays that determine the visibility between two octree nodes, 1 to 4096. Default
    /// 16.
    #[serde(alias = "pair_rays")]
    pub visibility_rays: u32,
    /// Adds the links of `Bounded` on the same points. Default `false`. Enable it for devices and
    /// frames that cannot run the octree.
    #[serde(alias = "fallback")]
    pub fallback_links: bool,
}

impl Default for FmmRecipe {
    fn default() -> Self {
        Self {
            order: 2,
            leaf_size: 24,
            samples_per_sender: 4,
            visibility_rays: 16,
            fallback_links: false,
        }
    }
}

impl FmmRecipe {
    fn check(&self) -> Result<(), RecipeError> {
        in_range("transport.order", Some(self.order), 0..=16)?;
        in_range("transport.leaf_size", Some(self.leaf_size), 1..=4096)?;
        let samples = Some(self.samples_per_sender);
        in_range("transport.samples_per_sender", samples, 1..=64)?;
        let rays = Some(self.visibility_rays);
        in_range("transport.visibility_rays", rays, 1..=4096)
    }
}
