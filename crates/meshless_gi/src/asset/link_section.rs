//! Section of the operator's links: the precision of each sender, then row after row in the order
//! of their links, in chunks of many rows. A chunk has eight streams of numbers, each coded by Pco
//! (pcodec), which adapts to the distribution of the numbers: the code of each row's step, the
//! difference of each link's sender to the one before in the row, three coordinates of each
//! quantized link, and the three halves of each other link.
//!
//! A link that does not follow from its coordinates is stored in halves, with its whole row.

use super::container::{Container, Section, SectionKind};
use super::error::{AssetError, Limits};
use super::section_io::{limit_error, section_error};
use crate::samples::Point;
use crate::transport::{Link, MAX_CODE, Operator, Row, RowQuantizer, row_order};
use pco::data_types::Number;
use pco::wrapped::{FileCompressor, FileDecompressor};
use pco::{ChunkConfig, DeltaSpec, ModeSpec, PagingSpec};

/// Links after which a chunk ends, with the row that has them.
const CHUNK: usize = 1 << 18;
/// Largest number of links of a row: one for each sender that an index can name.
const MAX_ROW: u32 = 1 << 16;
/// Largest memory of the decoder of a stream, bytes.
const SCRATCH: u64 = 3 << 18;
/// Pco's first byte of a stream of plain numbers: mode "classic" and no differences in its low and
/// high half. Other modes are refused, because they could request memory.
const CLASSIC: u8 = 0;

/// Numbers of a chunk.
#[derive(Default)]
struct Streams {
    steps: Vec<u16>,
    senders: Vec<u16>,
    coordinates: [Vec<i32>; 3],
    halves: [Vec<u16>; 3],
}

/// Rows and links of the operator in row order, split into chunks.
struct Chunks<'a> {
    rows: &'a [Row],
    order: Vec<u32>,
}

impl<'a> Chunks<'a> {
    fn new(rows: &'a [Row]) -> Self {
        let order = row_order(rows);
        Self { rows, order }
    }

    /// Returns the rows of each chunk.
    fn iter(&self) -> impl Iterator<Item = &[u32]> {
        let mut rest = &self.order[..];
        std::iter::from_fn(move || {
            let mut links = 0;
            let mut count = 0;
            while count < rest.len() && links < CHUNK && count < CHUNK {
                links += self.rows[rest[count] as usize].count as usize;
                count += 1;
            }
            let (chunk, behind) = rest.split_at(count);
            rest = behind;
            (count > 0).then_some(chunk)
        })
    }
}

/// Creates the section of an operator's links.
///
/// # Errors
/// [`AssetError::Section`] if a stream cannot be coded.
pub(super) fn section(
    kind: &'static SectionKind,
    operator: &Operator,
    points: &[Point],
    senders: usize,
) -> Result<Section, AssetError> {
    let mut raw = Vec::new();
    let precision: Vec<u16> = operator.precision.iter().map(|&code| code.into()).collect();
    write_stream(&mut raw, &precision).map_err(|error| section_error(kind, error))?;
    for chunk in Chunks::new(&operator.rows).iter() {
        let mut streams = Streams::default();
        for &i in chunk {
            streams.push_row(operator, i as usize, points, senders);
        }
        let written = streams.write(&mut raw);
        written.map_err(|error| section_error(kind, error))?;
    }
    Ok(Section {
        kind,
        items: raw.len(),
        raw,
    })
}

/// Content of the section.
pub(super) struct Links {
    pub links: Vec<Link>,
    pub steps: Vec<u8>,
    pub precision: Vec<u8>,
}

/// Rows and points of a reader.
struct RowGeometry<'a> {
    rows: &'a [Row],
    points: &'a [Point],
    senders: &'a [Point],
    precision: &'a [u8],
}

