//! Markdown of a report: recommended choices with reasons first, then charts, the comparison of
//! methods, and all rows.

use super::charts::Figure;
use super::format::{cell, count, error, megabytes, percent, recipe_label, short, whole_percent};
use super::measure::Row;
use super::octree::fmm_comparison;
use super::rules::{MethodComparison, Ratio, compare, compare_with, is_comparable};
use super::sentences::split_sentences;
use super::sweep::Report;
use super::tables::{known, table};
use super::variant::{BOUNCES, Factor};
use meshless_gi::TransportMethod;
use std::fmt::Write;

/// Error limits with a recommended choice.
pub const ERROR_LIMITS: [f64; 4] = [0.10, 0.05, 0.03, 0.02];
/// Goals of the default method relative to `l08`: links at equal error, and error at equal links.
const GOALS: (f64, f64) = (1.0 / 3.0, 0.5);

/// Returns the cheapest row by the default method with an error of at most `max`. The method `l08`
/// serves as a baseline only, because its reflections cannot be baked.
pub fn cheapest(rows: &[Row], max: f64, cost: fn(&Row) -> f64) -> Option<&Row> {
    cheapest_of(rows, TransportMethod::Bounded, max, cost)
}

fn cheapest_of(
    rows: &[Row],
    method: TransportMethod,
    max: f64,
    cost: fn(&Row) -> f64,
) -> Option<&Row> {
    rows.iter()
        .filter(|r| is_comparable(r) && r.has_method(&method) && r.error_or_bound() <= max)
        .min_by(|a, b| cost(a).total_cmp(&cost(b)))
}

/// Returns the text of a report on the scene `name`, with its charts.
#[must_use]
pub fn text(name: &str, report: &Report, figures: &[Figure]) -> String {
    let mut out = format!("# Cost of accuracy: {}\n\n", cell(name));
    out += &section(report, figures, "", 2);
    split_sentences(&out)
}

/// Returns the text without a title, as a section of a document on several scenes. The charts are
/// in the folder `charts` (with a trailing slash). The headings have `heading` marks.
#[must_use]
pub fn section(report: &Report, figures: &[Figure], charts: &str, heading: usize) -> String {
    let mut out = choice(&report.rows);
    let mark = "#".repeat(heading);
    let _ = write!(
        out,
        "\n{mark} Effect of each setting\n\n\
     {}",
        factors(&report.rows)
    );
    out += &reflections(&report.rows);
    for figure in figures {
        let _ = writeln!(
            out,
            "\n![{}]({charts}{})",
            cell(&figure.chart.title),
            figure.file
        );
    }
    let _ = write!(
        out,
        "\n{mark} Methods `bounded` and `l08`\n\n\
         {}",
        rules(&compare(&report.rows))
    );
    let bases = pca_comparison(&report.rows);
    if !bases.is_empty() {
        let _ = write!(
            out,
            "\n{mark} Methods `bounded` and `pca`\n\n\
             {bases}"
        );
    }
    let octree = fmm_comparison(&report.rows);
    if !octree.is_empty() {
        let _ = write!(
            out,
            "\n{mark} Methods `bounded` and `fmm`\n\n\
             {octree}"
        );
    }
    let _ = write!(
        out,
        "\n{mark} All bakes\n\n\
         {}",
        table(&report.rows)
    );
    out += &known(&report.rows, &mark);
    let _ = write!(
        out,
        "\n{mark} Method of measurement\n\n\
     {}",
        method(report)
    );
    out
}

