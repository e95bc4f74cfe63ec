//! What surface points see, in few numbers: hemispherical depth, compressed by principal component analysis ([P14] §4.2, §4.4). Where in the flow: from points and
//! geometry to the arrays that the frame's soft shadows read.
//!
//! For each cluster of points: the depths of all its points in all directions of a [`HemisphereGrid`] are rows of a matrix, from which the mean row is taken
//! (\[P14\] Eq. (7)); the rows are projected onto the first principal components (Eq. (8)), and a depth is reconstructed as mean plus coefficients times
//! components (Eq. (9)). Where we deviate:
//!
//! - **e = d² / (d² + s²) and not d** is what is decomposed, with s the size of the level times [`NEAR`]; no hit is e = 1. How near a near thing is does not matter to a lamp, for
//!   it hides the lamp anyhow; what tells a lamp from what hangs before it is the difference of far depths, and with d, or d / (d + s), the components are spent on the other.
//! - **Directions count with their cosine.** Components minimise the mean square of √cos θ · e, as irradiance counts directions: what lies along a wall is deep, changes
//!   much from point to point, and hardly lights anything.
//! - **One frame a cluster.** The directions of a point start from its own normal, its tangent from that of its cluster: neighbours look the same way, or else their depths
//!   would have nothing in common.
//! - **Sparse coefficients** (\[P14\] §4.4): those too small to move a depth by [`VisibilitySettings::tolerance`] are left out, a mask says which are there.
//! - **Each cluster knows its error**: beside mean and components stands, for each direction, the root mean square of what they leave out. It says how soft a comparison
//!   with a depth must be.
//! - **Components are signed 8-bit numbers**, means, errors and coefficients signed 16-bit ones, with a scale for each component of each cluster: \[P14\] §4.4 stores 16 bits of all. Components are what
//!   takes the room, and more directions in the same room are worth more than more exact ones. The error that a cluster knows has their rounding in it.

use super::{HemisphereGrid, cluster, decompose};
use crate::samples::tangents;
use crate::scene::{Geometry, Ray};
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use rayon::prelude::*;

/// s of e = d² / (d² + s²), in parts of the largest edge of the level's box.
pub const NEAR: f32 = 1.0;

/// Depths count up to so many times s.
pub const MOST_RATIO: f32 = 1e9;

/// The usual number of directions, about.
const DIRECTIONS: u32 = 4000;

/// Directions nearer to the horizon count as if they had this cosine.
const LEAST_COSINE: f32 = 0.05;

/// How visibility is baked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VisibilitySettings {
    /// Directions a point.
    pub grid: HemisphereGrid,
    /// Most components a cluster, at most [`Visibility::MOST_COMPONENTS`].
    pub components: u32,
    /// Points a cluster has about.
    pub cluster_points: u32,
    /// Root mean square, over all directions, of the change in e below which a coefficient is left out.
    pub tolerance: f32,
    /// Seed of the random numbers.
    pub seed: u64,
}

impl Default for VisibilitySettings {
    /// \[P14\] §6 has 2016 directions ([`HemisphereGrid::default`]), 50 coefficients, and §4.1 1000 points a cluster; here twice the directions in half the bits, and clusters of 400 points: docs/PCA.md says
    /// why.
    fn default() -> Self {
        Self {
            grid: HemisphereGrid::of(DIRECTIONS),
            components: 50,
            cluster_points: 400,
            tolerance: 5e-4,
            seed: 0,
        }
    }
}

/// A cluster's basis. 32 bytes, the layout of `VisibilityCluster` in the shaders.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct VisibilityCluster {
    /// Where the frames of its points turn their first axis to, a unit vector.
    pub tangent: [f32; 3],
    /// Its components, the mean not counted.
    pub components: u32,
    /// Where its part of [`Visibility::basis`] starts: direction after direction, [`words`](Self::words) each.
    pub basis: u32,
    /// Where its part of [`Visibility::scales`] starts: the mean's, the error's, then each component's.
    pub scales: u32,
    /// Not used.
    pub pad: [u32; 2],
}

