//! Document and its charts.

use super::bumps::NodeContent;
use super::experiments::{FINEST, Found, LIGHTS, NORMALS, Pair, SCREEN, SMALL};
use meshless_gi::{DepthTest, NormalTest, SubsplatSettings};
use meshless_gi_lab::accuracy::{Axis, Chart, Format, Mark, Series, Style};
use std::fmt::{Error, Write};

/// Bounds of subsplats: evaluations over pixels, and FLIP.
const BOUND: (f64, f32) = (1.0 / 8.0, 0.01);

fn depth_name(test: DepthTest) -> (&'static str, f32) {
    match test {
        DepthTest::Plane(t) => ("plane", t),
        DepthTest::MinMax(t) => ("min-max", t),
        DepthTest::Derivative(t) => ("derivative", t),
        other => unreachable!("{other:?}"),
    }
}

fn normal_name(test: NormalTest) -> (&'static str, f32) {
    match test {
        NormalTest::MinMax(t) => ("min-max", t),
        NormalTest::Curvature(t) => ("curvature", t),
        other => unreachable!("{other:?}"),
    }
}

fn pair_name(pair: &Pair) -> String {
    format!(
        "depth: {}, normals: {}",
        depth_name(pair.depth).0,
        normal_name(pair.normal).0
    )
}

fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

pub fn charts(found: &Found) -> Vec<(&'static str, Chart)> {
    let pixels = f64::from(SMALL[0] * SMALL[1]);
    let path = Chart {
        title: "Subsplats along a path, by tests of discontinuities".into(),
        caption: format!(
            "{}, {} × {} pixels, thresholds of about equal FLIP, no test of light. Lower is better.",
            found.on, SMALL[0], SMALL[1]
        ),
        x: Axis::linear("position along the path", Format::Number),
        y: Axis::linear("evaluations, fraction of the pixels", Format::Percent),
        series: found
            .pairs
            .iter()
            .map(|pair| {
                let positions = pair.positions.iter().enumerate();
                let points =
                    positions.map(|(k, m)| (k as f64, f64::from(m.counts.total()) / pixels));
                Series::new(pair_name(pair), Style::LineAndPoints, points)
            })
            .collect(),
        ..Chart::default()
    };
    let thresholds = Chart {
        title: "Subsplats by threshold of the normal and finest level".into(),
        caption: format!(
            "{}, first view, {} × {} pixels, no test of light.",
            found.on, SCREEN[0], SCREEN[1]
        ),
        x: Axis::linear("threshold of the normal's components", Format::Number),
        y: Axis::linear("evaluations, fraction of the pixels", Format::Percent),
        series: FINEST
            .iter()
            .map(|&finest| {
                let own = found.cells.iter().filter(|c| c.finest == finest);
                let points = own.map(|c| (f64::from(c.normal), c.measured.evaluations_per_pixel()));
                let name = format!("finest cells {} pixels wide", 1 << finest);
                Series::new(name, Style::LineAndPoints, points)
            })
            .collect(),
        ..Chart::default()
    };
    let mut names: Vec<&str> = found.lights.iter().map(|l| l.scene.as_str()).collect();
    names.dedup();
    let light = Chart {
        title: "Effect of the threshold of light".into(),
        caption: format!(
            "First view of each scene, {} × {} pixels. Labels: the threshold. The line: the bound of the first table.",
            SCREEN[0], SCREEN[1]
        ),
        x: Axis::linear("evaluations, fraction of the pixels", Format::Percent),
        y: Axis::linear("FLIP against full resolution", Format::Number),
        series: names
            .iter()
            .map(|&name| {
                let own = found.lights.iter().filter(|l| l.scene == name);
                Series {
                    points: own
                        .map(|l| {
                            Mark::new(
                                l.measured.evaluations_per_pixel(),
                                f64::from(l.measured.flip),
                            )
                            .labeled(threshold(l.light))
                        })
                        .collect(),
                    ..Series::new(name, Style::LineAndPoints, [])
                }
            })
            .collect(),
        guides: vec![(f64::from(BOUND.1), String::new())],
    };
    vec![
        ("path.svg", path),
        ("thresholds.svg", thresholds),
        ("light.svg", light),
    ]
}

fn threshold(t: f32) -> String {
    if t.is_finite() {
        format!("{t}")
    } else {
        "none".into()
    }
}

pub fn text(found: &Found) -> Result<String, Error> {
    let mut out = String::new();
    first(found, &mut out)?;
    views(found, &mut out)?;
    light(found, &mut out)?;
    tests(found, &mut out)?;
    table(found, &mut out)?;
    bumps(found, &mut out)?;
    super::gloss::text(&found.gloss, &mut out)?;
    Ok(out)
}

