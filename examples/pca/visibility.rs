//! Soft shadows: light of a rectangle in the penumbra, by the number of coefficients, beside the reference integrator.

use bevy_meshless_gi::accuracy::{Camera, Errors, Image, direct_irradiance, errors, render};
use bevy_meshless_gi::asset::BakedScene;
use bevy_meshless_gi::frame::project::extent;
use bevy_meshless_gi::frame::soft::{self, Rays, Sight, SoftLight, SoftParams, unshadowed};
use bevy_meshless_gi::frame::{VectorIrradiance, splat};
use bevy_meshless_gi::samples::{Random, trace_particles};
use bevy_meshless_gi::scene::{Geometry, Light, Ray, Surface, TriangleMesh};
use bevy_meshless_gi::transport::pca::{Visibility, VisibilitySettings, bake_visibility};
use glam::Vec3;
use rayon::prelude::*;
use std::error::Error;
use std::path::Path;
use std::time::Instant;

/// Visible fractions between which a place lies in the penumbra.
pub const PENUMBRA: [f32; 2] = [0.02, 0.98];
/// The reference cuts the rectangle into so many strata along each edge.
const STRATA: i32 = 16;
/// Samples of the light, as \[P14\] Fig. 5 has them.
pub const SAMPLES: u32 = 25;

