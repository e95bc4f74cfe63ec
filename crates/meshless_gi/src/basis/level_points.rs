//! Points of all levels of a hierarchy: Poisson disks, and disks on emitters.

use super::HierarchySettings;
use super::emitter_points::separate_emitters;
use crate::samples::{Candidate, DiskSettings, fill_level, order};
use crate::scene::Geometry;
use glam::Vec3;

/// Points of all levels.
#[derive(Default)]
pub(super) struct LevelPoints {
    /// Points of each level, coarse first.
    pub points: Vec<Vec<Candidate>>,
    /// Levels that reached their largest number of points.
    pub truncated: Vec<usize>,
    /// Number of rays cast.
    pub rays: u64,
}

impl LevelPoints {
    /// Scatters the points of each level. The points of senders on emitters come from `on_emitter`.
    /// Returns `None` if `progress` returns `false`.
    pub fn new(
        geometry: &dyn Geometry,
        viewpoints: &[Vec3],
        settings: &HierarchySettings,
        on_emitter: &[Candidate],
        progress: &(dyn Fn(f32) -> bool + Sync),
    ) -> Option<Self> {
        let emitters = settings.emitters(geometry);
        let mut out = Self::default();
        for l in 0..settings.levels {
            let all_covering = l + 1 == settings.levels || l + 1 == settings.sender_levels;
            let radius = settings.coarse_radius / (1u32 << l) as f32;
            let max = settings.max[l];
            let disks = fill_level(
                geometry,
                viewpoints,
                &DiskSettings {
                    radius,
                    open_only: !all_covering,
                    max,
                    seed: settings.seed.wrapping_add(l as u64),
                    drop_first: settings.drop_first,
                },
            );
            out.rays += disks.rays;
            if disks.truncated {
                out.truncated.push(l);
            }
            let mut points = disks.points;
            if let Some(emitters) = emitters.filter(|_| l < settings.sender_levels) {
                out.rays +=
                    separate_emitters(geometry, emitters, on_emitter, &mut points, radius, max);
            }
            order(&mut points, &geometry.bounds());
            out.points.push(points);
            if !progress(0.7 * (l + 1) as f32 / settings.levels as f32) {
                return None;
            }
        }
        Some(out)
    }
}
