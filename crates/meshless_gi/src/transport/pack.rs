//! Packing of rows into eight bytes per link, in half precision or quantized (`link_quantization`),
//! and the resulting error.

use super::occluded_links::{LinkTerm, UnindexedLinkTerm, link_of_parts, pack_parts};
use super::refine::RawRow;
use super::{Link, Operator, Row, RowQuantizer, SenderForm, row_order};
use crate::samples::Point;
use crate::scene::SkyRadiance;
use glam::{Vec3, Vec3A};

/// Largest correction of the sum of a quantized row. A row that needs more is stored in halves.
const MAX_CORRECTION: f32 = 0.02;

/// Packed operator.
pub struct Packed {
    /// Operator.
    pub operator: Operator,
    /// Terms of its links that cross occluders, in ascending order of links.
    pub link_terms: Vec<UnindexedLinkTerm>,
    /// Largest error of a link relative to the largest link of its row.
    pub error: f32,
}

/// Form and quantization of an operator.
#[derive(Clone, Copy, Debug)]
pub struct PackSettings<'a> {
    /// Coefficients that links multiply.
    pub form: SenderForm,
    /// Number of coefficients without the sky: columns in the form of components, otherwise
    /// senders. It is the index of the sky.
    pub senders: usize,
    /// Points of the operator, the senders first.
    pub points: &'a [Point],
    /// Step of links to dim senders, in the unit of F, rounded to quarters of a power of two of the
    /// row's scale. 0: links are not quantized. 0 for components, since columns have no position.
    pub link_step: f32,
    /// Precision of each sender, the sky last ([`precision_of`](super::precision_of)).
    pub precision: &'a [u8],
}

/// Packs the rows in the order of tiers. `tiers` has the first tier that uses each active row
/// ([`assign_tiers`](super::assign_tiers)). `sky` becomes a link of each active row to the sender
/// `senders` (see [`Operator::links`]). `terms` follow it.
#[must_use]
pub fn pack(
    rows: &[RawRow],
    tiers: &[u32],
    sky: &[Vec3],
    terms: &[[Vec3; SkyRadiance::TERMS]],
    settings: &PackSettings<'_>,
) -> Packed {
    let (senders, form) = (settings.senders, settings.form);
    debug_assert!(senders + terms.first().map_or(0, |t| t.len()) <= Link::MAX_SENDERS);
    let mut out = Packed {
        operator: Operator {
            form,
            rows: (rows.iter().zip(tiers))
                .map(|(row, &tier)| Row {
                    tier: if row.active { tier } else { 0 },
                    ..Row::default()
                })
                .collect(),
            links: Vec::new(),
            steps: vec![0; rows.len()],
            precision: settings.precision.to_vec(),
            compression: None,
        },
        link_terms: Vec::new(),
        error: 0.0,
    };
    let mut links = Vec::new();
    for i in row_order(&out.operator.rows) {
        let i = i as usize;
        let sky = (form.has_independent_rows() && sky[i] != Vec3::ZERO)
            .then(|| (senders as u32, Vec3A::from(sky[i])));
        let terms = terms.get(i).into_iter().flatten();
        let terms = (senders as u32 + 1..).zip(terms.map(|&t| Vec3A::from(t)));
        links.clear();
        links.extend(rows[i].links.iter().copied().chain(sky).chain(terms));
        let start = out.operator.links.len() as u32;
        let scale = match settings.link_step > 0.0 && rows[i].parts.is_empty() {
            true => out.push_quantized(i, &links, settings),
            false => out.push_row(&links, &rows[i].parts),
        };
        let row = &mut out.operator.rows[i];
        row.start = start;
        row.count = out.operator.links.len() as u32 - start;
        row.scale = scale;
    }
    if out.operator.steps.iter().all(|&code| code == 0) {
        out.operator.steps.clear();
        out.operator.precision.clear();
    }
    out
}