/// The lamp of a scene: a panel below the ceiling.
pub fn lamp(name: &str) -> Light {
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

/// Panels that the constants of [`soft`] were not chosen with: elsewhere, of other sizes and other shapes.
pub fn other_lamps(name: &str) -> [(&'static str, Light); 2] {
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

/// A place, its irradiance by the reference, and without shadows.
#[derive(Clone, Copy)]
pub struct Place {
    pub x: Vec3,
    pub n: Vec3,
    pub reference: f32,
    pub unshadowed: f32,
}

/// Irradiance by the reference integrator, a random sample in each stratum of the panel.
pub fn reference(mesh: &TriangleMesh, light: &Light, x: Vec3, n: Vec3, stream: u64) -> f32 {
    let Light::Rect {
        center,
        u,
        v,
        radiance,
    } = *light
    else {
        return 0.0;
    };
    let start = x + n * mesh.lift(x);
    let mut random = Random::new(9, stream, 0);
    let at = |i: i32| (2 * i + 1) as f32 / STRATA as f32 - 1.0;
    let mut sum = 0.0;
    for i in 0..STRATA * STRATA {
        let part = Light::Rect {
            center: center + u * at(i % STRATA) + v * at(i / STRATA),
            u: u / STRATA as f32,
            v: v / STRATA as f32,
            radiance,
        };
        sum += direct_irradiance(mesh, &part, start, n, &mut random).x;
    }
    sum
}

/// Places where importance particles land, that the lamp lights.
pub fn places(scene: &BakedScene, mesh: &TriangleMesh, light: &Light) -> Vec<Place> {
    let viewpoints: Vec<Vec3> = scene.info.viewpoints.iter().map(|&v| v.into()).collect();
    let landed = trace_particles(mesh, &viewpoints, 0..1200, 0xfeed, false).candidates;
    let lamp = SoftLight::of(light, SAMPLES).expect("a rectangle");
    let extent = extent(scene);
    landed
        .par_iter()
        .enumerate()
        .map(|(i, c)| {
            let (x, n) = (c.surface.position, c.surface.normal);
            Place {
                x,
                n,
                reference: reference(mesh, light, x, n, i as u64),
                unshadowed: unshadowed(&lamp, x, n, extent),
            }
        })
        .filter(|p| p.unshadowed > 1e-4)
        .collect()
}

pub fn in_penumbra(p: &Place) -> bool {
    let f = p.reference / p.unshadowed;
    f > PENUMBRA[0] && f < PENUMBRA[1]
}

/// Errors of irradiance at `places`, in three ways of display: (i) what arrives is splatted, (ii) what is missing is splatted as a vector and taken from the unshadowed light
/// of the place, (iii) the visible fraction is splatted. `sight` says what a point sees.
pub fn compare<S: Sight>(
    scene: &BakedScene,
    light: &SoftLight,
    params: &SoftParams,
    places: &[Place],
    sight: impl Fn(usize, Vec3, Vec3) -> S + Sync,
) -> [Errors; 3] {
    let mut fractions = vec![VectorIrradiance::default(); scene.points.len()];
    let mut deficits = fractions.clone();
    let senders = scene.senders();
    fractions[..senders]
        .par_iter_mut()
        .zip(&mut deficits[..senders])
        .with_min_len(64)
        .enumerate()
        .for_each(|(i, (fraction, deficit))| {
            let (x, n) = (scene.points[i].x(), scene.points[i].n());
            let sight = sight(i, x, n);
            let (f, _) = soft::fraction(light, x, n, &sight);
            let e = unshadowed(light, x, n, params.extent);
            fraction.x = [f, e * f, 0.0, 0.0];
            let d = soft::deficit(params, light, x, n, &sight);
            (deficit.x, deficit.y, deficit.z) = ([d.x; 4], [d.y; 4], [d.z; 4]);
        });
    soft::spread(scene, &mut fractions);
    soft::spread(scene, &mut deficits);
    let values: Vec<[f32; 3]> = places
        .par_iter()
        .map(|p| {
            let at = |v: &[VectorIrradiance]| {
                splat::splat_vector(&scene.points, &scene.display, v, p.x, p.n).unwrap_or_default()
            };
            let [f, shadowed, ..] = at(&fractions).x;
            let missing = at(&deficits).dot(p.n).x.clamp(0.0, p.unshadowed);
            [shadowed, p.unshadowed - missing, p.unshadowed * f]
        })
        .collect();
    let right: Vec<Vec3> = places.iter().map(|p| Vec3::splat(p.reference)).collect();
    [0, 1, 2].map(|k| {
        let got: Vec<Vec3> = values.iter().map(|v| Vec3::splat(v[k])).collect();
        errors(&got, &right, &vec![Vec3::ZERO; right.len()])
    })
}

/// As [`compare`], by rays: the least that points and display leave.
pub fn compare_rays(
    scene: &BakedScene,
    mesh: &TriangleMesh,
    light: &SoftLight,
    params: &SoftParams,
    places: &[Place],
) -> [Errors; 3] {
    compare(scene, light, params, places, |_, x, n| Rays {
        geometry: mesh,
        start: x + n * mesh.lift(x),
    })
}

/// As [`compare`], from memory.
pub fn compare_memory(
    scene: &BakedScene,
    visibility: &Visibility,
    light: &SoftLight,
    params: &SoftParams,
    places: &[Place],
) -> [Errors; 3] {
    compare(scene, light, params, places, |i, _, n| {
        soft::Eye::new(params, visibility, i, n)
    })
}

/// Numbers of coefficients that are tried.
const COUNTS: [u32; 8] = [1, 2, 5, 10, 20, 50, 75, 100];

/// One bake of visibility.
pub struct Variant {
    pub what: &'static str,
    pub points: usize,
    pub clusters: usize,
    pub basis: usize,
    pub coefficients: usize,
    pub kept: f64,
    pub bytes: usize,
    pub packed: usize,
    pub seconds: f64,
    pub penumbra: f64,
    pub lit: f64,
}

/// A panel that no constant was chosen with.
pub struct Other {
    pub what: &'static str,
    pub places: usize,
    pub penumbra: f64,
    pub rays: f64,
}

/// What was measured in one scene.
pub struct Found {
    pub name: String,
    pub places: (usize, usize),
    pub by_count: Vec<(u32, f64)>,
    pub rays: [Errors; 3],
    pub penumbra: [Errors; 3],
    pub lit: [Errors; 3],
    pub variants: Vec<Variant>,
    pub others: Vec<Other>,
    /// Seconds by rays and from memory.
    pub seconds: [f64; 2],
}

/// With the first `count` components only: those behind have no scale.
fn first_components(visibility: &Visibility, count: u32) -> Visibility {
    let mut out = visibility.clone();
    for cluster in &visibility.clusters {
        for j in count.min(cluster.components)..cluster.components {
            out.scales[(cluster.scales + 1 + j) as usize] = 0.0;
        }
    }
    out
}

/// Measures a scene and draws its picture into `folder`.
pub fn measure(
    name: &str,
    mesh: &TriangleMesh,
    scene: &BakedScene,
    folder: &Path,
) -> Result<Found, Box<dyn Error>> {
    let light = lamp(name);
    let lamp = SoftLight::of(&light, SAMPLES).ok_or("no rectangle")?;
    let lit = places(scene, mesh, &light);
    let shade: Vec<Place> = lit.iter().copied().filter(in_penumbra).collect();
    eprintln!(
        "{name}: {} places, {} in the penumbra",
        lit.len(),
        shade.len()
    );
    let points: Vec<(Vec3, Vec3)> = scene.points[..scene.senders()]
        .iter()
        .map(|p| (p.x(), p.n()))
        .collect();
    let usual = VisibilitySettings::default();
    let bake = |settings: &VisibilitySettings| {
        let began = Instant::now();
        let baked =
            bake_visibility(mesh, &points, settings, &|_| true).ok_or("too much to store")?;
        Ok::<_, Box<dyn Error>>((baked.0, began.elapsed().as_secs_f64()))
    };
    let mut variants = Vec::new();
    let mut shown = None;
    let settings = [
        ("the defaults", usual),
        (
            "1000 points a cluster, as [P14]",
            VisibilitySettings {
                cluster_points: 1000,
                ..usual
            },
        ),
        (
            "coefficients above 5e-3 only",
            VisibilitySettings {
                tolerance: 5e-3,
                ..usual
            },
        ),
        (
            "100 coefficients",
            VisibilitySettings {
                components: 100,
                tolerance: 0.0,
                ..usual
            },
        ),
    ];
    let mut by_count = Vec::new();
    for (what, settings) in settings {
        let (visibility, seconds) = bake(&settings)?;
        let params = SoftParams::new(&visibility, extent(scene), 1);
        let error =
            |v: &Visibility, places: &[Place]| compare_memory(scene, v, &lamp, &params, places);
        if settings.components == 100 {
            by_count = COUNTS
                .iter()
                .map(|&k| (k, error(&first_components(&visibility, k), &shade)[1].nrmse))
                .collect();
        }
        let (penumbra, all) = (error(&visibility, &shade), error(&visibility, &lit));
        let with = BakedScene {
            visibility: Some(visibility),
            ..scene.clone()
        };
        let packed = with.to_bytes()?.len() - scene.to_bytes()?.len();
        let visibility = with.visibility.as_ref().ok_or("lost")?;
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
            penumbra: penumbra[1].nrmse,
            lit: all[1].nrmse,
        });
        eprintln!("  {what}: {:.4}", penumbra[1].nrmse);
        if shown.is_none() {
            shown = Some((with, params, penumbra, all));
        }
    }
    let (with, params, penumbra, all) = shown.ok_or("nothing was baked")?;
    let visibility = with.visibility.as_ref().ok_or("lost")?;
    let mut others = Vec::new();
    for (what, light) in other_lamps(name) {
        let lamp = SoftLight::of(&light, SAMPLES).ok_or("no rectangle")?;
        let shade: Vec<Place> = places(scene, mesh, &light)
            .into_iter()
            .filter(in_penumbra)
            .collect();
        others.push(Other {
            what,
            places: shade.len(),
            penumbra: compare_memory(scene, visibility, &lamp, &params, &shade)[1].nrmse,
            rays: compare_rays(scene, mesh, &lamp, &params, &shade)[1].nrmse,
        });
    }
    let time = |what: &dyn Fn(usize) -> f32| {
        let began = Instant::now();
        let sum: f32 = (0..points.len()).map(what).sum();
        std::hint::black_box(sum);
        began.elapsed().as_secs_f64()
    };
    let by_rays = time(&|i| {
        let (x, n) = points[i];
        let sight = Rays {
            geometry: mesh,
            start: x + n * mesh.lift(x),
        };
        soft::fraction(&lamp, x, n, &sight).0
    });
    let from_memory = time(&|i| {
        let (x, n) = points[i];
        soft::fraction(&lamp, x, n, &soft::Eye::new(&params, visibility, i, n)).0
    });
    picture(name, mesh, &with, &light, folder)?;
    Ok(Found {
        name: name.into(),
        places: (lit.len(), shade.len()),
        by_count,
        rays: compare_rays(scene, mesh, &lamp, &params, &shade),
        penumbra,
        lit: all,
        variants,
        others,
        seconds: [by_rays, from_memory],
    })
}

/// From memory, the truth, and their difference, side by side.
fn picture(
    name: &str,
    mesh: &TriangleMesh,
    scene: &BakedScene,
    light: &Light,
    folder: &Path,
) -> Result<(), Box<dyn Error>> {
    let (width, height) = (360, 270);
    let camera = match name {
        "cornell" => Camera {
            eye: Vec3::new(2.78, 2.73, -7.6),
            target: Vec3::new(2.78, 2.5, 2.8),
            up: Vec3::Y,
            vertical_angle: 0.7,
        },
        _ => Camera {
            eye: Vec3::new(7.8, 2.2, 3.9),
            target: Vec3::new(4.2, 0.7, 1.6),
            up: Vec3::Y,
            vertical_angle: 1.1,
        },
    };
    let lamp = SoftLight::of(light, SAMPLES).ok_or("no rectangle")?;
    let deficits = soft::deficits(scene, &[lamp]);
    let extent = extent(scene);
    let memory = |_: &Ray, s: &Surface, _: &mut Random| {
        let e = unshadowed(&lamp, s.position, s.normal, extent);
        let missing = splat::splat(
            &scene.points,
            &scene.display,
            &deficits,
            s.position,
            s.normal,
        );
        Vec3::splat((e - missing.unwrap_or_default().x).max(0.0))
    };
    let truth = |_: &Ray, s: &Surface, random: &mut Random| {
        Vec3::splat(reference(mesh, light, s.position, s.normal, random.bits()))
    };
    let black = |_: Vec3| Vec3::ZERO;
    let ours = render(mesh, &camera, (width, height), 1, &memory, &black);
    let right = render(mesh, &camera, (width, height), 1, &truth, &black);
    let mean = right.pixels.iter().map(|p| p.x).sum::<f32>() / right.pixels.len() as f32;
    let exposure = 0.35 / mean;
    let mut pixels = Vec::new();
    for y in 0..height as usize {
        let row = y * width as usize..(y + 1) * width as usize;
        pixels.extend_from_slice(&ours.pixels[row.clone()]);
        pixels.extend_from_slice(&right.pixels[row.clone()]);
        let differences = ours.pixels[row.clone()].iter().zip(&right.pixels[row]);
        pixels.extend(differences.map(|(a, b)| Vec3::splat(0.2 / exposure) + 5.0 * (*a - *b)));
    }
    let image = Image {
        width: 3 * width,
        height,
        pixels,
    };
    image::save_buffer(
        folder.join(format!("{name}.png")),
        &image.to_srgb8(exposure),
        image.width,
        image.height,
        image::ExtendedColorType::Rgb8,
    )?;
    Ok(())
}
