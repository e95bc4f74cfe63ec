//! Texts of the document and the chart of visibility.

use super::transfer::{Made, Transfer};
use super::visibility::{BAKES, COUNTS, Found, SAMPLES, SplitResult, VisibilityTiming};
use meshless_gi_lab::accuracy::{Axis, Chart, Format, PENUMBRA, Series, Style};
use std::fmt::Write;

/// Returns the chart of the error in the penumbra against the number of coefficients.
pub fn chart(found: &[Found]) -> String {
    let series = |f: &Found, k: usize| {
        let points = f.by_count[k].iter();
        let points = points.map(|&(count, e)| (f64::from(count), 100.0 * e));
        let name = format!(
            "{}, {}",
            f.name,
            ["defaults", "2016 directions", "8064 directions"][k]
        );
        Series::new(name, Style::LineAndPoints, points)
    };
    Chart {
        title: "Soft shadow of a panel: error by the number of coefficients".into(),
        caption: "NRMSE of direct irradiance in the penumbra, beside the reference integrator"
            .into(),
        x: Axis::log("coefficients per point", Format::Number),
        y: Axis::log("NRMSE in the penumbra, %", Format::Number),
        series: (found.iter().flat_map(|f| [0, 1, 2].map(|k| series(f, k)))).collect(),
        guides: vec![(10.0, "10 %".into())],
    }
    .svg()
}

/// Splits the document on transfer into two parts: the published scenes with the title, and one
/// scene.
pub fn parts(document: &str) -> [String; 2] {
    let second = document.find(SCENE).unwrap_or(document.len());
    let (first, second) = document.split_at(second);
    [first, second].map(|part| format!("{}\n", part.trim_end()))
}

/// Heading of the part on one scene.
pub const SCENE: &str = "## Links to senders and bases of light: ";

/// Returns the document on visibility.
pub fn text(
    found: &[Found],
    timings: &[VisibilityTiming],
    scene: &str,
    split_results: &[SplitResult],
) -> String {
    let mut out = format!(
        "# Visibility in principal components\n\n\
         Made by `cargo run --release -p meshless_gi_lab --example pca -- -o docs/reports path/to/scene`, or with `--part visibility`. Do not edit.\n\n\
         Visibility after [P14] §4.2: soft shadows of one panel below the ceiling, {SAMPLES} samples, preset `Medium`.\n\
         The points of the last sender level and of the level behind it store visibility. All other points take the mean of their parents.\n\
         The penumbra contains the points that receive between {} % and {} % of the panel's light, by the reference integrator with 256 stratified rays per point.\n\n",
        100.0 * PENUMBRA[0],
        100.0 * PENUMBRA[1]
    );
    out += "![Error by the number of coefficients](pca/coefficients.svg)\n\n## By the number of coefficients\n\nNRMSE of direct irradiance in the penumbra, %.\n\n";
    let _ = writeln!(
        out,
        "| scene | bake |{} rays |",
        COUNTS.map(|count| format!(" {count} |")).concat()
    );
    let _ = writeln!(out, "|---|---|{}---|", "---|".repeat(COUNTS.len()));
    for f in found {
        for (k, bake) in BAKES.iter().enumerate() {
            let cell = |count| match f.by_count[k].iter().find(|c| c.0 == count) {
                Some(c) => format!(" {:.1} |", 100.0 * c.1),
                None => " – |".into(),
            };
            let cells = COUNTS.map(cell).concat();
            let _ = writeln!(
                out,
                "| {} | {bake} |{cells} {:.1} |",
                f.name,
                100.0 * f.rays
            );
        }
    }
    out += &panels_section(found);
    out += &display_section(found);
    out += &size_section(found);
    out += &split_section(scene, split_results);
    out += &rays_section(timings);
    for f in found {
        let _ = writeln!(out, "![{0}](pca/{0}.png)\n", f.name);
    }
    out.trim_end().to_string() + "\n"
}

/// Returns the section on panels that were not used to choose a constant.
fn panels_section(found: &[Found]) -> String {
    let mut out = String::new();
    out += "\nThe coefficients are the first ones of one bake. \"Rays\" is the error of points and display alone: the same samples, each with a shadow ray at the points.\n\n\
     ## Other panels\n\n\
     The constants of `soft_shadow` were chosen with the panel above. Other panels, NRMSE in the penumbra, %:\n\n\
     | scene | panel | points in the penumbra | defaults | 8064 directions, 150 points per cluster | rays |\n\
     |---|---|---|---|---|---|\n";
    for f in found {
        for o in &f.others {
            let _ = writeln!(
                out,
                "| {} | {} | {} | {:.1} | {:.1} | {:.1} |",
                f.name,
                o.what,
                o.positions,
                100.0 * o.penumbra[0],
                100.0 * o.penumbra[1],
                100.0 * o.rays
            );
        }
    }
    out
}

