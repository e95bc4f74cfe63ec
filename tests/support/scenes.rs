//! Small room in three forms: Bevy meshes, geometry to bake, and a picture drawn by the CPU.

use super::app::{HEIGHT, WIDTH};
use super::flip::Picture;
use bevy::asset::RenderAssetUsages;
use bevy::mesh::{Indices, PrimitiveTopology};
use bevy::prelude::*;
use meshless_gi::internals::frame::splat::{FULL_COVER, splat_covered, surface_fraction};
use meshless_gi::{
    BakedScene, Bounds, CpuFrame, FrameLight, FrameSettings, Geometry, Hit, Light, Material,
    Progress, Ray, Recipe, Surface, TriangleMesh, bake_scene,
};
use std::sync::{Arc, OnceLock};

/// Parallelogram: a corner and its two edges. It faces `u × v`.
#[derive(Clone, Copy)]
pub struct Quad {
    pub corner: Vec3,
    pub u: Vec3,
    pub v: Vec3,
    pub color: Vec3,
}

/// Parallelograms that reflect on both sides.
#[derive(Clone)]
pub struct Room(pub Vec<Quad>);

const WHITE: Vec3 = Vec3::new(0.7, 0.7, 0.7);

/// Returns a coarse recipe for rooms as small as [`Room::cornell`]. Tests compare two executors of
/// one bake, not the bake with the reference.
pub fn rough_recipe() -> Recipe {
    Recipe {
        viewpoints: vec![[0.0, 1.0, 0.6]],
        coarse_radius: Some(0.6),
        levels: Some(3),
        sender_levels: Some(2),
        max_refinement_points: Some(1000),
        rays_per_point: Some(128),
        ..Recipe::default()
    }
}

impl Room {
    /// Creates a room 2 m wide, open toward +Z, with a red wall, a green wall, and a block.
    pub fn cornell() -> Self {
        let quad = |corner, u, v, color| Quad {
            corner,
            u,
            v,
            color,
        };
        let v = Vec3::new;
        let (x, y, z) = (Vec3::X * 2.0, Vec3::Y * 2.0, Vec3::Z * 2.0);
        let low = v(-1.0, 0.0, -1.0);
        let mut quads = vec![
            quad(low, z, x, WHITE),
            quad(low + y, x, z, WHITE),
            quad(low, x, y, WHITE),
            quad(low, y, z, v(0.65, 0.05, 0.05)),
            quad(low + x, z, y, v(0.1, 0.5, 0.1)),
        ];
        let turn = Quat::from_rotation_y(0.4);
        let (a, b, up) = (
            turn * v(0.6, 0.0, 0.0),
            turn * v(0.0, 0.0, 0.6),
            v(0.0, 0.9, 0.0),
        );
        let foot = v(0.25, 0.0, 0.0) - 0.5 * (a + b);
        quads.extend([
            quad(foot, up, a, WHITE),
            quad(foot, b, up, WHITE),
            quad(foot + b, a, up, WHITE),
            quad(foot + a, up, b, WHITE),
            quad(foot + up, b, a, WHITE),
        ]);
        Self(quads)
    }

    /// Creates a gray wall of 2 m × 2 m in the plane z = 0 that faces +Z.
    pub fn wall(albedo: f32) -> Self {
        Self(vec![Quad {
            corner: Vec3::new(-1.0, -1.0, 0.0),
            u: Vec3::X * 2.0,
            v: Vec3::Y * 2.0,
            color: Vec3::splat(albedo),
        }])
    }

    /// Returns the room with other colors.
    pub fn recolored(&self, color: impl Fn(Vec3) -> Vec3) -> Self {
        Self(
            self.0
                .iter()
                .map(|q| Quad {
                    color: color(q.color),
                    ..*q
                })
                .collect(),
        )
    }

    /// Returns the room as a bake reads it: two triangles and one material per quad.
    pub fn mesh(&self) -> TriangleMesh {
        let halves = |q: &Quad| {
            let [a, b, c, d] = [
                q.corner,
                q.corner + q.u,
                q.corner + q.u + q.v,
                q.corner + q.v,
            ];
            [[a, b, c], [a, c, d]]
        };
        let material = |(k, q): (usize, &Quad)| Material {
            name: format!("quad {k}"),
            ..Material::diffuse(q.color)
        };
        TriangleMesh::new(
            self.0.iter().flat_map(halves).collect(),
            (0..2 * self.0.len() as u32).map(|i| i / 2).collect(),
            self.0.iter().enumerate().map(material).collect(),
        )
    }

