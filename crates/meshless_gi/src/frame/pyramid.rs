//! Kernel `pyramid`: discontinuities of a view, per cell and level (\[N09\] §3.2). A cell stores
//! minima and maxima of linear depth and of the normal's components. If a test measures pixels, the
//! cell stores the largest measure of a pixel instead. Entry points: `base` (pixels to level 1) and
//! `reduce` (a level to the next).
//!
//! Thresholds are relative to depth, those of \[N09\] are lengths. The same settings therefore fit
//! a room and a landscape.

use super::gbuffer;
use super::subsplat::{SubsplatLevels, SubsplatParams};
use bytemuck::{Pod, Zeroable};
use glam::{Mat4, Vec2, Vec3, Vec4};

/// Depth of a pixel without geometry, meters.
pub const BACKGROUND_DEPTH: f32 = 1e30;

/// Upper limit of a depth slope.
pub const MAX_SLOPE: f32 = 1e9;

/// Ranges of depth and normal of a cell's pixels. 16 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct CellRange {
    /// Smallest depth, meters. 0 if the test measures pixels.
    pub near: f32,
    /// Largest depth, meters, or the largest measure of a pixel.
    pub far: f32,
    /// Smallest components of the normal (WGSL's `pack4x8snorm`). 0 for curvature.
    pub low: u32,
    /// Largest components of the normal, or the largest curvature (the bits of a float).
    pub high: u32,
}

/// Depth and G-buffer of a rendered view.
#[derive(Clone, Copy, Debug)]
pub struct GbufferView<'a> {
    /// Reversed depth, row by row from the top. 0 if nothing was drawn.
    pub depth: &'a [f32],
    /// Texels of the G-buffer. See [`gbuffer`].
    pub gbuffer: &'a [[u32; 4]],
}

impl GbufferView<'_> {
    /// Returns the index of a pixel in the arrays.
    fn at(&self, size: [u32; 2], pixel: [u32; 2]) -> usize {
        (pixel[1] * size[0] + pixel[0]) as usize
    }

    /// Returns the reversed depth of a pixel, or 0 if the pixel is unlit.
    #[must_use]
    pub fn depth(&self, size: [u32; 2], pixel: [u32; 2]) -> f32 {
        let i = self.at(size, pixel);
        if gbuffer::is_unlit(self.gbuffer[i]) {
            0.0
        } else {
            self.depth[i]
        }
    }

    /// Returns the G-buffer texel of a pixel.
    #[must_use]
    pub fn texel(&self, size: [u32; 2], pixel: [u32; 2]) -> [u32; 4] {
        self.gbuffer[self.at(size, pixel)]
    }
}

/// Surface in a pixel, in view space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VisibleSurface {
    /// Position in view space, meters. −z is the linear depth.
    pub x: Vec3,
    /// Unit normal.
    pub n: Vec3,
    /// Reference length of depth tolerances, meters. See [`reach`].
    pub reach: f32,
}

/// Maximum reference length of depth tolerances, in pixel widths. Equals the distance of a picture
/// 2000 pixels high with a vertical angle of 64°, in pixel widths.
pub const MAX_REACH_PIXELS: f32 = 1600.0;

/// Returns the reference length of depth tolerances, meters. It is a pixel's linear depth `z`, as
/// in \[N09\], limited to [`MAX_REACH_PIXELS`] of its widths there. Through a long lens or with
/// parallel rays, objects one pixel wide are a small part of their distance but have edges.
#[must_use]
pub fn reach(params: &SubsplatParams, z: f32, depth: f32) -> f32 {
    let m = &params.view_from_clip;
    let w = m[2][3] * depth + m[3][3];
    let width = 2.0 * m[1][1].abs() / (params.viewport[3] * w.abs()).max(f32::MIN_POSITIVE);
    z.abs().min(MAX_REACH_PIXELS * width)
}

/// Returns the view-space position of a pixel with this reversed depth.
#[must_use]
pub fn view_position(params: &SubsplatParams, pixel: [u32; 2], depth: f32) -> Vec3 {
    let [left, top, width, height] = params.viewport;
    let at = (Vec2::new(pixel[0] as f32, pixel[1] as f32) + 0.5 - Vec2::new(left, top))
        / Vec2::new(width, height);
    let ndc = Vec4::new(at.x * 2.0 - 1.0, 1.0 - at.y * 2.0, depth, 1.0);
    let h = Mat4::from_cols_array_2d(&params.view_from_clip) * ndc;
    h.truncate() / h.w
}