impl VisibilityCluster {
    /// Words of the basis a direction: one for mean and error, then components, four a word.
    #[must_use]
    pub fn words(&self) -> usize {
        (self.components as usize).div_ceil(4) + 1
    }
}

/// A point's coefficients. 32 bytes, the layout of `VisiblePoint` in the shaders.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct VisiblePoint {
    /// Its cluster.
    pub cluster: u32,
    /// Its first coefficient, in halves of the words of [`Visibility::coefficients`].
    pub first: u32,
    /// Not used.
    pub pad: [u32; 2],
    /// Bit j: component j has a coefficient.
    pub mask: [u32; 4],
}

impl VisiblePoint {
    /// How many coefficients it has.
    #[must_use]
    pub fn count(&self) -> u32 {
        self.mask.iter().map(|m| m.count_ones()).sum()
    }
}

/// The visibility of the first points of a baked scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Visibility {
    /// Which directions.
    pub grid: HemisphereGrid,
    /// s of e = d² / (d² + s²), metres.
    pub near: f32,
    /// The clusters.
    pub clusters: Vec<VisibilityCluster>,
    /// One a point.
    pub points: Vec<VisiblePoint>,
    /// Of each direction its mean and its error, two signed normalised 16-bit numbers in a word, then its components, four signed normalised 8-bit numbers a word.
    pub basis: Vec<u32>,
    /// What the numbers of the basis and the coefficients are to be multiplied by.
    pub scales: Vec<f32>,
    /// Coefficients, two signed normalised 16-bit numbers a word.
    pub coefficients: Vec<u32>,
}

impl Visibility {
    /// Most components of a cluster: bits of a point's mask.
    pub const MOST_COMPONENTS: u32 = 128;

    /// Bytes of all arrays in memory and on the device.
    #[must_use]
    pub fn bytes(&self) -> usize {
        32 * (self.clusters.len() + self.points.len())
            + 4 * (self.basis.len() + self.scales.len() + self.coefficients.len())
    }

    /// Share of the coefficients that are kept.
    #[must_use]
    pub fn kept(&self) -> f64 {
        let all: u64 = self
            .points
            .iter()
            .map(|p| u64::from(self.clusters[p.cluster as usize].components))
            .sum();
        let kept: u64 = self.points.iter().map(|p| u64::from(p.count())).sum();
        kept as f64 / all.max(1) as f64
    }

    /// Says where the arrays of each cluster and point start, one behind the other, from how many components and coefficients they have. Returns how long the
    /// arrays are: words of the basis, scales, words of the coefficients; none where that is beyond 32 bits, or a point names no cluster.
    #[must_use]
    pub fn place(&mut self) -> Option<(usize, usize, usize)> {
        let (mut basis, mut scales) = (0u32, 0u32);
        for cluster in &mut self.clusters {
            (cluster.basis, cluster.scales) = (basis, scales);
            let words = cluster.components.min(Self::MOST_COMPONENTS).div_ceil(4) + 1;
            let length = u32::try_from(self.grid.len()).ok()?;
            basis = basis.checked_add(words.checked_mul(length)?)?;
            scales = scales.checked_add(cluster.components.min(Self::MOST_COMPONENTS) + 2)?;
        }
        // Cluster after cluster, in each as the points are numbered.
        let mut next = vec![0u32; self.clusters.len() + 1];
        for point in &self.points {
            let count = next.get_mut(point.cluster as usize + 1)?;
            *count = count.checked_add(point.count())?;
        }
        for c in 0..self.clusters.len() {
            next[c + 1] = next[c + 1].checked_add(next[c])?;
        }
        let end = next[self.clusters.len()];
        for point in &mut self.points {
            let first = &mut next[point.cluster as usize];
            point.first = *first;
            *first += point.count();
        }
        Some((basis as usize, scales as usize, end.div_ceil(2) as usize))
    }

    /// Number `at` of the coefficients, as it is stored.
    pub(super) fn coefficient(&self, at: u32) -> u16 {
        (self.coefficients[at as usize / 2] >> (16 * (at % 2))) as u16
    }

