//! The document: tables, charts, and what they say.

use super::{Found, POINTS, RECEIVERS, ROUNDS, Size};
use meshless_gi::internals::transport::fmm::FmmSettings;
use meshless_gi_lab::accuracy::{Axis, Chart, Format, Series, Style};
use std::error::Error;
use std::fmt::Write;

/// Slope of the logarithm of `y` over that of `x`, by least squares.
fn exponent(points: &[(f64, f64)]) -> f64 {
    let n = points.len() as f64;
    let logs: Vec<_> = points.iter().map(|(x, y)| (x.ln(), y.ln())).collect();
    let mean = |f: fn(&(f64, f64)) -> f64| logs.iter().map(f).sum::<f64>() / n;
    let (mx, my) = (mean(|l| l.0), mean(|l| l.1));
    let above: f64 = logs.iter().map(|l| (l.0 - mx) * (l.1 - my)).sum();
    let below: f64 = logs.iter().map(|l| (l.0 - mx).powi(2)).sum();
    above / below
}

impl Size {
    /// Seconds of one pass up and down.
    fn pass(&self) -> f64 {
        self.seconds[2] + self.seconds[3]
    }

    /// With tree and lists.
    fn whole(&self) -> f64 {
        self.seconds.iter().sum()
    }
}

/// From where on `ours` stays below the sum over all pairs, between two measured sizes by their
/// logarithms; the first size where it never is above.
fn overtakes(sizes: &[Size], ours: impl Fn(&Size) -> f64) -> Option<f64> {
    let gap = |s: &Size| (ours(s) / s.direct).ln();
    let Some(last) = sizes.iter().rposition(|s| gap(s) > 0.0) else {
        return sizes.first().map(|s| s.points as f64);
    };
    let [a, b] = [&sizes[last], sizes.get(last + 1)?];
    let t = gap(a) / (gap(a) - gap(b));
    let (la, lb) = ((a.points as f64).ln(), (b.points as f64).ln());
    Some((la + t * (lb - la)).exp())
}

fn of(sizes: &[Size], value: impl Fn(&Size) -> f64) -> Vec<(f64, f64)> {
    sizes.iter().map(|s| (s.points as f64, value(s))).collect()
}

/// All charts, with the names of their files.
pub fn charts(found: &Found) -> Vec<(&'static str, Chart)> {
    let separation = f64::from(FmmSettings::default().separation);
    let orders = |value: &dyn Fn(&super::Order) -> f64| -> Vec<(f64, f64)> {
        found
            .orders
            .iter()
            .map(|o| (o.order as f64, value(o)))
            .collect()
    };
    let first = found.orders[0].error;
    let rate = |o: &super::Order| first * separation.powi(o.order as i32);
    let sizes = &found.sizes;
    vec![
        (
            "order.svg",
            Chart {
                title: "Error by order".into(),
                caption: format!("{POINTS} points, no visibility, against the sum over all pairs"),
                x: Axis::linear("order n", Format::Number),
                y: Axis::log("error", Format::Number),
                series: vec![
                    Series::new(
                        "irradiance, NRMSE",
                        Style::LineAndPoints,
                        orders(&|o| o.error),
                    ),
                    Series::new("separationⁿ", Style::Line, orders(&rate)),
                    Series::new(
                        "[G08] Eq. (5) at 0.4, median",
                        Style::LineAndPoints,
                        orders(&|o| o.series),
                    ),
                ],
                guides: Vec::new(),
            },
        ),
        (
            "time.svg",
            Chart {
                title: "Time by number of points".into(),
                caption: "Order 4, no visibility, all three colors, one bounce".into(),
                x: Axis::log("points", Format::Si),
                y: Axis::log("seconds", Format::Number),
                series: vec![
                    Series::new("all pairs", Style::LineAndPoints, of(sizes, |s| s.direct)),
                    Series::new("up and down", Style::LineAndPoints, of(sizes, Size::pass)),
                    Series::new(
                        "with tree and lists",
                        Style::LineAndPoints,
                        of(sizes, Size::whole),
                    ),
                ],
                guides: Vec::new(),
            },
        ),
        (
            "passes.svg",
            Chart {
                title: "Upward and downward pass".into(),
                caption: "As [G08] Figs. 10 and 11; both on the CPU".into(),
                x: Axis::log("points", Format::Si),
                y: Axis::log("seconds", Format::Number),
                series: vec![
                    Series::new("upward", Style::LineAndPoints, of(sizes, |s| s.seconds[2])),
                    Series::new(
                        "downward",
                        Style::LineAndPoints,
                        of(sizes, |s| s.seconds[3]),
                    ),
                ],
                guides: Vec::new(),
            },
        ),
    ]
}

