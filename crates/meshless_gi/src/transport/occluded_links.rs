//! Terms of links by the occluders that they cross: while gathering, in a row, and packed in twelve
//! bytes per term.
//!
//! A link is the sum of its terms, one for each set of occluders that rays crossed together: F_ij =
//! Σ_m F_ij^m, the first through none. With the transmittances g_k in [0, 1] of a frame it is
//! F_ij(g) = Σ_m F_ij^m Π_{k ∈ m} g_k. This is exact for any transmittances and any number of
//! occluders in a row. Links without occluders have no terms and no cost.

use super::{Link, SenderTree};
use bytemuck::{Pod, Zeroable};
use glam::{Vec3, Vec3A};
use std::collections::BTreeSet;

/// Term of a row's link before packing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkTerm {
    /// Sender of the link. The number of senders is the sky, larger numbers are the sky's terms.
    pub sender: u32,
    /// Occluders on the way, bit k for number k.
    pub crossed: u64,
    /// Part of F_ij.
    pub value: Vec3A,
}

/// Sums the terms of the same link through the same occluders, in their order. The result is in
/// ascending order of links, then of occluders.
pub fn merge_parts(parts: &mut Vec<LinkTerm>) {
    parts.sort_by_key(|p| (p.sender, p.crossed));
    parts.dedup_by(|next, first| {
        let same = (next.sender, next.crossed) == (first.sender, first.crossed);
        if same {
            first.value += next.value;
        }
        same
    });
}

/// Terms of a row after truncation, which moved each sender's mass to the nearest of itself and its
/// ancestors that is `kept`. Mass without such an ancestor has rounded to zero. Numbers behind the
/// senders are the sky's.
pub(super) fn cut_parts(
    tree: &SenderTree,
    parts: &[LinkTerm],
    kept: impl Fn(u32) -> bool,
) -> Vec<LinkTerm> {
    let senders = tree.parent.len() as u32;
    let mut out: Vec<LinkTerm> = (parts.iter())
        .filter_map(|part| {
            let mut k = part.sender;
            while k < senders && !kept(k) {
                let parent = tree.parent[k as usize];
                if parent == k {
                    return None;
                }
                k = parent;
            }
            Some(LinkTerm { sender: k, ..*part })
        })
        .collect();
    merge_parts(&mut out);
    out
}

/// Part of an operator's link that crosses one set of occluders. 12 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct PackedLinkTerm {
    /// Index of the link.
    pub link: u32,
    /// x in the lower half, y in the upper half, both f16, relative to the row's scale as in a
    /// [`Link`].
    pub xy: u32,
    /// z as f16 in the lower half, the index of the set in the upper half.
    pub z_set: u32,
}

impl PackedLinkTerm {
    /// Largest number of sets, since the index has 16 bits.
    pub const MAX_SETS: usize = 1 << 16;

    /// Vector relative to the row's scale.
    #[must_use]
    #[inline]
    pub fn vector(self) -> Vec3 {
        Link {
            xy: self.xy,
            z_sender: self.z_set,
        }
        .vector()
    }

    /// Index of the set.
    #[must_use]
    #[inline]
    pub fn set(self) -> u32 {
        self.z_set >> 16
    }
}

/// Packed term whose set has no index yet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UnindexedLinkTerm {
    /// [`PackedLinkTerm::link`], [`PackedLinkTerm::xy`] and the lower half of
    /// [`PackedLinkTerm::z_set`].
    pub packed: PackedLinkTerm,
    /// Occluders on the way.
    pub crossed: u64,
}

/// Packs the terms of a link relative to its row's `scale`, the term without occluders first.
/// `parts` are those of the link, ascending. The link is their sum and the remainder of `whole`.
pub(super) fn pack_parts(
    link: u32,
    whole: Vec3,
    parts: &[LinkTerm],
    scale: f32,
) -> Vec<UnindexedLinkTerm> {
    let free = whole - parts.iter().map(|p| Vec3::from(p.value)).sum::<Vec3>();
    let all = std::iter::once((0, free)).chain(parts.iter().map(|p| (p.crossed, p.value.into())));
    all.filter_map(|(crossed, value)| {
        let Link { xy, z_sender } = Link::pack(value, scale, 0);
        let packed = PackedLinkTerm {
            link,
            xy,
            z_set: z_sender,
        };
        // Terms that round to zero are dropped.
        (packed.vector() != Vec3::ZERO).then_some(UnindexedLinkTerm { packed, crossed })
    })
    .collect()
}

