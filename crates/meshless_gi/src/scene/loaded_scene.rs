//! [`LoadedScene`]: the content of scene files.

use super::{Light, MeshProblems, TriangleMesh};

/// Scene from one or several files.
#[derive(Debug)]
#[non_exhaustive]
pub struct LoadedScene {
    /// Triangles, and the cells of points, in meters.
    pub mesh: TriangleMesh,
    /// Number of points that have cells in the mesh. 0 for triangles only.
    pub points: u64,
    /// Lights of the scene.
    pub lights: Vec<Light>,
    /// Name of each light. Empty if the file has no name.
    pub light_names: Vec<String>,
    /// Numbers of triangles and materials that were dropped or corrected.
    pub problems: MeshProblems,
    /// Notes on content that was ignored or converted.
    pub notes: Vec<String>,
}

impl From<TriangleMesh> for LoadedScene {
    /// Creates a scene without lights, problems and notes.
    fn from(mesh: TriangleMesh) -> Self {
        Self {
            mesh,
            points: 0,
            lights: Vec::new(),
            light_names: Vec::new(),
            problems: MeshProblems::default(),
            notes: Vec::new(),
        }
    }
}
