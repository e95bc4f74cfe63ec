//! Visibility by principal components, and soft shadows from it: against rays, in hard cases,
//! through the file, and from damaged ones.

use glam::Vec3;
use meshless_gi::internals::frame::project::extent;
use meshless_gi::internals::frame::soft_shadow::{
    self, DecodedVisibility, RayVisibility, SoftLight, SoftShadowParams,
};
use meshless_gi::internals::samples::Random;
use meshless_gi::internals::transport::pca::{
    HemisphereGrid, Visibility, VisibilityError, VisibilitySettings, bake_visibility, depths,
};
use meshless_gi::{
    BakedScene, Geometry, Limits, Material, Preset, Progress, Quad, Recipe, RecipeError,
    TriangleMesh, VisibilityRecipe, bake_scene,
};
use std::sync::atomic::{AtomicU32, Ordering};

const SOFT: VisibilityRecipe = VisibilityRecipe {
    directions: 504,
    coefficients: 40,
    cluster_size: 100,
    max_cluster_error: 0.03,
};

fn cornell_mesh() -> TriangleMesh {
    TriangleMesh::from_quads(&Quad::cornell_box())
}

fn baked(threads: usize) -> BakedScene {
    let recipe = Recipe {
        preset: Preset::Draft,
        levels: Some(4),
        sender_levels: Some(3),
        refinement_levels: Some(0),
        rays_per_point: Some(16),
        soft_shadows: Some(SOFT),
        ..Recipe::default()
    };
    bake_scene(&cornell_mesh(), &recipe, threads, &Progress::default())
        .unwrap()
        .scene
}

fn panel() -> SoftLight {
    SoftLight::rectangle(
        Vec3::new(0.0, 1.98, 0.0),
        Vec3::X * 0.3,
        Vec3::Z * 0.3,
        Vec3::ONE,
        25,
    )
}

/// Returns visible fractions from baked visibility and by rays, at all points that the light
/// reaches.
fn fractions(scene: &BakedScene, mesh: &TriangleMesh, light: &SoftLight) -> Vec<(f32, f32)> {
    let visibility = scene.data().visibility.as_ref().unwrap();
    let params = SoftShadowParams::new(visibility, extent(scene.data()), 1);
    let points = scene.data().points[..scene.data().senders()]
        .iter()
        .enumerate();
    points
        .filter(|(_, p)| soft_shadow::unshadowed(light, p.x(), p.n(), params.extent) > 1e-3)
        .map(|(i, p)| {
            let (x, n) = (p.x(), p.n());
            let rays = RayVisibility {
                geometry: mesh,
                start: x + n * mesh.ray_offset(x),
            };
            (
                soft_shadow::visible_fraction(
                    light,
                    x,
                    n,
                    &DecodedVisibility::new(&params, visibility, i, n),
                )
                .0,
                soft_shadow::visible_fraction(light, x, n, &rays).0,
            )
        })
        .collect()
}

#[test]
fn pca_visibility_matches_rays_and_round_trips() {
    let mesh = cornell_mesh();
    let scene = baked(2);
    assert_eq!(scene, baked(1), "threads change the bake");
    // Spherical lights too.
    let ball = SoftLight::sphere(Vec3::new(0.2, 1.6, 0.1), 0.2, Vec3::ONE, 9.0, 25);
    let balls = fractions(&scene, &mesh, &ball);
    let off: f32 = balls.iter().map(|(m, r)| (m - r).powi(2)).sum();
    let (off, lit) = (
        (off / balls.len() as f32).sqrt(),
        balls.iter().map(|b| b.1).sum::<f32>(),
    );
    println!("{} points: {off} below a ball", balls.len());
    assert!(off < 0.08 && lit < 0.95 * balls.len() as f32);
    let found = fractions(&scene, &mesh, &panel());
    let (mut square, mut acne, mut leaks, mut full, mut dark) = (0.0, 0.0, 0.0, 0, 0);
    for &(memory, rays) in &found {
        square += (memory - rays).powi(2);
        if rays >= 1.0 {
            full += 1;
            acne += 1.0 - memory;
        } else if rays <= 0.0 {
            dark += 1;
            leaks += memory;
        }
    }
    let rms = (square / found.len() as f32).sqrt();
    let (acne, leaks) = (acne / full as f32, leaks / dark as f32);
    println!(
        "{} points: rms {rms}, acne {acne} at {full}, leaks {leaks} at {dark}",
        found.len()
    );
    assert!(full > 200 && dark > 20);
    assert!(
        rms < 0.06 && acne < 0.015 && leaks < 0.05,
        "{rms} {acne} {leaks}"
    );
    // Must fail: visibility of other points.
    let mut swapped = scene.clone();
    let visibility = swapped.data_mut().visibility.as_mut().unwrap();
    visibility.scales.reverse();
    let wrong = fractions(&swapped, &mesh, &panel());
    let off: f32 = wrong.iter().map(|(m, r)| (m - r).powi(2)).sum();
    assert!((off / wrong.len() as f32).sqrt() > 2.0 * rms);

    let bytes = scene.to_bytes().unwrap();
    assert_eq!(
        BakedScene::from_bytes(&bytes, &Limits::default()).unwrap(),
        scene
    );
    let mut without = scene.clone();
    without.data_mut().visibility = None;
    assert!(without.to_bytes().unwrap().len() < bytes.len());
    assert!(
        soft_shadow::occluded_irradiances(without.data(), &[panel()])
            .iter()
            .all(|d| *d == Default::default())
    );
    damaged(&scene, &bytes);
}

