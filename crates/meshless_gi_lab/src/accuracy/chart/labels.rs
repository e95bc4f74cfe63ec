//! Positions of a chart's labels: next to their markers, and clear of other markers and labels if
//! possible.

/// Height of a label, pixels.
pub const HEIGHT: f64 = 11.0;

/// Box, pixels: left, top, right, bottom.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Area(pub f64, pub f64, pub f64, pub f64);

impl Area {
    /// Creates a square from its center and half its edge.
    pub fn from_center((x, y): (f64, f64), half: f64) -> Self {
        Self(x - half, y - half, x + half, y + half)
    }

    fn overlap(&self, other: &Self) -> f64 {
        let width = self.2.min(other.2) - self.0.max(other.0);
        let height = self.3.min(other.3) - self.1.max(other.1);
        width.max(0.0) * height.max(0.0)
    }

    /// Returns the area outside of `frame`.
    fn outside(&self, frame: &Self) -> f64 {
        (self.2 - self.0) * (self.3 - self.1) - self.overlap(frame)
    }
}

/// Returns the approximate width of `text` in a common sans-serif font, pixels.
pub fn width(text: &str, size: f64) -> f64 {
    let ems: f64 = text
        .chars()
        .map(|c| match c {
            'i' | 'j' | 'l' | 't' | 'f' | 'I' | '.' | ',' | ':' | ';' | '|' | ' ' | '\'' | '!'
            | '(' | ')' => 0.32,
            'm' | 'w' | 'M' | 'W' | '%' => 0.86,
            c if c.is_uppercase() => 0.68,
            _ => 0.56,
        })
        .sum();
    ems * size
}

/// Chooses the left end and the baseline of a label next to `position`. The label goes to the side
/// that covers least of `taken`, and its area is added to `taken`. Returns `None` if it would cover
/// much, because an illegible label hides others.
pub fn put(
    text: &str,
    position: (f64, f64),
    frame: &Area,
    taken: &mut Vec<Area>,
) -> Option<(f64, f64)> {
    let (w, h) = (width(text, HEIGHT), HEIGHT);
    let (x, y) = position;
    let covered = |left: f64, top: f64| {
        let area = Area(left, top, left + w, top + h);
        let covered: f64 = taken.iter().map(|t| area.overlap(t)).sum();
        covered + 4.0 * area.outside(frame)
    };
    let mut best = (f64::INFINITY, (0.0, 0.0));
    for (gap, penalty) in [(11.0, 0.0), (20.0, 0.08)] {
        let near = 0.7 * gap;
        // The area above and right of a marker on a falling front is free.
        let sides = [
            (x + near, y - near - h),
            (x - near - w, y + near),
            (x + gap, y - h / 2.0),
            (x - w / 2.0, y - gap - h),
            (x - w / 2.0, y + gap),
            (x - gap - w, y - h / 2.0),
            (x + near, y + near),
            (x - near - w, y - near - h),
        ];
        for (left, top) in sides {
            // Rounded, so that equal sides compare as equal and the first of them is taken.
            let cost = ((covered(left, top) / (w * h) + penalty) * 64.0).round();
            if cost < best.0 {
                best = (cost, (left, top));
            }
        }
    }
    let (cost, (left, top)) = best;
    (cost <= 64.0 * 0.3).then(|| {
        taken.push(Area(left, top, left + w, top + h));
        (left, top + 0.8 * h)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chart_labels_do_not_overlap() {
        let frame = Area(0.0, 0.0, 300.0, 300.0);
        let positions = [(100.0, 100.0), (112.0, 100.0), (295.0, 150.0), (4.0, 4.0)];
        let mut taken: Vec<Area> = positions
            .iter()
            .map(|p| Area::from_center(*p, 5.0))
            .collect();
        for position in positions {
            assert!(put("a label", position, &frame, &mut taken).is_some());
        }
        for (i, a) in taken.iter().enumerate() {
            assert!(i < positions.len() || a.outside(&frame) < 1e-9, "{a:?}");
            for b in &taken[..i.min(taken.len())] {
                let markers = a.3 - a.1 <= 10.0 && b.3 - b.1 <= 10.0;
                assert!(markers || a.overlap(b) < 1e-9, "{a:?} {b:?}");
            }
        }
        // Without room, there is no label.
        let mut full = vec![frame];
        assert_eq!(put("a label", (150.0, 150.0), &frame, &mut full), None);
        assert_eq!(full.len(), 1);
    }
}
