//! Document: tables, charts and conclusions.

use super::{FmmResults, POINTS, RECEIVERS, ROUNDS, Size};
use meshless_gi::internals::transport::fmm::FmmSettings;
use meshless_gi_lab::accuracy::{Axis, Chart, Format, Series, Style};
use std::error::Error;
use std::fmt::Write;

/// Returns the slope of the logarithm of `y` over that of `x`, by least squares.
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
    /// Returns the seconds of one pass up and down.
    fn pass_seconds(&self) -> f64 {
        self.seconds[2] + self.seconds[3]
    }

    /// Returns the seconds of a pass with tree and lists.
    fn total_seconds(&self) -> f64 {
        self.seconds.iter().sum()
    }
}

/// Returns the number of points above which `ours` stays below the sum over all pairs. The
/// logarithms of two measured sizes are interpolated. Returns the first size if `ours` is never
/// above.
fn crossover(sizes: &[Size], ours: impl Fn(&Size) -> f64) -> Option<f64> {
    let gap = |s: &Size| (ours(s) / s.direct).ln();
    let Some(last) = sizes.iter().rposition(|s| gap(s) > 0.0) else {
        return sizes.first().map(|s| s.points as f64);
    };
    let [a, b] = [&sizes[last], sizes.get(last + 1)?];
    let t = gap(a) / (gap(a) - gap(b));
    let (la, lb) = ((a.points as f64).ln(), (b.points as f64).ln());
    Some((la + t * (lb - la)).exp())
}

fn points(sizes: &[Size], value: impl Fn(&Size) -> f64) -> Vec<(f64, f64)> {
    sizes.iter().map(|s| (s.points as f64, value(s))).collect()
}

