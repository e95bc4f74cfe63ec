//! Bake of visibility ([P14] §4.2, §4.4): depths by rays, compressed by principal component
//! analysis. Computes [`Visibility`] from points and geometry.
//!
//! The depths of all points of a cluster in all directions of a [`HemisphereGrid`] are the rows of
//! a matrix. The mean row is subtracted (\[P14\] Eq. (7)), and the rows are projected onto the
//! first principal components (Eq. (8)). Deviations, in addition to those of [`Visibility`]:
//!
//! - **Directions are weighted by their cosine.** Components minimize the mean square of
//!   √cos θ · e, with the weights that directions have in irradiance. Directions along a wall have
//!   large depths, vary from point to point and hardly contribute.
//! - **One frame per cluster.** The directions of a point are relative to its own normal and its
//!   cluster's tangent. Neighbors then have corresponding directions. Without them, their depths
//!   have little in common.
//! - **s depends on the cluster** before any split: [`NEAR_PER_MEDIAN`] times the median of its
//!   depths. With one s for a scene, depths in a side aisle of a hall would all be close to zero.
//! - **Clusters with a large error are split**
//!   ([`max_cluster_error`](super::VisibilityRecipe::max_cluster_error)). Points on the two sides
//!   of a pillar differ, and fifty components cannot represent both. The split is at the mean of
//!   the coefficients of the first component ([B98]), so that each part has similar points. It is
//!   at the median if a part would be too small. A part with no more points than components is
//!   exact except for rounding.
//! - **Coefficients with an effect below** [`VisibilitySettings::tolerance`] are dropped, and
//!   components without coefficients.

use super::visibility::{encode, pack};
use super::visibility_compress::{ClusterDepths, CompressedCluster, compress};
use super::{HemisphereGrid, Visibility, VisibilitySettings, VisiblePoint, cluster, frame};
use crate::samples::tangents;
use crate::scene::{Geometry, Ray};
use glam::Vec3;
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicUsize, Ordering};

/// Value s of a cluster relative to the median of its depths.
pub const NEAR_PER_MEDIAN: f32 = 2.0;

/// Smallest s relative to the scene's size.
const MIN_NEAR: f32 = 1e-4;

/// Smallest cosine of the weights. Directions nearer to the horizon have the same weight.
const MIN_COSINE: f32 = 0.05;

/// Smallest part of a split, as a divisor of the number of points.
const MIN_PART_DIVISOR: usize = 8;

/// Largest number of words of all bases: 2 GiB.
const MAX_WORDS: usize = 1 << 29;

/// Error of a visibility bake.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum VisibilityError {
    /// Canceled by the progress callback.
    #[error("canceled")]
    Stopped,
    /// The data exceeds the size limit.
    #[error(
        "baked visibility exceeds the limit of {max} bytes: reduce the directions or the points, or raise the error"
    )]
    TooLarge {
        /// Size limit in bytes.
        max: u64,
    },
}

/// Computes the weights of the directions: the square roots of their cosines.
pub(super) fn weights(grid: HemisphereGrid) -> Vec<f32> {
    (0..grid.len())
        .map(|i| grid.direction(i).z.max(MIN_COSINE).sqrt())
        .collect()
}

/// Writes the depths in meters from (x, n) in all `directions` of a grid, with the tangent of its
/// cluster. The depth is infinite without a hit.
pub fn depths(
    geometry: &dyn Geometry,
    (x, n): (Vec3, Vec3),
    tangent: Vec3,
    directions: &[Vec3],
    out: &mut [f32],
) {
    let start = x + n * geometry.ray_offset(x);
    let (t, b) = frame(tangent, n);
    for (d, depth) in directions.iter().zip(out) {
        let ray = Ray::new(start, (t * d.x + b * d.y + n * d.z).normalize_or(n));
        *depth = geometry.cast(&ray).map_or(f32::INFINITY, |hit| hit.t);
    }
}

