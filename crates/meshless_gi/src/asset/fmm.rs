//! Octree of method `fmm` of a baked scene: sections of the file, and validation. The five sections
//! are present together or not at all. The sky visibility of the octree's points is stored with
//! their surfaces, and not twice.

use super::codec::{Field, Layout, words};
use super::container::{Container, Section, SectionKind};
use super::error::AssetError;
use super::layouts::COUNT;
use super::scene_data::{PointSurface, SceneData};
use super::section_io::{items, section, section_error};
use super::sections::kind;
use super::violation::Check;
use crate::transport::fmm::lists::ListEntry;
use crate::transport::fmm::terms::MAX_ORDER;
use crate::transport::fmm::{FmmNode, FmmOperator, FmmOperatorPoint};
use glam::Vec3;

/// Largest number of levels: three divisions by direction, and in space one per bit of a cell.
const MAX_LEVELS: usize = 64;
/// Largest surface area of a point over π, in units of the scene's side squared. It corresponds to
/// a single point for a scene with walls that fold a thousand times.
const MAX_SHARE: f32 = 1e3;

/// Largest factor of a point's light.
const MAX_FACTOR: f32 = 16.0;

const NODE: Layout = Layout::columns(&[
    Field::word(0),
    Field::word(1),
    Field::word(2),
    Field::word(3),
    Field::word(4).delta(),
    Field::word(5).delta(),
    Field::word(6).delta(),
    Field::word(7),
    Field::word(8).delta(),
    Field::word(14).delta(),
    Field::word(15).delta(),
]);
/// Lengths of a node's four lists.
const LENGTHS: Layout = Layout::columns(&words([0, 1, 2, 3]));
const ENTRY: Layout = Layout::columns(&[Field::word(0).delta(), Field::word(1)]);
const OCTREE_POINT: Layout = Layout::rows(&[
    Field::word(0),
    Field::word(1),
    Field::word(2),
    Field::word(3),
    Field::word(4),
    Field::word(5),
    Field::word(6),
    Field::word(7).delta(),
    Field::word(11),
]);

/// Kinds of sections, ascending.
pub(super) const KINDS: [SectionKind; 5] = [
    SectionKind {
        // Order, disks, and the starts of the levels.
        max: 3 + MAX_LEVELS as u64,
        // Twice in memory while they are split.
        memory: 8,
        ..kind::<u32>(29, "octree", COUNT)
    },
    kind::<FmmNode>(30, "octree nodes", NODE),
    kind::<[u32; 4]>(31, "octree lists", LENGTHS),
    kind::<ListEntry>(32, "octree entries", ENTRY),
    SectionKind {
        // Validation marks the points that have a value.
        memory: size_of::<FmmOperatorPoint>() as u64 + 1,
        ..kind::<FmmOperatorPoint>(33, "octree points", OCTREE_POINT)
    },
];

/// Returns the sections of an octree. `kinds` are the entries of [`KINDS`] in the table.
pub(super) fn sections(octree: &FmmOperator, kinds: &'static [SectionKind]) -> Vec<Section> {
    let mut shape = vec![octree.order, u32::from(octree.disks)];
    shape.extend(&octree.level_starts);
    let lengths: Vec<[u32; 4]> = (octree.nodes.iter())
        .map(|n| n.lists().map(|list| list.len() as u32))
        .collect();
    vec![
        section(&kinds[0], COUNT, &shape),
        section(&kinds[1], NODE, &octree.nodes),
        section(&kinds[2], LENGTHS, &lengths),
        section(&kinds[3], ENTRY, &octree.entries),
        section(&kinds[4], OCTREE_POINT, &octree.points),
    ]
}

