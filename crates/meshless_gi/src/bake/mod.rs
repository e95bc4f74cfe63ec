//! The whole bake as one call: from geometry and a recipe to a [`BakedScene`].
//!
//! Viewpoints → points → clip planes, parents, pull rows → training lights → operator → baked
//! bounces → packing → the error, measured. Equal input gives equal bytes, whatever the number of
//! threads (design D5): chunks are fixed, sums are ordered, random numbers are counted. Threads are
//! those of the rayon pool that the call runs in.

mod bake_scene;
mod bake_settings;
mod basis_training;
mod energy;
mod energy_components;
mod energy_fmm;
mod estimate;
mod fmm;
mod materials;
mod occluders;
mod precision_check;
mod probes;
mod progress;
mod quality_level;
mod ray_baseline;
mod recipe;
mod recipe_text;
mod sky;
mod staleness;
mod stats;
mod training_lights;
mod transport_method;
mod visibility;

pub use bake_scene::{BakeSceneError, bake_scene};
pub use bake_settings::{BakeSettings, reached_area};
pub use estimate::{ErrorEstimate, estimate_errors};
pub use occluders::{OccluderBox, OccluderDesc};
pub use probes::ProbeSettings;
pub use progress::{BakeStage, Progress};
use quality_level::QualityParameters;
pub use ray_baseline::cast_gather_rays;
pub use recipe::{BounceMode, Preset, Recipe, RecipeError};
pub use sky::SkyModel;
pub use staleness::{BAKE_VERSION, BakeInputs, Staleness, canonical_recipe, is_stale};
pub use stats::{BakeStats, StageSeconds};
pub use transport_method::{FmmRecipe, PcaRecipe, TransportMethod};
pub use visibility::VisibilityRecipe;

use crate::asset::{
    BakeInfo, BakedScene, EnergyInfo, FlatBasis, LightSamples, PointSurface, SkyVisibility,
    TierInfo,
};
use crate::basis::{Hierarchy, HierarchySettings, Weights, find_places};
use crate::samples::{find_viewpoints, trace_particles};
use crate::scene::{Bvh, Geometry, Occluder, OccluderGeometry};
use crate::transport::pca::Compression;
use crate::transport::{
    BounceScene, BoundedSettings, Deposit, GatherSettings, RawRow, Receivers, RefinedOperator,
    SenderForm, SenderTree, UnindexedLinkTerm, assign_tiers, bounce_operator, l08, pack,
    refine_bounded,
};
use glam::Vec3;
use std::time::Instant;

/// C of the senders' functions under rule `bounded`: the least that covers a saturated Poisson disk
/// set (C = 1) with a margin.
const SENDER_OVERLAP: f32 = 1.25;

/// What is baked.
pub struct BakeSource<'a> {
    /// What rays meet.
    pub geometry: &'a dyn Geometry,
    /// The same geometry as triangles, for the frame's shadow rays.
    pub bvh: Bvh,
    /// Triangles (or other primitives), for the statistics.
    pub primitives: u64,
    /// Hash of the geometry and its materials, for the fingerprint.
    pub content_hash: [u8; 32],
    /// Parts of the level that are not in the geometry: those that the recipe's occluders name.
    pub occluders: Vec<Occluder>,
}

/// A finished bake.
#[derive(Debug)]
pub struct Baked {
    /// What a frame needs.
    pub scene: BakedScene,
    /// Where the time went.
    pub stats: BakeStats,
}

