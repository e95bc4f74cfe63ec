//! A room with a glossy floor, a metal ball and a crate, lit by the virtual lights of a lamp: for the tests of gloss, and for the example that writes docs/SUBSPLATS.md.
#![allow(dead_code, reason = "test and example each use their part")]

use bevy_meshless_gi::accuracy::{DrawnView, Image, flip};
use bevy_meshless_gi::frame::gloss::{GlossView, Glosses, Lights};
use bevy_meshless_gi::frame::pyramid::Picture;
use bevy_meshless_gi::frame::reflective::space_from_clip;
use bevy_meshless_gi::frame::subsplat::LUMINANCE;
use bevy_meshless_gi::frame::{
    FrameLight, GlossParams, GlossSettings, RsmChooseParams, RsmParams, SubsplatParams, Vpl,
    VplParams, VplViewParams, gbuffer, rsm, vpl,
};
use bevy_meshless_gi::scene::{Bvh, Geometry, Material, Quad, TriangleMesh, mesh_of_quads};
use glam::{Mat4, Vec3};
use rayon::prelude::*;
use std::f32::consts::{FRAC_1_PI, PI};

/// Inner size of the room, metres.
const ROOM: Vec3 = Vec3::new(6.0, 3.0, 6.0);
const BALL: (Vec3, f32) = (Vec3::new(3.9, 0.7, 2.6), 0.7);
const LAMP: Vec3 = Vec3::new(3.0, 2.9, 3.4);
/// Vertical angle of view, radians.
const ANGLE: f32 = 1.0;
/// Mean luminance that pictures are exposed to.
const EXPOSED: f32 = 0.18;

fn quad(origin: Vec3, u: Vec3, v: Vec3, albedo: Vec3) -> Quad {
    Quad {
        corners: [origin, origin + u, origin + u + v, origin + v],
        material: Material::diffuse(albedo),
    }
}

/// The room: walls of several colours, a crate, a ball.
pub fn room() -> TriangleMesh {
    let (x, y, z) = (ROOM.x * Vec3::X, ROOM.y * Vec3::Y, ROOM.z * Vec3::Z);
    let o = Vec3::ZERO;
    let grey = Vec3::splat(0.7);
    let mut quads = vec![
        quad(o, z, x, Vec3::splat(0.3)),
        quad(y, x, z, grey),
        quad(o, x, y, grey),
        quad(z, y, x, grey),
        quad(o, y, z, Vec3::new(0.7, 0.15, 0.1)),
        quad(x, z, y, Vec3::new(0.15, 0.6, 0.2)),
    ];
    // A crate, its sides outwards.
    let (c, u, v) = (
        Vec3::new(1.2, 0.0, 1.4),
        Vec3::new(0.9, 0.0, 0.3),
        Vec3::new(-0.3, 0.0, 0.9),
    );
    let up = 1.2 * Vec3::Y;
    let orange = Vec3::new(0.8, 0.4, 0.1);
    quads.extend([
        quad(c, up, u, orange),
        quad(c + v, u, up, orange),
        quad(c, v, up, orange),
        quad(c + u, up, v, orange),
        quad(c + up, v, u, orange),
    ]);
    const N: u32 = 48;
    let at = |i: u32, j: u32| {
        let (polar, around) = (PI * i as f32 / N as f32, PI * j as f32 / N as f32);
        let ring = polar.sin();
        BALL.0 + BALL.1 * Vec3::new(ring * around.cos(), polar.cos(), -ring * around.sin())
    };
    quads.extend((0..N).flat_map(|i| {
        (0..2 * N).map(move |j| Quad {
            corners: [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)],
            material: Material::diffuse(Vec3::new(0.9, 0.75, 0.5)),
        })
    }));
    mesh_of_quads(&quads)
}