/// Returns the recommended choices with reasons, the first part of a report.
#[must_use]
pub fn choice(rows: &[Row]) -> String {
    let mut out = String::new();
    let best = rows
        .iter()
        .filter(|r| is_comparable(r) && r.has_method(&TransportMethod::Bounded))
        .min_by(|a, b| a.error_or_bound().total_cmp(&b.error_or_bound()));
    let Some(best) = best else {
        return "Nothing was measured.\n".into();
    };
    let summary = |r: &Row| {
        format!(
            "{}, bake {} s, file {}, frame {} ms on the CPU, error {} ± {}",
            recipe_label(r),
            short(r.bake_seconds),
            megabytes(r.bytes),
            short(r.frame_ms),
            error(r),
            percent(r.nrmse_interval)
        )
    };
    match cheapest(rows, 0.05, |r| r.frame_ms) {
        Some(row) => {
            let _ = writeln!(
                out,
                "**Recommendation for a release with at most 5 % error: {}.**\n\
                 Of all measured bakes below 5 % it has the fastest frame.",
                summary(row)
            );
        }
        None => {
            let _ = writeln!(
                out,
                "**No measured bake of this scene has an error below 5 %. The best: {}.**",
                summary(best)
            );
        }
    }
    let frame = |r: &Row| r.frame_ms;
    let ours = cheapest(rows, 0.05, frame).map_or(f64::INFINITY, frame);
    if let Some(row) =
        cheapest_of(rows, TransportMethod::L08, 0.05, frame).filter(|r| r.frame_ms < ours)
    {
        let _ = writeln!(
            out,
            "The published method has a faster frame here: {}.",
            summary(row)
        );
    }
    if let Some(row) = cheapest(rows, 0.10, |r| r.bake_seconds) {
        let _ = writeln!(
            out,
            "Recommendation during development with at most 10 % error: {}.\n\
             Of all measured bakes below 10 % it has the shortest bake.",
            summary(row)
        );
    }
    let _ = writeln!(
        out,
        "\nCheapest bakes by cost:\n\n\
         | error at most | shortest bake | smallest file | fastest frame |\n\
         |---|---|---|---|"
    );
    for max in ERROR_LIMITS {
        let cost = |cost: fn(&Row) -> f64, show: fn(&Row) -> String| match cheapest(rows, max, cost)
        {
            Some(r) => format!("{}: {} ({})", r.settings.name, show(r), percent(r.nrmse)),
            None => format!("not reached, minimum {}", percent(best.nrmse)),
        };
        let _ = writeln!(
            out,
            "| {} | {} | {} | {} |",
            whole_percent(max),
            cost(
                |r| r.bake_seconds,
                |r| format!("{} s", short(r.bake_seconds))
            ),
            cost(|r| r.bytes as f64, |r| megabytes(r.bytes)),
            cost(|r| r.frame_ms, |r| format!("{} ms", short(r.frame_ms))),
        );
    }
    out
}

/// Returns the effect of each factor from its cheapest to its best row, including the baseline.
/// Also names the row with the largest decrease of the error relative to its additional bake time.
fn factors(rows: &[Row]) -> String {
    let Some(base) = rows.first() else {
        return String::new();
    };
    let mut out = "Each row changes one setting of the first row of the table below, from the cheapest to the most expensive value.\n\n\
     | setting | from | to | error | bake, s | frame, ms | file |\n\
     |---|---|---|---|---|---|---|\n"
        .to_string();
    let mut gains: Vec<(f64, &Row)> = Vec::new();
    for factor in Factor::ALL {
        if matches!(factor, Factor::Bounces | Factor::Several) {
            continue;
        }
        let mut all: Vec<&Row> = rows
            .iter()
            .filter(|r| r.settings.factor == factor)
            .collect();
        // These variants change more than one setting.
        let alone = matches!(
            factor,
            Factor::RuleL08 | Factor::RulePca | Factor::RuleFmm | Factor::Plain
        );
        if !alone && factor != Factor::Preset {
            all.push(base);
        }
        if all.len() < 2 {
            continue;
        }
        all.sort_by(|a, b| {
            a.bytes
                .cmp(&b.bytes)
                .then(a.bake_seconds.total_cmp(&b.bake_seconds))
        });
        if factor == Factor::Rays {
            all.sort_by_key(|r| r.settings.baked.rays_per_point);
        }
        if factor == Factor::Tier {
            all.retain(|r| r.settings.baked == base.settings.baked);
            all.sort_by_key(|r| r.settings.tier);
        }
        if factor == Factor::SamplesPerSender {
            all.sort_by_key(|r| r.settings.baked.samples_per_sender);
        }
        let (first, last) = (all[0], all[all.len() - 1]);
        let both = |show: &dyn Fn(&Row) -> String| format!("{} → {}", show(first), show(last));
        let _ = writeln!(
            out,
            "| {} | {} | {} | {} | {} | {} | {} |",
            factor.name(),
            first.settings.name,
            last.settings.name,
            both(&error),
            both(&|r| short(r.bake_seconds)),
            both(&|r| short(r.frame_ms)),
            both(&|r| megabytes(r.bytes)),
        );
        let steps = all.iter().filter(|_| !alone && factor != Factor::Preset);
        gains.extend(steps.filter_map(|r| Some((gain(base, r)?, *r))));
    }
    if let Some((gain, row)) = gains.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)) {
        let _ = writeln!(
            out,
            "\n**{}** lowers the error most for the bake time that it adds: from {} to {} at {} s instead of {} s.\n\
             Each doubling of the time multiplies the error by {}.",
            row.settings.name,
            error(base),
            error(row),
            short(row.bake_seconds),
            short(base.bake_seconds),
            short(2f64.powf(-gain)),
        );
    }
    out
}