/// Why there is no bake.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BakeError {
    /// The recipe makes no sense.
    #[error(transparent)]
    Recipe(#[from] RecipeError),
    /// No surface was found that light can reach.
    #[error(
        "no surface was reached by light from {viewpoints} viewpoints: the level is empty, or the viewpoints lie outside of it"
    )]
    NoReachableSurface {
        /// How many were tried.
        viewpoints: usize,
    },
    /// The level lies so far from its origin that single precision cannot tell its places apart.
    #[error(
        "the level of {size} m lies {far} m from its origin, where coordinates are {spacing} m apart: move it to its origin, and place its root instead"
    )]
    PrecisionLoss {
        /// Largest coordinate, meters.
        far: f32,
        /// Largest edge of the box around it, meters.
        size: f32,
        /// Distance between neighboring coordinates there, meters.
        spacing: f32,
    },
    /// An occluder that the level has no part for.
    #[error(
        "the level has nothing called `{name}` for the occluder of that name: it must be the name of a node with triangles, or have boxes"
    )]
    UnknownOccluder {
        /// The occluder's name.
        name: String,
    },
    /// More sets of occluders that light passes one after the other than can be told apart.
    #[error("light passes the occluders in more than {most} combinations")]
    TooManyOccluderSets {
        /// How many can be told apart.
        most: usize,
    },
    /// What points see for soft shadows is too much.
    #[error("soft shadows: {0}")]
    Visibility(crate::transport::pca::VisibilityError),
    /// The points make no octree.
    #[error("the octree: {0}")]
    Octree(#[from] crate::transport::fmm::FmmError),
    /// Somebody asked it to stop.
    #[error("the bake was canceled")]
    Canceled,
}

/// Bakes `source` as `recipe` says.
///
/// # Errors
/// See [`BakeError`]. No input makes it panic.
pub fn bake(
    source: &BakeSource<'_>,
    recipe: &Recipe,
    progress: &Progress,
) -> Result<Baked, BakeError> {
    recipe.check()?;
    let occluders = occluders::find(&recipe.occluders, &source.occluders, source.geometry)?;
    if !occluders.is_empty() {
        let shapes: Vec<_> = occluders.iter().map(Occluder::shapes).collect();
        let open = BakeSource {
            geometry: &OccluderGeometry::new(source.geometry, &occluders),
            bvh: source.bvh.clone().with_occluders(&shapes),
            occluders,
            ..*source
        };
        return bake_known(&open, recipe, progress);
    }
    bake_known(source, recipe, progress)
}

/// Bakes what [`bake`] has found to be sound, once or until the error is met.
fn bake_known(
    source: &BakeSource<'_>,
    recipe: &Recipe,
    progress: &Progress,
) -> Result<Baked, BakeError> {
    let Some(most) = recipe.target_nrmse else {
        return bake_once(source, recipe, &recipe.preset.parameters(), progress);
    };
    let began = Instant::now();
    let mut best: Option<Baked> = None;
    let error = |baked: &Baked| baked.scene.info.estimated_nrmse;
    for care in QualityParameters::refinement_steps(most) {
        let baked = bake_once(source, recipe, &care, progress)?;
        let met = error(&baked) <= most;
        // A recipe that fixes all that care is taken by makes the same again.
        let again = best.as_ref().map(|b| &b.scene.info.recipe) == Some(&baked.scene.info.recipe);
        if best.as_ref().is_none_or(|best| error(&baked) < error(best)) {
            best = Some(baked);
        }
        if met || again {
            break;
        }
    }
    let mut baked = best.ok_or(BakeError::Canceled)?;
    if error(&baked) > most {
        baked.stats.warnings.push(format!(
            "the estimated error is {:.2} %, not the {:.2} % that were asked for: this is the best of what was tried, up to the finest settings",
            100.0 * error(&baked),
            100.0 * most
        ));
    }
    baked.stats.seconds.total = began.elapsed().as_secs_f64();
    Ok(baked)
}

