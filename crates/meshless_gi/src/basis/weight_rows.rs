//! Sparse interpolation weights: rows of (index, weight). Parents and pull both use such rows.

use bytemuck::{Pod, Zeroable};

/// One weight of a row. 8 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct WeightEntry {
    /// Index of the point.
    pub index: u32,
    /// Normalized weight, dimensionless.
    pub weight: f32,
}

/// Compressed sparse rows of weights. Row `i` is `entries[starts[i]..starts[i + 1]]`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Weights {
    /// Start of each row, and the end of the last.
    pub starts: Vec<u32>,
    /// Entries of all rows, row after row.
    pub entries: Vec<WeightEntry>,
}

impl Weights {
    /// Creates rows from lists, in order.
    pub fn from_rows<R: IntoIterator<Item = WeightEntry>>(
        rows: impl IntoIterator<Item = R>,
    ) -> Self {
        let mut out = Self {
            starts: vec![0],
            entries: Vec::new(),
        };
        out.append(rows);
        out
    }

    /// Appends rows.
    pub fn append<R: IntoIterator<Item = WeightEntry>>(
        &mut self,
        rows: impl IntoIterator<Item = R>,
    ) {
        for row in rows {
            self.entries.extend(row);
            self.starts.push(self.entries.len() as u32);
        }
    }

    /// Returns the number of rows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    /// Returns `true` if the number of rows is zero.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns row `i`.
    #[must_use]
    pub fn row(&self, i: usize) -> &[WeightEntry] {
        &self.entries[self.starts[i] as usize..self.starts[i + 1] as usize]
    }
}
