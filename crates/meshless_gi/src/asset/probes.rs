//! Probes of a baked scene with their rows of the operator: data in memory, sections of the file,
//! and validation. The five sections are present together or not at all. The starts of rows and the
//! grid follow from the other data, and are not stored.

use super::codec::{Field, Layout};
use super::container::{Container, Section, SectionKind};
use super::error::{AssetError, Limits};
use super::layouts::{COUNT, LINK, PLANE, ROW};
use super::scene_data::SceneData;
use super::section_io::{items, limit_error, rebuild_grid, section, section_error};
use super::sections::kind;
use super::validate::{MAX_LINK, TOLERANCE};
use super::violation::Check;
use crate::samples::{HashedGrid, Point};
use crate::transport::{Link, PROBE_ROWS, Row, place_links};
use glam::{Vec3, Vec4};

/// Probes of a baked scene: the light between surfaces, for dynamic objects.
#[derive(Clone, Debug, PartialEq)]
pub struct Probes {
    /// Positions, with the radii and clip planes of their functions. The normal is zero.
    pub points: Vec<Point>,
    /// Clip planes (n, d): a position p is on the function's side if n·p + d ≥ 0. `Point::planes`
    /// refers to them.
    pub planes: Vec<[f32; 4]>,
    /// Grid of the functions that may cover a position.
    pub grid: HashedGrid,
    /// [`PROBE_ROWS`] rows per probe: the incident light in spherical harmonics
    /// (`transport::probe_rows`). All are of tier 1.
    pub rows: Vec<Row>,
    /// Links to the operator's senders, the sky and, if baked, its terms. Row after row.
    pub links: Vec<Link>,
}

impl Probes {
    /// Largest number of probes of a scene.
    pub const MAX: usize = 1 << 20;

    /// Returns the size of all arrays in memory and on the device, bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let bytes = |length: usize, size: u64| length as u64 * size;
        bytes(self.points.len(), 32)
            + bytes(self.planes.len(), 16)
            + bytes(self.grid.slots.len(), 16)
            + bytes(self.grid.entries.len(), 4)
            + bytes(self.rows.len(), 16)
            + bytes(self.links.len(), 8)
    }
}

/// Layout of a probe, which has no normal.
const POINT: Layout = Layout::rows(&[
    Field::word(0),
    Field::word(1),
    Field::word(2),
    Field::word(3),
    Field::word(7).delta(),
]);
/// Words of the section "probes".
const SHAPE_WORDS: usize = 1;
/// Largest coefficient of a direction relative to its fraction of the sphere. 2 for linear terms,
/// 15/8 · 2/3 for quadratic ones.
pub(super) const MAX_PROBE_COEFFICIENT: f32 = 2.0;

/// Kinds of sections, ascending.
pub(super) const KINDS: [SectionKind; 5] = [
    SectionKind {
        max: SHAPE_WORDS as u64,
        ..kind::<u32>(40, "probes", COUNT)
    },
    SectionKind {
        max: Probes::MAX as u64,
        ..kind::<Point>(41, "probe points", POINT)
    },
    kind::<[f32; 4]>(42, "probe planes", PLANE),
    SectionKind {
        // Reading and validation also store the order of the rows.
        memory: size_of::<Row>() as u64 + 4,
        ..kind::<Row>(43, "probe rows", ROW)
    },
    kind::<Link>(44, "probe links", LINK),
];

/// Returns the sections of `probes`. `kinds` are the entries of [`KINDS`] in the table.
pub(super) fn sections(probes: &Probes, kinds: &'static [SectionKind]) -> Vec<Section> {
    vec![
        section(&kinds[0], COUNT, &[probes.grid.cell_size.to_bits()]),
        section(&kinds[1], POINT, &probes.points),
        section(&kinds[2], PLANE, &probes.planes),
        section(&kinds[3], ROW, &probes.rows),
        section(&kinds[4], LINK, &probes.links),
    ]
}

