//! Kernel `vpl_specular`: specular reflection of virtual point lights, \[N09\] Eq. (2) with a BRDF
//! at the receiver, refined for each light separately (\[N09\] §3.3.1, and the proposal of its §6).
//! Entry points: `vpl_specular` fills the nodes of a level, from the coarsest to the finest.
//! `vpl_specular_pixels` evaluates every pixel.
//!
//! A highlight of one light changes where that of another is flat or dark, so one list of subsplats
//! for all lights is inefficient. \[N09\] refines one list per light, at the cost of its Table 1.
//! Here every node has a *refine mask*, one bit per light (or group of lights). The bit is set if
//! evaluating the light changed the value that coarser nodes predict. A node between coarser ones
//! interpolates, and evaluates only the lights in the masks around it:
//!
//! ```text
//! value = Σ_j w_j value_j + Σ_{i in masks} (light_i − Σ_j w_j light_i,j)
//! ```
//!
//! with j the nodes around it. The last sum evaluates light i at these nodes again, because only
//! the bit of a light is stored, for any number of lights. A node without similar neighbors
//! (another surface, normal or roughness) evaluates all lights, as does such a pixel.
//!
//! Nodes have two colors, the radiance over f₀ and over f₉₀ ([`brdf`]), so color textures need no
//! subsplats. Size and shadows of lights are those of [`vpl`](super::vpl).
//! [`vpl_contribution`](super::vpl::vpl_contribution) returns the arriving part of a light, and its
//! direction.

use super::brdf;
use super::gbuffer;
use super::pyramid::{GbufferView, VisibleSurface, visible_surface};
use super::refine::FLOOR;
use super::rsm_layout::VplViewParams;
use super::splat::MAX_HALF;
use super::subsplat::{LUMINANCE, SubsplatLevels, SubsplatParams};
use super::upsample::PLANE;
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::FRAC_1_PI;
use std::sync::atomic::{AtomicU64, Ordering};

mod receiver;
mod settings;

pub use receiver::{MIN, Receiver, VplSet, receiver, specular_at, specular_of_light};
pub use settings::{SpecularNode, SpecularParams, SpecularRadiance, SpecularSettings};

/// Number of bits of a refine mask. If there are more lights, groups of neighbors share a bit.
pub const LIGHT_GROUPS: u32 = 128;
/// Range of perceptual roughness over which the specular light of non-metals fades out.
pub const ROUGHNESS_FADE: f32 = 0.1;
/// Cosines between normals at which the similarity of nodes is 0 and 1. Highlights rotate twice as
/// fast as the surface.
pub const NORMAL_COSINES: [f32; 2] = [0.85, 0.97];
/// Difference of the cosines to the eye, over their sum, at which the similarity of nodes is 0.
pub const VIEW_COSINE_TOLERANCE: f32 = 0.15;
/// Difference of perceptual roughness at which the similarity of nodes is 0.
pub const ROUGHNESS_TOLERANCE: f32 = 0.1;

/// Returns the fraction of the specular radiance that a texel shows, 0 to 1. Metals show all of it.
/// The fraction of other materials decreases with roughness.
#[must_use]
pub fn specular_fraction(params: &SpecularParams, texel: [u32; 4]) -> f32 {
    let smooth = (params.max_roughness - gbuffer::roughness(texel)) / ROUGHNESS_FADE;
    gbuffer::metallic(texel).max(smooth.clamp(0.0, 1.0))
}

/// Inputs of the specular light of a view.
#[derive(Clone, Copy)]
pub struct SpecularView<'a> {
    /// Levels and thresholds of the subsplats.
    pub screen: &'a SubsplatParams,
    /// Other settings.
    pub params: &'a SpecularParams,
    /// Transform to the space of the lights, and the scale.
    pub view: &'a VplViewParams,
    /// The lights.
    pub lights: VplSet<'a>,
    /// Depth and G-buffer.
    pub picture: GbufferView<'a>,
}

/// A pixel with specular light.
#[derive(Clone, Copy)]
struct Glossy {
    seen: VisibleSurface,
    depth: f32,
    texel: [u32; 4],
    specular_fraction: f32,
}

/// A node around a position: its light, weight and surface.
#[derive(Clone, Copy)]
struct NeighborNode {
    weight: f32,
    light: SpecularRadiance,
    at: Receiver,
}

