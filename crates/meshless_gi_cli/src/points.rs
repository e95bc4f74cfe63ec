//! Reader of POINTS.csv: positions and normals, in columns found by name.

use super::error::ToolError;
use super::input;
use glam::Vec3;
use std::path::Path;

/// Required columns.
pub const COLUMNS: [&str; 6] = ["px", "py", "pz", "nx", "ny", "nz"];

/// Position and normal of one row.
#[derive(Clone, Debug, PartialEq)]
pub struct ShadingPoint {
    /// The six cells as they are in the file.
    pub text: [String; 6],
    /// Position in meters.
    pub position: Vec3,
    /// Unit normal.
    pub normal: Vec3,
}

/// Reads the points of a file.
pub fn read(path: &Path) -> Result<Vec<ShadingPoint>, ToolError> {
    let text = String::from_utf8(input::bytes(path)?).map_err(|error| {
        let line = 1 + error.as_bytes()[..error.utf8_error().valid_up_to()]
            .iter()
            .filter(|b| **b == b'\n')
            .count();
        ToolError::input(path, &format!("line {line} is not UTF-8 text"))
    })?;
    parse(&text).map_err(|error| ToolError::input(path, &error))
}

/// Parses a CSV text. Accepts columns in any order, further columns, blanks around numbers and
/// empty lines.
fn parse(text: &str) -> Result<Vec<ShadingPoint>, String> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let mut lines = (1..)
        .zip(text.lines())
        .filter(|(_, line)| !line.trim().is_empty());
    let (number, header) = lines
        .next()
        .ok_or("the file is empty; add a header with px,py,pz,nx,ny,nz")?;
    let names: Vec<&str> = header.split(',').map(str::trim).collect();
    let mut at = [0; 6];
    for (at, column) in at.iter_mut().zip(COLUMNS) {
        let mut found = (0..names.len()).filter(|&i| names[i] == column);
        *at = found
            .next()
            .ok_or_else(|| format!("line {number}: the header has no column `{column}`"))?;
        if found.next().is_some() {
            return Err(format!("line {number}: the header has `{column}` twice"));
        }
    }
    lines
        .map(|(number, line)| {
            parse_row(line, &at).map_err(|error| format!("line {number}, {error}"))
        })
        .collect()
}

fn parse_row(line: &str, at: &[usize; 6]) -> Result<ShadingPoint, String> {
    let cells: Vec<&str> = line.split(',').map(str::trim).collect();
    let mut text: [String; 6] = Default::default();
    let mut values = [0.0f32; 6];
    for (k, column) in COLUMNS.iter().enumerate() {
        let cell = *cells
            .get(at[k])
            .ok_or_else(|| format!("column `{column}`: the line ends before it"))?;
        values[k] = match cell.parse::<f32>() {
            Ok(value) if value.is_finite() => value,
            _ => {
                return Err(format!(
                    "column `{column}`: `{cell}` is not a finite number"
                ));
            }
        };
        text[k] = cell.into();
    }
    let [px, py, pz, nx, ny, nz] = values;
    // Double precision keeps very long and very short normals.
    let normal = glam::DVec3::new(nx.into(), ny.into(), nz.into());
    let normal = normal
        .try_normalize()
        .ok_or("column `nx`: the normal has no length")?;
    Ok(ShadingPoint {
        text,
        position: Vec3::new(px, py, pz),
        normal: normal.as_vec3(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn point_columns_are_found_by_name() {
        let text =
            "\u{feff}nx, ny ,nz,id,px,py,pz\r\n0,0,2,7, 1.50,-2,3e0\r\n\r\n1e-30,0,0,x,0,0,0";
        let points = parse(text).unwrap();
        assert_eq!(points.len(), 2);
        assert_eq!(points[0].position, Vec3::new(1.5, -2.0, 3.0));
        assert_eq!(points[0].normal, Vec3::Z);
        assert_eq!(points[0].text, ["1.50", "-2", "3e0", "0", "0", "2"]);
        assert_eq!(points[1].normal, Vec3::X);
        assert_eq!(parse("px,py,pz,nx,ny,nz\n"), Ok(Vec::new()));
    }

    #[test]
    fn point_errors_name_line() {
        let head = "px,py,pz,nx,ny,nz\n";
        let parse_error = |text: &str| parse(text).unwrap_err();
        assert!(parse_error("").contains("px,py,pz"));
        assert_eq!(
            parse_error("\npx,py,pz,nx,ny\n"),
            "line 2: the header has no column `nz`"
        );
        assert!(parse_error("px,py,pz,nx,ny,nz,px\n").contains("twice"));
        let line = |row: &str| parse_error(&format!("{head}0,0,0,0,1,0\n{row}\n"));
        assert_eq!(
            line("0,0,oops,0,1,0"),
            "line 3, column `pz`: `oops` is not a finite number"
        );
        assert!(line("0,0,0,0,NaN,0").contains("column `ny`: `NaN`"));
        assert!(line("1e60,0,0,0,1,0").contains("column `px`"));
        assert!(line("0,0,0,0,1").contains("column `nz`: the line ends"));
        assert!(line("0,0,0,0,0,0").contains("no length"));
    }
}
