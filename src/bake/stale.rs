//! Whether a bake still belongs to its level: the fingerprint of everything that it depends on, and the comparison.

use crate::asset::{BakeInfo, fingerprint};

/// The fingerprint of a bake of geometry with this hash: by these settings (as [`BakeInfo::recipe`] holds them), from the viewpoints that
/// the recipe named, by this version of the crate.
pub(super) fn fingerprint_of(
    content_hash: &[u8; 32],
    settings: &str,
    viewpoints: &[[f32; 3]],
) -> String {
    fingerprint(&[
        content_hash,
        settings.as_bytes(),
        bytemuck::cast_slice(viewpoints),
        env!("CARGO_PKG_VERSION").as_bytes(),
    ])
}

/// True when the level has changed since it was baked, or another version of the crate baked it. `content_hash` is that of the level now:
/// [`TriangleMesh::content_hash`](crate::scene::TriangleMesh::content_hash).
#[must_use]
pub fn is_stale(info: &BakeInfo, content_hash: &[u8; 32]) -> bool {
    // The viewpoints were named, or found by the bake.
    [&info.viewpoints[..], &[]].iter().all(|viewpoints| {
        fingerprint_of(content_hash, &info.recipe, viewpoints) != info.fingerprint
    })
}
