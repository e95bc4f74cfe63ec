//! Occluders: doors and lifts that a game opens and closes. The rays of a bake pass through
//! occluders as if they were open and record the crossed ones. Only basis functions end at
//! occluders, as at walls. [`bake`](crate::bake) uses the geometry wrapper of this module.

use super::mesh::{FaceParts, is_usable};
use super::{
    Barrier, Bounds, Bvh, Emitters, Geometry, Hit, HitPoint, Material, MaterialFactors,
    MaterialTerms, Ray, Surface, TriangleMesh,
};
use glam::Vec3;

/// Part of a scene that can be opened and closed at run time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Occluder {
    /// Name.
    pub name: String,
    /// Corners of its triangles in the closed state, meters.
    pub triangles: Vec<[Vec3; 3]>,
    /// Boxes in the closed state.
    pub boxes: Vec<BoxPlanes>,
}

/// Planes that replace a box, because rendered geometry may lie anywhere inside it. They are the
/// middle plane across the thinnest edge and the planes of those of the four sides that no wall
/// adjoins. From one large side to the other they block as much as the box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoxPlanes {
    bounds: Bounds,
    /// Axis of the thinnest edge.
    axis: usize,
    /// `true` if the side has a plane.
    sides: [bool; 4],
}

/// Corners of the middle plane in half-lengths of the two other edges. Side k runs from corner k to
/// the next one.
const CORNERS: [(f32, f32); 4] = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
/// Number of rays that test for a wall along a side.
const RAYS_PER_SIDE: usize = 9;

impl BoxPlanes {
    /// Creates the planes of a box (meters) in the opening of `geometry`.
    #[must_use]
    pub fn new(bounds: Bounds, geometry: &dyn Geometry) -> Self {
        let size = bounds.size();
        let axis = (0..3).fold(0, |a, k| if size[k] < size[a] { k } else { a });
        let sides = [true; 4];
        let mut shutter = Self {
            bounds,
            axis,
            sides,
        };
        shutter.sides = std::array::from_fn(|k| !shutter.adjoins(geometry, k));
        shutter
    }

    /// Returns `true` if a wall adjoins the middle plane along the whole side.
    fn adjoins(&self, geometry: &dyn Geometry, side: usize) -> bool {
        let ((a, b), (c, d)) = (CORNERS[side], CORNERS[(side + 1) % 4]);
        let (from, to) = (self.corner(0.0, a, b), self.corner(0.0, c, d));
        let depth = 0.5 * (from + to) - self.bounds.center();
        let thickness = self.bounds.size()[self.axis];
        let way = depth.normalize_or_zero();
        let inset = thickness.min(0.5 * depth.length());
        (0..RAYS_PER_SIDE).all(|i| {
            let edge = from.lerp(to, (i as f32 + 0.5) / RAYS_PER_SIDE as f32);
            let ray = Ray::segment(edge - way * inset, way, inset + 0.25 * thickness);
            way != Vec3::ZERO && geometry.cast(&ray).is_some()
        })
    }

    fn corner(&self, w: f32, a: f32, b: f32) -> Vec3 {
        let mut at = Vec3::ZERO;
        at[self.axis] = w;
        at[(self.axis + 1) % 3] = a;
        at[(self.axis + 2) % 3] = b;
        self.bounds.center() + 0.5 * self.bounds.size() * at
    }

    /// Returns the triangles of the middle plane and then of the sides. The flag is `true` for a
    /// side.
    fn triangles(&self) -> Vec<([Vec3; 3], bool)> {
        let mut out = Vec::new();
        let mut quad = |[a, b, c, d]: [Vec3; 4], side| {
            let both = [[a, b, c], [a, c, d]].into_iter();
            out.extend(both.filter(is_usable).map(|t| (t, side)));
        };
        quad(CORNERS.map(|(a, b)| self.corner(0.0, a, b)), false);
        for k in (0..4).filter(|&k| self.sides[k]) {
            let ((a, b), (c, d)) = (CORNERS[k], CORNERS[(k + 1) % 4]);
            let at = [(-1.0, a, b), (-1.0, c, d), (1.0, c, d), (1.0, a, b)];
            quad(at.map(|(w, a, b)| self.corner(w, a, b)), true);
        }
        out
    }

    /// Returns the middle plane, facing `from`.
    fn barrier(&self, from: Vec3) -> Barrier {
        let position = self.bounds.center();
        let mut normal = Vec3::ZERO;
        normal[self.axis] = if from[self.axis] < position[self.axis] {
            -1.0
        } else {
            1.0
        };
        Barrier {
            normal,
            position,
            half_thickness: Some(0.5 * self.bounds.size()[self.axis]),
        }
    }

