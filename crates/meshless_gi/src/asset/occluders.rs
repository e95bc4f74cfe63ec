//! Occluders of a bake, which can be opened and closed at run time: data in memory, sections of the
//! file, and validation. The five sections are present together or not at all. The section of the
//! probes is empty without probes. The occluders' triangles are the last of the BVH.

use super::codec::{Field, Layout, words};
use super::container::{Container, Section, SectionKind};
use super::error::AssetError;
use super::layouts::COUNT;
use super::probes::MAX_PROBE_COEFFICIENT;
use super::scene_data::SceneData;
use super::section_io::{items, section, section_error};
use super::sections::kind;
use super::validate::{MAX_ROW_SUM, TOLERANCE};
use super::violation::Check;
use crate::scene::{Bvh, BvhTriangle};
use crate::transport::{Link, PROBE_ROWS, PackedLinkTerm, Row, SenderForm, link_of_parts};
use glam::Vec3;

/// Occluders of a baked scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Occluders {
    /// Names by index, without repetition.
    pub names: Vec<String>,
    /// Sets of occluders that light crosses one after the other, bit k for index k. Ascending, the
    /// empty set first.
    pub sets: Vec<u64>,
    /// Terms of the operator's links that occluders block. Ascending by link, then by set. With all
    /// occluders open, a link is the sum of its terms.
    pub links: Vec<PackedLinkTerm>,
    /// Terms of the probes' links, as in `links`.
    pub probes: Vec<PackedLinkTerm>,
}

impl Occluders {
    /// Returns the size in memory, bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let bytes = |length: usize, size: u64| length as u64 * size;
        let names: usize = self.names.iter().map(String::len).sum();
        bytes(names, 1)
            + bytes(self.sets.len(), 8)
            + bytes(self.links.len() + self.probes.len(), 12)
    }
}

const SET: Layout = Layout::rows(&words([0, 1]));
const LINK_TERM: Layout = Layout::columns(&[
    Field::word(0).delta(),
    Field::low(1),
    Field::high(1),
    Field::low(2),
    Field::high(2).delta(),
]);

/// Kinds of sections, ascending.
pub(super) const KINDS: [SectionKind; 5] = [
    SectionKind {
        code: 50,
        name: "occluder names",
        version: 1,
        raw: 1,
        // Memory of the text, the decoded names and the parser.
        memory: 32,
        max: 1 << 16,
    },
    kind::<u32>(51, "occluder triangles", COUNT),
    SectionKind {
        max: PackedLinkTerm::MAX_SETS as u64,
        ..kind::<u64>(52, "occluder sets", SET)
    },
    kind::<PackedLinkTerm>(53, "occluded link terms", LINK_TERM),
    kind::<PackedLinkTerm>(54, "occluded probe link terms", LINK_TERM),
];

/// Returns the sections of `occluders`. Their triangles are the last of `bvh`. `kinds` are the
/// entries of [`KINDS`] in the table.
pub(super) fn sections(
    occluders: &Occluders,
    bvh: &Bvh,
    kinds: &'static [SectionKind],
) -> Result<Vec<Section>, AssetError> {
    let names = ron::to_string(&occluders.names).map_err(|e| section_error(&kinds[0], e))?;
    if names.len() as u64 > kinds[0].max {
        let found = format!("{} bytes of text, at most {}", names.len(), kinds[0].max);
        return Err(section_error(&kinds[0], found));
    }
    let triangles = &bvh.triangles[bvh.first_occluder()..];
    let numbers: Vec<u32> = triangles.iter().map(|t| t.occluder).collect();
    Ok(vec![
        Section {
            kind: &kinds[0],
            items: names.len(),
            raw: names.into_bytes(),
        },
        section(&kinds[1], COUNT, &numbers),
        section(&kinds[2], SET, &occluders.sets),
        section(&kinds[3], LINK_TERM, &occluders.links),
        section(&kinds[4], LINK_TERM, &occluders.probes),
    ])
}

