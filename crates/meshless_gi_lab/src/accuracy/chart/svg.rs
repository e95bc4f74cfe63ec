//! SVG output of a chart.

use super::axis::Fitted;
use super::labels::{self, Area};
use super::{Chart, Mark, Series, Style};
use std::fmt::Write;

/// Size of the image, pixels.
const SIZE: (f64, f64) = (900.0, 560.0);
/// Width of the legend on the right, pixels.
const LEGEND: f64 = 190.0;
/// Frame of the data, pixels: left, top, right, bottom.
const FRAME: Area = Area(82.0, 72.0, SIZE.0 - LEGEND - 16.0, SIZE.1 - 74.0);
/// Colors that are distinct with any kind of color vision, after Okabe and Ito. Their yellow is
/// left out, because it is too light on white.
const COLORS: [&str; 7] = [
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000",
];
/// Dash patterns that distinguish lines without color.
const DASHES: [&str; 4] = ["", "7 3", "2 3", "9 3 2 3"];
const INK: &str = "#222222";
const FAINT: &str = "#666666";

/// Series with positions in the image.
struct Placed<'a> {
    series: &'a Series,
    style_index: usize,
    /// Positions of its points. `None` for points that cannot be shown.
    at: Vec<Option<(f64, f64)>>,
}

/// Returns the chart as an SVG document.
pub fn draw(chart: &Chart) -> String {
    let all = || chart.series.iter().flat_map(|s| &s.points);
    // Points that one axis cannot show do not affect the range of the other.
    let probe = |axis| Fitted::new(axis, std::iter::empty());
    let (any_x, any_y) = (probe(&chart.x), probe(&chart.y));
    let shown = |m: &&Mark| any_x.at(m.x).is_some() && any_y.at(m.y).is_some();
    let x = Fitted::new(&chart.x, all().filter(shown).map(|m| m.x));
    let y = Fitted::new(&chart.y, all().filter(shown).map(|m| m.y));
    let across = |t: f64| FRAME.0 + t * (FRAME.2 - FRAME.0);
    let up = |t: f64| FRAME.3 - t * (FRAME.3 - FRAME.1);
    // Clamps coordinates far outside of the frame, which keeps the numbers short.
    let position_of = |m: &Mark| {
        let far = |t: f64| t.clamp(-20.0, 20.0);
        Some((across(far(x.at(m.x)?)), up(far(y.at(m.y)?))))
    };
    let placed: Vec<Placed> = chart
        .series
        .iter()
        .enumerate()
        .map(|(i, series)| Placed {
            series,
            style_index: series.like.unwrap_or(i),
            at: series.points.iter().map(position_of).collect(),
        })
        .collect();

    let mut out = String::new();
    head(&mut out, chart);
    grid(&mut out, &x, &y, across, up);
    words(&mut out, chart);
    guides(&mut out, chart, &y, up);
    let _ = writeln!(out, "<g clip-path=\"url(#frame)\">");
    for p in &placed {
        line(&mut out, p);
    }
    let _ = writeln!(out, "</g>");
    for p in &placed {
        markers(&mut out, p);
    }
    texts(&mut out, &placed);
    legend(&mut out, &placed);
    foot(&mut out, &placed);
    out += "</svg>\n";
    out
}

/// Formats a coordinate to a tenth of a pixel.
fn n(v: f64) -> String {
    // Adding zero turns −0 into 0.
    format!("{:.1}", (v * 10.0).round() / 10.0 + 0.0)
}

/// Escapes text for XML and removes characters that XML does not allow.
fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out += "&amp;",
            '<' => out += "&lt;",
            '>' => out += "&gt;",
            '"' => out += "&quot;",
            '\n' | '\t' => out.push(' '),
            c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => {}
            c => out.push(c),
        }
    }
    out
}

fn text(out: &mut String, (x, y): (f64, f64), size: f64, extra: &str, content: &str) {
    let _ = writeln!(
        out,
        "<text x=\"{}\" y=\"{}\" font-size=\"{size}\"{extra}>{}</text>",
        n(x),
        n(y),
        escaped(content)
    );
}

