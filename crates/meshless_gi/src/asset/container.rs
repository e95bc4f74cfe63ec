//! Container of a `.mgi` file: header, section table, checksums, compression. It is independent of
//! scenes. `docs/FORMAT.md` has the layout.

use super::error::{AssetError, Limits};
use super::section_info::SectionInfo;
use std::borrow::Cow;

/// First eight bytes. They are not text, and any conversion of text damages them.
pub(super) const MAGIC: [u8; 8] = *b"\x89MGI\r\n\x1a\n";
/// Version of the format. It changes with the layout only.
pub const VERSION: u32 = 3;
/// Bytes of the header before the table.
const HEADER: usize = 32;
/// Bytes of one row of the table.
const ENTRY: usize = 40;
/// Largest number of sections. No version has as many.
const MAX_SECTIONS: u32 = 64;
/// Largest expansion of LZ4, bytes per compressed byte.
const LZ4_RATIO: u64 = 255;

/// Memory of a read that does not grow with the file, bytes: ends of arrays, messages.
const SLACK: u64 = 1 << 16;

/// Encoding of a section's bytes.
const STORED: u16 = 0;
const LZ4: u16 = 1;

/// Content of a section: the required entry of the table, and the size in memory.
#[derive(Clone, Copy, Debug)]
pub(super) struct SectionKind {
    /// Number in the table. Sections are in ascending order of it.
    pub code: u32,
    /// Name for messages.
    pub name: &'static str,
    /// Version of the section's own layout.
    pub version: u16,
    /// Raw bytes of an item.
    pub raw: u64,
    /// Bytes of memory of a decoded item.
    pub memory: u64,
    /// Largest number of items.
    pub max: u64,
}

/// Section of a file to write.
pub(super) struct Section {
    pub kind: &'static SectionKind,
    pub items: usize,
    pub raw: Vec<u8>,
}

/// Assembles a file from sections. The same sections give the same bytes.
pub(super) fn assemble(sections: &[Section]) -> Vec<u8> {
    let bodies: Vec<(u16, Cow<'_, [u8]>)> = sections
        .iter()
        .map(|s| {
            let packed = lz4_flex::block::compress(&s.raw);
            if packed.len() < s.raw.len() {
                (LZ4, packed.into())
            } else {
                (STORED, s.raw.as_slice().into())
            }
        })
        .collect();
    let start = HEADER + ENTRY * sections.len();
    let length = start + bodies.iter().map(|(_, b)| b.len()).sum::<usize>();
    let mut out = Vec::with_capacity(length);
    out.extend(MAGIC);
    out.extend(VERSION.to_le_bytes());
    out.extend((sections.len() as u32).to_le_bytes());
    out.extend((length as u64).to_le_bytes());
    out.extend([0; 8]);
    for (section, (compression, body)) in sections.iter().zip(&bodies) {
        out.extend(section.kind.code.to_le_bytes());
        out.extend(section.kind.version.to_le_bytes());
        out.extend(compression.to_le_bytes());
        out.extend((section.items as u64).to_le_bytes());
        out.extend((body.len() as u64).to_le_bytes());
        out.extend((section.raw.len() as u64).to_le_bytes());
        out.extend(crc32fast::hash(body).to_le_bytes());
        out.extend([0; 4]);
    }
    let crc = header_crc(&out);
    out[24..28].copy_from_slice(&crc.to_le_bytes());
    for (_, body) in &bodies {
        out.extend_from_slice(body);
    }
    out
}

/// Computes the CRC-32 of header and table, with zero in the field that holds it.
fn header_crc(header: &[u8]) -> u32 {
    let mut crc = crc32fast::Hasher::new();
    crc.update(&header[..24]);
    crc.update(&[0; 4]);
    crc.update(&header[28..]);
    crc.finalize()
}

/// Row of the table, and the bytes of its section.
struct TableEntry<'a> {
    kind: &'static SectionKind,
    compression: u16,
    items: u64,
    raw: u64,
    crc: u32,
    body: &'a [u8],
}

/// Number of items of a section, and its raw bytes.
pub(super) type Content<'a> = (usize, Cow<'a, [u8]>);

/// File with a valid header and table, within the memory limit.
pub(super) struct Container<'a> {
    entries: Vec<TableEntry<'a>>,
    /// Largest memory of the decoded items and the decoding, bytes.
    pub memory: u64,
}

/// Returns `true` if `bytes` start as a `.mgi` file does, even if they are incomplete.
#[must_use]
pub fn is_container(bytes: &[u8]) -> bool {
    bytes.starts_with(&MAGIC)
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap_or_default())
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap_or_default())
}

