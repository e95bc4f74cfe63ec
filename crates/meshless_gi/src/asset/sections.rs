//! Conversion between a baked scene and the sections of a `.mgi` file: the section and layout of
//! each array.
//!
//! Lossless: the scene that is read equals the scene that was written. Derived data is not stored:
//! the starts of rows (their lengths are stored), and unused fields. The display's grid is stored
//! only if a rebuild gives another one.

use super::codec::Layout;
use super::container::{Container, Section, SectionKind, assemble};
use super::error::{AssetError, Limits};
use super::fmm;
use super::info::BakeInfo;
use super::layouts::{
    BOUNCE, COLOR, COLUMN, COUNT, INDEX, LIGHT_SAMPLE, NODE, PLANE, POINT, ROW, SLOT, SURFACE,
    TRIANGLE, VALUE, WEIGHT,
};
use super::scene_data::{FlatBasis, LightSamples, PointSurface, SceneData};
use super::section_info::SectionInfo;
use super::section_io::{counts, items, limit_error, rebuild_grid, section, section_error, starts};
use super::{link_section, materials, occluders, probes, sky, visibility};
use crate::basis::{WeightEntry, Weights};
use crate::samples::{GridSlot, HashedGrid, LightSample, Point};
use crate::scene::{Bvh, BvhNode, BvhTriangle};
use crate::transport::pca::{Column, Compression};
use crate::transport::{BounceLink, BounceOperator, Operator, Row, SenderForm, place_links};

/// Largest number of items of any array: the range of a 32-bit index.
const MAX: u64 = u32::MAX as u64;

/// Returns a kind of section in its first version, with at most 2³² − 1 items.
pub(super) const fn kind<T>(code: u32, name: &'static str, layout: Layout) -> SectionKind {
    SectionKind {
        code,
        name,
        version: 1,
        raw: layout.item_bytes() as u64,
        memory: size_of::<T>() as u64,
        max: MAX,
    }
}

/// Returns a kind of section of counts. They are in memory twice during conversion to starts.
const fn kind_of_counts(code: u32, name: &'static str) -> SectionKind {
    SectionKind {
        memory: 8,
        ..kind::<u32>(code, name, COUNT)
    }
}

