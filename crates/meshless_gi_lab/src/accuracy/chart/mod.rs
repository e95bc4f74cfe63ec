//! Charts as SVG text: measurements and curves on linear or logarithmic axes, readable in light and
//! dark viewers.
//!
//! A chart is data; [`Chart::svg`] draws it. The same data gives the same text, with coordinates to
//! a tenth of a pixel, so that charts in a repository differ by what was measured. Colors are those
//! of Okabe and Ito, which are distinct with any kind of color vision, and each series has its
//! own marker as well. What cannot be drawn (a number that is none, nothing or less on a
//! logarithmic axis) is left out and counted below the chart.

mod axis;
mod labels;
mod svg;

pub use axis::{Axis, Format, Scale};

/// A chart.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Chart {
    /// Headline.
    pub title: String,
    /// A line below it: what was measured, and how to read it. May be empty.
    pub caption: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// Series in drawing order: later ones cover earlier ones.
    pub series: Vec<Series>,
    /// Horizontal lines to compare with: their height on the y axis, and what to write on them, if
    /// anything.
    pub guides: Vec<(f64, String)>,
}

/// One series of a chart, with its own color, marker and entry in the legend.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Series {
    /// The legend's text.
    pub name: String,
    /// Drawing style.
    pub style: Style,
    /// Its positions, in the order in which a line joins them.
    pub points: Vec<Mark>,
    /// Color and marker of the series of this number, instead of its own: for a front or a fit that
    /// belongs to another series.
    pub like: Option<usize>,
}

/// A position on a chart.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mark {
    /// On the horizontal axis.
    pub x: f64,
    /// On the vertical axis.
    pub y: f64,
    /// Written beside it, where that is not empty and there is room.
    pub label: String,
    /// Shown by viewers that show such things when the pointer rests on the marker; the label,
    /// where this is empty.
    pub hint: String,
}

/// Drawing style of a series.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Style {
    /// Markers.
    #[default]
    Points,
    /// A line.
    Line,
    /// A line with markers.
    LineAndPoints,
    /// A Pareto front: steps that bound what is not better anywhere, with a ring around each
    /// position. Give it the positions of the front alone, see [`super::pareto_front`].
    Front,
}

impl Mark {
    /// A position without a label.
    #[must_use]
    pub fn new(x: f64, y: f64) -> Self {
        Self {
            x,
            y,
            ..Self::default()
        }
    }

    /// The same position with a label.
    #[must_use]
    pub fn labeled(self, label: impl Into<String>) -> Self {
        Self {
            label: label.into(),
            ..self
        }
    }
}

impl Series {
    /// A series of positions without labels.
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
    /// The chart as an SVG document.
    #[must_use]
    pub fn svg(&self) -> String {
        svg::draw(self)
    }
}

#[cfg(test)]
mod tests;