/// Asserts that each damage is detected.
fn damaged(scene: &BakedScene, bytes: &[u8]) {
    let perturb = |what: &str, perturb: &dyn Fn(&mut Visibility)| {
        let mut wrong = scene.clone();
        perturb(wrong.data_mut().visibility.as_mut().unwrap());
        assert!(wrong.validate().is_err(), "{what} is not detected");
    };
    perturb("a grid of zero columns", &|v| v.grid.columns = 0);
    perturb("a grid above the limit", &|v| {
        v.grid = HemisphereGrid {
            columns: u32::MAX,
            rows: u32::MAX,
        }
    });
    perturb("depths relative to NaN", &|v| v.clusters[2].near = f32::NAN);
    perturb("depths relative to zero", &|v| v.clusters[2].near = 0.0);
    perturb("one point less", &|v| v.points.truncate(v.points.len() - 1));
    perturb("a cluster out of range", &|v| {
        v.points[3].cluster = v.clusters.len() as u32
    });
    perturb("a mask beyond the components", &|v| {
        v.points[3].mask[3] |= 1 << 31
    });
    perturb("another start", &|v| v.points[3].first += 1);
    perturb("one coefficient more", &|v| {
        v.points[3].mask[0] = !v.points[3].mask[0]
    });
    perturb("too many components", &|v| {
        v.clusters[0].components = u32::MAX
    });
    perturb("a tangent without length", &|v| {
        v.clusters[0].tangent = [0.0; 3]
    });
    perturb("a tangent that is NaN", &|v| {
        v.clusters[0].tangent[1] = f32::NAN
    });
    perturb("another basis", &|v| v.clusters[1].basis += 1);
    perturb("a basis that ends early", &|v| {
        v.basis.truncate(v.basis.len() - 1)
    });
    perturb("scales that end early", &|v| {
        v.scales.truncate(v.scales.len() - 1)
    });
    perturb("coefficients that end early", &|v| {
        v.coefficients.truncate(v.coefficients.len() - 1)
    });
    perturb("an infinite scale", &|v| v.scales[0] = f32::INFINITY);
    perturb("a scale below zero", &|v| v.scales[1] = -1.0);
    // Checksums detect random damage. No damage may panic.
    let mut random = Random::new(4, 0, 0);
    for _ in 0..40 {
        let mut wrong = bytes.to_vec();
        let at = random.below(wrong.len());
        wrong[at] ^= 1 << random.below(8);
        assert!(
            BakedScene::from_bytes(&wrong, &Limits::default()).is_err(),
            "byte {at}"
        );
    }
}

fn bake(geometry: &dyn Geometry, points: &[(Vec3, Vec3)]) -> Visibility {
    let settings = VisibilitySettings {
        recipe: VisibilityRecipe {
            directions: 252,
            coefficients: 30,
            cluster_size: 100,
            ..VisibilityRecipe::default()
        },
        ..VisibilitySettings::default()
    };
    bake_visibility(geometry, points, &settings, &|_| true)
        .unwrap()
        .0
}