/// Reads the links of `rows`, and the codes of their steps. `rows` has its counts and starts.
///
/// # Errors
/// [`AssetError::Limit`] if the links take more memory than `limits` leaves.
/// [`AssetError::Section`] if the bytes are not those of these rows.
pub(super) fn read(
    file: &Container<'_>,
    kind: &SectionKind,
    rows: &[Row],
    points: &[Point],
    senders: usize,
    limits: &Limits,
) -> Result<Links, AssetError> {
    let (_, raw) = file
        .section(kind)?
        .ok_or_else(|| section_error(kind, "is missing"))?;
    if let Some(i) = rows.iter().position(|row| row.count > MAX_ROW) {
        let count = rows[i].count;
        return Err(section_error(kind, format!("row {i} has {count} links")));
    }
    let chunks = Chunks::new(rows);
    let count: u64 = rows.iter().map(|row| u64::from(row.count)).sum();
    let links_of = |chunk: &[u32]| -> u64 {
        let rows = chunk.iter().map(|&i| u64::from(rows[i as usize].count));
        rows.sum()
    };
    let largest = chunks.iter().map(links_of).max().unwrap_or(0);
    // A link takes 8 bytes, and at most 20 more while its chunk is read. A row takes a byte, and
    // three more while its chunk is read, and the order has a word.
    let memory = 8 * count + 20 * largest + 8 * rows.len() as u64 + SCRATCH;
    if file.memory.saturating_add(memory) > limits.max_bytes {
        return Err(limit_error("the links", limits));
    }
    let mut links = Vec::with_capacity(count as usize);
    let mut steps = vec![0; rows.len()];
    let mut rest = &raw[..];
    let precision: Vec<u16> =
        read_stream(&mut rest, senders + 1).map_err(|problem| section_error(kind, problem))?;
    let codes = precision.iter().map(|&code| u8::try_from(code));
    let precision: Vec<u8> = codes
        .collect::<Result<_, _>>()
        .map_err(|error| section_error(kind, error))?;
    let geometry = RowGeometry {
        rows,
        points,
        senders: points.get(..senders).unwrap_or_default(),
        precision: &precision,
    };
    for chunk in chunks.iter() {
        let streams = Streams::read(&mut rest, chunk.len(), links_of(chunk) as usize)
            .map_err(|problem| section_error(kind, problem))?;
        streams
            .rows(chunk, &geometry, &mut links, &mut steps)
            .ok_or_else(|| section_error(kind, "the streams differ in length"))?;
    }
    if !rest.is_empty() {
        return Err(section_error(
            kind,
            format!("{} bytes are left", rest.len()),
        ));
    }
    if steps.iter().all(|&code| code == 0) {
        steps.clear();
    }
    Ok(Links {
        links,
        steps,
        precision,
    })
}

impl Streams {
    /// Appends the links of row `i`.
    fn push_row(&mut self, operator: &Operator, i: usize, points: &[Point], senders: usize) {
        let row = &operator.rows[i];
        let links = &operator.links[row.start as usize..][..row.count as usize];
        let mut before = 0;
        self.senders.extend(links.iter().map(|link| {
            let sender = link.sender() as u16;
            let step = sender.wrapping_sub(before);
            before = sender;
            step
        }));
        let code = operator.steps.get(i).copied().unwrap_or(0);
        let quantizer =
            RowQuantizer::new(code, &points[i], &points[..senders], &operator.precision);
        let coordinates = quantizer.and_then(|row| {
            let of = |link: &Link| {
                let coordinates = row.coordinates(link.vector(), link.sender());
                (row.link(coordinates, link.sender()) == *link).then_some(coordinates)
            };
            links.iter().map(of).collect::<Option<Vec<_>>>()
        });
        let Some(coordinates) = coordinates else {
            self.steps.push(0);
            for link in links {
                let halves = [link.xy as u16, (link.xy >> 16) as u16, link.z_sender as u16];
                for (stream, half) in self.halves.iter_mut().zip(halves) {
                    stream.push(half);
                }
            }
            return;
        };
        self.steps.push(code.into());
        for of_link in coordinates {
            for (stream, coordinate) in self.coordinates.iter_mut().zip(of_link) {
                stream.push(coordinate);
            }
        }
    }

    /// Appends the links of the rows of a chunk to `links`, and sets the codes of their steps.
    /// Returns `None` if the streams have too few numbers, or too many.
    fn rows(
        &self,
        chunk: &[u32],
        geometry: &RowGeometry<'_>,
        links: &mut Vec<Link>,
        steps: &mut [u8],
    ) -> Option<()> {
        let mut next = self.senders.iter();
        let [x, y, z] = &self.coordinates;
        let mut coordinates = x.iter().zip(y).zip(z).map(|((&x, &y), &z)| [x, y, z]);
        let [x, y, z] = &self.halves;
        let mut halves = x.iter().zip(y).zip(z).map(|((&x, &y), &z)| [x, y, z]);
        for (&i, &code) in chunk.iter().zip(&self.steps) {
            let i = i as usize;
            let code = u8::try_from(code).ok().filter(|&code| code <= MAX_CODE)?;
            let receiver = geometry.points.get(i)?;
            let quantizer = RowQuantizer::new(code, receiver, geometry.senders, geometry.precision);
            steps[i] = code;
            let mut sender = 0u16;
            for step in next.by_ref().take(geometry.rows[i].count as usize) {
                sender = sender.wrapping_add(*step);
                links.push(match &quantizer {
                    Some(row) => row.link(coordinates.next()?, sender.into()),
                    None => {
                        let [x, y, z] = halves.next()?.map(u32::from);
                        Link {
                            xy: x | y << 16,
                            z_sender: z | u32::from(sender) << 16,
                        }
                    }
                });
            }
        }
        (coordinates.next().is_none() && halves.next().is_none()).then_some(())
    }

