//! Variants of a report: one factor at a time around a baseline, the presets, and the method of
//! \[L08\].

use meshless_gi::internals::bake::BakeSettings;
use meshless_gi::internals::transport::TIERS;
use meshless_gi::{
    BounceMode, FmmRecipe, FrameSettings, PcaRecipe, Preset, Recipe, TransportMethod,
};
use serde::Serialize;

/// Number of reflections at which errors are measured. It is the recipes' default and the default
/// of a frame.
pub const BOUNCES: u32 = 4;

/// Factor that a variant changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Factor {
    /// Preset without changes.
    Preset,
    /// Threshold of the method `bounded`, and the tolerance that follows from it.
    Epsilon,
    /// `Epsilon` without added levels: on the points of the method `l08`.
    Plain,
    /// Method `l08`, by its threshold.
    RuleL08,
    /// Method `pca`, bases of direct light: vectors, clusters and threshold.
    RulePca,
    /// Method `fmm`, an octree of points: order, leaves, sources, and sender levels.
    RuleFmm,
    /// Density of the points of all levels.
    Density,
    /// Number of levels of the hierarchy.
    Levels,
    /// Refinement levels.
    Added,
    /// Rays per point.
    Rays,
    /// Number of sender levels.
    Senders,
    /// Light samples per sender.
    SamplesPerSender,
    /// Several factors together.
    Several,
    /// Operator tier of a frame.
    Tier,
    /// Number of reflections, and whether they are baked.
    Bounces,
}

impl Factor {
    /// Factors in the order of tables.
    pub const ALL: [Self; 15] = [
        Self::Preset,
        Self::Epsilon,
        Self::Plain,
        Self::RuleL08,
        Self::RulePca,
        Self::RuleFmm,
        Self::Density,
        Self::Levels,
        Self::Added,
        Self::Rays,
        Self::Senders,
        Self::SamplesPerSender,
        Self::Several,
        Self::Tier,
        Self::Bounces,
    ];

    /// Returns the display name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Preset => "presets",
            Self::Epsilon => "threshold ε",
            Self::Plain => "threshold ε, no refinement levels",
            Self::RuleL08 => "method l08, as published",
            Self::RulePca => "method pca",
            Self::RuleFmm => "method fmm",
            Self::Density => "point density",
            Self::Levels => "levels",
            Self::Rays => "rays per point",
            Self::Added => "refinement levels",
            Self::Senders => "sender levels",
            Self::SamplesPerSender => "samples per sender",
            Self::Several => "several settings",
            Self::Tier => "tier of the frame",
            Self::Bounces => "bounces",
        }
    }
}

/// Settings of the frame that do not affect the bake.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Run {
    /// Diffuse reflections.
    pub bounces: u32,
    /// Tier of the operator. See [`FrameSettings::tier`].
    pub tier: u32,
}

impl Default for Run {
    fn default() -> Self {
        Self {
            bounces: BOUNCES,
            tier: FrameSettings::ALL_TIERS,
        }
    }
}

/// Configuration to bake and measure.
#[derive(Clone, Debug, PartialEq)]
pub struct Variant {
    /// Factor that it changes.
    pub factor: Factor,
    /// Short name for charts and tables.
    pub name: String,
    /// Recipe of the bake.
    pub recipe: Recipe,
    /// Settings of the frame.
    pub run: Run,
    /// Approximate bake time relative to the baseline. It serves to keep within a report's time
    /// limit.
    pub cost: f64,
}

impl Variant {
    fn new(factor: Factor, name: impl Into<String>, cost: f64, recipe: Recipe) -> Self {
        Self {
            factor,
            name: name.into(),
            recipe,
            run: Run::default(),
            cost,
        }
    }