/// Returns the section on the displays of shadows.
fn display_section(found: &[Found]) -> String {
    let mut out = String::new();
    out += "\n## Three ways to display shadows\n\n\
     With 50 coefficients. Each cell: NRMSE in the penumbra / over all points that the panel would light without shadows, %.\n\n\
     - (i) splats the received irradiance.\n\
     - (ii) splats the missing irradiance and subtracts it from the unshadowed light of each point.\n\
     - (iii) splats the missing and the unshadowed irradiance and uses their quotient as the missing fraction, like the kernel `subtract_shadow`. All other figures of this report use (iii).\n\n\
     | scene | all points, penumbra | (i) | (ii) | (iii) | (iii) with rays |\n\
     |---|---|---|---|---|---|\n";
    for f in found {
        let pair = |k: usize| {
            format!(
                "{:.1} / {:.2}",
                100.0 * f.penumbra[k].nrmse,
                100.0 * f.lit[k].nrmse
            )
        };
        let _ = writeln!(
            out,
            "| {} | {}, {} | {} | {} | {} | {:.1} |",
            f.name,
            f.positions.0,
            f.positions.1,
            pair(0),
            pair(1),
            pair(2),
            100.0 * f.rays
        );
    }
    out
}

/// Returns the section on size and time.
fn size_section(found: &[Found]) -> String {
    let mut out = String::new();
    out += "\nIn penumbrae the three are equal. In full shadow only (iii) leaves no light: (ii) subtracts an interpolated value from a local one and leaves speckles.\n\n\
     ## Size and time\n\n\
     [P14] has 45K points, 48 clusters, 50 of 2016 coefficients and 4.47 MB. Visibility and transfer together take 4 hours.\n\
     This implementation has more points, because edges of shadows are finer than the spacing of senders, and smaller clusters. Most of the size is components.\n\n\
     | scene | settings | points | clusters | components, MB | coefficients, MB (kept) | all, MB | LZ4, MB | bake, s | penumbra, % | all points, % |\n\
     |---|---|---|---|---|---|---|---|---|---|---|\n";
    for f in found {
        for v in &f.variants {
            let mb = |b: usize| b as f64 / 1e6;
            let _ = writeln!(
                out,
                "| {} | {} | {} | {} | {:.1} | {:.1} ({:.0} %) | {:.1} | {:.1} | {} | {:.1} | {:.2} |",
                f.name,
                v.what,
                v.points,
                v.clusters,
                mb(v.basis),
                mb(v.coefficients),
                100.0 * v.kept,
                mb(v.bytes),
                mb(v.packed),
                v.seconds.map_or("–".into(), |s| format!("{s:.0}")),
                100.0 * v.penumbra,
                100.0 * v.lit
            );
        }
    }
    out += "\nSeconds are those of one machine, on all its cores.\n";
    out
}

/// Returns the section on rays in place of stored visibility.
fn rays_section(timings: &[VisibilityTiming]) -> String {
    let mut out = String::new();
    out += "\n## Comparison with rays\n\n\
     The kernel `project` traces shadow rays. It could use the stored visibility.\n\
     The table compares the visible fraction of a panel at the points with stored visibility, with the same samples, on one CPU thread.\n\
     One sample is the case of a point light. The difference is the root mean square over points.\n\n\
     | scene | triangles | points | samples | rays, µs per point | stored, µs per point | difference |\n\
     |---|---|---|---|---|---|---|\n";
    for r in timings {
        let _ = writeln!(
            out,
            "| {} | {} | {} | {} | {:.2} | {:.2} | {:.3} |",
            r.name, r.triangles, r.points, r.samples, r.rays, r.memory, r.apart
        );
    }
    for r in timings.iter().filter(|r| r.apart > 0.3) {
        let _ = write!(
            out,
            "\nIn {} with {} samples the difference is {:.2}: the visibility stored at `Draft` is not usable there.\n",
            r.name, r.samples, r.apart
        );
    }
    let wins = timings.iter().filter(|r| r.memory < r.rays).count();
    let (min, max) = (timings.iter().map(|r| r.memory / r.rays))
        .fold((f64::INFINITY, 0.0f64), |(a, b), v| (a.min(v), b.max(v)));
    let _ = writeln!(
        out,
        "\nStored visibility is faster in {wins} of {} rows, and takes {min:.1} to {max:.1} times as long as rays.\n\
         It multiplies fifty coefficients for each of four directions per sample. A ray visits some dozens of boxes.\n\
         {}\n\n\
         ## Pictures\n\n\
         The panel's light on white surfaces: stored visibility, reference integrator, and five times their difference around gray.\n",
        timings.len(),
        match wins {
            0 => "Rays are exact and faster here, so `project` uses rays.",
            _ => "Rays are exact and need no bake, so `project` uses rays.",
        }
    );
    out
}

