//! Functions that the readers and writers of all sections share.

use super::codec::Layout;
use super::container::{Container, Section, SectionKind};
use super::error::{AssetError, Limits};
use super::layouts::COUNT;
use crate::basis::support_bounds;
use crate::samples::{HashedGrid, Point};
use bytemuck::Pod;

pub(super) fn section_error(kind: &SectionKind, problem: impl ToString) -> AssetError {
    AssetError::Section {
        section: kind.name,
        problem: problem.to_string(),
    }
}

pub(super) fn section<T: Pod>(kind: &'static SectionKind, layout: Layout, items: &[T]) -> Section {
    Section {
        kind,
        items: items.len(),
        raw: layout.encode(items),
    }
}

pub(super) fn items<T: Pod>(
    file: &Container<'_>,
    kind: &SectionKind,
    layout: Layout,
) -> Result<Vec<T>, AssetError> {
    let (count, raw) = file
        .section(kind)?
        .ok_or_else(|| section_error(kind, "is missing"))?;
    Ok(layout.decode(&raw, count))
}

/// Returns the lengths of rows from their starts.
pub(super) fn counts(starts: &[u32]) -> Vec<u32> {
    starts.windows(2).map(|w| w[1] - w[0]).collect()
}

/// Returns the starts of rows from their lengths.
pub(super) fn starts(file: &Container<'_>, kind: &SectionKind) -> Result<Vec<u32>, AssetError> {
    let (count, raw) = file
        .section(kind)?
        .ok_or_else(|| section_error(kind, "is missing"))?;
    let mut starts = Vec::with_capacity(count + 1);
    starts.push(0u32);
    starts.extend(COUNT.decode::<u32>(&raw, count));
    for i in 1..starts.len() {
        starts[i] = starts[i]
            .checked_add(starts[i - 1])
            .ok_or_else(|| section_error(kind, "the counts overflow"))?;
    }
    Ok(starts)
}

/// Returns the error of a grid that exceeds the allowed memory.
pub(super) fn limit_error(what: &'static str, limits: &Limits) -> AssetError {
    AssetError::Limit {
        what,
        needed: limits.max_bytes.saturating_add(1),
        allowed: limits.max_bytes,
    }
}

/// Rebuilds the grid of a basis from its points, as the bake builds it. Returns `None` if the grid
/// takes more than `max_bytes`. Also returns `None` if the cells are too small relative to the
/// functions to come from a bake.
pub(super) fn rebuild_grid(points: &[Point], cell_size: f32, max_bytes: u64) -> Option<HashedGrid> {
    if !(cell_size.is_finite() && cell_size > 0.0) {
        return HashedGrid::build_within(0, 1.0, |_| crate::scene::Bounds::EMPTY, max_bytes)
            .map(|g| HashedGrid { cell_size, ..g });
    }
    // Cells are as large as the largest function. A box then touches at most 4 of them along each
    // axis.
    let max = max_bytes.min(64 * 88 * points.len() as u64 + 1024);
    HashedGrid::build_within(points.len(), cell_size, |i| support_bounds(&points[i]), max)
}
