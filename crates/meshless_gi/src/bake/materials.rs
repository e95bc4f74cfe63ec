//! Bake of dynamic materials: the material coverage of each sender.

use crate::asset::{DynamicMaterials, LightSamples, MaterialCoverage};
use crate::basis::{Hierarchy, Weights};
use crate::scene::{Geometry, MaterialTerms, Ray};
use glam::Vec3;
use rayon::prelude::*;

/// Computes the materials of `geometry`, the coverage of each sender, and the number of rays cast.
/// Returns `None` if the geometry has no materials. Finest senders use their light samples. Coarser
/// senders that `pull` fills have no coverage.
pub(super) fn cover(
    geometry: &dyn Geometry,
    hierarchy: &Hierarchy,
    samples: &LightSamples,
    pull: &Weights,
) -> (Option<DynamicMaterials>, u64) {
    let (names, factors): (Vec<_>, Vec<_>) = geometry.materials().into_iter().unzip();
    if factors.is_empty() {
        return (None, 0);
    }
    let finest = hierarchy.level(hierarchy.senders.len() - 1);
    let count = samples.per_sender as usize;
    let rows: Vec<(Vec<MaterialCoverage>, u64)> = (0..finest.end)
        .into_par_iter()
        .map(|j| {
            let s = &hierarchy.surfaces[j];
            let own = (s.position, s.normal);
            let spread = count > 0 && finest.contains(&j);
            let at: Vec<(Vec3, Vec3)> = if spread {
                let first = (j - finest.start) * count;
                let list = &samples.list[first..first + count];
                list.iter().map(|p| (p.x(), p.n())).collect()
            } else if j < finest.start && !pull.row(j).is_empty() {
                Vec::new()
            } else {
                vec![own]
            };
            let mut shares: Vec<MaterialCoverage> = Vec::new();
            let part = 1.0 / at.len().max(1) as f32;
            for &(x, n) in &at {
                let Some(coating) = material_below(geometry, x, n) else {
                    continue;
                };
                let known = shares.iter().position(|s| s.material == coating.material);
                let k = known.unwrap_or_else(|| {
                    shares.push(MaterialCoverage {
                        material: coating.material,
                        ..MaterialCoverage::default()
                    });
                    shares.len() - 1
                });
                let share = &mut shares[k];
                share.albedo = (Vec3::from_array(share.albedo) + part * coating.albedo).to_array();
                let emission = Vec3::from_array(share.emission) + part * coating.emission;
                share.emission = emission.to_array();
            }
            shares.sort_unstable_by_key(|s| s.material);
            (shares, at.len() as u64)
        })
        .collect();
    let rays = rows.iter().map(|r| r.1).sum();
    let mut dynamic = DynamicMaterials {
        names,
        factors,
        starts: vec![0],
        shares: Vec::new(),
    };
    for (shares, _) in rows {
        dynamic.shares.extend(shares);
        dynamic.starts.push(dynamic.shares.len() as u32);
    }
    (Some(dynamic), rays)
}

/// Returns the material at a surface point, on its front side.
fn material_below(geometry: &dyn Geometry, x: Vec3, n: Vec3) -> Option<MaterialTerms> {
    let up = 2.0 * geometry.ray_offset(x);
    let ray = Ray::segment(x + n * up, -n, 2.0 * up);
    let hit = geometry.cast(&ray)?;
    geometry.material_terms(&ray, &hit)
}