/// Reads the table of sections, and checks each row against its kind and the bytes that are left.
/// `rest` starts behind the table.
fn read_table<'a>(
    table: &[u8],
    mut rest: &'a [u8],
    kinds: &'static [SectionKind],
) -> Result<Vec<TableEntry<'a>>, AssetError> {
    let header = |problem: String| AssetError::Header { problem };
    let mut entries: Vec<TableEntry<'a>> = Vec::with_capacity(table.len() / ENTRY);
    for row in table.chunks_exact(ENTRY) {
        let code = u32_at(row, 0);
        let Some(kind) = kinds.iter().find(|k| k.code == code) else {
            return Err(header(format!("unknown section {code}")));
        };
        if entries.last().is_some_and(|e| e.kind.code >= code) {
            return Err(header(format!("section `{}` is out of order", kind.name)));
        }
        let section_error = |problem: String| AssetError::Section {
            section: kind.name,
            problem,
        };
        let version = u32_at(row, 4) as u16;
        let compression = (u32_at(row, 4) >> 16) as u16;
        let (items, stored, raw) = (u64_at(row, 8), u64_at(row, 16), u64_at(row, 24));
        if version != kind.version {
            return Err(section_error(format!(
                "version {version}, expected {}",
                kind.version
            )));
        }
        if items > kind.max || items.checked_mul(kind.raw) != Some(raw) {
            return Err(section_error(format!(
                "{items} items do not fit {raw} bytes, or are too many"
            )));
        }
        let possible = match compression {
            STORED => raw == stored,
            LZ4 => raw <= stored.saturating_mul(LZ4_RATIO),
            other => return Err(section_error(format!("unknown compression {other}"))),
        };
        if !possible {
            return Err(section_error(format!("{stored} bytes cannot hold {raw}")));
        }
        if u32_at(row, 36) != 0 {
            return Err(section_error("a reserved field is not zero".into()));
        }
        if stored > rest.len() as u64 {
            return Err(section_error(format!(
                "{stored} bytes, but {} are left",
                rest.len()
            )));
        }
        let (body, behind) = rest.split_at(stored as usize);
        rest = behind;
        entries.push(TableEntry {
            kind,
            compression,
            items,
            raw,
            crc: u32_at(row, 32),
            body,
        });
    }
    if !rest.is_empty() {
        return Err(header(format!("{} bytes are in no section", rest.len())));
    }
    Ok(entries)
}

impl<'a> Container<'a> {
    /// Reads header and table, and checks both against the bytes, `kinds` and `limits`.
    pub fn parse(
        bytes: &'a [u8],
        kinds: &'static [SectionKind],
        limits: &Limits,
    ) -> Result<Self, AssetError> {
        let header = |problem: String| AssetError::Header { problem };
        let found = bytes.len() as u64;
        if bytes.len() < MAGIC.len() || bytes[..MAGIC.len()] != MAGIC {
            return Err(AssetError::NotMgi);
        }
        let truncated = |needed: u64| AssetError::Truncated { needed, found };
        if bytes.len() < HEADER {
            return Err(truncated(HEADER as u64));
        }
        let version = u32_at(bytes, 8);
        if version != VERSION {
            return Err(AssetError::Version {
                found: version,
                expected: VERSION,
            });
        }
        let count = u32_at(bytes, 12);
        if count > MAX_SECTIONS {
            return Err(header(format!("{count} sections")));
        }
        let start = HEADER + ENTRY * count as usize;
        let length = u64_at(bytes, 16);
        if found < length || bytes.len() < start {
            return Err(truncated(length.max(start as u64)));
        }
        if found > length {
            return Err(header(format!("{} bytes after the end", found - length)));
        }
        if header_crc(&bytes[..start]) != u32_at(bytes, 24) {
            return Err(AssetError::Checksum { section: "header" });
        }
        if u32_at(bytes, 28) != 0 {
            return Err(header("a reserved field is not zero".into()));
        }
        let entries = read_table(&bytes[HEADER..start], &bytes[start..], kinds)?;
        let decoded = entries.iter().fold(0u64, |sum, e| {
            sum.saturating_add(e.items.saturating_mul(e.kind.memory))
        });
        let largest = entries.iter().map(|e| e.raw).max().unwrap_or(0);
        let memory = decoded.saturating_add(largest).saturating_add(SLACK);
        if memory > limits.max_bytes {
            return Err(AssetError::Limit {
                what: "the scene",
                needed: memory,
                allowed: limits.max_bytes,
            });
        }
        Ok(Self { entries, memory })
    }

    /// Returns sizes and digests of all sections, in the order of the file.
    pub fn list(&self) -> Result<Vec<SectionInfo>, AssetError> {
        let info = |entry: &TableEntry<'a>| {
            let (_, raw) = self.section(entry.kind)?.unwrap_or_default();
            Ok(SectionInfo {
                name: entry.kind.name,
                items: entry.items,
                bytes: entry.body.len() as u64,
                raw_bytes: entry.raw,
                digest: blake3::hash(&raw).to_hex().to_string(),
            })
        };
        self.entries.iter().map(info).collect()
    }

    /// Returns `true` if the file has a section of this kind.
    pub fn has(&self, kind: &SectionKind) -> bool {
        self.entries.iter().any(|e| e.kind.code == kind.code)
    }

    /// Returns the number of items and the raw bytes of a section. `None` if the file has no
    /// section of this kind.
    pub fn section(&self, kind: &SectionKind) -> Result<Option<Content<'a>>, AssetError> {
        let Some(entry) = self.entries.iter().find(|e| e.kind.code == kind.code) else {
            return Ok(None);
        };
        if crc32fast::hash(entry.body) != entry.crc {
            return Err(AssetError::Checksum { section: kind.name });
        }
        let raw = if entry.compression == STORED {
            Cow::Borrowed(entry.body)
        } else {
            let mut raw = vec![0; entry.raw as usize];
            match lz4_flex::block::decompress_into(entry.body, &mut raw) {
                Ok(length) if length == raw.len() => raw.into(),
                Ok(length) => {
                    return Err(AssetError::Section {
                        section: kind.name,
                        problem: format!("unpacks to {length} bytes instead of {}", entry.raw),
                    });
                }
                Err(e) => {
                    return Err(AssetError::Section {
                        section: kind.name,
                        problem: format!("does not unpack: {e}"),
                    });
                }
            }
        };
        Ok(Some((entry.items as usize, raw)))
    }
}
