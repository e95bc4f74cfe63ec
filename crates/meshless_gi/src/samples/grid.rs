//! Flat hashed grid: finds the functions that cover a position. One lookup is one hash and one
//! contiguous list. The arrays have the GPU layout, so that a kernel and its CPU twin read the same
//! bytes (design: no R-tree, [L08] §2.1 "Efficient Reconstruction" replaced).
//!
//! The grid is built from boxes. Each box is entered in every cell that it touches. An entry list
//! starts with its length.

use crate::scene::Bounds;
use bytemuck::{Pod, Zeroable};
use glam::{IVec3, Vec3};
use rayon::prelude::*;
use std::ops::Range;

/// Slot of the hash table: a cell and the start of its list. 16 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct GridSlot {
    /// Integer coordinates of the cell.
    pub cell: [i32; 3],
    /// Index into `entries` of the list's length, followed by the list. [`GridSlot::EMPTY`] for a
    /// free slot.
    pub start: u32,
}

impl GridSlot {
    /// `start` of an empty slot.
    pub const EMPTY: u32 = u32::MAX;
}

/// Hashed grid over boxes. Cells are cubes of `cell_size` meters, with cell = floor(p / cell_size).
#[derive(Clone, Debug, PartialEq)]
pub struct HashedGrid {
    /// Edge of a cell, meters.
    pub cell_size: f32,
    /// Hash table with linear probing. Its length is a power of two, and at most half of it is in
    /// use.
    pub slots: Vec<GridSlot>,
    /// Lists: length, then indices in ascending order.
    pub entries: Vec<u32>,
}

impl HashedGrid {
    /// Largest absolute cell coordinate along each axis.
    pub const CELL_LIMIT: f32 = 1_073_741_824.0;

    /// Computes the hash of a cell. The shader has the same function.
    #[must_use]
    pub fn hash(cell: IVec3) -> u32 {
        let mut h = (cell.x as u32)
            .wrapping_mul(0x8da6_b343)
            .wrapping_add((cell.y as u32).wrapping_mul(0xd816_3841))
            .wrapping_add((cell.z as u32).wrapping_mul(0xcb1a_b31f));
        h ^= h >> 16;
        h = h.wrapping_mul(0x7feb_352d);
        h ^= h >> 15;
        h
    }

    /// Returns the cell that contains `p`, with cells of `cell_size` meters. Coordinates beyond 2³⁰
    /// cells saturate.
    #[must_use]
    pub fn cell(p: Vec3, cell_size: f32) -> IVec3 {
        let scaled = (p / cell_size).clamp(
            Vec3::splat(-Self::CELL_LIMIT),
            Vec3::splat(Self::CELL_LIMIT),
        );
        // Floor without a function call: truncate, and subtract one if that rounded up.
        let cell = scaled.as_ivec3();
        let above = |k: usize| i32::from(cell[k] as f32 > scaled[k]);
        cell - IVec3::new(above(0), above(1), above(2))
    }

    /// Builds a grid from the boxes `bounds(i)` of the indices `0..count`. Each box is entered in
    /// every cell that it touches. Empty or non-finite boxes are left out. `cell_size` should be
    /// about the size of a box. A grid that would have more than 2³¹ entries stays empty.
    #[must_use]
    pub fn build(count: usize, cell_size: f32, bounds: impl Fn(usize) -> Bounds) -> Self {
        Self::build_within(count, cell_size, bounds, u64::MAX).unwrap_or(Self {
            cell_size,
            slots: vec![
                GridSlot {
                    cell: [0; 3],
                    start: GridSlot::EMPTY
                };
                2
            ],
            entries: Vec::new(),
        })
    }