fn first(found: &Found, out: &mut String) -> Result<(), Error> {
    let d = SubsplatSettings::default();
    let largest = |of: &dyn Fn(&super::experiments::Row) -> f64| {
        found.rows.iter().map(of).fold(0.0, f64::max)
    };
    let (share, flip) = (
        largest(&|r| r.measured.evaluations_per_pixel()),
        largest(&|r| f64::from(r.measured.flip)),
    );
    let holds = found
        .rows
        .iter()
        .filter(|r| r.measured.evaluations_per_pixel() <= BOUND.0 && r.measured.flip <= BOUND.1)
        .count();
    let mut names: Vec<&str> = found.rows.iter().map(|r| r.scene.as_str()).collect();
    names.dedup();
    writeln!(
        out,
        "# Multiresolution splatting\n\n\
         Made by `cargo run --release -p meshless_gi_lab --example subsplats -- -o docs/reports SCENE_FOLDER...`, with the CPU twins of the kernels. Do not edit.\n\
         The cluttered room is built in. Further scenes ({}) are folders that the command names.\n\n\
         **Recommendation: the defaults**: coarsest level {}, finest {}, depth {} {}, normals {} {}, radiance threshold {}, minimum similarity {}.\n\
         Over all {} views they evaluate at most 1/{:.1} of the pixels, with FLIP at most {flip:.4}. In {holds} of {} views they evaluate at most 1/8 of the pixels with FLIP at most 0.01.\n\n\
         - For fewer evaluations raise `radiance_threshold`. It is the only setting with a large effect. A table below has its cost.\n\
         - Keep the depth test at `Plane`: floors at a grazing angle are not edges to it.\n\
         - Keep `detail` at 0: nodes store vectors, so that bumps are shaded correctly without it.\n",
        if names.len() > 1 {
            names[1..].join(", ")
        } else {
            "none".into()
        },
        d.coarsest_level,
        d.finest_level,
        depth_name(d.depth).0,
        depth_name(d.depth).1,
        normal_name(d.normal).0,
        normal_name(d.normal).1,
        d.radiance_threshold,
        d.min_similarity,
        found.rows.len(),
        1.0 / share,
        found.rows.len(),
    )
}

fn views(found: &Found, out: &mut String) -> Result<(), Error> {
    writeln!(
        out,
        "## Views at {} × {} pixels\n\n\
         Default settings. The columns are:\n\n\
         - subsplats by the width of their cell in pixels (1: pixels evaluated directly), and their fraction of the pixels,\n\
         - FLIP of the pictures of indirect light × albedo (mean luminance 0.18, tone curve 1.25 x / (1 + x)),\n\
         - NRMSE of the irradiance,\n\
         - time of full resolution and of subsplats including all passes, on one CPU thread in the same run, and their ratio. Other work on the machine affects these times.\n\n\
         | scene | view | 16 | 8 | 4 | 2 | 1 | fraction | FLIP | NRMSE | full resolution | subsplats | ratio |\n\
         |---|---|---|---|---|---|---|---|---|---|---|---|---|",
        SCREEN[0], SCREEN[1]
    )?;
    for row in &found.rows {
        let n = row.measured.counts.evaluated;
        let [full, few] = row.seconds;
        writeln!(
            out,
            "| {} | {} | {} | {} | {} | {} | {} | 1/{:.1} | {:.4} | {} | {full:.2} s | {few:.2} s | {:.1} |",
            row.scene,
            row.view + 1,
            n[4],
            n[3],
            n[2],
            n[1],
            n[0],
            1.0 / row.measured.evaluations_per_pixel(),
            row.measured.flip,
            percent(row.measured.nrmse),
            full / few
        )?;
    }
    writeln!(out)
}

fn light(found: &Found, out: &mut String) -> Result<(), Error> {
    writeln!(
        out,
        "## Threshold of light\n\n\
         A cell is also refined if the light of a node differs from its prediction. Without (\"none\") only geometry refines, as in [N09] §4.2. First view of each scene.\n\n\
         ![FLIP against fraction of the pixels](subsplats/light.svg)\n\n\
         | scene |{}\n\
         |---|{}",
        LIGHTS.map(|l| format!(" {} |", threshold(l))).concat(),
        "---|".repeat(LIGHTS.len())
    )?;
    let mut names: Vec<&str> = found.lights.iter().map(|l| l.scene.as_str()).collect();
    names.dedup();
    for name in names {
        write!(out, "| {name} |")?;
        for l in found.lights.iter().filter(|l| l.scene == name) {
            write!(
                out,
                " 1/{:.1}, {:.4} |",
                1.0 / l.measured.evaluations_per_pixel(),
                l.measured.flip
            )?;
        }
        writeln!(out)?;
    }
    writeln!(out)
}