fn visible_fraction(
    visibility: &Visibility,
    points: &[(Vec3, Vec3)],
    i: usize,
    light: &SoftLight,
) -> f32 {
    let params = SoftShadowParams::new(visibility, 4.0, 1);
    let (x, n) = points[i];
    let f = soft_shadow::visible_fraction(
        light,
        x,
        n,
        &DecodedVisibility::new(&params, visibility, i, n),
    )
    .0;
    assert!((0.0..=1.0).contains(&f), "{f}");
    let d = soft_shadow::occluded_irradiance(
        &params,
        light,
        x,
        n,
        &DecodedVisibility::new(&params, visibility, i, n),
    );
    assert!(d.is_finite(), "{d}");
    f
}

fn light_source(at: Vec3) -> SoftLight {
    SoftLight::sphere(at, 0.1, Vec3::ONE, f32::INFINITY, 16)
}

#[test]
fn pca_visibility_of_rank_zero_clusters_matches_rays() {
    // Points at one position have one row, and subtraction of the mean leaves nothing.
    let mesh = cornell_mesh();
    let position = Vec3::new(-0.5, 0.0, 0.6);
    let by_rays = |light: &SoftLight| {
        let start = position + Vec3::Y * mesh.ray_offset(position);
        let rays = RayVisibility {
            geometry: &mesh,
            start,
        };
        soft_shadow::visible_fraction(light, position, Vec3::Y, &rays).0
    };
    for count in [1, 7, 150] {
        let points = vec![(position, Vec3::Y); count];
        let visibility = bake(&mesh, &points);
        assert!(
            visibility.clusters.iter().all(|c| c.components <= 1),
            "{count}"
        );
        for i in [0, count - 1] {
            let (inside, above) = (
                light_source(position + Vec3::Y),
                light_source(position + Vec3::Y * 6.0),
            );
            assert!(
                by_rays(&inside) == 1.0
                    && visible_fraction(&visibility, &points, i, &inside) > 0.99
            );
            assert!(
                by_rays(&above) == 0.0 && visible_fraction(&visibility, &points, i, &above) < 0.01
            );
        }
    }
    // Only the sky is visible.
    let nothing = TriangleMesh::new(Vec::new(), Vec::new(), vec![Material::default()]);
    let points = [
        (Vec3::ZERO, Vec3::Y),
        (Vec3::X, Vec3::Y),
        (Vec3::Z, -Vec3::Y),
    ];
    let visibility = bake(&nothing, &points);
    for (i, p) in points.iter().enumerate() {
        for distance in [1e-3, 1.0, 1e4] {
            assert!(
                visible_fraction(&visibility, &points, i, &light_source(p.0 + p.1 * distance))
                    > 0.95,
                "{i} {distance}"
            );
        }
    }
    assert!(bake_visibility(&nothing, &[], &VisibilitySettings::default(), &|_| true).is_ok());
}

#[test]
fn cancelled_bake_returns_early() {
    let mesh = cornell_mesh();
    let points: Vec<(Vec3, Vec3)> = (0..400)
        .map(|i| (Vec3::new(i as f32 / 200.0 - 1.0, 0.0, 0.7), Vec3::Y))
        .collect();
    let settings = VisibilitySettings {
        recipe: VisibilityRecipe {
            directions: 16,
            cluster_size: 4,
            ..VisibilityRecipe::default()
        },
        ..VisibilitySettings::default()
    };
    let asked = AtomicU32::new(0);
    let found = bake_visibility(&mesh, &points, &settings, &|_| {
        asked.fetch_add(1, Ordering::Relaxed) < 5
    });
    assert_eq!(found.err(), Some(VisibilityError::Stopped));
    // Each thread calls it at most once more.
    let asked = asked.into_inner() as usize;
    assert!(asked <= 6 + rayon::current_num_threads(), "{asked}");
}