fn head(out: &mut String, chart: &Chart) {
    let (w, h) = SIZE;
    let Area(left, top, right, bottom) = FRAME;
    let _ = writeln!(
        out,
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {w} {h}\" width=\"{w}\" height=\"{h}\" role=\"img\" \
         font-family=\"Helvetica, Arial, 'DejaVu Sans', sans-serif\" fill=\"{INK}\">\n\
         <title>{}</title>\n<desc>{}</desc>\n\
         <clipPath id=\"frame\"><rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\"/></clipPath>\n\
         <rect width=\"{w}\" height=\"{h}\" fill=\"#ffffff\"/>",
        escaped(&chart.title),
        escaped(&chart.caption),
        n(left),
        n(top),
        n(right - left),
        n(bottom - top)
    );
}

/// Draws the grid lines and texts of the ticks, and the frame.
fn grid(
    out: &mut String,
    x: &Fitted,
    y: &Fitted,
    across: impl Fn(f64) -> f64,
    up: impl Fn(f64) -> f64,
) {
    let Area(left, top, right, bottom) = FRAME;
    let color = |name: &str| {
        if name.is_empty() {
            "#f2f2f2"
        } else {
            "#dddddd"
        }
    };
    let mut names = String::new();
    for (axis, horizontal) in [(x, true), (y, false)] {
        for (v, name) in &axis.ticks {
            let Some(t) = axis.at(*v) else { continue };
            let (path, at, anchor) = if horizontal {
                let p = across(t);
                (
                    format!("M{} {}V{}", n(p), n(top), n(bottom)),
                    (p, bottom + 18.0),
                    "middle",
                )
            } else {
                let p = up(t);
                (
                    format!("M{} {}H{}", n(left), n(p), n(right)),
                    (left - 8.0, p + 4.0),
                    "end",
                )
            };
            let _ = writeln!(
                out,
                "<path d=\"{path}\" stroke=\"{}\" fill=\"none\"/>",
                color(name)
            );
            if !name.is_empty() {
                text(
                    &mut names,
                    at,
                    12.0,
                    &format!(" text-anchor=\"{anchor}\""),
                    name,
                );
            }
        }
    }
    let _ = writeln!(
        out,
        "<path d=\"M{} {}V{}H{}\" stroke=\"{INK}\" fill=\"none\"/>",
        n(left),
        n(top),
        n(bottom),
        n(right)
    );
    *out += &names;
}

/// Draws the title, the caption and the names of the axes.
fn words(out: &mut String, chart: &Chart) {
    let Area(left, top, right, bottom) = FRAME;
    text(
        out,
        (16.0, 28.0),
        17.0,
        " font-weight=\"bold\"",
        &chart.title,
    );
    let faint = format!(" fill=\"{FAINT}\"");
    text(out, (16.0, 49.0), 12.5, &faint, &chart.caption);
    let middle = 0.5 * (left + right);
    text(
        out,
        (middle, bottom + 42.0),
        13.5,
        " text-anchor=\"middle\"",
        &chart.x.label,
    );
    let (x, y) = (22.0, 0.5 * (top + bottom));
    let turned = format!(
        " text-anchor=\"middle\" transform=\"rotate(-90 {} {})\"",
        n(x),
        n(y)
    );
    text(out, (x, y), 13.5, &turned, &chart.y.label);
}

fn guides(out: &mut String, chart: &Chart, y: &Fitted, up: impl Fn(f64) -> f64) {
    for (height, name) in &chart.guides {
        let Some(t) = y.at(*height).filter(|t| (0.0..=1.0).contains(t)) else {
            continue;
        };
        let _ = writeln!(
            out,
            "<path d=\"M{} {}H{}\" stroke=\"#999999\" stroke-dasharray=\"4 4\" fill=\"none\"/>",
            n(FRAME.0),
            n(up(t)),
            n(FRAME.2)
        );
        let faint = format!(" fill=\"{FAINT}\"");
        if !name.is_empty() {
            text(out, (FRAME.0 + 5.0, up(t) - 4.0), 11.0, &faint, name);
        }
    }
}

