//! From rows in full precision to the operator's eight bytes a link, with the error that it costs.

use super::refine::RawRow;
use super::{Link, Operator, Row, SenderForm};
use glam::{Vec3, Vec3A};

/// An operator and the largest error that packing put on any link, relative to the largest link of its row.
pub struct Packed {
    /// The operator.
    pub operator: Operator,
    /// See above, dimensionless.
    pub error: f32,
}

/// Packs the rows. `sky`, where given, becomes each active row's last link, to the sender `senders` (see [`Operator::links`]).
#[must_use]
pub fn pack(rows: &[RawRow], sky: &[Vec3], senders: usize, form: SenderForm) -> Packed {
    debug_assert!(senders <= Link::MAX_SENDERS);
    let mut operator = Operator {
        form,
        rows: Vec::with_capacity(rows.len()),
        links: Vec::new(),
    };
    let mut error = 0.0f32;
    for (row, &sky) in rows.iter().zip(sky) {
        let sky = (row.active && form == SenderForm::Averages && sky != Vec3::ZERO)
            .then(|| (senders as u32, Vec3A::from(sky)));
        let all = || row.links.iter().copied().chain(sky);
        let scale = all().fold(0.0f32, |a, (_, v)| a.max(v.abs().max_element()));
        let start = operator.links.len() as u32;
        if scale > 0.0 {
            for (j, v) in all() {
                let link = Link::pack(v.into(), scale, j as u16);
                error = error.max((link.vector() - Vec3::from(v) / scale).abs().max_element());
                // What rounds to nothing carries nothing.
                if link.vector() != Vec3::ZERO {
                    operator.links.push(link);
                }
            }
        }
        operator.rows.push(Row {
            start,
            count: operator.links.len() as u32 - start,
            scale,
            active: u32::from(row.active),
        });
    }
    Packed { operator, error }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packing_keeps_vectors_and_senders() {
        let rows = vec![
            RawRow {
                links: vec![
                    (0, Vec3A::new(1e-7, -3e-7, 2e-8)),
                    (7, Vec3A::new(5e-7, 0.0, 1e-9)),
                ],
                active: true,
            },
            RawRow::default(),
        ];
        let packed = pack(
            &rows,
            &[Vec3::new(0.0, 1e-7, 0.0), Vec3::Y],
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
        assert_eq!(
            packed.operator.rows[1],
            Row {
                start: 3,
                ..Row::default()
            }
        );
    }
}