/// Reads the occluders of a file, and sets the occluder numbers of the last of `triangles`. Returns
/// `None` if it has none.
pub(super) fn read(
    file: &Container<'_>,
    triangles: &mut [BvhTriangle],
    kinds: &'static [SectionKind],
) -> Result<Option<Occluders>, AssetError> {
    let Some((_, names)) = file.section(&kinds[0])? else {
        return match kinds.iter().find(|k| file.has(k)) {
            Some(kind) => Err(section_error(
                kind,
                "is present, but the section `occluder names` is missing",
            )),
            None => Ok(None),
        };
    };
    let names = std::str::from_utf8(&names).map_err(|e| section_error(&kinds[0], e))?;
    let numbers: Vec<u32> = items(file, &kinds[1], COUNT)?;
    let count = triangles.len();
    let Some(first) = count.checked_sub(numbers.len()) else {
        let found = format!("{}, but the BVH has {count} triangles", numbers.len());
        return Err(section_error(&kinds[1], found));
    };
    for (triangle, number) in triangles[first..].iter_mut().zip(numbers) {
        (triangle.occluder, triangle.transmittance) = (number, 1.0);
    }
    Ok(Some(Occluders {
        names: ron::from_str(names).map_err(|e| section_error(&kinds[0], e))?,
        sets: items(file, &kinds[2], SET)?,
        links: items(file, &kinds[3], LINK_TERM)?,
        probes: items(file, &kinds[4], LINK_TERM)?,
    }))
}

impl SceneData {
    /// Checks that every lookup of the kernel `occlude` stays within the arrays, and that no
    /// transmittances create light.
    pub(super) fn check_occluders(&self, check: &mut Check) {
        let known = self.occluders.as_ref().map_or(0, |o| o.names.len());
        let triangles = &self.bvh.triangles;
        let first = triangles.iter().take_while(|t| t.occluder == 0).count();
        for (i, t) in triangles.iter().enumerate() {
            let sound = match i < first {
                true => t.transmittance == 0.0,
                false => (1..=known).contains(&(t.occluder as usize)) && t.transmittance == 1.0,
            };
            check.item(sound, "occluder triangles", i, || {
                format!(
                    "of occluder {} of {known}, transmittance {}",
                    t.occluder, t.transmittance
                )
            });
        }
        let Some(occluders) = &self.occluders else {
            return;
        };
        let names = &occluders.names;
        check.section(
            (1..=Bvh::MAX_OCCLUDERS).contains(&known),
            "occluder names",
            || format!("{known}, expected 1 to {}", Bvh::MAX_OCCLUDERS),
        );
        for (i, name) in names.iter().enumerate().take(Bvh::MAX_OCCLUDERS) {
            let sound = !name.is_empty() && !names[..i].contains(name);
            check.item(sound, "occluder names", i, || {
                format!("`{name}` is empty or occurs twice")
            });
        }
        let sets = &occluders.sets;
        let count = sets.len();
        let ascend = sets.first() == Some(&0) && sets.windows(2).all(|w| w[0] < w[1]);
        check.section(
            ascend && count <= PackedLinkTerm::MAX_SETS,
            "occluder sets",
            || format!("{count} sets are too many, or do not ascend from the empty set"),
        );
        let all = u64::MAX.checked_shr(64 - known.min(64) as u32).unwrap_or(0);
        for (i, set) in sets.iter().enumerate() {
            check.item(set & !all == 0, "occluder sets", i, || {
                format!("{set:#x} of {known} occluders")
            });
            if check.is_full() {
                return;
            }
        }
        let form = self.operator.form == SenderForm::Averages
            && self.bounces.is_none()
            && self.fmm.is_none();
        check.section(form, "occluded link terms", || {
            "are present, but require method `bounded` and bounce mode `runtime`".into()
        });
        check_link_terms(
            check,
            "occluded link terms",
            &occluders.links,
            &self.operator.links,
            count,
        );
        let space = self.probes.as_ref().map_or(&[][..], |p| &p.links);
        check_link_terms(
            check,
            "occluded probe link terms",
            &occluders.probes,
            space,
            count,
        );
        if !check.0.is_empty() {
            return;
        }
        let (rows, links) = (&self.operator.rows, &self.operator.links);
        for (i, (row, point)) in rows.iter().zip(&self.points).enumerate() {
            let n = point.n();
            let sum = self.max_row_sum(row, links, &occluders.links, |v| {
                Vec3::splat(v.dot(n).abs())
            });
            check.item(sum.x <= MAX_ROW_SUM, "occluded link terms", i, || {
                format!("of row {i} sum to {}, at most {MAX_ROW_SUM}", sum.x)
            });
        }
        let Some(probes) = &self.probes else { return };
        for (i, row) in probes.rows.iter().enumerate() {
            let sum = self.max_row_sum(row, &probes.links, &occluders.probes, Vec3::abs);
            let max = MAX_PROBE_COEFFICIENT + TOLERANCE;
            check.item(
                sum.max_element() <= max,
                "occluded probe link terms",
                i / PROBE_ROWS,
                || format!("sum to {sum}, at most {max}"),
            );
        }
    }

