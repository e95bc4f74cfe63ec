//! The document: what was found, the tables, and the charts and pictures that it shows.

use super::{Experiment, SHOWN, SPACINGS, slug};
use meshless_gi_lab::accuracy::{Basis, ComparisonRow, Quantity, SurfaceErrors};
use std::error::Error;
use std::fmt::Write;

const QUANTITIES: [(Quantity, &str); 5] = [
    (Quantity::Total, "direct and reflected light (B, D)"),
    (Quantity::Indirect, "reflected light (B⁺, D⁺)"),
    (Quantity::Noisy, "reflected light, samples with 5 % noise"),
    (
        Quantity::SolvedTotal,
        "direct and reflected light, iterated in the basis",
    ),
    (
        Quantity::SolvedIndirect,
        "reflected light, iterated in the basis",
    ),
];

/// The paper's bases: as many samples, at the same points, as ours.
const PAPERS: [Basis; 5] = [
    Basis::Shepard,
    Basis::Gaussian,
    Basis::HalfGaussian,
    Basis::NarrowGaussian,
    Basis::Lehtinen,
];

impl Experiment {
    fn row(&self, basis: Basis, quantity: Quantity, spacing: f64) -> &ComparisonRow {
        let mut rows = self.rows.iter();
        rows.find(|r| r.basis == basis && r.quantity == quantity && r.spacing == spacing)
            .expect("every basis is measured everywhere")
    }

    /// Ours, and the best of the paper's bases by root mean square error.
    fn duel(&self, quantity: Quantity, sphere: bool, spacing: f64) -> (f64, Basis, f64) {
        let rmse = |basis| on(self.row(basis, quantity, spacing), sphere).rmse;
        let best = PAPERS.iter().copied();
        let best = best.min_by(|a, b| rmse(*a).total_cmp(&rmse(*b)));
        let best = best.unwrap_or(Basis::Lehtinen);
        (rmse(Basis::Ours), best, rmse(best))
    }
}

fn on(row: &ComparisonRow, sphere: bool) -> &SurfaceErrors {
    if sphere { &row.sphere } else { &row.disk }
}

fn surface(sphere: bool) -> &'static str {
    if sphere { "sphere" } else { "disk" }
}

/// A share in per cent, without the sign, with about three figures.
fn percent(share: f64) -> String {
    let v = 100.0 * share;
    // No minus before nothing.
    let v = if v.abs() < 0.005 { 0.0 } else { v };
    match v.abs() {
        a if a < 9.995 => format!("{v:.2}"),
        a if a < 99.95 => format!("{v:.1}"),
        a if a < 1e5 => format!("{v:.0}"),
        _ => format!("{v:.0e}"),
    }
}

pub fn text(made: &Experiment) -> Result<String, Box<dyn Error>> {
    let mut out = String::new();
    found(made, &mut out)?;
    others(made, &mut out)?;
    shown(&mut out)?;
    solution(made, &mut out)?;
    measured(made, &mut out)?;
    for (quantity, name) in QUANTITIES {
        table(made, quantity, name, &mut out)?;
    }
    Ok(out)
}