/// Returns the surface that a pixel shows. Returns `None` if it has no lit surface.
#[must_use]
pub fn visible_surface(
    params: &SubsplatParams,
    picture: &GbufferView<'_>,
    pixel: [u32; 2],
) -> Option<VisibleSurface> {
    let depth = picture.depth(params.size, pixel);
    (depth > 0.0).then(|| VisibleSurface {
        x: view_position(params, pixel, depth),
        n: params.turn() * gbuffer::normal(picture.texel(params.size, pixel)),
        reach: reach(params, view_position(params, pixel, depth).z, depth),
    })
}

/// Returns the linear depth, meters, or [`BACKGROUND_DEPTH`] if `depth` is 0.
fn linear(params: &SubsplatParams, pixel: [u32; 2], depth: f32) -> f32 {
    if depth > 0.0 {
        -view_position(params, pixel, depth).z
    } else {
        BACKGROUND_DEPTH
    }
}

/// Returns the pixel (dx, dy) further, clamped to the picture.
fn neighbors_of(size: [u32; 2], pixel: [u32; 2], dx: i32, dy: i32) -> [u32; 2] {
    let step = |at: u32, by: i32, edge: u32| at.saturating_add_signed(by).min(edge - 1);
    [step(pixel[0], dx, size[0]), step(pixel[1], dy, size[1])]
}

/// Computes the contribution of a pixel to its cell.
fn measure(params: &SubsplatParams, picture: &GbufferView<'_>, pixel: [u32; 2]) -> CellRange {
    let size = params.size;
    let depth = |p: [u32; 2]| picture.depth(size, p);
    let d = depth(pixel);
    let z = linear(params, pixel, d);
    let (near, far) = match params.depth_test {
        0 => {
            let mut max = 0.0f32;
            for (dx, dy) in [(1, 0), (0, 1)] {
                let (a, b) = (
                    neighbors_of(size, pixel, -dx, -dy),
                    neighbors_of(size, pixel, dx, dy),
                );
                // At the picture's edge there is one neighbor only.
                if d > 0.0 && a != pixel && b != pixel {
                    // Depth is linear in screen space over a plane, in both kinds of projection.
                    let on_plane = linear(params, pixel, 0.5 * (depth(a) + depth(b)));
                    max = max.max((on_plane - z).abs() / reach(params, z, d));
                }
            }
            (0.0, max)
        }
        1 => (z, z),
        _ => {
            let change = |dx, dy| {
                let p = neighbors_of(size, pixel, dx, dy);
                let other = linear(params, p, depth(p));
                // The slope from geometry to background has the largest value.
                ((other - z).abs() / other.min(z)).min(MAX_SLOPE)
            };
            (0.0, Vec2::new(change(1, 0), change(0, 1)).length())
        }
    };
    let normal = |p: [u32; 2]| gbuffer::normal(picture.texel(size, p));
    // Unlit pixels contribute their depth only.
    let (low, high) = if d <= 0.0 {
        EMPTY
    } else if params.normal_test == 0 {
        let packed = pack_snorm(normal(pixel));
        (packed, packed)
    } else {
        let curvature = |dx, dy| {
            let p = neighbors_of(size, pixel, dx, dy);
            if depth(p) <= 0.0 {
                return 0.0;
            }
            // 2 sin(arccos(c) / 2) = √(2 − 2c).
            (2.0 - 2.0 * normal(pixel).dot(normal(p))).max(0.0).sqrt()
        };
        (0, curvature(1, 0).max(curvature(0, 1)).to_bits())
    };
    CellRange {
        near,
        far,
        low,
        high,
    }
}

/// Minimum and maximum of a cell without normals, the neutral values of `min` and `max`.
pub const EMPTY: (u32, u32) = (0x007f_7f7f, 0x0081_8181);

