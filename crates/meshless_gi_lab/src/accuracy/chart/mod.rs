//! Charts as SVG text: measurements and curves on linear or logarithmic axes, readable in light and
//! dark viewers.
//!
//! [`Chart`] holds the data, and [`Chart::svg`] draws them. The same data give the same text, and
//! coordinates are rounded to a tenth of a pixel. Charts in a repository then change only if the
//! measurements do. The colors are those of Okabe and Ito, which are distinct with any kind of
//! color vision. Each series has its own marker as well. Points that cannot be drawn are left out
//! and counted below the chart. Examples are NaN, and numbers of at most 0 on a logarithmic axis.

mod axis;
mod labels;
mod svg;

pub use axis::{Axis, Format, Scale};

/// Chart with axes and series.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Chart {
    /// Title.
    pub title: String,
    /// Caption below the title: the measured quantities and advice for reading. May be empty.
    pub caption: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// Series in drawing order: later ones cover earlier ones.
    pub series: Vec<Series>,
    /// Horizontal guide lines: height on the y axis, and label, which may be empty.
    pub guides: Vec<(f64, String)>,
}

/// Series of a chart with its own color, marker and entry in the legend.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Series {
    /// Text of the legend.
    pub name: String,
    /// Drawing style.
    pub style: Style,
    /// Points in the order in which a line joins them.
    pub points: Vec<Mark>,
    /// Index of the series whose color and marker are used, such as for a front or a fit of that
    /// series. `None` means its own color and marker.
    pub like: Option<usize>,
}

/// Point of a series.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mark {
    /// Coordinate on the horizontal axis.
    pub x: f64,
    /// Coordinate on the vertical axis.
    pub y: f64,
    /// Text next to the point. It is drawn if it is not empty and there is enough space.
    pub label: String,
    /// Tooltip of the marker in viewers that support it. If it is empty, the label is used.
    pub hint: String,
}

/// Drawing style of a series.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Style {
    /// Markers only.
    #[default]
    Points,
    /// Line without markers.
    Line,
    /// Line with markers.
    LineAndPoints,
    /// Pareto front: steps that bound the dominated region, with a ring around each point. All
    /// points must be on the front. See [`super::pareto_front`].
    Front,
}

impl Mark {
    /// Creates a point without a label.
    #[must_use]
    pub fn new(x: f64, y: f64) -> Self {
        Self {
            x,
            y,
            ..Self::default()
        }
    }

    /// Returns the point with a label.
    #[must_use]
    pub fn labeled(self, label: impl Into<String>) -> Self {
        Self {
            label: label.into(),
            ..self
        }
    }
}

impl Series {
    /// Creates a series of points without labels.
    #[must_use]
    pub fn new(
        name: impl Into<String>,
        style: Style,
        points: impl IntoIterator<Item = (f64, f64)>,
    ) -> Self {
        Self {
            name: name.into(),
            style,
            points: points.into_iter().map(|(x, y)| Mark::new(x, y)).collect(),
            like: None,
        }
    }
}

impl Chart {
    /// Returns the chart as an SVG document.
    #[must_use]
    pub fn svg(&self) -> String {
        svg::draw(self)
    }
}

#[cfg(test)]
mod tests;