#[test]
fn points_in_dome_receive_only_inner_lights() {
    // Constant depth, and lights at the horizon and inside of solids.
    let ball = |radius: f32| {
        let at = |i: usize, j: usize| {
            let (a, b) = (
                i as f32 * std::f32::consts::PI / 24.0,
                j as f32 * std::f32::consts::PI / 24.0,
            );
            Vec3::new(a.sin() * b.cos(), a.cos(), a.sin() * b.sin()) * radius
        };
        let mut triangles = Vec::new();
        for (i, j) in (0..24).flat_map(|i| (0..48).map(move |j| (i, j))) {
            let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
            triangles.extend([[a, b, c], [a, c, d]]);
        }
        let count = triangles.len();
        TriangleMesh::new(triangles, vec![0; count], vec![Material::default()])
    };
    let mesh = ball(2.0);
    let points: Vec<(Vec3, Vec3)> = (0..30)
        .map(|i| (Vec3::new(0.002 * i as f32, 0.0, 0.0), Vec3::Y))
        .collect();
    let visibility = bake(&mesh, &points);
    for (i, p) in points.iter().enumerate() {
        for direction in [
            Vec3::Y,
            Vec3::new(0.8, 0.6, 0.0),
            Vec3::new(-0.3, 0.2, 0.93),
            Vec3::new(0.0, 0.12, -0.99),
        ] {
            let d = direction.normalize();
            for inside in [0.1, 0.9, 1.6] {
                assert!(
                    visible_fraction(&visibility, &points, i, &light_source(p.0 + d * inside))
                        > 0.95
                );
            }
            for outside in [2.5, 4.0, 1e3] {
                assert!(
                    visible_fraction(&visibility, &points, i, &light_source(p.0 + d * outside))
                        < 0.05
                );
            }
        }
    }
    // Inside one of the blocks of the room, below the floor's horizon, and just above it without an
    // occluder.
    let mesh = cornell_mesh();
    let points: Vec<(Vec3, Vec3)> = (0..100)
        .map(|i| {
            let (a, b) = ((i % 10) as f32, (i / 10) as f32);
            (Vec3::new(0.09 * a - 0.9, 0.0, 0.5 + 0.04 * b), Vec3::Y)
        })
        .collect();
    let settings = VisibilitySettings::default();
    let visibility = bake_visibility(&mesh, &points, &settings, &|_| true)
        .unwrap()
        .0;
    let mean = |light: &SoftLight| {
        let sum: f32 = (0..points.len())
            .map(|i| visible_fraction(&visibility, &points, i, light))
            .sum();
        sum / points.len() as f32
    };
    let (block, near) = (
        light_source(Vec3::new(-0.35, 0.5, -0.35)),
        light_source(Vec3::new(-0.4, 0.15, 0.95)),
    );
    println!(
        "in a block {}, near the floor {}",
        mean(&block),
        mean(&near)
    );
    assert!(mean(&block) < 0.05 && mean(&near) > 0.8);
}

#[test]
fn pca_components_are_prefix_of_larger_bake() {
    let mesh = cornell_mesh();
    // The floor, so that clusters have rank: visibility next to and above the blocks changes from
    // point to point.
    let points: Vec<(Vec3, Vec3)> = (0..300)
        .map(|i| {
            let (a, b) = (i % 20, i / 20);
            let at = Vec3::new(a as f32 / 10.0 - 0.95, 0.0, b as f32 / 8.0 - 0.9);
            (at, Vec3::Y)
        })
        .collect();
    let bake = |components| {
        let settings = VisibilitySettings {
            recipe: VisibilityRecipe {
                directions: 252,
                coefficients: components,
                max_cluster_error: f32::INFINITY,
                ..VisibilityRecipe::default()
            },
            tolerance: 0.0,
            ..VisibilitySettings::default()
        };
        bake_visibility(&mesh, &points, &settings, &|_| true)
            .unwrap()
            .0
    };
    let (whole, fewer) = (bake(30), bake(9));
    let first = whole.truncated(9);
    assert_eq!(first.bytes(), fewer.bytes());
    let mut placed = first.clone();
    let (basis, scales, words) = placed.layout().unwrap();
    assert_eq!(placed, first);
    let found = (
        first.basis.len(),
        first.scales.len(),
        first.coefficients.len(),
    );
    assert_eq!((basis, scales, words), found);
    // Root mean squares of the differences of depths and errors, and of the errors.
    let compare = |a: &Visibility, b: &Visibility| {
        let mut sums = [0.0f64; 3];
        for i in 0..points.len() {
            let e = |v: &Visibility, texel| {
                let mut decoded = [0.0; Visibility::MAX_COMPONENTS as usize + 2];
                let count = v.decode(i, &mut decoded);
                let cluster = v.clusters[v.points[i].cluster as usize];
                v.reconstruct(&cluster, &decoded[..count], texel)
            };
            for texel in 0..a.grid.len() as u32 {
                let ((d, s), (e, t)) = (e(a, texel), e(b, texel));
                for (sum, v) in sums.iter_mut().zip([d - e, s - t, t]) {
                    *sum += f64::from(v * v);
                }
            }
        }
        sums.map(|v| (v / (points.len() * a.grid.len()) as f64).sqrt())
    };
    let [depth, error, min] = compare(&first, &fewer);
    println!("depths {depth} and errors {error} apart, of {min}");
    assert!(depth < 0.1 * min && error < 0.1 * min && min > 1e-3);
    // Must fail: all of them.
    let [depth, error, _] = compare(&whole, &fewer);
    assert!(depth > 0.5 * min && error > 0.2 * min);
    assert_eq!(whole.truncated(128), whole);
    let none = whole.truncated(0);
    assert!(none.clusters.iter().all(|c| c.components == 0) && none.coefficients.is_empty());
}

