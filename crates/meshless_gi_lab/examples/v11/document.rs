//! Document: results, tables, charts and pictures.

use super::{Experiment, SHOWN_SPACING, SPACINGS, slug};
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

/// Bases of [V11], with as many samples at the same points as ours.
const PAPER_BASES: [Basis; 5] = [
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

    /// Returns the RMSE of our basis, the best basis of [V11] by RMSE, and its RMSE.
    fn best_of_paper(&self, quantity: Quantity, sphere: bool, spacing: f64) -> (f64, Basis, f64) {
        let rmse = |basis| on(self.row(basis, quantity, spacing), sphere).rmse;
        let best = PAPER_BASES.iter().copied();
        let best = best.min_by(|a, b| rmse(*a).total_cmp(&rmse(*b)));
        let best = best.unwrap_or(Basis::Lehtinen);
        (rmse(Basis::FlatVector), best, rmse(best))
    }
}

fn on(row: &ComparisonRow, sphere: bool) -> &SurfaceErrors {
    if sphere { &row.sphere } else { &row.disk }
}

fn surface(sphere: bool) -> &'static str {
    if sphere { "sphere" } else { "disk" }
}

/// Formats a fraction in percent, without the sign, with about three figures.
fn percent(share: f64) -> String {
    let v = 100.0 * share;
    // No minus sign before zero.
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
    write_exceptions(made, &mut out)?;
    write_charts(&mut out)?;
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
        let (ours, _, best) = made.best_of_paper(*q, *s, *r);
        ours <= best
    });
    let won = won.count();
    let ours = |q, sphere| on(made.row(Basis::FlatVector, q, SHOWN_SPACING), sphere).rmse;
    let one = |q, sphere| on(made.row(Basis::Lehtinen, q, SHOWN_SPACING), sphere).rmse;
    let (q, _) = QUANTITIES[1];
    writeln!(
        out,
        "# Bases for light: the experiment of [V11]\n\n\
         Made by `cargo run --release -p meshless_gi_lab --example v11 -- -o docs/reports --short`. Without `--short` it also writes the curves of every basis at every density. Do not edit.\n\n\
         ## Results\n\n\
         With the same samples at the same points, **the basis of this project has the smallest root mean square error in {won} of {} comparisons** with the bases of [V11].\n\
         These are Shepard's, Gaussian radial functions of three widths, and one level of Lehtinen's.\n\
         Reflected light at the density of [V11] (points 3 m apart): {} % on the sphere where Lehtinen's single level has {} %, {} % on the disk where it has {} %.\n",
        all.len(),
        percent(ours(q, true)),
        percent(one(q, true)),
        percent(ours(q, false)),
        percent(one(q, false)),
    )?;
    let mut head = String::from("| light | on |");
    for spacing in SPACINGS {
        let points = made.row(Basis::FlatVector, q, spacing).points;
        write!(head, " {spacing} m, {points} points |")?;
    }
    writeln!(
        out,
        "Root mean square error in percent of the root mean square of the light: this project / the best basis of [V11]. The smaller one is bold.\n\n\
         {head}\n\
         |---|---|{}",
        "---|".repeat(SPACINGS.len())
    )?;
    for (quantity, name) in QUANTITIES {
        for sphere in [true, false] {
            write!(out, "| {name} | {} |", surface(sphere))?;
            for spacing in SPACINGS {
                let (ours, basis, best) = made.best_of_paper(quantity, sphere, spacing);
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

/// Writes the visual results of \[V11\] at its own density.
fn oscillation(made: &Experiment, out: &mut String) -> Result<(), Box<dyn Error>> {
    writeln!(
        out,
        "[V11] criticizes oscillation of the other two bases by eye. The table measures it at the density of [V11], in percent:\n\n\
         - total variation along meridians and rays relative to the solution, less 100 %,\n\
         - unevenness: variation over the azimuth, which is zero in the solution.\n\n\
         The spikes of Shepard's basis and of the Gaussians are visible in even light. At the edge of the shadow, flattening hides some of Shepard's.\n\n\
         | basis | reflected light, sphere | disk | all light, sphere | disk | unevenness of reflected light, sphere | disk |\n\
         |---|---|---|---|---|---|---|"
    )?;
    for basis in Basis::ALL {
        let reflected = made.row(basis, Quantity::Indirect, SHOWN_SPACING);
        let all = made.row(basis, Quantity::Total, SHOWN_SPACING);
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

/// Writes the cases in which another basis is better, with the reason.
fn write_exceptions(made: &Experiment, out: &mut String) -> Result<(), Box<dyn Error>> {
    let beaten = |of: &[Basis]| -> Vec<String> {
        let mut found = Vec::new();
        for (quantity, name) in QUANTITIES {
            for sphere in [true, false] {
                let at: Vec<String> = SPACINGS
                    .iter()
                    .filter(|&&r| {
                        let (ours, basis, best) = made.best_of_paper(quantity, sphere, r);
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
    let value = |basis, q, sphere| percent(on(made.row(basis, q, SHOWN_SPACING), sphere).rmse);
    writeln!(out, "### Cases in which another basis is better\n")?;
    let gaussians = [Basis::Gaussian, Basis::HalfGaussian, Basis::NarrowGaussian];
    let lost = beaten(&gaussians);
    if !lost.is_empty() {
        writeln!(
            out,
            "- **Gaussian functions**: {}.\n\
             \x20 Light on the disk without the edge of the shadow is smooth, and wide Gaussians interpolate it with high order. No non-negative basis that sums to one can.\n\
             \x20 Their error at 3 m is {} % (σ = α/2) and {} % (σ = α) on the sphere, {} % and {} % on the disk with the edge of the shadow.\n\
             \x20 Noise of 5 % in the samples becomes {} % and {} % on the disk.\n\
             \x20 They require a dense system of equations for each light. The basis of this project requires none.",
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
            "- **One level of Lehtinen's functions**: {}.\n\
             \x20 Its functions reach 2.5 spacings. Those of this project reach the five nearest points and use the square of the weight.\n\
             \x20 They blur less, which is better at edges and with few points, and average less: with dense points unevenness and noise of the samples remain.",
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
    let second = |s| value(Basis::CorrectedFlatVector, Quantity::Indirect, s);
    writeln!(
        out,
        "- **Three levels of Lehtinen's functions** are not in the count, because their coarser points are up to 50 % more samples.\n\
         \x20 They reach {} % on the sphere and {} % on the disk at 3 m (reflected light): differences of the finer levels correct the blur of the coarser ones.\n\
         - **Bias on the sphere**: {} % at {} m and {} % at {finest} m (reflected light). Lehtinen's single level has {} % and {} %.\n\
         \x20 The vector irradiance of a point covers the hemisphere of that point.\n\
         \x20 A position with another normal counts light from below its horizon, and misses light that only it receives.\n\
         \x20 With scalars instead of vectors the bias is {} % at 3 m, and the error {} % instead of {} %.\n\
         - **Largest error at the edge of the shadow**: every smooth function has an error of half the step there.\n\
         \x20 This basis is sharper than Lehtinen's, so that a position on the wrong side of its nearest point has nearly the whole step as error. The root mean square error is smaller.\n\
         \x20 The plugin does not represent direct light in its basis.\n\
         - **Possible improvement**: a second pass corrects the value of each point by the error of the field there.\n\
         \x20 It has {} % on the sphere and {} % on the disk instead of {} % and {} % (reflected light, 3 m), and a bias of {} % on the sphere instead of {} %.\n\
         \x20 With noisy samples it has {} % and {} % instead of {} % and {} %.\n\
         \x20 It is linear, so it could be baked into the rows of the operator. It is not implemented in the plugin.\n",
        levels(Quantity::Indirect, true),
        levels(Quantity::Indirect, false),
        bias(Basis::FlatVector, SHOWN_SPACING),
        SHOWN_SPACING,
        bias(Basis::FlatVector, finest),
        bias(Basis::Lehtinen, SHOWN_SPACING),
        bias(Basis::Lehtinen, finest),
        bias(Basis::Flat, SHOWN_SPACING),
        value(Basis::Flat, Quantity::Indirect, true),
        value(Basis::FlatVector, Quantity::Indirect, true),
        second(true),
        second(false),
        value(Basis::FlatVector, Quantity::Indirect, true),
        value(Basis::FlatVector, Quantity::Indirect, false),
        bias(Basis::CorrectedFlatVector, SHOWN_SPACING),
        bias(Basis::FlatVector, SHOWN_SPACING),
        value(Basis::CorrectedFlatVector, Quantity::Noisy, true),
        value(Basis::CorrectedFlatVector, Quantity::Noisy, false),
        value(Basis::FlatVector, Quantity::Noisy, true),
        value(Basis::FlatVector, Quantity::Noisy, false),
    )?;
    Ok(())
}

fn write_charts(out: &mut String) -> Result<(), Box<dyn Error>> {
    writeln!(
        out,
        "## Charts\n\n\
         ![Error of reflected light on the sphere](v11/error_reflected_sphere.svg)\n\
         ![Error of reflected light on the disk](v11/error_reflected_disk.svg)\n\
         ![Error of reflected light on the disk with noise](v11/error_noisy_disk.svg)\n\
         ![Error of all light on the disk](v11/error_total_disk.svg)\n\n\
         The curves of [V11] Figures 11-13, all bases in one chart:\n\n\
         ![Reflected light of the sphere](v11/B_reflected_{SHOWN_SPACING}.svg)\n\
         ![Reflected light of the disk](v11/D_reflected_{SHOWN_SPACING}.svg)\n\
         ![Radiosity of the disk](v11/D_{SHOWN_SPACING}.svg)\n\n\
         ## Pictures\n\n\
         The scene in each basis, from samples at points 3 m apart: all light (0.9 W/m² is white) and reflected light alone (0.6 W/m² is white).\n\
         The light comes from straight above. Direct light is represented in the basis here, unlike in the plugin. Negative values are black.\n\n\
         | basis | all light | reflected light |\n\
         |---|---|---|\n\
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

/// Writes the reference and its constants.
fn solution(made: &Experiment, out: &mut String) -> Result<(), Box<dyn Error>> {
    let scene = &made.solution.scene;
    writeln!(
        out,
        "## Reference solution\n\n\
         [V11] §VIII: a sphere of {} m with its center {} m above a disk of {} m, both with reflectance {}, under light of {} W/m² from straight above.\n\
         B(ζ) and D(u) solve two coupled integral equations (`crates/meshless_gi_lab/src/accuracy/sphere_over_disk.rs`).\n\
         The solution has {} cells on each and the integral over the azimuth in closed form. The iteration converges in {} steps.\n\
         `tests/sphere_over_disk.rs` compares it with Monte Carlo at ten points, within noise, and shows that other constants fail.\n\
         The form factor in [V11] lacks its 1/π, and μ = 0.9 is inferred from the axes of its Figure 10: see the head of the file.\n\n\
         Largest error of reflected light, in percent of its largest value. With n = 100 the sums of [V11] have the center of a cell on the edge of the shadow:\n\n\
         | cells | [V11] Eqs. (22), (23): sphere | disk | this project: sphere | disk |\n\
         |---|---|---|---|---|",
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
    let max = ridges.fold(0.0, f64::max);
    let ridge = if max == 0.0 {
        "not needed here".into()
    } else {
        format!("here at most {max:e}")
    };
    writeln!(
        out,
        "## Method of measurement\n\n\
         Points are Poisson disks over both surfaces ([L08] §2.3). The figures are medians over five point sets, in percent.\n\
         Errors are evaluated on a grid over both surfaces and weighted by area.\n\n\
         - **RMSE**, **max**: relative to the root mean square of the light on that surface. **bias**: mean error over the mean.\n\
         - **osc.**: total variation along meridians (sphere) or rays (disk), averaged over the azimuth, relative to the solution, less 100 %. Negative values mean flattened edges or peaks. [V11] does not define oscillation.\n\
         - **uneven**: root mean square of the difference from the mean over all azimuths, zero in the solution. [V11] Figures 11-13 show it as a red line next to a black one.\n\n\
         The bases:\n\n\
         - *Shepard 1/d²* ([V11] Eq. (16)), over all points.\n\
         - *Gaussian RBF* ([V11] Eq. (17)), with coefficients that interpolate the samples, by LU decomposition. α is the distance of a point to its tenth nearest point.\n\
         \x20 [V11] divides the distance by α in §VI, σ = α, and has functions that are nearly zero at α in §V, σ = α/4. Which one it used is unclear.\n\
         - Both use the normal-sensitive distance |p − q| / cos ([V11] Eq. (15)). It is no metric, so the Gaussian systems need not be positive.\n\
         \x20 If one is singular within rounding, a ridge is added to its diagonal of ones: {ridge}.\n\
         - *Lehtinen* ([L08] Eqs. (1)-(10)): the levels of this project, the finest with radius 2.5 spacings.\n\
         - *Ours*: the flat display basis (`crates/meshless_gi/src/basis/flat.rs`, `crates/meshless_gi/src/frame/splat.rs`) with a vector irradiance at each point, as in the plugin. *Scalars* is without vectors, *second pass* as above.\n\n\
         *Iterated in the basis* ([V11] §VII): λ ← ε + Rλ, with the direct light in the basis and the integrals of R by quadrature instead of the point lights of [V11].\n\
         *Ours* iterates with scalars, like the senders of the plugin.\n"
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
        writeln!(out, "All bases cover all positions.\n")?;
    } else {
        writeln!(
            out,
            "Positions that a basis does not cover count as dark.\n"
        )?;
    }
    Ok(())
}
