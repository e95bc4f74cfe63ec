use bevy_meshless_gi::accuracy::*;
fn main() {
    let scene = SphereOverDisk::default();
    let solution = scene.solve(1600).unwrap();
    for spacing in [6.0, 4.24, 3.0, 2.12, 1.5] {
        let began = std::time::Instant::now();
        let set = PointSet::new(&scene, spacing, 1);
        let ga = set.gaussian(1.0).unwrap();
        let gn = set.gaussian(0.25).unwrap();
        println!(
            "R {spacing} gaussian pivots {:e} ridge {:e}; narrow {:e} {:e}; {:?}",
            ga.pivots(),
            ga.ridge(),
            gn.pivots(),
            gn.ridge(),
            began.elapsed()
        );
        let rows = compare_bases(&set, &solution, &Basis::ALL, true, 7).unwrap();
        for q in [
            Quantity::Total,
            Quantity::Indirect,
            Quantity::Noisy,
            Quantity::SolvedTotal,
            Quantity::SolvedIndirect,
        ] {
            for r in rows.iter().filter(|r| r.quantity == q) {
                print!("{:?} {:24} {:5}", q, r.basis.name(), r.points);
                for e in [r.sphere, r.disk] {
                    print!(
                        " | {:6.2} {:7.2} {:6.2} {:6.2} {:6.2} {:.4}",
                        100.0 * e.rmse,
                        100.0 * e.largest,
                        100.0 * e.oscillation,
                        100.0 * e.unevenness,
                        100.0 * e.bias,
                        e.uncovered
                    );
                }
                println!();
            }
        }
        println!("{:?}", began.elapsed());
    }
}