impl Packed {
    /// Appends the links of a row in half precision, and their terms. Returns the row's scale.
    fn push_row(&mut self, links: &[(u32, Vec3A)], parts: &[LinkTerm]) -> f32 {
        // The remainder of a link beyond its terms can exceed the link, since terms of probes can
        // be negative.
        let rests = (links.iter())
            .map(|&(j, v)| v - parts_of(parts, j).iter().map(|p| p.value).sum::<Vec3A>());
        let sizes = (links.iter().map(|l| l.1)).chain(parts.iter().map(|p| p.value));
        let scale = sizes
            .chain(rests)
            .fold(0.0f32, |a, v| a.max(v.abs().max_element()));
        if scale <= 0.0 {
            return scale;
        }
        for &(j, v) in links {
            let mut link = Link::pack(v.into(), scale, j as u16);
            let own = parts_of(parts, j);
            let mut split = Vec::new();
            if !own.is_empty() {
                split = pack_parts(self.operator.links.len() as u32, v.into(), own, scale);
                // With all occluders open a link equals the sum of its terms exactly.
                link = link_of_parts(split.iter().map(|p| p.packed.vector()), j);
            }
            let error = (link.vector() - Vec3::from(v) / scale).abs();
            self.error = self.error.max(error.max_element());
            // Links that round to zero are dropped.
            if link.vector() != Vec3::ZERO || !split.is_empty() {
                self.operator.links.push(link);
                self.link_terms.append(&mut split);
            }
        }
        scale
    }

    /// Appends the quantized links of row `i`. The rounding error of a link is added to the next
    /// one. Returns the row's scale.
    fn push_quantized(
        &mut self,
        i: usize,
        links: &[(u32, Vec3A)],
        settings: &PackSettings<'_>,
    ) -> f32 {
        let largest = links
            .iter()
            .fold(0.0f32, |a, (_, v)| a.max(v.abs().max_element()));
        if largest <= 0.0 {
            return 0.0;
        }
        let code = RowQuantizer::code_of(settings.link_step / largest);
        let senders = &settings.points[..settings.senders];
        let Some(row) = RowQuantizer::new(code, &settings.points[i], senders, settings.precision)
        else {
            return self.push_row(links, &[]);
        };
        // Rounding, with the error of the links before, adds less than four steps.
        let scale = largest * (1.0 + 4.0 * row.largest_step());
        let start = self.operator.links.len();
        let normal = settings.points[i].n();
        let mut rest = Vec3::ZERO;
        let (mut before, mut after, mut error) = (0.0, 0.0, 0.0f32);
        for &(j, v) in links {
            if j as usize >= settings.senders {
                // The sky takes no error of a sender.
                rest = Vec3::ZERO;
            }
            let v = Vec3::from(v) / scale;
            // No light arrives from below the surface. The row could otherwise exceed its sum.
            let is_below = |v: Vec3| v.dot(normal) < 0.0;
            let up = row.step(j) * normal;
            // Links with a small step take no error of the others.
            let rest_of_link = match row.is_coarse(j) {
                true => rest,
                false => Vec3::ZERO,
            };
            let link = [v + rest_of_link, v + rest_of_link + up, v, v + up]
                .into_iter()
                .map(|v| row.quantize(v, j))
                .find(|link| is_below(v) || !is_below(link.vector()))
                .unwrap_or_default();
            rest += v - link.vector();
            // Many flat links would otherwise lower it without end. The row's sum is kept below.
            rest += (-2.0 * row.largest_step() - rest.dot(normal)).max(0.0) * normal;
            if j as usize <= settings.senders {
                before += v.dot(normal);
                after += link.vector().dot(normal);
            }
            error = error.max((link.vector() - v).abs().max_element());
            if link.vector() != Vec3::ZERO {
                self.operator.links.push(link);
            }
        }
        let factor = match settings.form.has_independent_rows() {
            true => before / after,
            false => 1.0,
        };
        // Rows of flat links alone have almost no sum that could be kept.
        let is_small = (factor - 1.0).abs() <= MAX_CORRECTION;
        if !is_small {
            self.operator.links.truncate(start);
            return self.push_row(links, &[]);
        }
        self.error = self.error.max(error);
        self.operator.steps[i] = code;
        scale * factor
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
    use crate::samples::Random;

    const HALVES: PackSettings<'_> = PackSettings {
        form: SenderForm::Averages,
        senders: 8,
        points: &[],
        link_step: 0.0,
        precision: &[],
    };

