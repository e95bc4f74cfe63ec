//! Tests of the SVG text of charts.

use super::*;

/// Returns the numbers of all attributes that hold coordinates.
fn numbers(svg: &str) -> Vec<f64> {
    let mut found = Vec::new();
    for name in ["d", "points", "x", "y", "cx", "cy", "width", "height"] {
        for part in svg.split(&format!(" {name}=\"")).skip(1) {
            let value = part.split('"').next().unwrap_or_default();
            let words = value.split(|c: char| " ,MLHVZ".contains(c));
            found.extend(words.filter(|w| !w.is_empty()).map(|w| {
                w.parse::<f64>()
                    .unwrap_or_else(|_| panic!("`{w}` in {name}=\"{value}\""))
            }));
        }
    }
    found
}

/// Returns the texts of a document. Panics if it is not XML.
fn texts(svg: &str) -> Vec<String> {
    let document = roxmltree::Document::parse(svg).unwrap_or_else(|error| panic!("{error}: {svg}"));
    assert_eq!(document.root_element().tag_name().name(), "svg");
    let nodes = document.descendants().filter(roxmltree::Node::is_text);
    nodes
        .filter_map(|n| n.text())
        .map(|t| t.trim().to_string())
        .collect()
}

fn example() -> Chart {
    Chart {
        title: "Error & <time> of a \"bake\"\u{1}".into(),
        caption: "two series; lower is better".into(),
        x: Axis::log("bake time, s", Format::Number),
        y: Axis::log("error", Format::Percent),
        series: vec![
            Series {
                points: vec![
                    Mark::new(1.0, 0.2).labeled("draft <1>"),
                    Mark::new(3.0, 0.1),
                    Mark::new(9.0, 0.12),
                ],
                ..Series::new("ours", Style::Points, [])
            },
            Series::new("a line", Style::LineAndPoints, [(2.0, 0.3), (4.0, 0.2)]),
            Series {
                like: Some(0),
                ..Series::new("front", Style::Front, [(1.0, 0.2), (3.0, 0.1)])
            },
        ],
        guides: vec![(0.15, "15 %".into()), (99.0, "far".into())],
    }
}

#[test]
fn chart_is_valid_xml_with_all_series() {
    let svg = example().svg();
    let texts_of = texts(&svg);
    for word in [
        "Error & <time> of a \"bake\"",
        "draft <1>",
        "bake time, s",
        "15 %",
        "ours",
    ] {
        assert!(
            texts_of.iter().any(|t| t == word),
            "no {word}: {texts_of:?}"
        );
    }
    assert!(svg.contains("#ffffff"));
    assert!(!svg.contains("far") && !svg.contains("not shown") && !svg.contains("no data"));
    // The front is drawn horizontally, then vertically.
    let front = svg.lines().find(|l| l.contains("stroke-opacity=\"0.55\""));
    let front = front.expect("a front");
    assert!(front.contains('H') && front.contains('V') && front.contains("#0072b2"));
    assert_eq!(svg, example().svg());
}

#[test]
fn chart_positions_match_axes() {
    let chart = Chart {
        series: vec![Series::new(
            "a",
            Style::Points,
            [(0.0, 0.0), (1.0, 1.0), (0.5, 0.25)],
        )],
        x: Axis {
            range: Some((0.0, 1.0)),
            ..Axis::default()
        },
        y: Axis {
            range: Some((0.0, 1.0)),
            ..Axis::default()
        },
        ..Chart::default()
    };
    let svg = chart.svg();
    let at: Vec<&str> = svg
        .lines()
        .filter(|l| l.starts_with("<circle"))
        .map(|l| l.split(" r=").next().unwrap_or_default())
        .collect();
    // The last marker belongs to the legend.
    assert_eq!(
        at[..3],
        [
            "<circle cx=\"82.0\" cy=\"486.0\"",
            "<circle cx=\"694.0\" cy=\"72.0\"",
            "<circle cx=\"388.0\" cy=\"382.5\""
        ]
    );
}

#[test]
fn chart_skips_nan_values() {
    let mut chart = example();
    let odd = [
        f64::NAN,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::MAX,
        -f64::MAX,
        0.0,
        -1.0,
        f64::MIN_POSITIVE,
        1e-90,
        1e90,
    ];
    for style in [Style::Line, Style::Points, Style::Front] {
        chart.series.push(Series::new(
            "odd",
            style,
            odd.iter().flat_map(|&x| odd.map(|y| (x, y))),
        ));
    }
    chart.series.push(Series::default());
    for scale in [Scale::Linear, Scale::Log] {
        (chart.x.scale, chart.y.scale) = (scale, scale);
        for range in [None, Some((0.5, 2.0)), Some((f64::NAN, 1.0))] {
            chart.x.range = range;
            let svg = chart.svg();
            texts(&svg);
            let all = numbers(&svg);
            assert!(all.len() > 100 && all.iter().all(|v| v.abs() < 1e5));
            assert!(svg.contains("not shown") && svg.contains("(no data)"));
        }
    }
    for chart in [
        Chart::default(),
        Chart {
            series: vec![Series::new("none", Style::Line, [(f64::NAN, 0.0)])],
            ..Chart::default()
        },
    ] {
        let svg = chart.svg();
        texts(&svg);
        assert!(svg.contains("no data"));
        assert!(numbers(&svg).iter().all(|v| v.is_finite()));
    }
}
