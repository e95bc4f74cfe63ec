//! Settings and errors of the fast multipole method.

use super::terms::MAX_ORDER;
use glam::Vec3;

/// Point that represents a piece of a surface (\[G08\] §2.4).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FmmPoint {
    /// Position in meters.
    pub position: Vec3,
    /// Normal, of any positive length. A point with a normal of length zero neither emits nor
    /// receives.
    pub normal: Vec3,
    /// Surface area of the point, m². A point with zero area does not emit.
    pub weight: f32,
    /// `true` if the irradiance at the point is computed. Otherwise the point only emits.
    pub receives: bool,
}

/// Settings of the solver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FmmSettings {
    /// Highest degree of the expansions, at most [`MAX_ORDER`]. The error of a pair falls like
    /// `separation`^(order + 1).
    pub order: usize,
    /// Maximum number of points in a leaf, s in \[G08\] §2.5. A leaf has more only if points
    /// (nearly) coincide.
    pub leaf: usize,
    /// Maximum sum of the radii of two nodes over the distance of their centers for an interaction
    /// by expansions. In (0, 1).
    pub separation: f32,
    /// Cosine by which points of two nodes may face away from each other while the nodes still
    /// interact by expansions. Such points exchange negative light instead of none. The light in
    /// that band of directions is at most `slack`² of the irradiance of the hemisphere. 0 allows
    /// none, at the cost of more pairs in the near list.
    pub slack: f32,
    /// `true` if a close source is a disk: r⁴ becomes r² (r² + w/π), so that a pair gives at most
    /// the source's radiosity. `false` for the kernel of \[G08\] Eq. (4) as printed, with point
    /// sources.
    pub disks: bool,
    /// Number of rays that estimate the visibility between two nodes. Unused without a geometry.
    pub rays: u32,
    /// Maximum sum of the radii of two partially occluded nodes over their distance for an
    /// interaction by expansions. The interaction is scaled by the visible fraction. Other pairs
    /// are divided. 0 divides down to the leaves. Unused without a geometry.
    pub penumbra: f32,
    /// Seed of the random numbers.
    pub seed: u64,
}

impl Default for FmmSettings {
    fn default() -> Self {
        Self {
            order: 4,
            leaf: 24,
            separation: 0.5,
            slack: 0.1,
            disks: true,
            rays: 16,
            penumbra: 0.1,
            seed: 0,
        }
    }
}

/// Error of the solver.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FmmError {
    /// Invalid value of a point.
    #[error("point {index}: {what} is {value}, {right}")]
    Point {
        /// Index of the point.
        index: usize,
        /// Name of the value.
        what: &'static str,
        /// The value.
        value: f32,
        /// Allowed values.
        right: &'static str,
    },
    /// Setting out of its range.
    #[error("{what} is {value}, not in {right}")]
    Setting {
        /// Name of the setting.
        what: &'static str,
        /// Its value.
        value: f64,
        /// Its range.
        right: &'static str,
    },
    /// Number of values that differs from the number of points.
    #[error("{what}: {have} values for {points} points")]
    Count {
        /// Name of the input.
        what: &'static str,
        /// Number of values.
        have: usize,
        /// Number of points.
        points: usize,
    },
    /// Number of list entries that exceeds 32-bit indices. Larger leaves or a larger separation
    /// reduce it.
    #[error("{0} pairs of nodes in the lists, at most 2^32")]
    TooManyPairs(u64),
    /// Number of points that exceeds 32-bit indices.
    #[error("{0} points, at most 2^31")]
    TooMany(usize),
}

impl FmmSettings {
    /// Checks the ranges of all settings.
    ///
    /// # Errors
    /// [`FmmError::Setting`].
    pub fn check(&self) -> Result<(), FmmError> {
        let range = |what, value: f64, ok: bool, right| match ok {
            true => Ok(()),
            false => Err(FmmError::Setting { what, value, right }),
        };
        let (s, k, p) = (self.separation, self.slack, self.penumbra);
        range(
            "order",
            self.order as f64,
            self.order <= MAX_ORDER,
            "0 … 16",
        )?;
        range("leaf", self.leaf as f64, self.leaf >= 1, "1 …")?;
        range("separation", s.into(), s > 0.0 && s < 1.0, "(0, 1)")?;
        range("slack", k.into(), (0.0..=1.0).contains(&k), "[0, 1]")?;
        range("penumbra", p.into(), (0.0..1.0).contains(&p), "[0, 1)")?;
        range("rays", self.rays.into(), self.rays >= 1, "1 …")
    }
}

/// Checks the values of all points.
///
/// # Errors
/// [`FmmError::Point`], [`FmmError::TooMany`].
pub fn check_points(points: &[FmmPoint]) -> Result<(), FmmError> {
    if points.len() >= 1 << 31 {
        return Err(FmmError::TooMany(points.len()));
    }
    for (index, p) in points.iter().enumerate() {
        let of = |what, v: Vec3| match v.to_array().into_iter().find(|c| !c.is_finite()) {
            Some(value) => Err(FmmError::Point {
                index,
                what,
                value,
                right: "not a finite number",
            }),
            None => Ok(()),
        };
        of("position", p.position)?;
        of("normal", p.normal)?;
        if !(p.weight.is_finite() && p.weight >= 0.0) {
            return Err(FmmError::Point {
                index,
                what: "weight",
                value: p.weight,
                right: "not a finite number of at least zero",
            });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fmm_settings_invalid_values_return_named_errors() {
        let good = FmmPoint {
            position: Vec3::ONE,
            normal: Vec3::Z,
            weight: 1.0,
            receives: true,
        };
        assert_eq!(check_points(&[good, good]), Ok(()));
        let bad = [
            FmmPoint {
                position: Vec3::NAN,
                ..good
            },
            FmmPoint {
                normal: Vec3::INFINITY,
                ..good
            },
            FmmPoint {
                weight: -1.0,
                ..good
            },
            FmmPoint {
                weight: f32::NAN,
                ..good
            },
        ];
        for point in bad {
            let error = check_points(&[good, point]).expect_err("bad");
            assert!(error.to_string().starts_with("point 1: "), "{error}");
        }
        let fine = FmmSettings::default();
        assert_eq!(fine.check(), Ok(()));
        let wrong = [
            FmmSettings { order: 17, ..fine },
            FmmSettings { leaf: 0, ..fine },
            FmmSettings {
                separation: 1.0,
                ..fine
            },
            FmmSettings {
                separation: f32::NAN,
                ..fine
            },
            FmmSettings {
                slack: -0.1,
                ..fine
            },
            FmmSettings {
                penumbra: 1.0,
                ..fine
            },
            FmmSettings { rays: 0, ..fine },
        ];
        for settings in wrong {
            assert!(settings.check().is_err(), "{settings:?}");
        }
    }
}
