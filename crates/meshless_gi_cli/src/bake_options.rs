//! Options of `bake` that replace fields of a recipe. Each field has an option with its name and
//! dashes. The shorter names are from earlier versions.

use super::field_help::field_help;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use meshless_gi::{BounceMode, OccluderDesc, Preset, Recipe, SkyModel, TransportMethod};

/// Headings of groups of options.
const PCA: &str = "Options of method pca";
const FMM: &str = "Options of method fmm";
const PROBES: &str = "Options of probes. Each implies --probes";
const SOFT_SHADOWS: &str = "Options of --soft-shadows";

/// Options of `bake`. One that is not given leaves the recipe's field as it is. The help of an
/// option is the doc comment of the field with its name (`field_help`).
#[derive(clap::Args)]
#[command(mut_args(field_help))]
pub struct Options {
    #[arg(long, hide_possible_values = true, value_parser = preset())]
    preset: Option<Preset>,
    #[arg(long = "viewpoint", visible_alias = "viewpoints", value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = viewpoint)]
    viewpoints: Vec<[f32; 3]>,
    #[arg(long, value_name = "R", allow_hyphen_values = true)]
    coarse_radius: Option<f32>,
    #[arg(long, value_name = "N", allow_hyphen_values = true)]
    levels: Option<u32>,
    #[arg(long, value_name = "N", allow_hyphen_values = true)]
    sender_levels: Option<u32>,
    #[arg(long, value_name = "N", allow_hyphen_values = true)]
    refinement_levels: Option<u32>,
    #[arg(long, value_name = "N", allow_hyphen_values = true)]
    max_refinement_points: Option<u32>,
    #[arg(
        long = "rays",
        visible_alias = "rays-per-point",
        value_name = "N",
        allow_hyphen_values = true
    )]
    rays_per_point: Option<u32>,
    #[arg(long, value_name = "N", allow_hyphen_values = true)]
    samples_per_sender: Option<u32>,
    #[arg(long, value_name = "N", allow_hyphen_values = true)]
    bounces: Option<u32>,
    #[arg(long, hide_possible_values = true, value_name = "STAGE", value_parser = bounce_mode())]
    bounce_mode: Option<BounceMode>,
    #[arg(long = "rule", visible_alias = "transport", hide_possible_values = true, value_parser = rule())]
    transport: Option<TransportMethod>,
    #[arg(
        long,
        help_heading = PCA,
        alias = "coefficients",
        value_name = "N",
        allow_hyphen_values = true
    )]
    pca_coefficients: Option<u32>,
    #[arg(
        long,
        help_heading = PCA,
        alias = "cluster-points",
        value_name = "N",
        allow_hyphen_values = true
    )]
    pca_cluster_size: Option<u32>,
    #[arg(long, help_heading = PCA, alias = "lamps", value_name = "N", allow_hyphen_values = true)]
    pca_training_lights: Option<u32>,
    #[arg(long, help_heading = FMM, alias = "order", value_name = "N", allow_hyphen_values = true)]
    fmm_order: Option<u32>,
    #[arg(long, help_heading = FMM, alias = "leaf", value_name = "N", allow_hyphen_values = true)]
    fmm_leaf_size: Option<u32>,
    #[arg(long, help_heading = FMM, alias = "sources", value_name = "N", allow_hyphen_values = true)]
    fmm_samples_per_sender: Option<u32>,
    #[arg(
        long,
        help_heading = FMM,
        alias = "pair-rays",
        value_name = "N",
        allow_hyphen_values = true
    )]
    fmm_visibility_rays: Option<u32>,
    #[arg(long, help_heading = FMM, alias = "fallback")]
    fmm_fallback_links: bool,
    #[arg(
        long = "epsilon",
        visible_alias = "truncation-error",
        value_name = "E",
        allow_hyphen_values = true
    )]
    truncation_error: Option<f32>,
    #[arg(long, value_name = "S", allow_hyphen_values = true)]
    link_step: Option<f32>,
    #[arg(long, value_name = "E", allow_hyphen_values = true)]
    receiver_tolerance: Option<f32>,
    #[arg(
        long = "max-error",
        visible_alias = "target-nrmse",
        value_name = "E",
        allow_hyphen_values = true
    )]
    target_nrmse: Option<f32>,
    #[arg(long)]
    probes: bool,
    #[arg(long, help_heading = PROBES, value_name = "M", allow_hyphen_values = true)]
    probe_spacing: Option<f32>,
    #[arg(long, help_heading = PROBES, value_name = "N", allow_hyphen_values = true)]
    probe_rays_per_probe: Option<u32>,
    #[arg(long, value_name = "KIND", value_parser = sky())]
    sky: Option<SkyModel>,
    #[arg(long, alias = "live-materials")]
    dynamic_materials: bool,
    #[arg(long = "occluder", visible_alias = "occluders", value_name = "NAME")]
    occluders: Vec<String>,
    #[arg(long)]
    soft_shadows: bool,
    #[arg(
        long,
        help_heading = SOFT_SHADOWS,
        value_name = "N",
        requires = "soft_shadows",
        allow_hyphen_values = true
    )]
    visibility_directions: Option<u32>,
    #[arg(
        long,
        help_heading = SOFT_SHADOWS,
        value_name = "N",
        requires = "soft_shadows",
        allow_hyphen_values = true
    )]
    visibility_coefficients: Option<u32>,
    #[arg(
        long,
        help_heading = SOFT_SHADOWS,
        alias = "visibility-cluster",
        value_name = "N",
        requires = "soft_shadows",
        allow_hyphen_values = true
    )]
    visibility_cluster_size: Option<u32>,
    #[arg(
        help_heading = SOFT_SHADOWS,
        long = "visibility-max-error",
        alias = "visibility-error",
        visible_alias = "visibility-max-cluster-error",
        value_name = "E",
        requires = "soft_shadows",
        allow_hyphen_values = true
    )]
    visibility_max_cluster_error: Option<f32>,
    #[arg(long, value_name = "N", allow_hyphen_values = true)]
    seed: Option<u64>,
    #[arg(long, value_name = "BOOL", hide_possible_values = true)]
    clip_planes: Option<bool>,
}

