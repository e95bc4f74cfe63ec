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

/// Returns four tiles, of which two are below a node "door".
fn mesh_with_nodes() -> TriangleMesh {
    let tiles = vec![tile(0.0), tile(1.0), tile(2.0), tile(3.0)];
    let mut mesh = TriangleMesh::new(tiles, vec![0; 4], vec![Material::default()]);
    let nodes = ["", "room", "door", "handle", "back"];
    let parents = [None, Some(0), Some(0), Some(2), None];
    let nodes = nodes.iter().zip(parents).map(|(name, p)| node(name, p));
    mesh.set_nodes(nodes.collect(), vec![1, 2, 3, 4]);
    mesh
}

#[test]
fn split_occluders_takes_node_with_descendants() {
    let (rest, held) = mesh_with_nodes().split_occluders(&["lift", "door"]);
    assert_eq!(rest.len(), 2);
    assert_eq!(
        [rest.triangle(0), rest.triangle(1)],
        [Some(tile(0.0)), Some(tile(3.0))]
    );
    assert!(held[0].triangles.is_empty());
    assert_eq!(held[1].triangles, [tile(1.0), tile(2.0)]);
    // The remaining mesh keeps its nodes, also after a join with another mesh.
    let (none, held) = rest.split_occluders(&["back"]);
    assert_eq!((none.len(), held[0].triangles.len()), (1, 1));
    let (rest, held) =
        TriangleMesh::joined(vec![none, mesh_with_nodes()]).split_occluders(&["room", "handle"]);
    assert_eq!(rest.len(), 2);
    assert_eq!([held[0].triangles.len(), held[1].triangles.len()], [2, 1]);
}

#[test]
fn occluder_geometry_is_open_to_rays_and_closed_on_request() {
    let (rest, held) = mesh_with_nodes().split_occluders(&["door"]);
    let doorways = OccluderGeometry::new(&rest, &held);
    let ray = Ray::new(Vec3::new(0.0, 0.0, 2.5), Vec3::NEG_Z);
    let hit = doorways.cast(&ray).unwrap();
    assert_eq!(hit.t, 2.5);
    assert_eq!(
        doorways.crossed_occluders(&Ray::segment(ray.origin, ray.direction, hit.t)),
        1
    );
    assert_eq!(
        doorways.crossed_occluders(&Ray::segment(ray.origin, ray.direction, 0.4)),
        0
    );
    let shut = doorways.with_occluders_closed().unwrap();
    let hit = shut.cast(&ray).unwrap();
    assert_eq!(hit.t, 0.5);
    assert_eq!(shut.surface(&ray, &hit).normal, Vec3::Z);
    assert!(shut.is_occluded(ray.origin, Vec3::new(0.0, 0.0, 1.5)));
    assert!(!doorways.is_occluded(ray.origin, Vec3::new(0.0, 0.0, 1.5)));
    assert!(rest.with_occluders_closed().is_none());
}

/// A box in a frame blocks at its middle plane. Without surrounding geometry its sides block too.
/// In both cases rays that cross the box cross the occluder.
#[test]
fn occluder_box_blocks_at_middle_and_free_sides() {
    let bounds = Bounds {
        min: Vec3::new(-0.5, 0.0, -0.1),
        max: Vec3::new(0.5, 2.0, 0.1),
    };
    let none = TriangleMesh::new(Vec::new(), Vec::new(), Vec::new());
    let free = BoxPlanes::new(bounds, &none);
    assert_eq!((free.axis, free.sides), (2, [true; 4]));
    // Floor below the box.
    let at = |x, z| Vec3::new(x, 0.0, z);
    let floor = [at(-9.0, -9.0), at(9.0, -9.0), at(0.0, 20.0)];
    let floor = TriangleMesh::new(vec![floor], vec![0], vec![Material::default()]);
    let stands = BoxPlanes::new(bounds, &floor);
    assert_eq!(stands.sides.iter().filter(|s| **s).count(), 3);
    for (shutter, triangles) in [(free, 10), (stands, 8)] {
        let occluder = Occluder {
            boxes: vec![shutter],
            ..Occluder::default()
        };
        assert_eq!(occluder.shapes().len(), triangles);
        let doorways = OccluderGeometry::new(&none, &[occluder]);
        let through = |x: f32, from: f32, to: f32| {
            let start = Vec3::new(x, 1.0, from);
            doorways.crossed_occluders(&Ray::segment(start, Vec3::Z, to - from))
        };
        assert_eq!(through(0.3, -1.0, 1.0), 1);
        assert_eq!(through(0.6, -1.0, 1.0), 0);
        // A segment that ends in the nearer half of the box crosses nothing. A segment that ends in
        // the farther half crosses the occluder.
        assert_eq!(
            (through(0.3, -1.0, -0.05), through(0.3, -1.0, 0.05)),
            (0, 1)
        );
        let ray = Ray::new(Vec3::new(0.3, 1.0, -1.0), Vec3::Z);
        let shut = doorways.with_occluders_closed().unwrap();
        let barrier = shut.barrier(&ray, &shut.cast(&ray).unwrap());
        assert_eq!((barrier.normal, barrier.position.z), (Vec3::NEG_Z, 0.0));
        assert!((barrier.half_thickness.unwrap() - 0.1).abs() < 1e-6);
    }
}

#[test]
fn occluder_thickness_is_measured_behind_front() {
    let back = |z: f32| {
        let [a, b, c] = tile(z);
        [a, c, b]
    };
    let thick = vec![tile(1.0), back(0.8)];
    let occluder = |triangles| Occluder {
        triangles,
        ..Occluder::default()
    };
    let none = TriangleMesh::new(Vec::new(), Vec::new(), Vec::new());
    let ray = Ray::new(Vec3::new(0.0, 0.0, 2.0), Vec3::NEG_Z);
    for (triangles, half) in [(thick, 0.1), (vec![tile(1.0)], 0.0)] {
        let doorways = OccluderGeometry::new(&none, &[occluder(triangles)]);
        let shut = doorways.with_occluders_closed().unwrap();
        let barrier = shut.barrier(&ray, &shut.cast(&ray).unwrap());
        let found = barrier.half_thickness.unwrap();
        assert!((found - half).abs() < 1e-3, "{found}");
        assert!((barrier.position.z - (1.0 - half)).abs() < 1e-3);
    }
}