/// Reads the octree of a file. `surfaces` are those of the baked points. Returns `None` if it has
/// none.
pub(super) fn read(
    file: &Container<'_>,
    kinds: &'static [SectionKind],
    surfaces: &[PointSurface],
) -> Result<Option<FmmOperator>, AssetError> {
    if !file.has(&kinds[0]) {
        return match kinds.iter().find(|k| file.has(k)) {
            Some(kind) => Err(section_error(
                kind,
                "is present, but the section `octree` is missing",
            )),
            None => Ok(None),
        };
    }
    let shape: Vec<u32> = items(file, &kinds[0], COUNT)?;
    let [order, disks, level_starts @ ..] = shape.as_slice() else {
        return Err(section_error(
            &kinds[0],
            format!("{} words, at least 3", shape.len()),
        ));
    };
    let disks = match disks {
        0 => false,
        1 => true,
        other => {
            return Err(section_error(
                &kinds[0],
                format!("`disks` is {other}, but must be 0 or 1"),
            ));
        }
    };
    let mut nodes: Vec<FmmNode> = items(file, &kinds[1], NODE)?;
    let lengths: Vec<[u32; 4]> = items(file, &kinds[2], LENGTHS)?;
    if nodes.len() != lengths.len() {
        return Err(section_error(
            &kinds[2],
            format!("{} instead of {}", lengths.len(), nodes.len()),
        ));
    }
    let mut at = 0u32;
    for (node, length) in nodes.iter_mut().zip(&lengths) {
        node.far = at;
        let mut ends = [0; 4];
        for (end, length) in ends.iter_mut().zip(length) {
            at = (at.checked_add(*length))
                .ok_or_else(|| section_error(&kinds[2], "the counts overflow"))?;
            *end = at;
        }
        [node.local, node.multipole, node.near, node.finish] = ends;
    }
    let mut points: Vec<FmmOperatorPoint> = items(file, &kinds[4], OCTREE_POINT)?;
    let receive = nodes.iter().filter(|n| n.is_leaf());
    for range in receive.map(|n| n.receivers..n.end) {
        // Validation reports ranges beyond the points.
        for point in points
            .get_mut(range.start as usize..range.end as usize)
            .into_iter()
            .flatten()
        {
            point.sky = surfaces
                .get(point.point as usize)
                .map_or([0.0; 3], |s| s.sky);
        }
    }
    Ok(Some(FmmOperator {
        order: *order,
        disks,
        level_starts: level_starts.to_vec(),
        nodes,
        entries: items(file, &kinds[3], ENTRY)?,
        points,
    }))
}

impl SceneData {
    /// Checks that the passes stay within the arrays, no divisor is zero, and every point gets a
    /// value. The nodes must form a tree without shared points between leaves. Lists must be
    /// contiguous. Their nodes must be as far away as the expansions require, and leaves if the
    /// list uses points.
    pub(super) fn check_fmm(&self, check: &mut Check) {
        let Some(octree) = &self.fmm else { return };
        check.section(octree.order as usize <= MAX_ORDER, "octree", || {
            format!("order {}, at most {MAX_ORDER}", octree.order)
        });
        check.section(octree.disks, "octree", || {
            "`disks` must be true: sources without an area amplify light".into()
        });
        let starts = &octree.level_starts;
        let nodes = octree.nodes.len();
        let sound = (1..=MAX_LEVELS + 1).contains(&starts.len())
            && starts.first() == Some(&0)
            && starts.last() == Some(&(nodes as u32))
            && starts.is_sorted()
            && (nodes == 0 || starts.get(1) == Some(&1));
        check.section(sound, "octree", || {
            format!("the levels do not cover the {nodes} nodes from one root")
        });
        if sound {
            self.check_nodes(octree, check);
        }
        if check.0.is_empty() {
            self.check_octree_points(octree, check);
        }
        if check.0.is_empty() {
            check_lists(octree, check);
        }
    }