fn tests(found: &Found, out: &mut String) -> Result<(), Error> {
    writeln!(
        out,
        "## Tests of discontinuities ([N09] Fig. 9)\n\n\
         {} positions on a path through {} at {} × {} pixels, refined by geometry alone.\n\
         The thresholds of a pair are the initial values times one factor (plane 0.05, min-max 0.1, derivative 0.02; normals: min-max 1, curvature 0.5).\n\
         The factor is found by bisection: the mean FLIP of every second position equals that of plane and min-max with factor 1.\n\
         FLIP is the mean over all positions. \"No diagonals\" omits the test of the four diagonal neighbors ([N09] §5.2: 2 to 3 % of the time).\n\n\
         ![Subsplats along the path](subsplats/path.svg)\n\n\
         | depth | threshold | normals | threshold | subsplats | minimum to maximum | FLIP | no diagonals: subsplats | FLIP | added by diagonals |\n\
         |---|---|---|---|---|---|---|---|---|---|",
        found.pairs[0].positions.len(),
        found.on,
        SMALL[0],
        SMALL[1]
    )?;
    for pair in &found.pairs {
        let ((depth, d), (normal, n)) = (depth_name(pair.depth), normal_name(pair.normal));
        let each = || pair.positions.iter().map(|m| m.counts.total());
        writeln!(
            out,
            "| {depth} | {d:.3} | {normal} | {n:.3} | {:.0} | {} to {} | {:.4} | {:.0} | {:.4} | {} |",
            pair.count(),
            each().min().unwrap_or(0),
            each().max().unwrap_or(0),
            pair.flip(),
            pair.straight.0,
            pair.straight.1,
            percent(pair.count() / pair.straight.0 - 1.0)
        )?;
    }
    writeln!(out)
}

fn table(found: &Found, out: &mut String) -> Result<(), Error> {
    writeln!(
        out,
        "## Resolution and threshold of the normal ([N09] Table 2, Fig. 10)\n\n\
         {}, first view, refined by geometry alone. The finest cells here correspond to the resolution of the indirect light in [N09].\n\
         Each cell: fraction of the pixels, FLIP, time of full resolution relative to subsplats.\n\n\
         ![Fraction of the pixels](subsplats/thresholds.svg)\n\n\
         | finest cells |{}\n\
         |---|{}",
        found.on,
        NORMALS.map(|n| format!(" {n} |")).concat(),
        "---|".repeat(NORMALS.len())
    )?;
    for finest in FINEST {
        write!(out, "| {} pixels |", 1 << finest)?;
        for c in found.cells.iter().filter(|c| c.finest == finest) {
            write!(
                out,
                " 1/{:.1}, {:.4}, {:.1} |",
                1.0 / c.measured.evaluations_per_pixel(),
                c.measured.flip,
                c.seconds[0] / c.seconds[1]
            )?;
        }
        writeln!(out)?;
    }
    writeln!(out)
}

fn bumps(found: &Found, out: &mut String) -> Result<(), Error> {
    writeln!(
        out,
        "## Detail of normals ([N09] §4.3, Fig. 11)\n\n\
         A ball in front of a wall, both with bumps in the normals of the G-buffer up to 25 degrees, {} × {} pixels, light from one side, refined by geometry alone.\n\
         Nodes store vector irradiance, or the irradiance at their own normal ([N09]), which Eq. (3) with α = 0.5 can modulate. The subsplats are the same.\n\n\
         | threshold of the normal | fraction | stored at nodes | FLIP | NRMSE |\n\
         |---|---|---|---|---|",
        SMALL[0], SMALL[1]
    )?;
    for b in &found.bumpy {
        let content = match b.content {
            NodeContent::Vectors => "vectors".to_string(),
            NodeContent::Scalars => "scalars".to_string(),
            NodeContent::Darkened(alpha) => format!("scalars, Eq. (3), α = {alpha}"),
        };
        writeln!(
            out,
            "| {} | 1/{:.1} | {content} | {:.4} | {} |",
            b.normal,
            1.0 / b.measured.evaluations_per_pixel(),
            b.measured.flip,
            percent(b.measured.nrmse)
        )?;
    }
    Ok(())
}
