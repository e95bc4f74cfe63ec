//! What a report tries: one factor at a time around a baseline, the presets, and the paper's rule
//! beside ours.

use meshless_gi::internals::bake::Settings;
use meshless_gi::internals::transport::TIERS;
use meshless_gi::{BounceMode, FrameSettings, Preset, Recipe, TransportMethod};
use serde::Serialize;

/// Reflections that errors are measured for, and that a frame runs where nothing else is said: the
/// recipes' default.
pub const BOUNCES: u32 = 4;

/// What a variant changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Factor {
    /// A preset as it is.
    Preset,
    /// The threshold of the rule `bounded`, and with it the tolerance.
    Epsilon,
    /// The same without added levels: on the points that the paper's rule has.
    Plain,
    /// The paper's rule, by its threshold.
    RuleL08,
    /// Bases of direct light, rule `pca`: vectors, clusters and threshold.
    RulePca,
    /// An octree of points, rule `fmm`: order, leaves, sources, and which levels send.
    RuleFmm,
    /// Points of all levels.
    Density,
    /// Levels of the hierarchy.
    Levels,
    /// Levels that are added where light asks for them.
    Added,
    /// Rays a point.
    Rays,
    /// Levels that send.
    Senders,
    /// Places that each sender is lit at.
    Places,
    /// More than one at once.
    Several,
    /// The operator's tier that a frame uses.
    Tier,
    /// Reflections, and where they are computed.
    Bounces,
}

impl Factor {
    /// All of them, in the order of tables.
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
        Self::Places,
        Self::Several,
        Self::Tier,
        Self::Bounces,
    ];

    /// Words for people.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Preset => "presets",
            Self::Epsilon => "threshold ε",
            Self::Plain => "threshold ε, no added levels",
            Self::RuleL08 => "rule l08, as published",
            Self::RulePca => "rule pca, bases of light",
            Self::RuleFmm => "rule fmm, an octree of points",
            Self::Density => "density of points",
            Self::Levels => "levels",
            Self::Rays => "rays a point",
            Self::Added => "added levels",
            Self::Senders => "levels that send",
            Self::Places => "places a sender",
            Self::Several => "several at once",
            Self::Tier => "tier in the frame",
            Self::Bounces => "reflections",
        }
    }
}

/// What is chosen in the frame and not in the bake.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Run {
    /// Diffuse reflections.
    pub bounces: u32,
    /// Tier of the operator, see [`FrameSettings::tier`].
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

/// One thing to try.
#[derive(Clone, Debug, PartialEq)]
pub struct Variant {
    /// What it changes.
    pub factor: Factor,
    /// A few words, for charts and tables.
    pub name: String,
    /// What to bake.
    pub recipe: Recipe,
    /// What to run.
    pub run: Run,
    /// About how long the bake takes, in bakes of the baseline: only to keep within a report's
    /// time.
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

    /// The recipe as a user writes it: only what is not as the preset has it.
    #[must_use]
    pub fn recipe_text(&self) -> String {
        fn some<T: std::fmt::Debug>(out: &mut Vec<String>, name: &str, value: Option<T>) {
            out.extend(value.map(|v| format!("{name}: {v:?}")));
        }
        let r = &self.recipe;
        let mut out = vec![format!("preset: {:?}", r.preset)];
        some(
            &mut out,
            "rule",
            (r.rule != TransportMethod::default()).then_some(r.rule),
        );
        some(&mut out, "coarse_radius", r.coarse_radius);
        some(&mut out, "levels", r.levels);
        some(&mut out, "sender_levels", r.sender_levels);
        some(&mut out, "extra_levels", r.extra_levels);
        some(&mut out, "extra_points", r.extra_points);
        some(&mut out, "rays", r.rays);
        some(&mut out, "places", r.places);
        some(&mut out, "epsilon", r.epsilon);
        some(&mut out, "tolerance", r.tolerance);
        some(&mut out, "coefficients", r.coefficients);
        some(&mut out, "cluster_points", r.cluster_points);
        some(&mut out, "lamps", r.lamps);
        some(&mut out, "order", r.order);
        some(&mut out, "leaf", r.leaf);
        some(&mut out, "sources", r.sources);
        some(&mut out, "pair_rays", r.pair_rays);
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

/// The baseline: quick to bake, so that many things around it can be tried.
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
        epsilon: Some(value),
        // As the presets have it.
        tolerance: Some(2.0 * value),
        ..draft()
    };
    Variant::new(Factor::Epsilon, format!("ε {value}"), cost, recipe)
}

