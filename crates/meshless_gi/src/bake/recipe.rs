//! Recipe of a bake, as a user writes it in RON or by options of the tool.

use super::VisibilityRecipe;
use super::occluders::{OccluderDesc, check_occluders};
use super::probes::ProbeSettings;
use super::recipe_text::RecipeText;
use super::sky::SkyModel;
use super::transport_method::TransportMethod;
use crate::asset::LightSamples;
#[cfg(feature = "bevy_reflect")]
use bevy_reflect::std_traits::ReflectDefault;
use ron::extensions::Extensions;
use serde::{Deserialize, Serialize};
use std::fmt::Display;
use std::ops::RangeInclusive;

/// Quality level of a bake. It sets every value that the recipe leaves out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(
    feature = "bevy_reflect",
    derive(bevy_reflect::Reflect),
    reflect(Default, Clone, Debug, PartialEq, Hash)
)]
#[non_exhaustive]
pub enum Preset {
    /// Fast bake for work in progress.
    Draft,
    /// Quality for release.
    #[default]
    Medium,
    /// About half the error of `Medium`.
    High,
}

/// Stage that computes the second and later bounces (design D2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(
    feature = "bevy_reflect",
    derive(bevy_reflect::Reflect),
    reflect(Default, Clone, Debug, PartialEq, Hash)
)]
#[non_exhaustive]
pub enum BounceMode {
    /// The frame, by sweeps over the senders. Materials can change at run time.
    #[default]
    #[serde(alias = "Live")]
    Runtime,
    /// The bake, by the Neumann series on the coarsest points. The frame then takes the fewest
    /// steps. Requires [`TransportMethod::Bounded`].
    Baked,
}

/// Input of a bake in addition to the scene. Every field has a default: `Recipe::default()` bakes
/// any scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(
    feature = "bevy_reflect",
    derive(bevy_reflect::Reflect),
    reflect(Default, Clone, Debug, PartialEq)
)]
#[cfg_attr(feature = "documentation", derive(documented::DocumentedFields))]
#[serde(from = "RecipeText")]
pub struct Recipe {
    /// Path of the scene file, relative to the recipe's file. Required in a `.gi.ron` file. Ignored
    /// by library calls.
    pub scene: Option<String>,
    /// Quality level: `Draft`, `Medium` (default) or `High`. It sets every value that is left out.
    pub preset: Preset,
    /// Positions in open space from which lit surfaces are visible, in meters (\[L08\] §2.3).
    /// Default: found automatically. Set them if the bake finds no surface.
    pub viewpoints: Vec<[f32; 3]>,
    /// Poisson-disk radius of the coarsest level, in meters, 1e-9 to 1e9. Default: from the lit
    /// area and the preset. Each further level halves it.
    pub coarse_radius: Option<f32>,
    /// Number of hierarchy levels, 1 to 12. Default 5.
    pub levels: Option<u32>,
    /// Number of levels, from the coarsest, whose points are senders, 1 to `levels`. Default: from
    /// the preset.
    pub sender_levels: Option<u32>,
    /// Number of levels that are added where the light varies strongly, 0 to 8. Default: from the
    /// preset. Not used by `L08`.
    pub refinement_levels: Option<u32>,
    /// Largest number of points of all added levels together, 0 to 4194304. Default: from the
    /// preset.
    pub max_refinement_points: Option<u32>,
    /// Number of gather rays per point, 16 to 65536. Points of added levels take half. Default:
    /// from the preset. More rays reduce noise and take proportionally longer.
    pub rays_per_point: Option<u32>,
    /// Number of light samples of each sender of the finest sender level, 1 to 64. Default: from
    /// the preset, 1 with `L08`. More samples make moving lights smoother and cost as many shadow
    /// rays per moving light.
    pub samples_per_sender: Option<u32>,
    /// Number of diffuse bounces, 1 to 64. Default 4.
    pub bounces: Option<u32>,
    /// Stage that computes later bounces: `Runtime` (default) or `Baked`. `Baked` requires
    /// `Bounded`.
    pub bounce_mode: BounceMode,
    /// Representation of the transport operator: `Bounded` (default), `L08`, `Pca(..)` or
    /// `Fmm(..)`.
    pub transport: TransportMethod,
    /// Relative truncation threshold of links, 0 to 1. It bounds the blur of a row (`Bounded`), the
    /// omitted part (`Pca`), or is ε of \[L08\] Figure 5 (`L08`). Default: from the preset, 0.025
    /// with `L08`. Smaller values keep more links.
    pub truncation_error: Option<f32>,
    /// Quantization step of links, as a fraction of the light that a point can receive, 0 to 0.1.
    /// Links to bright senders have smaller steps. Default: from the preset. 0 stores halves (f16).
    /// Smaller steps reduce the error and make the file larger. Not used by `L08` and `Pca`.
    pub link_step: Option<f32>,
    /// Relative difference from the parents' value below which a receiver stores no row, 0 to 1.
    /// Default: from the preset. Not used by `L08`.
    pub receiver_tolerance: Option<f32>,
    /// Largest estimated NRMSE, 0.0001 to 1. Default: no target. With a target the bake starts
    /// coarse and repeats with finer parameters until it is met, and ignores the preset.
    pub target_nrmse: Option<f32>,
    /// Visibility data of the senders and one finer level, for lights with soft shadows.
    /// Default: none, and soft lights cast no soft shadows.
    pub soft_shadows: Option<VisibilityRecipe>,
    /// Irradiance probes in open space, for dynamic objects, fog and forward cameras. Default:
    /// none. Requires `Bounded`.
    pub probes: Option<ProbeSettings>,
    /// Sky model: `Uniform` (default) or `Harmonics`. `Harmonics` requires `Bounded`.
    pub sky: SkyModel,
    /// Support for base colors and emission that change at run time. Default `false`. Requires
    /// `Bounded` and bounce mode `Runtime`.
    pub dynamic_materials: bool,
    /// Parts of the scene that open and close at run time, such as doors. At most 64. Default:
    /// none. Requires `Bounded` and bounce mode `Runtime`.
    pub occluders: Vec<OccluderDesc>,
    /// Seed of all random numbers. Default 0.
    pub seed: u64,
    /// Clip planes that end basis functions at walls (design D7). Default `true`. `false` is the
    /// method of \[L08\], which leaks light through thin walls.
    pub clip_planes: Option<bool>,
}