/// Returns the number of times the error halves for each doubling of the bake time. Returns `None`
/// if either is almost constant.
fn gain(base: &Row, row: &Row) -> Option<f64> {
    let (error, time) = (base.nrmse / row.nrmse, row.bake_seconds / base.bake_seconds);
    (error > 1.05 && time > 1.2 && error.is_finite() && time.is_finite())
        .then(|| error.ln() / time.ln())
}

/// Returns the cost and benefit of more bounces.
fn reflections(rows: &[Row]) -> String {
    let mut all: Vec<&Row> = rows
        .iter()
        .enumerate()
        .filter(|(i, r)| *i == 0 || !is_comparable(r))
        .map(|(_, r)| r)
        .collect();
    if all.len() < 2 {
        return String::new();
    }
    all.sort_by_key(|r| r.settings.baked.bounces);
    let mut out = format!(
        "\nThe frame chooses the number of bounces. It does not change the bake.\n\
         Errors in this table are relative to the converged solution, all others to {BOUNCES} bounces.\n\n\
         | bounces | error | frame, ms |\n\
         |---|---|---|\n"
    );
    for row in all {
        let name = match row.settings.factor {
            Factor::Bounces => row.settings.name.clone(),
            _ => format!("{} bounces", row.settings.baked.bounces),
        };
        let _ = writeln!(
            out,
            "| {name} | {} | {} |",
            percent(row.nrmse_all),
            short(row.frame_ms)
        );
    }
    out
}

fn ratio(r: Ratio) -> String {
    match r {
        Ratio::Is(v) => format!("× {v:.2}"),
        Ratio::AtMost(v) => format!("× {v:.2} at most"),
        Ratio::NotReached => "not reached".into(),
    }
}

/// Returns both ratios at each position of the front of `l08`, and the result for the goals.
fn rules(compared: &[MethodComparison]) -> String {
    if compared.is_empty() {
        return "The method `l08` was not measured.\n".into();
    }
    let mut out = "Each row is a bake on the Pareto front of `l08`.\n\
     The front of `bounded` is interpolated at its error and at its number of links, linearly between the logarithms.\n\
     \"At most\": every measured bake of `bounded` is better than that.\n\
     Bakes named \"plain\" use `bounded` at the points of `l08`, so that only the truncation differs.\n\n\
     | `l08` | links | error | links of `bounded` at equal error | error of `bounded` at equal links |\n\
     |---|---|---|---|---|\n"
        .to_string();
    for c in compared {
        let _ = writeln!(
            out,
            "| {} | {} | {} | {} | {} |",
            c.name,
            count(c.links as u64),
            percent(c.error),
            ratio(c.links_ratio),
            ratio(c.error_ratio)
        );
    }
    out.push('\n');
    let mut verdict = |what: &str, goal: f64, word: &str, of: fn(&MethodComparison) -> Ratio| {
        let found: Vec<f64> = compared.iter().filter_map(|c| of(c).value()).collect();
        let worst = found.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let best = found.iter().copied().fold(f64::INFINITY, f64::min);
        let met = found.iter().filter(|v| **v <= goal).count();
        let _ = match found.len() {
            0 => writeln!(out, "- {what}: not reached. Goal: {word}."),
            n => writeln!(
                out,
                "- {what}: × {best:.2} to × {worst:.2}. Goal: {word}, met in {met} of {} rows{}.",
                compared.len(),
                if n < compared.len() {
                    format!(", not reached in {}", compared.len() - n)
                } else {
                    String::new()
                }
            ),
        };
    };
    verdict("Links at equal error", GOALS.0, "a third", |c| {
        c.links_ratio
    });
    verdict("Error at equal links", GOALS.1, "a half", |c| c.error_ratio);
    out
}

