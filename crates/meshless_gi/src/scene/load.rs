//! A level's geometry from a file of any kind that can be read: triangles, points, or a description
//! that names several of them.

#[cfg(feature = "point_clouds")]
use super::load_ply_within;
use super::{InputBudget, MeshProblems, SceneError, TriangleMesh, load_gltf_within};
use glam::Vec3;
use std::path::Path;

/// A level's geometry as one mesh.
#[derive(Debug)]
#[non_exhaustive]
pub struct LoadedGeometry {
    /// Triangles, and the cells of points, in meters.
    pub mesh: TriangleMesh,
    /// Points whose cells are in the mesh; 0 where there are triangles only.
    pub points: u64,
    /// Problems of triangles that were dropped or corrected.
    pub problems: MeshProblems,
    /// Notes on content that was not read or was read in another way.
    pub notes: Vec<String>,
}

/// Reads `.ply` as points and anything else as glTF. With the feature `json` a `.json` is a scene
/// description whose geometry is joined. Points without normals face the `viewpoints` (meters, in
/// free space) that their surface lies around: see `PointCloud::new`. Without the feature
/// `point_clouds` a `.ply` is an error.
///
/// # Errors
/// See [`SceneError`].
pub fn load_geometry(
    path: impl AsRef<Path>,
    viewpoints: &[Vec3],
) -> Result<LoadedGeometry, SceneError> {
    load_geometry_within(path, viewpoints, &mut InputBudget::default())
}

/// As [`load_geometry`]; all files together are within `budget`.
///
/// # Errors
/// See [`SceneError`].
pub fn load_geometry_within(
    path: impl AsRef<Path>,
    viewpoints: &[Vec3],
    budget: &mut InputBudget,
) -> Result<LoadedGeometry, SceneError> {
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
        return Ok(LoadedGeometry {
            mesh,
            points: read.cloud.len() as u64,
            problems: MeshProblems::default(),
            notes: read.notes,
        });
    }
    let read = load_gltf_within(path, budget)?;
    Ok(LoadedGeometry {
        mesh: read.mesh,
        points: 0,
        problems: read.problems,
        notes: read.notes,
    })
}

/// All geometry that a description names.
#[cfg(feature = "json")]
fn described(
    path: &Path,
    viewpoints: &[Vec3],
    budget: &mut InputBudget,
) -> Result<LoadedGeometry, SceneError> {
    let description = super::SceneDescription::read_within(path, budget)?;
    let mut all = LoadedGeometry {
        mesh: TriangleMesh::joined(Vec::new()),
        points: 0,
        problems: MeshProblems::default(),
        notes: Vec::new(),
    };
    let mut meshes = Vec::new();
    for (i, file) in description.geometry.iter().enumerate() {
        if file
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("json"))
        {
            return Err(SceneError::Value {
                file: path.display().to_string(),
                location: format!("geometry[{i}]"),
                reason: format!("{} is a description and no geometry", file.display()),
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
