//! Axes of a chart: range, ticks and their text.

/// Mapping of an axis from numbers to lengths.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scale {
    /// Linear scale: equal differences are equal lengths.
    #[default]
    Linear,
    /// Logarithmic scale: equal ratios are equal lengths. Numbers must be above 0.
    Log,
}

/// Number format of an axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Format {
    /// Plain numbers. Very large and very small ones have an exponent.
    #[default]
    Number,
    /// Fractions as percent: 0.05 is 5 %.
    Percent,
    /// Numbers with k, M and G for thousands, millions and billions.
    Si,
}

/// Axis of a chart.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Axis {
    /// Title with the unit: "bake time, s".
    pub label: String,
    /// Mapping from numbers to lengths.
    pub scale: Scale,
    /// Number format.
    pub format: Format,
    /// Range of the axis. Data beyond it are cut off. If it is `None` or invalid, the range of the
    /// data is used.
    pub range: Option<(f64, f64)>,
}

impl Axis {
    /// Creates a linear axis.
    #[must_use]
    pub fn linear(label: impl Into<String>, format: Format) -> Self {
        Self {
            label: label.into(),
            format,
            ..Self::default()
        }
    }

    /// Creates a logarithmic axis.
    #[must_use]
    pub fn log(label: impl Into<String>, format: Format) -> Self {
        Self {
            scale: Scale::Log,
            ..Self::linear(label, format)
        }
    }
}

/// Limit of the numbers on an axis. Larger numbers, and on a logarithmic axis those below its
/// inverse, are left out. No measurement reaches it, and differences stay finite.
const MAX: f64 = 1e100;

/// Axis fitted to its data.
#[derive(Clone, Debug)]
pub struct Fitted {
    scale: Scale,
    /// Ends of the axis, the smaller one first. They are logarithms on a logarithmic axis.
    ends: (f64, f64),
    /// Positions of the ticks and their text. A tick without text is small.
    pub ticks: Vec<(f64, String)>,
}

impl Fitted {
    /// Fits `axis` to the valid numbers of `data`.
    pub fn new(axis: &Axis, data: impl Iterator<Item = f64>) -> Self {
        let given = axis
            .range
            .map(|(a, b)| (measure(axis.scale, a), measure(axis.scale, b)));
        let (ends, fixed) = match given {
            Some((Some(a), Some(b))) if a < b => ((a, b), true),
            _ => (span(axis.scale, data), false),
        };
        let (ends, ticks) = match axis.scale {
            Scale::Linear => linear(ends, fixed),
            Scale::Log => (ends, log(ends)),
        };
        let plain: Vec<f64> = ticks.iter().filter(|t| t.1).map(|t| t.0).collect();
        let decimals = decimals(&plain, axis.format);
        let text = |v: f64| write(v, axis.format, axis.scale, decimals);
        let ticks = ticks
            .into_iter()
            .map(|(v, named)| (v, if named { text(v) } else { String::new() }))
            .collect();
        Self {
            scale: axis.scale,
            ends,
            ticks,
        }
    }

    /// Returns the relative position of `v` between the ends: 0 to 1 within them. Returns `None` if
    /// the axis cannot show `v`.
    pub fn at(&self, v: f64) -> Option<f64> {
        let (from, to) = self.ends;
        Some((measure(self.scale, v)? - from) / (to - from))
    }
}

fn measure(scale: Scale, v: f64) -> Option<f64> {
    match scale {
        Scale::Linear => (v.abs() <= MAX).then_some(v),
        Scale::Log => (1.0 / MAX..=MAX).contains(&v).then(|| libm::log10(v)),
    }
}

/// Returns the range of the valid numbers of `data`, with a margin.
fn span(scale: Scale, data: impl Iterator<Item = f64>) -> (f64, f64) {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for v in data.filter_map(|v| measure(scale, v)) {
        low = low.min(v);
        high = high.max(v);
    }
    if low > high {
        return (0.0, 1.0);
    }
    let room = match (scale, high - low) {
        (Scale::Log, width) => 0.06 * width.max(1.0),
        (Scale::Linear, width) if width > 1e-9 * low.abs().max(high.abs()) => 0.04 * width,
        // All numbers are equal.
        (Scale::Linear, _) if low == 0.0 => 1.0,
        (Scale::Linear, _) => 0.5 * low.abs(),
    };
    // The range extends below 0 only if the data do.
    let below = match scale {
        Scale::Linear if low >= 0.0 => (low - room).max(0.0),
        _ => low - room,
    };
    // Keeps ticks at the ends within the limit.
    let max = match scale {
        Scale::Linear => MAX,
        Scale::Log => libm::log10(MAX),
    };
    (below.max(-max), (high + room).min(max))
}

