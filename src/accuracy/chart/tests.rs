//! What a chart's text must be, whatever is drawn.

use super::*;

/// Numbers of all attributes that hold coordinates.
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

/// Objects to text that is no XML: tags that do not close in order, bare ampersands, attributes without quotes.
fn check_xml(text: &str) -> Result<(), String> {
    let mut open: Vec<&str> = Vec::new();
    let mut rest = text.trim_end();
    while let Some(at) = rest.find('<') {
        let (content, tag) = rest.split_at(at);
        for part in content.split('&').skip(1) {
            let name = part.split_once(';').map(|p| p.0);
            if !matches!(name, Some("amp" | "lt" | "gt" | "quot")) {
                return Err(format!("a bare ampersand: {part}"));
            }
        }
        let end = tag.find('>').ok_or("a tag without an end")?;
        let body = &tag[1..end];
        if body.matches('"').count() % 2 == 1 || body[1..].contains('<') {
            return Err(format!("odd quotes: {body}"));
        }
        let name = body.trim_start_matches('/').split([' ', '/']).next();
        let name = name.unwrap_or_default();
        if body.starts_with('/') {
            if open.pop() != Some(name) {
                return Err(format!("{name} closes what is not open"));
            }
        } else if !body.ends_with('/') {
            open.push(name);
        }
        rest = &tag[end + 1..];
        if open.is_empty() && !rest.is_empty() {
            return Err(format!("more than one root: {rest}"));
        }
    }
    match open.is_empty() && rest.is_empty() {
        true => Ok(()),
        false => Err(format!("left open: {open:?}, {rest}")),
    }
}

fn example() -> Chart {
    Chart {
        title: "Error & <time> of a \"bake\"\u{1}".into(),
        caption: "two series; what is less is better".into(),
        x: Axis::log("bake time, s", Format::Number),
        y: Axis::log("error", Format::Percent),
        series: vec![
            Series {
                points: vec![
                    Mark::new(1.0, 0.2).labelled("draft <1>"),
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
fn a_chart_is_xml_with_all_that_was_asked_for() {
    let svg = example().svg();
    check_xml(&svg).unwrap();
    for word in [
        "Error &amp; &lt;time&gt; of a &quot;bake&quot;</text>",
        "draft &lt;1&gt;",
        "bake time, s",
        "15 %",
        "#ffffff",
        ">ours<",
    ] {
        assert!(svg.contains(word), "no {word} in {svg}");
    }
    assert!(!svg.contains("far") && !svg.contains("not shown") && !svg.contains("no data"));
    // The front goes over, then down.
    let front = svg.lines().find(|l| l.contains("stroke-opacity=\"0.55\""));
    let front = front.expect("a front");
    assert!(front.contains('H') && front.contains('V') && front.contains("#0072b2"));
    assert_eq!(svg, example().svg());
    // The check itself objects.
    let bad = [
        "<a><b></a></b>",
        "<a>x & y</a>",
        "<a x=\"1></a>",
        "<a/><b/>",
        "<a>",
    ];
    assert!(bad.iter().all(|text| check_xml(text).is_err()));
}

#[test]
fn places_are_where_the_axes_say() {
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
    // The last is the legend's.
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
fn no_number_is_no_coordinate() {
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
            check_xml(&svg).unwrap();
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
        check_xml(&svg).unwrap();
        assert!(svg.contains("no data"));
        assert!(numbers(&svg).iter().all(|v| v.is_finite()));
    }
}
