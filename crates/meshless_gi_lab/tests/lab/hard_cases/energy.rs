//! Energy figures of a bake against independent computations: gain, row sums and reciprocity,
//! computed here again in double precision or in another way.

use super::support::{baked, closed, cornell, small};
use glam::{DVec3, Vec3};
use meshless_gi::{
    BakedScene, CpuFrame, FrameLight, FrameSettings, Material, Recipe, TransportMethod,
};

/// Returns Σ_j F_ij·n_i of point `i` over all links, including those to the sky.
fn row_sum(scene: &BakedScene, i: usize) -> f64 {
    let row = &scene.data().operator.rows[i];
    let n = scene.data().points[i].n().as_dvec3();
    let links = &scene.data().operator.links[row.start as usize..][..row.count as usize];
    let sum: DVec3 = links.iter().map(|l| l.vector().as_dvec3()).sum();
    f64::from(row.scale) * sum.dot(n)
}

#[test]
fn transport_rows_sum_to_hemisphere() {
    for level in [
        closed(Material::default()),
        cornell(1.0, Vec3::ZERO), // Open: the sky's part counts.
    ] {
        let bake = baked(&level, &small());
        let scene = &bake.scene;
        assert!(bake.stats.uncovered < 1e-6, "{}", bake.stats.uncovered);
        let off = (0..scene.data().points.len())
            .filter(|&i| scene.data().operator.rows[i].tier != 0)
            .map(|i| (row_sum(scene, i) - 1.0).abs());
        let worst = off.fold(0.0, f64::max);
        let energy = bake.stats.energy;
        eprintln!("rows off one by {worst:.1e}, reported {energy:?}");
        assert!(worst < 1e-6 && energy.row_deviation < 1e-6);
        assert!(energy.row_deviation_rms <= energy.row_deviation);
    }
    // The paper's method drops links, and its rows lose their mass: the same figure shows it.
    let paper = Recipe {
        transport: TransportMethod::L08,
        ..small()
    };
    let energy = baked(&cornell(1.0, Vec3::ZERO), &paper).stats.energy;
    eprintln!("l08: {energy:?}");
    assert!(energy.row_deviation_rms > 0.01, "{energy:?}");
}

/// Returns the asymptotic growth of reflected light from sweep to sweep: the change of the senders'
/// light between two numbers of sweeps.
fn growth(scene: &BakedScene) -> f64 {
    let mut frame = CpuFrame::new(scene);
    let light_source = FrameLight::point(Vec3::new(0.1, 1.2, 0.3), Vec3::ONE, f32::INFINITY);
    frame.set_lights(scene, &[light_source]);
    let mut after = |sweeps: u32| -> Vec<f64> {
        let settings = FrameSettings {
            sweeps,
            ..FrameSettings::default()
        };
        frame.solve(scene, &settings);
        let finest = &frame.senders()[scene.data().finest_senders()];
        finest.iter().map(|s| f64::from(s[0])).collect()
    };
    let all: Vec<Vec<f64>> = (0..9).map(&mut after).collect();
    let added = |k: usize| -> f64 {
        let pairs = all[k].iter().zip(&all[k - 1]);
        pairs.map(|(a, b)| (a - b).abs()).sum()
    };
    (added(8) / added(4)).powf(0.25)
}

#[test]
fn spectral_radius_bound_holds_and_is_tight() {
    for rule in [TransportMethod::Bounded, TransportMethod::L08] {
        let recipe = Recipe {
            transport: rule,
            ..small()
        };
        let bake = baked(&cornell(1.0, Vec3::ZERO), &recipe);
        let (energy, growth) = (bake.stats.energy, growth(&bake.scene));
        eprintln!("{rule:?}: grows by {growth:.4}, reported {energy:?}");
        assert!(
            growth <= f64::from(energy.spectral_radius_bound) * 1.001,
            "{growth} {energy:?}"
        );
        // Signs leave only the row sums to the paper's method.
        let near = if rule == TransportMethod::Bounded {
            0.9
        } else {
            0.3
        };
        assert!(
            growth > near * f64::from(energy.spectral_radius_bound),
            "{growth} {energy:?}"
        );
        assert!(energy.spectral_radius_estimate <= energy.spectral_radius_bound);
    }
}

/// Exchange between surfaces differs by noise, which decreases with the number of rays.
#[test]
fn operator_reciprocity_improves_with_rays() {
    let room = closed(Material::default());
    let residual = |rays: u32, extra: u32| {
        let recipe = Recipe {
            rays_per_point: Some(rays),
            levels: Some(3 + extra),
            sender_levels: Some(2 + extra),
            ..small()
        };
        baked(&room, &recipe).stats.energy.reciprocity
    };
    let [few, many, fine] = [residual(16, 0), residual(256, 0), residual(64, 1)];
    eprintln!(
        "not reciprocal: {few:.3} with 16 rays, {many:.3} with 256, {fine:.3} with finer senders"
    );
    assert!(
        many < 0.75 * few && fine < 0.75 * few,
        "{few} {many} {fine}"
    );
    assert!(many > 0.001);
}
