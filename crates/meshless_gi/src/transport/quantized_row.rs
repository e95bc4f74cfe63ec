//! Gathered row in 16-bit fixed point, for [`super::refine`]. A row is read again for every child,
//! up to a hundred million times, so a link takes eight bytes. The bake does not store it.

use super::gather::Gathered;
use glam::Vec3;

/// Links of a row before truncation, in units of the largest component divided by 32 767. The error
/// is 2e-5 of the largest link, below the noise of the gather.
#[derive(Debug, Default)]
pub struct QuantizedRow {
    /// Unit: the largest component divided by 32 767.
    unit: f32,
    /// x, y, z in units, and the index of the sender. There are at most 65 536 senders, see
    /// [`Link::MAX_SENDERS`](super::Link::MAX_SENDERS).
    links: Vec<[i16; 4]>,
}

impl QuantizedRow {
    /// Quantizes the links of a gathered row.
    #[must_use]
    pub fn new(gathered: &Gathered) -> Self {
        let largest = gathered.touched.iter().fold(0.0f32, |max, &j| {
            max.max(gathered.link(j).abs().max_element())
        });
        if largest <= 0.0 {
            return Self::default();
        }
        let per_unit = 32_767.0 / largest;
        // The cast truncates, so the sum rounds half away from zero.
        let part = |v: f32| (v * per_unit + 0.5f32.copysign(v)) as i16;
        let links = gathered.touched.iter().map(|&j| {
            let v = gathered.link(j);
            [part(v.x), part(v.y), part(v.z), j as u16 as i16]
        });
        Self {
            unit: largest / 32_767.0,
            links: links.collect(),
        }
    }

    /// Calls `each` with every sender and its link along `n`, scaled by `weight`.
    #[inline]
    pub fn for_each(&self, n: Vec3, weight: f32, mut each: impl FnMut(u32, f32)) {
        let n = n * (weight * self.unit);
        for &[x, y, z, j] in &self.links {
            let part = f32::from(x) * n.x + f32::from(y) * n.y + f32::from(z) * n.z;
            each(u32::from(j as u16), part);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Random;
    use glam::Vec3A;

    #[test]
    fn quantized_row_error_is_bounded_by_largest_link() {
        let mut gathered = Gathered::new(65_536);
        let mut random = Random::new(4, 4, 4);
        for j in [0u32, 7, 32_768, 65_535] {
            for half in [0, 1] {
                let v = Vec3A::new(random.unit(), random.unit(), random.unit()) - 0.5;
                gathered.deposit(j, half, v * 0.01);
            }
        }
        let (n, weight) = (Vec3::new(0.6, 0.0, 0.8), 0.3);
        let mut found = Vec::new();
        QuantizedRow::new(&gathered).for_each(n, weight, |j, part| found.push((j, part)));
        assert_eq!(found.len(), 4);
        for (j, part) in found {
            let right = weight * gathered.link(j).dot(n.into());
            assert!(
                (part - right).abs() < 0.3 * 0.01 * 5e-5,
                "{j}: {part} {right}"
            );
        }
        QuantizedRow::new(&Gathered::new(3)).for_each(n, 1.0, |_, _| panic!("the row has entries"));
    }
}