/// Returns all charts with the names of their files.
pub fn charts(found: &FmmResults) -> Vec<(&'static str, Chart)> {
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
                    Series::new(
                        "all pairs",
                        Style::LineAndPoints,
                        points(sizes, |s| s.direct),
                    ),
                    Series::new(
                        "up and down",
                        Style::LineAndPoints,
                        points(sizes, Size::pass_seconds),
                    ),
                    Series::new(
                        "with tree and lists",
                        Style::LineAndPoints,
                        points(sizes, Size::total_seconds),
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
                    Series::new(
                        "upward",
                        Style::LineAndPoints,
                        points(sizes, |s| s.seconds[2]),
                    ),
                    Series::new(
                        "downward",
                        Style::LineAndPoints,
                        points(sizes, |s| s.seconds[3]),
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

/// Formats seconds, with enough digits for microseconds.
fn seconds(v: f64) -> String {
    match v < 0.01 {
        true => format!("{v:.6}"),
        false => format!("{v:.3}"),
    }
}

/// Minimum number of points for the fit of exponents.
const MIN_FITTED: usize = 900;

/// Returns the document.
pub fn text(found: &FmmResults) -> Result<String, Box<dyn Error>> {
    let mut out = String::new();
    let w = &mut out;
    let sizes = &found.sizes;
    // Below a thousand points leaves and threads determine the time, not the method.
    let fitted = &sizes[sizes.partition_point(|s| s.points < MIN_FITTED)..];
    let pass = exponent(&points(fitted, Size::pass_seconds));
    let whole = exponent(&points(fitted, Size::total_seconds));
    writeln!(
        w,
        "# Fast multipole method\n\n\
         Made by `cargo run --release -p meshless_gi_lab --example fmm -- -o docs/reports` on {} threads. Do not edit.\n\n\
         The method of [G08] (`crates/meshless_gi/src/transport/fmm/`) computes in double precision and returns single precision.\n\
         The first part compares it with itself and with the sum over all pairs, the second part compares bakes by the method `fmm` with bakes by links.\n\
         The kernels on a device: [measurements.md](measurements.md#fast-multipole-method-on-a-device).\n\n\
         ## Error by order\n\n\
         Scene: the Cornell box and a ball, rotated against the axes, {POINTS} points of varying radiosity, no visibility.\n\
         Error: NRMSE of the irradiance at {RECEIVERS} points against the sum over all pairs with [G08] Eq. (4).\n\
         The slack is 0, so pairs that face away from each other are excluded exactly.\n\
         Nodes interact if their radii are at most {} of their distance. The theoretical factor per order is {} for the worst pair.\n\
         The last column is the median error of the series [G08] Eq. (5) alone at r_y / r_x = 0.4.\n\
         [G08] uses \"two terms\". Both readings, n ≤ 1 and n ≤ 2, are in the table.\n\n\
         | order | NRMSE | one pass, s | Eq. (5) up to n |\n\
         |---|---|---|---|",
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
        "Order {}, at most {} points per leaf, one bounce, three color channels.\n\
         The sum over all pairs is timed for at most {RECEIVERS} receivers and scaled. The error is that of these receivers.\n\
         Sources in the near list are disks in both. Each time is the minimum of {ROUNDS} rounds over all sizes.\n\n\
         | points | nodes | pairs of points in the near list | tree, s | lists, s | up, s | down, s | all pairs, s | NRMSE |\n\
         |---|---|---|---|---|---|---|---|---|",
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
    let min = sizes.first().map(|s| s.points as f64);
    let said = |n: Option<f64>| match n {
        None => "nowhere".into(),
        Some(n) if Some(n) == min => format!("{n:.0} points or fewer"),
        Some(n) => format!("{n:.0} points"),
    };
    let (from, to) = (fitted.first(), sizes.last());
    let (lower, upper) = fitted.split_at(fitted.len() / 2);
    writeln!(
        w,
        "\nFitted from {} to {} points: **time of a pass ~ N^{pass:.2}**, with tree and lists N^{whole:.2}, all pairs N^{:.2}.\n\
         The lower half of these sizes alone grows as N^{:.2}.\n\
         The upper half grows as N^{:.2}: leaves of the ball are flat enough for the slack.\n\
         Without the last two octaves a pass grows as N^{:.2}.\n\
         A pass is faster than the sum over all pairs from {} on, with tree and lists from {}.\n\n\
         ![Time by number of points](fmm/time.svg)\n\n\
         At the largest size the upward pass takes {} of both ([G08] §3.1.6: less than 1 %).\n\n\
         ![Upward and downward pass](fmm/passes.svg)\n\n\
         ## Points that face away from each other\n",
        from.map_or(0, |s| s.points),
        to.map_or(0, |s| s.points),
        exponent(&points(fitted, |s| s.direct)),
        exponent(&points(lower, Size::pass_seconds)),
        exponent(&points(upper, Size::pass_seconds)),
        exponent(&points(
            &fitted[..fitted.len().saturating_sub(4)],
            Size::pass_seconds
        )),
        said(crossover(sizes, Size::pass_seconds)),
        said(crossover(sizes, Size::total_seconds)),
        percent(to.map_or(0.0, |s| s.seconds[2] / s.pass_seconds())),
    )?;
    writeln!(
        w,
        "The clamped cosine max(0, ·) of the kernel has no expansion.\n\
         Nodes interact by expansions if all their points face each other, are excluded if none do, and are divided otherwise.\n\
         A slack is the cosine by which points of interacting nodes may face away from each other. Slack 1 is the method of [G08].\n\
         The scene is that of the errors by order, the order is 6.\n\n\
         | slack | NRMSE | pairs of points in the near list | mixed pairs of nodes | down, s |\n\
         |---|---|---|---|---|"
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
         Scene: the Cornell box as points, a light below its ceiling, all bounces. Rays between nodes determine the visibility in the bake and meet the triangles of the box.\n\
         Error: NRMSE of reflected light at about 400 points against the reference integrator.\n\
         The last two scenes of this report have geometry made of the cells of their points.\n\n\
         | points | settings | NRMSE | bias | bounces | lists and rays, s | all bounces, s | rays | partial pairs |\n\
         |---|---|---|---|---|---|---|---|---|"
    )?;
    for s in &found.visibility_results {
        // The kernel is unbounded: more light is reflected than emitted.
        let (nrmse, bias) = match s.errors.nrmse > 1.0 {
            true => ("above 100 %".into(), "".into()),
            false => (percent(s.errors.nrmse), percent(s.errors.bias)),
        };
        writeln!(
            w,
            "| {} | {}, {} per leaf | {nrmse} | {bias} | {} | {:.2} | {:.2} | {} | {} |",
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
        "\nPartial pairs are pairs of nodes in the lists with partial visibility.\n\
         With [G08] Eq. (4) two points of neighboring walls can send each other more light than they have, and the bounces diverge.\n\
         Disks in place of points avoid this. They lose some light along edges, which is the bias. It decreases with the distance of the points.\n"
    )?;
    Ok(out)
}
