//! Dynamic materials: surfaces of the senders for the current factors of their materials (design
//! D1: reflectance and emission are no part of a link).
//!
//! This is not a kernel. It runs in frames in which a factor changed, over a few thousand senders,
//! and the result is uploaded.

use super::light::BRIGHTEST;
use super::occlude::occlude_sky;
use crate::asset::{BakedScene, DynamicMaterials, PointSurface};
use crate::scene::{MaterialFactors, SkyRadiance};
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::PI;

/// No material that changes reflects more, but what was baked so: light must die away whatever the
/// game says, and the bake's own guard (design D12) has seen the baked colors only.
pub const MAX_ALBEDO: f32 = 0.99;

/// `factors` as light can have them: base colors in [0, 1], emission from 0 to a quarter of what a
/// light may have at most, zero for what is no number; one a material of `live`, those that are
/// missing as they were baked.
#[must_use]
pub fn sanitize_factors(
    live: &DynamicMaterials,
    factors: &[MaterialFactors],
) -> Vec<MaterialFactors> {
    let within = |v: [f32; 3], most: f32| {
        v.map(|c| match c.is_nan() {
            true => 0.0,
            false => c.clamp(0.0, most),
        })
    };
    (live.factors.iter().enumerate())
        .map(|(m, baked)| {
            factors.get(m).map_or(*baked, |f| MaterialFactors {
                base_color: within(f.base_color, 1.0),
                emissive: within(f.emissive, BRIGHTEST / 4.0),
            })
        })
        .collect()
}

/// The surface of sender `j`, baked as `baked`. `factors` are [`sanitize_factors`].
#[must_use]
pub fn live_surface(
    live: &DynamicMaterials,
    factors: &[MaterialFactors],
    baked: &PointSurface,
    j: usize,
) -> PointSurface {
    let row = live.row(j);
    if row.is_empty() {
        return *baked;
    }
    let (mut albedo, mut emission) = (Vec3::ZERO, Vec3::ZERO);
    for share in row {
        let f = &factors[share.material as usize];
        albedo += Vec3::from_array(share.albedo) * Vec3::from_array(f.base_color);
        emission += Vec3::from_array(share.emission) * Vec3::from_array(f.emissive);
    }
    let most = Vec3::from_array(baked.albedo).max(Vec3::splat(MAX_ALBEDO));
    PointSurface {
        albedo: albedo.min(most).to_array(),
        emission: (PI * emission).to_array(),
        ..*baked
    }
}

/// The surfaces of all senders of `scene` for these factors, one a material; nothing where the bake
/// knows no materials.
#[must_use]
pub fn live_surfaces(scene: &BakedScene, factors: &[MaterialFactors]) -> Option<Vec<PointSurface>> {
    let live = scene.materials.as_ref()?;
    let factors = sanitize_factors(live, factors);
    let senders = &scene.surfaces[..scene.senders()];
    let all = senders.par_iter().enumerate();
    Some(
        all.map(|(j, baked)| live_surface(live, &factors, baked, j))
            .collect(),
    )
}

/// The senders' surfaces as they are now, and what they see of the sky's terms: for these factors
/// of the materials, and where so much passes each set of occluders. What is left empty is as
/// baked. What the senders see is empty where the bake knows a uniform sky only.
#[must_use]
pub fn current_surfaces(
    scene: &BakedScene,
    factors: &[MaterialFactors],
    passing: &[f32],
) -> (Vec<PointSurface>, Vec<[f32; SkyRadiance::TERMS]>) {
    let live = match factors.is_empty() {
        true => None,
        false => live_surfaces(scene, factors),
    };
    let mut surfaces = live.unwrap_or_else(|| scene.surfaces[..scene.senders()].to_vec());
    let mut seen = scene.sky.as_ref().map_or(Vec::new(), |s| s.senders.clone());
    if !passing.is_empty() {
        occlude_sky(scene, passing, &mut surfaces, &mut seen);
    }
    (surfaces, seen)
}