fn color(style_index: usize) -> &'static str {
    COLORS[style_index % COLORS.len()]
}

/// Draws the line of a series if it has one.
fn line(out: &mut String, placed: &Placed) {
    if placed.series.style == Style::Points {
        return;
    }
    let front = placed.series.style == Style::Front;
    let mut path = String::new();
    let mut before = false;
    for at in &placed.at {
        match at {
            None => before = false,
            Some((x, y)) if !before => {
                let _ = write!(path, "M{} {}", n(*x), n(*y));
                before = true;
            }
            // A front is a step function: constant up to the next point.
            Some((x, y)) if front => {
                let _ = write!(path, "H{}V{}", n(*x), n(*y));
            }
            Some((x, y)) => {
                let _ = write!(path, "L{} {}", n(*x), n(*y));
            }
        }
    }
    if path.is_empty() {
        return;
    }
    let dash = match (front, DASHES[placed.style_index / 2 % DASHES.len()]) {
        (false, dash) if !dash.is_empty() => format!(" stroke-dasharray=\"{dash}\""),
        _ => String::new(),
    };
    let (width, opacity) = if front { (2.0, 0.55) } else { (1.8, 1.0) };
    let _ = writeln!(
        out,
        "<path d=\"{path}\" stroke=\"{}\" stroke-width=\"{width}\" stroke-opacity=\"{opacity}\" stroke-linejoin=\"round\" fill=\"none\"{dash}/>",
        color(placed.style_index)
    );
}

/// Returns `true` if a position lies within the frame or on its edge.
fn inside((x, y): (f64, f64)) -> bool {
    let Area(left, top, right, bottom) = FRAME;
    (left - 0.5..=right + 0.5).contains(&x) && (top - 0.5..=bottom + 0.5).contains(&y)
}

fn markers(out: &mut String, placed: &Placed) {
    if placed.series.style == Style::Line {
        return;
    }
    for (mark, at) in placed.series.points.iter().zip(&placed.at) {
        if let Some(at) = at.filter(|at| inside(*at)) {
            let hint = match mark.hint.as_str() {
                "" => &mark.label,
                hint => hint,
            };
            marker(out, placed.series.style, placed.style_index, at, hint);
        }
    }
}

/// Draws a marker. Each style index has its own shape.
fn marker(out: &mut String, style: Style, style_index: usize, (x, y): (f64, f64), hint: &str) {
    let color = color(style_index);
    let r = 5.0;
    let polygon = |corners: &[(f64, f64)]| {
        let at: Vec<String> = corners
            .iter()
            .map(|(a, b)| format!("{},{}", n(x + a * r), n(y + b * r)))
            .collect();
        format!("polygon points=\"{}\"", at.join(" "))
    };
    let shape = match (style, style_index % 7) {
        (Style::Front, _) => format!("circle cx=\"{}\" cy=\"{}\" r=\"9\"", n(x), n(y)),
        (_, 0) => format!("circle cx=\"{}\" cy=\"{}\" r=\"{r}\"", n(x), n(y)),
        (_, 1) => polygon(&[(-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9)]),
        (_, 2) => polygon(&[(0.0, -1.2), (1.1, 0.9), (-1.1, 0.9)]),
        (_, 3) => polygon(&[(0.0, -1.3), (1.3, 0.0), (0.0, 1.3), (-1.3, 0.0)]),
        (_, 4) => polygon(&[(0.0, 1.2), (1.1, -0.9), (-1.1, -0.9)]),
        (_, 5) => polygon(&[
            (-0.4, -1.2),
            (0.4, -1.2),
            (0.4, -0.4),
            (1.2, -0.4),
            (1.2, 0.4),
            (0.4, 0.4),
            (0.4, 1.2),
            (-0.4, 1.2),
            (-0.4, 0.4),
            (-1.2, 0.4),
            (-1.2, -0.4),
            (-0.4, -0.4),
        ]),
        _ => polygon(&[(-1.2, -0.5), (1.2, -0.5), (1.2, 0.5), (-1.2, 0.5)]),
    };
    let paint = match style {
        Style::Front => format!("fill=\"none\" stroke=\"{color}\" stroke-width=\"1.6\""),
        _ => format!("fill=\"{color}\" stroke=\"#ffffff\" stroke-width=\"0.8\""),
    };
    let name = shape.split(' ').next().unwrap_or_default();
    let _ = match hint {
        "" => writeln!(out, "<{shape} {paint}/>"),
        hint => writeln!(
            out,
            "<{shape} {paint}><title>{}</title></{name}>",
            escaped(hint)
        ),
    };
}