fn found(made: &Experiment, out: &mut String) -> Result<(), Box<dyn Error>> {
    let all: Vec<(Quantity, bool, f64)> = cells().collect();
    let won = all.iter().filter(|(q, s, r)| {
        let (ours, _, best) = made.duel(*q, *s, *r);
        ours <= best
    });
    let won = won.count();
    let ours = |q, sphere| on(made.row(Basis::Ours, q, SHOWN), sphere).rmse;
    let one = |q, sphere| on(made.row(Basis::Lehtinen, q, SHOWN), sphere).rmse;
    let (q, _) = QUANTITIES[1];
    writeln!(
        out,
        "# Bases for light: [V11]'s experiment, with its table\n\n\
         Made by `cargo run --release -p meshless_gi_lab --example v11 -- -o docs/reports --short`; without `--short` it also writes the curves of\n\
         every basis at every density. Do not edit.\n\n\
         ## What was found\n\n\
         With the same samples at the same points, **the plugin's basis has the least root mean square error in {won} of {} comparisons** with the bases that\n\
         [V11] compares: Shepard's, Gaussian radial functions in three widths, and one level of Lehtinen's. Reflected light at the paper's own density (points 3 m\n\
         apart): {} % on the sphere where Lehtinen's single level has {} %, {} % on the disk where it has {} %. Where it is not the best, and why, is\n\
         said below.\n",
        all.len(),
        percent(ours(q, true)),
        percent(one(q, true)),
        percent(ours(q, false)),
        percent(one(q, false)),
    )?;
    let mut head = String::from("| what is written down | on |");
    for spacing in SPACINGS {
        let points = made.row(Basis::Ours, q, spacing).points;
        write!(head, " {spacing} m, {points} points |")?;
    }
    writeln!(
        out,
        "Root mean square error in per cent of the light's root mean square: ours / the best of the paper's bases; the smaller one is bold.\n\n\
         {head}\n|---|---|{}",
        "---|".repeat(SPACINGS.len())
    )?;
    for (quantity, name) in QUANTITIES {
        for sphere in [true, false] {
            write!(out, "| {name} | {} |", surface(sphere))?;
            for spacing in SPACINGS {
                let (ours, basis, best) = made.duel(quantity, sphere, spacing);
                let (a, b) = (percent(ours), percent(best));
                let (a, b) = if ours <= best {
                    (format!("**{a}**"), b)
                } else {
                    (a, format!("**{b}**"))
                };
                write!(out, " {a} / {b} {} |", short(basis))?;
            }
            writeln!(out)?;
        }
    }
    writeln!(
        out,
        "\nS: Shepard. G, G/2, G/4: Gaussian with a standard deviation of one, a half, a quarter of the nominal radius. L: Lehtinen, one level.\n"
    )?;
    oscillation(made, out)
}

/// Visual results of \[V11\] at its own density.
fn oscillation(made: &Experiment, out: &mut String) -> Result<(), Box<dyn Error>> {
    writeln!(
        out,
        "Oscillation is what [V11] blames the other two bases for, by eye. At its density, as total variation along meridians and rays over that of the solution, less\n\
         100 %, and as what is left of the azimuth in a light that has none (unevenness), in per cent. Shepard's and the Gaussians' spikes show where the light is\n\
         even; at the shadow's edge what is flattened hides some of Shepard's:\n\n\
         | basis | reflected light, sphere | disk | all light, sphere | disk | unevenness of reflected light, sphere | disk |\n|---|---|---|---|---|---|---|"
    )?;
    for basis in Basis::ALL {
        let reflected = made.row(basis, Quantity::Indirect, SHOWN);
        let all = made.row(basis, Quantity::Total, SHOWN);
        let cells = [
            reflected.sphere.oscillation,
            reflected.disk.oscillation,
            all.sphere.oscillation,
            all.disk.oscillation,
            reflected.sphere.unevenness,
            reflected.disk.unevenness,
        ];
        let cells = cells.map(percent).join(" | ");
        writeln!(out, "| {} | {cells} |", basis.name())?;
    }
    writeln!(out)?;
    Ok(())
}

fn short(basis: Basis) -> &'static str {
    match basis {
        Basis::Shepard => "S",
        Basis::Gaussian => "G",
        Basis::HalfGaussian => "G/2",
        Basis::NarrowGaussian => "G/4",
        _ => "L",
    }
}

fn cells() -> impl Iterator<Item = (Quantity, bool, f64)> {
    QUANTITIES.into_iter().flat_map(|(q, _)| {
        let both = [true, false].into_iter();
        both.flat_map(move |sphere| SPACINGS.into_iter().map(move |r| (q, sphere, r)))
    })
}