    /// Returns the recipe as a user writes it, with only the fields that differ from the preset.
    #[must_use]
    pub fn recipe_text(&self) -> String {
        fn some<T: std::fmt::Debug>(out: &mut Vec<String>, name: &str, value: Option<T>) {
            out.extend(value.map(|v| format!("{name}: {v:?}")));
        }
        let r = &self.recipe;
        let mut out = vec![format!("preset: {:?}", r.preset)];
        out.extend(transport_text(&r.transport));
        some(&mut out, "coarse_radius", r.coarse_radius);
        some(&mut out, "levels", r.levels);
        some(&mut out, "sender_levels", r.sender_levels);
        some(&mut out, "refinement_levels", r.refinement_levels);
        some(&mut out, "max_refinement_points", r.max_refinement_points);
        some(&mut out, "rays_per_point", r.rays_per_point);
        some(&mut out, "samples_per_sender", r.samples_per_sender);
        some(&mut out, "truncation_error", r.truncation_error);
        some(&mut out, "link_step", r.link_step);
        some(&mut out, "receiver_tolerance", r.receiver_tolerance);
        some(&mut out, "bounces", r.bounces);
        let mode = r.bounce_mode;
        some(
            &mut out,
            "bounce_mode",
            (mode != BounceMode::default()).then_some(mode),
        );
        format!("({})", out.join(", "))
    }
}

/// Returns the transport method as a user writes it, with only the parameters that differ from the
/// default. Returns `None` for the default method.
fn transport_text(transport: &TransportMethod) -> Option<String> {
    let mut out: Vec<String> = Vec::new();
    match transport {
        TransportMethod::L08 => return Some("transport: L08".into()),
        TransportMethod::Pca(pca) => {
            let usual = PcaRecipe::default();
            if pca.coefficients != usual.coefficients {
                out.push(format!("coefficients: {}", pca.coefficients));
            }
            out.extend(pca.cluster_size.map(|n| format!("cluster_size: {n}")));
            if pca.training_lights != usual.training_lights {
                out.push(format!("training_lights: {}", pca.training_lights));
            }
        }
        TransportMethod::Fmm(fmm) => {
            let usual = FmmRecipe::default();
            let fields = [
                ("order", fmm.order, usual.order),
                ("leaf_size", fmm.leaf_size, usual.leaf_size),
                (
                    "samples_per_sender",
                    fmm.samples_per_sender,
                    usual.samples_per_sender,
                ),
                (
                    "visibility_rays",
                    fmm.visibility_rays,
                    usual.visibility_rays,
                ),
            ];
            let changed = fields.iter().filter(|(_, value, usual)| value != usual);
            out.extend(changed.map(|(name, value, _)| format!("{name}: {value}")));
        }
        _ => return None,
    }
    Some(format!(
        "transport: {}({})",
        transport.name(),
        out.join(", ")
    ))
}

/// Returns the baseline. It bakes fast, so that many variants of it can be measured.
#[must_use]
pub fn baseline() -> Variant {
    Variant::new(Factor::Preset, "draft", 1.0, draft())
}

fn draft() -> Recipe {
    Recipe {
        preset: Preset::Draft,
        ..Recipe::default()
    }
}

fn epsilon(value: f32, cost: f64) -> Variant {
    let recipe = Recipe {
        truncation_error: Some(value),
        // Same ratio as in the presets.
        receiver_tolerance: Some(2.0 * value),
        ..draft()
    };
    Variant::new(Factor::Epsilon, format!("ε {value}"), cost, recipe)
}

/// Returns the method `bounded` on the points of the method `l08`, so that only the method differs.
fn plain(value: f32, cost: f64) -> Variant {
    let mut variant = epsilon(value, cost);
    variant.factor = Factor::Plain;
    variant.name = format!("plain ε {value}");
    variant.recipe.refinement_levels = Some(0);
    variant
}

fn l08(value: f32, cost: f64) -> Variant {
    let recipe = Recipe {
        transport: TransportMethod::L08,
        truncation_error: Some(value),
        ..draft()
    };
    Variant::new(Factor::RuleL08, format!("l08 ε {value}"), cost, recipe)
}

/// Returns the method `pca` with this number of vectors and of senders per cluster.
fn pca(coefficients: u32, cluster_points: u32, cost: f64) -> Variant {
    let recipe = Recipe {
        transport: TransportMethod::Pca(PcaRecipe {
            coefficients,
            cluster_size: Some(cluster_points),
            ..PcaRecipe::default()
        }),
        ..draft()
    };
    let name = format!("pca {coefficients} of {cluster_points}");
    Variant::new(Factor::RulePca, name, cost, recipe)
}

