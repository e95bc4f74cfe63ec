//! Writing points as a `.ply` file in each encoding of the format, for examples and tests. Colors
//! are written as linear `float`s, so that they are read back bitwise identical.

use glam::Vec3;
use std::io::Write;

/// Encoding of the body of a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PlyEncoding {
    /// Text with enough digits to read back the same value.
    Ascii,
    /// Binary, little-endian.
    #[default]
    LittleEndian,
    /// Binary, big-endian.
    BigEndian,
}

/// Writes points. `normals` and `albedo` (linear RGB) are empty or as long as `positions` (meters).
/// Missing values at their end are written as 0.
///
/// # Errors
/// Those of `to`.
pub fn write_ply(
    mut to: impl Write,
    encoding: PlyEncoding,
    positions: &[Vec3],
    normals: &[Vec3],
    albedo: &[Vec3],
) -> std::io::Result<()> {
    let format = match encoding {
        PlyEncoding::Ascii => "ascii",
        PlyEncoding::LittleEndian => "binary_little_endian",
        PlyEncoding::BigEndian => "binary_big_endian",
    };
    let groups = [
        (positions, ["x", "y", "z"], true),
        (normals, ["nx", "ny", "nz"], !normals.is_empty()),
        (albedo, ["red", "green", "blue"], !albedo.is_empty()),
    ];
    writeln!(to, "ply\nformat {format} 1.0")?;
    writeln!(to, "comment meters, Y up; colors are linear")?;
    writeln!(to, "element vertex {}", positions.len())?;
    let there = groups.iter().filter(|g| g.2);
    for name in there.clone().flat_map(|g| g.1) {
        writeln!(to, "property float {name}")?;
    }
    writeln!(to, "end_header")?;
    for i in 0..positions.len() {
        let mut first = true;
        for value in there
            .clone()
            .flat_map(|g| g.0.get(i).copied().unwrap_or_default().to_array())
        {
            match encoding {
                PlyEncoding::Ascii if first => write!(to, "{value}")?,
                PlyEncoding::Ascii => write!(to, " {value}")?,
                PlyEncoding::LittleEndian => to.write_all(&value.to_le_bytes())?,
                PlyEncoding::BigEndian => to.write_all(&value.to_be_bytes())?,
            }
            first = false;
        }
        if encoding == PlyEncoding::Ascii {
            writeln!(to)?;
        }
    }
    Ok(())
}
