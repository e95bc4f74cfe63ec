//! Visibility of a baked scene: sections of the file, and validation. The six sections are present
//! together or not at all. The starts of a cluster's and a point's arrays follow from the lengths
//! before, and are not stored.

use super::codec::{Field, Layout, words};
use super::container::{Container, Section, SectionKind};
use super::error::AssetError;
use super::layouts::COUNT;
use super::scene_data::SceneData;
use super::section_io::{items, section, section_error};
use super::sections::kind;
use super::violation::Check;
use crate::transport::pca::{HemisphereGrid, Visibility, VisibilityCluster, VisiblePoint};
use glam::Vec3;

const CLUSTER: Layout = Layout::rows(&words([0, 1, 2, 3, 6]));
const POINT: Layout = Layout::columns(&[
    Field::word(0).delta(),
    Field::word(2),
    Field::word(4),
    Field::word(5),
    Field::word(6),
    Field::word(7),
]);
/// Layout of words of two 16-bit or four 8-bit numbers. In byte planes all first bytes are
/// contiguous.
const PAIR: Layout = Layout::columns(&[Field::low(0), Field::high(0)]);

/// Words of the section "visibility".
const SHAPE_WORDS: usize = 2;
/// Largest number of directions of a point.
const MAX_DIRECTIONS: u64 = 1 << 16;
/// Largest product of coefficients and components. e is at most one, and the length of a component
/// at most the root of the number of directions.
const MAX_SCALE: f32 = 1024.0;

/// Kinds of sections, ascending.
pub(super) const KINDS: [SectionKind; 6] = [
    SectionKind {
        max: SHAPE_WORDS as u64,
        // Version 1 also had the unit of all depths. Now each cluster has its own.
        version: 2,
        ..kind::<u32>(23, "visibility", COUNT)
    },
    SectionKind {
        version: 2,
        // Validation compares them with a copy.
        memory: 2 * size_of::<VisibilityCluster>() as u64 + 4,
        ..kind::<VisibilityCluster>(24, "visibility clusters", CLUSTER)
    },
    SectionKind {
        // Validation compares them with a copy.
        memory: 2 * size_of::<VisiblePoint>() as u64,
        // Version 1 had no error per point.
        version: 2,
        ..kind::<VisiblePoint>(25, "visibility points", POINT)
    },
    SectionKind {
        // Components have 8 bits. Version 1 had 16.
        version: 2,
        ..kind::<u32>(26, "visibility basis", PAIR)
    },
    kind::<f32>(27, "visibility scales", COUNT),
    kind::<u32>(28, "visibility coefficients", PAIR),
];

/// Returns the sections of `visibility`. `kinds` are the entries of [`KINDS`] in the table.
pub(super) fn sections(visibility: &Visibility, kinds: &'static [SectionKind]) -> Vec<Section> {
    let grid = visibility.grid;
    let shape = [grid.columns, grid.rows];
    vec![
        section(&kinds[0], COUNT, &shape),
        section(&kinds[1], CLUSTER, &visibility.clusters),
        section(&kinds[2], POINT, &visibility.points),
        section(&kinds[3], PAIR, &visibility.basis),
        section(&kinds[4], COUNT, &visibility.scales),
        section(&kinds[5], PAIR, &visibility.coefficients),
    ]
}

/// Reads the visibility of a file. Returns `None` if it has none.
pub(super) fn read(
    file: &Container<'_>,
    kinds: &'static [SectionKind],
) -> Result<Option<Visibility>, AssetError> {
    if !file.has(&kinds[0]) {
        return match kinds.iter().find(|k| file.has(k)) {
            Some(kind) => Err(section_error(
                kind,
                "is present, but the section `visibility` is missing",
            )),
            None => Ok(None),
        };
    }
    let shape: Vec<u32> = items(file, &kinds[0], COUNT)?;
    let &[columns, rows] = shape.as_slice() else {
        return Err(section_error(
            &kinds[0],
            format!("{} words instead of {SHAPE_WORDS}", shape.len()),
        ));
    };
    let mut out = Visibility {
        grid: HemisphereGrid { columns, rows },
        clusters: items(file, &kinds[1], CLUSTER)?,
        points: items(file, &kinds[2], POINT)?,
        basis: items(file, &kinds[3], PAIR)?,
        scales: items(file, &kinds[4], COUNT)?,
        coefficients: items(file, &kinds[5], PAIR)?,
    };
    if u64::from(columns) * u64::from(rows) > MAX_DIRECTIONS {
        return Err(section_error(
            &kinds[0],
            format!("{columns} × {rows} directions"),
        ));
    }
    out.layout()
        .ok_or_else(|| section_error(&kinds[1], "the lengths of the arrays overflow"))?;
    Ok(Some(out))
}

