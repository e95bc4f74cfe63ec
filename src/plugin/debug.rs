//! [`MeshlessGiDebugPlugin`]: gizmos and diagnostics.

use super::{diagnostics, gizmos};
use bevy::app::{App, Plugin};

/// Adds tools for development: the gizmos of baked scenes ([`GiGizmos`](super::GiGizmos), off until
/// their group is enabled) and the counters of each frame as Bevy diagnostics (`meshless_gi/…`).
/// Add it after [`MeshlessGiPlugin`](super::MeshlessGiPlugin).
#[derive(Clone, Copy, Debug, Default)]
pub struct MeshlessGiDebugPlugin;

impl Plugin for MeshlessGiDebugPlugin {
    fn build(&self, app: &mut App) {
        diagnostics::register(app);
        gizmos::register(app);
    }
}
