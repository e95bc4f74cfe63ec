//! Dynamic materials: surfaces of the senders for the current factors of their materials (design
//! D1: reflectance and emission are not part of a link).
//!
//! This is not a kernel. It runs in frames in which a factor changed, over a few thousand senders,
//! and the result is uploaded.

use super::light::MAX_INTENSITY;
use super::occlude::occlude_sky;
use crate::asset::{DynamicMaterials, PointSurface, SceneData};
use crate::scene::{MaterialFactors, SkyRadiance};
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::PI;

/// Largest albedo of a material that changed, except for baked values. The bounce series must
/// converge for any input, and the bake's own limit (design D12) covers the baked colors only.
pub const MAX_ALBEDO: f32 = 0.99;

/// Clamps `factors` to physical values: base color to [0, 1], emission to [0, a quarter of the
/// largest intensity of a light], NaN to 0. The result has one entry per material of `dynamic`.
/// Missing entries keep the baked value.
#[must_use]
pub fn sanitize_factors(
    dynamic: &DynamicMaterials,
    factors: &[MaterialFactors],
) -> Vec<MaterialFactors> {
    let within = |v: [f32; 3], max: f32| {
        v.map(|c| match c.is_nan() {
            true => 0.0,
            false => c.clamp(0.0, max),
        })
    };
    (dynamic.factors.iter().enumerate())
        .map(|(m, baked)| {
            factors.get(m).map_or(*baked, |f| MaterialFactors {
                base_color: within(f.base_color, 1.0),
                emissive: within(f.emissive, MAX_INTENSITY / 4.0),
            })
        })
        .collect()
}

/// Returns the current surface of sender `j`. `baked` is its baked surface, `factors` the output of
/// [`sanitize_factors`].
#[must_use]
pub fn dynamic_surface(
    dynamic: &DynamicMaterials,
    factors: &[MaterialFactors],
    baked: &PointSurface,
    j: usize,
) -> PointSurface {
    let row = dynamic.row(j);
    if row.is_empty() {
        return *baked;
    }
    let (mut albedo, mut emission) = (Vec3::ZERO, Vec3::ZERO);
    for share in row {
        let f = &factors[share.material as usize];
        albedo += Vec3::from_array(share.albedo) * Vec3::from_array(f.base_color);
        emission += Vec3::from_array(share.emission) * Vec3::from_array(f.emissive);
    }
    let max = Vec3::from_array(baked.albedo).max(Vec3::splat(MAX_ALBEDO));
    PointSurface {
        albedo: albedo.min(max).to_array(),
        emission: (PI * emission).to_array(),
        ..*baked
    }
}

/// Returns the surfaces of all senders of `scene` for these factors, one per material. Returns
/// `None` if the bake has no dynamic materials.
#[must_use]
pub fn dynamic_surfaces(
    scene: &SceneData,
    factors: &[MaterialFactors],
) -> Option<Vec<PointSurface>> {
    let dynamic = scene.materials.as_ref()?;
    let factors = sanitize_factors(dynamic, factors);
    let senders = &scene.surfaces[..scene.senders()];
    let all = senders.par_iter().enumerate();
    Some(
        all.map(|(j, baked)| dynamic_surface(dynamic, &factors, baked, j))
            .collect(),
    )
}

/// Returns the current surfaces of the senders and their visibility of the sky's terms, for these
/// material factors and transmittances of occluder sets. Empty inputs mean the baked values. The
/// visibility is empty if the bake supports a uniform sky only.
#[must_use]
pub fn current_surfaces(
    scene: &SceneData,
    factors: &[MaterialFactors],
    transmittances: &[f32],
) -> (Vec<PointSurface>, Vec<[f32; SkyRadiance::TERMS]>) {
    let dynamic = match factors.is_empty() {
        true => None,
        false => dynamic_surfaces(scene, factors),
    };
    let mut surfaces = dynamic.unwrap_or_else(|| scene.surfaces[..scene.senders()].to_vec());
    let mut sky_visibility = scene.sky.as_ref().map_or(Vec::new(), |s| s.senders.clone());
    if !transmittances.is_empty() {
        occlude_sky(scene, transmittances, &mut surfaces, &mut sky_visibility);
    }
    (surfaces, sky_visibility)
}
