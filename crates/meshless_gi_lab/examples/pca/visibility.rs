//! Soft shadows: irradiance of a rectangle light in the penumbra by the number of coefficients,
//! compared with the reference integrator.

use super::picture;
use glam::Vec3;
use meshless_gi::internals::frame::project::extent;
use meshless_gi::internals::frame::soft_shadow::{
    self, RayVisibility, SoftLight, SoftShadowParams, unshadowed,
};
use meshless_gi::internals::frame::{VectorIrradiance, splat};
use meshless_gi::internals::transport::pca::{
    Visibility, VisibilityRecipe, VisibilitySettings, bake_visibility,
};
use meshless_gi::{BakedScene, Geometry, Light, TriangleMesh};
use meshless_gi_lab::accuracy::{
    Errors, PenumbraSample, errors, occluded_irradiances_by_rays, penumbra_samples, shadow_errors,
};
use rayon::prelude::*;
use std::error::Error;
use std::path::Path;
use std::time::Instant;

/// Number of paths of importance particles that select the positions of error measurements.
const PATHS: u64 = 4800;
/// Number of samples of the light.
pub const SAMPLES: u32 = 64;

/// Returns the light of a scene: a panel below the ceiling.
pub fn soft_light(name: &str) -> Light {
    let (center, u, v) = match name {
        "cornell" => (
            Vec3::new(2.78, 5.46, 2.795),
            Vec3::X * 0.65,
            Vec3::Z * 0.525,
        ),
        _ => (Vec3::new(1.8, 2.7, 2.0), Vec3::X * 0.5, Vec3::Z * 0.5),
    };
    Light::Rect {
        center,
        u,
        v,
        radiance: Vec3::ONE,
    }
}