impl SceneData {
    /// Checks that every lookup of the kernel `soft_shadow` stays within the arrays and reads
    /// finite values.
    pub(super) fn check_visibility(&self, check: &mut Check) {
        let Some(v) = &self.visibility else { return };
        let directions = u64::from(v.grid.columns) * u64::from(v.grid.rows);
        check.section(
            (1..=MAX_DIRECTIONS).contains(&directions),
            "visibility",
            || format!("{} × {} directions", v.grid.columns, v.grid.rows),
        );
        // At least all senders, and complete levels. Points after them use the mean of their
        // parents.
        let whole = (self.sender_levels as usize..=self.levels())
            .any(|l| self.level_starts.get(l).map(|&s| s as usize) == Some(v.points.len()));
        check.section(whole, "visibility points", || {
            format!(
                "{}, but must be all points of complete levels, at least the {} senders",
                v.points.len(),
                self.senders()
            )
        });
        check.section(
            v.clusters.len() <= v.points.len(),
            "visibility clusters",
            || format!("{} for {} points", v.clusters.len(), v.points.len()),
        );
        for (i, c) in v.clusters.iter().enumerate() {
            let tangent = Vec3::from_array(c.tangent);
            let sound = (tangent.length_squared() - 1.0).abs() < 1e-3;
            check.item(sound, "visibility clusters", i, || {
                format!("tangent {tangent} is not of unit length")
            });
            let sound = c.near.is_normal() && c.near > 0.0;
            check.item(sound, "visibility clusters", i, || {
                format!("depths relative to {} m", c.near)
            });
            let max = Visibility::MAX_COMPONENTS;
            check.item(c.components <= max, "visibility clusters", i, || {
                format!("{} components, at most {max}", c.components)
            });
            if check.is_full() {
                return;
            }
        }
        for (i, p) in v.points.iter().enumerate() {
            let components = match v.clusters.get(p.cluster as usize) {
                Some(cluster) => cluster.components,
                None => 0,
            };
            let named = (p.cluster as usize) < v.clusters.len();
            check.item(named, "visibility points", i, || {
                format!("cluster {} of {}", p.cluster, v.clusters.len())
            });
            let beyond = (components..Visibility::MAX_COMPONENTS)
                .any(|j| p.mask[j as usize / 32] >> (j % 32) & 1 != 0);
            check.item(!beyond, "visibility points", i, || {
                format!("has coefficients of more than {components} components")
            });
            if check.is_full() {
                return;
            }
        }
        for (i, &scale) in v.scales.iter().enumerate() {
            let sound = (0.0..=MAX_SCALE).contains(&scale);
            check.item(sound, "visibility scales", i, || format!("{scale}"));
        }
        // The remaining checks require valid lengths.
        if !check.0.is_empty() {
            return;
        }
        let mut placed = Visibility {
            grid: v.grid,
            clusters: v.clusters.clone(),
            points: v.points.clone(),
            ..Visibility::default()
        };
        let ends = placed.layout();
        let starts = placed.clusters == v.clusters && placed.points == v.points;
        check.section(starts, "visibility", || {
            "the data of clusters or points is not contiguous".into()
        });
        let found = (v.basis.len(), v.scales.len(), v.coefficients.len());
        check.section(ends == Some(found), "visibility", || {
            format!("basis, scales and coefficients have the lengths {found:?} instead of {ends:?}")
        });
    }
}
