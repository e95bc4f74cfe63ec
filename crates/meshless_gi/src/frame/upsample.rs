//! Kernel `upsample`: interpolation between nodes, from coarse to fine (\[N09\] §3.5). Entry
//! points: `upsample` fills a level from the next coarser one before its own nodes are evaluated.
//! Its result is the prediction that evaluation is compared with. `resolve` does the same for
//! pixels and lists those with too few similar nodes. `fill` writes these after their evaluation.
//!
//! \[N09\] interpolates among texels with data and assumes that discontinuities were refined to
//! single pixels. Here each node is weighted by its similarity to the pixel's surface
//! ([`surface_similarity`]). An edge therefore needs a direct evaluation of few of its pixels. The
//! interpolation is cubic if all nodes around are similar, else linear.

use super::gbuffer;
use super::layout::VectorIrradiance;
use super::pyramid::{GbufferView, VisibleSurface, visible_surface};
use super::refine::{luminance, pack_cell};
use super::splat::MAX_HALF;
use super::subsplat::{SubsplatLevels, SubsplatNode, SubsplatParams, state};
use glam::Vec3;

/// Distance of a node from the other node's plane at which similarity ends, as a fraction of the
/// depth ([`VisibleSurface::reach`]). Up to half of it both nodes count as one surface, and beyond
/// that the similarity decreases to 0.
pub const PLANE: f32 = 0.01;
/// Cosine between normals up to which nodes have no similarity.
pub const MIN_NORMAL_COSINE: f32 = 0.5;
/// Cosine between normals above which nodes have full similarity.
pub const FULL_NORMAL_COSINE: f32 = 0.9;
/// Minimum similarity of all nodes for cubic interpolation.
pub const CUBIC_MIN_SIMILARITY: f32 = 0.9;

/// Returns the similarity of two surface points, from 0 (different surfaces) to 1 (one surface).
#[must_use]
pub fn surface_similarity(a: &VisibleSurface, b: &VisibleSurface) -> f32 {
    let off = (b.x - a.x).dot(a.n).abs().max((b.x - a.x).dot(b.n).abs());
    let plane = (2.0 - 2.0 * off / (PLANE * a.reach)).clamp(0.0, 1.0);
    let normal = ((a.n.dot(b.n) - MIN_NORMAL_COSINE) / (FULL_NORMAL_COSINE - MIN_NORMAL_COSINE))
        .clamp(0.0, 1.0);
    plane * normal
}

/// Nodes of a midpoint, as steps and weights: those of the cubic interpolation first, then those of
/// the linear one. The cubic on an edge is the four-point scheme (−1, 9, 9, −1)/16. In the middle
/// of a cell its weights are 5/16 for each corner and −1/32 for the eight nodes next to them. This
/// reproduces quadratics exactly too.
const EDGE: [(i32, f32); 4] = [(-1, -0.0625), (0, 0.5625), (1, 0.5625), (2, -0.0625)];
const MIDDLE: [(i32, i32, f32); 12] = [
    (0, 0, 0.3125),
    (1, 0, 0.3125),
    (0, 1, 0.3125),
    (1, 1, 0.3125),
    (-1, 0, -0.03125),
    (-1, 1, -0.03125),
    (2, 0, -0.03125),
    (2, 1, -0.03125),
    (0, -1, -0.03125),
    (1, -1, -0.03125),
    (0, 2, -0.03125),
    (1, 2, -0.03125),
];

/// Interpolated value of a level between its nodes.
struct Interpolation {
    light: VectorIrradiance,
    /// Share of the weight of nodes with light.
    covered: f32,
    /// Sum of the linear weights of nodes on the same surface, 1 for a cubic interpolation.
    weight: f32,
    /// `true` if all nodes around on a visible surface are known.
    whole: bool,
}

