//! Distances between surface points: the anisotropic distance of [L08] Eq. (10) and the symmetric
//! 5D distance of Eq. (11).

use glam::Vec3;

/// Additional growth of the distance along the normal (\[L08\] §2.2).
pub const F_SQUASH: f32 = 2.0;

/// Computes dist_j(x) of \[L08\] Eq. (10), meters: the length of v + F_squash ⟨v, n_j⟩ n_j with v =
/// x − x_j.
#[must_use]
#[inline]
pub fn dist(v: Vec3, n_j: Vec3) -> f32 {
    dist_squared(v, n_j).sqrt()
}

/// Computes the square of [`dist`], m².
#[must_use]
#[inline]
pub fn dist_squared(v: Vec3, n_j: Vec3) -> f32 {
    (v + F_SQUASH * v.dot(n_j) * n_j).length_squared()
}

/// Computes D(p, q) of \[L08\] Eq. (11), meters. Infinite if the normals are 90° or more apart.
#[must_use]
pub fn distance_5d(x_p: Vec3, n_p: Vec3, x_q: Vec3, n_q: Vec3) -> f32 {
    let cosine = n_p.dot(n_q).max(0.0);
    let v = x_q - x_p;
    if cosine == 0.0 {
        return f32::INFINITY;
    }
    dist(v, n_p).min(dist(v, n_q)) / (cosine * cosine)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sample_distance_is_symmetric_and_flattened() {
        let (x, n) = (Vec3::new(1.0, 2.0, 3.0), Vec3::Y);
        let (y, m) = (Vec3::new(1.5, 2.2, 3.0), Vec3::new(0.6, 0.8, 0.0));
        assert_eq!(distance_5d(x, n, y, m), distance_5d(y, m, x, n));
        assert!((dist(Vec3::Y, Vec3::Y) - 3.0).abs() < 1e-6);
        assert!((dist(Vec3::X, Vec3::Y) - 1.0).abs() < 1e-6);
        assert_eq!(distance_5d(x, n, x, -n), f32::INFINITY);
        assert_eq!(distance_5d(x, n, x, n), 0.0);
    }
}