    /// The coefficients of point `i` with their scales, into `out`: 1 for the mean, 1 for the error, then one a component. Returns how many numbers these are.
    #[inline]
    pub fn decode(&self, i: usize, out: &mut [f32; Self::MOST_COMPONENTS as usize + 2]) -> usize {
        let point = &self.points[i];
        let cluster = &self.clusters[point.cluster as usize];
        let scales = &self.scales[cluster.scales as usize..];
        (out[0], out[1]) = (scales[0], scales[1]);
        let mut at = point.first;
        for j in 0..cluster.components as usize {
            out[j + 2] = 0.0;
            if point.mask[j / 32] >> (j % 32) & 1 != 0 {
                out[j + 2] = scales[j + 2] * from_snorm(self.coefficient(at));
                at += 1;
            }
        }
        cluster.components as usize + 2
    }

    /// e in direction `texel` of a point of `cluster` whose decoded coefficients these are, \[P14\] Eq. (9), and the root mean square error of that for
    /// the points of the cluster.
    #[must_use]
    #[inline]
    pub fn reconstruct(
        &self,
        cluster: &VisibilityCluster,
        decoded: &[f32],
        texel: u32,
    ) -> (f32, f32) {
        let words = cluster.words();
        let start = cluster.basis as usize + texel as usize * words;
        let basis = &self.basis[start..start + words];
        let mut e = decoded[0] * from_snorm(basis[0] as u16);
        let error = decoded[1] * from_snorm((basis[0] >> 16) as u16);
        for (word, four) in basis[1..].iter().zip(decoded[2..].chunks(4)) {
            for (bits, v) in word.to_le_bytes().into_iter().zip(four) {
                e += v * from_short(bits);
            }
        }
        (e, error)
    }

    /// e of a light at `distance` metres.
    #[must_use]
    #[inline]
    pub fn encode(&self, distance: f32) -> f32 {
        encode(distance, self.near)
    }
}

/// e = d² / (d² + s²); 1 for no hit.
#[must_use]
#[inline]
pub fn encode(distance: f32, near: f32) -> f32 {
    // No square overflows.
    let q = (distance / near).min(MOST_RATIO);
    q * q / (1.0 + q * q)
}

/// A signed normalised number, as WGSL's `unpack2x16snorm` reads it.
#[inline]
pub(super) fn from_snorm(bits: u16) -> f32 {
    (f32::from(bits as i16) / 32767.0).max(-1.0)
}

/// A signed normalised number of eight bits, as WGSL's `unpack4x8snorm` reads it.
#[inline]
pub(super) fn from_short(bits: u8) -> f32 {
    (f32::from(bits as i8) / 127.0).max(-1.0)
}

fn to_short(v: f32) -> u8 {
    (v.clamp(-1.0, 1.0) * 127.0).round() as i8 as u8
}

pub(super) fn to_snorm(v: f32) -> u16 {
    (v.clamp(-1.0, 1.0) * 32767.0).round() as i16 as u16
}

pub(super) fn pack(numbers: &[u16]) -> impl Iterator<Item = u32> + '_ {
    numbers
        .chunks(2)
        .map(|pair| u32::from(pair[0]) | u32::from(pair.get(1).copied().unwrap_or(0)) << 16)
}

/// The axes of a point's directions: x along the tangent of its cluster as far as that lies in the surface, z along its normal.
#[must_use]
#[inline]
pub fn frame(tangent: Vec3, n: Vec3) -> (Vec3, Vec3) {
    let along = tangent - n * n.dot(tangent);
    let square = along.dot(along);
    if square > 1e-6 {
        let t = along / square.sqrt();
        (t, n.cross(t))
    } else {
        tangents(n)
    }
}

/// Depths, in metres, of all directions of `grid` from (x, n), with the tangent of its cluster; infinite where there is nothing.
pub fn depths(
    geometry: &dyn Geometry,
    (x, n): (Vec3, Vec3),
    tangent: Vec3,
    grid: HemisphereGrid,
    out: &mut [f32],
) {
    let start = x + n * geometry.lift(x);
    let (t, b) = frame(tangent, n);
    for (i, depth) in out.iter_mut().enumerate() {
        let d = grid.direction(i);
        let ray = Ray::new(start, (t * d.x + b * d.y + n * d.z).normalize_or(n));
        *depth = geometry.cast(&ray).map_or(f32::INFINITY, |hit| hit.t);
    }
}