fn bake_once(
    source: &BakeSource<'_>,
    recipe: &Recipe,
    care: &QualityParameters,
    progress: &Progress,
) -> Result<Baked, BakeError> {
    let began = Instant::now();
    let geometry = source.geometry;
    let go_on = |stage, done| {
        if progress.set(stage, done) {
            Ok(())
        } else {
            Err(BakeError::Canceled)
        }
    };
    let mut stats = BakeStats {
        triangles: source.primitives,
        threads: rayon::current_num_threads() as u64,
        ..BakeStats::default()
    };

    stats
        .warnings
        .extend(precision_check::check_precision(&geometry.bounds())?);

    // Viewpoints and the size of things.
    go_on(BakeStage::Points, 0.0)?;
    let (viewpoints, rays) = if recipe.viewpoints.is_empty() {
        find_viewpoints(geometry, recipe.seed)
    } else {
        (recipe.viewpoints.iter().map(|&v| v.into()).collect(), 0)
    };
    stats.rays += rays;
    let pilot = trace_particles(geometry, &viewpoints, 0..512, recipe.seed ^ 0x70_69, false);
    stats.rays += pilot.rays;
    if pilot.candidates.is_empty() {
        return Err(BakeError::NoReachableSurface {
            viewpoints: viewpoints.len(),
        });
    }
    // Where particles rarely live past their dropped bounces, drop none ([L08] drops three of
    // thirty).
    let drop_first = pilot.candidates.len() >= 512 * 8;
    let (area, rays) = reached_area(geometry, &viewpoints, drop_first, recipe.seed);
    stats.rays += rays;
    let settings = recipe.settings_with(area, care)?;

    // Points, levels, parents, pull.
    let building = HierarchySettings {
        coarse_radius: settings.coarse_radius,
        levels: settings.levels as usize,
        sender_levels: settings.sender_levels as usize,
        most: settings.max_points(),
        seed: settings.seed,
        sender_overlap: match settings.transport {
            TransportMethod::Bounded | TransportMethod::Pca(_) | TransportMethod::Fmm(_) => {
                Some(SENDER_OVERLAP)
            }
            TransportMethod::L08 => None,
        },
        clip: settings.clip_planes,
        drop_first,
    };
    let mut hierarchy = Hierarchy::build(geometry, &viewpoints, &building, &|done| {
        progress.set(BakeStage::Points, 0.9 * done)
    })
    .ok_or(BakeError::Canceled)?;
    stats.rays += hierarchy.rays;
    if hierarchy.is_empty() {
        return Err(BakeError::NoReachableSurface {
            viewpoints: viewpoints.len(),
        });
    }
    let sender_levels = settings.sender_levels as usize;
    let places = lit_places(geometry, &mut hierarchy, &settings, &mut stats.rays);
    let tree = hierarchy.tree();
    let mut shown = Vec::new();
    // Without links nobody hands mass to coarse senders, and nobody reads their light.
    let linked = settings.fmm().is_none_or(|fmm| fmm.fallback_links);
    let mut pull = match settings.transport {
        TransportMethod::Bounded | TransportMethod::Pca(_) | TransportMethod::Fmm(_) if linked => {
            let (areas, rays) = hierarchy.shown_areas(geometry, &viewpoints, &tree, &building);
            stats.rays += rays;
            shown = areas;
            hierarchy.tree_pull(&tree, &shown)
        }
        _ => hierarchy.pull(),
    };
    let mut parents = hierarchy.parents(settings.transport == TransportMethod::L08);
    stats.seconds.points = began.elapsed().as_secs_f64();

    // The operator.
    let transport_began = Instant::now();
    go_on(BakeStage::Transport, 0.0)?;
    let gathering = GatherSettings {
        geometry,
        sender_levels,
        rays: settings.rays_per_point,
        seed: settings.seed,
        deposit: match settings.transport {
            TransportMethod::Bounded | TransportMethod::Pca(_) | TransportMethod::Fmm(_) => {
                Deposit::Finest
            }
            TransportMethod::L08 => Deposit::All,
        },
    };
    let told = |done| progress.set(BakeStage::Transport, done);
    let mut compression = None;
    let (mut free_space, mut space_passing) = (None, Vec::new());
    let (refined, form) = match settings.transport {
        TransportMethod::Fmm(_) if !linked => (
            Some(RefinedOperator::without_rows(hierarchy.len())),
            SenderForm::Averages,
        ),
        TransportMethod::Bounded | TransportMethod::Pca(_) | TransportMethod::Fmm(_) => {
            let tree = SenderTree::new(&tree, &hierarchy.level_starts[..=sender_levels]);
            let (training, rays) = training_lights::train(
                &gathering,
                &hierarchy,
                &viewpoints,
                &places,
                &pull,
                &tree,
                drop_first,
            );
            stats.rays += rays;
            let basis = match settings.transport {
                TransportMethod::Pca(pca) => {
                    let (basis, rays) = basis_training::light_basis(
                        &gathering,
                        &hierarchy,
                        &viewpoints,
                        &places,
                        &pull,
                        &pca,
                        drop_first,
                    );
                    stats.rays += rays;
                    stats.clusters = basis.clusters() as u64;
                    stats.components = basis.columns() as u64;
                    stats.basis_missed = basis.missed();
                    compression = Some(Compression::new(&basis, pull.len()));
                    Some(basis)
                }
                _ => None,
            };
            let bounded = BoundedSettings {
                epsilon: settings.truncation_error,
                tolerance: settings.receiver_tolerance,
                always: sender_levels.max(1),
                extra_levels: settings.refinement_levels as usize,
                extra_points: settings.max_refinement_points as usize,
                extra_rays: settings.rays_of_level(settings.levels as usize),
            };
            let mut receivers = Receivers {
                hierarchy: &mut hierarchy,
                parents: &mut parents,
                building: &building,
            };
            let refined = refine_bounded(
                &gathering,
                &mut receivers,
                &tree,
                &training,
                &bounded,
                basis.as_ref(),
                &told,
            );
            if let (Some(light), Some(_)) = (&settings.probes, &refined) {
                let mut room = probes::Room {
                    gathering: &gathering,
                    hierarchy: &hierarchy,
                    viewpoints: &viewpoints,
                    tree: &tree,
                    training: &training,
                    epsilon: settings.truncation_error,
                    sky_terms: settings.sky == SkyModel::Harmonics,
                    drop_first,
                    stats: &mut stats,
                };
                let (probes, passing) = probes::bake(light, &mut room, progress)?;
                (free_space, space_passing) = (Some(probes), passing);
            }
            if let Some(handed) = refined.as_ref().and_then(|r| r.handed.as_ref()) {
                pull = handed.pull(&tree, &shown);
            }
            let form = match basis {
                Some(_) => SenderForm::Components,
                None => SenderForm::Averages,
            };
            (refined, form)
        }
        TransportMethod::L08 => {
            let neighbors = l08::neighbors(&hierarchy, sender_levels);
            (
                l08::refine_l08(
                    &gathering.scene(&hierarchy),
                    &parents,
                    &neighbors,
                    settings.truncation_error,
                    &told,
                ),
                SenderForm::Differences,
            )
        }
    };
    let refined = refined.ok_or(BakeError::Canceled)?;
    let (flat, rays) = hierarchy.flat(geometry, &viewpoints, &building);
    stats.rays += rays;
    let transport_seconds = transport_began.elapsed().as_secs_f64();
    stats.seconds.gather = transport_seconds * refined.gather_share;
    stats.seconds.refine = transport_seconds - stats.seconds.gather;

    let cells = fmm::Cells::find(geometry, &hierarchy, &settings);
    let (baked, passing) = assemble(
        source,
        recipe,
        &settings,
        viewpoints,
        hierarchy,
        flat,
        places,
        pull,
        parents,
        refined,
        form,
        compression,
        stats,
        progress,
    )?;
    let baked = fmm::build(geometry, &settings, cells, baked, progress)?;
    let mut baked = visibility::bake_point_visibility(source, &settings, baked, progress)?;
    baked.scene.probes = free_space;
    baked.scene.occluders = occluders::known(&source.occluders, &passing, &space_passing)?;
    finish(source, recipe, baked, began, progress)
}

