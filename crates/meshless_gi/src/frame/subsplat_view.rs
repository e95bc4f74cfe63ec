//! Multiresolution splatting of a view on the CPU: the kernels `pyramid`, `refine`, `splat` (nodes)
//! and `upsample` in the order in which the device runs them.

use super::pyramid::{GbufferView, pyramid};
use super::refine::{refine, start, unpack_cell};
use super::subsplat::{LEVELS, SubsplatNode, SubsplatParams};
use super::upsample::{PixelResolve, fill, resolve, upsample};
use rayon::prelude::*;

/// Counts of subsplat evaluations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SubsplatCounts {
    /// Evaluations per level. Level 0 counts the pixels evaluated directly.
    pub evaluated: [u32; LEVELS],
    /// Pixels of the view.
    pub pixels: u32,
}

impl SubsplatCounts {
    /// Returns the number of all evaluations.
    #[must_use]
    pub fn total(&self) -> u32 {
        self.evaluated.iter().sum()
    }
}

/// Light of a view, and the number of evaluations.
#[derive(Clone, Debug, PartialEq)]
pub struct Subsplats {
    /// Irradiance times the view's scale of each pixel, and 1 in alpha. All zero without light.
    pub texels: Vec<[f32; 4]>,
    /// Nodes of all levels. See [`SubsplatLevels`](super::SubsplatLevels).
    pub nodes: Vec<SubsplatNode>,
    /// Cell list of each level.
    pub lists: Vec<Vec<u32>>,
    /// Number of evaluations.
    pub counts: SubsplatCounts,
}

/// Runs the kernels of the screen. `evaluate` computes the light at a pixel and stores it in the
/// node.
#[must_use]
pub fn subsplats(
    params: &SubsplatParams,
    picture: &GbufferView<'_>,
    evaluate: &(dyn Fn([u32; 2], &mut SubsplatNode) + Sync),
) -> Subsplats {
    let levels = params.levels();
    let [width, height] = params.size;
    let cells = pyramid(params, picture);
    let mut nodes = vec![SubsplatNode::UNKNOWN; levels.total() as usize];
    let mut counts = SubsplatCounts {
        pixels: width * height,
        ..SubsplatCounts::default()
    };
    let mut lists = vec![Vec::new(); LEVELS];
    let mut list = start(&levels);
    for k in (1..=params.coarsest_level).rev() {
        if k < params.coarsest_level {
            upsample(params, picture, k, &mut nodes);
        }
        // Nodes of even cells are those of the next coarser level.
        let requested: Vec<[u32; 2]> = list
            .iter()
            .map(|&cell| unpack_cell(cell))
            .filter(|[x, y]| k == params.coarsest_level || x % 2 == 1 || y % 2 == 1)
            .collect();
        let found: Vec<(usize, SubsplatNode)> = requested
            .par_iter()
            .map(|&[x, y]| {
                let at = levels.index(k, x, y);
                let mut node = nodes[at];
                evaluate([x << k, y << k], &mut node);
                (at, node)
            })
            .collect();
        counts.evaluated[k as usize] = found.len() as u32;
        for (at, node) in found {
            nodes[at] = node;
        }
        let next = if k > params.finest_level && k > 1 {
            refine(params, picture, &cells, &nodes, k, &list)
        } else {
            Vec::new()
        };
        lists[k as usize] = core::mem::replace(&mut list, next);
    }
    let resolved: Vec<PixelResolve> = (0..width * height)
        .into_par_iter()
        .map(|i| resolve(params, picture, &nodes, [i % width, i / width]))
        .collect();
    let room = levels.cells(0) as usize;
    let holes: Vec<u32> = (0..width * height)
        .filter(|&i| matches!(resolved[i as usize], PixelResolve::NeedsEvaluation(_)))
        .take(room)
        .collect();
    let mut texels: Vec<[f32; 4]> = resolved
        .into_iter()
        .map(|r| match r {
            PixelResolve::Texel(t) | PixelResolve::NeedsEvaluation(t) => t,
        })
        .collect();
    let filled: Vec<(SubsplatNode, [f32; 4])> = holes
        .par_iter()
        .map(|&i| {
            let pixel = [i % width, i / width];
            let mut node = SubsplatNode::UNKNOWN;
            evaluate(pixel, &mut node);
            (node, fill(params, picture, &node, pixel))
        })
        .collect();
    counts.evaluated[0] = holes.len() as u32;
    for (slot, (&i, (node, texel))) in holes.iter().zip(filled).enumerate() {
        nodes[levels.starts[0] as usize + slot] = node;
        texels[i as usize] = texel;
        lists[0].push(super::refine::pack_cell(i % width, i / width));
    }
    Subsplats {
        texels,
        nodes,
        lists,
        counts,
    }
}