/// Returns the ends and five to ten ticks at multiples of 1, 2 or 5 times a power of ten. The ends
/// are extended to the next ticks unless they are fixed.
fn linear((low, high): (f64, f64), fixed: bool) -> ((f64, f64), Vec<(f64, bool)>) {
    let rough = (high - low) / 6.0;
    let power = libm::pow(10.0, libm::floor(libm::log10(rough)));
    let step = [1.0, 2.0, 5.0, 10.0]
        .map(|k| k * power)
        .into_iter()
        .find(|s| *s >= rough * 0.9)
        .unwrap_or(10.0 * power);
    let (first, last) = match fixed {
        false => (libm::floor(low / step), libm::ceil(high / step)),
        true => (
            libm::ceil(low / step - 1e-9),
            libm::floor(high / step + 1e-9),
        ),
    };
    // Far from zero, the step may be below the precision of the numbers.
    if !(last - first <= 20.0 && (first + 1.0) * step > first * step) {
        return ((low, high), vec![(low, true), (high, true)]);
    }
    let ticks = (0..=(last - first) as u32)
        .map(|k| ((first + f64::from(k)) * step, true))
        .collect();
    let ends = match fixed {
        false => (first * step, last * step),
        true => (low, high),
    };
    (ends, ticks)
}

/// Returns the ticks of a logarithmic axis. Ticks with text are at powers of ten. With few powers,
/// they are also at 2 and 5 times those, or at more multiples. Small ticks are at all multiples.
fn log((low, high): (f64, f64)) -> Vec<(f64, bool)> {
    const SETS: [&[f64]; 3] = [&[1.0], &[1.0, 2.0, 5.0], &[1.0, 1.5, 2.0, 3.0, 5.0, 7.0]];
    let (first, last) = (libm::floor(low) as i32, libm::ceil(high) as i32);
    let within = |v: f64| {
        let at = libm::log10(v);
        at >= low - 1e-9 && at <= high + 1e-9 && measure(Scale::Log, v).is_some()
    };
    let of = |set: &[f64]| -> Vec<f64> {
        (first..=last)
            .flat_map(|e| set.iter().map(move |k| power(*k, e)))
            .filter(|v| within(*v))
            .collect()
    };
    let named = SETS
        .iter()
        .map(|set| of(set))
        .find(|ticks| ticks.len() >= 4)
        .unwrap_or_else(|| {
            // Ranges below half a power of ten have the ticks of a linear axis.
            let (low, high) = (libm::pow(10.0, low), libm::pow(10.0, high));
            let (_, ticks) = linear((low, high), true);
            ticks.into_iter().map(|t| t.0).collect()
        });
    // At most ten ticks have text.
    let every = named.len().div_ceil(10);
    let mut ticks: Vec<(f64, bool)> = named.iter().step_by(every).map(|v| (*v, true)).collect();
    if last - first <= 8 {
        let all: Vec<f64> = (1..10).map(f64::from).collect();
        let small = of(&all);
        ticks.extend(
            small
                .into_iter()
                .filter(|v| !named.iter().any(|n| (n / v - 1.0).abs() < 1e-6))
                .map(|v| (v, false)),
        );
    }
    ticks
}

/// Returns k · 10^e without the rounding of a multiplication.
fn power(k: f64, e: i32) -> f64 {
    format!("{k}e{e}").parse().unwrap_or(f64::NAN)
}

/// Returns the number of decimals that distinguish the ticks of an axis.
fn decimals(ticks: &[f64], format: Format) -> usize {
    let scale = if format == Format::Percent {
        100.0
    } else {
        1.0
    };
    let step = ticks
        .windows(2)
        .map(|w| (w[1] - w[0]).abs() * scale)
        .fold(f64::INFINITY, f64::min);
    if step > 0.0 && step.is_finite() {
        (-libm::floor(libm::log10(step) + 1e-9)).clamp(0.0, 9.0) as usize
    } else {
        2
    }
}