    /// Returns the largest sum of a row's links for any transmittances. `size` returns the
    /// magnitude of a link. Links with terms count by the magnitudes of their terms. The sky's
    /// terms have signs and are parts of its light, so they do not count.
    fn max_row_sum(
        &self,
        row: &Row,
        links: &[Link],
        terms: &[PackedLinkTerm],
        size: impl Fn(Vec3) -> Vec3,
    ) -> Vec3 {
        let range = row.start..row.start + row.count;
        let of_row = |p: &PackedLinkTerm| p.link < range.start;
        let mut parts = &terms[terms.partition_point(of_row)..];
        let mut sum = Vec3::ZERO;
        for at in range.clone() {
            let link = links[at as usize];
            let own = parts.partition_point(|p| p.link <= at);
            if link.sender() as usize <= self.senders() {
                sum += match own {
                    0 => size(link.vector()),
                    _ => parts[..own].iter().map(|p| size(p.vector())).sum(),
                };
            }
            parts = &parts[own..];
        }
        sum * row.scale
    }
}

/// Checks that the terms ascend, refer to a link and a set, and sum to their link.
fn check_link_terms(
    check: &mut Check,
    location: &'static str,
    terms: &[PackedLinkTerm],
    links: &[Link],
    sets: usize,
) {
    let mut before: Option<(u32, u32)> = None;
    for (i, p) in terms.iter().enumerate() {
        let now = (p.link, p.set());
        check.item(before < Some(now), location, i, || {
            format!("link {} and set {} do not ascend", p.link, p.set())
        });
        before = Some(now);
        let inside = (p.link as usize) < links.len() && (p.set() as usize) < sets;
        check.item(inside, location, i, || {
            format!(
                "link {} of {}, set {} of {sets}",
                p.link,
                links.len(),
                p.set()
            )
        });
        let v = p.vector();
        let sound = v.is_finite() && v.abs().max_element() <= 1.0 + TOLERANCE;
        check.item(sound, location, i, || format!("vector {v}"));
        if check.is_full() {
            return;
        }
    }
    if !check.0.is_empty() {
        return;
    }
    let mut at = 0;
    for own in terms.chunk_by(|a, b| a.link == b.link) {
        let link = links[own[0].link as usize];
        let sum = link_of_parts(own.iter().map(|p| p.vector()), link.sender());
        check.item(sum == link, location, at, || {
            format!(
                "sum to {}, but link {} is {}",
                sum.vector(),
                own[0].link,
                link.vector()
            )
        });
        at += own.len();
        if check.is_full() {
            return;
        }
    }
}
