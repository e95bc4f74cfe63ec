//! Point clouds as surfaces. A cloud has arrays of positions, normals (given or estimated),
//! reflectances and areas, and a mesh of flat cells for ray casts. It takes the role of a scene's
//! triangles: it is read from a `.ply` file ([`load_ply`]), joined with other geometry and baked.
//!
//! The cells are triangles of an ordinary [`TriangleMesh`]. Discs are not used. A disc extends over
//! each edge by its radius and covers its neighbors two or three times. Discs would also need a
//! second primitive type in the frame's shadow rays and on the GPU. The cells tile the surface and
//! end at its borders, and all code for triangles applies to them. The bake and the frame's shadow
//! rays use bitwise identical geometry.
//!
//! Points reflect on both sides, because a `.ply` file has no material with a single-sided flag.

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

/// Upper limit of coordinates, meters. Larger values are treated as damage: no scene is this large,
/// and the resolution of single precision there is 64 m.
const MAX_COORDINATE: f32 = 1e9;
/// Largest number of points in a cloud. The corners of the cells, at most [`cells::MAX_CORNERS`]
/// per cell, have 32-bit indices.
const MAX_POINTS: usize = (1 << 31) / cells::MAX_CORNERS;
/// Albedo of a point without a color.
const GRAY: Vec3 = Vec3::splat(0.5);
/// Cosine threshold for normals at one position. Normals with a larger cosine belong to the same
/// point.
const MIN_SURFACE_COSINE: f32 = 0.766;

/// Number of points around a cell corner that can contribute to its normal.
const AROUND: usize = 8;

/// Error of building a surface from points.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PointsError {
    /// Fewer than three positions.
    #[error(
        "{usable} usable points at different positions ({not_finite} not finite, {coincident} coincident): a surface needs at least three"
    )]
    TooFew {
        /// Number of usable points.
        usable: u64,
        /// Points with a coordinate that is not finite or is beyond 10⁹ m.
        not_finite: u64,
        /// Points with the same position and normal as another point.
        coincident: u64,
    },
    /// More points than 32-bit indices of all cell corners allow.
    #[error("{0} points, at most {MAX_POINTS}")]
    TooMany(usize),
    /// Different numbers of positions and of normals or colors.
    #[error("{positions} positions, but {others} {what}")]
    Lengths {
        /// Number of positions.
        positions: usize,
        /// Name of the array with another length.
        what: &'static str,
        /// Length of that array.
        others: usize,
    },
    /// All cells have zero area in single precision, because the points are too close together.
    #[error("the points are so close together that they have no area")]
    NoArea,
}

/// Numbers of points that were dropped or corrected when a cloud was built.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PointProblems {
    /// Points dropped because a coordinate was not finite or was beyond 10⁹ m.
    pub not_finite: u64,
    /// Points dropped because another point has the same position and a similar normal.
    pub coincident: u64,
    /// Points without a usable normal in a cloud that has normals. Their normals were estimated.
    pub normal_estimated: u64,
    /// Points dropped because neither the file nor their neighbors give them a normal.
    pub no_normal: u64,
    /// Points with a reflectance outside [0, 1]. It was clamped. NaN became 0.
    pub albedo_clamped: u64,
}

/// Points that represent a surface. All arrays have the same length.
#[derive(Clone, Debug, Default)]
pub struct PointCloud {
    /// Positions, meters.
    pub positions: Vec<Vec3>,
    /// Unit normals.
    pub normals: Vec<Vec3>,
    /// Diffuse reflectance, linear RGB in [0, 1].
    pub albedo: Vec<Vec3>,
    /// Surface area that each point represents, m².
    pub areas: Vec<f32>,
    /// `true` if the file had no normals.
    pub normals_estimated: bool,
    /// Numbers of points that were dropped or corrected.
    pub problems: PointProblems,
    /// Corners of all cells. Point i has the corners from `first[i]` to `first[i + 1]`.
    corners: Vec<Vec3>,
    first: Vec<u32>,
    lifts: Vec<f32>,
    spacings: Vec<f32>,
}

impl PointCloud {
    /// Creates a cloud from the points of a file. Removes invalid points, estimates missing normals
    /// and computes the surface area of each point. Points keep their order. If the file has no
    /// normals, a closed part of the surface around one of `viewpoints` (meters, between surfaces)
    /// faces inwards. Other parts face outwards, or toward the points of other parts inside them.
    /// Points without a color have an albedo of 0.5. The result is the same for any number of
    /// threads.
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

    /// Returns the number of points.
    #[must_use]
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Returns `true` if the cloud has no points. A cloud from [`Self::new`] is not empty.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Returns the corners of the flat convex cell of point `i`, in meters. The order is
    /// counter-clockwise seen from the side of its normal. The cell slightly overlaps the cells of
    /// its neighbors. Empty if the point represents no surface.
    #[must_use]
    pub fn outline(&self, i: usize) -> &[Vec3] {
        &self.corners[self.corners_of(i)]
    }

    /// Returns the approximate distance between point `i` and its neighbors in meters. 0 if the
    /// point represents no surface.
    #[must_use]
    pub fn spacing(&self, i: usize) -> f32 {
        self.spacings.get(i).copied().unwrap_or(0.0)
    }

    /// Returns a normal for each corner of each cell, in the order of the points and their
    /// [`outline`](Self::outline)s. It is the mean normal of the surrounding points on the same
    /// side of a crease. Cells that share a corner have nearly the same normal there, so that
    /// shading varies smoothly between cells.
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
                    .filter(|(normal, _)| normal.dot(own) > MIN_SURFACE_COSINE)
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