impl From<Preset> for Recipe {
    /// Creates a recipe with this preset and defaults.
    fn from(preset: Preset) -> Self {
        Self {
            preset,
            ..Self::default()
        }
    }
}

/// Error of an invalid recipe.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RecipeError {
    /// Value outside of its range.
    #[error("`{field}` is {value}, but must be {allowed}")]
    OutOfRange {
        /// Field.
        field: &'static str,
        /// Value in the recipe.
        value: String,
        /// Allowed values.
        allowed: String,
    },
    /// Invalid text.
    #[error("the recipe cannot be read: {0}")]
    Syntax(String),
}

impl RecipeError {
    /// Creates the error of a value outside of its range.
    pub(super) fn out_of_range(
        field: &'static str,
        value: impl Display,
        allowed: impl Into<String>,
    ) -> Self {
        Self::OutOfRange {
            field,
            value: value.to_string(),
            allowed: allowed.into(),
        }
    }
}

/// Checks that a value is in a range. `None` passes.
pub(super) fn in_range<T: PartialOrd + Display>(
    field: &'static str,
    value: Option<T>,
    range: RangeInclusive<T>,
) -> Result<(), RecipeError> {
    match value {
        Some(v) if !range.contains(&v) => {
            let allowed = format!("{} to {}", range.start(), range.end());
            Err(RecipeError::out_of_range(field, v, allowed))
        }
        _ => Ok(()),
    }
}

/// Returns the options of the RON text of recipes and settings.
pub(super) fn ron_options() -> ron::Options {
    ron::Options::default()
        .with_default_extension(Extensions::IMPLICIT_SOME | Extensions::UNWRAP_VARIANT_NEWTYPES)
}

impl Recipe {
    /// Reads a recipe from RON. Field names of earlier versions are accepted.
    ///
    /// # Errors
    /// [`RecipeError::Syntax`] with line and column, [`RecipeError::OutOfRange`] for an invalid
    /// value.
    pub fn from_ron(text: &str) -> Result<Self, RecipeError> {
        let recipe: Self = ron_options()
            .from_str(text)
            .map_err(|e| RecipeError::Syntax(e.to_string()))?;
        recipe.check()?;
        Ok(recipe)
    }

    /// Checks every value, and the combinations that do not depend on the scene.
    ///
    /// # Errors
    /// [`RecipeError::OutOfRange`].
    pub fn check(&self) -> Result<(), RecipeError> {
        in_range("coarse_radius", self.coarse_radius, 1e-9..=1e9)?;
        in_range("levels", self.levels, 1..=12)?;
        in_range("sender_levels", self.sender_levels, 1..=12)?;
        in_range("refinement_levels", self.refinement_levels, 0..=8)?;
        let added = self.max_refinement_points;
        in_range("max_refinement_points", added, 0..=1 << 22)?;
        in_range("rays_per_point", self.rays_per_point, 16..=65_536)?;
        let samples = self.samples_per_sender;
        in_range("samples_per_sender", samples, 1..=LightSamples::MAX)?;
        in_range("bounces", self.bounces, 1..=64)?;
        in_range("truncation_error", self.truncation_error, 0.0..=1.0)?;
        in_range("link_step", self.link_step, 0.0..=0.1)?;
        in_range("receiver_tolerance", self.receiver_tolerance, 0.0..=1.0)?;
        in_range("target_nrmse", self.target_nrmse, 1e-4..=1.0)?;
        if let Some(v) = (self.viewpoints.iter()).find(|v| !v.iter().all(|c| c.is_finite())) {
            let value = format!("{v:?}");
            return Err(RecipeError::out_of_range(
                "viewpoints",
                value,
                "finite coordinates",
            ));
        }
        self.transport.check()?;
        if let Some(soft) = &self.soft_shadows {
            soft.check()?;
        }
        if let Some(probes) = &self.probes {
            probes.check()?;
        }
        check_occluders(&self.occluders)?;
        self.check_method()
    }