/// All nodes with similarity to a position. The weights sum to one, or there is no node.
#[derive(Default)]
struct Prediction {
    light: SpecularRadiance,
    around: [Option<NeighborNode>; 4],
    known: bool,
}

impl SpecularView<'_> {
    /// Returns `None` if no specular surface is visible.
    fn glossy(&self, pixel: [u32; 2]) -> Option<Glossy> {
        let seen = visible_surface(self.screen, &self.picture, pixel)?;
        let texel = self.picture.texel(self.screen.size, pixel);
        let specular_fraction = specular_fraction(self.params, texel);
        (specular_fraction > 0.0).then(|| Glossy {
            seen,
            depth: self.picture.depth(self.screen.size, pixel),
            texel,
            specular_fraction,
        })
    }

    fn receiver(&self, pixel: [u32; 2], of: &Glossy) -> Receiver {
        receiver(self.view, &self.lights, pixel, of.depth, of.texel)
    }

    /// Computes the prediction of the nodes of level `k` + 1 at cell (x, y) of level `k` (0 for
    /// pixels). At least one coordinate is odd.
    fn predict(
        &self,
        levels: &SubsplatLevels,
        nodes: &[SpecularNode],
        k: u32,
        [x, y]: [u32; 2],
        here: &Glossy,
    ) -> Prediction {
        let [w, h] = levels.grid(k + 1);
        let mut out = Prediction::default();
        let mut total = 0.0;
        let share = if x % 2 == 1 && y % 2 == 1 { 0.25 } else { 0.5 };
        for (slot, (dx, dy)) in CORNERS.into_iter().enumerate() {
            let (cx, cy) = (x / 2 + dx, y / 2 + dy);
            if dx > x % 2 || dy > y % 2 || cx >= w || cy >= h {
                continue;
            }
            let Some(light) = nodes[levels.index(k + 1, cx, cy)].light() else {
                continue;
            };
            let pixel = [cx << (k + 1), cy << (k + 1)];
            let Some(there) = self.glossy(pixel) else {
                continue;
            };
            let weight = share * surface_similarity(here, &there);
            if weight > 0.0 {
                total += weight;
                let at = self.receiver(pixel, &there);
                out.around[slot] = Some(NeighborNode { weight, light, at });
            }
        }
        out.known = total > self.screen.min_similarity;
        if out.known {
            for a in out.around.iter_mut().flatten() {
                a.weight /= total;
                out.light.add(a.weight, &a.light);
            }
        }
        out
    }

    /// Returns the union of the refine masks of level `k` + 1 around cell (x, y) of level `k`. All
    /// bits are set if level `k` + 1 is the coarsest.
    fn combined_refine_masks(
        &self,
        levels: &SubsplatLevels,
        refine_masks: &[[u32; 4]],
        k: u32,
        [x, y]: [u32; 2],
    ) -> [u32; 4] {
        if k + 1 == self.screen.coarsest_level {
            return [u32::MAX; 4];
        }
        let [w, h] = levels.grid(k + 1).map(|edge| edge as i32);
        let (bx, by) = ((x / 2) as i32, (y / 2) as i32);
        let mut out = [0; 4];
        // On an edge, the cells on both sides of it.
        for cy in by - (1 - (y % 2) as i32)..=by + 1 {
            for cx in bx - (1 - (x % 2) as i32)..=bx + 1 {
                if (0..w).contains(&cx) && (0..h).contains(&cy) {
                    let at = refine_mask_index(levels, k + 1, cx as u32, cy as u32);
                    out = core::array::from_fn(|i| out[i] | refine_masks[at][i]);
                }
            }
        }
        out
    }

    /// Computes a node of level `k`, its refine mask, and the number of light evaluations.
    fn node(
        &self,
        levels: &SubsplatLevels,
        nodes: &[SpecularNode],
        refine_masks: &[[u32; 4]],
        k: u32,
        [x, y]: [u32; 2],
    ) -> (SpecularNode, [u32; 4], u64) {
        let none = ([0; 4], 0);
        let nothing = (SpecularNode::default(), none.0, none.1);
        let pixel = [x << k, y << k];
        let Some(here) = self.glossy(pixel) else {
            return nothing;
        };
        let all = u64::from(self.lights.lit.vpls);
        if k == self.screen.coarsest_level {
            return (self.evaluate_all_lights(pixel, &here), none.0, all);
        }
        if x % 2 == 0 && y % 2 == 0 {
            let same = nodes[levels.index(k + 1, x / 2, y / 2)];
            return (same, none.0, none.1);
        }
        let before = self.predict(levels, nodes, k, [x, y], &here);
        let combined_refine_masks = self.combined_refine_masks(levels, refine_masks, k, [x, y]);
        let finer = k >= self.screen.finest_level;
        if before.known && (combined_refine_masks == [0; 4] || !finer) {
            return (SpecularNode::new(&before.light), none.0, none.1);
        }
        if !before.known && !finer {
            return nothing;
        }
        let f0 = gbuffer::f0(here.texel);
        let seen_before = LUMINANCE.dot(before.light.evaluate(f0));
        let max = self.screen.radiance_threshold * (seen_before + FLOOR * FRAC_1_PI);
        if before.known && self.params.together == 1 {
            let node = self.evaluate_all_lights(pixel, &here);
            let found = node.light().unwrap_or_default();
            let off = (LUMINANCE.dot(found.evaluate(f0)) - seen_before).abs();
            let bits = if off > max { u32::MAX } else { 0 };
            return (node, [bits; 4], all);
        }
        let at = self.receiver(pixel, &here);
        let group = self.lights.lights_per_group();
        let (mut light, mut bits, mut count) = (before.light, [0; 4], 0);
        for g in 0..self.lights.lit.vpls.div_ceil(group) {
            if before.known && combined_refine_masks[(g / 32) as usize] >> (g % 32) & 1 == 0 {
                continue;
            }
            let mut change = SpecularRadiance::default();
            for i in g * group..((g + 1) * group).min(self.lights.lit.vpls) {
                let flux = self.view.scale * Vec3::from_array(self.lights.vpls[i as usize].flux);
                let mut found = specular_of_light(&self.lights, i, &at);
                count += 1;
                for a in before.around.iter().flatten().filter(|_| before.known) {
                    let there = specular_of_light(&self.lights, i, &a.at);
                    found.f0 -= a.weight * there.f0;
                    found.f90 -= a.weight * there.f90;
                    count += 1;
                }
                change.f0 += found.f0 * flux;
                change.f90 += found.f90 * flux;
            }
            light.add(1.0, &change);
            if LUMINANCE.dot(change.evaluate(f0)).abs() > max {
                bits[(g / 32) as usize] |= 1 << (g % 32);
            }
        }
        (SpecularNode::new(&light), bits, count)
    }

    /// Evaluates all lights at a pixel.
    fn evaluate_all_lights(&self, pixel: [u32; 2], of: &Glossy) -> SpecularNode {
        let mut light = SpecularRadiance::default();
        let found = specular_at(&self.lights, &self.receiver(pixel, of));
        light.add(self.view.scale, &found);
        SpecularNode::new(&light)
    }

    /// Entry point `vpl_specular_pixels`, for one pixel. Returns radiance times the scale, with 1
    /// in alpha on specular surfaces, and the number of lights evaluated directly for it.
    #[must_use]
    pub fn pixel(
        &self,
        levels: &SubsplatLevels,
        nodes: &[SpecularNode],
        [x, y]: [u32; 2],
    ) -> ([f32; 4], u64) {
        let Some(here) = self.glossy([x, y]) else {
            return ([0.0; 4], 0);
        };
        let known = if x % 2 == 0 && y % 2 == 0 {
            nodes[levels.index(1, x / 2, y / 2)].light()
        } else {
            let before = self.predict(levels, nodes, 0, [x, y], &here);
            before.known.then_some(before.light)
        };
        if let Some(light) = known {
            return (texel(&here, &light), 0);
        }
        let light = self
            .evaluate_all_lights([x, y], &here)
            .light()
            .unwrap_or_default();
        (texel(&here, &light), u64::from(self.lights.lit.vpls))
    }

    /// Evaluates a pixel directly, as at full resolution.
    #[must_use]
    pub fn full(&self, pixel: [u32; 2]) -> [f32; 4] {
        self.glossy(pixel).map_or([0.0; 4], |here| {
            let light = self
                .evaluate_all_lights(pixel, &here)
                .light()
                .unwrap_or_default();
            texel(&here, &light)
        })
    }

    /// Computes all levels without the pixels, in the order in which the device runs them.
    #[must_use]
    pub fn levels(&self) -> SpecularImage {
        let levels = self.screen.levels();
        let mut nodes = vec![SpecularNode::default(); levels.starts[0] as usize];
        let surprised = levels.starts[0] - levels.starts[2];
        let mut refine_masks = vec![[0; 4]; surprised as usize];
        let mut evaluated = vec![0; levels.coarsest_level as usize + 1];
        for k in (1..=levels.coarsest_level).rev() {
            let [w, h] = levels.grid(k);
            let found: Vec<_> = (0..w * h)
                .into_par_iter()
                .map(|i| self.node(&levels, &nodes, &refine_masks, k, [i % w, i / w]))
                .collect();
            for (i, (node, bits, count)) in (0..w * h).zip(found) {
                nodes[levels.index(k, i % w, i / w)] = node;
                if k > 1 {
                    refine_masks[refine_mask_index(&levels, k, i % w, i / w)] = bits;
                }
                evaluated[k as usize] += count;
            }
        }
        SpecularImage {
            texels: Vec::new(),
            nodes,
            refine_masks,
            evaluated,
        }
    }

    /// Computes all levels and pixels.
    #[must_use]
    pub fn run(&self) -> SpecularImage {
        let mut out = self.levels();
        let levels = self.screen.levels();
        let [width, height] = levels.size;
        let alone = AtomicU64::new(0);
        out.texels = (0..width * height)
            .into_par_iter()
            .map(|i| {
                let (texel, count) = self.pixel(&levels, &out.nodes, [i % width, i / width]);
                alone.fetch_add(count, Ordering::Relaxed);
                texel
            })
            .collect();
        out.evaluated[0] = alone.into_inner();
        out
    }
}

