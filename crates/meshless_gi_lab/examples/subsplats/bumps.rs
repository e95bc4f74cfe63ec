//! Benefit of vector irradiance at nodes ([N09] §4.3, Fig. 11), on a ball and a wall with bumpy
//! normals. Nodes hold vector irradiance, or the irradiance of their own normal, with and without
//! Eq. (3).

use super::experiments::SMALL;
use super::subsplat_support::{LitScene, Measured, View, from};
use glam::Vec3;
use meshless_gi::internals::frame::subsplat::state;
use meshless_gi::internals::frame::{SubsplatNode, VectorIrradiance, gbuffer, splat, subsplats};
use meshless_gi::{Material, NormalTest, Quad, SubsplatSettings, TriangleMesh};
use std::f32::consts::PI;

/// Content of the nodes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NodeContent {
    Vectors,
    Scalars,
    /// Darkened at grazing angles with this α.
    Darkened(f32),
}

pub struct BumpResult {
    pub content: NodeContent,
    pub normal: f32,
    pub measured: Measured,
}

/// Returns light from one side, and a little from all directions.
fn light(x: Vec3) -> VectorIrradiance {
    let to = Vec3::new(-2.5, 2.0, 1.0) - x;
    let mut e = from(to, Vec3::new(9.0, 8.0, 7.0) / (1.0 + to.length_squared()));
    e.add_scaled(
        1.0,
        &from(Vec3::new(1.0, 0.2, 0.6), Vec3::new(0.2, 0.3, 0.4)),
    );
    e
}

/// Returns a ball of 1 m in front of a wall.
fn scene() -> TriangleMesh {
    const N: u32 = 96;
    let center = Vec3::new(0.0, 0.0, -3.0);
    let at = |i: u32, j: u32| {
        let (polar, around) = (PI * i as f32 / N as f32, PI * j as f32 / N as f32);
        let ring = polar.sin();
        center + Vec3::new(ring * around.cos(), polar.cos(), -ring * around.sin())
    };
    let ball = (0..N).flat_map(|i| (0..2 * N).map(move |j| (i, j)));
    let mut quads: Vec<Quad> = ball
        .map(|(i, j)| Quad {
            corners: [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)],
            material: Material::diffuse(Vec3::splat(0.6)),
        })
        .collect();
    let corner = Vec3::new(-12.0, -8.0, -5.0);
    let (u, v) = (24.0 * Vec3::X, 16.0 * Vec3::Y);
    quads.push(Quad {
        corners: [corner, corner + u, corner + u + v, corner + v],
        material: Material::diffuse(Vec3::splat(0.6)),
    });
    TriangleMesh::from_quads(&quads)
}

/// Adds bumps a few centimeters wide, up to 25 degrees steep.
fn bump(view: &mut View<'_>) {
    for i in 0..view.drawn.depth.len() {
        if view.drawn.depth[i] <= 0.0 {
            continue;
        }
        let pixel = [i as u32 % SMALL[0], i as u32 / SMALL[0]];
        let texel = view.drawn.gbuffer[i];
        let (x, n) = splat::pixel_position(&view.splat, pixel, view.drawn.depth[i], texel);
        let p = 45.0 * x;
        let slope = Vec3::new(
            p.y.sin() * p.z.cos(),
            p.z.sin() * p.x.cos(),
            p.x.sin() * p.y.cos(),
        );
        let tilted = (n + 0.45 * (slope - slope.dot(n) * n)).normalize();
        view.drawn.gbuffer[i] = gbuffer::pack(Vec3::splat(0.6), 0.0, 1.0, tilted, 0);
    }
    let scale = view.splat.scale;
    view.expose(scale);
}

/// Returns the result of nodes with one irradiance each. Interpolation between nodes acts on each
/// part, and a pixel evaluates the result for its normal. The irradiance is stored along one of the
/// six axes. A pixel with a normal along that axis thus returns the interpolated value.
fn scalars(view: &View<'_>, settings: &SubsplatSettings) -> (Vec<[f32; 4]>, Measured) {
    let params = view.params(settings);
    let picture = view.picture();
    let mut out = vec![[0.0; 4]; view.full.len()];
    let mut counts = None;
    for axis in 0..3 {
        for sign in [-1.0f32, 1.0] {
            let shown = subsplats(&params, &picture, &|pixel, node| {
                let e = view.pixel(pixel);
                let all = state::EVALUATED | state::KNOWN | state::COVERED;
                let along = from(sign * Vec3::AXES[axis], Vec3::new(e[0], e[1], e[2]));
                *node = SubsplatNode::new(&along, node.predicted_luminance(), all);
            });
            for (i, texel) in shown.texels.iter().enumerate() {
                let n = gbuffer::normal(view.drawn.gbuffer[i]);
                let largest = n.abs().max_position();
                if largest == axis && n[axis] * sign > 0.0 {
                    out[i] = texel.map(|v| v / n[axis].abs());
                    out[i][3] = 1.0;
                }
            }
            counts = Some(shown.counts);
        }
    }
    let measured = view.compare(&out, counts.unwrap_or_default());
    (out, measured)
}

pub fn measure() -> Vec<BumpResult> {
    let stage = LitScene::made("bumps", scene(), light);
    let eye = Vec3::ZERO;
    let mut view = View::new(&stage, eye, Vec3::NEG_Z, SMALL);
    bump(&mut view);
    let mut out = Vec::new();
    for normal in [0.25, 1.0, 1.4] {
        let settings = SubsplatSettings {
            normal: NormalTest::MinMax(normal),
            radiance_threshold: f32::INFINITY,
            // No direct evaluation at pixels, as in [N09].
            min_similarity: 0.0,
            ..SubsplatSettings::default()
        };
        out.push(BumpResult {
            content: NodeContent::Vectors,
            normal,
            measured: view.measure(&settings),
        });
        let (plain, measured) = scalars(&view, &settings);
        out.push(BumpResult {
            content: NodeContent::Scalars,
            normal,
            measured,
        });
        let alpha = 0.5;
        let dark: Vec<[f32; 4]> = (0..plain.len())
            .map(|i| {
                let pixel = [i as u32 % SMALL[0], i as u32 / SMALL[0]];
                let (depth, texel) = (view.drawn.depth[i], view.drawn.gbuffer[i]);
                let (x, n) = splat::pixel_position(&view.splat, pixel, depth, texel);
                let facing = n.dot((eye - x).normalize()).max(0.0);
                let shade = alpha * facing + 1.0 - alpha;
                let [r, g, b, a] = plain[i];
                [shade * r, shade * g, shade * b, a]
            })
            .collect();
        out.push(BumpResult {
            content: NodeContent::Darkened(alpha),
            normal,
            measured: view.compare(&dark, measured.counts),
        });
    }
    out
}