/// Link to `sender` as the sum of its terms.
#[must_use]
#[inline]
pub fn link_of_parts(parts: impl Iterator<Item = Vec3>, sender: u32) -> Link {
    Link::pack(parts.sum(), 1.0, sender as u16)
}

/// Sets of occluders that occur, ascending, the empty one first, and the terms of several operators
/// with their indices. `None` if there are more sets than an index can represent.
#[must_use]
pub fn number_sets<const N: usize>(
    parts: [&[UnindexedLinkTerm]; N],
) -> Option<(Vec<u64>, [Vec<PackedLinkTerm>; N])> {
    let all = parts.iter().flat_map(|own| own.iter().map(|p| p.crossed));
    let sets: BTreeSet<u64> = all.chain([0]).collect();
    let sets: Vec<u64> = sets.into_iter().collect();
    if sets.len() > PackedLinkTerm::MAX_SETS {
        return None;
    }
    let numbered = parts.map(|own| {
        let passages = own.iter().map(|p| {
            let set = sets.partition_point(|&s| s < p.crossed) as u32;
            PackedLinkTerm {
                z_set: p.packed.z_set & 0xffff | set << 16,
                ..p.packed
            }
        });
        passages.collect()
    });
    Some((sets, numbered))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn part(sender: u32, crossed: u64, value: f32) -> LinkTerm {
        LinkTerm {
            sender,
            crossed,
            value: Vec3A::new(value, 0.0, 2.0 * value),
        }
    }

    #[test]
    fn link_terms_are_proportional_to_sender_mass() {
        // Two roots, two children each.
        let tree = SenderTree::new(&[0, 1, 0, 0, 1, 1], &[0, 2, 6]);
        let found = [
            part(3, 1, 0.25),
            part(6, 2, 1.0),
            part(2, 1, 0.5),
            part(4, 1, 0.125),
            part(3, 3, 0.5),
            part(2, 1, 1.0),
        ];
        let cut = cut_parts(&tree, &found, |k| k == 0 || k == 3);
        let right = [
            part(0, 1, 1.5),
            part(3, 1, 0.25),
            part(3, 3, 0.5),
            part(6, 2, 1.0),
        ];
        assert_eq!(cut, right);
    }

    #[test]
    fn packed_link_is_sum_of_terms() {
        let parts = [part(3, 1, 0.25), part(3, 5, 0.125)];
        let whole = Vec3::new(0.5, 0.0, 1.0);
        let packed = pack_parts(7, whole, &parts, 1.0);
        assert_eq!(
            packed.iter().map(|p| p.crossed).collect::<Vec<_>>(),
            [0, 1, 5]
        );
        let sum: Vec3 = packed.iter().map(|p| p.packed.vector()).sum();
        assert_eq!(sum, whole);
        // A link of which all passes has no part that passes nothing.
        let all = pack_parts(7, Vec3::new(0.375, 0.0, 0.75), &parts, 1.0);
        assert_eq!(all.iter().map(|p| p.crossed).collect::<Vec<_>>(), [1, 5]);
        let (sets, [first, second]) = number_sets([&packed, &all]).unwrap();
        assert_eq!(sets, [0, 1, 5]);
        let indices = |own: &[PackedLinkTerm]| own.iter().map(|p| p.set()).collect::<Vec<_>>();
        assert_eq!(
            (indices(&first), indices(&second)),
            (vec![0, 1, 2], vec![1, 2])
        );
        assert!(first.iter().all(|p| p.link == 7));
        assert_eq!(number_sets([&[]]), Some((vec![0], [Vec::new()])));
    }
}