/// Specular light of a view, and the number of evaluations.
#[derive(Clone, Debug, PartialEq)]
pub struct SpecularImage {
    /// Radiance times the view's scale of each pixel, and 1 in alpha. All zero without specular
    /// light.
    pub texels: Vec<[f32; 4]>,
    /// Nodes of the levels from 1.
    pub nodes: Vec<SpecularNode>,
    /// Refine masks of the levels from 2.
    pub refine_masks: Vec<[u32; 4]>,
    /// Number of light evaluations of each level. Entry 0 counts pixels that are evaluated
    /// directly.
    pub evaluated: Vec<u64>,
}

/// Steps to the nodes around.
const CORNERS: [(u32, u32); 4] = [(0, 0), (1, 0), (0, 1), (1, 1)];

/// Returns the index of the refine mask of a cell of level 2 or more.
#[must_use]
pub fn refine_mask_index(levels: &SubsplatLevels, k: u32, x: u32, y: u32) -> usize {
    levels.index(k, x, y) - levels.starts[2] as usize
}

/// Returns the similarity of two specular surface points, 0 to 1.
fn surface_similarity(a: &Glossy, b: &Glossy) -> f32 {
    let (p, q) = (&a.seen, &b.seen);
    let off = (q.x - p.x).dot(p.n).abs().max((q.x - p.x).dot(q.n).abs());
    let plane = (2.0 - 2.0 * off / (PLANE * p.reach)).clamp(0.0, 1.0);
    let normal = ((p.n.dot(q.n) - NORMAL_COSINES[0]) / (NORMAL_COSINES[1] - NORMAL_COSINES[0]))
        .clamp(0.0, 1.0);
    let apart = (gbuffer::roughness(a.texel) - gbuffer::roughness(b.texel)).abs();
    let rough = (2.0 - 2.0 * apart / ROUGHNESS_TOLERANCE).clamp(0.0, 1.0);
    // The test uses the ratio of the cosines to the eye. Small cosines change the reflection of all
    // lights.
    let [u, v] = [p, q].map(|s| s.n.dot(-s.x.normalize()).abs());
    let slant = (2.0
        - 2.0 * (u - v).abs() / (VIEW_COSINE_TOLERANCE * (u + v)).max(f32::MIN_POSITIVE))
    .clamp(0.0, 1.0);
    plane * normal * rough * slant
}

fn texel(here: &Glossy, light: &SpecularRadiance) -> [f32; 4] {
    let f0 = gbuffer::f0(here.texel);
    let again = brdf::multiscatter_compensation(gbuffer::roughness(here.texel), f0);
    (here.specular_fraction * again * light.evaluate(f0))
        .min(Vec3::splat(MAX_HALF))
        .extend(1.0)
        .to_array()
}
