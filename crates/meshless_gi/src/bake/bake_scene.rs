//! Bake of a scene on its own thread pool, for the tool and the plugin. Panics become errors.

use super::occluders::node_names;
use super::{
    BakeError, BakeOrigin, BakeSource, BakeStage, Baked, Progress, Recipe, bake_with_origin,
};
use crate::scene::TriangleMesh;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Instant;

/// Error of [`bake_scene`].
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BakeSceneError {
    /// Error of the bake.
    #[error(transparent)]
    Bake(#[from] BakeError),
    /// Failed start of the threads.
    #[error("no threads could be started for the bake: {0}")]
    Threads(String),
    /// Defect of this crate: the bake panicked. Please report it with the scene.
    #[error("the bake panicked: {0}")]
    Panicked(String),
}

/// Bakes a scene on its own pool of `threads` threads. 0 uses one thread per processor. A panic
/// becomes an error, so that a game or an asset processor does not hang.
///
/// # Errors
/// See [`BakeSceneError`].
pub fn bake_scene(
    mesh: &TriangleMesh,
    recipe: &Recipe,
    threads: usize,
    progress: &Progress,
) -> Result<Baked, BakeSceneError> {
    bake_scene_with_origin(mesh, recipe, &BakeOrigin::default(), threads, progress)
}

/// Bakes as [`bake_scene`]. Stores `origin` in the description of the bake.
///
/// # Errors
/// See [`BakeSceneError`].
pub fn bake_scene_with_origin(
    mesh: &TriangleMesh,
    recipe: &Recipe,
    origin: &BakeOrigin,
    threads: usize,
    progress: &Progress,
) -> Result<Baked, BakeSceneError> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .thread_name(|i| format!("meshless gi bake {i}"))
        .build()
        .map_err(|e| BakeSceneError::Threads(e.to_string()))?;
    let whole = || {
        let began = Instant::now();
        if !progress.set(BakeStage::Geometry, 0.0) {
            return Err(BakeError::Canceled);
        }
        let nodes = node_names(&recipe.occluders);
        let held = (!nodes.is_empty()).then(|| mesh.split_occluders(&nodes));
        let (staying, occluders) = match held {
            Some((rest, held)) => (Some(rest), held),
            None => (None, Vec::new()),
        };
        let geometry = staying.as_ref().unwrap_or(mesh);
        let source = BakeSource {
            geometry,
            bvh: geometry.bvh(),
            primitives: mesh.len() as u64,
            content_hash: mesh.content_hash(),
            occluders,
        };
        let seconds = began.elapsed().as_secs_f64();
        let mut baked = bake_with_origin(&source, recipe, origin, progress)?;
        baked.stats.seconds.bvh += seconds;
        baked.stats.seconds.total += seconds;
        Ok(baked)
    };
    match pool.install(|| catch_unwind(AssertUnwindSafe(whole))) {
        Ok(result) => Ok(result?),
        Err(panic) => {
            let text = panic.downcast_ref::<&str>().map(ToString::to_string);
            let text = text.or_else(|| panic.downcast_ref::<String>().cloned());
            Err(BakeSceneError::Panicked(
                text.unwrap_or_else(|| "no message".into()),
            ))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Material, TriangleMesh};
    use glam::Vec3;

    #[test]
    fn bake_scene_invalid_input_returns_named_error() {
        let none = TriangleMesh::new(Vec::new(), Vec::new(), vec![Material::default()]);
        let bake = |progress: &Progress| bake_scene(&none, &Recipe::default(), 1, progress);
        assert!(matches!(
            bake(&Progress::default()),
            Err(BakeSceneError::Bake(BakeError::NoReachableSurface { .. }))
        ));
        let stopped = Progress::default();
        stopped.cancel();
        assert!(matches!(
            bake(&stopped),
            Err(BakeSceneError::Bake(BakeError::Canceled))
        ));
        let wrong = Recipe {
            viewpoints: vec![[f32::NAN, Vec3::X.y, 0.0]],
            ..Recipe::default()
        };
        let error = bake_scene(&none, &wrong, 1, &Progress::default()).unwrap_err();
        assert!(error.to_string().contains("viewpoints"), "{error}");
    }
}