/// All kinds of sections, ascending.
static KINDS: [SectionKind; 49] = [
    SectionKind {
        code: 1,
        name: "info",
        version: 1,
        raw: 1,
        // Memory of the text, the decoded facts and the parser.
        memory: 8,
        max: 1 << 20,
    },
    SectionKind {
        max: SHAPE_WORDS as u64,
        ..kind::<u32>(2, "shape", COUNT)
    },
    SectionKind {
        max: 32,
        ..kind::<u32>(3, "levels", INDEX)
    },
    kind::<Point>(4, "points", POINT),
    kind::<PointSurface>(5, "surfaces", SURFACE),
    kind_of_counts(6, "pull counts"),
    kind::<WeightEntry>(7, "pull weights", WEIGHT),
    kind_of_counts(8, "parent counts"),
    kind::<WeightEntry>(9, "parent weights", WEIGHT),
    SectionKind {
        // Reading also stores the order of the rows.
        memory: size_of::<Row>() as u64 + 4,
        ..kind::<Row>(10, "rows", ROW)
    },
    SectionKind {
        code: 11,
        name: "links",
        version: 2,
        // Bytes of streams. The reader of the section limits the memory of its links.
        raw: 1,
        memory: 1,
        max: MAX,
    },
    kind_of_counts(12, "bounce counts"),
    kind::<BounceLink>(13, "bounce links", BOUNCE),
    kind::<[f32; 4]>(14, "planes", PLANE),
    kind::<GridSlot>(15, "grid slots", SLOT),
    SectionKind {
        // Validation stores the starts of the lists.
        memory: 8,
        ..kind::<u32>(16, "grid entries", INDEX)
    },
    SectionKind {
        // One more byte: validation stores the depth of each node.
        memory: size_of::<BvhNode>() as u64 + 1,
        ..kind::<BvhNode>(17, "bvh nodes", NODE)
    },
    kind::<BvhTriangle>(18, "bvh triangles", TRIANGLE),
    kind::<LightSample>(19, "light samples", LIGHT_SAMPLE),
    kind::<Column>(20, "columns", COLUMN),
    // One more word: validation marks each sender that occurs.
    SectionKind {
        memory: 8,
        ..kind::<u32>(21, "column senders", INDEX)
    },
    kind::<u32>(22, "column values", VALUE),
    VISIBILITY[0],
    VISIBILITY[1],
    VISIBILITY[2],
    VISIBILITY[3],
    VISIBILITY[4],
    VISIBILITY[5],
    OCTREE[0],
    OCTREE[1],
    OCTREE[2],
    OCTREE[3],
    OCTREE[4],
    kind::<[f32; 3]>(34, "illumination", COLOR),
    PROBES[0],
    PROBES[1],
    PROBES[2],
    PROBES[3],
    PROBES[4],
    sky::KIND,
    MATERIALS[0],
    MATERIALS[1],
    MATERIALS[2],
    MATERIALS[3],
    OCCLUDERS[0],
    OCCLUDERS[1],
    OCCLUDERS[2],
    OCCLUDERS[3],
    OCCLUDERS[4],
];
const OCCLUDERS: [SectionKind; 5] = occluders::KINDS;
/// Index of the first section of the occluders.
const FIRST_OCCLUDER: usize = 44;
const MATERIALS: [SectionKind; 4] = materials::KINDS;
/// Index of the first section of the materials.
const FIRST_MATERIAL: usize = 40;
const PROBES: [SectionKind; 5] = probes::KINDS;
/// Index of the first section of the probes.
const FIRST_PROBES: usize = 34;
/// Index of the section of the sky's terms.
const SKY_INDEX: usize = 39;
const SKY: &SectionKind = &KINDS[SKY_INDEX];
const VISIBILITY: [SectionKind; 6] = visibility::KINDS;
/// Index of the first section of the visibility.
const FIRST_VISIBILITY: usize = 22;
const OCTREE: [SectionKind; 5] = fmm::KINDS;
/// Index of the first section of the octree.
const FIRST_OCTREE: usize = 28;
/// Index of the section of the illumination.
const ILLUMINATION_INDEX: usize = 33;

const INFO: &SectionKind = &KINDS[0];
const SHAPE: &SectionKind = &KINDS[1];
const LEVELS: &SectionKind = &KINDS[2];
const POINTS: &SectionKind = &KINDS[3];
const SURFACES: &SectionKind = &KINDS[4];
const PULL: [&SectionKind; 2] = [&KINDS[5], &KINDS[6]];
const PARENTS: [&SectionKind; 2] = [&KINDS[7], &KINDS[8]];
const ROWS: &SectionKind = &KINDS[9];
const LINKS: &SectionKind = &KINDS[10];
const BOUNCES: [&SectionKind; 2] = [&KINDS[11], &KINDS[12]];
const PLANES: &SectionKind = &KINDS[13];
const SLOTS: &SectionKind = &KINDS[14];
const ENTRIES: &SectionKind = &KINDS[15];
const NODES: &SectionKind = &KINDS[16];
const TRIANGLES: &SectionKind = &KINDS[17];
const LIGHT_SAMPLES: &SectionKind = &KINDS[18];
const COLUMNS: &SectionKind = &KINDS[19];
const MEMBERS: &SectionKind = &KINDS[20];
const VALUES: &SectionKind = &KINDS[21];
const ILLUMINATION: &SectionKind = &KINDS[ILLUMINATION_INDEX];

/// Words of the section "shape".
const SHAPE_WORDS: usize = 8;