    /// Returns the range in [`corner_normals`](Self::corner_normals) of the corners of point `i`'s
    /// cell.
    #[must_use]
    pub fn corners_of(&self, i: usize) -> Range<usize> {
        match (self.first.get(i), self.first.get(i + 1)) {
            (Some(&from), Some(&to)) => from as usize..to as usize,
            _ => 0..0,
        }
    }

    /// Splits the points into spatially compact parts of at most `max` points (1 at least). Each
    /// part lists indices in ascending order.
    #[must_use]
    pub fn parts(&self, max: usize) -> Vec<Vec<u32>> {
        parts::parts(&self.positions, max)
    }

    /// Returns a box around the points.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        self.positions.iter().fold(Bounds::EMPTY, |b, x| b.join(*x))
    }

    /// Returns the cells as a triangle mesh for ray casts, and the point index of each triangle.
    /// Cells too small for single precision are left out.
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
        mesh.set_ray_offsets(self.lifts());
        (mesh, point_of)
    }

    /// Returns the ray offsets that exceed those of a mesh.
    fn lifts(&self) -> Option<RayOffsets> {
        let rough = |i: &usize| self.lifts[*i] > 1e-3 * self.spacings[*i];
        let rough: Vec<usize> = (0..self.len()).filter(rough).collect();
        let rough_positions: Vec<Vec3> = rough.iter().map(|&i| self.positions[i]).collect();
        let lifts = rough
            .iter()
            .map(|&i| [self.lifts[i], 2.0 * self.spacings[i]]);
        (!rough_positions.is_empty()).then(|| RayOffsets {
            tree: PointTree::new(&rough_positions),
            farthest: lifts.clone().map(|[_, reach]| reach).fold(0.0, f32::max),
            lifts: lifts.collect(),
        })
    }
}

/// Ray offsets of cells that do not lie in the planes of their neighbors.
#[derive(Clone, Debug)]
pub(super) struct RayOffsets {
    tree: PointTree,
    /// Ray offset and radius of influence of each point of the tree, meters.
    lifts: Vec<[f32; 2]>,
    /// Largest radius of influence, meters.
    farthest: f32,
}

impl RayOffsets {
    /// Returns the ray offset at `p` in meters. 0 if no rough cell is near.
    pub(super) fn at(&self, p: Vec3) -> f32 {
        let near = self.tree.nearest_within(p, self.farthest * self.farthest);
        near.map_or(0.0, |n| {
            let [lift, reach] = self.lifts[n.index as usize];
            if n.square <= reach * reach { lift } else { 0.0 }
        })
    }
}

/// Returns the triangles of a convex polygon.
fn fan(corners: &[Vec3]) -> impl Iterator<Item = [Vec3; 3]> + '_ {
    let others = corners.get(1..).unwrap_or_default();
    others.windows(2).map(|pair| [corners[0], pair[0], pair[1]])
}

/// Returns the indices of finite points in order. Of points with the same position and similar
/// normals only the first is kept.
fn usable(points: &PlyPoints, problems: &mut PointProblems) -> Vec<u32> {
    let fine = |x: &Vec3| x.is_finite() && x.abs().max_element() < MAX_COORDINATE;
    let mut order: Vec<u32> = (0..points.positions.len() as u32)
        .filter(|i| fine(&points.positions[*i as usize]))
        .collect();
    problems.not_finite = (points.positions.len() - order.len()) as u64;
    // Adding 0 turns -0.0 into +0.0.
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
    // At equal positions, points with a normal come first, so that these are kept.
    order.sort_unstable_by_key(|i| (key(*i), normal(*i) == Vec3::ZERO, *i));
    let mut kept = Vec::with_capacity(order.len());
    for cell in order.chunk_by(|a, b| key(*a) == key(*b)) {
        let start = kept.len();
        for &i in cell {
            let known = |k: &u32| {
                let (a, b) = (normal(*k), normal(i));
                a == Vec3::ZERO || b == Vec3::ZERO || a.dot(b) > MIN_SURFACE_COSINE
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

/// Returns the normal scaled to unit length, or zero if it has no direction.
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

/// Point cloud from a file.
#[derive(Debug)]
pub struct LoadedPoints {
    /// Point cloud.
    pub cloud: PointCloud,
    /// Notes on content that was ignored or converted.
    pub notes: Vec<String>,
}

/// Reads a `.ply` file as a cloud. See [`PointCloud::new`].
///
/// # Errors
/// [`SceneError::Io`] and [`SceneError::Refused`] if the file cannot be read, [`SceneError::Ply`]
/// and [`SceneError::Points`] if its content is not valid.
pub fn load_ply(path: impl AsRef<Path>, viewpoints: &[Vec3]) -> Result<LoadedPoints, SceneError> {
    load_ply_within(path, viewpoints, &mut InputBudget::default())
}

/// Reads a `.ply` file like [`load_ply`] within `budget`.
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

/// Reads the bytes of a `.ply` file like [`load_ply`]. `name` is the file name in errors.
///
/// # Errors
/// [`SceneError::Ply`] and [`SceneError::Points`] if the content is not valid.
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
        (faces, "faces were ignored: a .ply file is read as points"),
        (p.not_finite, "points that are not finite were left out"),
        (
            p.coincident,
            "points with the position of another point were left out",
        ),
        (p.no_normal, "points without a normal were left out"),
        (
            p.normal_estimated,
            "points without a normal use a normal from their neighbors",
        ),
        (
            p.albedo_clamped,
            "points with an albedo outside of 0 to 1 were clamped",
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
