//! [V11]'s experiment on a few hundred points: accuracy of each basis. The bounds are measured with
//! a margin, and another reference violates them.

use meshless_gi_lab::accuracy::{
    Basis, ComparisonRow, PointSet, Quantity, Solution, SphereOverDisk, compare_bases,
};

const BASES: [Basis; 5] = [
    Basis::Shepard,
    Basis::HalfGaussian,
    Basis::NarrowGaussian,
    Basis::Lehtinen,
    Basis::FlatVector,
];

fn row(rows: &[ComparisonRow], basis: Basis, quantity: Quantity) -> &ComparisonRow {
    let mut rows = rows.iter();
    let found = rows.find(|r| r.basis == basis && r.quantity == quantity);
    found.expect("was compared")
}

/// Tests properties of the table at the paper's own density, for any point set. Returns the first
/// violated property as an error.
fn check(rows: &[ComparisonRow]) -> Result<(), String> {
    let is = |true_: bool, what: &str| {
        if true_ {
            Ok(())
        } else {
            Err(format!("{what}: {rows:#?}"))
        }
    };
    for r in rows {
        let e = [r.sphere, r.disk];
        let covered = e.iter().all(|e| e.uncovered == 0.0 && e.rmse.is_finite());
        is(covered, "every basis covers everything")?;
    }
    let of = |basis, quantity| row(rows, basis, quantity);
    let reflected = |basis| of(basis, Quantity::Indirect);
    let (ours, single) = (reflected(Basis::FlatVector), reflected(Basis::Lehtinen));
    // Measured over nine point sets: 3.5 to 4.0 %, and 2.8 to 3.2 %; iterated, on the disk, 3.2 to
    // 5.5 %.
    is(ours.sphere.rmse < 0.055, "ours on the sphere")?;
    is(ours.disk.rmse < 0.045, "ours on the disk")?;
    is(ours.sphere.rmse < 0.7 * single.sphere.rmse, "vectors help")?;
    is(ours.disk.rmse < single.disk.rmse, "less blur")?;
    is(single.disk.rmse < 0.06, "Lehtinen's level on the disk")?;
    // Cost of vectors: see docs/reports/v11.md.
    is(
        (-0.07..-0.01).contains(&ours.sphere.bias),
        "bias of vectors",
    )?;
    is(ours.disk.bias.abs() < 0.01, "no bias on the disk")?;
    is(
        reflected(Basis::Shepard).disk.rmse > 4.0 * ours.disk.rmse,
        "Shepard's spikes",
    )?;
    // Advantages of the Gaussians, and their cost.
    let half = reflected(Basis::HalfGaussian);
    is(half.disk.rmse < 0.5 * ours.disk.rmse, "smooth light")?;
    is(half.sphere.rmse > ours.sphere.rmse, "few points that curve")?;
    let all = |basis| of(basis, Quantity::Total);
    is(
        all(Basis::FlatVector).disk.rmse < all(Basis::Lehtinen).disk.rmse,
        "the shadow's edge",
    )?;
    is(
        all(Basis::FlatVector).disk.oscillation.abs() < 0.1,
        "no oscillation",
    )?;
    for gaussian in [Basis::HalfGaussian, Basis::NarrowGaussian] {
        is(all(gaussian).disk.oscillation > 0.4, "oscillation")?;
    }
    // Iterating in the basis adds the blurred shadow's light, and no more.
    let solved = of(Basis::FlatVector, Quantity::SolvedIndirect);
    is(solved.sphere.rmse < 0.055, "solved on the sphere")?;
    is(solved.disk.rmse < 0.065, "solved on the disk")
}

fn rows(set: &PointSet, known: &Solution, truth: &Solution) -> Vec<ComparisonRow> {
    compare_bases(set, known, truth, &BASES, true, 3).expect("no singular system")
}

#[test]
fn basis_ranking_matches_document_and_detects_other_reference() {
    let scene = SphereOverDisk::default();
    let solution = scene.solve(400).expect("a scene");
    for seed in [1, 9] {
        let set = PointSet::new(&scene, 3.0, seed);
        check(&rows(&set, &solution, &solution)).unwrap();
        if seed == 1 {
            let higher = SphereOverDisk {
                height: 21.0,
                ..scene
            };
            let other = higher.solve(400).expect("a scene");
            assert!(check(&rows(&set, &solution, &other)).is_err());
        }
    }
}

#[test]
fn basis_error_falls_with_points_and_is_reproducible() {
    let scene = SphereOverDisk::default();
    let solution = scene.solve(400).expect("a scene");
    let ours = |spacing: f64| {
        let set = PointSet::new(&scene, spacing, 2);
        let bases = [Basis::FlatVector, Basis::Lehtinen, Basis::LehtinenLevels];
        compare_bases(&set, &solution, &solution, &bases, false, 2).expect("nothing to solve")
    };
    let (coarse, fine) = (ours(6.0), ours(3.0));
    for (c, f) in coarse.iter().zip(&fine) {
        assert!(f.points > 3 * c.points);
        if c.quantity == Quantity::Indirect {
            assert!(f.sphere.rmse < 0.75 * c.sphere.rmse, "{c:?} {f:?}");
            assert!(f.disk.rmse < 0.75 * c.disk.rmse, "{c:?} {f:?}");
        }
    }
    assert_eq!(ours(6.0), coarse);
}