/// Bakes the visibility of `points`, positions in meters and unit normals. Returns the visibility
/// and the number of rays cast. `on_progress` receives the completed part and returns `false` to
/// cancel.
///
/// The result does not depend on the number of threads.
///
/// # Errors
///
/// Returns an error if canceled, or if the data exceeds 2 GiB.
pub fn bake_visibility(
    geometry: &dyn Geometry,
    points: &[(Vec3, Vec3)],
    settings: &VisibilitySettings,
    on_progress: &(dyn Fn(f32) -> bool + Sync),
) -> Result<(Visibility, u64), VisibilityError> {
    const LARGE: VisibilityError = VisibilityError::TooLarge {
        max: 4 * MAX_WORDS as u64,
    };

    let clusters = cluster(points, settings.recipe.cluster_size as usize, settings.seed);
    let size = geometry.bounds().size().max_element();
    let size = if size > 0.0 && size.is_finite() {
        size
    } else {
        1.0
    };
    let (done, stop, words) = (
        AtomicU32::new(0),
        AtomicBool::new(false),
        AtomicUsize::new(0),
    );
    let parts: Option<Vec<Vec<CompressedCluster>>> = (0..clusters.len())
        .into_par_iter()
        .map(|c| {
            let share = done.load(Ordering::Relaxed) as f32 / clusters.len() as f32;
            if stop.load(Ordering::Relaxed) || !on_progress(share) {
                stop.store(true, Ordering::Relaxed);
                return None;
            }
            let root = points[clusters.roots[c] as usize].1;
            let members = clusters.members_of(c);
            let seen = trace_cluster_depths(geometry, points, members, root, size, settings.grid());
            let parts = split_cluster(seen, settings, settings.seed ^ c as u64, &words)?;
            done.fetch_add(1, Ordering::Relaxed);
            Some(parts)
        })
        .collect();
    let Some(parts) = parts else {
        return Err(match words.load(Ordering::Relaxed) > MAX_WORDS {
            true => LARGE,
            false => VisibilityError::Stopped,
        });
    };
    let mut out = Visibility {
        grid: settings.grid(),
        points: vec![VisiblePoint::default(); points.len()],
        ..Visibility::default()
    };
    let mut coefficients: Vec<u16> = Vec::new();
    for parts in parts {
        for part in parts {
            let c = out.clusters.len() as u32;
            out.clusters.push(part.cluster);
            out.basis.extend(part.basis);
            out.scales.extend(part.scales);
            for (&i, kept) in part.members.iter().zip(part.points) {
                out.points[i as usize] = VisiblePoint {
                    cluster: c,
                    error: kept.error,
                    mask: kept.mask,
                    ..VisiblePoint::default()
                };
                coefficients.extend(kept.coefficients);
            }
        }
    }
    out.layout().ok_or(LARGE)?;
    out.coefficients = pack(&coefficients).collect();
    on_progress(1.0);
    Ok((out, (points.len() * settings.grid().len()) as u64))
}

/// Casts the rays of a cluster with the normal `root` of its root, in a scene of `size` meters.
fn trace_cluster_depths(
    geometry: &dyn Geometry,
    points: &[(Vec3, Vec3)],
    members: &[u32],
    root: Vec3,
    size: f32,
    grid: HemisphereGrid,
) -> ClusterDepths {
    let length = grid.len();
    let tangent = tangents(root).0;
    let directions: Vec<Vec3> = (0..length).map(|i| grid.direction(i)).collect();
    let mut rows = vec![0.0f32; members.len() * length];
    rows.par_chunks_mut(length)
        .zip(members)
        .for_each(|(row, &i)| depths(geometry, points[i as usize], tangent, &directions, row));
    let mut finite: Vec<f32> = rows.iter().copied().filter(|d| d.is_finite()).collect();
    let middle = finite.len() / 2;
    let near = match finite.is_empty() {
        true => size,
        false => NEAR_PER_MEDIAN * *finite.select_nth_unstable_by(middle, f32::total_cmp).1,
    };
    let near = near.max(MIN_NEAR * size);
    rows.iter_mut().for_each(|d| *d = encode(*d, near));
    ClusterDepths {
        members: members.to_vec(),
        tangent,
        near,
        rows,
    }
}

/// Compresses a cluster and splits it until its error is small enough. Returns `None` if the data,
/// together with `words`, exceeds its limit.
fn split_cluster(
    seen: ClusterDepths,
    settings: &VisibilitySettings,
    seed: u64,
    words: &AtomicUsize,
) -> Option<Vec<CompressedCluster>> {
    let length = settings.grid().len();
    let (mut todo, mut out) = (vec![seen], Vec::new());
    while let Some(seen) = todo.pop() {
        let (part, error, first) = compress(&seen, settings, seed);
        let count = seen.members.len();
        if error <= settings.recipe.max_cluster_error || count < 2 {
            let before = words.fetch_add(part.basis.len(), Ordering::Relaxed);
            if before + part.basis.len() > MAX_WORDS {
                return None;
            }
            out.push(part);
            continue;
        }
        drop(part);
        let mut order: Vec<usize> = (0..count).collect();
        order.sort_by(|&a, &b| first[a].total_cmp(&first[b]));
        let middle = order.partition_point(|&m| first[m] <= 0.0);
        let min = (count / MIN_PART_DIVISOR).max(1);
        let (low, high) = match middle < min || count - middle < min {
            true => order.split_at(count / 2),
            false => order.split_at(middle),
        };
        for half in [high, low] {
            let mut half = half.to_vec();
            half.sort_unstable();
            todo.push(ClusterDepths {
                members: half.iter().map(|&m| seen.members[m]).collect(),
                rows: (half.iter())
                    .flat_map(|&m| &seen.rows[m * length..(m + 1) * length])
                    .copied()
                    .collect(),
                ..seen
            });
        }
    }
    Some(out)
}