    fn contains(&self, x: Vec3) -> bool {
        x.cmpge(self.bounds.min).all() && x.cmple(self.bounds.max).all()
    }
}

impl Occluder {
    /// Returns the triangles that block light: its own, and the middle and side planes of each box.
    #[must_use]
    pub fn shapes(&self) -> Vec<[Vec3; 3]> {
        let boxes = self.boxes.iter().flat_map(BoxPlanes::triangles);
        let boxes = boxes.map(|(triangle, _)| triangle);
        self.triangles.iter().copied().chain(boxes).collect()
    }
}

/// Node of the file or entity of the world that is the source of triangles of a mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeshNode {
    /// Name. Empty if the file has none.
    pub name: String,
    /// Parent node, which has a lower index.
    pub parent: Option<u32>,
}

impl TriangleMesh {
    /// Splits off the triangles of the nodes with these names and of all nodes below them. Returns
    /// the remaining mesh, and one occluder per name. An occluder is empty if no node has its name.
    /// A triangle below several named nodes belongs to the nearest one.
    #[must_use]
    pub fn split_occluders(&self, names: &[&str]) -> (Self, Vec<Occluder>) {
        let mut out: Vec<Occluder> = (names.iter())
            .map(|&name| Occluder {
                name: name.into(),
                ..Occluder::default()
            })
            .collect();
        let (nodes, node_of) = self.nodes();
        // Parents come before their children.
        let mut owner: Vec<Option<usize>> = Vec::with_capacity(nodes.len());
        for node in nodes {
            let above = node.parent.and_then(|p| owner.get(p as usize).copied());
            let own = names.iter().position(|&name| name == node.name);
            owner.push(own.or(above.flatten()));
        }
        let owner_of = |i: usize| -> Option<usize> {
            let node = *node_of.get(i)?;
            owner.get(node as usize).copied().flatten()
        };
        for i in 0..self.len() {
            if let (Some(k), Some(corners)) = (owner_of(i), self.triangle(i)) {
                out[k].triangles.push(corners);
            }
        }
        let mesh = self.keep(|i| owner_of(i).is_none());
        (mesh, out)
    }
}

/// Geometry with open occluders that records the occluders that rays cross.
pub struct OccluderGeometry<'a> {
    closed: ClosedGeometry<'a>,
    bvh: Bvh,
}

/// Variant of the geometry with all occluders closed.
struct ClosedGeometry<'a> {
    open: &'a dyn Geometry,
    doors: TriangleMesh,
    /// Boxes. `occluder_of` has the box index of each triangle of `doors`, and `true` if the
    /// triangle is a side.
    shutters: Vec<BoxPlanes>,
    occluder_of: Vec<Option<(u32, bool)>>,
}

/// Flag bit of primitive indices of occluders. The scene has fewer triangles.
const OCCLUDER_FLAG: u32 = 1 << 31;

impl<'a> OccluderGeometry<'a> {
    /// Creates the geometry from `open`, which does not contain the occluders. Occluders beyond
    /// [`Bvh::MAX_OCCLUDERS`] are left out.
    #[must_use]
    pub fn new(open: &'a dyn Geometry, occluders: &[Occluder]) -> Self {
        let occluders = &occluders[..occluders.len().min(Bvh::MAX_OCCLUDERS)];
        let shapes: Vec<Vec<[Vec3; 3]>> = occluders.iter().map(Occluder::shapes).collect();
        let (mut all, mut occluder_of, mut shutters) = (Vec::new(), Vec::new(), Vec::new());
        for occluder in occluders {
            let own = occluder.triangles.iter().filter(|t| is_usable(t));
            all.extend(own.copied());
            occluder_of.resize(all.len(), None);
            for shutter in &occluder.boxes {
                let number = shutters.len() as u32;
                for (triangle, side) in shutter.triangles() {
                    all.push(triangle);
                    occluder_of.push(Some((number, side)));
                }
                shutters.push(*shutter);
            }
        }
        let material = Material {
            double_sided: true,
            ..Material::default()
        };
        Self {
            closed: ClosedGeometry {
                open,
                doors: TriangleMesh::new(all, vec![0; occluder_of.len()], vec![material]),
                shutters,
                occluder_of,
            },
            bvh: Bvh::default().with_occluders(&shapes),
        }
    }
}