/// Returns the method `pca` with the settings of a preset.
fn pca_preset(preset: Preset, cost: f64) -> Variant {
    let recipe = Recipe {
        preset,
        transport: TransportMethod::pca(),
        ..Recipe::default()
    };
    let name = format!("pca, {preset:?}").to_lowercase();
    Variant::new(Factor::RulePca, name, cost, recipe)
}

/// Returns the method `fmm` with the sender levels and light samples of a preset, or with other
/// numbers of them.
fn fmm(preset: Preset, sender_levels: Option<u32>, sources: Option<u32>, cost: f64) -> Variant {
    let recipe = Recipe {
        preset,
        transport: TransportMethod::Fmm(FmmRecipe {
            samples_per_sender: sources.unwrap_or(4),
            ..FmmRecipe::default()
        }),
        sender_levels,
        ..Recipe::default()
    };
    let mut name = format!("fmm, {preset:?}").to_lowercase();
    if let Some(levels) = sender_levels {
        name += &format!(", {levels} levels");
    }
    if let Some(sources) = sources {
        name += &format!(", {sources} sources");
    }
    Variant::new(Factor::RuleFmm, name, cost, recipe)
}

fn rays(count: u32) -> Variant {
    let recipe = Recipe {
        rays_per_point: Some(count),
        ..draft()
    };
    let cost = 0.4 + 0.6 * f64::from(count) / 256.0;
    Variant::new(Factor::Rays, format!("{count} rays"), cost, recipe)
}

/// Returns the baseline with its number of points multiplied by `times`.
fn density(base: &BakeSettings, times: f32) -> Variant {
    // Rounds to three digits for readability.
    let radius = base.coarse_radius / times.sqrt();
    let unit = libm::powf(10.0, 2.0 - libm::floorf(libm::log10f(radius)));
    let recipe = Recipe {
        coarse_radius: Some(libm::roundf(radius * unit) / unit),
        ..draft()
    };
    let name = format!("{times} × points");
    Variant::new(Factor::Density, name, f64::from(times).max(0.5), recipe)
}

fn bounces(count: u32) -> Variant {
    let name = match count {
        1 => "1 bounce".to_string(),
        n => format!("{n} bounces"),
    };
    Variant {
        run: Run {
            bounces: count,
            ..Run::default()
        },
        cost: 0.0,
        ..Variant::new(Factor::Bounces, name, 0.0, draft())
    }
}

/// Returns the lower tiers of a preset's bake. They need no further bake if they come directly
/// after it.
fn tiers(preset: Preset) -> impl Iterator<Item = Variant> {
    (1..TIERS).map(move |tier| {
        let recipe = Recipe {
            preset,
            ..Recipe::default()
        };
        let name = format!("{preset:?}, tier {tier}").to_lowercase();
        Variant {
            run: Run {
                tier,
                ..Run::default()
            },
            ..Variant::new(Factor::Tier, name, 0.0, recipe)
        }
    })
}

fn several(preset: Preset, rays: u32, epsilon: f32, cost: f64) -> Variant {
    let name = format!("{preset:?}, {rays} rays, ε {epsilon}").to_lowercase();
    let recipe = Recipe {
        preset,
        rays_per_point: Some(rays),
        truncation_error: Some(epsilon),
        receiver_tolerance: Some(2.0 * epsilon),
        ..Recipe::default()
    };
    Variant::new(Factor::Several, name, cost, recipe)
}

/// Returns a few variants for the settings of the baseline, most important first. Those without a
/// bake of their own come first.
#[must_use]
pub fn quick(base: &BakeSettings) -> Vec<Variant> {
    let mut all = vec![bounces(1), bounces(2), bounces(8)];
    all.extend(tiers(Preset::Draft));
    all.extend([
        l08(0.025, 1.0),
        pca_preset(Preset::Draft, 1.3),
        fmm(Preset::Draft, None, None, 0.8),
        epsilon(0.1, 0.8),
        l08(0.005, 1.0),
        pca(10, 100, 1.3),
        plain(0.05, 0.7),
        plain(0.01, 0.9),
        rays(64),
        density(base, 0.25),
        several(Preset::Draft, 1024, 0.02, 3.0),
    ]);
    all
}