/// Returns the comparison of the method `pca` with links to senders, and a recommendation. Empty if
/// that method was not measured.
#[must_use]
pub fn pca_comparison(rows: &[Row]) -> String {
    let compared = compare_with(rows, TransportMethod::pca());
    if compared.is_empty() {
        return String::new();
    }
    let mut out = "Method `pca` ([P14]) stores each row of the operator in principal components of the direct light on each cluster of senders.\n\
     Each row below is a bake on its Pareto front. The front of `bounded` is interpolated linearly between the logarithms.\n\
     \"At most\": every measured bake of `bounded` is better than that.\n\n\
     | `pca` | error | links | file | bake, s | frame, ms | links of `bounded` at equal error | error of `bounded` at equal links |\n\
     |---|---|---|---|---|---|---|---|\n"
        .to_string();
    for c in &compared {
        let row = &rows[c.row];
        let _ = writeln!(
            out,
            "| {} | {} | {} | {} | {} | {} | {} | {} |",
            cell(&c.name),
            percent(c.error),
            count(c.links as u64),
            megabytes(row.bytes),
            short(row.bake_seconds),
            short(row.frame_ms),
            ratio(c.links_ratio),
            ratio(c.error_ratio)
        );
    }
    let min = |method: TransportMethod| {
        let errors = rows
            .iter()
            .filter(|r| is_comparable(r) && r.has_method(&method));
        errors.map(|r| r.nrmse).fold(f64::INFINITY, f64::min)
    };
    let (ours, theirs) = (min(TransportMethod::Bounded), min(TransportMethod::pca()));
    let wins = compared
        .iter()
        .filter(|c| c.links_ratio.value().is_none_or(|r| r > 1.0))
        .count();
    let found = match wins {
        0 => "needs more links than `bounded` at every error that it reached".to_string(),
        n if n == compared.len() => {
            "needs fewer links than `bounded` at every error that it reached".to_string()
        }
        n => format!(
            "needs fewer links than `bounded` at {n} of the {} errors above",
            compared.len()
        ),
    };
    let advice = match wins {
        0 => "Use `bounded` here.",
        _ => {
            "Use `bounded` to meet an error. Use `pca` at the errors where it needs fewer links, if lights keep away from walls."
        }
    };
    let _ = writeln!(
        out,
        "\nConclusion: in this scene `pca` {found}.\n\
         The minimum error is {} with `pca` and {} with `bounded`. {advice}\n\
         Bases are trained on lights in the open space of the scene.\n\
         A light next to a wall, or unlike the training lights, is blurred over its cluster. Its energy is kept, but the error has no bound.",
        percent(theirs),
        percent(ours)
    );
    out
}

fn method(report: &Report) -> String {
    let rows = &report.rows;
    let agree = rows.iter().filter(|r| is_comparable(r));
    let honest = agree
        .clone()
        .filter(|r| {
            let room = r.estimated_nrmse_interval.hypot(r.nrmse_interval);
            (r.estimated_nrmse - r.nrmse).abs() <= room
        })
        .count();
    let rounding = rows.iter().map(|r| r.link_error).fold(0.0, f64::max);
    let mut out = format!(
        "- Error: NRMSE of indirect irradiance, computed as in a frame, against the reference integrator at {} random surface points under {} white point lights in turn. No bake has used these lights.\n\
         - The variance of the reference is subtracted. ± is the half width of the 95 % confidence interval over points. All bakes use the same points and lights.\n\
         - The reference was computed once, in {} s. Its standard error is {} of its values with {} bounces, {} with all.\n\
         - Bake time includes the error estimate, without reading the scene and writing the file.\n\
         - Frame time is that of the CPU twins for one light that has moved: projection with shadow rays, bounces, operator. The display per point on one thread is listed separately.\n\
         - Times are for {} threads of one machine. They do not predict a GPU.\n\
         - The estimate of the bake agrees with the measured error, within both intervals, for {honest} of {} bakes.\n\
         - Not varied: the quantization of links (it changes a link by at most {:.3} % of the largest in its row), and the resolution of the display, which evaluates every point.\n",
        report.positions,
        report.light_sources,
        short(report.reference_seconds),
        percent(report.noise.0),
        report.bounces,
        percent(report.noise.1),
        report.threads,
        agree.count(),
        100.0 * rounding,
    );
    if !report.left_out.is_empty() {
        let _ = writeln!(
            out,
            "- Skipped because of the time limit: {}.",
            report.left_out.join("; ")
        );
    }
    let _ = writeln!(
        out,
        "- Total time: {} s. Triangles of the scene: {}.",
        short(report.seconds),
        report.triangles
    );
    out
}