fn percent(v: f64) -> String {
    format!("{:.2} %", 100.0 * v)
}

/// Seconds, with digits enough for microseconds.
fn seconds(v: f64) -> String {
    match v < 0.01 {
        true => format!("{v:.6}"),
        false => format!("{v:.3}"),
    }
}

/// Exponents are fitted from so many points on.
const MIN_FITTED: usize = 900;

/// The document.
pub fn text(found: &Found) -> Result<String, Box<dyn Error>> {
    let mut out = String::new();
    let w = &mut out;
    let sizes = &found.sizes;
    // Below a thousand points leaves and threads decide, not the method.
    let fitted = &sizes[sizes.partition_point(|s| s.points < MIN_FITTED)..];
    let pass = exponent(&of(fitted, Size::pass));
    let whole = exponent(&of(fitted, Size::whole));
    writeln!(
        w,
        "# Light between points: the fast multipole method, measured\n\n\
         Made by `cargo run --release -p meshless_gi_lab --example fmm -- -o docs/reports` on {} threads. Do not edit.\n\n\
         The method is [G08]'s (`crates/meshless_gi/src/transport/fmm/`), in double precision, with results in single precision; what is compared here is one implementation with itself and with the sum over all pairs.\n\
         What a bake by rule `fmm` makes of it, beside links, and which to use when: [FMM_RULE.md](FMM_RULE.md). On a device: [MEASUREMENTS.md](MEASUREMENTS.md#fast-multipole-method-on-a-device).\n\n\
         ## Error by order\n\n\
         The Cornell box and a ball, turned so that nothing lies along an axis: {POINTS} points of uneven radiosity, everything sees everything that it faces. NRMSE of the irradiance at\n\
         {RECEIVERS} of them, against the sum over all pairs with [G08] Eq. (4) as it stands. No slack: pairs that look away from each other are left out exactly.\n\
         Nodes meet where their radii are at most {} of their distance, so that theory promises a factor of {} an order for the worst pair. Beside it the median error of [G08] Eq. (5)\n\
         alone at r_y / r_x = 0.4. The paper stops after \"two terms\"; taken as n ≤ 1 or as n ≤ 2 they stand in the table.\n\n\
         | order | NRMSE | one pass, s | Eq. (5) up to n |\n|---|---|---|---|",
        rayon::current_num_threads(),
        FmmSettings::default().separation,
        FmmSettings::default().separation,
    )?;
    for o in &found.orders {
        writeln!(
            w,
            "| {} | {:.1e} | {:.2} | {:.1e} |",
            o.order, o.error, o.pass, o.series
        )?;
    }
    writeln!(w, "\n![Error by order](fmm/order.svg)\n\n## Time\n")?;
    writeln!(
        w,
        "Order {}, {} points a leaf at most, one bounce, red, green and blue together. The sum over all pairs is timed at {RECEIVERS} receivers at most and scaled. Errors are at the same receivers, with sources\n\
         near by as disks in both. Of {ROUNDS} rounds over all numbers the fastest counts, part by part.\n\n\
         | points | nodes | pairs of points in the near list | tree, s | lists, s | up, s | down, s | all pairs, s | NRMSE |\n|---|---|---|---|---|---|---|---|---|",
        FmmSettings::default().order,
        FmmSettings::default().leaf,
    )?;
    for s in sizes {
        let [tree, lists, up, down] = s.seconds.map(seconds);
        writeln!(
            w,
            "| {} | {} | {} | {tree} | {lists} | {up} | {down} | {} | {:.1e} |",
            s.points,
            s.nodes,
            s.point_pairs,
            seconds(s.direct),
            s.error
        )?;
    }
    let least = sizes.first().map(|s| s.points as f64);
    let said = |n: Option<f64>| match n {
        None => "nowhere".into(),
        Some(n) if Some(n) == least => format!("{n:.0} points or fewer"),
        Some(n) => format!("{n:.0} points"),
    };
    let (from, to) = (fitted.first(), sizes.last());
    let (lower, upper) = fitted.split_at(fitted.len() / 2);
    writeln!(
        w,
        "\nFitted from {} to {} points: **time of a pass ~ N^{pass:.2}**, with tree and lists N^{whole:.2}; all pairs N^{:.2}. The lower half of these sizes alone grows as N^{:.2}, the upper half, in\n\
         which leaves of the ball become flat enough for the slack, as N^{:.2}; without the last two octaves a pass grows as N^{:.2}. A pass takes less than the sum over all pairs from {} on, with tree and lists from {}.\n\n\
         ![Time by number of points](fmm/time.svg)\n\n\
         At the largest size the upward pass takes {} of both ([G08] §3.1.6: less than 1 % beside its downward pass).\n\n\
         ![Upward and downward pass](fmm/passes.svg)\n\n## Points that look away from each other\n",
        from.map_or(0, |s| s.points),
        to.map_or(0, |s| s.points),
        exponent(&of(fitted, |s| s.direct)),
        exponent(&of(lower, Size::pass)),
        exponent(&of(upper, Size::pass)),
        exponent(&of(&fitted[..fitted.len().saturating_sub(4)], Size::pass)),
        said(overtakes(sizes, Size::pass)),
        said(overtakes(sizes, Size::whole)),
        percent(to.map_or(0.0, |s| s.seconds[2] / s.pass())),
    )?;
    writeln!(
        w,
        "The kernel's max(0, ·) has no expansion. Nodes meet by expansions where all their points face each other, are dropped where none do, and are divided else. A slack lets\n\
         nodes meet whose points look away by a small cosine. 1 means no care at all, as in [G08], but for what the lists drop. The room of the errors by order, order 6.\n\n\
         | slack | NRMSE | pairs of points in the near list | mixed pairs of nodes | down, s |\n|---|---|---|---|---|"
    )?;
    for s in &found.slacks {
        writeln!(
            w,
            "| {} | {:.1e} | {} | {} | {:.2} |",
            s.slack, s.error, s.counts.point_pairs, s.counts.mixed, s.down
        )?;
    }
    writeln!(
        w,
        "\n## Visibility\n\n\
         The Cornell box as points, a light below its ceiling, all bounces; rays between nodes decide at the bake what they see of each other. Against the reference integrator at some 400 places, reflected light alone. Its rays, and those between nodes, meet the box's walls;\n\
         docs/reports/FMM_RULE.md has the room whose geometry is the points' own cells.\n\n\
         | points | what | NRMSE | bias | bounces | lists and rays, s | all bounces, s | rays | parts |\n|---|---|---|---|---|---|---|---|---|"
    )?;
    for s in &found.seen {
        // A kernel without bound: more light comes back than went out.
        let (nrmse, bias) = match s.errors.nrmse > 1.0 {
            true => ("above 100 %".into(), "".into()),
            false => (percent(s.errors.nrmse), percent(s.errors.bias)),
        };
        writeln!(
            w,
            "| {} | {}, {} a leaf | {nrmse} | {bias} | {} | {:.2} | {:.2} | {} | {} |",
            s.points,
            s.name,
            s.leaf,
            s.bounces,
            s.seconds[0],
            s.seconds[1],
            s.counts.rays,
            s.counts.partial,
        )?;
    }
    writeln!(
        w,
        "\nParts: pairs of nodes in the lists that see each other in part. PoissonSamples in place of points keep pairs that nearly touch from outshining everything: with [G08] Eq. (4) as it stands two points of neighboring walls may\n\
         send each other more light than they have, and bounces grow without end. PoissonSamples lose some light along edges instead: the bias, which falls as points are denser."
    )?;
    Ok(out)
}
