//! Occluders: doors and lifts, which a game opens and shuts. The rays of a bake pass them as if they stood open, and say which they crossed; functions alone end at
//! them, as at walls. Serves [`bake`](crate::bake) with a geometry around the level's own.

use super::mesh::{FaceParts, is_usable};
use super::{
    Barrier, Bounds, Bvh, Coating, Geometry, Hit, Material, MaterialFactors, Ray, Site, Surface,
    TriangleMesh,
};
use glam::Vec3;

/// A part of a level that comes and goes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Occluder {
    /// What it is called.
    pub name: String,
    /// Corners of its triangles where it is shut, metres.
    pub triangles: Vec<[Vec3; 3]>,
    /// Boxes where it is shut, meters: what is drawn may lie anywhere inside.
    pub boxes: Vec<Bounds>,
}

/// What stands in the way of light in place of a box: its middle across the thinnest edge, and the four sides around. From one large side to the other it is as closed as the box, and
/// what lies inside is before one of them.
#[derive(Clone, Copy, Debug)]
struct Shutter {
    bounds: Bounds,
    /// The thinnest edge.
    axis: usize,
}

/// Triangles of a shutter: two in the middle, and two a side.
const SHUTTER: usize = 10;

impl Shutter {
    fn new(bounds: Bounds) -> Self {
        let size = bounds.size();
        let axis = (0..3).fold(0, |a, k| if size[k] < size[a] { k } else { a });
        Self { bounds, axis }
    }

    /// The middle first.
    fn triangles(&self) -> [[Vec3; 3]; SHUTTER] {
        let (center, half) = (self.bounds.center(), 0.5 * self.bounds.size());
        let (u, v) = ((self.axis + 1) % 3, (self.axis + 2) % 3);
        let corner = |w: f32, a: f32, b: f32| {
            let mut at = Vec3::ZERO;
            (at[self.axis], at[u], at[v]) = (w, a, b);
            center + half * at
        };
        let quad = |[a, b, c, d]: [Vec3; 4]| [[a, b, c], [a, c, d]];
        let middle = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
        let sides = (0..4).map(|k| {
            let ((a, b), (c, d)) = (middle[k], middle[(k + 1) % 4]);
            quad([
                corner(-1.0, a, b),
                corner(-1.0, c, d),
                corner(1.0, c, d),
                corner(1.0, a, b),
            ])
        });
        let all = std::iter::once(quad(middle.map(|(a, b)| corner(0.0, a, b)))).chain(sides);
        let mut out = [[Vec3::ZERO; 3]; SHUTTER];
        for (triangle, from) in out.iter_mut().zip(all.flatten()) {
            *triangle = from;
        }
        out
    }

    /// The plane of its middle, towards `from`.
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
    /// Triangles that stand in the way of light: its own, and for each box its middle and the sides around.
    #[must_use]
    pub fn shapes(&self) -> Vec<[Vec3; 3]> {
        let boxes = self.boxes.iter().map(|&b| Shutter::new(b));
        let boxes = boxes.flat_map(|s| s.triangles()).filter(is_usable);
        self.triangles.iter().copied().chain(boxes).collect()
    }
}

/// A node of the file, or an entity of the world, that triangles of a mesh came from.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeshNode {
    /// What it is called; empty where the file gives no name.
    pub name: String,
    /// The node above it, which has a lower index.
    pub parent: Option<u32>,
}

impl TriangleMesh {
    /// The mesh without what the nodes of these names and all below them hold, and that: one occluder a name, empty where no node is called so. A triangle below several
    /// of them belongs to the nearest.
    #[must_use]
    pub fn hold_out(&self, names: &[&str]) -> (Self, Vec<Occluder>) {
        let mut out: Vec<Occluder> = (names.iter())
            .map(|&name| Occluder {
                name: name.into(),
                ..Occluder::default()
            })
            .collect();
        let (nodes, node_of) = self.nodes();
        // Parents come first.
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

/// A geometry whose occluders stand open, and are known.
pub struct Doorways<'a> {
    shut: Shut<'a>,
    bvh: Bvh,
}

/// The same geometry with all of them shut.
struct Shut<'a> {
    open: &'a dyn Geometry,
    doors: TriangleMesh,
    /// The boxes, and for each of the doors' triangles the one that it is of, with whether it is a side.
    shutters: Vec<Shutter>,
    of: Vec<Option<(u32, bool)>>,
}

