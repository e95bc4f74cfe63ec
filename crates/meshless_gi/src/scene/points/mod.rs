//! A cloud of points as a surface: positions, normals (given or estimated), reflectances and areas
//! as plain arrays, and the mesh of flat cells that rays meet. In the flow it stands where a
//! level's triangles stand: read from a `.ply` ([`load_ply`]), joined with other geometry, baked.
//!
//! The cells are triangles of an ordinary [`TriangleMesh`], and no discs with an intersection of
//! their own. A disc reaches over every edge by its radius, covers its neighbors two- or threefold,
//! and would need a second kind of primitive in the frame's shadow rays and on the device; the
//! cells tile the surface, end where it ends, and all that works on triangles works on them: what
//! the bake meets is what the frame shadows with, bit by bit.
//!
//! Points reflect on both sides: a `.ply` has no material that could say otherwise.

mod cells;
mod nearest;
mod normals;
mod parts;
#[cfg(test)]
mod tests;

use super::{
    Bounds, InputBudget, Material, PlyPoints, SceneError, TriangleMesh, parse_ply, read_ply_within,
};
use cells::cells;
use glam::Vec3;
use nearest::{Neighbor, PointTree};
use rayon::prelude::*;
use std::collections::HashMap;
use std::ops::Range;
use std::path::Path;

/// Coordinates from here on, in meters, are taken for damage: no scene is as large, and what is
/// left of single precision there is 64 m.
const FARTHEST: f32 = 1e9;
/// Most points of a cloud: the corners of their cells, [`cells::MAX_CORNERS`] each at most, are
/// numbered by 32 bits.
const MAX_POINTS: usize = (1 << 31) / cells::MAX_CORNERS;
/// Albedo of a point without a color.
const GRAY: Vec3 = Vec3::splat(0.5);
/// Normals of one position that enclose an angle with a cosine above this are of one point.
const SAME: f32 = 0.766;

/// Points around a corner of a cell whose normals it may have a part of.
const AROUND: usize = 8;

/// Error of building a surface from points.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PointsError {
    /// Fewer than three positions.
    #[error(
        "{usable} usable points at different positions ({not_finite} not finite, {coincident} coincident): three at least make a surface"
    )]
    TooFew {
        /// Points that could be used.
        usable: u64,
        /// Points with a coordinate that is not finite, or beyond 10⁹ m.
        not_finite: u64,
        /// Points at the position of another one with its normal.
        coincident: u64,
    },
    /// More points than indices of 32 bits reach, with all corners of their cells.
    #[error("{0} points, at most {MAX_POINTS}")]
    TooMany(usize),
    /// Normals or colors are not as many as positions.
    #[error("{positions} positions, but {others} {what}")]
    Lengths {
        /// Number of positions.
        positions: usize,
        /// Name of the array with another length.
        what: &'static str,
        /// Length of that array.
        others: usize,
    },
    /// The points are there, but so close together that their cells have no area in single
    /// precision.
    #[error("the points are so close together that they have no area")]
    NoArea,
}

/// Numbers of parts that were dropped or corrected when a cloud was built.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PointProblems {
    /// Points dropped because a coordinate was not finite, or beyond 10⁹ m.
    pub not_finite: u64,
    /// Points dropped because another one with the same position and a similar normal is there.
    pub coincident: u64,
    /// Points that had no usable normal among others that had one: it was estimated.
    pub normal_estimated: u64,
    /// Points dropped because neither the file nor their neighbors give them a normal.
    pub no_normal: u64,
    /// Points whose reflectance was not within [0, 1]: clamped; 0 where it was no number.
    pub albedo_clamped: u64,
}

/// Points that stand for a surface. All arrays are of the same length.
#[derive(Clone, Debug, Default)]
pub struct PointCloud {
    /// Meters.
    pub positions: Vec<Vec3>,
    /// Unit.
    pub normals: Vec<Vec3>,
    /// Diffuse reflectance, linear RGB in [0, 1].
    pub albedo: Vec<Vec3>,
    /// The surface that each point stands for, m².
    pub areas: Vec<f32>,
    /// True where the file gave no normals at all.
    pub normals_estimated: bool,
    /// Problems that were dropped or corrected.
    pub problems: PointProblems,
    /// Corners of all cells, those of point i from `first[i]` to `first[i + 1]`.
    corners: Vec<Vec3>,
    first: Vec<u32>,
    lifts: Vec<f32>,
    spacings: Vec<f32>,
}