/// Returns panels that were not used to choose the constants of [`soft_shadow`], at other
/// positions, with other sizes and shapes.
pub fn other_lights(name: &str) -> [(&'static str, Light); 2] {
    let panel = |center: [f32; 3], u: f32, v: f32| Light::Rect {
        center: center.into(),
        u: Vec3::X * u,
        v: Vec3::Z * v,
        radiance: Vec3::ONE,
    };
    match name {
        "cornell" => [
            ("0.8 × 1.6 m, aside", panel([1.5, 5.2, 2.0], 0.4, 0.8)),
            ("1.8 × 0.6 m, lower", panel([4.0, 4.9, 3.6], 0.9, 0.3)),
        ],
        _ => [
            ("0.6 × 1.2 m, lower", panel([2.6, 2.5, 1.3], 0.3, 0.6)),
            (
                "1.2 × 0.8 m, the other room",
                panel([6.0, 2.6, 2.4], 0.6, 0.4),
            ),
        ],
    }
}

/// Returns the errors of irradiance at `positions` from baked visibility, for three ways of
/// display. (i) splats visible irradiance. (ii) splats occluded irradiance and subtracts it from
/// the unshadowed irradiance of the position. (iii) splats occluded and unshadowed irradiance.
/// Their quotient is the occluded fraction, as in the kernel `subtract_shadow`.
fn compare(
    scene: &BakedScene,
    visibility: &Visibility,
    light: &SoftLight,
    positions: &[PenumbraSample],
) -> [Errors; 3] {
    let extent = extent(scene.data());
    let params = SoftShadowParams::new(visibility, extent, 1);
    let known = visibility.points.len();
    let mut parts = vec![VectorIrradiance::default(); scene.data().points.len()];
    parts[..known]
        .par_iter_mut()
        .with_min_len(64)
        .enumerate()
        .for_each(|(i, out)| {
            let (x, n) = (scene.data().points[i].x(), scene.data().points[i].n());
            let eye = soft_shadow::DecodedVisibility::new(&params, visibility, i, n);
            let (f, _) = soft_shadow::visible_fraction(light, x, n, &eye);
            let e = unshadowed(light, x, n, extent);
            out.x = [e * f, e * (1.0 - f), 0.0, 0.0];
        });
    soft_shadow::fill_finer_levels(scene.data(), known, &mut parts);
    let values: Vec<[f32; 2]> = positions
        .par_iter()
        .map(|p| {
            let at = splat::splat_vector(
                &scene.data().points,
                &scene.data().display,
                &parts,
                p.x,
                p.n,
            );
            let [arrives, missing, ..] = at.unwrap_or_default().x;
            [arrives, (p.unshadowed - missing).max(0.0)]
        })
        .collect();
    let right: Vec<Vec3> = positions.iter().map(|p| Vec3::splat(p.reference)).collect();
    let by = |k: usize| {
        let got: Vec<Vec3> = values.iter().map(|v| Vec3::splat(v[k])).collect();
        errors(&got, &right, &vec![Vec3::ZERO; right.len()])
    };
    [by(0), by(1), memory(scene, visibility, light, positions)]
}

/// Returns the errors of the third way alone.
fn memory(
    scene: &BakedScene,
    visibility: &Visibility,
    light: &SoftLight,
    positions: &[PenumbraSample],
) -> Errors {
    let occluded_irradiances =
        soft_shadow::occluded_irradiances_from(scene.data(), visibility, &[*light]);
    shadow_errors(scene, &occluded_irradiances, positions)
}

/// Descriptions of the measured visibility bakes.
pub const BAKES: [&str; 3] = [
    "defaults",
    "2016 directions, 1000 points per cluster, 100 coefficients",
    "8064 directions, 150 points per cluster",
];

/// Measured numbers of coefficients.
pub const COUNTS: [u32; 8] = [1, 2, 5, 10, 20, 50, 75, 100];

/// Results of one visibility bake.
pub struct Variant {
    pub what: &'static str,
    pub points: usize,
    pub clusters: usize,
    pub basis: usize,
    pub coefficients: usize,
    pub kept: f64,
    pub bytes: usize,
    pub packed: usize,
    /// Seconds of the bake. `None` if it is a part of the previous one.
    pub seconds: Option<f64>,
    pub penumbra: f64,
    pub lit: f64,
}

/// Results of a panel that was not used to choose a constant.
pub struct OtherPanel {
    pub what: &'static str,
    pub positions: usize,
    /// Errors with the defaults and with the finest bake.
    pub penumbra: [f64; 2],
    pub rays: f64,
}

/// Measurements of one scene.
pub struct Found {
    pub name: String,
    pub positions: (usize, usize),
    /// Errors by the number of coefficients of each bake.
    pub by_count: [Vec<(u32, f64)>; 3],
    pub rays: f64,
    pub penumbra: [Errors; 3],
    pub lit: [Errors; 3],
    pub variants: Vec<Variant>,
    pub others: Vec<OtherPanel>,
    pub timings: Vec<VisibilityTiming>,
}

/// Comparison of the visible fraction of a panel by rays and from baked visibility, at the same
/// points.
pub struct VisibilityTiming {
    pub name: String,
    pub triangles: usize,
    pub points: usize,
    pub samples: u32,
    /// Microseconds per point on one thread.
    pub rays: f64,
    pub memory: f64,
    /// Root mean square difference of the fractions.
    pub apart: f64,
}

/// Results of a bake that splits clusters with an error above `error`.
pub struct SplitResult {
    pub error: f32,
    pub clusters: usize,
    pub bytes: usize,
    pub seconds: f64,
    /// Root mean square difference of the visible fractions by rays and from baked visibility, at
    /// the points.
    pub apart: f64,
    /// NRMSE in the penumbra. `rays` is the NRMSE by rays at the same points.
    pub penumbra: f64,
    pub rays: f64,
    /// Number of positions in the penumbra.
    pub positions: usize,
}

/// Errors above which clusters are split.
const SPLIT_ERRORS: [f32; 4] = [1.0, 0.04, 0.03, 0.02];

/// Bakes the visibility of the scene with and without split clusters. Returns the race of the
/// default bake and the results.
pub fn split_results(
    name: &str,
    mesh: &TriangleMesh,
    scene: &BakedScene,
    light: &Light,
) -> Result<(Vec<VisibilityTiming>, Vec<SplitResult>), Box<dyn Error>> {
    let soft_light = SoftLight::from_light(light, SAMPLES).ok_or("no rectangle")?;
    let shade = penumbra_of(&penumbra_samples(scene, mesh, light, PATHS));
    let points = points_with_visibility(scene);
    let occluded_irradiances = occluded_irradiances_by_rays(scene, mesh, &soft_light, points.len());
    let rays = shadow_errors(scene, &occluded_irradiances, &shade).nrmse;
    let (mut timings, mut split_results) = (Vec::new(), Vec::new());
    let usual = VisibilitySettings::default();
    for error in SPLIT_ERRORS {
        let began = Instant::now();
        let settings = VisibilitySettings {
            recipe: VisibilityRecipe {
                max_cluster_error: error,
                ..usual.recipe
            },
            ..usual
        };
        let (visibility, _) = bake_visibility(mesh, &points, &settings, &|_| true)?;
        let seconds = began.elapsed().as_secs_f64();
        let run = race(name, mesh, scene, &visibility, light)?;
        split_results.push(SplitResult {
            error,
            clusters: visibility.clusters.len(),
            bytes: visibility.bytes(),
            seconds,
            apart: run.last().ok_or("no race")?.apart,
            penumbra: memory(scene, &visibility, &soft_light, &shade).nrmse,
            rays,
            positions: shade.len(),
        });
        if error == usual.recipe.max_cluster_error {
            timings = run;
        }
    }
    Ok((timings, split_results))
}

/// Returns the points with visibility data, as in a bake with soft shadows.
fn points_with_visibility(scene: &BakedScene) -> Vec<(Vec3, Vec3)> {
    let levels = (scene.data().sender_levels as usize + 1).min(scene.levels());
    let known = scene.data().level_starts[levels] as usize;
    (scene.data().points[..known].iter())
        .map(|p| (p.x(), p.n()))
        .collect()
}

/// Runs both methods at the points that have visibility data and that the panel can light. Uses one
/// sample, as `project` does for a point light, and [`SAMPLES`] samples.
pub fn race(
    name: &str,
    mesh: &TriangleMesh,
    scene: &BakedScene,
    visibility: &Visibility,
    light: &Light,
) -> Result<Vec<VisibilityTiming>, Box<dyn Error>> {
    let extent = extent(scene.data());
    let params = SoftShadowParams::new(visibility, extent, 1);
    let mut timings = Vec::new();
    for samples in [1, SAMPLES] {
        let soft_light = SoftLight::from_light(light, samples).ok_or("no rectangle")?;
        let positions: Vec<(usize, Vec3, Vec3)> = (scene.data().points[..visibility.points.len()]
            .iter())
        .enumerate()
        .map(|(i, p)| (i, p.x(), p.n()))
        .filter(|&(_, x, n)| unshadowed(&soft_light, x, n, extent) > 0.0)
        .collect();
        let time = |what: &dyn Fn(&(usize, Vec3, Vec3)) -> f32| {
            let began = Instant::now();
            let found: Vec<f32> = positions.iter().map(what).collect();
            let seconds = began.elapsed().as_secs_f64();
            (1e6 * seconds / positions.len().max(1) as f64, found)
        };
        let (rays, truth) = time(&|&(_, x, n)| {
            let ray_visibility = RayVisibility {
                geometry: mesh,
                start: x + n * mesh.ray_offset(x),
            };
            soft_shadow::visible_fraction(&soft_light, x, n, &ray_visibility).0
        });
        let (memory, decoded) = time(&|&(i, x, n)| {
            soft_shadow::visible_fraction(
                &soft_light,
                x,
                n,
                &soft_shadow::DecodedVisibility::new(&params, visibility, i, n),
            )
            .0
        });
        let pairs = truth.iter().zip(&decoded);
        let square: f64 = pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum();
        timings.push(VisibilityTiming {
            name: name.into(),
            triangles: mesh.len(),
            points: positions.len(),
            samples,
            rays,
            memory,
            apart: (square / positions.len().max(1) as f64).sqrt(),
        });
    }
    Ok(timings)
}

/// Returns the positions that the light illuminates partially.
fn penumbra_of(positions: &[PenumbraSample]) -> Vec<PenumbraSample> {
    positions
        .iter()
        .copied()
        .filter(PenumbraSample::is_in_penumbra)
        .collect()
}

/// A bake of visibility and its seconds.
type TimedBake = (Visibility, f64);

/// Bakes visibility with the settings that [`BAKES`] names.
fn bake_all(
    mesh: &TriangleMesh,
    points: &[(Vec3, Vec3)],
) -> Result<[TimedBake; 3], Box<dyn Error>> {
    let usual = VisibilitySettings::default();
    let bake = |settings: &VisibilitySettings| {
        let began = Instant::now();
        let baked = bake_visibility(mesh, points, settings, &|_| true)?;
        Ok::<_, Box<dyn Error>>((baked.0, began.elapsed().as_secs_f64()))
    };
    Ok([
        bake(&usual)?,
        bake(&VisibilitySettings {
            recipe: VisibilityRecipe {
                directions: 2016,
                coefficients: 100,
                cluster_size: 1000,
                max_cluster_error: f32::INFINITY,
            },
            tolerance: 0.0,
            ..usual
        })?,
        bake(&VisibilitySettings {
            recipe: VisibilityRecipe {
                directions: 8064,
                cluster_size: 150,
                ..usual.recipe
            },
            ..usual
        })?,
    ])
}

/// Measures the panels that were not used to choose a constant, with the defaults and with the
/// finest bake.
fn other_panels(
    name: &str,
    mesh: &TriangleMesh,
    scene: &BakedScene,
    bakes: [&Visibility; 2],
) -> Result<Vec<OtherPanel>, Box<dyn Error>> {
    let points = points_with_visibility(scene).len();
    let mut others = Vec::new();
    for (what, light) in other_lights(name) {
        let soft_light = SoftLight::from_light(&light, SAMPLES).ok_or("no rectangle")?;
        let shade = penumbra_of(&penumbra_samples(scene, mesh, &light, PATHS));
        let error = |visibility: &Visibility| memory(scene, visibility, &soft_light, &shade).nrmse;
        let occluded_irradiances = occluded_irradiances_by_rays(scene, mesh, &soft_light, points);
        others.push(OtherPanel {
            what,
            positions: shade.len(),
            penumbra: bakes.map(error),
            rays: shadow_errors(scene, &occluded_irradiances, &shade).nrmse,
        });
    }
    Ok(others)
}

/// Measures a scene and draws its picture into `folder`.
pub fn measure(
    name: &str,
    mesh: &TriangleMesh,
    scene: &BakedScene,
    folder: &Path,
) -> Result<Found, Box<dyn Error>> {
    let light = soft_light(name);
    let soft_light = SoftLight::from_light(&light, SAMPLES).ok_or("no rectangle")?;
    let lit = penumbra_samples(scene, mesh, &light, PATHS);
    let shade = penumbra_of(&lit);
    eprintln!(
        "{name}: {} points, {} in the penumbra",
        lit.len(),
        shade.len()
    );
    let points = points_with_visibility(scene);
    let known = points.len();
    let usual = VisibilitySettings::default();
    let bakes = bake_all(mesh, &points)?;
    // The first components of a bake are those of a bake with fewer components.
    let by_count = [0, 1, 2].map(|k| {
        let max = [usual.recipe.coefficients, 100, usual.recipe.coefficients][k];
        let counts = COUNTS.into_iter().filter(|&count| count <= max);
        let error = |count| {
            let few = bakes[k].0.truncated(count);
            (count, memory(scene, &few, &soft_light, &shade).nrmse)
        };
        counts.map(error).collect()
    });
    let [
        (own, own_seconds),
        (theirs, their_seconds),
        (fine, fine_seconds),
    ] = bakes;
    let fifty = theirs.truncated(50);
    let others = other_panels(name, mesh, scene, [&own, &fine])?;
    let mut variants = Vec::new();
    let mut shown = None;
    for (what, visibility, seconds) in [
        (BAKES[0], own, Some(own_seconds)),
        (BAKES[1], theirs, Some(their_seconds)),
        ("the first 50 of these, as [P14]", fifty, None),
        (BAKES[2], fine, Some(fine_seconds)),
    ] {
        let error =
            |positions: &[PenumbraSample]| compare(scene, &visibility, &soft_light, positions);
        let (penumbra, all) = (error(&shade), error(&lit));
        let mut with = scene.clone();
        with.data_mut().visibility = Some(visibility);
        let packed = with.to_bytes()?.len() - scene.to_bytes()?.len();
        let visibility = with.data().visibility.as_ref().ok_or("lost")?;
        variants.push(Variant {
            what,
            points: points.len(),
            clusters: visibility.clusters.len(),
            basis: 4 * visibility.basis.len(),
            coefficients: 4 * visibility.coefficients.len(),
            kept: visibility.kept(),
            bytes: visibility.bytes(),
            packed,
            seconds,
            penumbra: penumbra[2].nrmse,
            lit: all[2].nrmse,
        });
        eprintln!("  {what}: {:.4}", penumbra[2].nrmse);
        if shown.is_none() {
            shown = Some((with, penumbra, all));
        }
    }
    let (with, penumbra, all) = shown.ok_or("nothing was baked")?;
    let visibility = with.data().visibility.as_ref().ok_or("lost")?;
    let timings = race(name, mesh, scene, visibility, &light)?;
    picture::draw(name, mesh, &with, &light, folder)?;
    Ok(Found {
        name: name.into(),
        positions: (lit.len(), shade.len()),
        by_count,
        rays: shadow_errors(
            scene,
            &occluded_irradiances_by_rays(scene, mesh, &soft_light, known),
            &shade,
        )
        .nrmse,
        penumbra,
        lit: all,
        variants,
        others,
        timings,
    })
}
