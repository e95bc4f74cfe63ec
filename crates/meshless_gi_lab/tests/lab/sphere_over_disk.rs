//! The sphere over the disk of [V11] §VIII: its two integral equations against themselves at other
//! resolutions, against closed forms and against the Monte Carlo reference, which shares nothing
//! with them.

use glam::Vec3;
use meshless_gi::internals::eval::irradiance_at_all;
use meshless_gi::{Irradiance, ReferenceSettings};
use meshless_gi_lab::accuracy::{Site, Solution, SphereOverDisk, SphereOverDiskError};

const V11: SphereOverDisk = SphereOverDisk {
    radius: 5.0,
    disk: 40.0,
    height: 20.0,
    albedo: 0.9,
    light: 0.9,
};

fn position(site: Site) -> (Vec3, Vec3) {
    match site {
        Site::Sphere(latitude) => {
            // Away from the axes, so that nothing depends on one azimuth.
            let (sine, cosine) = (latitude.sin() as f32, latitude.cos() as f32);
            let n = Vec3::new(0.6 * cosine, sine, 0.8 * cosine);
            (Vec3::Y * V11.height as f32 + n * V11.radius as f32, n)
        }
        Site::Disk(u) => (Vec3::new(-0.8, 0.0, 0.6) * u as f32, Vec3::Y),
    }
}

fn sites() -> Vec<Site> {
    let sphere = [-85.0f64, -50.0, -20.0, 5.0, 30.0];
    let disk = [1.0, 4.0, 7.0, 15.0, 35.0];
    let sphere = sphere.iter().map(|z| Site::Sphere(z.to_radians()));
    sphere.chain(disk.iter().map(|&u| Site::Disk(u))).collect()
}

/// Returns the largest |z| of direct and indirect irradiance against Monte Carlo.
fn largest_z(solution: &Solution, truth: &[Irradiance]) -> f64 {
    let scene = &solution.scene;
    let mut max = 0.0f64;
    for (&site, truth) in sites().iter().zip(truth) {
        let pairs = [
            (scene.direct(site), truth.direct, truth.direct_error),
            (
                solution.indirect(site),
                truth.indirect,
                truth.indirect_error,
            ),
        ];
        for (radiosity, mean, error) in pairs {
            let off = f64::from(mean.x) - radiosity / scene.albedo;
            // Single-precision limit of the light itself, which has no noise.
            max = max.max(off.abs() / f64::from(error.x).max(1e-5));
        }
    }
    max
}

#[test]
fn monte_carlo_matches_closed_form_and_rejects_other_constants() {
    let positions: Vec<(Vec3, Vec3)> = sites().into_iter().map(position).collect();
    let settings = ReferenceSettings {
        paths: 100_000,
        bounces: None,
        seed: 11,
    };
    let truth = irradiance_at_all(&V11.geometry(), &V11.lights(), &positions, &settings);
    assert!(truth.iter().filter(|t| t.indirect_error.x > 0.0).count() >= 9);
    let z = |scene: SphereOverDisk| largest_z(&scene.solve(400).expect("a scene"), &truth);
    // The paths' first directions are a lattice: their error is below that of independent paths.
    let right = z(V11);
    assert!(right < 3.0, "{right}");
    for wrong in [
        SphereOverDisk {
            height: 22.0,
            ..V11
        },
        SphereOverDisk { radius: 5.3, ..V11 },
        SphereOverDisk {
            albedo: 0.86,
            ..V11
        },
        SphereOverDisk { light: 1.0, ..V11 },
        // One π too many in Eq. (5), as the damaged text has it.
        SphereOverDisk {
            albedo: 0.9 / std::f64::consts::PI,
            light: 0.9 * std::f64::consts::PI,
            ..V11
        },
    ] {
        let found = z(wrong);
        assert!(found > 6.0, "{found} for {wrong:?}");
    }
}

#[test]
fn cells_converge_and_hundred_cells_exceed_half_percent_error() {
    let fine = V11.solve(800).expect("a scene");
    assert!(fine.iterations < 40);
    let error = |s: &Solution| {
        let [b, d] = s.difference(&fine);
        b.max(d)
    };
    let rings = [100, 200, 400].map(|n| error(&V11.solve(n).expect("a scene")));
    assert!(rings[0] < 4e-4 && rings[2] < 2e-5, "{rings:?}");
    // The square of the cells' size.
    assert!(
        rings[1] < 0.3 * rings[0] && rings[2] < 0.3 * rings[1],
        "{rings:?}"
    );
    // The thirteenth radius of a hundred is the shadow's edge. A hundred and one are not better,
    // and two hundred end a cell there.
    let sums = [100, 101, 200].map(|n| error(&V11.solve_sums(n).expect("a scene")));
    assert!((0.002..0.0101).contains(&sums[0]), "{sums:?}");
    assert!((0.002..0.0101).contains(&sums[1]), "{sums:?}");
    assert!(sums[2] < 2e-4, "{sums:?}");
}

#[test]
fn sphere_over_disk_matches_closed_forms_of_figure_10() {
    // Without further reflection the lowest position receives light of a disk of 40 m less one of 5
    // m from 15 m: F = R²/(R² + d²) − r²/(r² + d²).
    let faint = SphereOverDisk {
        albedo: 1e-4,
        light: 1.0,
        ..V11
    };
    let seen = 1600.0 / (1600.0 + 225.0) - 25.0 / (25.0 + 225.0);
    let lowest = Site::Sphere(-std::f64::consts::FRAC_PI_2);
    let found = faint.solve(800).expect("a scene").indirect(lowest) / 1e-8;
    assert!((found / seen - 1.0).abs() < 1e-4, "{found} {seen}");
    // Figure 10: B⁺ below 0.6 with S = 0.81; with S = 1 it would leave the axes.
    let fine = V11.solve(400).expect("a scene");
    let highest = fine.indirect(lowest);
    assert!(
        (0.5..0.6).contains(&highest) && highest / 0.81 > 0.6,
        "{highest}"
    );
    // The vector irradiance's part along the normal is the irradiance.
    for site in sites().into_iter().take(5) {
        let (x, n) = position(site);
        let e = fine.vector(x).dot(n.as_dvec3());
        let right = fine.indirect(site) / 0.9;
        assert!((e - right).abs() < 1e-4, "{site:?}: {e} {right}");
        let (Site::Sphere(a), Site::Sphere(b)) = (fine.scene.site(x), site) else {
            panic!("{site:?} is on the sphere");
        };
        assert!((a - b).abs() < 1e-5, "{a} {b}");
    }
}

#[test]
fn invalid_sphere_over_disk_is_rejected() {
    for bad in [
        SphereOverDisk { radius: 0.0, ..V11 },
        SphereOverDisk {
            radius: 41.0,
            ..V11
        },
        SphereOverDisk { height: 5.0, ..V11 },
        SphereOverDisk { albedo: 1.1, ..V11 },
        SphereOverDisk { light: -1.0, ..V11 },
        SphereOverDisk {
            height: f64::NAN,
            ..V11
        },
    ] {
        let refused = bad.solve(100).expect_err("no scene");
        assert!(
            matches!(refused, SphereOverDiskError::Scene(_)),
            "{refused}"
        );
        assert!(bad.solve_sums(100).is_err());
    }
    for cells in [0, 7, 8193] {
        let refused = V11.solve(cells).expect_err("no cells");
        assert_eq!(refused, SphereOverDiskError::Cells(cells));
    }
}
