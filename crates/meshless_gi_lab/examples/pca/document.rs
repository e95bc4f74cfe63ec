//! The document's texts and the chart of visibility.

use super::transfer::{Made, Transfer};
use super::visibility::{BAKES, COUNTS, Cut, Found, Race, SAMPLES};
use meshless_gi_lab::accuracy::{Axis, Chart, Format, PENUMBRA, Series, Style};
use std::fmt::Write;

/// Error in the penumbra against the number of coefficients.
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
        x: Axis::log("coefficients a point", Format::Number),
        y: Axis::log("NRMSE in the penumbra, %", Format::Number),
        series: (found.iter().flat_map(|f| [0, 1, 2].map(|k| series(f, k)))).collect(),
        guides: vec![(10.0, "10 %".into())],
    }
    .svg()
}

/// A document's three parts: visibility with the title, transfer, and the level.
pub fn parts(document: &str) -> [String; 3] {
    let begins = |of: &str| document.find(of).unwrap_or(document.len());
    let second = begins(TRANSFER);
    let third = begins(LEVEL).max(second);
    let part = |from: usize, to: usize| format!("{}\n", document[from..to].trim_end());
    [
        part(0, second),
        part(second, third),
        part(third, document.len()),
    ]
}

/// Heading of the second part.
const TRANSFER: &str = "## Transfer\n";
/// Heading of the third part.
pub const LEVEL: &str = "## Links to senders and bases of light on the same axes: ";

/// The part on visibility, with the document's title.
pub fn text(found: &[Found], races: &[Race], level: &str, cuts: &[Cut]) -> String {
    let mut out = format!(
        "# Principal components\n\n\
        Visibility after [P14] §4.2 and transfer after its §4.3, measured. Printed by\n\n\
        ```text\ncargo run --release -p meshless_gi_lab --example pca -- -o docs/reports path/to/level\n```\n\nor with `--part` one of its three parts: `visibility`, `transfer`, `level`.\n\n\
        Soft shadows of one panel below the ceiling, {SAMPLES} samples, medium preset. The senders and the points of one level behind them remember what they see; all others take the mean of their\n\
        parents. The penumbra is where the reference integrator (256 stratified rays a place) says that between {} % and {} % of the panel's light arrive.\n\n",
        100.0 * PENUMBRA[0],
        100.0 * PENUMBRA[1]
    );
    out += "![Error by the number of coefficients](pca/coefficients.svg)\n\n## By the number of coefficients\n\nNRMSE of direct irradiance in the penumbra, %.\n\n";
    let _ = writeln!(
        out,
        "| scene | bake |{} rays instead |",
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
    out += "\nThese are the first so many of one bake's. \"Rays instead\" is what points and display alone leave: the same samples, each with a shadow ray at the points.\n\n\
        ## Other panels\n\n\
        The constants of `soft_shadow` were chosen with the panel above. Panels of other places and sizes, %:\n\n\
        | scene | panel | places in the penumbra | the defaults | 8064 directions, 150 points a cluster | by rays |\n|---|---|---|---|---|---|\n";
    for f in found {
        for o in &f.others {
            let _ = writeln!(
                out,
                "| {} | {} | {} | {:.1} | {:.1} | {:.1} |",
                f.name,
                o.what,
                o.places,
                100.0 * o.penumbra[0],
                100.0 * o.penumbra[1],
                100.0 * o.rays
            );
        }
    }
    out += "\n## Three ways to the screen\n\n\
        With 50 coefficients, over the penumbra / over all places that the panel would light, %: (i) the irradiance that arrives is splatted; (ii) what is missing is \
        splatted and taken from the unshadowed light of each place; (iii) what is missing and what would be there without shadows are splatted, and their quotient is the missing share, as the kernel \
        `subtract_shadow` has it. All other figures here are of (iii).\n\n\
        | scene | places, penumbra | (i) | (ii) | (iii) | (iii) by rays |\n|---|---|---|---|---|---|\n";
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
            f.places.0,
            f.places.1,
            pair(0),
            pair(1),
            pair(2),
            100.0 * f.rays
        );
    }
    out += "\nIn penumbrae all three are alike. Where all is hidden only (iii) leaves nothing: (ii) takes what the points say from what the place has, and speckles.\n\n\
        ## Size and time\n\n\
        [P14]: 45K points, 48 clusters, 50 of 2016 coefficients, 4.47 MB; 4 hours for visibility and transfer together. \
        Ours are more points, for edges of shadows are finer than what senders are spread for, and smaller clusters; components take the room.\n\n\
        | scene | settings | points | clusters | components, MB | coefficients, MB (kept) | all, MB | LZ4, MB | bake, s | penumbra, % | fully lit and umbra too, % |\n\
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
    out += "\nSeconds are those of the machine that printed this, on all its processors.\n";
    out += &cut(level, cuts);
    out += "\n## In place of rays\n\n\
        `project` asks whether a light reaches a place by a ray. It could ask the memory. The visible fraction of a panel at the points that remember and that it would light, the same samples, on one thread of \
        the CPU; one sample is what `project` asks of a point light; \"apart\" is the root mean square of the difference of the two fractions:\n\n\
        | level | triangles | points | samples | by rays, µs a point | from memory, µs a point | apart |\n|---|---|---|---|---|---|---|\n";
    for r in races {
        let _ = writeln!(
            out,
            "| {} | {} | {} | {} | {:.2} | {:.2} | {:.3} |",
            r.name, r.triangles, r.points, r.samples, r.rays, r.memory, r.apart
        );
    }
    for r in races.iter().filter(|r| r.apart > 0.3) {
        let _ = write!(
            out,
            "\nOn {} with {} samples memory and rays tell different things ({:.2} apart): what is remembered there at `Draft` is of no use yet.\n",
            r.name, r.samples, r.apart
        );
    }
    let wins = races.iter().filter(|r| r.memory < r.rays).count();
    let (least, most) = (races.iter().map(|r| r.memory / r.rays))
        .fold((f64::INFINITY, 0.0f64), |(a, b), v| (a.min(v), b.max(v)));
    let _ = writeln!(
        out,
        "\nMemory is the faster one in {wins} of {} rows, and takes {least:.1} to {most:.1} times as long as rays: it multiplies fifty coefficients for each of four directions a sample, where a ray \
        visits some dozens of boxes. {}\n\n## Pictures\n\nThe panel's light \
        on white surfaces: from memory, by the reference integrator, and the difference, five times as bright around gray.\n",
        races.len(),
        match wins {
            0 => "It wins nowhere here, and rays are exact: `project` keeps its rays.",
            _ => "Rays are exact, and need nothing baked: `project` keeps its rays.",
        }
    );
    for f in found {
        let _ = writeln!(out, "![{0}](pca/{0}.png)\n", f.name);
    }
    out.trim_end().to_string() + "\n"
}

