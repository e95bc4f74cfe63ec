//! Quantization of links. A link becomes three integers, multiples of a step along three axes: the
//! direction from the receiver to the sender, and two axes normal to it. A link points close to
//! that direction, so the last two integers are small. A file stores the integers
//! (`asset/link_section.rs`), and every reader computes the same [`Link`] from them.
//!
//! All links to dim senders have about the same step, whatever their size. The error of a row's
//! sum is then that of its number of links, and small links, which are the most, take few bits.
//! Links to senders that are brighter than the mean, such as emitters, have smaller steps, by the
//! exposure of the sender ([`super::Training`]). The rounding error of a link is added to the next
//! one of the row, which is usually close by, so a row keeps its mass.

use super::Link;
use crate::samples::{Point, tangents};
use glam::Vec3;

/// Largest code of a step.
pub const MAX_CODE: u8 = 84;

/// Largest number of roundings until a link is equal to that of its coordinates.
const ROUNDS: u32 = 100;

/// Frame and step of the links of one row.
#[derive(Clone, Copy, Debug)]
pub struct RowQuantizer<'a> {
    /// Code of the step of links to dim senders, relative to the row's scale.
    code: u8,
    position: Vec3,
    normal: Vec3,
    /// The senders of the operator.
    senders: &'a [Point],
    /// Code that each sender adds, see [`precision_of`]. The last is that of the sky.
    precision: &'a [u8],
}

impl<'a> RowQuantizer<'a> {
    /// Creates the quantizer of a row from the code of its step, which is 2^(−code / 4) of the
    /// row's scale. Returns `None` for 0, the code of rows that are not quantized, and for codes
    /// above [`MAX_CODE`]. `precision` has [`precision_of`] of each sender, and of the sky.
    #[must_use]
    pub fn new(
        code: u8,
        receiver: &Point,
        senders: &'a [Point],
        precision: &'a [u8],
    ) -> Option<Self> {
        (1..=MAX_CODE).contains(&code).then(|| Self {
            code,
            position: receiver.x(),
            normal: receiver.n(),
            senders,
            precision,
        })
    }

    /// Returns the code of the largest step of at most `max`, relative to the row's scale.
    #[must_use]
    pub fn code_of(max: f32) -> u8 {
        (1..MAX_CODE)
            .find(|&code| step(code) <= max)
            .unwrap_or(MAX_CODE)
    }

    /// Returns the step of links to a sender, relative to the row's scale.
    #[must_use]
    pub fn step(&self, sender: u32) -> f32 {
        // The terms of a varying sky follow the sky.
        let last = self.precision.len().saturating_sub(1);
        let finer = self.precision.get((sender as usize).min(last));
        step(self.code.saturating_add(finer.copied().unwrap_or(0)))
    }

    /// Returns the step of links to dim senders, relative to the row's scale.
    #[must_use]
    pub fn largest_step(&self) -> f32 {
        step(self.code)
    }

    /// Returns `true` if the step of links to a sender is at least half of the largest.
    #[must_use]
    pub fn is_coarse(&self, sender: u32) -> bool {
        2.0 * self.step(sender) >= self.largest_step()
    }

    /// Returns the three axes of a link. The first points to the sender. For the sky, and for a
    /// sender at the receiver, it is the receiver's normal.
    fn axes(&self, sender: u32) -> [Vec3; 3] {
        let sender = self.senders.get(sender as usize);
        let direction = sender.map_or(self.normal, |s| {
            (s.x() - self.position).normalize_or(self.normal)
        });
        let (t, b) = tangents(direction);
        [direction, t, b]
    }

    /// Returns the link closest to a vector, which can be stored by its coordinates.
    #[must_use]
    pub fn quantize(&self, vector: Vec3, sender: u32) -> Link {
        let mut link = self.link(self.coordinates(vector, sender), sender);
        // The halves of a link can be coarser than the step. Its own coordinates must give it back.
        for _ in 0..ROUNDS {
            let again = self.link(self.coordinates(link.vector(), sender), sender);
            if again == link {
                break;
            }
            link = again;
        }
        link
    }