/// Where the senders of the finest sender level are lit; their surfaces reflect and emit what those
/// do in the mean. With one place a sender that is its own point, as in \[L08\].
fn lit_places(
    geometry: &dyn Geometry,
    hierarchy: &mut Hierarchy,
    settings: &BakeSettings,
    rays: &mut u64,
) -> LightSamples {
    if settings.samples_per_sender <= 1 {
        return LightSamples::default();
    }
    let finest = settings.sender_levels as usize - 1;
    let level = hierarchy.level(finest);
    let (list, cast) = find_places(
        geometry,
        &hierarchy.senders[finest],
        &mut hierarchy.surfaces[level],
        settings.samples_per_sender,
        settings.seed,
    );
    *rays += cast;
    LightSamples {
        per_sender: settings.samples_per_sender,
        list,
    }
}

/// Puts the pieces into the frame's arrays.
#[expect(
    clippy::too_many_arguments,
    reason = "the pieces of one bake, each made by one stage and used up here"
)]
fn assemble(
    source: &BakeSource<'_>,
    recipe: &Recipe,
    settings: &BakeSettings,
    viewpoints: Vec<Vec3>,
    hierarchy: Hierarchy,
    flat: crate::basis::LevelBasis,
    places: LightSamples,
    pull: Weights,
    parents: Weights,
    mut refined: RefinedOperator,
    form: SenderForm,
    compression: Option<Compression>,
    mut stats: BakeStats,
    progress: &Progress,
) -> Result<(Baked, Vec<UnindexedLinkTerm>), BakeError> {
    let sender_levels = settings.sender_levels as usize;
    let senders = hierarchy.level_starts[sender_levels] as usize;
    stats.rays += refined.rays;
    stats.gather_rays = refined.rays;
    stats.gathered = refined.gathered;
    stats.senders = senders as u64;
    stats.points_per_level = hierarchy
        .level_starts
        .windows(2)
        .map(|w| u64::from(w[1] - w[0]))
        .collect();
    stats.truncated_levels = hierarchy.truncated.iter().map(|&l| l as u64).collect();

    let mut surfaces: Vec<PointSurface> = hierarchy
        .surfaces
        .iter()
        .zip(&refined.sky)
        .map(|(s, sky)| PointSurface {
            albedo: s.albedo.to_array(),
            emission: s.emission.to_array(),
            sky: sky.to_array(),
            ..PointSurface::default()
        })
        .collect();
    // A sender reflects with the mean albedo of what it stands for, not with the texel under its
    // center.
    for level in (0..sender_levels).rev() {
        for k in hierarchy.level(level) {
            let row = pull.row(k);
            if !row.is_empty() {
                let mean: Vec3 = row
                    .iter()
                    .map(|w| w.weight * Vec3::from_array(surfaces[w.index as usize].albedo))
                    .sum();
                surfaces[k].albedo = mean.min(Vec3::ONE).to_array();
            }
        }
    }

    let tiers = assign_tiers(&refined.rows, &hierarchy.level_starts, &parents, form);
    let coefficients = compression
        .as_ref()
        .map_or(senders, Compression::components);
    let (sky_terms, rays) = sky::terms(
        source.geometry,
        &hierarchy,
        &mut refined.rows,
        coefficients,
        settings,
    );
    stats.rays += rays;
    let mut packed = pack(
        &refined.rows,
        &tiers,
        &refined.sky,
        &sky_terms,
        coefficients,
        form,
    );
    packed.operator.compression = compression;
    let (materials, rays) = match settings.dynamic_materials {
        true => materials::cover(source.geometry, &hierarchy, &places, &pull),
        false => (None, 0),
    };
    stats.rays += rays;
    let size = source.geometry.bounds();
    let settings_text = settings.to_ron();
    stats.links = packed.operator.links.len() as u64;
    stats.active_rows = refined.rows.iter().filter(|r: &&RawRow| r.active).count() as u64;
    stats.uncovered = refined.uncovered;
    stats.largest_row_sum = f64::from(refined.largest_row_sum);
    stats.link_error = f64::from(packed.error);
    stats.clip_planes = flat.planes.len() as u64;
    let mut scene = BakedScene {
        surfaces,
        level_starts: hierarchy.level_starts,
        sender_levels: settings.sender_levels,
        places,
        pull,
        parents,
        operator: packed.operator,
        fmm: None,
        illumination: Vec::new(),
        materials,
        sky: (settings.sky == SkyModel::Harmonics).then(|| SkyVisibility {
            senders: (sky_terms.iter().zip(&hierarchy.surfaces))
                .take(senders)
                .map(|(terms, s)| terms.map(|t| t.dot(s.normal)))
                .collect(),
        }),
        bounces: None,
        visibility: None,
        probes: None,
        occluders: None,
        display: FlatBasis {
            radius: flat.points.first().map_or(0.0, |p| p.radius),
            planes: flat.planes,
            grid: flat.grid,
        },
        points: flat.points,
        bvh: source.bvh.clone(),
        info: BakeInfo {
            version: env!("CARGO_PKG_VERSION").into(),
            bake_version: BAKE_VERSION,
            fingerprint: staleness::fingerprint_of(
                &source.content_hash,
                &settings_text,
                &recipe.viewpoints,
            ),
            content_hash: staleness::hex(&source.content_hash),
            level: recipe.scene.clone(),
            level_digest: String::new(),
            given_recipe: canonical_recipe(recipe),
            recipe: settings_text,
            triangles: source.primitives,
            rays: stats.rays,
            bounces: settings.bounces,
            bounds: [size.min.to_array(), size.max.to_array()],
            viewpoints: viewpoints.iter().map(|v| v.to_array()).collect(),
            estimated_nrmse: 0.0,
            estimated_nrmse_interval: 0.0,
            tiers: Vec::new(),
            link_error: packed.error,
            uncovered: refined.uncovered as f32,
            largest_row_sum: refined.largest_row_sum,
            energy: EnergyInfo::default(),
            request: String::new(),
        },
    };
    scene.info.tiers = TierInfo::of(&scene);
    let energy = energy::enforce_energy_bound(&mut scene, &refined.missed);
    stats
        .warnings
        .extend(energy::warning(&energy, stats.senders));
    stats.energy = energy;
    scene.info.energy = energy;

    let bounces_began = Instant::now();
    scene.bounces =
        (settings.bounce_mode == BounceMode::Baked && settings.bounces > 1).then(|| {
            progress.set(BakeStage::Bounces, 0.0);
            let coarsest = scene.level(0);
            bounce_operator(
                &BounceScene {
                    rows: &refined.rows,
                    normals: &hierarchy.surfaces[coarsest.clone()]
                        .iter()
                        .map(|s| s.normal)
                        .collect::<Vec<_>>(),
                    albedo: &scene.surfaces[coarsest]
                        .iter()
                        .map(|s| s.albedo.into())
                        .collect::<Vec<_>>(),
                    parents: &scene.parents,
                    senders,
                },
                settings.bounces - 1,
                0.02 * settings.truncation_error,
            )
        });
    stats.seconds.bounces = bounces_began.elapsed().as_secs_f64();
    if progress.is_canceled() {
        return Err(BakeError::Canceled);
    }

    Ok((Baked { scene, stats }, packed.passing))
}

