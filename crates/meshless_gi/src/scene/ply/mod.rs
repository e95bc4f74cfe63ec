//! Reading and writing `.ply` files: points with positions, optional normals and optional colors.
//! [`PointCloud`](super::PointCloud) converts the points of a file to a surface.
//!
//! | `.ply` | here |
//! |---|---|
//! | ascii, binary_little_endian, binary_big_endian 1.0; LF or CR LF | read |
//! | element `vertex`: `x y z` of any type | positions in meters |
//! | `nx ny nz` of any type | normals, if all three are present; of any length |
//! | `red green blue` of 8 bits | sRGB, decoded to linear albedo |
//! | `red green blue` of `float` or `double` | linear albedo |
//! | `red green blue` of another type | an error: its range is not specified |
//! | faces | skipped, with a note of their number: a `.ply` is read as points |
//! | other elements, other properties, lists | skipped |
//!
//! This crate has its own reader, because the maintained crates of the registry (ply-rs-bw 4.0)
//! have four faults. They merge properties of the same name, so that such a body is read at wrong
//! offsets. They do not terminate on an element without properties. They reject comments that are
//! not UTF-8. Their errors for binary bodies have no position. The format consists only of a text
//! header and a list of numbers.

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

/// Largest number of points. The cells of more points would exceed the triangle limit of a scene.
const MAX_POINTS: u64 = 1 << 23;

/// Error in a `.ply` file, with its position.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PlyError {
    /// The header is not valid.
    #[error("header line {line}: {what}")]
    Header {
        /// Line number, counted from 1.
        line: usize,
        /// Problem.
        what: String,
    },
    /// The body of an ASCII file does not match the header.
    #[error("line {line}: {what}")]
    Text {
        /// Line number, counted from 1 including the header.
        line: usize,
        /// Problem.
        what: String,
    },
    /// The body of a binary file does not match the header.
    #[error("byte {byte}: {what}")]
    Binary {
        /// Byte offset, counted from 0 including the header.
        byte: usize,
        /// Problem.
        what: String,
    },
    /// The file has more points than the limit.
    #[error("{count} points, at most {limit}")]
    TooMany {
        /// Number found.
        count: u64,
        /// Largest number allowed.
        limit: u64,
    },
}

/// Points of a file. The values are numbers of the format and are otherwise unchecked.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlyPoints {
    /// Positions, meters. May contain values that are not finite.
    pub positions: Vec<Vec3>,
    /// Normals of any length, as many as `positions`. May contain values that are not finite.
    /// `None` if the file has no normals.
    pub normals: Option<Vec<Vec3>>,
    /// Linear RGB albedo, as many as `positions`. May contain values outside [0, 1]. `None` if the
    /// file has no colors.
    pub albedo: Option<Vec<Vec3>>,
    /// Number of faces in the file. Faces are not read.
    pub faces: u64,
}

/// Reads a `.ply` file.
///
/// # Errors
/// [`SceneError::Io`] and [`SceneError::Refused`] if the file cannot be read, [`SceneError::Ply`]
/// if its content is not valid.
pub fn read_ply(path: impl AsRef<Path>) -> Result<PlyPoints, SceneError> {
    read_ply_within(path, &mut InputBudget::default())
}

/// Reads a `.ply` file like [`read_ply`] within `budget`.
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
/// See [`PlyError`]. Bytes after the last element are ignored.
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
    // The header check guarantees that the remaining bytes can hold this number of points.
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

/// Converts an 8-bit sRGB value to linear.
fn linear(value: u8) -> f32 {
    super::material::srgb_table()[usize::from(value)]
}