    /// Returns the coordinates of a vector, rounded.
    #[must_use]
    pub fn coordinates(&self, vector: Vec3, sender: u32) -> [i32; 3] {
        let step = self.step(sender);
        (self.axes(sender)).map(|axis| (vector.dot(axis) / step).round() as i32)
    }

    /// Returns the link of these coordinates.
    #[must_use]
    #[inline]
    pub fn link(&self, coordinates: [i32; 3], sender: u32) -> Link {
        let [e, t, b] = self.axes(sender);
        let step = self.step(sender);
        let [x, y, z] = coordinates.map(|c| step * c as f32);
        Link::pack(x * e + y * t + z * b, 1.0, sender as u16)
    }
}

/// Returns the code by which links to a sender have a smaller step: that of the ratio of its root
/// mean square radiosity to the irradiance of the scene, if it is above one. `exposure` is the mean
/// square of that ratio ([`super::Training`]).
#[must_use]
pub fn precision_of(exposure: f32) -> u8 {
    (2.0 * libm::log2f(exposure.max(1.0))).round() as u8
}

/// Returns 2^(−code / 4), at least that of [`MAX_CODE`].
fn step(code: u8) -> f32 {
    const QUARTERS: [f32; 4] = [1.0, 0.840_896_4, 0.707_106_77, 0.594_603_54];
    let code = code.min(MAX_CODE);
    let power = f32::from_bits((127 - u32::from(code / 4)) << 23);
    QUARTERS[usize::from(code % 4)] * power
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Random;

    fn point(random: &mut Random) -> Point {
        let v = |r: &mut Random| Vec3::new(r.unit(), r.unit(), r.unit()) - 0.5;
        let position = 4.0 * v(random);
        Point::new(position, v(random).normalize_or(Vec3::Y), 0.1)
    }

    #[test]
    fn quantized_link_error_is_below_step() {
        let mut random = Random::new(1, 2, 3);
        let senders: Vec<Point> = (0..100).map(|_| point(&mut random)).collect();
        let precision: Vec<u8> = (0..101).map(|j| j % 3 * 20).collect();
        let receiver = point(&mut random);
        for code in [4, 20, MAX_CODE] {
            let row = RowQuantizer::new(code, &receiver, &senders, &precision).unwrap();
            for sender in 0..105u32 {
                let v = Vec3::new(random.unit(), random.unit(), random.unit()) * 2.0 - 1.0;
                let link = row.quantize(v, sender);
                let error = (link.vector() - v).abs().max_element();
                let step = row.step(sender);
                // Halves near one are 5e-4 apart, and several roundings can follow each other.
                assert!(error <= 0.87 * step + 3e-3, "{code} {sender}: {error}");
                assert_eq!(link.sender(), sender);
                // A reader computes the same link from its coordinates.
                let coordinates = row.coordinates(link.vector(), sender);
                assert_eq!(row.link(coordinates, sender), link);
            }
            assert!(row.step(1) <= row.step(0));
            assert_eq!(row.step(100), row.step(104), "terms of the sky");
        }
        assert!(RowQuantizer::new(0, &receiver, &senders, &[]).is_none());
        assert!(RowQuantizer::new(MAX_CODE + 1, &receiver, &senders, &[]).is_none());
    }

    #[test]
    fn step_code_is_largest_within_bound() {
        for max in [0.2, 0.01, 0.003] {
            let code = RowQuantizer::code_of(max);
            assert!(step(code) <= max && step(code - 1) > max, "{code}");
        }
        assert_eq!(RowQuantizer::code_of(1e-9), MAX_CODE);
        assert_eq!(RowQuantizer::code_of(9.0), 1);
        for code in 0..=MAX_CODE {
            let right = libm::exp2f(-0.25 * f32::from(code));
            assert!((step(code) / right - 1.0).abs() < 1e-6);
        }
        // A sender that is 16 times brighter has a sixteenth of the step.
        assert_eq!(precision_of(256.0), 16);
        assert_eq!((precision_of(0.0), precision_of(1.0)), (0, 0));
    }
}