/// One cluster before all are put together.
struct Part {
    tangent: Vec3,
    /// The mean's, the error's, then each component's.
    scales: Vec<f32>,
    basis: Vec<u32>,
    /// One a member: the mask and what it says is there.
    points: Vec<([u32; 4], Vec<u16>)>,
}

/// Bakes the visibility of `points`, places (metres) and unit normals. Also says how many rays it took. None where `told`, which hears how much is done, says stop.
///
/// The same for any number of threads.
pub fn bake_visibility(
    geometry: &dyn Geometry,
    points: &[(Vec3, Vec3)],
    settings: &VisibilitySettings,
    told: &(dyn Fn(f32) -> bool + Sync),
) -> Option<(Visibility, u64)> {
    let clusters = cluster(points, settings.cluster_points as usize, settings.seed);
    let size = geometry.bounds().size().max_element();
    let near = NEAR
        * if size > 0.0 && size.is_finite() {
            size
        } else {
            1.0
        };
    let done = std::sync::atomic::AtomicU32::new(0);
    let parts: Vec<Option<Part>> = (0..clusters.len())
        .into_par_iter()
        .map(|c| {
            let root = points[clusters.roots[c] as usize].1;
            let part = bake_cluster(
                geometry,
                points,
                clusters.members_of(c),
                root,
                near,
                settings,
                c,
            );
            let done = 1 + done.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
            told(done as f32 / clusters.len() as f32).then_some(part)
        })
        .collect();
    let mut out = Visibility {
        grid: settings.grid,
        near,
        points: vec![VisiblePoint::default(); points.len()],
        ..Visibility::default()
    };
    let mut coefficients: Vec<u16> = Vec::new();
    for (c, part) in parts.into_iter().enumerate() {
        let part = part?;
        out.clusters.push(VisibilityCluster {
            tangent: part.tangent.to_array(),
            components: part.scales.len() as u32 - 2,
            ..VisibilityCluster::default()
        });
        out.basis.extend(part.basis);
        out.scales.extend(part.scales);
        for (&i, (mask, kept)) in clusters.members_of(c).iter().zip(part.points) {
            out.points[i as usize] = VisiblePoint {
                cluster: c as u32,
                mask,
                ..VisiblePoint::default()
            };
            coefficients.extend(kept);
        }
    }
    // Beyond 32 bits nothing could read it: no visibility then.
    out.place()?;
    out.coefficients = pack(&coefficients).collect();
    Some((out, (points.len() * settings.grid.len()) as u64))
}

