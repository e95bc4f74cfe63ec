//! A static room, a moving object in it, and the reflective shadow map of the object from a light.

use glam::{Mat4, Vec2, Vec3};
use meshless_gi::internals::eval::irradiance_at_all;
use meshless_gi::internals::frame::rsm_layout::space_from_clip;
use meshless_gi::internals::frame::{
    RsmParams, RsmSelectParams, RsmShadowParams, RsmTexel, Vpl, VplParams, project, rsm, vpl,
};
use meshless_gi::internals::samples::Random;
use meshless_gi::{Bvh, FrameLight, Irradiance, Light, Material, ReferenceSettings, TriangleMesh};
use meshless_gi_lab::accuracy::RaycastView;

pub type Triangles = Vec<[Vec3; 3]>;

pub const ORANGE: Vec3 = Vec3::new(0.8, 0.3, 0.1);

/// Returns a box from corner to corner. Its faces point inward if `inwards`.
pub fn cuboid(min: Vec3, max: Vec3, inwards: bool) -> Triangles {
    let mut out = Vec::new();
    for axis in 0..3 {
        for side in [0.0, 1.0] {
            let corner = |u: f32, v: f32| {
                let t = match axis {
                    0 => Vec3::new(side, u, v),
                    1 => Vec3::new(v, side, u),
                    _ => Vec3::new(u, v, side),
                };
                min + (max - min) * t
            };
            let [a, b, c, d] = [
                corner(0., 0.),
                corner(1., 0.),
                corner(1., 1.),
                corner(0., 1.),
            ];
            match (side > 0.5) != inwards {
                true => out.extend([[a, b, c], [a, c, d]]),
                false => out.extend([[a, c, b], [a, d, c]]),
            }
        }
    }
    out
}