impl PointCloud {
    /// A cloud of points as a file has them: cleans them, estimates what is missing, finds what
    /// surface each stands for. Points keep their order. Where there are no normals, a closed part
    /// of the surface that one of `viewpoints` (meters, in free space) lies in faces it; other
    /// parts face outwards, or what they lie around. Points without a color reflect a half. The
    /// same points give the same cloud on any number of threads.
    ///
    /// # Errors
    /// See [`PointsError`].
    pub fn new(points: PlyPoints, viewpoints: &[Vec3]) -> Result<Self, PointsError> {
        let count = points.positions.len();
        if count > MAX_POINTS {
            return Err(PointsError::TooMany(count));
        }
        for (what, others) in [("normals", &points.normals), ("colors", &points.albedo)] {
            if let Some(others) = others.as_ref().map(Vec::len).filter(|n| *n != count) {
                return Err(PointsError::Lengths {
                    positions: count,
                    what,
                    others,
                });
            }
        }
        let mut problems = PointProblems::default();
        let kept = usable(&points, &mut problems);
        if kept.len() < 3 {
            return Err(PointsError::TooFew {
                usable: kept.len() as u64,
                not_finite: problems.not_finite,
                coincident: problems.coincident,
            });
        }
        let mut positions: Vec<Vec3> = kept.iter().map(|&i| points.positions[i as usize]).collect();
        let mut tree = PointTree::new(&positions);
        let given = points.normals.as_ref();
        let mut normals = match given {
            None => normals::estimate(&positions, &tree, viewpoints),
            Some(given) => {
                let given: Vec<Vec3> = kept.iter().map(|&i| unit(given[i as usize])).collect();
                normals::complete(&positions, given, &tree, &mut problems.normal_estimated)
            }
        };
        let color = |i: u32| {
            points
                .albedo
                .as_ref()
                .map_or(GRAY, |albedo| albedo[i as usize])
        };
        let mut albedo: Vec<Vec3> = kept
            .iter()
            .map(|&i| reflectance(color(i), &mut problems.albedo_clamped))
            .collect();
        if normals.contains(&Vec3::ZERO) {
            let keep = |of: &[Vec3]| {
                of.iter()
                    .zip(&normals)
                    .filter(|(_, n)| **n != Vec3::ZERO)
                    .map(|(v, _)| *v)
                    .collect::<Vec<_>>()
            };
            (positions, albedo) = (keep(&positions), keep(&albedo));
            let before = normals.len();
            normals.retain(|n| *n != Vec3::ZERO);
            problems.no_normal = (before - normals.len()) as u64;
            tree = PointTree::new(&positions);
        }
        let cells = cells(&positions, &normals, &tree);
        let mut cloud = Self {
            positions,
            normals,
            albedo,
            areas: cells.iter().map(|c| c.area).collect(),
            normals_estimated: given.is_none(),
            problems,
            corners: Vec::with_capacity(cells.iter().map(|c| c.outline.len()).sum()),
            first: vec![0],
            lifts: cells.iter().map(|c| c.lift).collect(),
            spacings: cells.iter().map(|c| c.spacing).collect(),
        };
        for cell in &cells {
            cloud.corners.extend_from_slice(&cell.outline);
            cloud.first.push(cloud.corners.len() as u32);
        }
        if cloud.areas.iter().all(|a| *a <= 0.0) {
            return Err(PointsError::NoArea);
        }
        Ok(cloud)
    }

    /// Number of points.
    #[must_use]
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// True when it has no point; a cloud that was built has some.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Corners, meters, of the flat convex cell of point `i`, counter-clockwise as seen from where
    /// its normal points. It overlaps its neighbors' cells a little. Empty where the point stands
    /// for no surface.
    #[must_use]
    pub fn outline(&self, i: usize) -> &[Vec3] {
        &self.corners[self.corners_of(i)]
    }

    /// Distance between point `i` and its neighbors, meters, about; 0 where the point stands for no
    /// surface.
    #[must_use]
    pub fn spacing(&self, i: usize) -> f32 {
        self.spacings.get(i).copied().unwrap_or(0.0)
    }

    /// A normal for each corner of each cell, in the order of the points and their
    /// [`outline`](Self::outline)s: the mean of those of the points around it, without those beyond
    /// a crease. Cells that meet in a corner have nearly the same normal there, so that light drawn
    /// with it changes smoothly from cell to cell.
    #[must_use]
    pub fn corner_normals(&self) -> Vec<Vec3> {
        let tree = PointTree::new(&self.positions);
        let of_cell = |near: &mut Vec<Neighbor>, i: usize| {
            let own = self.normals[i];
            let at = |corner: &Vec3| {
                tree.nearest(*corner, AROUND, None, near);
                let reach = near.last().map_or(0.0, |n| n.square).max(f32::MIN_POSITIVE);
                let sum: Vec3 = (near.iter())
                    .map(|n| (self.normals[n.index as usize], 1.0 - n.square / reach))
                    .filter(|(normal, _)| normal.dot(own) > SAME)
                    .map(|(normal, weight)| normal * weight * weight)
                    .sum();
                sum.try_normalize().unwrap_or(own)
            };
            self.outline(i).iter().map(at).collect::<Vec<_>>()
        };
        (0..self.len())
            .into_par_iter()
            .map_init(Vec::new, of_cell)
            .flatten_iter()
            .collect()
    }

