//! Quality levels: the parameters of each preset, and the sequence of levels for a target error.
//!
//! A target error changes all parameters of the presets together: thresholds of links and of added
//! points, density, rays and samples. Levels lie between and beyond the presets. The expected error
//! falls by [`ERROR_RATIO`] from level to level. The sequence is the same for every target, so a
//! smaller target never gives a coarser bake.

use super::recipe::Preset;
#[cfg(doc)]
use super::recipe::Recipe;

/// Parameters of a quality level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct QualityParameters {
    /// Number of points of the finest level.
    pub points: f32,
    /// See [`Recipe::sender_levels`].
    pub sender_levels: u32,
    /// See [`Recipe::refinement_levels`].
    pub refinement_levels: u32,
    /// See [`Recipe::max_refinement_points`].
    pub max_refinement_points: f32,
    /// See [`Recipe::rays_per_point`].
    pub rays_per_point: u32,
    /// See [`Recipe::samples_per_sender`].
    pub samples_per_sender: u32,
    /// See [`Recipe::truncation_error`].
    pub truncation_error: f32,
    /// See [`Recipe::link_step`].
    pub link_step: f32,
    /// See [`Recipe::receiver_tolerance`].
    pub receiver_tolerance: f32,
}

impl Preset {
    /// Returns the parameters of the preset.
    #[must_use]
    pub(super) fn parameters(self) -> QualityParameters {
        match self {
            Self::Draft => QualityParameters {
                points: 8_000.0,
                sender_levels: 4,
                refinement_levels: 2,
                max_refinement_points: 16_000.0,
                rays_per_point: 256,
                samples_per_sender: 8,
                truncation_error: 0.03,
                link_step: 0.0005,
                receiver_tolerance: 0.04,
            },
            Self::Medium => QualityParameters {
                points: 32_000.0,
                sender_levels: 5,
                refinement_levels: 3,
                max_refinement_points: 256_000.0,
                rays_per_point: 1024,
                samples_per_sender: 16,
                truncation_error: 0.01,
                link_step: 0.0005,
                receiver_tolerance: 0.03,
            },
            // The sender levels get no more points, since `Link::MAX_SENDERS` limits them.
            Self::High => QualityParameters {
                points: 40_000.0,
                sender_levels: 5,
                refinement_levels: 4,
                max_refinement_points: 400_000.0,
                rays_per_point: 2048,
                samples_per_sender: 32,
                truncation_error: 0.005,
                link_step: 0.00025,
                receiver_tolerance: 0.02,
            },
        }
    }
}

/// Typical errors of the presets on scenes without hard corners. They select the first level for a
/// target error.
const PRESET_ERRORS: [(f32, Preset); 3] = [
    (0.04, Preset::Draft),
    (0.015, Preset::Medium),
    (0.008, Preset::High),
];
/// Error of the coarsest level on such a scene.
const COARSEST_ERROR: f32 = 0.16;
/// Ratio of the errors of consecutive levels.
const ERROR_RATIO: f32 = 1.6;
/// Number of levels. The last is finer than the finest preset by half a step. Finer levels exhaust
/// memory on large scenes.
const STEP_COUNT: i32 = 8;

impl QualityParameters {
    /// Returns the levels to try for a target error, from the coarsest that can meet it to the
    /// finest.
    pub fn refinement_steps(error: f32) -> impl Iterator<Item = Self> {
        let usual = |step: i32| COARSEST_ERROR / ERROR_RATIO.powi(step);
        let first = (0..STEP_COUNT - 1).find(|&step| usual(step) <= ERROR_RATIO * error);
        (first.unwrap_or(STEP_COUNT - 1)..STEP_COUNT).map(move |step| Self::of_error(usual(step)))
    }

    /// Returns the parameters for a typical error, by geometric interpolation between the nearest
    /// presets. Extrapolates beyond them.
    fn of_error(error: f32) -> Self {
        let pair = if error > PRESET_ERRORS[1].0 { 0 } else { 1 };
        let [(e0, coarse), (e1, fine)] = [PRESET_ERRORS[pair], PRESET_ERRORS[pair + 1]];
        let (coarse, fine) = (coarse.parameters(), fine.parameters());
        let t = libm::logf(error / e0) / libm::logf(e1 / e0);
        let mix = |a: f32, b: f32| a * libm::powf(b / a, t);
        let whole = |a: u32, b: u32, min: f32| {
            let straight = a as f32 + t * (b as f32 - a as f32);
            straight.round().max(min) as u32
        };
        let count = |a: u32, b: u32, min: f32, max: f32| {
            mix(a as f32, b as f32).round().clamp(min, max) as u32
        };
        Self {
            points: mix(coarse.points, fine.points),
            sender_levels: whole(coarse.sender_levels, fine.sender_levels, 3.0).min(5),
            refinement_levels: whole(coarse.refinement_levels, fine.refinement_levels, 0.0),
            max_refinement_points: mix(coarse.max_refinement_points, fine.max_refinement_points),
            rays_per_point: count(coarse.rays_per_point, fine.rays_per_point, 64.0, 8192.0),
            samples_per_sender: count(
                coarse.samples_per_sender,
                fine.samples_per_sender,
                4.0,
                64.0,
            ),
            truncation_error: mix(coarse.truncation_error, fine.truncation_error).min(1.0),
            link_step: mix(coarse.link_step, fine.link_step).min(0.1),
            receiver_tolerance: mix(coarse.receiver_tolerance, fine.receiver_tolerance).min(1.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refinement_steps_include_presets_and_increase() {
        for (error, preset) in PRESET_ERRORS {
            let (a, b) = (QualityParameters::of_error(error), preset.parameters());
            assert!(
                (a.points / b.points - 1.0).abs() < 1e-3 && a.rays_per_point == b.rays_per_point
            );
            assert!(
                (a.truncation_error / b.truncation_error - 1.0).abs() < 1e-3
                    && a.samples_per_sender == b.samples_per_sender
            );
            assert_eq!(a.refinement_levels, b.refinement_levels);
        }
        let all: Vec<QualityParameters> = QualityParameters::refinement_steps(1.0).collect();
        assert_eq!(all.len(), STEP_COUNT as usize);
        for pair in all.windows(2) {
            let (a, b) = (pair[0], pair[1]);
            assert!(
                a.points < b.points
                    && a.rays_per_point < b.rays_per_point
                    && a.max_refinement_points < b.max_refinement_points
            );
            assert!(
                a.truncation_error > b.truncation_error
                    && a.receiver_tolerance > b.receiver_tolerance
            );
            assert!(
                a.samples_per_sender <= b.samples_per_sender
                    && a.refinement_levels <= b.refinement_levels
            );
            assert!(a.sender_levels <= b.sender_levels);
        }
        // First level: coarser for a larger error, and never beyond the last level.
        let errors = [1.0, 0.1, 0.05, 0.03, 0.01, 0.001, 1e-4];
        let left = errors.map(|e| QualityParameters::refinement_steps(e).count());
        assert!(left.is_sorted_by(|a, b| a >= b) && left[6] == 1, "{left:?}");
        assert!(left[1] > left[3] && left[3] > left[4], "{left:?}");
    }
}
