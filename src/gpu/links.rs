//! Chunks of the operator's links that fit a binding (WebGPU: 128 MiB), each for a range of rows.

use super::GpuError;
use meshless_gi::internals::transport::{Link, Row};
use std::ops::Range;

/// Rows whose links share a buffer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LinkChunk {
    /// Rows, as positions in the order of the links.
    pub rows: Range<u32>,
    /// Links of these rows.
    pub links: Range<u32>,
}

/// Splits the rows, sorted by their links, into chunks of at most `max` bytes of links.
///
/// # Errors
/// [`GpuError::TooLarge`] if the links of a single row exceed `max`.
pub fn split_links(rows: &[Row], max: u64) -> Result<Vec<LinkChunk>, GpuError> {
    let size = size_of::<Link>() as u64;
    let mut parts: Vec<LinkChunk> = Vec::new();
    let mut part = LinkChunk {
        rows: 0..0,
        links: 0..0,
    };
    for (i, row) in rows.iter().enumerate() {
        let i = i as u32;
        let row_links = row.start..row.start + row.count;
        if row.count > 0 && part.links.is_empty() {
            part.links = row_links;
        } else if row.count > 0 {
            let end = part.links.end.max(row_links.end);
            if row_links.start < part.links.start || u64::from(end - part.links.start) * size > max
            {
                parts.push(part);
                part = LinkChunk {
                    rows: i..i,
                    links: row_links,
                };
            } else {
                part.links.end = end;
            }
        }
        let bytes = u64::from(row.count) * size;
        if bytes > max {
            return Err(GpuError::TooLarge {
                what: "the links of one row",
                bytes,
                limit: max,
            });
        }
        part.rows.end = i + 1;
    }
    if !part.rows.is_empty() {
        parts.push(part);
    }
    Ok(parts)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(counts: &[u32]) -> Vec<Row> {
        let mut start = 0;
        counts
            .iter()
            .map(|&count| {
                let row = Row {
                    start,
                    count,
                    scale: 1.0,
                    tier: u32::from(count > 0),
                };
                start += count;
                row
            })
            .collect()
    }

    #[test]
    fn link_chunks_contain_each_row_once_within_limit() {
        let rows = rows(&[3, 0, 5, 8, 0, 0, 1, 7, 2]);
        for max in [64, 80, 1000] {
            let parts = split_links(&rows, max).unwrap();
            let mut next = 0;
            for part in &parts {
                assert_eq!(part.rows.start, next);
                next = part.rows.end;
                assert!(part.links.len() as u64 * 8 <= max);
                for row in &rows[part.rows.start as usize..part.rows.end as usize] {
                    assert!(
                        row.count == 0
                            || part.links.start <= row.start
                                && row.start + row.count <= part.links.end
                    );
                }
            }
            assert_eq!(next, 9);
        }
        assert_eq!(split_links(&rows, 1000).unwrap().len(), 1);
        assert!(matches!(
            split_links(&rows, 56),
            Err(GpuError::TooLarge { bytes: 64, .. })
        ));
        assert_eq!(split_links(&[], 8).unwrap(), []);
    }
}
