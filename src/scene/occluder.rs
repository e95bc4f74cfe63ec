//! Occluders: doors and lifts, which a game opens and shuts. The rays of a bake pass them as if they stood open, and say which they crossed; functions alone end at
//! them, as at walls. Serves [`bake`](crate::bake) with a geometry around the level's own.

use super::mesh::FaceParts;
use super::{
    Bounds, Bvh, Coating, Geometry, Hit, Material, MaterialFactors, Ray, Site, Surface,
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
                triangles: Vec::new(),
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
}

/// Marks hits of occluders among those of the level, which has fewer triangles.
const DOOR: u32 = 1 << 31;

impl<'a> Doorways<'a> {
    /// `open` without the occluders, and those; no more than [`Bvh::MOST_OCCLUDERS`], the others are left out.
    #[must_use]
    pub fn new(open: &'a dyn Geometry, occluders: &[Occluder]) -> Self {
        let occluders = &occluders[..occluders.len().min(Bvh::MOST_OCCLUDERS)];
        let shapes: Vec<Vec<[Vec3; 3]>> = occluders.iter().map(|o| o.triangles.clone()).collect();
        let all: Vec<[Vec3; 3]> = shapes.iter().flatten().copied().collect();
        let material_of = vec![0; all.len()];
        let material = Material {
            double_sided: true,
            ..Material::default()
        };
        Self {
            shut: Shut {
                open,
                doors: TriangleMesh::new(all, material_of, vec![material]),
            },
            bvh: Bvh::default().with_occluders(&shapes),
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