/// Returns a sphere of triangles.
pub fn ball(center: Vec3, radius: f32) -> Triangles {
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    let mut out = Vec::new();
    for (a, b, c) in [(x, y, z), (y, -x, z), (-x, -y, z), (-y, x, z)] {
        out.push([a, b, c]);
        out.push([b, a, -c]);
    }
    for _ in 0..4 {
        out = out
            .into_iter()
            .flat_map(|[a, b, c]: [Vec3; 3]| {
                let middle = |p: Vec3, q: Vec3| (p + q).normalize();
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    out.into_iter()
        .map(|t| t.map(|p| center + radius * p))
        .collect()
}

pub fn mesh(triangles: Triangles, albedo: Vec3) -> TriangleMesh {
    let material_of = vec![0; triangles.len()];
    TriangleMesh::new(triangles, material_of, vec![Material::diffuse(albedo)])
}

/// View of a light: a camera at the light, or a parallel projection.
#[derive(Clone, Copy)]
pub struct MapCamera {
    pub world_from_view: Mat4,
    pub clip_from_view: Mat4,
}

impl MapCamera {
    /// Creates the view of a light, `angle` wide.
    pub fn light_source(eye: Vec3, target: Vec3, angle: f32) -> Self {
        let up = (target - eye).normalize().any_orthonormal_vector();
        Self {
            world_from_view: Mat4::look_at_rh(eye, target, up).inverse(),
            clip_from_view: Mat4::perspective_infinite_reverse_rh(angle, 1.0, 0.05),
        }
    }

    /// Creates a parallel projection, `width` meters wide.
    pub fn parallel(eye: Vec3, target: Vec3, width: f32) -> Self {
        let up = (target - eye).normalize().any_orthonormal_vector();
        let h = 0.5 * width;
        Self {
            world_from_view: Mat4::look_at_rh(eye, target, up).inverse(),
            clip_from_view: Mat4::orthographic_rh(-h, h, -h, h, 100.0, 0.0),
        }
    }

    pub fn draw(&self, object: &TriangleMesh, side: u32) -> RaycastView {
        let clip_from_world = self.clip_from_view * self.world_from_view.inverse();
        RaycastView::new(object, clip_from_world, [side; 2])
    }

    pub fn params(&self, light: &FrameLight, side: u32) -> RsmParams {
        let m = space_from_clip(&self.world_from_view, &self.clip_from_view, Vec3::ZERO);
        RsmParams::new(m, light, side, 0)
    }
}

/// Static walls, an object, one light.
pub struct Room {
    pub walls: TriangleMesh,
    pub bvh: Bvh,
    pub object: Triangles,
    pub color: Vec3,
    pub light: Light,
    pub camera: MapCamera,
    /// Positions on the walls, meters, and their normals.
    pub positions: Vec<(Vec3, Vec3)>,
}

impl Room {
    pub fn new(walls: Triangles, object: Triangles, light: Light, camera: MapCamera) -> Self {
        let positions = positions_on(&walls, 240);
        let walls = mesh(walls, Vec3::ZERO);
        Self {
            bvh: walls.bvh(),
            walls,
            object,
            color: ORANGE,
            light,
            camera,
            positions,
        }
    }

    pub fn slot(&self) -> FrameLight {
        FrameLight::expand(&self.light, 1)[0]
    }

    /// Returns the reference with one reflection at the object alone: the walls are black.
    pub fn truth(&self, paths: u32) -> Vec<Irradiance> {
        let mut triangles: Triangles = (0..self.walls.len())
            .filter_map(|i| self.walls.triangle(i))
            .collect();
        let mut material_of = vec![0; triangles.len()];
        triangles.extend(&self.object);
        material_of.resize(triangles.len(), 1);
        let materials = [Vec3::ZERO, self.color].map(Material::diffuse).to_vec();
        let all = TriangleMesh::new(triangles, material_of, materials);
        let settings = ReferenceSettings {
            paths,
            bounces: Some(1),
            seed: 7,
        };
        irradiance_at_all(&all, &[self.light], &self.positions, &settings)
    }

    pub fn extent(&self) -> f32 {
        let [min, max] = self
            .positions
            .iter()
            .fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |b, p| {
                [b[0].min(p.0), b[1].max(p.0)]
            });
        (max - min).max_element()
    }

    /// Returns the lit texels of a map, with the walls' shadows on them.
    pub fn texels(&self, side: u32) -> Vec<RsmTexel> {
        let light = self.slot();
        let drawn = self
            .camera
            .draw(&mesh(self.object.clone(), self.color), side);
        let params = self.camera.params(&light, side);
        let mut texels = rsm::texels(&params, &drawn.depth, &drawn.gbuffer);
        let nodes = self.bvh.nodes.len() as u32;
        let shade = RsmShadowParams::new(Mat4::IDENTITY, &light, side * side, nodes, self.extent());
        rsm::shadow(&shade, &self.bvh, &mut texels);
        texels
    }

    /// Returns virtual point lights from a map.
    pub fn lights(&self, side: u32, vpls: u32) -> Vec<Vpl> {
        select_vpls(&self.texels(side), vpls)
    }

    /// Returns the light of `lights` at the positions.
    pub fn light_of(&self, lights: &[Vpl], visibility: bool) -> Vec<Vec3> {
        let count = lights.len() as u32;
        let params = match visibility {
            true => VplParams::shadowed(
                count,
                Mat4::IDENTITY,
                self.bvh.nodes.len() as u32,
                self.extent(),
                0.0,
            ),
            false => VplParams::unshadowed(count),
        };
        self.positions
            .iter()
            .map(|&(x, n)| vpl::vpl_at(&params, lights, &self.bvh, x, n).dot(n))
            .collect()
    }
}

pub fn select_vpls(texels: &[RsmTexel], vpls: u32) -> Vec<Vpl> {
    let params = RsmSelectParams {
        texels: texels.len() as u32,
        vpls,
        ..RsmSelectParams::default()
    };
    rsm::select_vpls(&params, texels)
}

/// Returns positions on triangles with equal density, slightly above the surface.
fn positions_on(triangles: &Triangles, count: usize) -> Vec<(Vec3, Vec3)> {
    let area = |t: &[Vec3; 3]| 0.5 * (t[1] - t[0]).cross(t[2] - t[0]).length();
    let all: f32 = triangles.iter().map(area).sum();
    let mut random = Random::new(3, 1, 0);
    (0..count)
        .map(|i| {
            let mut at = (i as f32 + random.unit()) / count as f32 * all;
            let mut chosen = triangles[triangles.len() - 1];
            for t in triangles {
                if at < area(t) {
                    chosen = *t;
                    break;
                }
                at -= area(t);
            }
            let mut uv = Vec2::new(random.unit(), random.unit());
            if uv.x + uv.y > 1.0 {
                uv = Vec2::ONE - uv;
            }
            let [a, b, c] = chosen;
            let n = (b - a).cross(c - a).normalize();
            let x = a + (b - a) * uv.x + (c - a) * uv.y;
            (x + n * project::ray_offset(x, 4.0), n)
        })
        .collect()
}

/// \[N09\]'s own sampling, for comparison: a fixed grid of texels, all with the same solid angle
/// (or cross-section). r² is at least a constant.
pub struct Grid {
    pub lights: Vec<Vpl>,
    pub min: f32,
}

impl Grid {
    /// Creates a grid of `count`² of the map's texels.
    pub fn new(room: &Room, side: u32, count: u32) -> Self {
        let light = room.slot();
        let params = room.camera.params(&light, side);
        // Its map holds the walls too: they shadow it.
        let texels = room.texels(side);
        let angle = |x: u32, y: u32| {
            // The flux over ρ I is the solid angle: that of a white patch in front of a light of
            // one.
            let white = meshless_gi::internals::frame::gbuffer::pack(
                Vec3::ONE,
                0.0,
                1.0,
                Vec3::from_array(params.forward) * -1.0,
                0,
            );
            let one = RsmParams {
                light: FrameLight::point(
                    Vec3::from_array(light.position),
                    Vec3::ONE,
                    f32::INFINITY,
                ),
                ..params
            };
            rsm::texel(&one, [x, y], 0.01, white).flux[0]
        };
        let texel_count = (side * side) as f32;
        let mean = (0..side * side)
            .map(|i| angle(i % side, i / side))
            .sum::<f32>()
            / texel_count;
        let lights = (0..count * count)
            .filter_map(|i| {
                let step = side / count;
                let (x, y) = (i % count * step + step / 2, i / count * step + step / 2);
                let t = &texels[rsm::hilbert_index(side, x, y) as usize];
                let same = match light.kind {
                    FrameLight::DIRECTIONAL => 1.0,
                    _ => mean / angle(x, y),
                };
                let each = texel_count / (count * count) as f32;
                let flux = Vec3::from_array(t.flux) * (same * each);
                (flux != Vec3::ZERO).then_some(Vpl {
                    position: t.position,
                    normal: t.normal,
                    flux: flux.to_array(),
                    ..Vpl::default()
                })
            })
            .collect();
        Self { lights, min: 0.01 }
    }

    pub fn light_at(&self, x: Vec3, n: Vec3) -> Vec3 {
        let one = |l: &Vpl| -> Vec3 {
            let square = (Vec3::from_array(l.position) - x).length_squared();
            Vec3::from_array(l.flux)
                * vpl::vpl_contribution(l, x, n).dot(n)
                * (square / square.max(self.min))
        };
        self.lights.iter().map(one).sum()
    }
}