    /// Range in [`corner_normals`](Self::corner_normals) of the corners of point `i`'s cell.
    #[must_use]
    pub fn corners_of(&self, i: usize) -> Range<usize> {
        match (self.first.get(i), self.first.get(i + 1)) {
            (Some(&from), Some(&to)) => from as usize..to as usize,
            _ => 0..0,
        }
    }

    /// All points in parts that lie together, of `max` points at most (1 at least): ascending
    /// indices.
    #[must_use]
    pub fn parts(&self, max: usize) -> Vec<Vec<u32>> {
        parts::parts(&self.positions, max)
    }

    /// A box around the points.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        self.positions.iter().fold(Bounds::EMPTY, |b, x| b.join(*x))
    }

    /// The cells as triangles, for rays, and which point each triangle belongs to. Cells too small
    /// for single precision are left out.
    #[must_use]
    pub fn mesh(&self) -> (TriangleMesh, Vec<u32>) {
        let mut materials = Vec::new();
        let mut known: HashMap<[u32; 3], u32> = HashMap::new();
        let (mut triangles, mut material_of, mut point_of) = (Vec::new(), Vec::new(), Vec::new());
        for i in 0..self.len() {
            let albedo = self.albedo[i];
            let material = *known
                .entry(albedo.to_array().map(f32::to_bits))
                .or_insert_with(|| {
                    materials.push(Material::diffuse(albedo));
                    materials.len() as u32 - 1
                });
            for triangle in fan(self.outline(i)).filter(super::mesh::has_area) {
                triangles.push(triangle);
                material_of.push(material);
                point_of.push(i as u32);
            }
        }
        let mut mesh = TriangleMesh::new(triangles, material_of, materials);
        mesh.set_lifts(self.lifts());
        (mesh, point_of)
    }

    /// Returns the ray offsets that exceed those of a mesh.
    fn lifts(&self) -> Option<Lifts> {
        let rough = |i: &usize| self.lifts[*i] > 1e-3 * self.spacings[*i];
        let rough: Vec<usize> = (0..self.len()).filter(rough).collect();
        let rough_positions: Vec<Vec3> = rough.iter().map(|&i| self.positions[i]).collect();
        let lifts = rough
            .iter()
            .map(|&i| [self.lifts[i], 2.0 * self.spacings[i]]);
        (!rough_positions.is_empty()).then(|| Lifts {
            tree: PointTree::new(&rough_positions),
            farthest: lifts.clone().map(|[_, reach]| reach).fold(0.0, f32::max),
            lifts: lifts.collect(),
        })
    }
}

/// Ray offsets of cells that do not lie in the planes of their neighbors.
#[derive(Clone, Debug)]
pub(super) struct Lifts {
    tree: PointTree,
    /// Ray offset and radius of influence of each point of the tree, meters.
    lifts: Vec<[f32; 2]>,
    /// The largest of those reaches, meters.
    farthest: f32,
}

impl Lifts {
    /// The lift at `p`, meters; 0 where no rough cell is near.
    pub(super) fn at(&self, p: Vec3) -> f32 {
        let near = self.tree.nearest_within(p, self.farthest * self.farthest);
        near.map_or(0.0, |n| {
            let [lift, reach] = self.lifts[n.index as usize];
            if n.square <= reach * reach { lift } else { 0.0 }
        })
    }
}

/// The triangles of a convex polygon.
fn fan(corners: &[Vec3]) -> impl Iterator<Item = [Vec3; 3]> + '_ {
    let others = corners.get(1..).unwrap_or_default();
    others.windows(2).map(|pair| [corners[0], pair[0], pair[1]])
}