impl ClosedGeometry<'_> {
    /// Returns the plane at which basis functions end at an occluder's `primitive`. It is the plane
    /// half-way between the two faces of the occluder, facing the ray's origin.
    fn door(&self, ray: &Ray, hit: &Hit) -> Barrier {
        let surface = self.doors.surface(ray, hit);
        let own = Barrier {
            normal: surface.normal,
            position: surface.position,
            half_thickness: None,
        };
        match self
            .occluder_of
            .get(hit.primitive as usize)
            .copied()
            .flatten()
        {
            Some((k, side)) => {
                let shutter = &self.shutters[k as usize];
                // Seen from inside the box, a side is the frame around the door.
                match side && shutter.contains(ray.origin) {
                    true => own,
                    false => shutter.barrier(ray.origin),
                }
            }
            None => {
                let start = surface.position - surface.normal * self.ray_offset(surface.position);
                let through = Ray::new(start, -surface.normal);
                let out = self.doors.cast(&through).filter(|_| surface.front);
                let out = out.filter(|out| !self.doors.surface(&through, out).front);
                let half = out.map_or(0.0, |out| 0.5 * out.t);
                Barrier {
                    position: surface.position - surface.normal * half,
                    half_thickness: Some(half),
                    ..own
                }
            }
        }
    }
}

impl Geometry for OccluderGeometry<'_> {
    fn bounds(&self) -> Bounds {
        self.closed.open.bounds()
    }

    fn cast(&self, ray: &Ray) -> Option<Hit> {
        self.closed.open.cast(ray)
    }

    fn is_occluded(&self, from: Vec3, to: Vec3) -> bool {
        self.closed.open.is_occluded(from, to)
    }

    fn surface(&self, ray: &Ray, hit: &Hit) -> Surface {
        self.closed.open.surface(ray, hit)
    }

    fn hit_point(&self, ray: &Ray, hit: &Hit) -> HitPoint {
        self.closed.open.hit_point(ray, hit)
    }

    fn material_terms(&self, ray: &Ray, hit: &Hit) -> Option<MaterialTerms> {
        self.closed.open.material_terms(ray, hit)
    }

    fn materials(&self) -> Vec<(String, MaterialFactors)> {
        self.closed.open.materials()
    }

    fn emitters(&self) -> Option<&Emitters> {
        self.closed.open.emitters()
    }

    fn crossed_occluders(&self, ray: &Ray) -> u64 {
        self.bvh.crossed_occluders(ray)
    }

    fn with_occluders_closed(&self) -> Option<&dyn Geometry> {
        Some(&self.closed)
    }

    fn ray_offset(&self, p: Vec3) -> f32 {
        self.closed.open.ray_offset(p)
    }

    fn surface_relief(&self, p: Vec3) -> f32 {
        self.closed.open.surface_relief(p)
    }
}

impl Geometry for ClosedGeometry<'_> {
    fn bounds(&self) -> Bounds {
        self.open.bounds()
    }

    fn cast(&self, ray: &Ray) -> Option<Hit> {
        let hit = self.open.cast(ray);
        let end = hit.map_or(ray.max_t, |hit| hit.t);
        let door = self.doors.cast(&Ray { max_t: end, ..*ray });
        let marked = |hit: Hit| Hit {
            primitive: hit.primitive | OCCLUDER_FLAG,
            ..hit
        };
        door.map(marked).or(hit)
    }

    fn is_occluded(&self, from: Vec3, to: Vec3) -> bool {
        self.open.is_occluded(from, to) || self.doors.is_occluded(from, to)
    }

    fn surface(&self, ray: &Ray, hit: &Hit) -> Surface {
        match hit.primitive & OCCLUDER_FLAG {
            0 => self.open.surface(ray, hit),
            _ => {
                let primitive = hit.primitive & !OCCLUDER_FLAG;
                self.doors.surface(ray, &Hit { primitive, ..*hit })
            }
        }
    }

    fn barrier(&self, ray: &Ray, hit: &Hit) -> Barrier {
        match hit.primitive & OCCLUDER_FLAG {
            0 => self.open.barrier(ray, hit),
            _ => {
                let primitive = hit.primitive & !OCCLUDER_FLAG;
                self.door(ray, &Hit { primitive, ..*hit })
            }
        }
    }

    fn ray_offset(&self, p: Vec3) -> f32 {
        self.open.ray_offset(p)
    }

    fn surface_relief(&self, p: Vec3) -> f32 {
        self.open.surface_relief(p)
    }
}

impl FaceParts {
    /// Returns the nodes, and the node of each triangle, with indices shifted by `first`: the
    /// number of nodes of earlier parts.
    pub(super) fn nodes_behind(&self, first: u32) -> (Vec<MeshNode>, Vec<u32>) {
        let nodes = self.nodes.iter().map(|node| MeshNode {
            name: node.name.clone(),
            parent: node.parent.map(|p| p + first),
        });
        // The triangles of a part without nodes have no node.
        let count = self.triangles.len();
        let own = (0..count).map(|i| {
            self.node_of
                .get(i)
                .map_or(u32::MAX, |n| n.saturating_add(first))
        });
        (nodes.collect(), own.collect())
    }
}

#[cfg(test)]
mod tests;