    /// The sum of a quantized row differs from the row's by a few steps, however many links round
    /// to zero.
    #[test]
    fn quantized_row_keeps_its_mass() {
        const SENDERS: usize = 500;
        let mut random = Random::new(7, 7, 7);
        let mut v = || Vec3::new(random.unit(), random.unit(), random.unit()) - 0.5;
        let points: Vec<Point> = (0..=SENDERS)
            .map(|_| Point::new(9.0 * v(), v().normalize_or(Vec3::Y), 0.1))
            .collect();
        let links: Vec<(u32, Vec3A)> = (0..SENDERS as u32)
            .map(|j| {
                let toward = (points[j as usize].x() - points[SENDERS].x()).normalize();
                (
                    j,
                    Vec3A::from(1e-3 * (toward + 0.2 * v()) / (1.0 + j as f32 % 100.0)),
                )
            })
            .collect();
        let mut rows = vec![RawRow::default(); SENDERS + 1];
        rows[SENDERS] = RawRow {
            links: links.clone(),
            active: true,
            ..RawRow::default()
        };
        let sky = vec![Vec3::ZERO; SENDERS + 1];
        let tiers = vec![1; SENDERS + 1];
        let settings = PackSettings {
            senders: SENDERS,
            points: &points,
            link_step: 2e-4,
            ..HALVES
        };
        let packed = pack(&rows, &tiers, &sky, &[], &settings);
        let row = packed.operator.rows[SENDERS];
        let code = packed.operator.steps[SENDERS];
        let step = RowQuantizer::new(code, &points[SENDERS], &points, &[])
            .unwrap()
            .largest_step();
        assert!(
            packed.operator.links.len() < SENDERS * 3 / 4,
            "some round to zero"
        );
        let sum: Vec3 = packed.operator.links.iter().map(|l| l.vector()).sum();
        let right: Vec3 = links.iter().map(|l| Vec3::from(l.1)).sum::<Vec3>() / row.scale;
        assert!((sum - right).length() < 2.0 * step, "{sum} {right} {step}");
        assert!(packed.error < 4.0 * step, "{}", packed.error);
    }

    /// Links that hardly rise above the surface, with some steep ones or without. Their rounded
    /// links must rise too. No link, steep ones included, may pay for it with more than some steps.
    #[test]
    fn quantized_row_of_flat_links_keeps_its_links() {
        const SENDERS: usize = 600;
        const STEP: f32 = 5e-4;
        let mut random = Random::new(8, 8, 8);
        let mut jitter = || {
            let [x, y, z] = [(); 3].map(|()| random.unit() - 0.5);
            Vec3::new(x, y, 0.1 * z)
        };
        let mut points: Vec<Point> = (0..SENDERS)
            .map(|j| {
                let (sin, cos) = (j as f32).sin_cos();
                let height = if j % 20 == 0 { 3.0 } else { 0.001 };
                Point::new(Vec3::new(3.0 * cos, 3.0 * sin, height), Vec3::Z, 0.1)
            })
            .collect();
        points.push(Point::new(Vec3::ZERO, Vec3::Z, 0.1));
        for flat_only in [false, true] {
            let links: Vec<(u32, Vec3A)> = (0..SENDERS as u32)
                .filter(|j| !flat_only || j % 20 != 0)
                .map(|j| {
                    // Links point near their senders, and not below the surface.
                    let v = points[j as usize].x().normalize() + 0.1 * jitter();
                    (j, Vec3A::from(2e-2 * v.with_z(v.z.abs())))
                })
                .collect();
            let mut rows = vec![RawRow::default(); SENDERS + 1];
            rows[SENDERS] = RawRow {
                links: links.clone(),
                active: true,
                ..RawRow::default()
            };
            let settings = PackSettings {
                senders: SENDERS,
                points: &points,
                link_step: STEP,
                ..HALVES
            };
            let (tiers, sky) = (vec![1; SENDERS + 1], vec![Vec3::ZERO; SENDERS + 1]);
            let packed = pack(&rows, &tiers, &sky, &[], &settings);
            let scale = packed.operator.rows[SENDERS].scale;
            for (sender, right) in links {
                let own = packed.operator.links.iter().find(|l| l.sender() == sender);
                let found = own.map_or(Vec3::ZERO, |link| scale * link.vector());
                let error = (found - Vec3::from(right)).length();
                assert!(error < 4.0 * STEP, "{flat_only}, {sender}: {error}");
            }
        }
    }

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
        let sky = [Vec3::new(0.0, 1e-7, 0.0), Vec3::Y];
        let packed = pack(&rows, &[1, 1], &sky, &[], &HALVES);
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
        let packed = pack(&[row], &[1], &[Vec3::ZERO], &[], &HALVES);
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
        let mut packed = pack(&rows, &tiers, &[Vec3::ZERO; 5], &[], &HALVES).operator;
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