fn preset() -> impl TypedValueParser<Value = Preset> {
    PossibleValuesParser::new(["draft", "medium", "high"]).map(|word| match word.as_str() {
        "draft" => Preset::Draft,
        "high" => Preset::High,
        _ => Preset::Medium,
    })
}

fn bounce_mode() -> impl TypedValueParser<Value = BounceMode> {
    PossibleValuesParser::new(["runtime", "baked"]).map(|word| match word.as_str() {
        "baked" => BounceMode::Baked,
        _ => BounceMode::Runtime,
    })
}

fn rule() -> impl TypedValueParser<Value = TransportMethod> {
    PossibleValuesParser::new(["bounded", "l08", "pca", "fmm"]).map(|word| match word.as_str() {
        "l08" => TransportMethod::L08,
        "pca" => TransportMethod::pca(),
        "fmm" => TransportMethod::fmm(),
        _ => TransportMethod::Bounded,
    })
}

fn sky() -> impl TypedValueParser<Value = SkyModel> {
    PossibleValuesParser::new(["uniform", "harmonics"]).map(|word| match word.as_str() {
        "harmonics" => SkyModel::Harmonics,
        _ => SkyModel::Uniform,
    })
}

fn viewpoint(text: &str) -> Result<[f32; 3], String> {
    let mut parts = text.split(',').map(|c| c.trim().parse::<f32>());
    match (parts.next(), parts.next(), parts.next(), parts.next()) {
        (Some(Ok(x)), Some(Ok(y)), Some(Ok(z)), None)
            if [x, y, z].iter().all(|c| c.is_finite()) =>
        {
            Ok([x, y, z])
        }
        _ => Err("expected three finite numbers separated by commas, such as -1,2.5,0".into()),
    }
}