/// Returns all variants for the settings of the baseline, most important first.
#[must_use]
pub fn full(base: &BakeSettings) -> Vec<Variant> {
    let with = |factor, name: &str, cost, recipe| Variant::new(factor, name, cost, recipe);
    let mut all: Vec<Variant> = [1, 2, 3, 6, 8, 16].into_iter().map(bounces).collect();
    all.extend(tiers(Preset::Draft));
    all.extend([0.1, 0.05, 0.025, 0.01, 0.004, 0.0015].map(|e| l08(e, 1.0)));
    all.extend([0.2, 0.1, 0.05, 0.02, 0.007, 0.0025].map(|e| plain(e, 0.8)));
    all.push(pca_preset(Preset::Draft, 1.3));
    all.push(fmm(Preset::Draft, None, None, 0.8));
    all.extend([1, 16].map(|k| fmm(Preset::Draft, None, Some(k), 0.8)));
    all.push(fmm(Preset::Draft, Some(5), None, 1.0));
    all.push(fmm(Preset::Medium, None, None, 4.0));
    all.extend([(3, 50), (10, 25), (20, 50), (10, 100), (30, 100)].map(|(k, n)| pca(k, n, 1.3)));
    all.extend([epsilon(0.1, 0.8), epsilon(0.05, 0.9), epsilon(0.015, 1.4)]);
    all.push(with(Factor::Preset, "medium", 15.0, Recipe::default()));
    // Same cost as the bake, so that they are left out together with it.
    all.extend(tiers(Preset::Medium).map(|v| Variant { cost: 15.0, ..v }));
    all.push(pca_preset(Preset::Medium, 16.0));
    all.push(epsilon(0.007, 2.0));
    all.extend([64, 128, 512, 1024, 4096].map(rays));
    all.extend([0.25, 0.5, 2.0, 4.0].map(|times| density(base, times)));
    all.push(several(Preset::Draft, 1024, 0.02, 3.0));
    all.push(several(Preset::Draft, 1024, 0.01, 3.5));
    let levels = |levels, name| {
        let recipe = Recipe {
            levels: Some(levels),
            ..draft()
        };
        with(Factor::Levels, name, 1.2, recipe)
    };
    all.extend([
        levels(3, "3 levels"),
        levels(4, "4 levels"),
        levels(6, "6 levels"),
    ]);
    let added = |extra, name| {
        let recipe = Recipe {
            refinement_levels: Some(extra),
            ..draft()
        };
        with(Factor::Added, name, 1.0, recipe)
    };
    all.extend([
        added(0, "no refinement levels"),
        added(4, "4 refinement levels"),
    ]);
    let sending = |count, name| {
        let recipe = Recipe {
            sender_levels: Some(count),
            ..draft()
        };
        with(Factor::Senders, name, 1.5, recipe)
    };
    all.extend([sending(3, "3 sender levels"), sending(5, "5 sender levels")]);
    let lit = |samples, name| {
        let recipe = Recipe {
            samples_per_sender: Some(samples),
            ..draft()
        };
        with(Factor::SamplesPerSender, name, 1.0, recipe)
    };
    all.extend([
        lit(1, "1 sample per sender"),
        lit(32, "32 samples per sender"),
    ]);
    all.push(with(
        Factor::Bounces,
        "4 bounces, baked",
        1.2,
        Recipe {
            bounce_mode: BounceMode::Baked,
            ..draft()
        },
    ));
    all.push(several(Preset::Medium, 256, 0.02, 5.0));
    all.push(several(Preset::Medium, 512, 0.01, 9.0));
    let high = Recipe {
        preset: Preset::High,
        ..Recipe::default()
    };
    all.push(with(Factor::Preset, "high", 45.0, high));
    all
}
