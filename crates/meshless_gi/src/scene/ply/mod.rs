//! Reading and writing `.ply` files: points with positions and, where they are there, normals and
//! colors. First step of a point cloud's way into a scene; [`PointCloud`](super::PointCloud) takes
//! what is read here.
//!
//! | `.ply` | here |
//! |---|---|
//! | ascii, binary_little_endian, binary_big_endian 1.0; LF or CR LF | read |
//! | element `vertex`: `x y z` of any type | positions in meters |
//! | `nx ny nz` of any type | normals, if all three are there; of any length |
//! | `red green blue` of 8 bits | sRGB, decoded to linear albedo |
//! | `red green blue` of `float` or `double` | linear albedo |
//! | `red green blue` of another type | an error: its range is not known |
//! | faces, other elements, other properties, lists | passed over; faces are counted and noted: a `.ply` is taken for points |
//!
//! The reader is ours and no crate's: the maintained ones of the registry (ply-rs-bw 4.0) merge
//! properties of the same name, so that such a body is read at wrong positions, never end on an
//! element without properties, refuse comments that are not UTF-8, and say of binary bodies not
//! where they break. The whole format is a header of words and a list of numbers.

mod body;
mod header;
#[cfg(test)]
mod tests;
mod write;

use super::{InputBudget, SceneError};
use glam::Vec3;
use header::{Header, Scalar};
use std::path::Path;
pub use write::{PlyEncoding, write_ply};

/// More points than this are not taken on: their cells would be more triangles than a level may
/// have.
const MAX_POINTS: u64 = 1 << 23;

/// Error of a `.ply` file, with its position.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PlyError {
    /// The header is not one.
    #[error("header line {line}: {what}")]
    Header {
        /// Counted from 1.
        line: usize,
        /// Problem.
        what: String,
    },
    /// The body of an ASCII file does not hold what the header says.
    #[error("line {line}: {what}")]
    Text {
        /// Counted from 1, the header's lines too.
        line: usize,
        /// Problem.
        what: String,
    },
    /// The body of a binary file does not hold what the header says.
    #[error("byte {byte}: {what}")]
    Binary {
        /// Counted from 0, the header's bytes too.
        byte: usize,
        /// Problem.
        what: String,
    },
    /// More points than this program takes on.
    #[error("{count} points, at most {limit}")]
    TooMany {
        /// Number found.
        count: u64,
        /// Largest number allowed.
        limit: u64,
    },
}

/// Points as a file has them: nothing is checked but that they are numbers of the format.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlyPoints {
    /// Meters; may hold what is not finite.
    pub positions: Vec<Vec3>,
    /// As long as `positions`, or none: of any length, and may hold what is not finite.
    pub normals: Option<Vec<Vec3>>,
    /// As long as `positions`, or none: linear RGB; may hold what is no reflectance.
    pub albedo: Option<Vec<Vec3>>,
    /// Faces that the file has too; they are not read.
    pub faces: u64,
}

/// Reads a `.ply` file.
///
/// # Errors
/// [`SceneError::Io`] and [`SceneError::Refused`] where the file cannot be read,
/// [`SceneError::Ply`] where its content is not valid.
pub fn read_ply(path: impl AsRef<Path>) -> Result<PlyPoints, SceneError> {
    read_ply_within(path, &mut InputBudget::default())
}

/// As [`read_ply`], of a file within `budget`.
///
/// # Errors
/// Those of [`read_ply`].
pub fn read_ply_within(
    path: impl AsRef<Path>,
    budget: &mut InputBudget,
) -> Result<PlyPoints, SceneError> {
    let path = path.as_ref();
    let bytes = (budget.read(path)).map_err(|error| SceneError::reading(path, error))?;
    parse_ply(&bytes).map_err(|source| SceneError::Ply {
        file: path.display().to_string(),
        source,
    })
}

/// Reads the bytes of a `.ply` file.
///
/// # Errors
/// See [`PlyError`]. What is behind the last element is not looked at.
pub fn parse_ply(bytes: &[u8]) -> Result<PlyPoints, PlyError> {
    let header = Header::read(bytes)?;
    let no = |line: usize, what: &str| PlyError::Header {
        line,
        what: what.into(),
    };
    let Some(vertex) = header.elements.iter().find(|e| e.name == "vertex") else {
        return Err(no(header.lines, "there is no element `vertex`"));
    };
    if vertex.count > MAX_POINTS {
        return Err(PlyError::TooMany {
            count: vertex.count,
            limit: MAX_POINTS,
        });
    }
    let three = |names: [&str; 3]| -> Option<[usize; 3]> {
        let [a, b, c] = names.map(|name| vertex.scalar(name));
        Some([a?, b?, c?])
    };
    let at = three(["x", "y", "z"]).ok_or_else(|| no(vertex.line, "`vertex` has no x, y and z"))?;
    let normal = three(["nx", "ny", "nz"]);
    let color = three(["red", "green", "blue"]);
    let scalar = |i: usize| vertex.properties[i].scalar;
    if let Some(bad) = color
        .into_iter()
        .flatten()
        .find(|&i| !(scalar(i) == Scalar::U8 || scalar(i).is_float()))
    {
        let what = format!(
            "`{}` is {:?}: colors are uchar (sRGB), float or double (linear)",
            vertex.properties[bad].name,
            scalar(bad)
        );
        return Err(no(vertex.line, &what));
    }
    // The header has shown that so many fit into the bytes that are there.
    let count = vertex.count as usize;
    let mut positions = Vec::with_capacity(count);
    let mut normals = normal.map(|_| Vec::with_capacity(count));
    let mut albedo = color.map(|_| Vec::with_capacity(count));
    body::read(bytes, &header, "vertex", |values| {
        let vector =
            |[x, y, z]: [usize; 3]| Vec3::new(values[x] as f32, values[y] as f32, values[z] as f32);
        positions.push(vector(at));
        if let (Some(normals), Some(normal)) = (&mut normals, normal) {
            normals.push(vector(normal));
        }
        if let (Some(albedo), Some(color)) = (&mut albedo, color) {
            albedo.push(Vec3::from_array(color.map(|i| match scalar(i) {
                Scalar::U8 => linear(values[i] as u8),
                _ => values[i] as f32,
            })));
        }
    })?;
    let faces = header.elements.iter().filter(|e| e.name == "face");
    Ok(PlyPoints {
        positions,
        normals,
        albedo,
        faces: faces.map(|e| e.count).sum(),
    })
}

/// An 8-bit sRGB value as linear light.
fn linear(value: u8) -> f32 {
    super::material::srgb_table()[usize::from(value)]
}