/// The default rule on the very points that the paper's rule gets: what differs then is the rule
/// alone.
fn plain(value: f32, cost: f64) -> Variant {
    let mut variant = epsilon(value, cost);
    variant.factor = Factor::Plain;
    variant.name = format!("plain ε {value}");
    variant.recipe.extra_levels = Some(0);
    variant
}

fn l08(value: f32, cost: f64) -> Variant {
    let recipe = Recipe {
        rule: TransportMethod::L08,
        epsilon: Some(value),
        ..draft()
    };
    Variant::new(Factor::RuleL08, format!("l08 ε {value}"), cost, recipe)
}

/// Bases of so many vectors for clusters of so many senders.
fn pca(coefficients: u32, cluster_points: u32, cost: f64) -> Variant {
    let recipe = Recipe {
        rule: TransportMethod::Pca,
        coefficients: Some(coefficients),
        cluster_points: Some(cluster_points),
        ..draft()
    };
    let name = format!("pca {coefficients} of {cluster_points}");
    Variant::new(Factor::RulePca, name, cost, recipe)
}

/// Rule `pca` as a preset has it.
fn pca_preset(preset: Preset, cost: f64) -> Variant {
    let recipe = Recipe {
        preset,
        rule: TransportMethod::Pca,
        ..Recipe::default()
    };
    let name = format!("pca, {preset:?}").to_lowercase();
    Variant::new(Factor::RulePca, name, cost, recipe)
}

/// Rule `fmm` with as many levels that send as a preset has, or more, from so many places each.
fn fmm(preset: Preset, sender_levels: Option<u32>, sources: Option<u32>, cost: f64) -> Variant {
    let recipe = Recipe {
        preset,
        rule: TransportMethod::Fmm,
        sender_levels,
        sources,
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
        rays: Some(count),
        ..draft()
    };
    let cost = 0.4 + 0.6 * f64::from(count) / 256.0;
    Variant::new(Factor::Rays, format!("{count} rays"), cost, recipe)
}

/// The baseline with so many times its points.
fn density(base: &Settings, times: f32) -> Variant {
    // Three digits do, and can be read.
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
        1 => "1 reflection".to_string(),
        n => format!("{n} reflections"),
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

/// The tiers below all of them of a preset's bake, which needs no bake where it comes right after
/// that.
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
        rays: Some(rays),
        epsilon: Some(epsilon),
        tolerance: Some(2.0 * epsilon),
        ..Recipe::default()
    };
    Variant::new(Factor::Several, name, cost, recipe)
}

/// A handful of bakes, most important first, for the settings that the baseline got. Those that
/// need no bake of their own come first.
#[must_use]
pub fn quick(base: &Settings) -> Vec<Variant> {
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

/// All that is swept, most important first, for the settings that the baseline got.
#[must_use]
pub fn full(base: &Settings) -> Vec<Variant> {
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
    // As dear as the bake, so that they are left out with it.
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
            extra_levels: Some(extra),
            ..draft()
        };
        with(Factor::Added, name, 1.0, recipe)
    };
    all.extend([added(0, "no added levels"), added(4, "4 added levels")]);
    let sending = |count, name| {
        let recipe = Recipe {
            sender_levels: Some(count),
            ..draft()
        };
        with(Factor::Senders, name, 1.5, recipe)
    };
    all.extend([sending(3, "3 sender levels"), sending(5, "5 sender levels")]);
    let lit = |places, name| {
        let recipe = Recipe {
            places: Some(places),
            ..draft()
        };
        with(Factor::Places, name, 1.0, recipe)
    };
    all.extend([lit(1, "1 place a sender"), lit(32, "32 places a sender")]);
    all.push(with(
        Factor::Bounces,
        "4 reflections, baked",
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
