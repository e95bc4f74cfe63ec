//! Sky model of a recipe, and the links of a sky that is not uniform.

use super::BakeSettings;
use crate::asset::SkyVisibility;
use crate::basis::Hierarchy;
use crate::scene::{Geometry, SkyRadiance, Surface};
use crate::transport::{LinkTerm, RawRow, ReceiverRays, gather_sky_harmonics, merge_parts};
#[cfg(feature = "bevy_reflect")]
use bevy_reflect::std_traits::ReflectDefault;
use glam::Vec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Model of the sky that lights a baked scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(
    feature = "bevy_reflect",
    derive(bevy_reflect::Reflect),
    reflect(Default, Clone, Debug, PartialEq, Hash)
)]
#[non_exhaustive]
pub enum SkyModel {
    /// Sky with the same radiance from all directions. One link per row.
    #[default]
    Uniform,
    /// Spherical harmonics up to degree 2 ([`SkyRadiance`]). Eight more links per row and twice the
    /// rays.
    Harmonics,
}

impl SkyModel {
    /// Returns `true` for the default, which settings leave out.
    pub(super) fn is_uniform(&self) -> bool {
        *self == Self::Uniform
    }
}

/// Computes the sky terms of each point with a row, zero for the others. Also returns the number of
/// rays cast. Uses the directions of the row's gather. Empty for a uniform sky.
pub(super) fn terms(
    geometry: &dyn Geometry,
    hierarchy: &Hierarchy,
    rows: &mut [RawRow],
    senders: usize,
    settings: &BakeSettings,
) -> (Vec<[Vec3; SkyRadiance::TERMS]>, u64) {
    if settings.sky == SkyModel::Uniform {
        return (Vec::new(), 0);
    }
    let rays_of = |i: usize| {
        let level = hierarchy.level_starts.partition_point(|&s| s as usize <= i);
        settings.rays_of_level(level.saturating_sub(1))
    };
    let found = (rows.par_iter_mut().enumerate())
        .map(|(i, row)| {
            if !row.active {
                return Default::default();
            }
            let parts = &mut row.parts;
            let rays = ReceiverRays::over_cell(geometry, hierarchy, i, rays_of(i), settings.seed);
            gather_sky_harmonics(geometry, &rays, |crossed, values| {
                let terms = (senders as u32 + 1..).zip(values);
                parts.extend(terms.map(|(sender, &value)| LinkTerm {
                    sender,
                    crossed,
                    value: value.into(),
                }));
            })
        })
        .collect();
    for row in rows.iter_mut() {
        merge_parts(&mut row.parts);
    }
    let active = (0..rows.len()).filter(|&i| rows[i].active);
    (found, active.map(|i| u64::from(rays_of(i))).sum())
}

/// Returns the visibility of the sky's `terms` at the senders.
pub(super) fn visibility(
    terms: &[[Vec3; SkyRadiance::TERMS]],
    surfaces: &[Surface],
) -> SkyVisibility {
    let senders = terms.iter().zip(surfaces);
    SkyVisibility {
        senders: senders
            .map(|(terms, s)| terms.map(|t| t.dot(s.normal)))
            .collect(),
    }
}