fn join(params: &SubsplatParams, a: &CellRange, b: &CellRange) -> CellRange {
    let (low, high) = if params.normal_test == 0 {
        (min_bytes(a.low, b.low), max_bytes(a.high, b.high))
    } else {
        // Bits of positive floats have the order of the floats. Empty cells measure 0.
        let of = |cell: &CellRange| if cell.low == EMPTY.0 { 0 } else { cell.high };
        (0, of(a).max(of(b)))
    };
    CellRange {
        near: a.near.min(b.near),
        far: a.far.max(b.far),
        low,
        high,
    }
}

fn bytes(word: u32) -> [i8; 4] {
    word.to_le_bytes().map(|b| b as i8)
}

fn each(a: u32, b: u32, of: fn(i8, i8) -> i8) -> u32 {
    let (a, b) = (bytes(a), bytes(b));
    u32::from_le_bytes(core::array::from_fn(|i| of(a[i], b[i]) as u8))
}

fn min_bytes(a: u32, b: u32) -> u32 {
    each(a, b, i8::min)
}

fn max_bytes(a: u32, b: u32) -> u32 {
    each(a, b, i8::max)
}

/// Computes WGSL's `pack4x8snorm` of (v, 0).
fn pack_snorm(v: Vec3) -> u32 {
    let byte = |c: f32| (0.5 + 127.0 * c.clamp(-1.0, 1.0)).floor() as i32 as u8;
    u32::from_le_bytes([byte(v.x), byte(v.y), byte(v.z), 0])
}

/// Computes level 1, cell by cell (entry point `base`).
pub fn base(params: &SubsplatParams, picture: &GbufferView<'_>, cells: &mut [CellRange]) {
    let levels = params.levels();
    let [w, h] = levels.grid(1);
    for y in 0..h {
        for x in 0..w {
            cells[levels.index(1, x, y)] = four(params, levels.size, x, y, |px, py| {
                measure(params, picture, [px, py])
            });
        }
    }
}

/// Computes level `k` from level `k` − 1 (entry point `reduce`).
pub fn reduce(params: &SubsplatParams, k: u32, cells: &mut [CellRange]) {
    let levels = params.levels();
    let [w, h] = levels.grid(k);
    for y in 0..h {
        for x in 0..w {
            cells[levels.index(k, x, y)] = four(params, levels.grid(k - 1), x, y, |cx, cy| {
                cells[levels.index(k - 1, cx, cy)]
            });
        }
    }
}

/// Computes all levels.
#[must_use]
pub fn pyramid(params: &SubsplatParams, picture: &GbufferView<'_>) -> Vec<CellRange> {
    let mut cells = vec![CellRange::default(); params.levels().starts[0] as usize];
    base(params, picture, &mut cells);
    for k in 2..=params.coarsest_level {
        reduce(params, k, &mut cells);
    }
    cells
}

/// Joins the up to four children of a cell that are within `grid`.
fn four(
    params: &SubsplatParams,
    grid: [u32; 2],
    x: u32,
    y: u32,
    child: impl Fn(u32, u32) -> CellRange,
) -> CellRange {
    let mut out = child(2 * x, 2 * y);
    for (dx, dy) in [(1, 0), (0, 1), (1, 1)] {
        let (cx, cy) = (2 * x + dx, 2 * y + dy);
        if cx < grid[0] && cy < grid[1] {
            out = join(params, &out, &child(cx, cy));
        }
    }
    out
}

/// Returns `true` if cell (x, y) of level `k` is not continuous.
#[must_use]
pub fn is_discontinuous(
    params: &SubsplatParams,
    levels: &SubsplatLevels,
    cells: &[CellRange],
    k: u32,
    x: u32,
    y: u32,
) -> bool {
    let cell = &cells[levels.index(k, x, y)];
    let depth = match params.depth_test {
        0 => cell.far * (1u32 << k) as f32 > params.depth_threshold,
        1 => cell.far - cell.near > params.depth_threshold * cell.near,
        _ => cell.far > params.depth_threshold,
    };
    let normal = if params.normal_test == 0 {
        let (low, high) = (bytes(cell.low), bytes(cell.high));
        (0..3).any(|i| f32::from(high[i]) - f32::from(low[i]) > 127.0 * params.normal_threshold)
    } else {
        f32::from_bits(cell.high) > params.normal_threshold && cell.low != EMPTY.0
    };
    depth || normal
}
