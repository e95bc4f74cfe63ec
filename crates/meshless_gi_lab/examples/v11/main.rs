//! Experiment of [V11]: nine bases represent the light of a sphere over a disk. Two integral
//! equations give the exact light. Writes the table that the paper lacks, its curves B(ζ) and D(u)
//! as charts, and pictures, and puts them into a document:
//!
//! ```text
//! cargo run --release -p meshless_gi_lab --example v11 -- -o DIR
//! ```
//!
//! makes `DIR/v11.md`, its charts and pictures in `DIR/v11/`, and the curves of every basis at
//! every density in `DIR/v11/all/`. With `--short`, as for `docs/`, `all` is omitted.

mod curves;
mod document;
mod pictures;

use meshless_gi_lab::accuracy::{
    Basis, ComparisonRow, PointSet, Solution, SphereOverDisk, SurfaceErrors, compare_bases,
};
use meshless_gi_lab::report::split_sentences;
use std::error::Error;
use std::path::PathBuf;

/// Minimum distances between two points, in meters. The third is that of the paper.
pub const SPACINGS: [f64; 5] = [6.0, 4.24, 3.0, 2.12, 1.5];
/// Spacing of the charts and pictures in the document.
pub const SHOWN_SPACING: f64 = 3.0;
/// Number of point sets per density. The table has the median of each number over them.
const SETS: u64 = 5;
/// Number of cells of the reference solution.
const CELLS: usize = 1600;

/// Input of all parts of the document.
pub struct Experiment {
    pub solution: Solution,
    /// Medians over the point sets.
    pub rows: Vec<ComparisonRow>,
    /// First point set of each spacing.
    pub sets: Vec<PointSet>,
    pub folder: PathBuf,
}

fn main() -> Result<(), Box<dyn Error>> {
    let usage = "usage: v11 -o DIR [--short]";
    let (mut folder, mut short) = (None, false);
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "-o" => folder = Some(PathBuf::from(args.next().ok_or(usage)?)),
            "--short" => short = true,
            _ => return Err(usage.into()),
        }
    }
    let folder = folder.ok_or(usage)?;
    std::fs::create_dir_all(folder.join("v11/all"))?;
    let scene = SphereOverDisk::default();
    let solution = scene.solve(CELLS)?;
    let (mut rows, mut sets) = (Vec::new(), Vec::new());
    for spacing in SPACINGS {
        let mut of_sets = Vec::new();
        for seed in 1..=SETS {
            let set = PointSet::new(&scene, spacing, seed);
            let all = compare_bases(&set, &solution, &solution, &Basis::ALL, true, seed)?;
            of_sets.push(all);
            if seed == 1 {
                sets.push(set);
            }
        }
        rows.extend(medians(&of_sets));
        eprintln!("spacing {spacing} m done");
    }
    let made = Experiment {
        solution,
        rows,
        sets,
        folder,
    };
    curves::write(&made, !short)?;
    pictures::write(&made)?;
    std::fs::write(
        made.folder.join("v11.md"),
        split_sentences(&document::text(&made)?),
    )?;
    if short {
        std::fs::remove_dir(made.folder.join("v11/all"))?;
    }
    Ok(())
}

/// Returns the median of each number over rows that differ by their point set.
fn medians(sets: &[Vec<ComparisonRow>]) -> Vec<ComparisonRow> {
    let median = |mut all: Vec<f64>| {
        all.sort_by(f64::total_cmp);
        all[all.len() / 2]
    };
    (0..sets[0].len())
        .map(|i| {
            let of = |value: &dyn Fn(&ComparisonRow) -> f64| {
                median(sets.iter().map(|rows| value(&rows[i])).collect())
            };
            let surface = |get: fn(&ComparisonRow) -> &SurfaceErrors| SurfaceErrors {
                rmse: of(&|r| get(r).rmse),
                largest: of(&|r| get(r).largest),
                oscillation: of(&|r| get(r).oscillation),
                unevenness: of(&|r| get(r).unevenness),
                bias: of(&|r| get(r).bias),
                uncovered: of(&|r| get(r).uncovered),
            };
            ComparisonRow {
                points: of(&|r| r.points as f64) as usize,
                sphere: surface(|r| &r.sphere),
                disk: surface(|r| &r.disk),
                // The largest, because one case is enough.
                ridge: sets.iter().fold(0.0, |max, rows| max.max(rows[i].ridge)),
                ..sets[0][i]
            }
        })
        .collect()
}

/// Returns the part of a file name that identifies a basis.
pub fn slug(basis: Basis) -> &'static str {
    match basis {
        Basis::Shepard => "shepard",
        Basis::Gaussian => "gaussian",
        Basis::HalfGaussian => "gaussian_half",
        Basis::NarrowGaussian => "gaussian_quarter",
        Basis::Lehtinen => "lehtinen",
        Basis::LehtinenLevels => "lehtinen_3",
        Basis::Flat => "ours_scalars",
        Basis::FlatVector => "ours",
        Basis::CorrectedFlatVector => "ours_second_pass",
    }
}
