//! Ground truth of another program, read from a table: irradiance at surface points after one to
//! all diffuse reflections.

use super::{Errors, errors};
use glam::Vec3;
use meshless_gi::Evaluator;
use meshless_gi::internals::scene::{InputBudget, read_file};
use rayon::prelude::*;
use std::io;
use std::path::{Path, PathBuf};

/// Numbers of reflections with columns in a table. `None` means without limit.
pub const BOUNCES: [Option<u32>; 4] = [Some(1), Some(2), Some(4), None];

/// Table of ground truth. All lists have equal length.
#[derive(Clone, Debug, Default)]
pub struct GroundTruth {
    /// Positions and their unit normals.
    pub positions: Vec<(Vec3, Vec3)>,
    /// Direct irradiance on the side of the normal, W/m².
    pub direct: Vec<Vec3>,
    /// Irradiance after one to [`BOUNCES`] reflections and its standard errors, W/m².
    pub indirect: [(Vec<Vec3>, Vec<Vec3>); 4],
}

/// Errors of reading a table.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GroundTruthError {
    /// File that could not be read.
    #[error("{}: {source}", path.display())]
    Io {
        /// Path of the file.
        path: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// Text that is not a valid table.
    #[error("{}, line {line}: {what}", path.display())]
    Content {
        /// Path of the file.
        path: PathBuf,
        /// Line number, from 1.
        line: usize,
        /// Description of the error.
        what: String,
    },
}

/// Errors of a baked scene against ground truth.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Comparison {
    /// Errors of indirect irradiance. A position that no basis function covers counts as dark.
    pub indirect: Errors,
    /// Errors of direct irradiance.
    pub direct: Errors,
    /// Number of positions that no basis function covers.
    pub uncovered: usize,
}

impl GroundTruth {
    /// Compares a baked scene with the ground truth for the `k`-th of [`BOUNCES`]. `evaluator` must
    /// have the same number of reflections.
    #[must_use]
    pub fn compare(&self, evaluator: &Evaluator<'_>, k: usize) -> Comparison {
        let light: Vec<_> = self
            .positions
            .par_iter()
            .enumerate()
            .map(|(i, &(x, n))| evaluator.at(x, n, i as u64))
            .collect();
        let indirect: Vec<Vec3> = light
            .iter()
            .map(|e| e.indirect.unwrap_or_default())
            .collect();
        let direct: Vec<Vec3> = light.iter().map(|e| e.direct).collect();
        let (values, noise) = &self.indirect[k];
        Comparison {
            indirect: errors(&indirect, values, noise),
            direct: errors(&direct, &self.direct, &vec![Vec3::ZERO; direct.len()]),
            uncovered: light.iter().filter(|e| e.indirect.is_none()).count(),
        }
    }

    /// Reads a table of comma-separated numbers under a header with `p`, `n`, `direct`, `ind1`,
    /// `ind1_se` and so on, three columns each.
    ///
    /// # Errors
    /// Returns a [`GroundTruthError`] with the line number if the content is invalid.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, GroundTruthError> {
        let path = path.as_ref();
        let failed = |source| GroundTruthError::Io {
            path: path.into(),
            source,
        };
        let bytes = read_file(path, InputBudget::DEFAULT)
            .map_err(|error| failed(io::Error::other(error)))?;
        let text = String::from_utf8(bytes).map_err(|error| failed(io::Error::other(error)))?;
        Self::parse(&text).map_err(|(line, what)| GroundTruthError::Content {
            path: path.into(),
            line,
            what,
        })
    }

    fn parse(text: &str) -> Result<Self, (usize, String)> {
        let mut lines = text.lines().enumerate();
        let header: Vec<&str> = lines
            .next()
            .ok_or((1, "the file is empty".to_string()))?
            .1
            .split(',')
            .map(str::trim)
            .collect();
        let column = |names: [String; 3]| -> Result<[usize; 3], (usize, String)> {
            let mut at = [0; 3];
            for (at, name) in at.iter_mut().zip(names) {
                let found = header.iter().position(|h| *h == name);
                *at = found.ok_or_else(|| (1, format!("there is no column `{name}`")))?;
            }
            Ok(at)
        };
        let coordinates = |name: &str| column(["x", "y", "z"].map(|c| format!("{name}{c}")));
        let channels = |name: &str| column(["r", "g", "b"].map(|c| format!("{name}_{c}")));
        let (p, n, direct) = (coordinates("p")?, coordinates("n")?, channels("direct")?);
        let mut indirect = [([0; 3], [0; 3]); 4];
        for (columns, name) in indirect.iter_mut().zip(["ind1", "ind2", "ind4", "indinf"]) {
            *columns = (channels(name)?, channels(&format!("{name}_se"))?);
        }
        let mut out = Self::default();
        for (i, line) in lines.filter(|(_, line)| !line.trim().is_empty()) {
            let cells: Vec<&str> = line.split(',').collect();
            let read = |at: [usize; 3]| -> Result<Vec3, (usize, String)> {
                let mut v = [0.0f32; 3];
                for (v, &at) in v.iter_mut().zip(&at) {
                    let cell = cells.get(at).map_or("", |c| c.trim());
                    let number = cell.parse().ok().filter(|v: &f32| v.is_finite());
                    *v = number.ok_or_else(|| {
                        (
                            i + 1,
                            format!("`{cell}` in column `{}` is not a finite number", header[at]),
                        )
                    })?;
                }
                Ok(v.into())
            };
            let normal = read(n)?
                .try_normalize()
                .ok_or_else(|| (i + 1, "the normal has no length".to_string()))?;
            out.positions.push((read(p)?, normal));
            out.direct.push(read(direct)?);
            for ((values, errors), (value, error)) in out.indirect.iter_mut().zip(indirect) {
                values.push(read(value)?);
                errors.push(read(error)?);
            }
        }
        Ok(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ground_truth_tables_load_and_errors_are_named() {
        let names = [
            "direct",
            "ind1",
            "ind1_se",
            "ind2",
            "ind2_se",
            "ind4",
            "ind4_se",
            "indinf",
            "indinf_se",
        ];
        let mut header = "nx,ny,nz,px,py,pz".to_string();
        let mut row = "0,0,2,1,2,3".to_string();
        for (i, name) in names.iter().enumerate() {
            header += &format!(",{name}_r,{name}_g,{name}_b");
            row += &format!(",{i},{i}.5,0");
        }
        let truth = GroundTruth::parse(&format!("{header}\n{row}\n\n")).unwrap();
        assert_eq!(truth.positions, [(Vec3::new(1.0, 2.0, 3.0), Vec3::Z)]);
        assert_eq!(truth.indirect[2].1, [Vec3::new(6.0, 6.5, 0.0)]);
        for (wrong, line, word) in [
            (String::new(), 1, "empty"),
            (header.replace("ind4_se_g", "x"), 1, "ind4_se_g"),
            (
                format!("{header}\n{}", row.replace("4.5", "dark")),
                2,
                "dark",
            ),
            (
                format!("{header}\n{}", row.replace("0,0,2", "0,0,0")),
                2,
                "normal",
            ),
            (format!("{header}\n1,2"), 2, "nz"),
        ] {
            let (at, what) = GroundTruth::parse(&wrong).unwrap_err();
            assert!(at == line && what.contains(word), "{at}: {what}");
        }
    }
}