/// Reads the probes of a file. Returns `None` if it has none.
pub(super) fn read(
    file: &Container<'_>,
    kinds: &'static [SectionKind],
    limits: &Limits,
) -> Result<Option<Probes>, AssetError> {
    if !file.has(&kinds[0]) {
        return match kinds.iter().find(|k| file.has(k)) {
            Some(kind) => Err(section_error(
                kind,
                "is present, but the section `probes` is missing",
            )),
            None => Ok(None),
        };
    }
    let shape: Vec<u32> = items(file, &kinds[0], COUNT)?;
    let &[cell_size] = shape.as_slice() else {
        return Err(section_error(
            &kinds[0],
            format!("{} words instead of {SHAPE_WORDS}", shape.len()),
        ));
    };
    let points: Vec<Point> = items(file, &kinds[1], POINT)?;
    let mut rows: Vec<Row> = items(file, &kinds[3], ROW)?;
    place_links(&mut rows).ok_or_else(|| section_error(&kinds[3], "the counts overflow"))?;
    let left = limits.max_bytes - file.memory;
    let grid = rebuild_grid(&points, f32::from_bits(cell_size), left)
        .ok_or_else(|| limit_error("the probes' grid", limits))?;
    Ok(Some(Probes {
        points,
        planes: items(file, &kinds[2], PLANE)?,
        grid,
        rows,
        links: items(file, &kinds[4], LINK)?,
    }))
}

impl SceneData {
    /// Checks that every lookup of the kernel `probe` stays within the arrays and reads finite
    /// values.
    pub(super) fn check_probes(&self, check: &mut Check) {
        let Some(probes) = &self.probes else { return };
        let count = probes.points.len();
        check.section((1..=Probes::MAX).contains(&count), "probes", || {
            format!("{count}, expected 1 to {}", Probes::MAX)
        });
        for (i, p) in probes.points.iter().enumerate() {
            let sound = p.x().is_finite() && p.radius.is_finite() && p.radius > 0.0;
            check.item(sound, "probe points", i, || {
                format!("position {}, radius {} m", p.x(), p.radius)
            });
            check.item(p.n() == Vec3::ZERO, "probe points", i, || {
                format!("normal {} is not zero", p.n())
            });
            let planes = p.plane_range();
            check.item(planes.end <= probes.planes.len(), "probe points", i, || {
                format!("clip planes {planes:?} of {}", probes.planes.len())
            });
            if check.is_full() {
                return;
            }
        }
        for (i, plane) in probes.planes.iter().enumerate() {
            check.item(
                Vec4::from_array(*plane).is_finite(),
                "probe planes",
                i,
                || format!("{plane:?}"),
            );
        }
        check.section(
            probes.rows.len() == PROBE_ROWS * count,
            "probe rows",
            || format!("{} instead of {}", probes.rows.len(), PROBE_ROWS * count),
        );
        let mut end = 0u64;
        for (i, row) in probes.rows.iter().enumerate() {
            check.item(u64::from(row.start) == end, "probe rows", i, || {
                format!("starts at link {} instead of {end}", row.start)
            });
            end += u64::from(row.count);
            let sound = row.tier == 1 && (0.0..=MAX_LINK).contains(&row.scale);
            check.item(sound, "probe rows", i, || {
                format!("tier {}, scale {}", row.tier, row.scale)
            });
            if check.is_full() {
                return;
            }
        }
        check.section(end == probes.links.len() as u64, "probe rows", || {
            format!("have {end} links, but there are {}", probes.links.len())
        });
        let senders = self.operator.coefficients(self.senders()) + self.sky_terms();
        for (i, link) in probes.links.iter().enumerate() {
            let v = link.vector();
            let sound = v.is_finite() && v.abs().max_element() <= 1.0 + TOLERANCE;
            check.item(sound, "probe links", i, || format!("vector {v}"));
            check.item(link.sender() as usize <= senders, "probe links", i, || {
                format!("sender {} of {senders}", link.sender())
            });
            if check.is_full() {
                return;
            }
        }
        if !check.0.is_empty() {
            return;
        }
        // The light from all directions is at most the radiosity of all senders. The other
        // coefficients are not larger.
        for (i, rows) in probes.rows.chunks_exact(PROBE_ROWS).enumerate() {
            for row in rows {
                let links = &probes.links[row.start as usize..][..row.count as usize];
                let light = links
                    .iter()
                    .filter(|l| l.sender() as usize <= self.senders());
                let sum: Vec3 = light.map(|l| l.vector().abs()).sum::<Vec3>() * row.scale;
                check.item(
                    sum.max_element() <= MAX_PROBE_COEFFICIENT + TOLERANCE,
                    "probe rows",
                    i,
                    || format!("links sum to {sum}, at most {MAX_PROBE_COEFFICIENT}"),
                );
            }
        }
        let again = rebuild_grid(&probes.points, probes.grid.cell_size, u64::MAX);
        check.section(again.as_ref() == Some(&probes.grid), "probes", || {
            "the grid differs from that of the points".into()
        });
    }
}
