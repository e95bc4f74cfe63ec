//! Closed forms of irradiance in double precision. The reference integrator is tested against them.
//!
//! Form factors are those of Howell's catalog \[H10\], by its numbers. Enclosures follow from the
//! geometric series of reflections. Integrating spheres follow from the constant form factor
//! between any two positions inside a sphere. Angles in radians, lengths in meters, irradiances in
//! W/m².

use core::f64::consts::PI;
use glam::DVec3;

/// Returns the direct irradiance of a point light of `intensity` (W/sr) at `height` above a plane,
/// at distance `aside` from the light's foot. E = I h / (h² + s²)^(3/2) is the inverse square law
/// times Lambert's cosine.
#[must_use]
pub fn light_over_plane(intensity: f64, height: f64, aside: f64) -> f64 {
    intensity * height / (height * height + aside * aside).powf(1.5)
}

/// Returns the irradiance at the foot of a point light at distance `below` under an infinite
/// ceiling of reflectance `albedo`. The ceiling is `room` above a black floor, so there is one
/// reflection. 0 < `below` < `room`.
///
/// The ceiling's radiosity is ρ I h / (h² + s²)^(3/2). Its irradiance at distance H below the
/// center is ∫ B H² 2s / (s² + H²)² ds. With w² = s² + h² and c = H² − h² the integrand is
/// rational: 2 ρ I h H² ∫_h^∞ dw / (w² (w² + c)²).
#[must_use]
pub fn light_below_ceiling(intensity: f64, albedo: f64, below: f64, room: f64) -> f64 {
    let c = room * room - below * below;
    let angle = (c.sqrt() / below).atan();
    let integral = 1.0 / (c * c * below) - 1.5 * angle / (c * c * c.sqrt())
        + below / (2.0 * c * c * room * room);
    2.0 * albedo * intensity * below * room * room * integral
}

/// Returns the form factor of two equal parallel rectangles `a` × `b` that face each other at
/// `distance`: \[H10\] C-11. 0.19982 for unit squares.
#[must_use]
pub fn parallel_rectangles(a: f64, b: f64, distance: f64) -> f64 {
    let (x, y) = (a / distance, b / distance);
    let (sx, sy) = (1.0 + x * x, 1.0 + y * y);
    let log = 0.5 * (sx * sy / (sx + y * y)).ln();
    let arcs = x * sy.sqrt() * (x / sy.sqrt()).atan() + y * sx.sqrt() * (y / sx.sqrt()).atan();
    2.0 / (PI * x * y) * (log + arcs - x * x.atan() - y * y.atan())
}

/// Returns the form factor from a rectangle `edge` × `from` to a perpendicular one of `edge` ×
/// `to`. `edge` is their common edge: \[H10\] C-14. 0.20004 for unit squares.
#[must_use]
pub fn perpendicular_rectangles(edge: f64, from: f64, to: f64) -> f64 {
    let (w, h) = (from / edge, to / edge);
    let (w2, h2) = (w * w, h * h);
    let (sw, sh, both) = (1.0 + w2, 1.0 + h2, w2 + h2);
    let all = 1.0 + both;
    let arcs =
        w * (1.0 / w).atan() + h * (1.0 / h).atan() - both.sqrt() * (1.0 / both.sqrt()).atan();
    let logs = (sw * sh / all).ln()
        + w2 * (w2 * all / (sw * both)).ln()
        + h2 * (h2 * all / (sh * both)).ln();
    (arcs + 0.25 * logs) / (PI * w)
}

/// Returns the irradiance at position `x` with unit normal `n` from a convex polygon of uniform
/// `radiance` (W/(m² sr)). The polygon must be above the position's tangent plane and unoccluded.
/// The irradiance is half the radiance times a sum over the polygon's edges (\[L60\]). A term is
/// the angle that the edge subtends, times the cosine between n and the normal of the plane of edge
/// and position. The corners may be in either order.
#[must_use]
pub fn polygon(x: DVec3, n: DVec3, corners: &[DVec3], radiance: f64) -> f64 {
    let to: Vec<DVec3> = corners.iter().map(|&c| (c - x).normalize()).collect();
    let edges = to.iter().zip(to.iter().cycle().skip(1));
    let sum: f64 = edges
        .map(|(a, b)| {
            let cross = a.cross(*b);
            let angle = cross.length().atan2(a.dot(*b));
            angle * n.dot(cross.normalize_or_zero())
        })
        .sum();
    0.5 * radiance * sum.abs()
}