fn bake_cluster(
    geometry: &dyn Geometry,
    points: &[(Vec3, Vec3)],
    members: &[u32],
    root: Vec3,
    near: f32,
    settings: &VisibilitySettings,
    c: usize,
) -> Part {
    let grid = settings.grid;
    let length = grid.len();
    let tangent = tangents(root).0;
    let mut rows = vec![0.0f32; members.len() * length];
    rows.par_chunks_mut(length)
        .zip(members)
        .for_each(|(row, &i)| {
            depths(geometry, points[i as usize], tangent, grid, row);
            row.iter_mut().for_each(|d| *d = encode(*d, near));
        });
    let mut mean = vec![0.0f64; length];
    for row in rows.chunks_exact(length) {
        mean.iter_mut()
            .zip(row)
            .for_each(|(m, e)| *m += f64::from(*e));
    }
    let mean: Vec<f32> = mean
        .iter()
        .map(|m| (m / members.len() as f64) as f32)
        .collect();
    for row in rows.chunks_exact_mut(length) {
        row.iter_mut().zip(&mean).for_each(|(e, m)| *e -= m);
    }
    let most = settings.components.min(Visibility::MOST_COMPONENTS) as usize;
    // Directions count as irradiance counts them.
    let weights: Vec<f32> = (0..length)
        .map(|i| grid.direction(i).z.max(LEAST_COSINE).sqrt())
        .collect();
    for row in rows.chunks_exact_mut(length) {
        row.iter_mut().zip(&weights).for_each(|(e, w)| *e *= w);
    }
    let found = decompose(&rows, length, most, settings.seed ^ c as u64);
    let stride = found.count();
    let component = |j: usize, i: usize| found.vector(j)[i] / weights[i];

    // [P14] Eq. (8).
    let coefficients: Vec<f32> = rows
        .chunks_exact(length)
        .flat_map(|row| {
            (0..stride).map(|j| {
                let products = row.iter().zip(found.vector(j));
                products
                    .map(|(e, v)| f64::from(*e) * f64::from(*v))
                    .sum::<f64>() as f32
            })
        })
        .collect();
    let largest_of = |j: usize| {
        let all = coefficients.iter().skip(j).step_by(stride.max(1));
        all.fold(0.0f32, |most, v| most.max(v.abs()))
    };
    let most: Vec<f32> = (0..stride).map(largest_of).collect();
    // Components are of length one: a coefficient moves e by its own value over the root of the number of directions, in the mean.
    let least = settings.tolerance * (length as f32).sqrt();
    // Components that no point keeps are not stored.
    let used = (most.iter()).rposition(|&v| v >= least && v > 0.0);
    let count = used.map_or(0, |last| last + 1);
    // Components of largest number one, and what that took goes to their coefficients.
    let largest = |v: &[f32]| v.iter().fold(0.0f32, |most, v| most.max(v.abs()));
    let over = |v: f32, scale: f32| if scale > 0.0 { v / scale } else { 0.0 };
    let basis_scale: Vec<f32> = (0..count)
        .map(|j| (0..length).fold(0.0f32, |most, i| most.max(component(j, i).abs())))
        .collect();
    // As they are stored, component after component.
    let stored: Vec<u8> = (0..count)
        .flat_map(|j| (0..length).map(move |i| (j, i)))
        .map(|(j, i)| to_short(over(component(j, i), basis_scale[j])))
        .collect();
    // What is left of the rows when all that is stored is taken off is the error.
    let points: Vec<([u32; 4], Vec<u16>)> = rows
        .chunks_exact_mut(length)
        .enumerate()
        .map(|(m, row)| {
            (row.iter_mut().zip(&weights)).for_each(|(e, w)| *e /= w);
            let mut mask = [0u32; 4];
            let mut kept = Vec::new();
            for j in 0..count {
                let v = coefficients[m * stride + j];
                if v.abs() >= least && v != 0.0 {
                    mask[j / 32] |= 1 << (j % 32);
                    let bits = to_snorm(v / most[j]);
                    kept.push(bits);
                    let factor = from_snorm(bits) * most[j] * basis_scale[j];
                    let numbers = &stored[j * length..(j + 1) * length];
                    (row.iter_mut().zip(numbers)).for_each(|(e, c)| *e -= factor * from_short(*c));
                }
            }
            (mask, kept)
        })
        .collect();
    let mut error = vec![0.0f32; length];
    for row in rows.chunks_exact(length) {
        (error.iter_mut().zip(row)).for_each(|(s, e)| *s += e * e / members.len() as f32);
    }
    error.iter_mut().for_each(|s| *s = s.sqrt());

    let mut scales = vec![largest(&mean), largest(&error)];
    scales.extend((0..count).map(|j| most[j] * basis_scale[j]));
    let mut basis = Vec::with_capacity(length * (count.div_ceil(4) + 1));
    for i in 0..length {
        let first = [
            to_snorm(over(mean[i], scales[0])),
            to_snorm(over(error[i], scales[1])),
        ];
        basis.extend(pack(&first));
        basis.extend((0..count).step_by(4).map(|j| {
            let of = |k: usize| (j + k < count).then(|| stored[(j + k) * length + i]);
            u32::from_le_bytes([0, 1, 2, 3].map(|k| of(k).unwrap_or(0)))
        }));
    }
    Part {
        tangent,
        scales,
        basis,
        points,
    }
}
