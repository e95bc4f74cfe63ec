//! Kernel `probe`: the light at a place in free space and for any normal, from the probes around it (\[L08\] Eq. (3) in space): what lights things that
//! move. `apply` has filled the probes' values: three vectors of RGB each, which are the nine numbers of `transport::probe_rows`.
//!
//! Weights are squared, as `splat` squares them: a probe nearby says more than several behind it.

use super::layout::VectorIrradiance;
use crate::asset::Probes;
use crate::basis::{NO_COVER, weight_in_space};
use crate::transport::PROBE_ROWS;
use glam::{Vec3, Vec4};

/// Irradiance for a normal as E(n) = c + d·n + n·Q n, RGB, W/m²: what arrives at a place in free space.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SpaceLight {
    /// d; (c, Q_xx, Q_yy); (Q_xy, Q_xz, Q_yz).
    pub parts: [VectorIrradiance; PROBE_ROWS],
}

impl SpaceLight {
    /// E(n), W/m². The second degree rings a little: what would be below zero is zero.
    #[must_use]
    pub fn irradiance(&self, n: Vec3) -> Vec3 {
        let [linear, even, mixed] = &self.parts;
        let v = Vec4::from_array;
        // Q_zz = −Q_xx − Q_yy.
        let square = n * n;
        let e = v(even.x)
            + v(even.y) * (square.x - square.z)
            + v(even.z) * (square.y - square.z)
            + 2.0
                * (v(mixed.x) * (n.x * n.y) + v(mixed.y) * (n.x * n.z) + v(mixed.z) * (n.y * n.z));
        (e.truncate() + linear.dot(n)).max(Vec3::ZERO)
    }

    /// Adds `weight` times `other`.
    pub fn add_scaled(&mut self, weight: f32, other: &[VectorIrradiance]) {
        for (part, other) in self.parts.iter_mut().zip(other) {
            part.add_scaled(weight, other);
        }
    }
}

/// The light at `x`; none where no probe reaches. `values` are those of the probes, [`PROBE_ROWS`] each.
#[must_use]
pub fn probe(probes: &Probes, values: &[VectorIrradiance], x: Vec3) -> Option<SpaceLight> {
    if !x.is_finite() {
        return None;
    }
    let mut sum = SpaceLight::default();
    let (mut cover, mut all) = (0.0, 0.0);
    for &j in probes.grid.near(x) {
        let w = weight_in_space(&probes.points[j as usize], &probes.planes, x);
        if w > 0.0 {
            cover += w;
            all += w * w;
            sum.add_scaled(w * w, &values[PROBE_ROWS * j as usize..][..PROBE_ROWS]);
        }
    }
    if cover <= NO_COVER {
        return None;
    }
    let mut out = SpaceLight::default();
    out.add_scaled(1.0 / all, &sum.parts);
    Some(out)
}