    /// Bakes the room by [`rough_recipe`].
    pub fn bake(&self, seed: u64) -> Arc<BakedScene> {
        self.bake_as(&Recipe {
            seed,
            ..rough_recipe()
        })
    }

    /// Bakes the room by a recipe.
    pub fn bake_as(&self, recipe: &Recipe) -> Arc<BakedScene> {
        let baked = bake_scene(&self.mesh(), recipe, 0, &Progress::default());
        Arc::new(baked.expect("the room bakes").scene)
    }

    /// Spawns the room's surfaces below `root`, with roughness 1 and without specular reflection.
    pub fn spawn(&self, app: &mut App, root: Entity) {
        for quad in &self.0 {
            let n = quad.u.cross(quad.v).normalize().to_array();
            let [a, b, c, d] = [
                quad.corner,
                quad.corner + quad.u,
                quad.corner + quad.u + quad.v,
                quad.corner + quad.v,
            ];
            let mesh = Mesh::new(
                PrimitiveTopology::TriangleList,
                RenderAssetUsages::default(),
            )
            .with_inserted_attribute(
                Mesh::ATTRIBUTE_POSITION,
                [a, b, c, d].map(|p| p.to_array()).to_vec(),
            )
            .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, vec![n; 4])
            .with_inserted_indices(Indices::U32(vec![0, 1, 2, 0, 2, 3]));
            let mesh = app.world_mut().resource_mut::<Assets<Mesh>>().add(mesh);
            let material = app
                .world_mut()
                .resource_mut::<Assets<StandardMaterial>>()
                .add(StandardMaterial {
                    base_color: Color::linear_rgb(quad.color.x, quad.color.y, quad.color.z),
                    perceptual_roughness: 1.0,
                    reflectance: 0.0,
                    ..default()
                });
            app.world_mut()
                .spawn((Mesh3d(mesh), MeshMaterial3d(material), ChildOf(root)));
        }
    }
}

/// Returns the Cornell room and its bake. Each test binary bakes it once.
pub fn cornell() -> (Room, Arc<BakedScene>) {
    static BAKED: OnceLock<Arc<BakedScene>> = OnceLock::new();
    let room = Room::cornell();
    let baked = BAKED.get_or_init(|| room.bake(1)).clone();
    (room, baked)
}

impl Geometry for Room {
    fn bounds(&self) -> Bounds {
        let corners = |q: &Quad| {
            [
                q.corner,
                q.corner + q.u,
                q.corner + q.v,
                q.corner + q.u + q.v,
            ]
        };
        self.0
            .iter()
            .flat_map(corners)
            .fold(Bounds::EMPTY, Bounds::join)
    }

    fn cast(&self, ray: &Ray) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        for (i, q) in self.0.iter().enumerate() {
            let n = q.u.cross(q.v);
            let along = ray.direction.dot(n);
            if along == 0.0 {
                continue;
            }
            let t = (q.corner - ray.origin).dot(n) / along;
            let at = ray.at(t) - q.corner;
            let uv = [
                at.dot(q.u) / q.u.length_squared(),
                at.dot(q.v) / q.v.length_squared(),
            ];
            let inside = uv.iter().all(|c| (0.0..=1.0).contains(c));
            if t > 0.0 && t < ray.max_t && inside && best.is_none_or(|b| t < b.t) {
                best = Some(Hit {
                    t,
                    primitive: i as u32,
                    uv,
                });
            }
        }
        best
    }

    fn is_occluded(&self, from: Vec3, to: Vec3) -> bool {
        let offset = to - from;
        self.cast(&Ray::segment(from, offset.normalize(), offset.length()))
            .is_some()
    }

    fn surface(&self, ray: &Ray, hit: &Hit) -> Surface {
        let q = &self.0[hit.primitive as usize];
        let n = q.u.cross(q.v).normalize();
        let front = ray.direction.dot(n) < 0.0;
        Surface {
            position: q.corner + q.u * hit.uv[0] + q.v * hit.uv[1],
            normal: if front { n } else { -n },
            albedo: q.color,
            emission: Vec3::ZERO,
            front,
        }
    }
}

