//! Kernel `refine`: selection of the cells that are divided (\[N09\] §3.3). Entry points: `start`
//! lists the cells of the coarsest level. `refine` lists the children of divided cells of level k.
//! A cell is divided if one of these holds:
//!
//! - It is on the coarsest level.
//! - It is discontinuous ([`pyramid::is_discontinuous`]).
//! - It has a discontinuous diagonal neighbor (\[N09\] §5.2).
//! - Its light differs from its prediction.

use super::gbuffer;
use super::pyramid::{self, CellRange, GbufferView};
use super::subsplat::{LUMINANCE, SubsplatLevels, SubsplatNode, SubsplatParams, state};
use glam::Vec3;

/// Luminance below which differences lose weight, as a fraction of the luminance of a well-exposed
/// white surface.
pub const FLOOR: f32 = 0.1;

/// Packs a cell into a list entry: x in the low half, y in the high half. Pictures are smaller than
/// 65536 pixels.
#[must_use]
pub fn pack_cell(x: u32, y: u32) -> u32 {
    x | y << 16
}

/// Inverse of [`pack_cell`].
#[must_use]
pub fn unpack_cell(word: u32) -> [u32; 2] {
    [word & 0xffff, word >> 16]
}

/// Returns the luminance of a node at its own pixel.
#[must_use]
pub fn luminance(node: &SubsplatNode, normal: Vec3) -> f32 {
    LUMINANCE.dot(node.light().dot(normal).max(Vec3::ZERO))
}

/// Returns `true` if the node at `pixel` was evaluated and differs from its prediction.
fn exceeds_prediction(
    params: &SubsplatParams,
    picture: &GbufferView<'_>,
    node: &SubsplatNode,
    pixel: [u32; 2],
) -> bool {
    if !node.has_bits(state::EVALUATED | state::COVERED) {
        return false;
    }
    let found = luminance(node, gbuffer::normal(picture.texel(params.size, pixel)));
    let predicted_luminance = node.predicted_luminance();
    (found - predicted_luminance).abs()
        > params.radiance_threshold * (0.5 * (found + predicted_luminance) + FLOOR)
}

/// Returns `true` if cell (x, y) of level `k` is divided.
#[must_use]
pub fn divides(
    params: &SubsplatParams,
    picture: &GbufferView<'_>,
    cells: &[CellRange],
    nodes: &[SubsplatNode],
    k: u32,
    [x, y]: [u32; 2],
) -> bool {
    let levels = params.levels();
    if k == params.coarsest_level || pyramid::is_discontinuous(params, &levels, cells, k, x, y) {
        return true;
    }
    let [w, h] = levels.grid(k);
    let is_discontinuous = |dx: i32, dy: i32| {
        let (cx, cy) = (x.checked_add_signed(dx), y.checked_add_signed(dy));
        matches!((cx, cy), (Some(cx), Some(cy)) if cx < w && cy < h
            && pyramid::is_discontinuous(params, &levels, cells, k, cx, cy))
    };
    if params.diagonal != 0
        && [(-1, -1), (1, -1), (-1, 1), (1, 1)]
            .iter()
            .any(|&(dx, dy)| is_discontinuous(dx, dy))
    {
        return true;
    }
    // The nodes at the corners of the cell.
    [(0, 0), (1, 0), (0, 1), (1, 1)].iter().any(|&(dx, dy)| {
        let (cx, cy) = (x + dx, y + dy);
        cx < w && cy < h && {
            let node = &nodes[levels.index(k, cx, cy)];
            exceeds_prediction(params, picture, node, [cx << k, cy << k])
        }
    })
}

/// Entry point `start`: lists all cells of the coarsest level.
#[must_use]
pub fn start(levels: &SubsplatLevels) -> Vec<u32> {
    let [w, h] = levels.grid(levels.coarsest_level);
    (0..h)
        .flat_map(|y| (0..w).map(move |x| pack_cell(x, y)))
        .collect()
}

/// Entry point `refine`: lists the children of the cells of `list` (level `k`) that are divided.
#[must_use]
pub fn refine(
    params: &SubsplatParams,
    picture: &GbufferView<'_>,
    cells: &[CellRange],
    nodes: &[SubsplatNode],
    k: u32,
    list: &[u32],
) -> Vec<u32> {
    let [w, h] = params.levels().grid(k - 1);
    let mut out = Vec::new();
    for &cell in list {
        let [x, y] = unpack_cell(cell);
        if !divides(params, picture, cells, nodes, k, [x, y]) {
            continue;
        }
        for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let (cx, cy) = (2 * x + dx, 2 * y + dy);
            if cx < w && cy < h {
                out.push(pack_cell(cx, cy));
            }
        }
    }
    out
}
