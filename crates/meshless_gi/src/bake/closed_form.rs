//! Closed form of the rows: (1/π) ∫ n·ω dω = 1 over the hemisphere. Σ_j F_ij·n_i, the sky's part
//! and the part without a sender sum to one. Packing to half precision adds rounding errors to the
//! sum. A room with albedo 0.99 amplifies them a hundredfold. Rows of averages are rescaled to
//! correct this.

use super::energy_components as components;
use super::packing::LinkedPoints;
use crate::asset::{PointSurface, SceneData};
use crate::frame::{CpuFrame, FrameSettings};
use crate::transport::SenderForm;
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// Largest deviation from the closed form that rounding explains. Such rows are rescaled.
const ROUNDING: f64 = 0.01;

/// Rescales rows of averages so that they sum to the gathered part. `missed` has, for each point,
/// the part of its gathered light that hit a surface without a sender.
pub(super) fn rescale_rows(linked: &mut LinkedPoints, missed: &[f32]) {
    if !linked.operator.form.has_independent_rows() {
        return;
    }
    let compression = linked.operator.compression.as_ref();
    let even = compression.map(|c| components::even_sums(linked, c));
    let max = linked.operator.coefficients(linked.senders());
    let operator = &mut linked.operator;
    let rows = operator.rows.iter_mut().zip(&linked.points).zip(missed);
    for (i, ((row, point), &missed)) in rows.enumerate() {
        let links = &operator.links[row.start as usize..][..row.count as usize];
        let n = point.n();
        // Sky terms do not contribute under a uniform sky.
        let even_links = links.iter().filter(|l| l.sender() as usize <= max);
        let sum: f64 = even_links.map(|l| f64::from(l.vector().dot(n))).sum();
        let sum = match &even {
            Some(even) => even[i],
            None => f64::from(row.scale) * sum,
        };
        let factor = (1.0 - f64::from(missed)) / sum;
        if (factor - 1.0).abs() < ROUNDING {
            row.scale = (f64::from(row.scale) * factor) as f32;
        }
    }
}

/// Computes the largest and the root-mean-square deviation from one of the rows of a white room
/// under a white sky. Returns zeros without rows.
pub(super) fn row_deviation(scene: &SceneData, missed: &[f32]) -> [f32; 2] {
    if scene.link_tiers() == 0 {
        return [0.0; 2];
    }
    let white = PointSurface {
        emission: [1.0; 3],
        ..PointSurface::default()
    };
    let mut frame = CpuFrame::with_surfaces(scene, vec![white; scene.surfaces.len()]);
    let settings = FrameSettings {
        sky: Vec3::splat(FRAC_1_PI).into(),
        baked_bounces: false,
        tier: scene.link_tiers(),
        ..FrameSettings::bounces(1)
    };
    frame.solve_data(scene, &settings);
    let (mut largest, mut squares, mut count) = (0.0f64, 0.0, 0u64);
    let rows = scene.operator.rows.iter().zip(&scene.points);
    let rows = rows
        .zip(&scene.surfaces)
        .zip(frame.vector_irradiance())
        .zip(missed);
    for ((((row, point), surface), value), &missed) in rows {
        if row.tier == 0 {
            continue;
        }
        // Rows of differences have no link to the sky.
        let sky = match scene.operator.form {
            SenderForm::Averages | SenderForm::Components => 0.0,
            SenderForm::Differences => Vec3::from_array(surface.sky).dot(point.n()),
        };
        let d = f64::from(value.dot(point.n()).x) + f64::from(sky) + f64::from(missed) - 1.0;
        largest = largest.max(d.abs());
        squares += d * d;
        count += 1;
    }
    let rms = (squares / count.max(1) as f64).sqrt();
    [largest as f32, rms as f32]
}
