//! Levels that lie so far from their origin that single precision shows: refused, or warned of,
//! before anything is baked.

use super::BakeError;
use crate::scene::Bounds;

/// Rays start off their surface by eight roundings of the largest coordinate: by how much of the
/// level's size at most.
const MAX_LIFT: f32 = 0.1;
/// From how much on it is worth a warning: a level of 2 m then lies 2 km away.
const NOTED_LIFT: f32 = 1e-3;

/// A warning of a level that lies so far from its origin that roundings show.
pub(super) fn check_precision(bounds: &Bounds) -> Result<Option<String>, BakeError> {
    let far = bounds.min.abs().max(bounds.max.abs()).max_element();
    let size = bounds.size().max_element();
    let spacing = f32::EPSILON * far;
    // Nothing at all is somebody else's error.
    let lift = 8.0 * spacing / size;
    if size <= 0.0 || lift.is_nan() || lift <= NOTED_LIFT {
        return Ok(None);
    }
    if lift > MAX_LIFT {
        return Err(BakeError::PrecisionLoss { far, size, spacing });
    }
    Ok(Some(format!(
        "the level of {size} m lies {far} m from its origin, where coordinates are {spacing} m apart: rays start {:.1} % of its size off their surfaces. Move it to its origin, and place its root instead",
        100.0 * lift
    )))
}