/// Cases in which another basis is better, with the reason.
fn others(made: &Experiment, out: &mut String) -> Result<(), Box<dyn Error>> {
    let beaten = |of: &[Basis]| -> Vec<String> {
        let mut found = Vec::new();
        for (quantity, name) in QUANTITIES {
            for sphere in [true, false] {
                let at: Vec<String> = SPACINGS
                    .iter()
                    .filter(|&&r| {
                        let (ours, basis, best) = made.duel(quantity, sphere, r);
                        best < ours && of.contains(&basis)
                    })
                    .map(|r| format!("{r}"))
                    .collect();
                if !at.is_empty() {
                    let at = at.join(", ");
                    found.push(format!("{name} on the {} at {at} m", surface(sphere)));
                }
            }
        }
        found
    };
    let value = |basis, q, sphere| percent(on(made.row(basis, q, SHOWN), sphere).rmse);
    writeln!(out, "### Where another basis is better, and why\n")?;
    let gaussians = [Basis::Gaussian, Basis::HalfGaussian, Basis::NarrowGaussian];
    let lost = beaten(&gaussians);
    if !lost.is_empty() {
        writeln!(
            out,
            "- **Gaussian functions**: {}.\n  Light on the disk without the shadow's edge is as smooth as can be, and interpolation by wide Gaussians is of high order\n  \
             there, which no basis of non-negative functions that sum to one can be. The price, at 3 m: {} % (σ = α/2) and {} % (σ = α) on the sphere, {} % and\n  \
             {} % on the disk with the shadow's edge, and a noise of 5 % in the samples becomes {} % and {} % on the disk. They also need a dense system of equations\n  \
             solved for each light; ours need nothing solved.",
            lost.join("; "),
            value(Basis::HalfGaussian, Quantity::Indirect, true),
            value(Basis::Gaussian, Quantity::Indirect, true),
            value(Basis::HalfGaussian, Quantity::Total, false),
            value(Basis::Gaussian, Quantity::Total, false),
            value(Basis::HalfGaussian, Quantity::Noisy, false),
            value(Basis::Gaussian, Quantity::Noisy, false),
        )?;
    }
    let lost = beaten(&[Basis::Lehtinen]);
    if !lost.is_empty() {
        writeln!(
            out,
            "- **One level of Lehtinen's functions**: {}.\n  Its functions reach 2.5 spacings, ours the five nearest points, and count by the square of the weight. That\n  \
             blurs less, which wins at edges and where points are few, and averages less: with dense points what is left is unevenness, and the noise of the samples.",
            lost.join("; "),
        )?;
    }
    let lost = beaten(&[Basis::Shepard]);
    if !lost.is_empty() {
        writeln!(out, "- **Shepard's**: {}.", lost.join("; "))?;
    }
    let levels = |q, s| value(Basis::LehtinenLevels, q, s);
    let finest = SPACINGS[SPACINGS.len() - 1];
    let bias = |basis, r| percent(made.row(basis, Quantity::Indirect, r).sphere.bias);
    let second = |s| value(Basis::OursTwice, Quantity::Indirect, s);
    writeln!(
        out,
        "- **Three levels of Lehtinen's functions** are not in the count: their coarser points are up to a half more samples. They reach {} % on the sphere and {} % on\n  \
         the disk at 3 m (reflected light): the differences of the finer levels undo what the coarser ones blur.\n\
         - **Bias on the sphere**: ours is {} % at {} m and {} % at {finest} m (reflected light); Lehtinen's single level has {} % and {} %. A point's vector irradiance is what arrives over its own\n  \
         hemisphere; a place that faces elsewhere counts some of it from below its horizon, and misses what only it sees. With scalars instead of vectors the bias\n  \
         is {} % at 3 m, and the error {} % instead of {} %.\n\
         - **Largest error at the shadow's edge**: a smooth function is wrong there by half of the step at least. Ours is sharper than Lehtinen's, so that a place on the\n  \
         wrong side of its nearest point is wrong by nearly the whole step; the root mean square error is less. The plugin does not write direct light in its basis.\n\
         - **What would be better**: a second pass, which moves each point's value by what the field misses there, brings {} % on the sphere and {} % on the disk instead\n  \
         of {} % and {} % (reflected light, 3 m), and a bias of {} % on the sphere instead of {} %. With noisy samples it brings {} % and {} % instead of {} % and {} %. It is linear, so\n  \
         it could be baked into the operator's rows. The plugin does not have it.\n",
        levels(Quantity::Indirect, true),
        levels(Quantity::Indirect, false),
        bias(Basis::Ours, SHOWN),
        SHOWN,
        bias(Basis::Ours, finest),
        bias(Basis::Lehtinen, SHOWN),
        bias(Basis::Lehtinen, finest),
        bias(Basis::Flat, SHOWN),
        value(Basis::Flat, Quantity::Indirect, true),
        value(Basis::Ours, Quantity::Indirect, true),
        second(true),
        second(false),
        value(Basis::Ours, Quantity::Indirect, true),
        value(Basis::Ours, Quantity::Indirect, false),
        bias(Basis::OursTwice, SHOWN),
        bias(Basis::Ours, SHOWN),
        value(Basis::OursTwice, Quantity::Noisy, true),
        value(Basis::OursTwice, Quantity::Noisy, false),
        value(Basis::Ours, Quantity::Noisy, true),
        value(Basis::Ours, Quantity::Noisy, false),
    )?;
    Ok(())
}