/// Virtual lights of a lamp: it looks at half of the room, on a map of `side`².
pub fn virtual_lights(mesh: &dyn Geometry, side: u32, count: u32) -> Vec<Vpl> {
    let target = LAMP + Vec3::new(-0.3, -1.0, -0.45);
    let world_from_view = Mat4::look_at_rh(LAMP, target, Vec3::X).inverse();
    let clip_from_view = Mat4::perspective_infinite_reverse_rh(2.0, 1.0, 0.05);
    let drawn = DrawnView::new(mesh, clip_from_view * world_from_view.inverse(), [side; 2]);
    let light = FrameLight::point(LAMP, Vec3::splat(100.0), f32::INFINITY);
    let m = space_from_clip(&world_from_view, &clip_from_view, Vec3::ZERO);
    let params = RsmParams::new(m, &light, side, 0);
    let texels = rsm::texels(&params, &drawn.depth, &drawn.gbuffer);
    let choice = RsmChooseParams {
        texels: side * side,
        vpls: count,
        ..RsmChooseParams::default()
    };
    rsm::choose(&choice, &texels)
}

/// A picture of the room, its matrices, and its lights.
pub struct Scene {
    pub drawn: DrawnView,
    pub view_from_clip: Mat4,
    pub view_from_world: Mat4,
    pub view: VplViewParams,
    pub lit: VplParams,
    pub vpls: Vec<Vpl>,
    pub bvh: Bvh,
    /// Diffuse light of every pixel, over π, times albedo.
    pub diffuse: Vec<Vec3>,
}

impl Scene {
    /// The room from its door, with a floor of this roughness.
    pub fn new(size: [u32; 2], vpls: Vec<Vpl>, roughness: f32) -> Self {
        Self::from(
            [Vec3::new(3.2, 1.6, 5.8), Vec3::new(2.7, 0.5, 1.5)],
            size,
            vpls,
            roughness,
        )
    }

    pub fn from([eye, target]: [Vec3; 2], size: [u32; 2], vpls: Vec<Vpl>, roughness: f32) -> Self {
        let mesh = room();
        let clip_from_world = DrawnView::perspective(eye, target, Vec3::Y, ANGLE, size, 0.1);
        let view_from_world = Mat4::look_at_rh(eye, target, Vec3::Y);
        let drawn = DrawnView::new(&mesh, clip_from_world, size);
        let mut out = Self {
            view_from_clip: view_from_world * drawn.world_from_clip,
            view_from_world,
            view: VplViewParams {
                space_from_clip: drawn.world_from_clip.to_cols_array_2d(),
                viewport: [0.0, 0.0, size[0] as f32, size[1] as f32],
                size,
                scale: 1.0,
                pad: 0,
            },
            drawn,
            lit: VplParams::unshadowed(vpls.len() as u32),
            vpls,
            bvh: mesh.bvh(),
            diffuse: Vec::new(),
        };
        for i in 0..out.drawn.depth.len() {
            let depth = out.drawn.depth[i];
            let x = vpl::place(&out.view, out.pixel(i), depth);
            let texel = out.drawn.gbuffer[i];
            out.drawn.gbuffer[i] = if x.y < 0.005 {
                // Planks, some of them duller.
                let dull = ((x.x * 4.0).floor() as i32).rem_euclid(5) == 0;
                gbuffer::glossy(texel, roughness + if dull { 0.15 } else { 0.0 }, 0.7)
            } else if ((x - BALL.0).length() - BALL.1).abs() < 0.01 {
                let n = gbuffer::normal(texel);
                let metal = gbuffer::pack(Vec3::new(0.9, 0.75, 0.5), 1.0, 1.0, n, 0);
                gbuffer::glossy(metal, 0.3, 0.5)
            } else {
                gbuffer::glossy(texel, 0.9, 0.5)
            };
        }
        out.light();
        let shown = out.image(&out.full());
        let sum: f64 = shown.iter().map(|&c| f64::from(LUMINANCE.dot(c))).sum();
        out.view.scale = EXPOSED / (sum / shown.len() as f64) as f32;
        out.light();
        out
    }