/// Returns the irradiance everywhere inside a closed surface that emits `emitted` (radiosity, W/m²)
/// and has reflectance `albedo`. It includes up to `bounces` reflections: M Σ ρ^i for i up to
/// `bounces`. Without a limit it is M / (1 − ρ), infinite for a reflectance of one. It equals the
/// radiosity there.
#[must_use]
pub fn enclosure(emitted: f64, albedo: f64, bounces: Option<u32>) -> f64 {
    emitted * series(albedo, bounces)
}

/// Returns the reflected part of a closed surface's own emission: [`enclosure`] without the direct
/// irradiance.
#[must_use]
pub fn enclosure_reflected(emitted: f64, albedo: f64, bounces: Option<u32>) -> f64 {
    match bounces {
        Some(0) => 0.0,
        _ => enclosure(emitted * albedo, albedo, bounces.map(|k| k - 1)),
    }
}

/// Returns the reflected irradiance anywhere inside a sphere of `radius` in which lights emit
/// `power` (W), after one to `bounces` reflections. It does not depend on the directions of the
/// light. The form factor from a position of a sphere to a part of it is the part's share of the
/// area. So the first reflection is already uniform: Φ / (4π R²) · (ρ + ρ² + …).
#[must_use]
pub fn integrating_sphere(power: f64, radius: f64, albedo: f64, bounces: Option<u32>) -> f64 {
    enclosure_reflected(power / (4.0 * PI * radius * radius), albedo, bounces)
}

/// Returns the power (W) of a spot light of axial `intensity` (W/sr) with half angles `inner` and
/// `outer`. Its edge falls as the square of the normalized cosine between them: 2π I ((1 − cos
/// inner) + (cos inner − cos outer) / 3).
#[must_use]
pub fn spot_power(intensity: f64, inner: f64, outer: f64) -> f64 {
    let (inside, edge) = (inner.cos(), outer.cos());
    2.0 * PI * intensity * ((1.0 - inside) + (inside - edge) / 3.0)
}

