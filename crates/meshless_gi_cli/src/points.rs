//! POINTS.csv: places with normals, found by the names of their columns.

use super::error::ToolError;
use super::input;
use glam::Vec3;
use std::path::Path;

/// The columns that a file must have.
pub const COLUMNS: [&str; 6] = ["px", "py", "pz", "nx", "ny", "nz"];

/// A place and a normal.
#[derive(Clone, Debug, PartialEq)]
pub struct Place {
    /// As they stand in the file.
    pub text: [String; 6],
    /// Meters.
    pub position: Vec3,
    /// Of unit length.
    pub normal: Vec3,
}

/// Reads the places of a file.
pub fn read(path: &Path) -> Result<Vec<Place>, ToolError> {
    let text = String::from_utf8(input::bytes(path)?).map_err(|why| {
        let line = 1 + why.as_bytes()[..why.utf8_error().valid_up_to()]
            .iter()
            .filter(|b| **b == b'\n')
            .count();
        ToolError::input(path, &format!("line {line} is not text"))
    })?;
    parse(&text).map_err(|why| ToolError::input(path, &why))
}

/// Columns in any order, others between them, blanks around numbers, empty lines.
fn parse(text: &str) -> Result<Vec<Place>, String> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let mut lines = (1..)
        .zip(text.lines())
        .filter(|(_, line)| !line.trim().is_empty());
    let (number, header) = lines
        .next()
        .ok_or("the file is empty: a header with px,py,pz,nx,ny,nz is needed")?;
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
        .map(|(number, line)| place(line, &at).map_err(|why| format!("line {number}, {why}")))
        .collect()
}

fn place(line: &str, at: &[usize; 6]) -> Result<Place, String> {
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
    // In double precision, so that neither a long nor a short normal is lost.
    let normal = glam::DVec3::new(nx.into(), ny.into(), nz.into());
    let normal = normal
        .try_normalize()
        .ok_or("column `nx`: the normal has no length")?;
    Ok(Place {
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
        let places = parse(text).unwrap();
        assert_eq!(places.len(), 2);
        assert_eq!(places[0].position, Vec3::new(1.5, -2.0, 3.0));
        assert_eq!(places[0].normal, Vec3::Z);
        assert_eq!(places[0].text, ["1.50", "-2", "3e0", "0", "0", "2"]);
        assert_eq!(places[1].normal, Vec3::X);
        assert_eq!(parse("px,py,pz,nx,ny,nz\n"), Ok(Vec::new()));
    }

    #[test]
    fn point_errors_name_line() {
        let head = "px,py,pz,nx,ny,nz\n";
        let why = |text: &str| parse(text).unwrap_err();
        assert!(why("").contains("px,py,pz"));
        assert_eq!(
            why("\npx,py,pz,nx,ny\n"),
            "line 2: the header has no column `nz`"
        );
        assert!(why("px,py,pz,nx,ny,nz,px\n").contains("twice"));
        let line = |row: &str| why(&format!("{head}0,0,0,0,1,0\n{row}\n"));
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
