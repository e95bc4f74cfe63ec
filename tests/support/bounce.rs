//! CPU reference of light reflected by dynamic objects. Ray casts draw the plugin's shadow maps,
//! and CPU versions of the kernels evaluate them.

use super::app::{HEIGHT, WIDTH};
use super::flip::Picture;
use super::scenes::{Quad, Room, exposure};
use bevy::prelude::*;
use bevy_meshless_gi::GiReflectiveShadowMap;
use bevy_meshless_gi::internals::plan::{Lens, map_views};
use meshless_gi::internals::frame::project::extent;
use meshless_gi::internals::frame::rsm_layout::{MAX_VPLS, light_in_space, space_from_clip};
use meshless_gi::internals::frame::vpl_specular::{SpecularView, VplSet};
use meshless_gi::internals::frame::{
    RsmParams, RsmSelectParams, RsmShadowParams, Vpl, VplParams, VplViewParams, gbuffer, pyramid,
    rsm, vpl,
};
use meshless_gi::{
    BakedScene, Bounds, Bvh, FrameLight, Geometry, Hit, Light, Ray, SpecularSettings, Surface,
};
use meshless_gi_lab::accuracy::RaycastView;
use std::f32::consts::{FRAC_PI_4, PI};

/// Ball of a diffuse material.
#[derive(Clone, Copy)]
pub struct Ball {
    pub center: Vec3,
    pub radius: f32,
    pub color: Vec3,
}

/// Quads with culled back faces, and balls.
#[derive(Clone, Default)]
pub struct DynamicObjects {
    pub quads: Vec<Quad>,
    pub balls: Vec<Ball>,
}

/// First primitive index of the balls.
const BALLS: u32 = 1 << 20;

impl DynamicObjects {
    /// Returns the bounding boxes of all quads and balls.
    pub fn boxes(&self) -> Vec<Bounds> {
        let quads = self.quads.iter().map(|q| Room(vec![*q]).bounds());
        let balls = self.balls.iter().map(|b| Bounds {
            min: b.center - b.radius,
            max: b.center + b.radius,
        });
        quads.chain(balls).collect()
    }
}

impl Geometry for DynamicObjects {
    fn bounds(&self) -> Bounds {
        let corners = |b: Bounds| [b.min, b.max];
        (self.boxes().into_iter().flat_map(corners)).fold(Bounds::EMPTY, Bounds::join)
    }