/// Returns 1 + ρ + … + ρ^k.
fn series(albedo: f64, bounces: Option<u32>) -> f64 {
    match bounces {
        None if albedo >= 1.0 => f64::INFINITY,
        None => 1.0 / (1.0 - albedo),
        Some(k) if albedo == 1.0 => f64::from(k) + 1.0,
        Some(k) => (1.0 - albedo.powf(f64::from(k) + 1.0)) / (1.0 - albedo),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_close(a: f64, b: f64, by: f64) -> bool {
        (a - b).abs() <= by * b.abs()
    }

    #[test]
    fn form_factors_match_tables_and_reciprocity() {
        assert!(is_close(
            parallel_rectangles(1.0, 1.0, 1.0),
            0.199_825,
            1e-5
        ));
        assert!(is_close(
            perpendicular_rectangles(1.0, 1.0, 1.0),
            0.200_044,
            1e-5
        ));
        // Value from tables of heat transfer for plates of 1 m x 1.5 m at 0.5 m.
        assert!(is_close(parallel_rectangles(1.0, 1.5, 0.5), 0.4756, 2e-4));
        assert!(is_close(parallel_rectangles(1.0, 1.0, 1e-4), 1.0, 1e-3));
        // Reciprocity: areas times form factors are equal in both directions.
        let (there, back) = (
            perpendicular_rectangles(2.0, 0.5, 3.0),
            perpendicular_rectangles(2.0, 3.0, 0.5),
        );
        assert!(is_close(0.5 * there, 3.0 * back, 1e-12));
        // The form factors of a cube's face add up to one.
        let cube =
            parallel_rectangles(1.0, 1.0, 1.0) + 4.0 * perpendicular_rectangles(1.0, 1.0, 1.0);
        assert!(is_close(cube, 1.0, 1e-12), "{cube}");
        // The form factors of the floor of a hall of 3 x 2 x 1.5 m add up to one, too.
        let hall = parallel_rectangles(3.0, 2.0, 1.5)
            + 2.0 * perpendicular_rectangles(3.0, 2.0, 1.5)
            + 2.0 * perpendicular_rectangles(2.0, 3.0, 1.5);
        assert!(is_close(hall, 1.0, 1e-12), "{hall}");
    }

    #[test]
    fn polygon_irradiance_is_additive_and_averages_to_form_factor() {
        let corner = |x: f64, y: f64| DVec3::new(x, y, 1.0);
        let square = [
            corner(0.0, 0.0),
            corner(1.0, 0.0),
            corner(1.0, 1.0),
            corner(0.0, 1.0),
        ];
        // Gauss-Legendre with three nodes, ten panels along each side.
        let nodes: Vec<(f64, f64)> = (0..10)
            .flat_map(|k| {
                let t = 0.6f64.sqrt();
                [(-t, 5.0), (0.0, 8.0), (t, 5.0)]
                    .map(|(at, weight)| ((f64::from(k) + 0.5 + 0.5 * at) / 10.0, weight / 180.0))
            })
            .collect();
        let mut mean = 0.0;
        for &(x, wx) in &nodes {
            for &(y, wy) in &nodes {
                mean += wx * wy * polygon(DVec3::new(x, y, 0.0), DVec3::Z, &square, 1.0 / PI);
            }
        }
        let right = parallel_rectangles(1.0, 1.0, 1.0);
        assert!(is_close(mean, right, 1e-9), "{mean} {right}");
        // A tilted receiver: midpoint rule over the square.
        let (x, n) = (DVec3::new(0.3, -0.4, 0.2), DVec3::new(0.48, 0.6, 0.64));
        let steps = 400;
        let middle = |i: i32| (f64::from(i) + 0.5) / f64::from(steps);
        let mut sum = 0.0;
        for i in 0..steps * steps {
            let to = corner(middle(i % steps), middle(i / steps)) - x;
            let square = to.length_squared();
            sum += to.dot(n) * to.z / (square * square) / f64::from(steps * steps);
        }
        assert!(is_close(polygon(x, n, &square, 1.0), sum, 1e-5));
    }

    #[test]
    fn ceiling_irradiance_matches_quadrature() {
        let (below, room, albedo) = (0.7, 3.0, 0.6);
        // s = tan t · room: the integrand is smooth on [0, π/2).
        let steps = 200_000;
        let mut sum = 0.0;
        for k in 0..steps {
            let t = (f64::from(k) + 0.5) / f64::from(steps) * (PI / 2.0);
            let s = room * t.tan();
            let b = albedo * light_over_plane(2.0, below, s);
            let ring = 2.0 * s * room * room / (s * s + room * room).powi(2);
            sum += b * ring * room / t.cos().powi(2) * (PI / 2.0) / f64::from(steps);
        }
        let right = light_below_ceiling(2.0, albedo, below, room);
        assert!(is_close(right, sum, 1e-7), "{right} {sum}");
    }

    #[test]
    fn bounce_series_matches_powers() {
        assert!(is_close(enclosure(2.0, 0.99, None), 200.0, 1e-12));
        assert!(is_close(enclosure(2.0, 0.5, Some(2)), 3.5, 1e-12));
        assert!(is_close(enclosure(2.0, 1.0, Some(4)), 10.0, 1e-12));
        assert_eq!(enclosure(1.0, 1.0, None), f64::INFINITY);
        assert_eq!(enclosure_reflected(1.0, 0.5, Some(0)), 0.0);
        assert!(is_close(enclosure_reflected(1.0, 0.5, None), 1.0, 1e-12));
        // A point light of 1 W/sr at the center: direct irradiance I / R², and for ρ = 1/2 the same
        // reflected.
        assert!(is_close(
            integrating_sphere(4.0 * PI, 2.0, 0.5, None),
            0.25,
            1e-12
        ));
        // A spot light over the full sphere, without an edge, is a point light.
        assert!(is_close(spot_power(1.0, PI, PI), 4.0 * PI, 1e-12));
        assert!(is_close(
            spot_power(1.0, 0.0, PI / 2.0),
            2.0 * PI / 3.0,
            1e-12
        ));
    }
}