/// Returns sizes and digests of the sections of a file, in their order.
///
/// # Errors
/// [`AssetError`] if the container is invalid. Contents are not checked.
pub fn list_sections(bytes: &[u8], limits: &Limits) -> Result<Vec<SectionInfo>, AssetError> {
    Container::parse(bytes, &KINDS, limits)?.list()
}

impl SceneData {
    /// Returns a valid scene as a `.mgi` file. See [`BakedScene::to_bytes`].
    pub(super) fn to_bytes(&self, info: &BakeInfo) -> Result<Vec<u8>, AssetError> {
        let info = ron::to_string(info).map_err(|e| section_error(INFO, e))?;
        if info.len() as u64 > INFO.max {
            return Err(section_error(
                INFO,
                format!("{} bytes of text, at most {}", info.len(), INFO.max),
            ));
        }
        let grid = &self.display.grid;
        let rebuilt = rebuild_grid(&self.points, grid.cell_size, u64::MAX).as_ref() == Some(grid);
        let bounces = self.bounces.as_ref();
        let shape = [
            self.sender_levels,
            match self.operator.form {
                SenderForm::Averages => 0,
                SenderForm::Differences => 1,
                SenderForm::Components => 2,
            },
            self.display.radius.to_bits(),
            grid.cell_size.to_bits(),
            u32::from(!rebuilt),
            u32::from(bounces.is_some()),
            bounces.map_or(0, |b| b.bounces),
            self.light_samples.per_sender,
        ];
        let positions = match self.operator.form {
            SenderForm::Components => 0,
            _ => self.senders(),
        };
        let mut sections = vec![
            Section {
                kind: INFO,
                items: info.len(),
                raw: info.into_bytes(),
            },
            section(SHAPE, COUNT, &shape),
            section(LEVELS, INDEX, &self.level_starts),
            section(POINTS, POINT, &self.points),
            section(SURFACES, SURFACE, &self.surfaces),
            section(PULL[0], COUNT, &counts(&self.pull.starts)),
            section(PULL[1], WEIGHT, &self.pull.entries),
            section(PARENTS[0], COUNT, &counts(&self.parents.starts)),
            section(PARENTS[1], WEIGHT, &self.parents.entries),
            section(ROWS, ROW, &self.operator.rows),
            link_section::section(LINKS, &self.operator, &self.points, positions)?,
        ];
        if let Some(b) = bounces {
            sections.push(section(BOUNCES[0], COUNT, &counts(&b.starts)));
            sections.push(section(BOUNCES[1], BOUNCE, &b.links));
        }
        sections.push(section(PLANES, PLANE, &self.display.planes));
        if !rebuilt {
            sections.push(section(SLOTS, SLOT, &grid.slots));
            sections.push(section(ENTRIES, INDEX, &grid.entries));
        }
        sections.push(section(NODES, NODE, &self.bvh.nodes));
        sections.push(section(TRIANGLES, TRIANGLE, &self.bvh.triangles));
        sections.push(section(
            LIGHT_SAMPLES,
            LIGHT_SAMPLE,
            &self.light_samples.list,
        ));
        if let Some(c) = &self.operator.compression {
            sections.push(section(COLUMNS, COLUMN, &c.columns));
            sections.push(section(MEMBERS, INDEX, &c.members));
            sections.push(section(VALUES, VALUE, &c.values));
        }
        if let Some(v) = &self.visibility {
            sections.extend(visibility::sections(
                v,
                &KINDS[FIRST_VISIBILITY..FIRST_OCTREE],
            ));
        }
        if let Some(octree) = &self.fmm {
            sections.extend(fmm::sections(
                octree,
                &KINDS[FIRST_OCTREE..ILLUMINATION_INDEX],
            ));
        }
        if !self.illumination.is_empty() {
            sections.push(section(ILLUMINATION, COLOR, &self.illumination));
        }
        if let Some(p) = &self.probes {
            sections.extend(probes::sections(p, &KINDS[FIRST_PROBES..SKY_INDEX]));
        }
        if let Some(sky) = &self.sky {
            sections.push(sky::sections(sky, SKY));
        }
        if let Some(materials) = &self.materials {
            let kinds = &KINDS[FIRST_MATERIAL..FIRST_OCCLUDER];
            sections.extend(materials::sections(materials, kinds)?);
        }
        if let Some(o) = &self.occluders {
            sections.extend(occluders::sections(o, &self.bvh, &KINDS[FIRST_OCCLUDER..])?);
        }
        Ok(assemble(&sections))
    }