/// Returns Bevy's default exposure, EV100 9.7.
pub fn exposure() -> f32 {
    (-9.7f32).exp2() / 1.2
}

/// Draws indirect light only. `camera` and `lights` are in world space. The room and its bake are
/// below `root`.
pub fn cpu_indirect(
    room: &Room,
    bake: &BakedScene,
    root: Transform,
    camera: Transform,
    lights: &[Light],
    settings: &FrameSettings,
) -> Picture {
    cpu_indirect_sized(room, bake, root, camera, lights, settings, [WIDTH, HEIGHT])
}

/// Draws the picture of [`cpu_indirect`] in another size.
pub fn cpu_indirect_sized(
    room: &Room,
    bake: &BakedScene,
    root: Transform,
    camera: Transform,
    lights: &[Light],
    settings: &FrameSettings,
    size: [u32; 2],
) -> Picture {
    let plain = |_: &Quad, surface: Surface| surface;
    cpu_indirect_textured(room, bake, [root, camera], lights, settings, size, plain)
}

/// Draws the picture of [`cpu_indirect_sized`] with surfaces modified by textures.
pub fn cpu_indirect_textured(
    room: &Room,
    bake: &BakedScene,
    [root, camera]: [Transform; 2],
    lights: &[Light],
    settings: &FrameSettings,
    [wide, high]: [u32; 2],
    textured: impl Fn(&Quad, Surface) -> Surface,
) -> Picture {
    let local_from_world = root.to_matrix().inverse();
    let lights: Vec<FrameLight> = lights
        .iter()
        .flat_map(|l| FrameLight::expand(l, 16))
        .map(|l| l.to_local(&local_from_world))
        .collect();
    let mut frame = CpuFrame::new(bake);
    frame.set_lights(bake, &lights);
    frame.solve(bake, settings);
    let half_height = (std::f32::consts::FRAC_PI_4 / 2.0).tan();
    let aspect = wide as f32 / high as f32;
    let pixel = |i: u32| {
        let (x, y) = ((i % wide) as f32 + 0.5, (i / wide) as f32 + 0.5);
        let ndc = Vec2::new(2.0 * x / wide as f32 - 1.0, 1.0 - 2.0 * y / high as f32);
        let toward =
            camera.rotation * Vec3::new(ndc.x * aspect * half_height, ndc.y * half_height, -1.0);
        let origin = local_from_world.transform_point3(camera.translation);
        let ray = Ray::new(
            origin,
            local_from_world.transform_vector3(toward).normalize(),
        );
        // Bevy culls back faces.
        let seen = Room(
            room.0
                .iter()
                .filter(|q| q.u.cross(q.v).dot(ray.direction) < 0.0)
                .copied()
                .collect(),
        );
        let Some(hit) = seen.cast(&ray) else {
            return [0.0; 3];
        };
        let surface = textured(&seen.0[hit.primitive as usize], seen.surface(&ray, &hit));
        let e = light(&frame, bake, surface.position, surface.normal);
        (exposure() * surface.albedo * e / std::f32::consts::PI).to_array()
    };
    Picture {
        width: wide as usize,
        height: high as usize,
        pixels: (0..wide * high).map(pixel).collect(),
    }
}

/// Returns the irradiance of a frame at a position. Surface functions contribute by their fraction,
/// and probes contribute the rest.
fn light(frame: &CpuFrame, bake: &BakedScene, x: Vec3, n: Vec3) -> Vec3 {
    let space = || Some(frame.probe_irradiance(bake, x, n)?.irradiance(n));
    match splat_covered(
        &bake.data().points,
        &bake.data().display,
        frame.vector_irradiance(),
        x,
        n,
    ) {
        Some((e, cover)) => {
            let (e, fraction) = (
                e.dot(n).max(Vec3::ZERO),
                surface_fraction(cover, FULL_COVER),
            );
            let rest = if fraction < 1.0 { space() } else { None };
            rest.map_or(e, |rest| rest.lerp(e, fraction))
        }
        None => space().unwrap_or_default(),
    }
}
