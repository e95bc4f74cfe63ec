//! Charts: errors against the number of points, and the curves B(ζ), D(u) of [V11] Figures 11-13
//! for every basis and density.

use super::{Experiment, SHOWN_SPACING, slug};
use glam::DVec3;
use meshless_gi_lab::accuracy::SurfaceField;
use meshless_gi_lab::accuracy::{
    Axis, Basis, Chart, ComparisonRow, Format, PointSet, Quantity, Series, Site, Solution, Style,
    exact_samples,
};
use std::error::Error;
use std::f64::consts::TAU;

/// Bases of the charts that show several, in the order of their colors. The widest Gaussians exceed
/// every frame and have their own charts.
const SEVERAL: [Basis; 6] = [
    Basis::FlatVector,
    Basis::Shepard,
    Basis::HalfGaussian,
    Basis::Lehtinen,
    Basis::LehtinenLevels,
    Basis::NarrowGaussian,
];
/// Number of positions of a curve.
const STEPS: usize = 320;
/// Number of azimuths of a mean.
const AZIMUTHS: usize = 48;
/// Azimuth of a single line, in turns.
const LINE_AZIMUTH: f64 = 0.13;

/// One of the four curves of the paper's figures.
#[derive(Clone, Copy)]
struct Curve {
    name: &'static str,
    /// Label of the axis, with the unit.
    what: &'static str,
    sphere: bool,
    /// Channel of the samples.
    channel: usize,
}

const CURVES: [Curve; 4] = [
    Curve {
        name: "B",
        what: "radiosity B of the sphere",
        sphere: true,
        channel: 0,
    },
    Curve {
        name: "B_reflected",
        what: "reflected light B⁺ of the sphere",
        sphere: true,
        channel: 1,
    },
    Curve {
        name: "D",
        what: "radiosity D of the disk",
        sphere: false,
        channel: 0,
    },
    Curve {
        name: "D_reflected",
        what: "reflected light D⁺ of the disk",
        sphere: false,
        channel: 1,
    },
];

impl Curve {
    /// Returns the positions of the curve's points along the axis, in degrees or meters.
    fn positions(self, solution: &Solution) -> Vec<f64> {
        let (from, to) = if self.sphere {
            (-90.0, 90.0)
        } else {
            (0.0, solution.scene.disk)
        };
        let at = |k: usize| from + (to - from) * (k as f64 + 0.5) / STEPS as f64;
        (0..STEPS).map(at).collect()
    }

    fn truth(self, solution: &Solution, at: f64) -> f64 {
        let site = if self.sphere {
            Site::Sphere(at.to_radians())
        } else {
            Site::Disk(at)
        };
        match self.channel {
            0 => solution.total(site),
            _ => solution.indirect(site),
        }
    }

    /// Returns the field at a position of the axis and an azimuth in turns.
    fn value(self, solution: &Solution, field: &SurfaceField<'_>, at: f64, turns: f64) -> f64 {
        let (s, c) = (TAU * turns).sin_cos();
        let scene = &solution.scene;
        let (x, n) = if self.sphere {
            let (sine, cosine) = at.to_radians().sin_cos();
            let n = DVec3::new(cosine * c, sine, cosine * s);
            (n * scene.radius + DVec3::Y * scene.height, n)
        } else {
            (DVec3::new(at * c, 0.0, at * s), DVec3::Y)
        };
        field(x.as_vec3(), n.as_vec3()).map_or(f64::NAN, |v| v[self.channel])
    }

    fn axes(self, solution: &Solution) -> [Axis; 2] {
        let x = if self.sphere {
            "latitude ζ on the sphere, degrees (−90: lowest point)"
        } else {
            "distance u from the middle of the disk, m"
        };
        let positions = self.positions(solution);
        let values = positions.iter().map(|&at| self.truth(solution, at));
        let max = values.fold(0.0f64, f64::max);
        let mut axes = [
            Axis::linear(x, Format::Number),
            Axis::linear(format!("{}, W/m²", self.what), Format::Number),
        ];
        axes[0].range = Some(if self.sphere {
            (-90.0, 90.0)
        } else {
            (0.0, solution.scene.disk)
        });
        // Oscillations beyond this range are cut off.
        axes[1].range = Some((-0.25 * max, 1.35 * max));
        axes
    }

    fn reference(self, solution: &Solution) -> Series {
        let positions = self.positions(solution);
        let points = positions.iter().map(|&at| (at, self.truth(solution, at)));
        Series::new("solution", Style::Line, points)
    }
}

fn spacing_text(set: &PointSet) -> String {
    let points = set.points(Basis::FlatVector).len();
    format!("points at least {} m apart ({points} of them)", set.spacing)
}