    /// The same with the room's own shadows on the lights.
    pub fn shadowed(mut self) -> Self {
        let nodes = self.bvh.nodes.len() as u32;
        let count = self.vpls.len() as u32;
        self.lit = VplParams::shadowed(count, Mat4::IDENTITY, nodes, 6.0, 0.0);
        self.light();
        self
    }

    fn light(&mut self) {
        let drawn = &self.drawn;
        self.diffuse = (0..drawn.depth.len())
            .into_par_iter()
            .map(|i| {
                let of = (self.pixel(i), drawn.depth[i], drawn.gbuffer[i]);
                let e = vpl::vpl_pixel(&self.view, &self.lit, &self.vpls, &self.bvh, of, [0.0; 4]);
                FRAC_1_PI * gbuffer::diffuse(of.2) * Vec3::new(e[0], e[1], e[2])
            })
            .collect();
    }

    pub fn pixel(&self, i: usize) -> [u32; 2] {
        let width = self.drawn.size[0];
        [i as u32 % width, i as u32 / width]
    }

    pub fn params(&self, settings: &GlossSettings) -> (SubsplatParams, GlossParams) {
        settings.params(
            self.view_from_clip,
            self.view_from_world,
            self.view.viewport,
            self.drawn.size,
        )
    }

    pub fn view<'a>(
        &'a self,
        (screen, params): &'a (SubsplatParams, GlossParams),
    ) -> GlossView<'a> {
        GlossView {
            screen,
            params,
            view: &self.view,
            lights: Lights {
                lit: &self.lit,
                vpls: &self.vpls,
                bvh: &self.bvh,
            },
            picture: Picture {
                depth: &self.drawn.depth,
                gbuffer: &self.drawn.gbuffer,
            },
        }
    }

    pub fn run(&self, settings: &GlossSettings) -> Glosses {
        let params = self.params(settings);
        self.view(&params).run()
    }

    /// Every pixel evaluated by itself.
    pub fn full(&self) -> Vec<[f32; 4]> {
        let params = self.params(&GlossSettings::default());
        let view = self.view(&params);
        (0..self.drawn.depth.len())
            .into_par_iter()
            .map(|i| view.full(self.pixel(i)))
            .collect()
    }

    /// What the camera gets of the lights: diffuse and gloss, linear.
    pub fn image(&self, texels: &[[f32; 4]]) -> Vec<Vec3> {
        let pairs = texels.iter().zip(&self.diffuse);
        pairs
            .map(|(t, d)| *d + Vec3::new(t[0], t[1], t[2]))
            .collect()
    }

    /// FLIP of the two pictures with a tone curve, and root mean square difference over root mean square of the gloss alone.
    pub fn compare(&self, full: &[[f32; 4]], texels: &[[f32; 4]]) -> (f32, f64) {
        let picture = |texels: &[[f32; 4]]| Image {
            width: self.drawn.size[0],
            height: self.drawn.size[1],
            pixels: self
                .image(texels)
                .into_iter()
                .map(|c| 1.25 * c / (Vec3::ONE + c))
                .collect(),
        };
        let square = |v: f32| f64::from(v) * f64::from(v);
        let pairs = texels.iter().flatten().zip(full.iter().flatten());
        let error: f64 = pairs.map(|(a, b)| square(a - b)).sum();
        let power: f64 = full.iter().flat_map(|t| &t[..3]).map(|&b| square(b)).sum();
        (
            flip(&picture(full), &picture(texels)),
            (error / power).sqrt(),
        )
    }

    /// Glossy pixels.
    pub fn glossy(&self, full: &[[f32; 4]]) -> u64 {
        full.iter().filter(|t| t[3] > 0.0).count() as u64
    }
}

/// Evaluations of a light over those of full resolution.
pub fn share(scene: &Scene, full: &[[f32; 4]], found: &Glosses) -> f64 {
    let sum: u64 = found.evaluated.iter().sum();
    sum as f64 / (scene.glossy(full) * u64::from(scene.lit.vpls)) as f64
}