/// Points that are finite, and of those at one position with similar normals the first: their
/// indices in order.
fn usable(points: &PlyPoints, problems: &mut PointProblems) -> Vec<u32> {
    let fine = |x: &Vec3| x.is_finite() && x.abs().max_element() < FARTHEST;
    let mut order: Vec<u32> = (0..points.positions.len() as u32)
        .filter(|i| fine(&points.positions[*i as usize]))
        .collect();
    problems.not_finite = (points.positions.len() - order.len()) as u64;
    // Adding 0 makes one zero of both.
    let key = |i: u32| {
        (points.positions[i as usize] + Vec3::ZERO)
            .to_array()
            .map(f32::to_bits)
    };
    let finite = order.len();
    let normal = |i: u32| {
        points
            .normals
            .as_ref()
            .map_or(Vec3::ZERO, |n| unit(n[i as usize]))
    };
    // Of points at one position those with a normal come first: one without must not stand for
    // them.
    order.sort_unstable_by_key(|i| (key(*i), normal(*i) == Vec3::ZERO, *i));
    let mut kept = Vec::with_capacity(order.len());
    for cell in order.chunk_by(|a, b| key(*a) == key(*b)) {
        let start = kept.len();
        for &i in cell {
            let known = |k: &u32| {
                let (a, b) = (normal(*k), normal(i));
                a == Vec3::ZERO || b == Vec3::ZERO || a.dot(b) > SAME
            };
            if !kept[start..].iter().any(known) {
                kept.push(i);
            }
        }
    }
    kept.sort_unstable();
    problems.coincident = (finite - kept.len()) as u64;
    kept
}

/// The normal at length one; zero where it has no direction.
fn unit(n: Vec3) -> Vec3 {
    let largest = n.abs().max_element();
    if n.is_finite() && largest > 0.0 {
        (n / largest).normalize()
    } else {
        Vec3::ZERO
    }
}

fn reflectance(color: Vec3, clamped: &mut u64) -> Vec3 {
    let inside = Vec3::from_array(
        color
            .to_array()
            .map(|c| if c.is_nan() { 0.0 } else { c.clamp(0.0, 1.0) }),
    );
    *clamped += u64::from(inside != color);
    inside
}

/// A point cloud as it was read.
#[derive(Debug)]
pub struct LoadedPoints {
    /// The points.
    pub cloud: PointCloud,
    /// Notes on content that was not read or was read in another way.
    pub notes: Vec<String>,
}

/// Reads a `.ply` file as a cloud; see [`PointCloud::new`].
///
/// # Errors
/// [`SceneError::Io`] and [`SceneError::Refused`] where the file cannot be read,
/// [`SceneError::Ply`] and [`SceneError::Points`] where its content is not valid.
pub fn load_ply(path: impl AsRef<Path>, viewpoints: &[Vec3]) -> Result<LoadedPoints, SceneError> {
    load_ply_within(path, viewpoints, &mut InputBudget::default())
}

/// As [`load_ply`], of a file within `budget`.
///
/// # Errors
/// Those of [`load_ply`], and [`SceneError::Refused`].
pub fn load_ply_within(
    path: impl AsRef<Path>,
    viewpoints: &[Vec3],
    budget: &mut InputBudget,
) -> Result<LoadedPoints, SceneError> {
    let path = path.as_ref();
    let points = read_ply_within(path, budget)?;
    cloud_of(points, &path.display().to_string(), viewpoints)
}

/// As [`load_ply`], of a file's bytes; `name` is what errors call it.
///
/// # Errors
/// [`SceneError::Ply`] and [`SceneError::Points`] where the content is not valid.
pub fn load_ply_bytes(
    bytes: &[u8],
    name: &str,
    viewpoints: &[Vec3],
) -> Result<LoadedPoints, SceneError> {
    let points = parse_ply(bytes).map_err(|source| SceneError::Ply {
        file: name.into(),
        source,
    })?;
    cloud_of(points, name, viewpoints)
}

fn cloud_of(
    points: PlyPoints,
    name: &str,
    viewpoints: &[Vec3],
) -> Result<LoadedPoints, SceneError> {
    let faces = points.faces;
    let cloud = PointCloud::new(points, viewpoints).map_err(|source| SceneError::Points {
        file: name.into(),
        source,
    })?;
    let p = &cloud.problems;
    let notes = [
        (faces, "faces were passed over: a .ply is taken for points"),
        (p.not_finite, "points without numbers were left out"),
        (
            p.coincident,
            "points at the position of others were left out",
        ),
        (p.no_normal, "points without a normal were left out"),
        (
            p.normal_estimated,
            "points without a normal got one from their neighbors",
        ),
        (
            p.albedo_clamped,
            "points reflected what light can't be: clamped",
        ),
    ];
    let mut notes: Vec<String> = notes
        .into_iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, what)| format!("{count} {what}"))
        .collect();
    if cloud.normals_estimated {
        notes.push("the file has no normals: they were estimated".into());
    }
    Ok(LoadedPoints { cloud, notes })
}