/// Writes all charts. `all` includes those that the document does not show.
pub fn write(made: &Experiment, all: bool) -> Result<(), Box<dyn Error>> {
    let folder = made.folder.join("v11");
    for quantity in [Quantity::Total, Quantity::Indirect, Quantity::Noisy] {
        for sphere in [true, false] {
            let name = format!(
                "error_{}_{}.svg",
                match quantity {
                    Quantity::Total => "total",
                    Quantity::Indirect => "reflected",
                    _ => "noisy",
                },
                if sphere { "sphere" } else { "disk" }
            );
            std::fs::write(folder.join(name), errors(made, quantity, sphere).svg())?;
        }
    }
    for set in &made.sets {
        let mut fields = Vec::new();
        for basis in Basis::ALL {
            fields.push((basis, set.build(basis)?));
        }
        let mut fitted = Vec::new();
        for (basis, built) in &fields {
            let samples = exact_samples(&made.solution, &set.points(*basis), 1);
            fitted.push((*basis, built.fit(&samples)?));
        }
        for curve in CURVES {
            if set.spacing == SHOWN_SPACING || all {
                let name = format!("{}_{}.svg", curve.name, set.spacing);
                let path = if set.spacing == SHOWN_SPACING {
                    folder.join(name)
                } else {
                    folder.join("all").join(name)
                };
                std::fs::write(path, several(made, set, curve, &fitted).svg())?;
            }
            for (basis, field) in fitted.iter().filter(|_| all) {
                let name = format!("{}_{}_{}.svg", curve.name, set.spacing, slug(*basis));
                let chart = single(made, set, curve, *basis, field);
                std::fs::write(folder.join("all").join(name), chart.svg())?;
            }
        }
    }
    Ok(())
}

/// Returns the chart of the error against the number of points.
fn errors(made: &Experiment, quantity: Quantity, sphere: bool) -> Chart {
    let rmse = |r: &ComparisonRow| if sphere { r.sphere.rmse } else { r.disk.rmse };
    let series = SEVERAL
        .iter()
        .chain(&[Basis::CorrectedFlatVector])
        .map(|&basis| {
            let own = made.rows.iter();
            let own = own.filter(|r| r.basis == basis && r.quantity == quantity);
            let points = own.map(|r| (r.points as f64, rmse(r)));
            Series::new(basis.name(), Style::LineAndPoints, points)
        });
    let surface = if sphere { "sphere" } else { "disk" };
    let mut y = Axis::log(
        "root mean square error / root mean square of the light",
        Format::Percent,
    );
    y.range = Some((0.002, 3.0));
    Chart {
        title: format!(
            "{} on the {surface}: error against samples",
            match quantity {
                Quantity::Total => "Direct and reflected light",
                Quantity::Indirect => "Reflected light",
                _ => "Reflected light with noise of 5 % in the samples",
            }
        ),
        caption: format!(
            "Sphere over a disk, samples of {} at Poisson-disk points; median over five point sets. Lower is better.",
            if quantity == Quantity::Noisy {
                "the light with noise"
            } else {
                "the exact light"
            }
        ),
        x: Axis::log(
            "points with a sample, on sphere and disk together",
            Format::Number,
        ),
        y,
        series: series.collect(),
        ..Chart::default()
    }
}

/// Returns the curves of several bases at one azimuth.
fn several(
    made: &Experiment,
    set: &PointSet,
    curve: Curve,
    fields: &[(Basis, SurfaceField<'_>)],
) -> Chart {
    let solution = &made.solution;
    let [x, y] = curve.axes(solution);
    let mut series: Vec<Series> = SEVERAL
        .iter()
        .filter_map(|&basis| fields.iter().find(|f| f.0 == basis))
        .map(|(basis, field)| {
            let positions = curve.positions(solution);
            let points = positions
                .iter()
                .map(|&at| (at, curve.value(solution, field, at, LINE_AZIMUTH)));
            Series::new(basis.name(), Style::Line, points)
        })
        .collect();
    series.push(curve.reference(solution));
    Chart {
        title: format!("{}{}", curve.what[..1].to_uppercase(), &curve.what[1..]),
        caption: format!(
            "Along one {}, {}; samples of the exact light. What leaves the frame is cut off.",
            if curve.sphere { "meridian" } else { "ray" },
            spacing_text(set)
        ),
        x,
        y,
        series,
        ..Chart::default()
    }
}

/// Returns one basis at one azimuth and the mean over all, as in the figures of [V11].
fn single(
    made: &Experiment,
    set: &PointSet,
    curve: Curve,
    basis: Basis,
    field: &SurfaceField<'_>,
) -> Chart {
    let solution = &made.solution;
    let [x, y] = curve.axes(solution);
    let positions = curve.positions(solution);
    let line = positions
        .iter()
        .map(|&at| (at, curve.value(solution, field, at, LINE_AZIMUTH)));
    let mean = positions.iter().map(|&at| {
        let turns = (0..AZIMUTHS).map(|k| (k as f64 + 0.37) / AZIMUTHS as f64);
        let sum: f64 = turns.map(|t| curve.value(solution, field, at, t)).sum();
        (at, sum / AZIMUTHS as f64)
    });
    Chart {
        title: format!("{}: {}", basis.name(), curve.what),
        caption: format!(
            "{}; samples of the exact light. What leaves the frame is cut off.",
            spacing_text(set)
        ),
        x,
        y,
        series: vec![
            Series::new("one azimuth", Style::Line, line),
            Series::new("mean of all azimuths", Style::Line, mean),
            curve.reference(solution),
        ],
        ..Chart::default()
    }
}