/// Measures the error and closes the statistics.
fn finish(
    source: &BakeSource<'_>,
    recipe: &Recipe,
    mut baked: Baked,
    began: Instant,
    progress: &Progress,
) -> Result<Baked, BakeError> {
    let estimate_began = Instant::now();
    let (estimates, rays) = estimate_errors(&baked.scene, source.geometry, recipe.seed, progress)
        .ok_or(BakeError::Canceled)?;
    let info = &mut baked.scene.info;
    for (tier, estimate) in info.tiers.iter_mut().zip(&estimates) {
        tier.estimated_nrmse = estimate.nrmse;
        tier.estimated_nrmse_interval = estimate.interval;
    }
    let whole = estimates.last().copied().unwrap_or_default();
    info.estimated_nrmse = whole.nrmse;
    info.estimated_nrmse_interval = whole.interval;
    baked.stats.rays += rays;
    info.rays = baked.stats.rays;
    baked.stats.tiers.clone_from(&info.tiers);
    baked.stats.estimated_nrmse = f64::from(whole.nrmse);
    baked.stats.estimated_nrmse_interval = f64::from(whole.interval);
    baked.stats.seconds.estimate = estimate_began.elapsed().as_secs_f64();
    baked.stats.seconds.total = began.elapsed().as_secs_f64();
    Ok(baked)
}
