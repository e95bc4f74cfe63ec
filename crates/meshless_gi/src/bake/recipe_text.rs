//! Text form of a recipe: the fields of [`Recipe`] and their spelling in earlier versions, where
//! the parameters of each transport method were fields of the recipe.

use super::VisibilityRecipe;
use super::occluders::OccluderDesc;
use super::probes::ProbeSettings;
use super::recipe::{BounceMode, Preset, Recipe};
use super::sky::SkyModel;
use super::transport_method::TransportMethod;
use serde::Deserialize;

/// Name of a transport method in earlier versions.
#[derive(Clone, Copy, Deserialize)]
enum Rule {
    Bounded,
    L08,
    Pca,
    Fmm,
}

/// Fields of a recipe file.
#[derive(Default, Deserialize)]
#[serde(default, deny_unknown_fields, rename = "Recipe")]
pub(super) struct RecipeText {
    scene: Option<String>,
    preset: Preset,
    viewpoints: Vec<[f32; 3]>,
    coarse_radius: Option<f32>,
    levels: Option<u32>,
    sender_levels: Option<u32>,
    #[serde(alias = "extra_levels")]
    refinement_levels: Option<u32>,
    #[serde(alias = "extra_points")]
    max_refinement_points: Option<u32>,
    #[serde(alias = "rays")]
    rays_per_point: Option<u32>,
    #[serde(alias = "places")]
    samples_per_sender: Option<u32>,
    bounces: Option<u32>,
    bounce_mode: BounceMode,
    transport: TransportMethod,
    #[serde(alias = "epsilon")]
    truncation_error: Option<f32>,
    link_step: Option<f32>,
    #[serde(alias = "tolerance")]
    receiver_tolerance: Option<f32>,
    #[serde(alias = "max_error")]
    target_nrmse: Option<f32>,
    soft_shadows: Option<VisibilityRecipe>,
    probes: Option<ProbeSettings>,
    sky: SkyModel,
    #[serde(alias = "live_materials")]
    dynamic_materials: bool,
    occluders: Vec<OccluderDesc>,
    seed: u64,
    #[serde(alias = "walls")]
    clip_planes: Option<bool>,

    // Earlier versions.
    rule: Option<Rule>,
    coefficients: Option<u32>,
    cluster_points: Option<u32>,
    #[serde(alias = "lamps")]
    training_lights: Option<u32>,
    order: Option<u32>,
    leaf: Option<u32>,
    sources: Option<u32>,
    pair_rays: Option<u32>,
    fallback: bool,
}

impl RecipeText {
    /// Returns the transport method with the parameters that have their own fields.
    fn transport(&self) -> TransportMethod {
        let mut method = match self.rule {
            None => self.transport,
            Some(Rule::Bounded) => TransportMethod::Bounded,
            Some(Rule::L08) => TransportMethod::L08,
            Some(Rule::Pca) => TransportMethod::pca(),
            Some(Rule::Fmm) => TransportMethod::fmm(),
        };
        match &mut method {
            TransportMethod::Bounded | TransportMethod::L08 => {}
            TransportMethod::Pca(pca) => {
                pca.coefficients = self.coefficients.unwrap_or(pca.coefficients);
                pca.cluster_size = self.cluster_points.or(pca.cluster_size);
                pca.training_lights = self.training_lights.unwrap_or(pca.training_lights);
            }
            TransportMethod::Fmm(fmm) => {
                fmm.order = self.order.unwrap_or(fmm.order);
                fmm.leaf_size = self.leaf.unwrap_or(fmm.leaf_size);
                fmm.samples_per_sender = self.sources.unwrap_or(fmm.samples_per_sender);
                fmm.visibility_rays = self.pair_rays.unwrap_or(fmm.visibility_rays);
                fmm.fallback_links |= self.fallback;
            }
        }
        method
    }
}

impl From<RecipeText> for Recipe {
    fn from(text: RecipeText) -> Self {
        Self {
            transport: text.transport(),
            scene: text.scene,
            preset: text.preset,
            viewpoints: text.viewpoints,
            coarse_radius: text.coarse_radius,
            levels: text.levels,
            sender_levels: text.sender_levels,
            refinement_levels: text.refinement_levels,
            max_refinement_points: text.max_refinement_points,
            rays_per_point: text.rays_per_point,
            samples_per_sender: text.samples_per_sender,
            bounces: text.bounces,
            bounce_mode: text.bounce_mode,
            truncation_error: text.truncation_error,
            link_step: text.link_step,
            receiver_tolerance: text.receiver_tolerance,
            target_nrmse: text.target_nrmse,
            soft_shadows: text.soft_shadows,
            probes: text.probes,
            sky: text.sky,
            dynamic_materials: text.dynamic_materials,
            occluders: text.occluders,
            seed: text.seed,
            clip_planes: text.clip_planes,
        }
    }
}