fn shown(out: &mut String) -> Result<(), Box<dyn Error>> {
    writeln!(
        out,
        "## Charts\n\n\
         ![Error of reflected light on the sphere](v11/error_reflected_sphere.svg)\n\
         ![Error of reflected light on the disk](v11/error_reflected_disk.svg)\n\
         ![Error of reflected light on the disk with noise](v11/error_noisy_disk.svg)\n\
         ![Error of all light on the disk](v11/error_total_disk.svg)\n\n\
         The curves of [V11] Figures 11-13, all bases in one frame:\n\n\
         ![Reflected light of the sphere](v11/B_reflected_{SHOWN}.svg)\n\
         ![Reflected light of the disk](v11/D_reflected_{SHOWN}.svg)\n\
         ![Radiosity of the disk](v11/D_{SHOWN}.svg)\n\n\
         ## Pictures\n\n\
         The scene as each basis writes it down from samples at points 3 m apart: all light, with 0.9 W/m² white; and reflected light alone, with 0.6 W/m² white. The\n\
         light comes from straight above; direct light stands in the basis here, which the plugin never does. Where a basis says less than nothing it is black.\n\n\
         | basis | all light | reflected light |\n|---|---|---|\n\
         | solution | ![](v11/total_solution.png) | ![](v11/reflected_solution.png) |"
    )?;
    for basis in Basis::ALL {
        let (name, file) = (basis.name(), slug(basis));
        writeln!(
            out,
            "| {name} | ![](v11/total_{file}.png) | ![](v11/reflected_{file}.png) |"
        )?;
    }
    writeln!(out)?;
    Ok(())
}

/// The reference and its constants.
fn solution(made: &Experiment, out: &mut String) -> Result<(), Box<dyn Error>> {
    let scene = &made.solution.scene;
    writeln!(
        out,
        "## The solution that all is compared with\n\n\
         [V11] §VIII: a sphere of {} m with its center {} m over a disk of {} m, both with reflectance {}, under light of {} W/m² from straight above. B(ζ) and D(u)\n\
         solve two coupled integral equations (`crates/meshless_gi_lab/src/accuracy/sphere_over_disk.rs`), here with {} cells on each and the integral over the azimuth in closed form; the\n\
         iteration stands after {} steps. `tests/sphere_over_disk.rs` compares it with Monte Carlo at ten places, within noise, and shows that other constants\n\
         are noticed. The paper's form factor reads without its 1/π, and μ = 0.9 is inferred from the axes of its Figure 10: see the file's head.\n\n\
         Largest error of reflected light, in per cent of its largest value. [V11]'s own sums with n = 100 put a cell's middle on the shadow's edge:\n\n\
         | cells | [V11] Eqs. (22), (23): sphere | disk | ours: sphere | disk |\n|---|---|---|---|---|",
        scene.radius,
        scene.height,
        scene.disk,
        scene.albedo,
        scene.light,
        made.solution.latitudes.len(),
        made.solution.iterations,
    )?;
    for n in [100, 101, 200, 400] {
        let sums = scene.solve_sums(n)?.difference(&made.solution);
        let rings = scene.solve(n)?.difference(&made.solution);
        let cell = |v: f64| format!("{:.4}", 100.0 * v);
        writeln!(
            out,
            "| {n} | {} | {} | {} | {} |",
            cell(sums[0]),
            cell(sums[1]),
            cell(rings[0]),
            cell(rings[1])
        )?;
    }
    writeln!(out)?;
    Ok(())
}