fn write(v: f64, format: Format, scale: Scale, decimals: usize) -> String {
    // On a logarithmic axis, each number has its own number of decimals.
    let fixed = |v: f64| match scale {
        Scale::Linear => format!("{v:.decimals$}"),
        Scale::Log => {
            let text = format!("{v:.9}");
            text.trim_end_matches('0').trim_end_matches('.').to_string()
        }
    };
    let number = |v: f64| match v.abs() {
        0.0 => "0".to_string(),
        a if !(1e-4..1e6).contains(&a) => {
            let text = format!("{v:.2e}");
            let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
            let mantissa = mantissa.trim_end_matches('0').trim_end_matches('.');
            format!("{mantissa}e{exponent}")
        }
        _ => fixed(v),
    };
    let text = match format {
        Format::Number => number(v),
        Format::Percent => format!("{} %", number(100.0 * v)),
        Format::Si => {
            let (unit, name) = match v.abs() {
                a if a >= 1e9 => (1e9, " G"),
                a if a >= 1e6 => (1e6, " M"),
                a if a >= 1e3 => (1e3, " k"),
                _ => (1.0, ""),
            };
            let shown = v / unit;
            let text = format!("{shown:.3}");
            let text = text.trim_end_matches('0').trim_end_matches('.');
            format!("{text}{name}")
        }
    };
    text.replace('-', "−")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(axis: &Axis, data: &[f64]) -> Vec<String> {
        let fitted = Fitted::new(axis, data.iter().copied());
        let ticks = fitted.ticks.into_iter().map(|t| t.1);
        ticks.filter(|t| !t.is_empty()).collect()
    }

    #[test]
    fn axis_ticks_are_round_numbers() {
        let linear = Axis::linear("", Format::Number);
        assert_eq!(
            named(&linear, &[0.0, 1.0]),
            ["0", "0.2", "0.4", "0.6", "0.8", "1.0", "1.2"].map(String::from)
        );
        assert_eq!(named(&linear, &[-3.0, 40.0])[..2], ["−10", "0"]);
        let log = Axis::log("", Format::Percent);
        assert_eq!(
            named(&log, &[0.01, 0.2]),
            ["1 %", "2 %", "5 %", "10 %", "20 %"]
        );
        let decades = Axis::log("", Format::Number);
        let found = named(&decades, &[1e-7, 1e3]);
        assert!(
            found.contains(&"1e−7".into()) && found.contains(&"0.001".into()),
            "{found:?}"
        );
        let si = Axis::log("", Format::Si);
        let found = named(&si, &[400.0, 3e7]);
        assert!(
            found.contains(&"10 k".into()) && found.contains(&"1 M".into()),
            "{found:?}"
        );
        // An almost empty range.
        assert!(named(&log, &[0.0201, 0.0202]).len() >= 3);
    }

    #[test]
    fn axis_of_any_values_is_finite() {
        let max = f64::MAX;
        let sets: [&[f64]; 9] = [
            &[],
            &[f64::NAN],
            &[0.0],
            &[-5.0, -5.0],
            &[f64::INFINITY, 1.0, -max],
            &[max, 1e-300],
            &[1e-99, 1e99],
            &[1e16, 1e16 + 2.0],
            &[3.0, 3.0 + 1e-14],
        ];
        for data in sets {
            for axis in [
                Axis::linear("", Format::Number),
                Axis::log("", Format::Si),
                Axis::log("", Format::Percent),
            ] {
                let fitted = Fitted::new(&axis, data.iter().copied());
                assert!(!fitted.ticks.is_empty() && fitted.ticks.len() < 120);
                for &(tick, _) in &fitted.ticks {
                    let at = fitted.at(tick).expect("a tick can be shown");
                    assert!((-0.01..=1.01).contains(&at), "{data:?} {axis:?}: {at}");
                }
                for &v in data {
                    assert!(fitted.at(v).is_none_or(f64::is_finite));
                }
            }
        }
        let odd = Axis {
            range: Some((2.0, f64::NAN)),
            ..Axis::default()
        };
        assert!(Fitted::new(&odd, [1.0, 2.0].into_iter()).at(1.5).is_some());
        let given = Axis {
            range: Some((-0.3, 0.7)),
            ..Axis::default()
        };
        let fitted = Fitted::new(&given, [5.0].into_iter());
        assert!(fitted.at(-0.3) == Some(0.0) && fitted.at(0.7) == Some(1.0));
    }
}