/// The section on clusters that are cut.
fn cut(level: &str, cuts: &[Cut]) -> String {
    let Some(first) = cuts.first() else {
        return String::new();
    };
    let mut out = format!(
        "\n## Clusters that are cut: {level}\n\n\
        Points on two sides of a pillar see different things. A cluster whose error is larger than `error` is cut in two, and its halves again. At `Draft`, a panel at the first place that light can be \
        seen from; \"apart\" is the root mean square of the difference of the visible fractions from memory and by rays at the points, the penumbra has {} places:\n\n\
        | `error` | clusters | all, MB | bake, s | apart | penumbra, % | penumbra by rays, % |\n|---|---|---|---|---|---|---|\n",
        first.places
    );
    for c in cuts {
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
        out += "\nRays at the points are over ten per cent here by themselves: penumbrae are narrower than these points are apart, and no memory of theirs can mend that.\n";
    }
    out
}

/// The part on transfer.
pub fn transfer(all: &[Transfer]) -> String {
    let mut out = format!(
        "{TRANSFER}\n\
        TransportMethod `pca` beside rule `bounded`. The error is NRMSE of indirect irradiance after four reflections against the reference integrator, at places under lights that no bake has seen, with the \
        half width of its 95 % interval for other places. The share missed is the root mean square of the example lights' direct light that the bases cannot write down. The operator is links \
        of eight bytes, rows, and columns of sixteen bits a value.\n"
    );
    for t in all {
        let _ = write!(
            out,
            "\n![{0}: error by the number of coefficients](pca/transfer_error_{0}.svg)\n\n![{0}: operator by the number of coefficients](pca/transfer_size_{0}.svg)\n\n\
            {0}:\n\n{1}{2}",
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
        "\n### Size and time beside the paper's\n\n\
        [P14] §6: 45K points, 48 clusters, ten coefficients, 21 MB for transfer, less than a fifth of all entries; 4 hours for visibility and transfer together. It stores three scalars, one for \
        each color, with reflectance inside; a link here is a vector without color, so that materials may change and normals may be bent. Ours at medium:\n\n{}",
        head(&["level"])
    );
    for t in all {
        for m in &t.medium {
            let _ = write!(out, "| {} {}", t.name, row(m));
        }
    }
    out += "\nSeconds are those of the machine that printed this, on all its processors.\n";
    out
}

/// The head of a table of `row`s behind columns of these names.
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
            .map_or("rule `bounded`".into(), |k| k.to_string()),
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