    fn cast(&self, ray: &Ray) -> Option<Hit> {
        // Bevy culls back faces.
        let front: Vec<usize> = (0..self.quads.len())
            .filter(|&i| {
                let q = &self.quads[i];
                q.u.cross(q.v).dot(ray.direction) < 0.0
            })
            .collect();
        let quads = Room(front.iter().map(|&i| self.quads[i]).collect());
        let mut best = quads.cast(ray).map(|hit| Hit {
            primitive: front[hit.primitive as usize] as u32,
            ..hit
        });
        for (i, ball) in self.balls.iter().enumerate() {
            let to = ray.origin - ball.center;
            let b = to.dot(ray.direction);
            let root = b * b - to.length_squared() + ball.radius * ball.radius;
            let t = -b - root.max(0.0).sqrt();
            if root > 0.0 && t > 0.0 && t < ray.max_t && best.is_none_or(|h| t < h.t) {
                best = Some(Hit {
                    t,
                    primitive: BALLS + i as u32,
                    uv: [0.0; 2],
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
        let position = ray.at(hit.t);
        let (normal, albedo) = match hit.primitive.checked_sub(BALLS) {
            Some(i) => {
                let ball = self.balls[i as usize];
                ((position - ball.center).normalize(), ball.color)
            }
            None => {
                let q = self.quads[hit.primitive as usize];
                (q.u.cross(q.v).normalize(), q.color)
            }
        };
        Surface {
            position,
            normal,
            albedo,
            emission: Vec3::ZERO,
            front: true,
        }
    }
}

/// Computes the virtual point lights of dynamic objects in world space.
pub fn cpu_vpls(
    moving: &DynamicObjects,
    light: &Light,
    requested: &GiReflectiveShadowMap,
    bake: Option<&BakedScene>,
) -> Vec<Vpl> {
    let light = FrameLight::expand(light, 1)[0];
    let side = requested.texels();
    let views = map_views(&light, &moving.boxes(), side).expect("it is in range");
    let mut texels = Vec::new();
    for view in &views {
        let clip_from_view = match view.lens {
            Lens::Perspective { fov, near, .. } => {
                Mat4::perspective_infinite_reverse_rh(fov, 1.0, near)
            }
            Lens::Orthographic { size, far } => {
                let half = 0.5 * size;
                Mat4::orthographic_rh(-half, half, -half, half, far, 0.0)
            }
        };
        let world_from_view = Mat4::from_rotation_translation(view.rotation, view.position);
        let clip_from_world = clip_from_view * world_from_view.inverse();
        let drawn = RaycastView::new(moving, clip_from_world, [side, side]);
        let matrix = space_from_clip(&world_from_view, &clip_from_view, Vec3::ZERO);
        let light = light_in_space(&light, Vec3::ZERO);
        let params = RsmParams::new(matrix, &light, side, 0);
        texels.extend(rsm::texels(&params, &drawn.depth, &drawn.gbuffer));
    }
    let count = texels.len() as u32;
    if let Some(bake) = bake.filter(|_| requested.trace_shadows) {
        let nodes = bake.data().bvh.nodes.len() as u32;
        let params =
            RsmShadowParams::new(Mat4::IDENTITY, &light, count, nodes, extent(bake.data()));
        rsm::shadow(&params, &bake.data().bvh, &mut texels);
    }
    let params = RsmSelectParams {
        texels: count,
        first: 0,
        vpls: requested.vpl_count.clamp(1, MAX_VPLS),
        pad: 0,
    };
    rsm::select_vpls(&params, &texels)
}

/// Draws the light that `lights` add to the picture of `seen`.
pub fn cpu_bounce(
    seen: &DynamicObjects,
    lights: &[Vpl],
    bake: Option<&BakedScene>,
    camera: Transform,
) -> Picture {
    let count = lights.len() as u32;
    let (params, bvh) = match bake {
        Some(bake) => {
            let nodes = bake.data().bvh.nodes.len() as u32;
            let shadowed =
                VplParams::shadowed(count, Mat4::IDENTITY, nodes, extent(bake.data()), 0.0);
            (shadowed, bake.data().bvh.clone())
        }
        None => (VplParams::unshadowed(count), Bvh::default()),
    };
    let half_height = (FRAC_PI_4 / 2.0).tan();
    let aspect = WIDTH as f32 / HEIGHT as f32;
    let pixel = |i: u32| {
        let (x, y) = ((i % WIDTH) as f32 + 0.5, (i / WIDTH) as f32 + 0.5);
        let ndc = Vec2::new(2.0 * x / WIDTH as f32 - 1.0, 1.0 - 2.0 * y / HEIGHT as f32);
        let toward =
            camera.rotation * Vec3::new(ndc.x * aspect * half_height, ndc.y * half_height, -1.0);
        let ray = Ray::new(camera.translation, toward.normalize());
        let Some(hit) = seen.cast(&ray) else {
            return [0.0; 3];
        };
        let surface = seen.surface(&ray, &hit);
        let e = vpl::vpl_at(&params, lights, &bvh, surface.position, surface.normal);
        let e = e.dot(surface.normal).max(Vec3::ZERO);
        (exposure() * surface.albedo * e / PI).to_array()
    };
    Picture {
        width: WIDTH as usize,
        height: HEIGHT as usize,
        pixels: (0..WIDTH * HEIGHT).map(pixel).collect(),
    }
}

/// Draws the specular light of `lights` on the surfaces of `seen` at every pixel, without shadows.
/// All surfaces have the given roughness and reflectance.
pub fn cpu_specular(
    seen: &DynamicObjects,
    lights: &[Vpl],
    camera: Transform,
    [roughness, reflectance]: [f32; 2],
) -> Picture {
    let size = [WIDTH, HEIGHT];
    let world_from_view = Mat4::from_rotation_translation(camera.rotation, camera.translation);
    let clip_from_view =
        Mat4::perspective_infinite_reverse_rh(FRAC_PI_4, WIDTH as f32 / HEIGHT as f32, 0.1);
    let drawn = RaycastView::new(seen, clip_from_view * world_from_view.inverse(), size);
    let gbuffer: Vec<_> = (drawn.gbuffer.iter())
        .map(|texel| gbuffer::with_roughness(*texel, roughness, reflectance))
        .collect();
    let viewport = [0.0, 0.0, WIDTH as f32, HEIGHT as f32];
    let view = VplViewParams {
        space_from_clip: space_from_clip(&world_from_view, &clip_from_view, Vec3::ZERO)
            .to_cols_array_2d(),
        viewport,
        size,
        scale: exposure(),
        pad: 0,
    };
    let view_from_clip = clip_from_view.inverse();
    let view_from_world = world_from_view.inverse();
    let (screen, params) =
        SpecularSettings::default().params(view_from_clip, view_from_world, viewport, size);
    let on = SpecularView {
        screen: &screen,
        params: &params,
        view: &view,
        lights: VplSet {
            lit: &VplParams::unshadowed(lights.len() as u32),
            vpls: lights,
            bvh: &Bvh::default(),
        },
        picture: pyramid::GbufferView {
            depth: &drawn.depth,
            gbuffer: &gbuffer,
        },
    };
    let pixel = |i: u32| {
        let [r, g, b, _] = on.full([i % WIDTH, i / WIDTH]);
        [r, g, b]
    };
    Picture {
        width: WIDTH as usize,
        height: HEIGHT as usize,
        pixels: (0..WIDTH * HEIGHT).map(pixel).collect(),
    }
}