#[test]
fn soft_shadow_of_degenerate_lights_stays_finite() {
    let mesh = cornell_mesh();
    let points = [
        (Vec3::new(0.0, 0.0, 0.0), Vec3::Y),
        (Vec3::new(0.5, 0.0, 0.8), Vec3::Y),
        // Within a wall, and facing out of the scene.
        (Vec3::new(0.0, -0.01, 0.0), Vec3::Y),
        (Vec3::new(0.3, 0.3, 0.9), Vec3::Z),
    ];
    let visibility = bake(&mesh, &points);
    for i in 0..points.len() {
        let (x, n) = points[i];
        let aside = n.any_orthonormal_vector();
        for at in [
            x,
            x + n * 1e-6,
            x + aside,
            x + aside * 1e-3,
            x - n,
            x + n * 1e-30,
            Vec3::splat(1e9),
            Vec3::splat(1e14),
            Vec3::splat(1e20),
        ] {
            for radius in [0.0, 0.1, 100.0] {
                let ball = SoftLight::sphere(at, radius, Vec3::ONE, 10.0, 16);
                let _ = visible_fraction(&visibility, &points, i, &ball);
            }
            for size in [1e-6, 0.3, 50.0] {
                let panel =
                    SoftLight::rectangle(at, aside * size, n.cross(aside) * size, Vec3::ONE, 9);
                let _ = visible_fraction(&visibility, &points, i, &panel);
                let edge = SoftLight::rectangle(at, n * size, aside * size, Vec3::ONE, 9);
                let _ = visible_fraction(&visibility, &points, i, &edge);
            }
        }
        // Nearer than the first occluder, unoccluded.
        assert!(
            visible_fraction(
                &visibility,
                &points[..],
                1,
                &light_source(points[1].0 + Vec3::Y * 0.05)
            ) > 0.95
        );
    }
    let none = SoftLight::default();
    assert_eq!(light_source(Vec3::NAN), none);
    assert_eq!(
        SoftLight::sphere(Vec3::ZERO, f32::INFINITY, Vec3::ONE, 1.0, 4),
        none
    );
    assert_eq!(
        SoftLight::rectangle(Vec3::ZERO, Vec3::X, Vec3::X, Vec3::ONE, 4),
        none
    );
    assert_eq!(
        SoftLight::rectangle(Vec3::ZERO, Vec3::X, Vec3::NAN, Vec3::ONE, 4),
        none
    );
    assert_eq!(
        SoftLight::rectangle(Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::NAN, 4),
        none
    );
    assert_eq!(
        soft_shadow::unshadowed(&none, Vec3::ZERO, Vec3::Y, 1.0),
        0.0
    );
}

