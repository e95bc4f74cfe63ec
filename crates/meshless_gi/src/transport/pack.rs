//! Packing of rows into eight bytes per link, and the resulting error.

use super::occluded_links::{LinkTerm, UnindexedLinkTerm, link_of_parts, pack_parts};
use super::refine::RawRow;
use super::{Link, Operator, Row, SenderForm, row_order};
use crate::scene::SkyRadiance;
use glam::{Vec3, Vec3A};

/// Packed operator.
pub struct Packed {
    /// Operator.
    pub operator: Operator,
    /// Terms of its links that cross occluders, in ascending order of links.
    pub link_terms: Vec<UnindexedLinkTerm>,
    /// Largest error of a link relative to the largest link of its row.
    pub error: f32,
}

/// Packs the rows in the order of tiers. `tiers` has the first tier that uses each active row
/// ([`assign_tiers`](super::assign_tiers)). `sky` becomes a link of each active row to the sender
/// `senders` (see [`Operator::links`]). `terms` follow it. In the form of components, `senders` is
/// the number of columns.
#[must_use]
pub fn pack(
    rows: &[RawRow],
    tiers: &[u32],
    sky: &[Vec3],
    terms: &[[Vec3; SkyRadiance::TERMS]],
    senders: usize,
    form: SenderForm,
) -> Packed {
    debug_assert!(senders + terms.first().map_or(0, |t| t.len()) <= Link::MAX_SENDERS);
    let mut operator = Operator {
        form,
        rows: (rows.iter().zip(tiers))
            .map(|(row, &tier)| Row {
                tier: if row.active { tier } else { 0 },
                ..Row::default()
            })
            .collect(),
        links: Vec::new(),
        compression: None,
    };
    let mut error = 0.0f32;
    let mut link_terms = Vec::new();
    for i in row_order(&operator.rows) {
        let i = i as usize;
        let sky = (form.has_independent_rows() && sky[i] != Vec3::ZERO)
            .then(|| (senders as u32, Vec3A::from(sky[i])));
        let terms = terms.get(i).into_iter().flatten();
        let terms = (senders as u32 + 1..).zip(terms.map(|&t| Vec3A::from(t)));
        let all = || {
            (rows[i].links.iter().copied())
                .chain(sky)
                .chain(terms.clone())
        };
        let parts = &rows[i].parts;
        // The remainder of a link beyond its terms can exceed the link, since terms of probes can
        // be negative.
        let rests =
            all().map(|(j, v)| v - parts_of(parts, j).iter().map(|p| p.value).sum::<Vec3A>());
        let sizes = all().map(|l| l.1).chain(parts.iter().map(|p| p.value));
        let scale = sizes
            .chain(rests)
            .fold(0.0f32, |a, v| a.max(v.abs().max_element()));
        let start = operator.links.len() as u32;
        if scale > 0.0 {
            for (j, v) in all() {
                let mut link = Link::pack(v.into(), scale, j as u16);
                let own = parts_of(parts, j);
                let mut split = Vec::new();
                if !own.is_empty() {
                    split = pack_parts(operator.links.len() as u32, v.into(), own, scale);
                    // With all occluders open a link equals the sum of its terms exactly.
                    link = link_of_parts(split.iter().map(|p| p.packed.vector()), j);
                }
                error = error.max((link.vector() - Vec3::from(v) / scale).abs().max_element());
                // Links that round to zero are dropped.
                if link.vector() != Vec3::ZERO || !split.is_empty() {
                    operator.links.push(link);
                    link_terms.append(&mut split);
                }
            }
        }
        let row = &mut operator.rows[i];
        row.start = start;
        row.count = operator.links.len() as u32 - start;
        row.scale = scale;
    }
    Packed {
        operator,
        link_terms,
        error,
    }
}

/// Returns the terms of the link to `sender` in a row.
fn parts_of(parts: &[LinkTerm], sender: u32) -> &[LinkTerm] {
    let first = parts.partition_point(|p| p.sender < sender);
    let own = &parts[first..];
    &own[..own.partition_point(|p| p.sender == sender)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packed_row_keeps_vectors_and_senders() {
        let rows = vec![
            RawRow {
                links: vec![
                    (0, Vec3A::new(1e-7, -3e-7, 2e-8)),
                    (7, Vec3A::new(5e-7, 0.0, 1e-9)),
                ],
                active: true,
                ..RawRow::default()
            },
            RawRow::default(),
        ];
        let packed = pack(
            &rows,
            &[1, 1],
            &[Vec3::new(0.0, 1e-7, 0.0), Vec3::Y],
            &[],
            8,
            SenderForm::Averages,
        );
        let links = &packed.operator.links;
        assert_eq!(
            links.iter().map(|l| l.sender()).collect::<Vec<_>>(),
            [0, 7, 8]
        );
        assert!(
            packed.error > 0.0 && packed.error < 5e-4,
            "{}",
            packed.error
        );
        for (link, &(_, v)) in links.iter().zip(&rows[0].links) {
            let back = link.vector() * packed.operator.rows[0].scale;
            assert!((back - Vec3::from(v)).abs().max_element() < 5e-4 * 5e-7);
        }
        assert_eq!(packed.operator.rows[1], Row::default());
    }

    #[test]
    fn packed_row_scale_follows_largest_term() {
        let part = LinkTerm {
            sender: 3,
            crossed: 1,
            value: Vec3A::new(-0.6, 0.2, 0.0),
        };
        let row = RawRow {
            links: vec![(3, Vec3A::new(0.5, 0.1, 0.0))],
            parts: vec![part],
            active: true,
        };
        let packed = pack(&[row], &[1], &[Vec3::ZERO], &[], 8, SenderForm::Averages);
        assert_eq!(packed.link_terms.len(), 2);
        let largest = |p: &UnindexedLinkTerm| p.packed.vector().abs().max_element();
        let largest = packed.link_terms.iter().map(largest).fold(0.0, f32::max);
        assert!((largest - 1.0).abs() < 1e-3, "{largest}");
    }

    #[test]
    fn packed_links_are_ordered_by_tier() {
        let row = |j: u32| RawRow {
            links: vec![(j, Vec3A::X), (j + 1, Vec3A::Y)],
            active: true,
            ..RawRow::default()
        };
        let rows = [row(0), row(1), RawRow::default(), row(2), row(3)];
        let tiers = [1, 3, 1, 2, 1];
        let mut packed = pack(
            &rows,
            &tiers,
            &[Vec3::ZERO; 5],
            &[],
            8,
            SenderForm::Averages,
        )
        .operator;
        let senders: Vec<u32> = packed.links.iter().map(|l| l.sender()).collect();
        assert_eq!(senders, [0, 1, 3, 4, 2, 3, 1, 2]);
        assert_eq!(packed.tier_sizes(), [(2, 4), (3, 6), (4, 8)]);
        assert_eq!(packed.rows[2], Row::default());
        // The starts of rows follow from tiers and counts.
        let rows = packed.rows.clone();
        packed.rows.iter_mut().for_each(|row| row.start = 99);
        assert_eq!(crate::transport::place_links(&mut packed.rows), Some(8));
        assert_eq!(packed.rows, rows);
    }
}