/// Interpolates light at cell (x, y) of level `k` (0 for pixels) from the nodes of level `k` + 1.
/// At least one coordinate is odd.
fn interpolate_odd_cell(
    params: &SubsplatParams,
    levels: &SubsplatLevels,
    picture: &GbufferView<'_>,
    nodes: &[SubsplatNode],
    k: u32,
    [x, y]: [u32; 2],
    here: &VisibleSurface,
) -> Interpolation {
    let [w, h] = levels.grid(k + 1);
    let (bx, by) = ((x / 2) as i32, (y / 2) as i32);
    let node_at = |dx: i32, dy: i32| -> Option<([u32; 2], SubsplatNode)> {
        let (cx, cy) = (bx + dx, by + dy);
        if cx < 0 || cy < 0 || cx >= w as i32 || cy >= h as i32 {
            return None;
        }
        let node = nodes[levels.index(k + 1, cx as u32, cy as u32)];
        Some(([(cx as u32) << (k + 1), (cy as u32) << (k + 1)], node))
    };
    let node = |dx: i32, dy: i32| -> Option<(SubsplatNode, f32)> {
        let (pixel, node) = node_at(dx, dy)?;
        if !node.has_bits(state::KNOWN) {
            return None;
        }
        visible_surface(params, picture, pixel)
            .map(|there| (node, surface_similarity(here, &there)))
    };
    let unknown = |dx: i32, dy: i32| {
        node_at(dx, dy).is_some_and(|(pixel, node)| {
            !node.has_bits(state::KNOWN) && picture.depth(params.size, pixel) > 0.0
        })
    };
    let (odd_x, odd_y) = (x % 2 == 1, y % 2 == 1);
    let count = if odd_x && odd_y { 12 } else { 4 };
    let tap = |i: usize| match (odd_x, odd_y) {
        (true, true) => MIDDLE[i],
        (true, false) => (EDGE[i].0, 0, EDGE[i].1),
        _ => (0, EDGE[i].0, EDGE[i].1),
    };
    let mut out = Interpolation {
        light: VectorIrradiance::default(),
        covered: 1.0,
        weight: 1.0,
        whole: true,
    };
    let mut sure = true;
    for i in 0..count {
        let (dx, dy, weight) = tap(i);
        match node(dx, dy) {
            Some((node, similarity))
                if node.has_bits(state::COVERED) && similarity >= CUBIC_MIN_SIMILARITY =>
            {
                out.light.add_scaled(weight, &node.light());
            }
            _ => {
                sure = false;
                break;
            }
        }
    }
    if sure {
        return out;
    }
    let (mut sum, mut covered, mut total) = (VectorIrradiance::default(), 0.0, 0.0);
    let mut whole = true;
    let corners: [(i32, i32); 4] = [(0, 0), (1, 0), (0, 1), (1, 1)];
    let share = if odd_x && odd_y { 0.25 } else { 0.5 };
    for (dx, dy) in corners {
        if (dx == 1 && !odd_x) || (dy == 1 && !odd_y) {
            continue;
        }
        if let Some((node, similarity)) = node(dx, dy) {
            let weight = share * similarity;
            total += weight;
            if node.has_bits(state::COVERED) {
                covered += weight;
                sum.add_scaled(weight, &node.light());
            }
        } else if unknown(dx, dy) {
            whole = false;
        }
    }
    let scale = if covered > 0.0 { 1.0 / covered } else { 0.0 };
    let mut light = VectorIrradiance::default();
    light.add_scaled(scale, &sum);
    Interpolation {
        light,
        covered: if total > 0.0 { covered / total } else { 0.0 },
        weight: total,
        whole,
    }
}

impl Interpolation {
    /// Returns the state bits. The result is known if nodes on the same surface have enough weight
    /// and all have light. The result "no light" additionally requires that all nodes around are
    /// known. Otherwise single positions without a function would spread over unknown surroundings.
    fn state(&self, params: &SubsplatParams) -> u32 {
        if self.weight <= params.min_similarity {
            0
        } else if self.covered > 0.99 {
            state::KNOWN | state::COVERED
        } else if self.covered < 0.01 && self.whole {
            state::KNOWN
        } else {
            0
        }
    }
}

/// Entry point `upsample`: computes level `k` from level `k` + 1.
pub fn upsample(
    params: &SubsplatParams,
    picture: &GbufferView<'_>,
    k: u32,
    nodes: &mut [SubsplatNode],
) {
    let levels = params.levels();
    let [w, h] = levels.grid(k);
    for y in 0..h {
        for x in 0..w {
            nodes[levels.index(k, x, y)] = node_of(params, &levels, picture, nodes, k, [x, y]);
        }
    }
}