#[test]
fn unoccluded_panel_matches_lambert_polygon() {
    use meshless_gi_lab::accuracy::closed_form::polygon;
    let (u, v) = (Vec3::X * 0.4, Vec3::Z * 0.7);
    let center = Vec3::new(0.2, 1.5, -0.3);
    // u × v points down.
    let light = SoftLight::rectangle(center, u, v, Vec3::ONE, 4);
    let corners = [-u - v, u - v, u + v, v - u].map(|c| (center + c).as_dvec3());
    for (x, n) in [
        (Vec3::ZERO, Vec3::Y),
        (Vec3::new(1.0, 0.2, 0.4), Vec3::new(-0.6, 0.8, 0.0)),
    ] {
        let right = polygon(x.as_dvec3(), n.as_dvec3(), &corners, 1.0);
        let got = f64::from(soft_shadow::unshadowed(&light, x, n, 4.0));
        assert!((got / right - 1.0).abs() < 1e-4, "{got} {right}");
    }
    // Half below the horizon: the sum of its small parts above it.
    let (x, n) = (Vec3::new(0.3, 0.4, -0.1), Vec3::X);
    let mut sum = 0.0f64;
    const N: i32 = 400;
    let at = |i: i32| (2 * i + 1) as f32 / N as f32 - 1.0;
    for i in 0..N * N {
        let to = center + u * at(i % N) + v * at(i / N) - x;
        let area = 4.0 * u.length() * v.length() / (N * N) as f32;
        let square = to.length_squared();
        sum += f64::from(area * to.dot(n).max(0.0) * to.y / (square * square));
    }
    let got = f64::from(soft_shadow::unshadowed(&light, x, n, 4.0));
    assert!((got / sum - 1.0).abs() < 2e-3, "{got} {sum}");
    // No light arrives from behind.
    assert_eq!(
        soft_shadow::unshadowed(&light, Vec3::new(0.0, 3.0, 0.0), -Vec3::Y, 4.0),
        0.0
    );
}

#[test]
fn visibility_recipe_limits_are_enforced() {
    let recipe = Recipe::from_ron("(soft_shadows: (coefficients: 30))").unwrap();
    let soft = recipe.soft_shadows.unwrap();
    assert_eq!((soft.coefficients, soft.directions), (30, 4012));
    assert_eq!(Recipe::from_ron("()").unwrap().soft_shadows, None);
    for wrong in [
        "coefficients: 0",
        "coefficients: 129",
        "directions: 3",
        "cluster_points: 1",
        "error: 0",
        "error: NaN",
    ] {
        let found = Recipe::from_ron(&format!("(soft_shadows: ({wrong}))"));
        assert!(
            matches!(found, Err(RecipeError::OutOfRange { .. })),
            "{wrong}"
        );
    }
}

/// A hall of 30 × 10 × 14 m without a roof, with six pillars along each side.
fn hall() -> TriangleMesh {
    let mut triangles = Vec::new();
    let mut quad = |a: Vec3, u: Vec3, v: Vec3| {
        triangles.extend([[a, a + u, a + u + v], [a, a + u + v, a + v]]);
    };
    let (x, y, z) = (Vec3::X * 30.0, Vec3::Y * 10.0, Vec3::Z * 14.0);
    quad(Vec3::ZERO, z, x);
    quad(Vec3::ZERO, y, z);
    quad(x, z, y);
    quad(Vec3::ZERO, x, y);
    quad(z, y, x);
    for i in 0..12 {
        let foot = Vec3::new(
            2.5 + 5.0 * (i % 6) as f32,
            0.0,
            if i < 6 { 3.0 } else { 11.0 },
        );
        let (u, v) = (Vec3::X * 0.8, Vec3::Z * 0.8);
        for (at, along) in [(foot, u), (foot + u, v), (foot + u + v, -u), (foot + v, -v)] {
            quad(at, y, along);
        }
    }
    let count = triangles.len();
    TriangleMesh::new(triangles, vec![0; count], vec![Material::default()])
}

/// Returns the error of each cluster and of each of its points. The error of a cluster is the root
/// mean square of the error of e over its points and over cosine-weighted directions. The error of
/// a point comes with its stored error estimate.
fn wrong(
    mesh: &TriangleMesh,
    points: &[(Vec3, Vec3)],
    v: &Visibility,
) -> Vec<(f32, Vec<[f32; 2]>)> {
    let length = v.grid.len();
    let directions: Vec<Vec3> = (0..length).map(|t| v.grid.direction(t)).collect();
    let weights: Vec<f32> = directions.iter().map(|d| d.z.max(0.05)).collect();
    let whole: f32 = weights.iter().sum();
    let mut out = vec![(0.0, Vec::new()); v.clusters.len()];
    let (mut row, mut decoded) = (
        vec![0.0; length],
        [0.0; Visibility::MAX_COMPONENTS as usize + 2],
    );
    for (i, &point) in points.iter().enumerate() {
        let c = v.points[i].cluster as usize;
        let cluster = &v.clusters[c];
        depths(mesh, point, cluster.tangent.into(), &directions, &mut row);
        let count = v.decode(i, &mut decoded);
        let (mut is, mut says) = (0.0, 0.0);
        for (t, w) in weights.iter().enumerate() {
            let (e, error) = v.reconstruct(cluster, &decoded[..count], t as u32);
            is += w * (e - cluster.encode(row[t])).powi(2) / whole;
            says += w * error * error / whole;
        }
        out[c].0 += is;
        out[c].1.push([is.sqrt(), says.sqrt()]);
    }
    for (square, of) in &mut out {
        *square = (*square / of.len() as f32).sqrt();
    }
    out
}

