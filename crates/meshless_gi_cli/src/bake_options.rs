//! Options of `bake` that replace fields of a recipe. Each field has an option with its name and
//! dashes. The shorter names are from earlier versions.

use clap::builder::{PossibleValuesParser, TypedValueParser};
use meshless_gi::{BounceMode, OccluderDesc, Preset, Recipe, SkyModel, TransportMethod};

/// Options of `bake`. One that is not given leaves the recipe's field as it is.
#[derive(clap::Args)]
pub struct Options {
    /// Quality level: draft, medium (default) or high. It sets every value that is left out.
    #[arg(long, hide_possible_values = true, value_parser = preset())]
    preset: Option<Preset>,
    /// Positions in open space from which lit surfaces are visible, in meters ([L08] §2.3). Repeat
    /// the option for several. Points without normals face them. Default: found automatically.
    #[arg(long = "viewpoint", visible_alias = "viewpoints", value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = viewpoint)]
    viewpoints: Vec<[f32; 3]>,
    /// Poisson-disk radius of the coarsest level, in meters, 1e-9 to 1e9. Default: from the lit
    /// area and the preset.
    #[arg(long, value_name = "R", allow_hyphen_values = true)]
    coarse_radius: Option<f32>,
    /// Number of hierarchy levels, 1 to 12. Default 5.
    #[arg(long, value_name = "N", allow_hyphen_values = true)]
    levels: Option<u32>,
    /// Number of levels, from the coarsest, whose points are senders, 1 to levels. Default: from
    /// the preset.
    #[arg(long, value_name = "N", allow_hyphen_values = true)]
    sender_levels: Option<u32>,
    /// Number of levels that are added where the light varies strongly, 0 to 8. Default: from the
    /// preset.
    #[arg(long, value_name = "N", allow_hyphen_values = true)]
    refinement_levels: Option<u32>,
    /// Largest number of points of all added levels together, 0 to 4194304. Default: from the
    /// preset.
    #[arg(long, value_name = "N", allow_hyphen_values = true)]
    max_refinement_points: Option<u32>,
    /// Number of gather rays per point, 16 to 65536. Default: from the preset.
    #[arg(
        long,
        visible_alias = "rays-per-point",
        value_name = "N",
        allow_hyphen_values = true
    )]
    rays: Option<u32>,
    /// Number of light samples of each sender of the finest sender level, 1 to 64. Default: from
    /// the preset.
    #[arg(long, value_name = "N", allow_hyphen_values = true)]
    samples_per_sender: Option<u32>,
    /// Number of diffuse bounces, 1 to 64. Default 4.
    #[arg(long, value_name = "N", allow_hyphen_values = true)]
    bounces: Option<u32>,
    /// Stage that computes later bounces: runtime (default) or baked. Baked requires method
    /// bounded.
    #[arg(long, hide_possible_values = true, value_name = "STAGE", value_parser = bounce_mode())]
    bounce_mode: Option<BounceMode>,
    /// Representation of the transport operator: bounded (default), l08, pca or fmm.
    #[arg(long, visible_alias = "transport", hide_possible_values = true, value_parser = rule())]
    rule: Option<TransportMethod>,
    /// Method pca: vectors in a cluster's basis of direct light, 1 to 1000. Default 10.
    #[arg(
        long,
        alias = "coefficients",
        value_name = "N",
        allow_hyphen_values = true
    )]
    pca_coefficients: Option<u32>,
    /// Method pca: approximate number of senders per cluster, 1 to 65536. Default: 1/64 of all.
    #[arg(
        long,
        alias = "cluster-points",
        value_name = "N",
        allow_hyphen_values = true
    )]
    pca_cluster_size: Option<u32>,
    /// Method pca: lights that train the bases, 0 to 65536. Default 1000.
    #[arg(long, alias = "lamps", value_name = "N", allow_hyphen_values = true)]
    pca_training_lights: Option<u32>,
    /// Method fmm: order of the expansions, 0 to 16. Default 2. GPU kernels support up to 6.
    #[arg(long, alias = "order", value_name = "N", allow_hyphen_values = true)]
    fmm_order: Option<u32>,
    /// Method fmm: maximum number of points in a leaf of the octree, 1 to 4096. Default 24.
    #[arg(long, alias = "leaf", value_name = "N", allow_hyphen_values = true)]
    fmm_leaf_size: Option<u32>,
    /// Method fmm: emission samples per sender of the finest sender level, 1 to 64. Default 4.
    #[arg(long, alias = "sources", value_name = "N", allow_hyphen_values = true)]
    fmm_samples_per_sender: Option<u32>,
    /// Method fmm: rays per pair of nodes that estimate their visibility, 1 to 4096. Default 16.
    #[arg(
        long,
        alias = "pair-rays",
        value_name = "N",
        allow_hyphen_values = true
    )]
    fmm_visibility_rays: Option<u32>,
    /// Method fmm: also bake the links of method bounded, for devices that cannot hold the octree.
    #[arg(long, alias = "fallback")]
    fmm_fallback_links: bool,
    /// Relative truncation threshold of links, 0 to 1. Default: from the preset.
    #[arg(
        long,
        visible_alias = "truncation-error",
        value_name = "E",
        allow_hyphen_values = true
    )]
    epsilon: Option<f32>,
    /// Relative difference from the parents' value below which a receiver stores no row, 0 to 1.
    /// Default: from the preset.
    #[arg(long, value_name = "E", allow_hyphen_values = true)]
    receiver_tolerance: Option<f32>,
    /// Largest estimated NRMSE, 0.0001 to 1. The bake starts coarse and repeats with finer
    /// parameters until it is met.
    #[arg(
        long,
        visible_alias = "target-nrmse",
        value_name = "E",
        allow_hyphen_values = true
    )]
    max_error: Option<f32>,
    /// Bake probes, which light dynamic objects, fog and forward cameras.
    #[arg(long)]
    probes: bool,
    /// Distance between probes, in meters. Implies --probes. Default: about 2000 probes in the
    /// bounding box of the scene.
    #[arg(long, value_name = "M", allow_hyphen_values = true)]
    probe_spacing: Option<f32>,
    /// Number of gather rays per probe, 64 to 65536. Implies --probes. Default: twice those of a
    /// point.
    #[arg(long, value_name = "N", allow_hyphen_values = true)]
    probe_rays_per_probe: Option<u32>,
    /// Sky model: uniform (default) or harmonics. Harmonics are for skies that vary with the
    /// direction.
    #[arg(long, value_name = "KIND", value_parser = sky())]
    sky: Option<SkyModel>,
    /// Support for base colors and emission that change at run time.
    #[arg(long, alias = "live-materials")]
    dynamic_materials: bool,
    /// Parts of the scene that open and close at run time, such as doors. Name of a node of the
    /// scene. Repeat the option for several, up to 64.
    #[arg(long = "occluder", visible_alias = "occluders", value_name = "NAME")]
    occluders: Vec<String>,
    /// Bake the visibility of points, for lights with soft shadows.
    #[arg(long)]
    soft_shadows: bool,
    /// Soft shadows: approximate number of directions per point, 16 to 16384. Default 4012.
    #[arg(
        long,
        value_name = "N",
        requires = "soft_shadows",
        allow_hyphen_values = true
    )]
    visibility_directions: Option<u32>,
    /// Soft shadows: maximum number of coefficients per point, 1 to 128. Default 50.
    #[arg(
        long,
        value_name = "N",
        requires = "soft_shadows",
        allow_hyphen_values = true
    )]
    visibility_coefficients: Option<u32>,
    /// Soft shadows: approximate number of points per cluster, 16 to 65536. Default 400.
    #[arg(
        long,
        alias = "visibility-cluster",
        value_name = "N",
        requires = "soft_shadows",
        allow_hyphen_values = true
    )]
    visibility_cluster_size: Option<u32>,
    /// Soft shadows: depth error above which a cluster is split, 0.001 to 1 (1: never split).
    /// Default 0.03.
    #[arg(
        long,
        alias = "visibility-error",
        visible_alias = "visibility-max-cluster-error",
        value_name = "E",
        requires = "soft_shadows",
        allow_hyphen_values = true
    )]
    visibility_max_error: Option<f32>,
    /// Seed of all random numbers. Default 0.
    #[arg(long, value_name = "N", allow_hyphen_values = true)]
    seed: Option<u64>,
    /// Clip planes that end basis functions at walls (design D7). Values: true (default) or false.
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
        set(&mut recipe.rays_per_point, self.rays);
        set(&mut recipe.samples_per_sender, self.samples_per_sender);
        set(&mut recipe.bounces, self.bounces);
        set(&mut recipe.truncation_error, self.epsilon);
        set(&mut recipe.receiver_tolerance, self.receiver_tolerance);
        set(&mut recipe.target_nrmse, self.max_error);
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
            soft.max_cluster_error = self.visibility_max_error.unwrap_or(soft.max_cluster_error);
        }
    }

    fn apply_transport(&self, transport: &mut TransportMethod) {
        if let Some(method) = self.rule.filter(|method| !method.is_same_method(transport)) {
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