    /// Checks that the transport method and bounce mode support everything that the recipe needs.
    fn check_method(&self) -> Result<(), RecipeError> {
        let bounded = self.transport == TransportMethod::Bounded;
        let runtime = bounded && self.bounce_mode == BounceMode::Runtime;
        let method = self.transport.name();
        let mode = self.bounce_mode;
        let needs = [
            ("probes", self.probes.is_some(), bounded),
            ("sky", self.sky == SkyModel::Harmonics, bounded),
            ("bounce_mode", mode == BounceMode::Baked, bounded),
            ("dynamic_materials", self.dynamic_materials, runtime),
            ("occluders", !self.occluders.is_empty(), runtime),
        ];
        for (field, used, supported) in needs {
            if used && !supported {
                let value = format!("used with transport {method} and bounce mode {mode:?}");
                let allowed = match field {
                    "dynamic_materials" | "occluders" => {
                        "used with transport Bounded and bounce mode Runtime only"
                    }
                    "sky" => "Uniform, or Harmonics with transport Bounded",
                    "bounce_mode" => "Runtime, or Baked with transport Bounded",
                    _ => "used with transport Bounded only",
                };
                return Err(RecipeError::out_of_range(field, value, allowed));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::transport_method::{FmmRecipe, PcaRecipe};
    use super::*;

    #[test]
    fn recipe_in_earlier_spelling_is_the_same_recipe() {
        let alias = "lamps: 50";
        let earlier = format!(
            "(preset: Draft, rays: 64, places: 3, extra_levels: 1, extra_points: 9, \
            rule: Pca, epsilon: 0.1, tolerance: 0.2, max_error: 0.3, coefficients: 7, \
            cluster_points: 30, {alias}, order: 3, leaf: 8, sources: 2, pair_rays: 5, \
            fallback: true, live_materials: false, walls: false, bounce_mode: Live, \
            probes: (rays: 99), soft_shadows: (error: 0.5))"
        );
        let now = "(preset: Draft, rays_per_point: 64, samples_per_sender: 3, \
            refinement_levels: 1, max_refinement_points: 9, truncation_error: 0.1, \
            transport: Pca(coefficients: 7, cluster_size: 30, training_lights: 50), \
            receiver_tolerance: 0.2, target_nrmse: 0.3, dynamic_materials: false, \
            clip_planes: false, bounce_mode: Runtime, soft_shadows: (max_cluster_error: 0.5))";
        let with_probes = |recipe: Recipe| Recipe {
            probes: None,
            ..recipe
        };
        let read: Recipe = ron_options().from_str(&earlier).unwrap();
        assert_eq!(read.probes.unwrap().rays_per_probe, Some(99));
        assert_eq!(with_probes(read), Recipe::from_ron(now).unwrap());

        let earlier = "(rule: Fmm, order: 3, leaf: 8, sources: 2, pair_rays: 5, fallback: true, coefficients: 1)";
        let fmm = FmmRecipe {
            order: 3,
            leaf_size: 8,
            samples_per_sender: 2,
            visibility_rays: 5,
            fallback_links: true,
        };
        let read = Recipe::from_ron(earlier).unwrap();
        assert_eq!(read.transport, TransportMethod::Fmm(fmm));
    }

    #[test]
    fn recipe_text_reads_back() {
        let pca = PcaRecipe {
            cluster_size: Some(12),
            ..PcaRecipe::default()
        };
        for transport in [
            TransportMethod::Bounded,
            TransportMethod::L08,
            TransportMethod::Pca(pca),
            TransportMethod::fmm(),
        ] {
            let recipe = Recipe {
                transport,
                ..Recipe::default()
            };
            let text = ron_options().to_string(&recipe).unwrap();
            assert_eq!(Recipe::from_ron(&text).unwrap(), recipe, "{text}");
        }
        let text = "(transport: Fmm())";
        let transport = Recipe::from_ron(text).unwrap().transport;
        assert_eq!(transport, TransportMethod::fmm());
        assert!(Recipe::from_ron("(transport: Fmm(coefficients: 3))").is_err());
        assert!(Recipe::from_ron("(lights: 3)").is_err());
    }
}
