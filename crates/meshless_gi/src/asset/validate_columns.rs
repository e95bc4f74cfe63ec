//! Validation of an operator of components: its columns, and rows in its basis. Part of
//! [`validate`](super::validate) (design D10).

use super::scene_data::SceneData;
use super::validate::{MAX_ROW_SUM, TOLERANCE};
use super::violation::Check;
use crate::transport::pca::Compression;
use crate::transport::{Link, SenderForm};

impl SceneData {
    /// Checks that columns and their values are contiguous, so that no value is read twice. Columns
    /// of a cluster share its senders. No sender is in two clusters, and the last column is the sky
    /// alone.
    pub(super) fn check_compression(&self, check: &mut Check) {
        let senders = self.senders();
        let form = self.operator.form;
        let Some(c) = &self.operator.compression else {
            check.section(form != SenderForm::Components, "columns", || {
                "are missing".into()
            });
            return;
        };
        check.section(form == SenderForm::Components, "columns", || {
            format!("are present, but the operator has the form {form:?}")
        });
        let coefficients = c.components();
        check.section(coefficients <= Link::MAX_SENDERS, "columns", || {
            format!("{coefficients}, at most {}", Link::MAX_SENDERS)
        });
        let (mut member, mut value) = ([0u64; 2], 0u64);
        for (i, column) in c.columns.iter().enumerate() {
            let count = u64::from(column.count);
            let (first, end) = (u64::from(column.member), u64::from(column.member) + count);
            let last = i + 1 == c.columns.len();
            let same = !last && [first, end] == member && i > 0;
            check.item(same || first == member[1], "columns", i, || {
                format!("senders {first}..{end} after {member:?}")
            });
            check.item(count > 0 && (!last || count == 1), "columns", i, || {
                format!("has {count} senders")
            });
            check.item(u64::from(column.value) == value, "columns", i, || {
                format!("values start at {} instead of {value}", column.value)
            });
            check.item(
                (0.0..=1.0 + TOLERANCE).contains(&column.scale),
                "columns",
                i,
                || format!("scale {}", column.scale),
            );
            member = [first, end];
            value += count.div_ceil(2);
            if check.is_full() {
                return;
            }
        }
        check.section(!c.columns.is_empty(), "columns", || {
            "the column of the sky is missing".into()
        });
        check.section(
            member[1] == c.members.len() as u64,
            "column senders",
            || format!("{} instead of {}", c.members.len(), member[1]),
        );
        check.section(value == c.values.len() as u64, "column values", || {
            format!("{} words instead of {value}", c.values.len())
        });
        let mut used = vec![false; senders];
        for (k, &j) in c.members.iter().enumerate() {
            let sky = k + 1 == c.members.len();
            let sound = match used.get_mut(j as usize) {
                Some(used) => !std::mem::replace(used, true) && !sky,
                None => sky && j as usize == senders,
            };
            check.item(sound, "column senders", k, || {
                format!("sender {j} of {senders}, out of order or listed twice")
            });
        }
        for (k, word) in c.values.iter().enumerate() {
            let sound = |half: u32| half::f16::from_bits(half as u16).to_f32().abs() <= 1.0;
            check.item(
                sound(*word) && sound(word >> 16),
                "column values",
                k,
                || "is not within −1 to 1".into(),
            );
            if check.is_full() {
                return;
            }
        }
    }

    /// Checks that the vectors of a basis have length one, and that uniform light is not amplified.
    /// Rows in the basis must not be longer than the rows that they were made from.
    pub(super) fn check_components(&self, check: &mut Check, compression: &Compression) {
        for c in 0..compression.columns.len() {
            let square: f32 = compression.column(c).map(|(_, v)| v * v).sum();
            check.item(
                (square - 1.0).abs() <= 4.0 * TOLERANCE,
                "columns",
                c,
                || format!("vector length {} is not 1", square.sqrt()),
            );
        }
        let ones = compression.of_ones();
        let all = self.operator.rows.iter().zip(&self.points).enumerate();
        for (i, (row, point)) in all {
            let links = &self.operator.links[row.start as usize..][..row.count as usize];
            let (mut square, mut even) = (0.0, 0.0);
            for link in links {
                let f = row.scale * link.vector().dot(point.n());
                square += f * f;
                even += f64::from(f) * ones[link.sender() as usize];
            }
            check.item(
                square <= MAX_ROW_SUM && even.abs() <= f64::from(MAX_ROW_SUM),
                "rows",
                i,
                || format!("row sum {even}, squared norm {square}: at most {MAX_ROW_SUM} each"),
            );
        }
    }
}