/// Marks hits of occluders among those of the level, which has fewer triangles.
const DOOR: u32 = 1 << 31;

impl<'a> Doorways<'a> {
    /// `open` without the occluders, and those; no more than [`Bvh::MOST_OCCLUDERS`], the others are left out.
    #[must_use]
    pub fn new(open: &'a dyn Geometry, occluders: &[Occluder]) -> Self {
        let occluders = &occluders[..occluders.len().min(Bvh::MOST_OCCLUDERS)];
        let shapes: Vec<Vec<[Vec3; 3]>> = occluders.iter().map(Occluder::shapes).collect();
        let (mut all, mut of, mut shutters) = (Vec::new(), Vec::new(), Vec::new());
        for occluder in occluders {
            let own = occluder.triangles.iter().filter(|t| is_usable(t));
            all.extend(own.copied());
            of.resize(all.len(), None);
            for &bounds in &occluder.boxes {
                let shutter = Shutter::new(bounds);
                let number = shutters.len() as u32;
                for (k, triangle) in shutter.triangles().into_iter().enumerate() {
                    if is_usable(&triangle) {
                        all.push(triangle);
                        of.push(Some((number, k >= 2)));
                    }
                }
                shutters.push(shutter);
            }
        }
        let material = Material {
            double_sided: true,
            ..Material::default()
        };
        Self {
            shut: Shut {
                open,
                doors: TriangleMesh::new(all, vec![0; of.len()], vec![material]),
                shutters,
                of,
            },
            bvh: Bvh::default().with_occluders(&shapes),
        }
    }
}