    /// Appends the coded streams.
    fn write(&self, out: &mut Vec<u8>) -> Result<(), pco::errors::PcoError> {
        write_stream(out, &self.steps)?;
        write_stream(out, &self.senders)?;
        for stream in &self.coordinates {
            write_stream(out, stream)?;
        }
        for stream in &self.halves {
            write_stream(out, stream)?;
        }
        Ok(())
    }

    /// Reads the streams of a chunk with this number of rows and links.
    fn read(rest: &mut &[u8], rows: usize, links: usize) -> Result<Self, String> {
        let mut out = Self {
            steps: read_stream(rest, rows)?,
            senders: read_stream(rest, links)?,
            ..Self::default()
        };
        if out.steps.len() != rows || out.senders.len() != links {
            return Err("a chunk has too few rows or links".into());
        }
        for stream in &mut out.coordinates {
            *stream = read_stream(rest, links)?;
        }
        let left = links - out.coordinates[0].len();
        for stream in &mut out.halves {
            *stream = read_stream(rest, left)?;
        }
        let [x, y, z] = out.coordinates.each_ref().map(Vec::len);
        let [h, k, l] = out.halves.each_ref().map(Vec::len);
        match x == y && x == z && h == k && h == l {
            true => Ok(out),
            false => Err("the components of links differ in number".into()),
        }
    }
}

/// Appends a stream: the number of its numbers, the number of its bytes, and the bytes.
fn write_stream<T: Number>(out: &mut Vec<u8>, numbers: &[T]) -> Result<(), pco::errors::PcoError> {
    out.extend((numbers.len() as u32).to_le_bytes());
    let mut bytes = Vec::new();
    if !numbers.is_empty() {
        let file = FileCompressor::default();
        let config = ChunkConfig::default()
            .with_mode_spec(ModeSpec::Classic)
            .with_delta_spec(DeltaSpec::NoOp)
            .with_paging_spec(PagingSpec::Exact(vec![numbers.len()]));
        let mut chunk = file.chunk_compressor(numbers, &config)?;
        bytes = file.write_header(bytes)?;
        bytes = chunk.write_meta(bytes)?;
        bytes = chunk.write_page(0, bytes)?;
    }
    out.extend((bytes.len() as u32).to_le_bytes());
    out.extend(bytes);
    Ok(())
}

/// Reads a stream of at most `max` numbers, and moves `rest` behind it.
fn read_stream<T: Number + Default>(rest: &mut &[u8], max: usize) -> Result<Vec<T>, String> {
    let (head, behind) = rest.split_at_checked(8).ok_or("it is cut off")?;
    let word = |at: usize| u32::from_le_bytes(head[at..at + 4].try_into().unwrap_or_default());
    let (count, length) = (word(0) as usize, word(4) as usize);
    let (bytes, behind) = behind.split_at_checked(length).ok_or("it is cut off")?;
    *rest = behind;
    if count > max {
        return Err(format!(
            "a stream has {count} numbers, at most {max} are possible"
        ));
    }
    let mut numbers = vec![T::default(); count];
    if count == 0 {
        return match length {
            0 => Ok(numbers),
            _ => Err(format!("a stream without numbers has {length} bytes")),
        };
    }
    let text = |error: pco::errors::PcoError| error.to_string();
    let (file, bytes) = FileDecompressor::new(bytes).map_err(text)?;
    if bytes.first() != Some(&CLASSIC) {
        return Err("a stream has an unknown mode".into());
    }
    let (mut chunk, bytes) = file.chunk_decompressor::<T, _>(bytes).map_err(text)?;
    let mut page = chunk.page_decompressor(bytes, count).map_err(text)?;
    let progress = page.read(&mut numbers).map_err(text)?;
    let left = page.into_src().len();
    match progress.finished && progress.n_processed == count && left == 0 {
        true => Ok(numbers),
        false => Err(format!("a stream has {left} bytes behind its numbers")),
    }
}
