//! Kernel `occlude`: links that cross occluders, for the occluders' current transmittances: F_ij(g)
//! = Σ_m F_ij^m Π_{k ∈ m} g_k. It runs in frames in which a transmittance changed, and only for
//! bakes with occluders. The links stay valid for later frames. The shader has one thread per term.
//! The thread of the first term of a link sums all of them.
//!
//! Sky irradiance is updated on the CPU, over a few thousand senders: direct sky irradiance of a
//! sender is the sum of its own links to the sky.

use crate::asset::{Occluders, PointSurface, SceneData};
use crate::scene::SkyRadiance;
use crate::transport::{Link, Operator, PackedLinkTerm, link_of_parts};
use glam::Vec3;

/// Clamps `transmittances` to [0, 1], NaN to 0. The result has one entry per occluder.
/// Missing entries are open (1).
#[must_use]
pub fn sanitize_transmittances(occluders: &Occluders, transmittances: &[f32]) -> Vec<f32> {
    let count = occluders.names.len();
    let sound = |g: f32| if g.is_nan() { 0.0 } else { g.clamp(0.0, 1.0) };
    (0..count)
        .map(|k| transmittances.get(k).map_or(1.0, |&g| sound(g)))
        .collect()
}

/// Returns the transmittance of each set of occluders: the product of the occluders'
/// transmittances. `transmittances` is the output of [`sanitize_transmittances`].
#[must_use]
pub fn occluder_set_transmittances(occluders: &Occluders, transmittances: &[f32]) -> Vec<f32> {
    let product = |set: &u64| {
        let own = transmittances
            .iter()
            .enumerate()
            .filter(|(k, _)| set >> k & 1 == 1);
        own.fold(1.0, |product, (_, t)| product * t)
    };
    occluders.sets.iter().map(product).collect()
}

/// Returns the link with the terms `parts` for the transmittance `transmittances` of each set.
#[must_use]
#[inline]
pub fn combine_link_terms(parts: &[PackedLinkTerm], transmittances: &[f32], link: Link) -> Link {
    let transmitted = |p: &PackedLinkTerm| transmittances[p.set() as usize] * p.vector();
    link_of_parts(parts.iter().map(transmitted), link.sender())
}

/// Rewrites the links that have terms.
pub fn occlude(terms: &[PackedLinkTerm], transmittances: &[f32], links: &mut [Link]) {
    for parts in terms.chunk_by(|a, b| a.link == b.link) {
        let link = &mut links[parts[0].link as usize];
        *link = combine_link_terms(parts, transmittances, *link);
    }
}

/// Updates the direct sky irradiance of the senders for the transmittance of each set. Changes
/// `surfaces`, one per sender and as baked. Changes `seen`, the visibility of the sky's further
/// terms, if the bake has them.
pub fn occlude_sky(
    scene: &SceneData,
    transmittances: &[f32],
    surfaces: &mut [PointSurface],
    seen: &mut [[f32; SkyRadiance::TERMS]],
) {
    let Some(occluders) = &scene.occluders else {
        return;
    };
    let Operator { rows, links, .. } = &scene.operator;
    let sky = scene.senders();
    for (j, surface) in surfaces.iter_mut().enumerate() {
        let row = &rows[j];
        let range = row.start as usize..(row.start + row.count) as usize;
        // The links to the sky and to its terms are the last ones of a row.
        for at in range.rev() {
            let link = links[at];
            let Some(term) = (link.sender() as usize).checked_sub(sky) else {
                break;
            };
            let first = occluders.links.partition_point(|p| (p.link as usize) < at);
            let parts = &occluders.links[first..];
            let parts = &parts[..parts.partition_point(|p| p.link as usize == at)];
            if parts.is_empty() {
                continue;
            }
            let now = combine_link_terms(parts, transmittances, link).vector();
            let lost = row.scale * (link.vector() - now);
            match term.checked_sub(1) {
                None => surface.sky = (Vec3::from(surface.sky) - lost).to_array(),
                Some(k) => {
                    if let Some(terms) = seen.get_mut(j) {
                        terms[k] -= lost.dot(scene.points[j].n());
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn occluders() -> Occluders {
        Occluders {
            names: vec!["door".into(), "lift".into()],
            sets: vec![0, 1, 3],
            ..Occluders::default()
        }
    }

    fn term(link: u32, set: u32, z: f32) -> PackedLinkTerm {
        let packed = Link::pack(Vec3::Z * z, 1.0, set as u16);
        PackedLinkTerm {
            link,
            xy: packed.xy,
            z_set: packed.z_sender,
        }
    }

    #[test]
    fn transmittances_are_clamped_to_unit_interval() {
        let known = occluders();
        assert_eq!(
            sanitize_transmittances(&known, &[2.0, -1.0, 0.5]),
            [1.0, 0.0]
        );
        assert_eq!(sanitize_transmittances(&known, &[f32::NAN]), [0.0, 1.0]);
        assert_eq!(
            occluder_set_transmittances(&known, &[0.5, 0.25]),
            [1.0, 0.5, 0.125]
        );
    }

    #[test]
    fn occluded_link_is_sum_of_transmitted_terms() {
        let link = |z: f32, sender| Link::pack(Vec3::Z * z, 1.0, sender);
        let open = [link(0.5, 3), link(1.0, 7), link(0.75, 9)];
        let terms = [
            term(1, 0, 0.25),
            term(1, 1, 0.5),
            term(1, 2, 0.25),
            term(2, 2, 0.75),
        ];
        let known = occluders();
        for (transmittances, right) in [
            ([1.0, 1.0], [0.5, 1.0, 0.75]),
            ([0.5, 1.0], [0.5, 0.625, 0.375]),
            ([0.5, 0.0], [0.5, 0.5, 0.0]),
            ([0.0, 1.0], [0.5, 0.25, 0.0]),
        ] {
            let mut links = open;
            occlude(
                &terms,
                &occluder_set_transmittances(&known, &transmittances),
                &mut links,
            );
            assert_eq!(links.map(|l| l.vector().z), right, "{transmittances:?}");
            assert_eq!(links.map(Link::sender), [3, 7, 9]);
        }
    }
}