    /// Checks that every node except the root is the child of one node of the level above. Its
    /// points must be points of the parent.
    fn check_nodes(&self, octree: &FmmOperator, check: &mut Check) {
        let nodes = &octree.nodes;
        let mut at = 0u32;
        for l in 0..octree.levels() {
            // Children are in the order of their parents.
            let mut next = octree.level_starts[l + 1];
            for i in octree.level(l) {
                let node = &nodes[i];
                let (center, size) = (Vec3::from_array(node.center), node.size);
                let wide = center.abs().max_element() <= 4.0 && size > 1e-9 && size <= 4.0;
                check.item(wide, "octree nodes", i, || {
                    format!("center {center}, size {size}")
                });
                let inside = node.start <= node.end && node.end as usize <= octree.points.len();
                check.item(inside, "octree nodes", i, || {
                    format!(
                        "points {}..{} of {}",
                        node.start,
                        node.end,
                        octree.points.len()
                    )
                });
                if i == 0 {
                    let whole = node.start == 0 && node.end as usize == octree.points.len();
                    check.item(whole && node.parent == 0, "octree nodes", i, || {
                        "the root does not contain all points".into()
                    });
                }
                if node.is_leaf() {
                    let range = node.start..=node.end;
                    let sound = range.contains(&node.sources) && range.contains(&node.receivers);
                    check.item(sound, "octree nodes", i, || {
                        format!(
                            "sources end at point {}, receivers start at point {}",
                            node.sources, node.receivers
                        )
                    });
                } else {
                    let last = u64::from(next) + u64::from(node.children);
                    let end = octree.level_starts.get(l + 2).map_or(0, |&e| u64::from(e));
                    let behind = node.first_child == next && last <= end;
                    check.item(behind, "octree nodes", i, || {
                        format!("children at {}, not at {next}", node.first_child)
                    });
                    if !behind {
                        return;
                    }
                    next = last as u32;
                    let mut point = node.start;
                    for c in node.child_range() {
                        let child = &nodes[c];
                        let own = child.parent as usize == i && child.start == point;
                        check.item(own, "octree nodes", c, || {
                            format!("parent {} instead of {i}, or wrong points", child.parent)
                        });
                        // Translations have lengths near one, so that none of their powers
                        // overflows.
                        let apart = Vec3::from_array(child.center).distance(center);
                        let near = apart <= 2.0 * size && child.size <= 2.0 * size;
                        check.item(near, "octree nodes", c, || {
                            format!("is {apart} away from its parent of size {size}")
                        });
                        point = child.end;
                    }
                    check.item(point == node.end, "octree nodes", i, || {
                        "the children do not contain all points".into()
                    });
                }
                for list in node.lists() {
                    let sound = list.start == at as usize && list.start <= list.end;
                    check.item(sound, "octree lists", i, || {
                        format!("{list:?} does not start at {at}")
                    });
                    at = list.end as u32;
                }
                if check.is_full() {
                    return;
                }
            }
            let end = octree.level_starts.get(l + 2);
            check.section(end.is_none_or(|&e| e == next), "octree", || {
                format!("level {} has nodes without a parent", l + 1)
            });
        }
        check.section(
            at as usize == octree.entries.len(),
            "octree entries",
            || format!("{} instead of {at}", octree.entries.len()),
        );
    }