/// Replaces `field` by `option` if that is given.
fn set<T: Copy>(field: &mut Option<T>, option: Option<T>) {
    *field = option.or(*field);
}

impl Options {
    /// Replaces the fields of `recipe` whose options are given.
    pub fn apply(&self, recipe: &mut Recipe) {
        recipe.preset = self.preset.unwrap_or(recipe.preset);
        recipe.seed = self.seed.unwrap_or(recipe.seed);
        recipe.sky = self.sky.unwrap_or(recipe.sky);
        recipe.bounce_mode = self.bounce_mode.unwrap_or(recipe.bounce_mode);
        recipe.dynamic_materials |= self.dynamic_materials;
        for name in &self.occluders {
            // The recipe's own description may have boxes.
            if !recipe.occluders.iter().any(|o| o.name == *name) {
                recipe.occluders.push(OccluderDesc::node(name));
            }
        }
        if !self.viewpoints.is_empty() {
            recipe.viewpoints.clone_from(&self.viewpoints);
        }
        set(&mut recipe.coarse_radius, self.coarse_radius);
        set(&mut recipe.levels, self.levels);
        set(&mut recipe.sender_levels, self.sender_levels);
        set(&mut recipe.refinement_levels, self.refinement_levels);
        set(
            &mut recipe.max_refinement_points,
            self.max_refinement_points,
        );
        set(&mut recipe.rays_per_point, self.rays_per_point);
        set(&mut recipe.samples_per_sender, self.samples_per_sender);
        set(&mut recipe.bounces, self.bounces);
        set(&mut recipe.truncation_error, self.truncation_error);
        set(&mut recipe.link_step, self.link_step);
        set(&mut recipe.receiver_tolerance, self.receiver_tolerance);
        set(&mut recipe.target_nrmse, self.target_nrmse);
        set(&mut recipe.clip_planes, self.clip_planes);
        let probes = self.probe_spacing.is_some() || self.probe_rays_per_probe.is_some();
        if self.probes || probes {
            let probes = recipe.probes.get_or_insert_default();
            set(&mut probes.spacing, self.probe_spacing);
            set(&mut probes.rays_per_probe, self.probe_rays_per_probe);
        }
        self.apply_soft_shadows(recipe);
        self.apply_transport(&mut recipe.transport);
    }

    fn apply_soft_shadows(&self, recipe: &mut Recipe) {
        if self.soft_shadows {
            let soft = recipe.soft_shadows.get_or_insert_default();
            soft.directions = self.visibility_directions.unwrap_or(soft.directions);
            soft.coefficients = self.visibility_coefficients.unwrap_or(soft.coefficients);
            soft.cluster_size = self.visibility_cluster_size.unwrap_or(soft.cluster_size);
            soft.max_cluster_error = self
                .visibility_max_cluster_error
                .unwrap_or(soft.max_cluster_error);
        }
    }

    fn apply_transport(&self, transport: &mut TransportMethod) {
        if let Some(method) = self
            .transport
            .filter(|method| !method.is_same_method(transport))
        {
            *transport = method;
        }
        match transport {
            TransportMethod::Pca(pca) => {
                pca.coefficients = self.pca_coefficients.unwrap_or(pca.coefficients);
                set(&mut pca.cluster_size, self.pca_cluster_size);
                pca.training_lights = self.pca_training_lights.unwrap_or(pca.training_lights);
            }
            TransportMethod::Fmm(fmm) => {
                let samples = self.fmm_samples_per_sender;
                fmm.order = self.fmm_order.unwrap_or(fmm.order);
                fmm.leaf_size = self.fmm_leaf_size.unwrap_or(fmm.leaf_size);
                fmm.samples_per_sender = samples.unwrap_or(fmm.samples_per_sender);
                fmm.visibility_rays = self.fmm_visibility_rays.unwrap_or(fmm.visibility_rays);
                fmm.fallback_links |= self.fmm_fallback_links;
            }
            _ => {}
        }
    }
}