    /// Reads a `.mgi` file and its facts from memory, and does not validate them. See
    /// [`BakedScene::from_bytes`].
    pub(super) fn from_bytes(
        bytes: &[u8],
        limits: &Limits,
    ) -> Result<(Self, BakeInfo), AssetError> {
        let file = Container::parse(bytes, &KINDS, limits)?;
        let shape: Vec<u32> = items(&file, SHAPE, COUNT)?;
        let &[
            sender_levels,
            form,
            radius,
            cell_size,
            grid_stored,
            has_bounces,
            bounces,
            per_sender,
        ] = shape.as_slice()
        else {
            return Err(section_error(
                SHAPE,
                format!("{} words instead of {SHAPE_WORDS}", shape.len()),
            ));
        };
        let form = sender_form(form)?;
        let points: Vec<Point> = items(&file, POINTS, POINT)?;
        let surfaces: Vec<PointSurface> = items(&file, SURFACES, SURFACE)?;
        let mut rows: Vec<Row> = items(&file, ROWS, ROW)?;
        place_links(&mut rows).ok_or_else(|| section_error(ROWS, "the counts overflow"))?;
        let level_starts: Vec<u32> = items(&file, LEVELS, INDEX)?;
        // An invalid number of senders is an error of `validate`.
        let senders = level_starts.get(sender_levels as usize).copied();
        let senders = match form {
            SenderForm::Components => 0,
            _ => senders.map_or(0, |end| (end as usize).min(points.len())),
        };
        let links = link_section::read(&file, LINKS, &rows, &points, senders, limits)?;
        // The size of the section does not bound the memory of its links.
        let limits = &Limits {
            max_bytes: limits.max_bytes - size_of_val(&links.links[..]) as u64,
        };
        let grid = display_grid(
            &file,
            &points,
            f32::from_bits(cell_size),
            grid_stored,
            limits,
        )?;
        let bounces = bounce_operator(&file, has_bounces, bounces)?;
        let fmm = fmm::read(&file, &KINDS[FIRST_OCTREE..ILLUMINATION_INDEX], &surfaces)?;
        let mut triangles: Vec<BvhTriangle> = items(&file, TRIANGLES, TRIANGLE)?;
        let kinds = &KINDS[FIRST_OCCLUDER..];
        let occluders = occluders::read(&file, &mut triangles, kinds)?;
        let info = info(&file)?;
        let scene = Self {
            points,
            surfaces,
            level_starts,
            sender_levels,
            light_samples: LightSamples {
                per_sender,
                list: items(&file, LIGHT_SAMPLES, LIGHT_SAMPLE)?,
            },
            pull: weights(&file, PULL)?,
            parents: weights(&file, PARENTS)?,
            operator: Operator {
                form,
                compression: compression(&file, form)?,
                rows,
                links: links.links,
                steps: links.steps,
                precision: links.precision,
            },
            bounces,
            visibility: visibility::read(&file, &KINDS[FIRST_VISIBILITY..FIRST_OCTREE])?,
            fmm,
            sky: sky::read(&file, SKY)?,
            materials: materials::read(&file, &KINDS[FIRST_MATERIAL..FIRST_OCCLUDER])?,
            illumination: match file.has(ILLUMINATION) {
                true => items(&file, ILLUMINATION, COLOR)?,
                false => Vec::new(),
            },
            probes: probes::read(&file, &KINDS[FIRST_PROBES..SKY_INDEX], limits)?,
            display: FlatBasis {
                radius: f32::from_bits(radius),
                planes: items(&file, PLANES, PLANE)?,
                grid,
            },
            bvh: Bvh {
                nodes: items(&file, NODES, NODE)?,
                triangles,
            },
            occluders,
            bounds: info.bounds,
        };
        Ok((scene, info))
    }
}

