//! Terms of links per set of crossed occluders: during the gather, in a row, and packed in twelve
//! bytes per term.
//!
//! A link is the sum of its terms, one for each set of occluders that rays cross:
//! F_ij = Σ_m F_ij^m. The first term crosses no occluders. With the transmittances g_k in [0, 1] of
//! a frame, the link is F_ij(g) = Σ_m F_ij^m Π_{k ∈ m} g_k. This is exact for any transmittances
//! and any number of occluders along a ray. Links without occluders have no terms and no cost.

use super::{Link, SenderTree};
use bytemuck::{Pod, Zeroable};
use glam::{Vec3, Vec3A};
use std::collections::BTreeSet;

/// Term of a row's link before packing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkTerm {
    /// Sender of the link. The sky has the index "number of senders", and its terms follow.
    pub sender: u32,
    /// Crossed occluders, bit k for occluder k.
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

/// Returns the terms of a row after truncation. Truncation moved each sender's mass to the nearest
/// `kept` sender among itself and its ancestors. Mass without such a sender has rounded to zero and
/// is dropped. Indices behind the senders belong to the sky.
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

    /// Returns the vector relative to the row's scale.
    #[must_use]
    #[inline]
    pub fn vector(self) -> Vec3 {
        Link {
            xy: self.xy,
            z_sender: self.z_set,
        }
        .vector()
    }

    /// Returns the index of the set.
    #[must_use]
    #[inline]
    pub fn set(self) -> u32 {
        self.z_set >> 16
    }
}

/// Packed term without the index of its set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UnindexedLinkTerm {
    /// [`PackedLinkTerm::link`], [`PackedLinkTerm::xy`] and the lower half of
    /// [`PackedLinkTerm::z_set`].
    pub packed: PackedLinkTerm,
    /// Crossed occluders, bit k for occluder k.
    pub crossed: u64,
}

/// Packs the terms of a link relative to its row's `scale`, the term without occluders first.
/// `parts` are the terms of the link with occluders, in ascending order. The term without occluders
/// is `whole` minus their sum.
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

/// Returns the link to `sender` as the sum of its terms.
#[must_use]
#[inline]
pub fn link_of_parts(parts: impl Iterator<Item = Vec3>, sender: u32) -> Link {
    Link::pack(parts.sum(), 1.0, sender as u16)
}

/// Numbers the sets of occluders of several operators. Returns all sets in ascending order, the
/// empty set first, and the terms with the indices of their sets. Returns `None` if there are more
/// sets than an index can represent.
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
        let terms = own.iter().map(|p| {
            let set = sets.partition_point(|&s| s < p.crossed) as u32;
            PackedLinkTerm {
                z_set: p.packed.z_set & 0xffff | set << 16,
                ..p.packed
            }
        });
        terms.collect()
    });
    Some((sets, numbered))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn term(sender: u32, crossed: u64, value: f32) -> LinkTerm {
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
            term(3, 1, 0.25),
            term(6, 2, 1.0),
            term(2, 1, 0.5),
            term(4, 1, 0.125),
            term(3, 3, 0.5),
            term(2, 1, 1.0),
        ];
        let cut = cut_parts(&tree, &found, |k| k == 0 || k == 3);
        let right = [
            term(0, 1, 1.5),
            term(3, 1, 0.25),
            term(3, 3, 0.5),
            term(6, 2, 1.0),
        ];
        assert_eq!(cut, right);
    }

    #[test]
    fn packed_link_is_sum_of_terms() {
        let parts = [term(3, 1, 0.25), term(3, 5, 0.125)];
        let whole = Vec3::new(0.5, 0.0, 1.0);
        let packed = pack_parts(7, whole, &parts, 1.0);
        assert_eq!(
            packed.iter().map(|p| p.crossed).collect::<Vec<_>>(),
            [0, 1, 5]
        );
        let sum: Vec3 = packed.iter().map(|p| p.packed.vector()).sum();
        assert_eq!(sum, whole);
        // The rays of this link all cross occluders, so it has no term without occluders.
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
