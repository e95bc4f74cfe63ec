//! Compressed radiosity of senders in its stored form: c = D b, with a few rows of D per cluster of
//! senders. Links of an operator in the form of [`Components`](crate::transport::SenderForm)
//! multiply c (\[P14\] Eq. (10)).
//!
//! A column of the operator is a row of D. It has senders and a 16-bit value for each of them
//! ([P14] §4.4), relative to the column's scale. All columns of a cluster share its senders. The
//! last column is the sky alone.

use super::light_basis::LightBasis;
use bytemuck::{Pod, Zeroable};
use half::f16;

/// Column of the operator. 16 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Column {
    /// Index of its first sender in [`Compression::members`].
    pub member: u32,
    /// Number of senders.
    pub count: u32,
    /// Index of the first word of its values. A word has two f16 values, the first in the lower
    /// bits.
    pub value: u32,
    /// Factor of every value.
    pub scale: f32,
}

/// Matrix D: from the senders' radiosity to the coefficients that links multiply.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Compression {
    /// Columns of the operator, cluster after cluster. The last is the sky's.
    pub columns: Vec<Column>,
    /// Senders, cluster after cluster. The last is the sky, with the index "number of senders".
    pub members: Vec<u32>,
    /// Values, column after column. Each column starts at a word.
    pub values: Vec<u32>,
}

impl Compression {
    /// Packs bases in full precision, over `senders` senders.
    #[must_use]
    pub fn new(basis: &LightBasis, senders: usize) -> Self {
        let mut out = Self::default();
        for s in 0..basis.clusters() {
            let member = out.members.len() as u32;
            out.members.extend(basis.members_of(s));
            for vector in basis.vectors_of(s) {
                out.push(member, vector);
            }
        }
        let sky = out.members.len() as u32;
        out.members.push(senders as u32);
        out.push(sky, &[1.0]);
        out
    }

    fn push(&mut self, member: u32, vector: &[f32]) {
        let scale = vector.iter().fold(0.0f32, |max, v| max.max(v.abs()));
        let half = |v: &f32| match scale > 0.0 {
            true => u32::from(f16::from_f32(v / scale).to_bits()),
            false => 0,
        };
        self.columns.push(Column {
            member,
            count: vector.len() as u32,
            value: self.values.len() as u32,
            scale,
        });
        let words = vector.chunks(2);
        self.values
            .extend(words.map(|w| half(&w[0]) | w.get(1).map_or(0, half) << 16));
    }

    /// Returns the number of columns, without the sky.
    #[must_use]
    pub fn components(&self) -> usize {
        self.columns.len().saturating_sub(1)
    }

    /// Returns the senders of column `c` and their values.
    pub fn column(&self, c: usize) -> impl Iterator<Item = (u32, f32)> {
        let column = self.columns[c];
        let words = &self.values[column.value as usize..];
        let members = &self.members[column.member as usize..][..column.count as usize];
        members.iter().enumerate().map(move |(k, &j)| {
            let bits = words[k / 2] >> (16 * (k % 2));
            (j, column.scale * f16::from_bits(bits as u16).to_f32())
        })
    }

    /// Computes the coefficient of each column if all senders and the sky emit 1 W/m².
    #[must_use]
    pub fn of_ones(&self) -> Vec<f64> {
        (0..self.columns.len())
            .map(|c| self.column(c).map(|(_, v)| f64::from(v)).sum())
            .collect()
    }

    /// Returns the size of all arrays in bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        (16 * self.columns.len() + 4 * (self.members.len() + self.values.len())) as u64
    }
}