fn node_of(
    params: &SubsplatParams,
    levels: &SubsplatLevels,
    picture: &GbufferView<'_>,
    nodes: &[SubsplatNode],
    k: u32,
    [x, y]: [u32; 2],
) -> SubsplatNode {
    let pixel = [x << k, y << k];
    let Some(here) = visible_surface(params, picture, pixel) else {
        return SubsplatNode::UNKNOWN;
    };
    let normal = gbuffer::normal(picture.texel(params.size, pixel));
    let (light, bits) = if x % 2 == 0 && y % 2 == 0 {
        let same = nodes[levels.index(k + 1, x / 2, y / 2)];
        // Evaluated nodes keep their value, and their difference is already tested.
        (same.light(), same.state())
    } else {
        let found = interpolate_odd_cell(params, levels, picture, nodes, k, [x, y], &here);
        let bits = found.state(params);
        if bits == 0 {
            return SubsplatNode::UNKNOWN;
        }
        (found.light, bits)
    };
    let predicted_luminance = luminance(&SubsplatNode::new(&light, 0.0, bits), normal);
    SubsplatNode::new(&light, predicted_luminance, bits)
}

/// Result of [`resolve`] for a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PixelResolve {
    /// Irradiance times the view's scale, and 1 in alpha if light is present.
    Texel([f32; 4]),
    /// A pixel that needs a direct evaluation, with its fallback value if the list is full.
    NeedsEvaluation([f32; 4]),
}

/// Entry point `resolve`, for one pixel.
#[must_use]
pub fn resolve(
    params: &SubsplatParams,
    picture: &GbufferView<'_>,
    nodes: &[SubsplatNode],
    pixel: [u32; 2],
) -> PixelResolve {
    let Some(here) = visible_surface(params, picture, pixel) else {
        return PixelResolve::Texel([0.0; 4]);
    };
    let levels = params.levels();
    let [x, y] = pixel;
    let (light, bits, some) = if x % 2 == 0 && y % 2 == 0 {
        let node = nodes[levels.index(1, x / 2, y / 2)];
        (node.light(), node.state(), node.has_bits(state::COVERED))
    } else {
        let found = interpolate_odd_cell(params, &levels, picture, nodes, 0, pixel, &here);
        let bits = found.state(params);
        (found.light, bits, found.covered > 0.0)
    };
    let lit = |some: bool| {
        if some {
            texel(params, picture, pixel, &here, &light)
        } else {
            [0.0; 4]
        }
    };
    if bits & state::KNOWN == 0 {
        return PixelResolve::NeedsEvaluation(lit(some));
    }
    PixelResolve::Texel(lit(bits & state::COVERED != 0))
}

/// Entry point `fill`, for one pixel that was evaluated directly.
#[must_use]
pub fn fill(
    params: &SubsplatParams,
    picture: &GbufferView<'_>,
    node: &SubsplatNode,
    pixel: [u32; 2],
) -> [f32; 4] {
    match visible_surface(params, picture, pixel) {
        Some(here) if node.has_bits(state::COVERED) => {
            texel(params, picture, pixel, &here, &node.light())
        }
        _ => [0.0; 4],
    }
}

/// Returns the texel of a pixel with this light: E⃗·n with its own normal. \[N09\] Eq. (3) darkens
/// it at grazing angles if `detail` is above 0.
fn texel(
    params: &SubsplatParams,
    picture: &GbufferView<'_>,
    pixel: [u32; 2],
    here: &VisibleSurface,
    light: &VectorIrradiance,
) -> [f32; 4] {
    let n = gbuffer::normal(picture.texel(params.size, pixel));
    let facing = here.n.dot(-here.x.normalize()).max(0.0);
    let shade = params.detail * facing + (1.0 - params.detail);
    (shade * light.dot(n).max(Vec3::ZERO))
        .min(Vec3::splat(MAX_HALF))
        .extend(1.0)
        .to_array()
}

/// Packs a pixel for the list of those evaluated directly.
#[must_use]
pub fn listed(pixel: [u32; 2]) -> u32 {
    pack_cell(pixel[0], pixel[1])
}