/// Returns the form of the operator from its number in the section "shape".
fn sender_form(number: u32) -> Result<SenderForm, AssetError> {
    match number {
        0 => Ok(SenderForm::Averages),
        1 => Ok(SenderForm::Differences),
        2 => Ok(SenderForm::Components),
        other => {
            let message = format!("unknown form {other} of the operator");
            Err(section_error(SHAPE, message))
        }
    }
}

/// Returns the grid of the display: stored, or rebuilt from the points.
fn display_grid(
    file: &Container<'_>,
    points: &[Point],
    cell_size: f32,
    is_stored: u32,
    limits: &Limits,
) -> Result<HashedGrid, AssetError> {
    match is_stored {
        0 => {
            let left = limits.max_bytes - file.memory;
            absent(file, [SLOTS, ENTRIES])?;
            rebuild_grid(points, cell_size, left)
                .ok_or_else(|| limit_error("the display's grid", limits))
        }
        1 => Ok(HashedGrid {
            cell_size,
            slots: items(file, SLOTS, SLOT)?,
            entries: items(file, ENTRIES, INDEX)?,
        }),
        other => Err(section_error(
            SHAPE,
            format!("the grid flag is {other}, but must be 0 or 1"),
        )),
    }
}

/// Reads the operator of baked bounces. `None` if the file has none.
fn bounce_operator(
    file: &Container<'_>,
    is_stored: u32,
    bounces: u32,
) -> Result<Option<BounceOperator>, AssetError> {
    match is_stored {
        0 if bounces == 0 => {
            absent(file, BOUNCES)?;
            Ok(None)
        }
        1 => Ok(Some(BounceOperator {
            starts: starts(file, BOUNCES[0])?,
            links: items(file, BOUNCES[1], BOUNCE)?,
            bounces,
        })),
        other => Err(section_error(
            SHAPE,
            format!("bounce flag {other} with {bounces} bounces, expected 1, or 0 with 0 bounces"),
        )),
    }
}

fn absent(file: &Container<'_>, kinds: [&SectionKind; 2]) -> Result<(), AssetError> {
    for kind in kinds {
        if file.has(kind) {
            return Err(section_error(
                kind,
                "is present, but the section `shape` does not declare it",
            ));
        }
    }
    Ok(())
}

fn weights(
    file: &Container<'_>,
    [counts, entries]: [&SectionKind; 2],
) -> Result<Weights, AssetError> {
    Ok(Weights {
        starts: starts(file, counts)?,
        entries: items(file, entries, WEIGHT)?,
    })
}

/// Reads the matrix of an operator of components. `None` for the other forms.
fn compression(file: &Container<'_>, form: SenderForm) -> Result<Option<Compression>, AssetError> {
    if form != SenderForm::Components {
        absent(file, [COLUMNS, MEMBERS])?;
        absent(file, [VALUES, VALUES])?;
        return Ok(None);
    }
    Ok(Some(Compression {
        columns: items(file, COLUMNS, COLUMN)?,
        members: items(file, MEMBERS, INDEX)?,
        values: items(file, VALUES, VALUE)?,
    }))
}

fn info(file: &Container<'_>) -> Result<BakeInfo, AssetError> {
    let (_, raw) = file
        .section(INFO)?
        .ok_or_else(|| section_error(INFO, "is missing"))?;
    let text = std::str::from_utf8(&raw).map_err(|e| section_error(INFO, e))?;
    ron::from_str(text).map_err(|e| section_error(INFO, e))
}