    /// Builds a grid as [`build`](Self::build) does, within a memory limit. Returns `None`, without
    /// allocation of the grid, if it would take more than `max_bytes` bytes.
    #[must_use]
    pub fn build_within(
        count: usize,
        cell_size: f32,
        bounds: impl Fn(usize) -> Bounds,
        max_bytes: u64,
    ) -> Option<Self> {
        let range_of = |i: usize| {
            let b = bounds(i);
            let ok = b.min.is_finite() && b.max.is_finite() && b.min.cmple(b.max).all();
            if ok {
                (Self::cell(b.min, cell_size), Self::cell(b.max, cell_size))
            } else {
                (IVec3::ONE, IVec3::ZERO)
            }
        };
        let cells_of = |i: usize| {
            let (lo, hi) = range_of(i);
            (lo.z..=hi.z).flat_map(move |z| {
                (lo.y..=hi.y).flat_map(move |y| (lo.x..=hi.x).map(move |x| IVec3::new(x, y, z)))
            })
        };
        let total = (0..count).fold(0u64, |sum, i| {
            let (lo, hi) = range_of(i);
            let edge = |k: usize| (i64::from(hi[k]) - i64::from(lo[k]) + 1).max(0) as u64;
            let cells = edge(0).saturating_mul(edge(1)).saturating_mul(edge(2));
            sum.saturating_add(cells)
        });
        const PAIR: u64 = size_of::<([i32; 3], u32)>() as u64;
        if total > u64::from(u32::MAX) / 2 || total * PAIR > max_bytes {
            return None;
        }
        let mut pairs: Vec<([i32; 3], u32)> = Vec::with_capacity(total as usize);
        for i in 0..count {
            pairs.extend(cells_of(i).map(|c| (c.to_array(), i as u32)));
        }
        pairs.par_sort_unstable();
        let cells = pairs.chunk_by(|a, b| a.0 == b.0).count();
        let table = (2 * cells).next_power_of_two().max(2);
        let needed = (pairs.len() as u64) * (PAIR + 4)
            + cells as u64 * 8
            + (table * size_of::<GridSlot>()) as u64;
        if needed > max_bytes {
            return None;
        }
        let mut slots = vec![
            GridSlot {
                cell: [0; 3],
                start: GridSlot::EMPTY
            };
            table
        ];
        let mut entries = Vec::with_capacity(pairs.len() + cells);
        for list in pairs.chunk_by(|a, b| a.0 == b.0) {
            let mut at = Self::hash(list[0].0.into()) as usize & (table - 1);
            while slots[at].start != GridSlot::EMPTY {
                at = (at + 1) & (table - 1);
            }
            slots[at] = GridSlot {
                cell: list[0].0,
                start: entries.len() as u32,
            };
            entries.push(list.len() as u32);
            entries.extend(list.iter().map(|&(_, i)| i));
        }
        Some(Self {
            cell_size,
            slots,
            entries,
        })
    }

    /// Calls `each` with the indices entered in any cell that `bounds` touches, cell after cell. An
    /// index whose box spans several cells occurs several times.
    pub fn for_each_in(&self, bounds: Bounds, mut each: impl FnMut(u32)) {
        let (lo, hi) = (
            Self::cell(bounds.min, self.cell_size),
            Self::cell(bounds.max, self.cell_size),
        );
        for z in lo.z..=hi.z {
            for y in lo.y..=hi.y {
                for x in lo.x..=hi.x {
                    for &i in self.list(IVec3::new(x, y, z)) {
                        each(i);
                    }
                }
            }
        }
    }

    /// Returns the indices whose boxes touch the cell of `p`, ascending.
    #[must_use]
    pub fn indices_near(&self, p: Vec3) -> &[u32] {
        self.list(Self::cell(p, self.cell_size))
    }

    /// Returns the range in `entries` of the indices whose boxes touch the cell of `p`.
    #[must_use]
    pub(crate) fn range_near(&self, p: Vec3) -> Range<u32> {
        let list = self.list_range(Self::cell(p, self.cell_size));
        list.start as u32..list.end as u32
    }

    fn list(&self, cell: IVec3) -> &[u32] {
        &self.entries[self.list_range(cell)]
    }

    fn list_range(&self, cell: IVec3) -> Range<usize> {
        let mask = self.slots.len() - 1;
        let mut at = Self::hash(cell) as usize & mask;
        loop {
            let slot = &self.slots[at];
            if slot.start == GridSlot::EMPTY {
                return 0..0;
            }
            if slot.cell == cell.to_array() {
                let start = slot.start as usize;
                let len = self.entries[start] as usize;
                return start + 1..start + 1 + len;
            }
            at = (at + 1) & mask;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Small deterministic point cloud. The oracle below is the O(n²) search.
    fn cloud(n: u32) -> Vec<Vec3> {
        let unit =
            |h: u32| (HashedGrid::hash(IVec3::splat(h as i32)) >> 8) as f32 / (1 << 24) as f32;
        (0..n)
            .map(|i| Vec3::new(unit(3 * i), unit(3 * i + 1), unit(3 * i + 2)) * 10.0 - 5.0)
            .collect()
    }

    #[test]
    fn grid_query_returns_every_covering_box() {
        for (n, r, cell) in [
            (0, 0.5, 0.5),
            (1, 0.3, 1.0),
            (300, 0.7, 0.5),
            (300, 0.2, 1.0),
        ] {
            let points = cloud(n);
            let grid = HashedGrid::build(points.len(), cell, |i| Bounds {
                min: points[i] - r,
                max: points[i] + r,
            });
            for q in cloud(997) {
                let found = grid.indices_near(q);
                for (i, p) in points.iter().enumerate() {
                    let covers = (q - *p).abs().max_element() <= r;
                    assert!(
                        !covers || found.contains(&(i as u32)),
                        "{i} covers {q} but was not found"
                    );
                }
                assert!(found.is_sorted());
            }
        }
    }

    #[test]
    fn grid_invalid_boxes_are_skipped() {
        let grid = HashedGrid::build(3, 1.0, |i| match i {
            0 => Bounds::EMPTY,
            1 => Bounds {
                min: Vec3::NAN,
                max: Vec3::ONE,
            },
            _ => Bounds {
                min: Vec3::ZERO,
                max: Vec3::splat(0.5),
            },
        });
        assert_eq!(grid.indices_near(Vec3::splat(0.25)), &[2]);
        assert_eq!(grid.indices_near(Vec3::splat(-7.0)), &[] as &[u32]);
    }
}
