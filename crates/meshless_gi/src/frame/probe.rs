//! Kernel `probe`: irradiance for any normal at a position between surfaces, from the probes around
//! it (\[L08\] Eq. (3) in space). Used for dynamic objects. `apply` computes the probes' values:
//! three RGB vectors each, which are the nine numbers of `transport::probe_rows`.
//!
//! Weights are squared as in `splat`: a near probe counts more than several distant ones.

use super::layout::{SplatParams, VectorIrradiance};
use super::splat::{MAX_HALF, lit_pixel, pixel_position, to_world};
use super::subsplat::{SubsplatNode, state};
use crate::asset::Probes;
use crate::basis::{NO_COVER, probe_weight};
use crate::transport::PROBE_ROWS;
use glam::{Vec3, Vec4};

/// Irradiance for a normal as E(n) = c + d·n + n·Q n, RGB, W/m², at a position between surfaces.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ProbeIrradiance {
    /// Coefficients d, (c, Q_xx, Q_yy) and (Q_xy, Q_xz, Q_yz).
    pub parts: [VectorIrradiance; PROBE_ROWS],
}

impl ProbeIrradiance {
    /// Returns E(n), W/m². The second degree rings slightly, so negative values are clamped to
    /// zero.
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

    /// Returns the vector irradiance with the value E(n) at n and the gradient of E there.
    /// Subsplats store it.
    #[must_use]
    pub fn linearize(&self, n: Vec3) -> VectorIrradiance {
        let [linear, a, m] = &self.parts;
        let v = Vec4::from_array;
        // The gradient of d·n + n·Q n.
        let x = v(linear.x) + 2.0 * (v(a.y) * n.x + v(m.x) * n.y + v(m.y) * n.z);
        let y = v(linear.y) + 2.0 * (v(m.x) * n.x + v(a.z) * n.y + v(m.z) * n.z);
        let z = v(linear.z) + 2.0 * (v(m.y) * n.x + v(m.z) * n.y - (v(a.y) + v(a.z)) * n.z);
        let along = self.irradiance(n).extend(0.0) - (x * n.x + y * n.y + z * n.z);
        VectorIrradiance {
            x: (x + along * n.x).to_array(),
            y: (y + along * n.y).to_array(),
            z: (z + along * n.z).to_array(),
        }
    }

    /// Adds `weight` times `other`.
    pub fn add_scaled(&mut self, weight: f32, other: &[VectorIrradiance]) {
        for (part, other) in self.parts.iter_mut().zip(other) {
            part.add_scaled(weight, other);
        }
    }
}

/// Distance in front of a surface at which probes are read if none reaches the surface, in cells of
/// the probes' grid. A cell is as large as a probe's support radius.
pub const RETRY_OFFSET: f32 = 0.1;

/// Returns the irradiance at `x` for surfaces that face `n`. `n` selects the side inside an
/// occluder, and is zero without a surface. Objects inside the thickness of a thin wall, such as a
/// door, are behind the clip planes of probes on both sides. If no probe reaches a surface, the
/// irradiance [`RETRY_OFFSET`] in front of it is used. Returns `None` if no probe reaches that
/// position either.
#[must_use]
pub fn probe(
    probes: &Probes,
    values: &[VectorIrradiance],
    x: Vec3,
    n: Vec3,
) -> Option<ProbeIrradiance> {
    if !x.is_finite() || !n.is_finite() {
        return None;
    }
    let ahead = RETRY_OFFSET * probes.grid.cell_size;
    probe_at(probes, values, x, n).or_else(|| probe_at(probes, values, x + ahead * n, n))
}

/// Returns the irradiance at exactly `x` for surfaces that face `n`.
fn probe_at(
    probes: &Probes,
    values: &[VectorIrradiance],
    x: Vec3,
    n: Vec3,
) -> Option<ProbeIrradiance> {
    let mut sum = ProbeIrradiance::default();
    let (mut cover, mut all) = (0.0, 0.0);
    for &j in probes.grid.indices_near(x) {
        let w = probe_weight(&probes.points[j as usize], &probes.planes, x, n);
        if w > 0.0 {
            cover += w;
            all += w * w;
            sum.add_scaled(w * w, &values[PROBE_ROWS * j as usize..][..PROBE_ROWS]);
        }
    }
    if cover <= NO_COVER {
        return None;
    }
    let mut out = ProbeIrradiance::default();
    out.add_scaled(1.0 / all, &sum.parts);
    Some(out)
}

/// Computes one pixel of the entry point `next_scene`. `earlier` is the result of the basis
/// functions on surfaces. Its alpha is its share in the output. `params` has the probes' grid.
#[must_use]
pub fn probe_pixel(
    params: &SplatParams,
    probes: &Probes,
    values: &[VectorIrradiance],
    pixel: [u32; 2],
    depth: f32,
    texel: [u32; 4],
    earlier: [f32; 4],
) -> [f32; 4] {
    if earlier[3] >= 1.0 {
        return earlier;
    }
    let Some((x, n)) = lit_pixel(params, pixel, depth, texel) else {
        return earlier;
    };
    match probe(probes, values, x, n) {
        Some(light) => (light.irradiance(n) * params.scale)
            .lerp(Vec4::from_array(earlier).truncate(), earlier[3])
            .min(Vec3::splat(MAX_HALF))
            .extend(1.0)
            .to_array(),
        None => earlier,
    }
}

/// Computes one node of the entry point `evaluate_list`: adds the light that basis functions on
/// surfaces do not provide, in the axes of the world. Nodes without a surface do not change.
pub fn probe_node(
    params: &SplatParams,
    probes: &Probes,
    values: &[VectorIrradiance],
    pixel: [u32; 2],
    depth: f32,
    texel: [u32; 4],
    node: &mut SubsplatNode,
) {
    let missing = node.probe_fraction();
    if missing <= 0.0 || !node.has_bits(state::KNOWN) {
        return;
    }
    let (x, n) = pixel_position(params, pixel, depth, texel);
    if let Some(light) = probe(probes, values, x, n) {
        let mut sum = VectorIrradiance::default();
        sum.add_scaled(1.0 - missing, &node.light());
        sum.add_scaled(missing, &to_world(params, &light.linearize(n)));
        *node = SubsplatNode::new(
            &sum,
            node.predicted_luminance(),
            state::EVALUATED | state::KNOWN | state::COVERED,
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Random;

    #[test]
    fn probe_node_preserves_irradiance_and_gradient() {
        let mut random = Random::new(1, 2, 3);
        let mut vector = || {
            let mut four = || [random.unit() - 0.5, random.unit() - 0.5, random.unit(), 0.0];
            VectorIrradiance {
                x: four(),
                y: four(),
                z: four(),
            }
        };
        let mut light = ProbeIrradiance {
            parts: [vector(), vector(), vector()],
        };
        // Bright enough that no value is clamped to zero.
        light.parts[1].x = [4.0, 5.0, 6.0, 0.0];
        for k in 0..30u32 {
            let n =
                crate::samples::uniform_sphere(crate::samples::lattice(k, 30, glam::Vec2::ZERO))
                    .normalize();
            let e = light.linearize(n);
            assert!((e.dot(n) - light.irradiance(n)).length() < 1e-5);
            let (t, b) = crate::samples::tangents(n);
            for beside in [t, b] {
                let m = (n + 0.01 * beside).normalize();
                let (kept, right) = (
                    e.dot(m) - e.dot(n),
                    light.irradiance(m) - light.irradiance(n),
                );
                assert!((kept - right).length() < 1e-3, "{kept} {right}");
            }
        }
    }
}
