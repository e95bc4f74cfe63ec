//! Geometry of a scene from a file of any supported type: triangles, points, or a description that
//! lists several files.

#[cfg(feature = "json")]
use super::TriangleMesh;
#[cfg(feature = "point_clouds")]
use super::load_ply_within;
use super::{InputBudget, LoadedScene, SceneError, load_gltf_within};
use glam::Vec3;
use std::path::Path;

/// Reads `.ply` files as points and other files as glTF. With the feature `json` a `.json` file is
/// a scene description, and its geometry is joined without lights. A surface of points without
/// normals faces those `viewpoints` (meters, between surfaces) that it encloses. See
/// `PointCloud::new`. Without the feature `point_clouds` a `.ply` file is an error.
///
/// # Errors
/// See [`SceneError`].
pub fn load_geometry(
    path: impl AsRef<Path>,
    viewpoints: &[Vec3],
) -> Result<LoadedScene, SceneError> {
    load_geometry_within(path, viewpoints, &mut InputBudget::default())
}

/// Reads geometry like [`load_geometry`]. All files together are within `budget`.
///
/// # Errors
/// See [`SceneError`].
pub fn load_geometry_within(
    path: impl AsRef<Path>,
    viewpoints: &[Vec3],
    budget: &mut InputBudget,
) -> Result<LoadedScene, SceneError> {
    let path = path.as_ref();
    let ends = |ending: &str| {
        path.extension()
            .is_some_and(|e| e.eq_ignore_ascii_case(ending))
    };
    #[cfg(feature = "json")]
    if ends("json") {
        return described(path, viewpoints, budget);
    }
    #[cfg(not(feature = "point_clouds"))]
    if ends("ply") {
        let _ = viewpoints;
        return Err(SceneError::Format {
            file: path.display().to_string(),
            reason: "a point cloud; build with the feature `point_clouds`".into(),
        });
    }
    #[cfg(feature = "point_clouds")]
    if ends("ply") {
        let read = load_ply_within(path, viewpoints, budget)?;
        let (mesh, _) = read.cloud.mesh();
        return Ok(LoadedScene {
            points: read.cloud.len() as u64,
            notes: read.notes,
            ..LoadedScene::from(mesh)
        });
    }
    load_gltf_within(path, budget)
}

/// Reads all geometry that a description lists.
#[cfg(feature = "json")]
fn described(
    path: &Path,
    viewpoints: &[Vec3],
    budget: &mut InputBudget,
) -> Result<LoadedScene, SceneError> {
    let description = super::SceneDescription::read_within(path, budget)?;
    let mut all = LoadedScene::from(TriangleMesh::joined(Vec::new()));
    let mut meshes = Vec::new();
    for (i, file) in description.geometry.iter().enumerate() {
        if file
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("json"))
        {
            return Err(SceneError::Value {
                file: path.display().to_string(),
                location: format!("geometry[{i}]"),
                reason: format!("{} is a scene description, not geometry", file.display()),
            });
        }
        let part = load_geometry_within(file, viewpoints, budget)?;
        all.points += part.points;
        all.problems.add(&part.problems);
        all.notes.extend(part.notes);
        meshes.push(part.mesh);
    }
    if meshes.is_empty() {
        return Err(SceneError::Value {
            file: path.display().to_string(),
            location: "geometry".into(),
            reason: "names no file".into(),
        });
    }
    all.mesh = TriangleMesh::joined(meshes);
    Ok(all)
}