impl Shut<'_> {
    /// Where functions end at a door's `primitive`: at the middle between its two sides, as seen from the ray's start.
    fn door(&self, ray: &Ray, hit: &Hit) -> Barrier {
        let surface = self.doors.surface(ray, hit);
        let own = Barrier {
            normal: surface.normal,
            position: surface.position,
            half_thickness: None,
        };
        match self.of.get(hit.primitive as usize).copied().flatten() {
            Some((k, side)) => {
                let shutter = &self.shutters[k as usize];
                // From inside, a side is the frame beside the door.
                match side && shutter.contains(ray.origin) {
                    true => own,
                    false => shutter.barrier(ray.origin),
                }
            }
            None => {
                let start = surface.position - surface.normal * self.lift(surface.position);
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

impl Geometry for Doorways<'_> {
    fn bounds(&self) -> Bounds {
        self.shut.open.bounds()
    }

    fn cast(&self, ray: &Ray) -> Option<Hit> {
        self.shut.open.cast(ray)
    }

    fn occluded(&self, from: Vec3, to: Vec3) -> bool {
        self.shut.open.occluded(from, to)
    }

    fn surface(&self, ray: &Ray, hit: &Hit) -> Surface {
        self.shut.open.surface(ray, hit)
    }

    fn site(&self, ray: &Ray, hit: &Hit) -> Site {
        self.shut.open.site(ray, hit)
    }

    fn coating(&self, ray: &Ray, hit: &Hit) -> Option<Coating> {
        self.shut.open.coating(ray, hit)
    }

    fn materials(&self) -> Vec<(String, MaterialFactors)> {
        self.shut.open.materials()
    }

    fn crossed(&self, ray: &Ray) -> u64 {
        self.bvh.crossed(ray)
    }

    fn shut(&self) -> Option<&dyn Geometry> {
        Some(&self.shut)
    }

    fn lift(&self, p: Vec3) -> f32 {
        self.shut.open.lift(p)
    }

    fn roughness(&self, p: Vec3) -> f32 {
        self.shut.open.roughness(p)
    }
}

impl Geometry for Shut<'_> {
    fn bounds(&self) -> Bounds {
        self.open.bounds()
    }

    fn cast(&self, ray: &Ray) -> Option<Hit> {
        let hit = self.open.cast(ray);
        let end = hit.map_or(ray.max_t, |hit| hit.t);
        let door = self.doors.cast(&Ray { max_t: end, ..*ray });
        let marked = |hit: Hit| Hit {
            primitive: hit.primitive | DOOR,
            ..hit
        };
        door.map(marked).or(hit)
    }

    fn occluded(&self, from: Vec3, to: Vec3) -> bool {
        self.open.occluded(from, to) || self.doors.occluded(from, to)
    }

    fn surface(&self, ray: &Ray, hit: &Hit) -> Surface {
        match hit.primitive & DOOR {
            0 => self.open.surface(ray, hit),
            _ => {
                let primitive = hit.primitive & !DOOR;
                self.doors.surface(ray, &Hit { primitive, ..*hit })
            }
        }
    }

    fn barrier(&self, ray: &Ray, hit: &Hit) -> Barrier {
        match hit.primitive & DOOR {
            0 => self.open.barrier(ray, hit),
            _ => {
                let primitive = hit.primitive & !DOOR;
                self.door(ray, &Hit { primitive, ..*hit })
            }
        }
    }

    fn lift(&self, p: Vec3) -> f32 {
        self.open.lift(p)
    }

    fn roughness(&self, p: Vec3) -> f32 {
        self.open.roughness(p)
    }
}

impl FaceParts {
    /// Where each triangle's node is among those of several parts, of which `first` come from the parts before.
    pub(super) fn nodes_behind(&self, first: u32) -> (Vec<MeshNode>, Vec<u32>) {
        let nodes = self.nodes.iter().map(|node| MeshNode {
            name: node.name.clone(),
            parent: node.parent.map(|p| p + first),
        });
        // A part without nodes names none.
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
mod tests {
    use super::*;

    fn tile(z: f32) -> [Vec3; 3] {
        let at = |x, y| Vec3::new(x, y, z);
        [at(-3.0, -1.0), at(3.0, -1.0), at(0.0, 4.0)]
    }

    fn node(name: &str, parent: Option<u32>) -> MeshNode {
        MeshNode {
            name: name.into(),
            parent,
        }
    }

    /// Four tiles, of which two are below a node "door".
    fn level() -> TriangleMesh {
        let tiles = vec![tile(0.0), tile(1.0), tile(2.0), tile(3.0)];
        let mut mesh = TriangleMesh::new(tiles, vec![0; 4], vec![Material::default()]);
        let nodes = ["", "room", "door", "handle", "back"];
        let parents = [None, Some(0), Some(0), Some(2), None];
        let nodes = nodes.iter().zip(parents).map(|(name, p)| node(name, p));
        mesh.set_nodes(nodes.collect(), vec![1, 2, 3, 4]);
        mesh
    }

    #[test]
    fn a_node_is_held_out_with_all_below_it() {
        let (rest, held) = level().hold_out(&["lift", "door"]);
        assert_eq!(rest.len(), 2);
        assert_eq!(
            [rest.triangle(0), rest.triangle(1)],
            [Some(tile(0.0)), Some(tile(3.0))]
        );
        assert!(held[0].triangles.is_empty());
        assert_eq!(held[1].triangles, [tile(1.0), tile(2.0)]);
        // What is left still knows its nodes; joined with another, too.
        let (none, held) = rest.hold_out(&["back"]);
        assert_eq!((none.len(), held[0].triangles.len()), (1, 1));
        let (rest, held) = TriangleMesh::joined(vec![none, level()]).hold_out(&["room", "handle"]);
        assert_eq!(rest.len(), 2);
        assert_eq!([held[0].triangles.len(), held[1].triangles.len()], [2, 1]);
    }

    #[test]
    fn open_for_rays_and_shut_for_those_who_ask() {
        let (rest, held) = level().hold_out(&["door"]);
        let doorways = Doorways::new(&rest, &held);
        let ray = Ray::new(Vec3::new(0.0, 0.0, 2.5), Vec3::NEG_Z);
        let hit = doorways.cast(&ray).unwrap();
        assert_eq!(hit.t, 2.5);
        assert_eq!(
            doorways.crossed(&Ray::segment(ray.origin, ray.direction, hit.t)),
            1
        );
        assert_eq!(
            doorways.crossed(&Ray::segment(ray.origin, ray.direction, 0.4)),
            0
        );
        let shut = doorways.shut().unwrap();
        let hit = shut.cast(&ray).unwrap();
        assert_eq!(hit.t, 0.5);
        assert_eq!(shut.surface(&ray, &hit).normal, Vec3::Z);
        assert!(shut.occluded(ray.origin, Vec3::new(0.0, 0.0, 1.5)));
        assert!(!doorways.occluded(ray.origin, Vec3::new(0.0, 0.0, 1.5)));
        assert!(rest.shut().is_none());
    }
}