#[test]
fn high_error_clusters_are_split_and_errors_stored() {
    let mesh = hall();
    // Next to a row of pillars: visibility behind them changes from step to step.
    let points: Vec<(Vec3, Vec3)> = (0..500)
        .map(|i| {
            let (a, b) = ((i % 50) as f32, (i / 50) as f32);
            (Vec3::new(0.3 + 0.6 * a, 0.0, 0.2 + 0.25 * b), Vec3::Y)
        })
        .collect();
    let bake = |error| {
        let settings = VisibilitySettings {
            recipe: VisibilityRecipe {
                directions: 504,
                coefficients: 20,
                cluster_size: 250,
                max_cluster_error: error,
            },
            ..VisibilitySettings::default()
        };
        bake_visibility(&mesh, &points, &settings, &|_| true)
            .unwrap()
            .0
    };
    let (cut, whole) = (bake(0.02), bake(1.0));
    let (found, coarse) = (wrong(&mesh, &points, &cut), wrong(&mesh, &points, &whole));
    let largest = |of: &[(f32, Vec<[f32; 2]>)]| of.iter().fold(0.0f32, |max, c| max.max(c.0));
    println!(
        "{} clusters wrong by {} at most, {} by {}",
        cut.clusters.len(),
        largest(&found),
        whole.clusters.len(),
        largest(&coarse)
    );
    assert!(largest(&found) < 0.021);
    // Must fail: without cuts.
    assert!(largest(&coarse) > 0.04 && whole.clusters.len() < cut.clusters.len());
    // Errors are rounded up to a part of 32, and stored in sixteen bits.
    for (_, points) in coarse {
        assert!(points.iter().any(|p| p[0] > 1.1 * points[0][0]) || points.len() < 20);
        for [is, says] in points {
            assert!(
                says > 0.99 * is && says < 1.03 * is + 0.04 * 0.06,
                "{is} {says}"
            );
        }
    }
}

#[test]
fn pca_visibility_of_large_hall_matches_rays() {
    let mesh = hall();
    let recipe = |max_cluster_error| Recipe {
        preset: Preset::Draft,
        levels: Some(4),
        sender_levels: Some(3),
        refinement_levels: Some(0),
        rays_per_point: Some(16),
        soft_shadows: Some(VisibilityRecipe {
            directions: 1008,
            max_cluster_error,
            ..VisibilityRecipe::default()
        }),
        ..Recipe::default()
    };
    let panel = SoftLight::rectangle(
        Vec3::new(13.0, 6.0, 6.0),
        Vec3::X * 0.7,
        Vec3::Z * 0.7,
        Vec3::ONE,
        25,
    );
    // Difference between baked visibility and rays, light that the rays let through, and light that
    // baked visibility adds to it.
    let apart = |error| {
        let scene = bake_scene(&mesh, &recipe(error), 0, &Progress::default())
            .unwrap()
            .scene;
        let found = fractions(&scene, &mesh, &panel);
        let mean = |of: &dyn Fn(&(f32, f32)) -> f32| {
            found.iter().map(of).sum::<f32>() / found.len() as f32
        };
        let square = mean(&|(m, r)| (m - r) * (m - r));
        println!(
            "error {error}: {} points, {} clusters",
            found.len(),
            scene.data().visibility.as_ref().unwrap().clusters.len()
        );
        (square.sqrt(), mean(&|p| p.1), mean(&|(m, r)| m - r))
    };
    let (cut, whole) = (apart(0.02), apart(1.0));
    println!("cut {cut:?}, whole {whole:?}");
    assert!(cut.1 > 0.1 && cut.1 < 0.95);
    assert!(cut.0 < 0.1 && cut.2.abs() < 0.03, "{cut:?}");
    // Must fail: without cuts.
    assert!(whole.0 > 1.3 * cut.0, "{whole:?}");
}