fn measured(made: &Experiment, out: &mut String) -> Result<(), Box<dyn Error>> {
    let ridges = made.rows.iter().map(|r| r.ridge);
    let most = ridges.fold(0.0, f64::max);
    let ridge = if most == 0.0 {
        "none of these needed one".into()
    } else {
        format!("here at most {most:e}")
    };
    writeln!(
        out,
        "## What was measured\n\n\
         Points are Poisson disks of the project's own sampling over both surfaces ([L08] §2.3); the numbers are medians over five point sets. Places lie on a grid over\n\
         both surfaces, and errors count by area. All numbers are per cent.\n\n\
         - **RMSE**, **max**: of the light's root mean square on that surface. **bias**: mean error over the mean.\n\
         - **osc.**: total variation along meridians (sphere) or rays (disk), in the mean over the azimuths, over that of the solution, less 100 %. Below zero an edge or a\n  \
         top is flattened. [V11] speaks of oscillation and defines none.\n\
         - **uneven**: root mean square of what differs from the mean over all azimuths; the solution has none. [V11] Figures 11-13 show it as a red line beside a black one.\n\n\
         The bases: *Shepard 1/d²* ([V11] Eq. (16)), over all points. *Gaussian RBF* ([V11] Eq. (17)), with coefficients that pass through the samples, found by LU; α is\n\
         the site distance to the tenth nearest point. The paper's text says that the distance is divided by α (§VI), σ = α, and that functions are nearly zero at α (§V), σ = α/4; which it used we cannot tell. Both\n\
         use the normal-sensitive distance |p − q| / cos ([V11] Eq. (15)), which is no metric, so that the Gaussian systems need not be positive. Where one is\n\
         singular as far as rounding tells, a ridge is added to its diagonal of ones: {ridge}. *Lehtinen* ([L08] Eqs. (1)-(10)): the\n\
         project's own levels, the finest with radius 2.5 spacings. *Ours*: the flat display basis (`crates/meshless_gi/src/basis/flat.rs`, `crates/meshless_gi/src/frame/splat.rs`) with a vector irradiance at each\n\
         point, as the plugin shows it; *scalars* without vectors; *second pass*: see above.\n\n\
         *Iterated in the basis* ([V11] §VII): λ ← ε + Rλ, with the direct light in the basis and R's integrals taken by quadrature instead of [V11]'s point lights. Ours\n\
         iterates with scalars, as the plugin's senders do.\n"
    )?;
    Ok(())
}

fn table(
    made: &Experiment,
    quantity: Quantity,
    name: &str,
    out: &mut String,
) -> Result<(), Box<dyn Error>> {
    let surface = "RMSE | max | osc. | uneven | bias";
    writeln!(
        out,
        "### {}{}\n\n| spacing | samples | basis | sphere: {surface} | disk: {surface} |\n|{}",
        name[..1].to_uppercase(),
        &name[1..],
        "---|".repeat(13)
    )?;
    for spacing in SPACINGS {
        for basis in Basis::ALL {
            let row = made.row(basis, quantity, spacing);
            write!(out, "| {spacing} m | {} | {} |", row.points, basis.name())?;
            for e in [&row.sphere, &row.disk] {
                for v in [e.rmse, e.largest, e.oscillation, e.unevenness, e.bias] {
                    write!(out, " {} |", percent(v))?;
                }
            }
            writeln!(out)?;
        }
    }
    writeln!(out)?;
    let missing = made.rows.iter().filter(|r| r.quantity == quantity);
    let missing = missing.filter(|r| r.sphere.uncovered + r.disk.uncovered > 0.0);
    if missing.count() == 0 {
        writeln!(out, "Every basis covered every place.\n")?;
    } else {
        writeln!(out, "Places that a basis did not cover count as dark.\n")?;
    }
    Ok(())
}