    /// Checks that every sender receives at one position, and that only senders emit.
    fn check_octree_points(&self, octree: &FmmOperator, check: &mut Check) {
        let senders = self.senders();
        let mut receiving = vec![false; senders];
        for node in octree.nodes.iter().filter(|n| n.is_leaf()) {
            for i in node.points() {
                let p = &octree.points[i];
                let (x, n) = (Vec3::from_array(p.position), Vec3::from_array(p.normal));
                let apart = x.distance(Vec3::from_array(node.center));
                check.item(apart <= 2.0 * node.size, "octree points", i, || {
                    format!("is {apart} from the center of a leaf of size {}", node.size)
                });
                let sound = (n.length_squared() - 1.0).abs() <= 1e-3;
                check.item(sound, "octree points", i, || {
                    format!("normal {n} is not of unit length")
                });
                let source = node.source_range().contains(&i);
                let fits = match source {
                    true => (p.point as usize) < senders && (0.0..=MAX_SHARE).contains(&p.share),
                    false => p.share == 0.0,
                };
                check.item(fits, "octree points", i, || {
                    format!("point {} of {senders} senders, share {}", p.point, p.share)
                });
                let sound = (0.0..=MAX_FACTOR).contains(&p.factor);
                check.item(sound, "octree points", i, || format!("factor {}", p.factor));
                if node.receiver_range().contains(&i) {
                    let fresh = receiving.get_mut(p.point as usize);
                    let fresh = fresh.is_some_and(|receiving| !std::mem::replace(receiving, true));
                    check.item(fresh, "octree points", i, || {
                        format!(
                            "point {} of {senders} senders is out of range or receives twice",
                            p.point
                        )
                    });
                } else {
                    check.item(source, "octree points", i, || {
                        "is neither a source nor a receiver".into()
                    });
                }
                if check.is_full() {
                    return;
                }
            }
        }
        let dark = receiving.iter().position(|receiving| !receiving);
        check.section(dark.is_none(), "octree points", || {
            format!("sender {} is not a receiver of any leaf", dark.unwrap_or(0))
        });
    }
}

/// Largest number of positions in the lists between a leaf and a node, summed over all entries. The
/// leaves of a bake are small.
const MAX_NAMED: u64 = 1 << 31;

/// Checks that entries refer to nodes that fit their list, at distances at which the expansions
/// converge.
fn check_lists(octree: &FmmOperator, check: &mut Check) {
    let nodes = &octree.nodes;
    let center = |n: &FmmNode| Vec3::from_array(n.center);
    let at = |i: usize| Vec3::from_array(octree.points[i].position);
    let mut listed = 0u64;
    for (t, node) in nodes.iter().enumerate() {
        for (which, list) in node.lists().into_iter().enumerate() {
            for e in list {
                let entry = &octree.entries[e];
                let Some(source) = nodes.get(entry.source as usize) else {
                    check.item(false, "octree entries", e, || {
                        format!("node {} of {}", entry.source, nodes.len())
                    });
                    continue;
                };
                check.item(
                    (0.0..=1.0).contains(&entry.weight),
                    "octree entries",
                    e,
                    || format!("weight {} is not within 0 to 1", entry.weight),
                );
                // Sides that the list splits into points: 1 the source, 2 the receiver, 3 both.
                let leaves =
                    (which & 1 == 0 || source.is_leaf()) && (which & 2 == 0 || node.is_leaf());
                check.item(leaves, "octree entries", e, || {
                    format!("node {t} or {} must be a leaf in this list", entry.source)
                });
                listed += match which {
                    1 => source.source_range().len() as u64,
                    2 => node.receiver_range().len() as u64,
                    _ => 0,
                };
                if listed > MAX_NAMED {
                    check.item(false, "octree entries", e, || {
                        format!("more than {MAX_NAMED} points in lists of leaves")
                    });
                    return;
                }
                let (size, nearest) = match which {
                    0 => (
                        node.size + source.size,
                        center(node).distance(center(source)),
                    ),
                    1 => (
                        node.size,
                        nearest(center(node), source.source_range().map(at)),
                    ),
                    2 => (
                        source.size,
                        nearest(center(source), node.receiver_range().map(at)),
                    ),
                    _ => (0.0, f32::INFINITY),
                };
                // Below one due to the bake's separation. Rounding errors are smaller than the
                // margin.
                check.item(
                    leaves && size <= 1.001 * nearest,
                    "octree entries",
                    e,
                    || format!("size {size} exceeds the distance {nearest}"),
                );
                if check.is_full() {
                    return;
                }
            }
        }
    }
}

/// Returns the smallest distance of `to` from any position. Infinite without positions.
fn nearest(to: Vec3, points: impl Iterator<Item = Vec3>) -> f32 {
    points.fold(f32::INFINITY, |min, x| min.min(x.distance(to)))
}