/// Returns the section on split clusters.
fn split_section(scene: &str, split_results: &[SplitResult]) -> String {
    let Some(first) = split_results.first() else {
        return String::new();
    };
    let mut out = format!(
        "\n## Split clusters: {scene}\n\n\
         Points on two sides of a pillar have different visibility. A cluster whose error exceeds `error` is split, and its halves again.\n\
         Preset `Draft`, a panel at the first viewpoint. The difference is that of the visible fractions by stored visibility and by rays at the points, root mean square.\n\
         The penumbra has {} points.\n\n\
         | `error` | clusters | all, MB | bake, s | difference | penumbra, % | penumbra with rays, % |\n\
         |---|---|---|---|---|---|---|\n",
        first.positions
    );
    for c in split_results {
        let _ = writeln!(
            out,
            "| {} | {} | {:.1} | {:.0} | {:.3} | {:.1} | {:.1} |",
            c.error,
            c.clusters,
            c.bytes as f64 / 1e6,
            c.seconds,
            c.apart,
            100.0 * c.penumbra,
            100.0 * c.rays
        );
    }
    if first.rays > 0.1 {
        out += "\nThe error with rays is above 10 % too: penumbrae are narrower than the spacing of the points. Better stored visibility cannot correct that.\n";
    }
    out
}

/// Returns the part on transfer, with the title of the document.
pub fn transfer(all: &[Transfer]) -> String {
    let mut out = "# Transfer in principal components\n\n\
         Made by `cargo run --release -p meshless_gi_lab --example pca -- -o docs/reports path/to/scene`, or with `--part transfer` and `--part scene`. Do not edit.\n\n\
         Transfer after [P14] §4.3: the method `pca` compared with `bounded`.\n\n\
         - Error: NRMSE of indirect irradiance after four bounces against the reference integrator, under lights that no bake has seen. ± is the half width of the 95 % confidence interval over points.\n\
         - Direct light missed: root mean square of the part of the training lights' direct light that the bases cannot represent.\n\
         - Operator: links of eight bytes, rows, and columns of sixteen bits per value.\n"
        .to_string();
    for t in all {
        let _ = write!(
            out,
            "\n## {0}\n\n\
             ![{0}: error by the number of coefficients](pca/transfer_error_{0}.svg)\n\n\
             ![{0}: operator by the number of coefficients](pca/transfer_size_{0}.svg)\n\n\
             {1}{2}",
            t.name,
            head(&[]),
            row(&t.senders)
        );
        for m in t.by_count.iter().flat_map(|(_, made)| made) {
            out += &row(m);
        }
    }
    let _ = write!(
        out,
        "\n## Comparison with [P14]\n\n\
         [P14] §6 has 45K points, 48 clusters, ten coefficients, 21 MB for transfer, less than a fifth of all entries. Visibility and transfer together take 4 hours.\n\
         It stores three scalars per entry, one per color, with the reflectance included.\n\
         A link here is a vector without color, so that materials can change and normals can be bent. Preset `Medium`:\n\n\
         {}",
        head(&["scene"])
    );
    for t in all {
        for m in &t.medium {
            let _ = write!(out, "| {} {}", t.name, row(m));
        }
    }
    out += "\nSeconds are those of one machine, on all its cores.\n";
    out
}

/// Returns the head of a table of `row`s after columns of these names.
fn head(before: &[&str]) -> String {
    const COLUMNS: [&str; 10] = [
        "preset",
        "coefficients",
        "senders",
        "clusters",
        "columns",
        "direct light missed",
        "error",
        "links",
        "operator, MB",
        "bake, s",
    ];
    let names = [before, &COLUMNS].concat();
    format!(
        "| {} |\n|{}\n",
        names.join(" | "),
        "---|".repeat(names.len())
    )
}

fn row(m: &Made) -> String {
    let share = |v: String| {
        if m.coefficients.is_some() {
            v
        } else {
            "–".into()
        }
    };
    format!(
        "| `{:?}` | {} | {} | {} | {} | {} | {:.1} ± {:.1} % | {:.2} M | {:.2} | {} |\n",
        m.preset,
        m.coefficients
            .map_or("method `bounded`".into(), |k| k.to_string()),
        m.senders,
        share(m.clusters.to_string()),
        share(m.columns.to_string()),
        share(format!("{:.1} %", 100.0 * m.missed)),
        100.0 * m.error,
        100.0 * m.interval,
        m.links as f64 / 1e6,
        m.bytes as f64 / 1e6,
        m.seconds.map_or("–".into(), |s| format!("{s:.1}")),
    )
}
