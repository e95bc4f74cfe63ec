//! Check of scenes far from the origin, before the bake.

use super::BakeError;
use crate::scene::Bounds;

/// Largest offset of ray origins, relative to the scene's size. The offset is eight roundings of
/// the largest coordinate.
const MAX_OFFSET: f32 = 0.1;
/// Offset that causes a warning: a scene of 2 m at a distance of 2 km.
const WARNING_OFFSET: f32 = 1e-3;

/// Returns the warning for a scene that is too far from the origin for full precision.
pub(super) fn check_precision(bounds: &Bounds) -> Result<Option<String>, BakeError> {
    let far = bounds.min.abs().max(bounds.max.abs()).max_element();
    let size = bounds.size().max_element();
    let spacing = f32::EPSILON * far;
    // An empty scene is reported by a later stage.
    let lift = 8.0 * spacing / size;
    if size <= 0.0 || lift.is_nan() || lift <= WARNING_OFFSET {
        return Ok(None);
    }
    if lift > MAX_OFFSET {
        return Err(BakeError::PrecisionLoss { far, size, spacing });
    }
    Ok(Some(format!(
        "the scene of {size} m lies {far} m from its origin, where coordinates are {spacing} m apart: rays start {:.1} % of its size off their surfaces; move it to its origin, and transform its root instead",
        100.0 * lift
    )))
}