/// Draws the labels of the points.
fn texts(out: &mut String, placed: &[Placed]) {
    let mut taken: Vec<Area> = placed
        .iter()
        .filter(|p| p.series.style != Style::Line)
        .flat_map(|p| p.at.iter().flatten())
        .filter(|at| inside(**at))
        .map(|at| Area::from_center(*at, 6.0))
        .collect();
    // Thin boxes around the steps of fronts.
    for p in placed.iter().filter(|p| p.series.style == Style::Front) {
        for pair in p.at.windows(2) {
            if let [Some((x0, y0)), Some((x1, y1))] = *pair {
                taken.push(Area(x0, y0 - 1.0, x1, y0 + 1.0));
                taken.push(Area(x1 - 1.0, y0.min(y1), x1 + 1.0, y0.max(y1)));
            }
        }
    }
    for p in placed {
        for (mark, at) in p.series.points.iter().zip(&p.at) {
            let Some(at) = at.filter(|at| inside(*at) && !mark.label.is_empty()) else {
                continue;
            };
            let Some(at) = labels::put(&mark.label, at, &FRAME, &mut taken) else {
                continue;
            };
            // A white outline keeps them readable over lines.
            let rim = " paint-order=\"stroke\" stroke=\"#ffffff\" stroke-width=\"3\" stroke-linejoin=\"round\"";
            text(out, at, labels::HEIGHT, rim, &mark.label);
        }
    }
}

fn legend(out: &mut String, placed: &[Placed]) {
    let left = SIZE.0 - LEGEND;
    let max = LEGEND - 48.0;
    let mut y = FRAME.1 + 10.0;
    for p in placed {
        let style = p.series.style;
        if style != Style::Points {
            let sample = Placed {
                series: p.series,
                style_index: p.style_index,
                at: vec![Some((left, y)), Some((left + 28.0, y))],
            };
            line(out, &sample);
        }
        if style != Style::Line {
            marker(out, style, p.style_index, (left + 14.0, y), "");
        }
        let empty = !p.at.iter().any(Option::is_some);
        let name = format!("{}{}", p.series.name, if empty { " (no data)" } else { "" });
        for part in wrapped(&name, max, 12.0) {
            text(out, (left + 38.0, y + 4.0), 12.0, "", &part);
            y += 16.0;
        }
        y += 6.0;
    }
}

/// Wraps `text` at its spaces into lines of at most `max` pixels.
fn wrapped(text: &str, max: f64, size: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split(' ') {
        match lines.last_mut() {
            Some(line) if labels::width(&format!("{line} {word}"), size) <= max => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_string()),
        }
    }
    lines
}

/// Draws the number of missing points.
fn foot(out: &mut String, placed: &[Placed]) {
    let all = || placed.iter().flat_map(|p| &p.at);
    let missing = all().filter(|at| at.is_none()).count();
    let (x, y) = (SIZE.0 - 16.0, SIZE.1 - 10.0);
    let end = format!(" text-anchor=\"end\" fill=\"{FAINT}\"");
    if missing > 0 {
        let what = format!("{missing} not shown: no number, or not above 0 on a logarithmic axis");
        text(out, (x, y), 11.0, &end, &what);
    }
    if all().all(Option::is_none) {
        let middle = (0.5 * (FRAME.0 + FRAME.2), 0.5 * (FRAME.1 + FRAME.3));
        text(out, middle, 16.0, " text-anchor=\"middle\"", "no data");
    }
}
