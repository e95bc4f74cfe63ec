//! Subsplats (\[N09\] §3.3): the positions on the screen at which indirect light is evaluated. This
//! module has the parts that the kernels `pyramid`, `refine`, `splat` (nodes) and `upsample` share:
//! settings, parameters, levels, and the node that stores a subsplat's light.
//!
//! Level k divides the screen into cells of 2^k pixels. Every cell has one node, its upper left
//! pixel. Nodes are nested: the node of a cell is also that of one of its children. Refining a cell
//! therefore costs three evaluations, and interpolation between nodes reproduces the evaluated
//! values. \[N09\] evaluates at the middles of cells, which have neither property.
//!
//! A node stores *vector* irradiance (in the axes of the view's world), and a pixel uses the cosine
//! with its own normal. Normal detail therefore needs no subsplats and no modulation as in \[N09\]
//! Eq. (3). That modulation is still available, see [`SubsplatSettings::detail`].

use super::layout::VectorIrradiance;
use super::splat::MAX_HALF;
#[cfg(feature = "bevy_reflect")]
use bevy_reflect::std_traits::ReflectDefault;
use bytemuck::{Pod, Zeroable};
use glam::{Mat3, Mat4, Vec3, Vec4};
use half::f16;

/// Maximum coarsest level: cells of 64 pixels, \[N09\]'s 16² at 1024².
pub const MAX_COARSEST_LEVEL: u32 = 6;
/// Maximum number of levels, including that of the pixels.
pub const LEVELS: usize = MAX_COARSEST_LEVEL as usize + 1;
/// Number of pixels per direct evaluation. If more pixels need one, the others are interpolated
/// from the most similar nodes.
pub const PIXELS_PER_DIRECT_EVALUATION: u32 = 4;

/// Test for discontinuities of depth.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(
    feature = "bevy_reflect",
    derive(bevy_reflect::Reflect),
    reflect(Clone, Debug, PartialEq)
)]
#[non_exhaustive]
pub enum DepthTest {
    /// Distance of a pixel from the plane through its neighbors, as a fraction of its depth times
    /// the cell's edge in pixels. Slanted planes are continuous. Not in \[N09\].
    Plane(f32),
    /// Maximum minus minimum depth, over the minimum (\[N09\] §3.2.1, there in units of length).
    MinMax(f32),
    /// Length of the depth's gradient per pixel, as a fraction of the depth (\[N09\] §3.2.1).
    Derivative(f32),
}

/// Test for discontinuities of the normal.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(
    feature = "bevy_reflect",
    derive(bevy_reflect::Reflect),
    reflect(Clone, Debug, PartialEq)
)]
#[non_exhaustive]
pub enum NormalTest {
    /// Maximum minus minimum of any component (\[N09\] §3.2.2), 0 to 2.
    MinMax(f32),
    /// Maximum curvature between neighbors, κ = 2 sin(arccos(n₁·n₂) / 2) (\[N09\] Eq. (1)), 0 to 2.
    Curvature(f32),
}

/// Settings of multiresolution splatting, \[N09\].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(
    feature = "bevy_reflect",
    derive(bevy_reflect::Reflect),
    reflect(Default, Clone, Debug, PartialEq)
)]
pub struct SubsplatSettings {
    /// Level at which every node is evaluated and every cell is refined once, 2 to
    /// [`MAX_COARSEST_LEVEL`]. Its cells have 2^coarsest_level pixels.
    pub coarsest_level: u32,
    /// Level below which no cell is refined: at least 1, and less than `coarsest_level`. Single
    /// pixels are evaluated if fewer neighbors than [`min_similarity`](Self::min_similarity) are
    /// similar.
    pub finest_level: u32,
    /// Test of depth.
    pub depth: DepthTest,
    /// Test of normals.
    pub normal: NormalTest,
    /// `true` to test the four diagonal neighbors too (\[N09\] §5.2).
    pub diagonal: bool,
    /// Difference between a node's light and its prediction from which a cell is refined, as a
    /// fraction of the light. \[N09\] §3.3.1 compares neighbors, which also refines constant
    /// gradients of light. Infinity means never.
    pub radiance_threshold: f32,
    /// Share of a pixel's surroundings on its own surface up to which the pixel is evaluated
    /// directly.
    pub min_similarity: f32,
    /// α of \[N09\] Eq. (3). It darkens surfaces at grazing angles, as a substitute for detail that
    /// was not refined. 0 turns it off, because vector irradiance does not need it.
    pub detail: f32,
}

impl Default for SubsplatSettings {
    fn default() -> Self {
        Self {
            coarsest_level: 4,
            finest_level: 1,
            depth: DepthTest::Plane(0.05),
            normal: NormalTest::MinMax(1.0),
            diagonal: true,
            radiance_threshold: 0.02,
            min_similarity: 0.35,
            detail: 0.0,
        }
    }
}

impl SubsplatSettings {
    /// Returns the settings with every number clamped to its range.
    #[must_use]
    pub fn clamped(self) -> Self {
        let coarsest = self.coarsest_level.clamp(2, MAX_COARSEST_LEVEL);
        let positive = |v: f32| if v.is_nan() { 0.0 } else { v.max(0.0) };
        Self {
            coarsest_level: coarsest,
            finest_level: self.finest_level.clamp(1, coarsest - 1),
            depth: match self.depth {
                DepthTest::Plane(t) => DepthTest::Plane(positive(t)),
                DepthTest::MinMax(t) => DepthTest::MinMax(positive(t)),
                DepthTest::Derivative(t) => DepthTest::Derivative(positive(t)),
            },
            normal: match self.normal {
                NormalTest::MinMax(t) => NormalTest::MinMax(positive(t)),
                NormalTest::Curvature(t) => NormalTest::Curvature(positive(t)),
            },
            radiance_threshold: positive(self.radiance_threshold),
            min_similarity: positive(self.min_similarity).min(1.0),
            detail: positive(self.detail).min(1.0),
            ..self
        }
    }
}

/// Parameters of a view with subsplats. 240 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct SubsplatParams {
    /// Transform from clip space (reversed depth, y up) to view space (view direction −Z), column
    /// by column.
    pub view_from_clip: [[f32; 4]; 4],
    /// Rotation of world-space normals to view space: three columns.
    pub view_from_world: [[f32; 4]; 3],
    /// The viewport in texels: x, y, width, height.
    pub viewport: [f32; 4],
    /// Size of the targets in texels.
    pub size: [u32; 2],
    /// Coarsest level.
    pub coarsest_level: u32,
    /// Finest level of refined cells.
    pub finest_level: u32,
    /// 0 [`DepthTest::Plane`], 1 [`DepthTest::MinMax`], 2 [`DepthTest::Derivative`].
    pub depth_test: u32,
    /// 0 [`NormalTest::MinMax`], 1 [`NormalTest::Curvature`].
    pub normal_test: u32,
    /// Threshold of the depth test.
    pub depth_threshold: f32,
    /// Threshold of the normal test.
    pub normal_threshold: f32,
    /// See [`SubsplatSettings::radiance_threshold`].
    pub radiance_threshold: f32,
    /// See [`SubsplatSettings::min_similarity`].
    pub min_similarity: f32,
    /// See [`SubsplatSettings::detail`].
    pub detail: f32,
    /// 1 to test diagonal neighbors.
    pub diagonal: u32,
    /// First cell of each level. Level 0 contains the pixels that are evaluated directly and is
    /// last. Two vectors of four, the last element not used.
    pub starts: [[u32; 4]; 2],
}

/// Bits of [`SubsplatNode::state`].
pub mod state {
    /// The result is known: light, or no light.
    pub const KNOWN: u32 = 1;
    /// Light is present: a basis function covers the node, or a virtual point light lights it.
    pub const COVERED: u32 = 2;
    /// Evaluated here, not interpolated.
    pub const EVALUATED: u32 = 4;
    /// Bits of the missing fraction: the part of the light that surface functions leave to probe
    /// irradiance, in 255ths.
    pub const PROBE_FRACTION: u32 = 0xff00;

    /// Returns these bits for a given share of the light that is present.
    #[must_use]
    pub fn probe_fraction(share: f32) -> u32 {
        ((255.0 * (1.0 - share) + 0.5) as u32) << 8
    }
}

/// Light at a node, as half floats. 24 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct SubsplatNode {
    /// Half floats, two per word, the first in the low bits. First the vector irradiance times the
    /// view's scale (x, y, z of red, green, blue each, so x.r x.g, x.b y.r, …). Then the predicted
    /// luminance. The last word holds the state.
    pub words: [u32; 6],
}

impl SubsplatNode {
    /// A node without a value.
    pub const UNKNOWN: Self = Self { words: [0; 6] };

    /// Creates a node from scaled light, the predicted luminance, and state bits.
    #[must_use]
    pub fn new(e: &VectorIrradiance, predicted_luminance: f32, state: u32) -> Self {
        let [x, y, z] = [e.x, e.y, e.z];
        Self {
            words: [
                pack(x[0], x[1]),
                pack(x[2], y[0]),
                pack(y[1], y[2]),
                pack(z[0], z[1]),
                pack(z[2], predicted_luminance),
                state,
            ],
        }
    }

    /// Returns the light of the node.
    #[must_use]
    pub fn light(&self) -> VectorIrradiance {
        let h: [[f32; 2]; 5] = core::array::from_fn(|i| unpack(self.words[i]));
        VectorIrradiance {
            x: [h[0][0], h[0][1], h[1][0], 0.0],
            y: [h[1][1], h[2][0], h[2][1], 0.0],
            z: [h[3][0], h[3][1], h[4][0], 0.0],
        }
    }

    /// Returns the predicted luminance.
    #[must_use]
    pub fn predicted_luminance(&self) -> f32 {
        unpack(self.words[4])[1]
    }

    /// Returns the bits of [`state`].
    #[must_use]
    pub fn state(&self) -> u32 {
        self.words[5]
    }

    /// Returns the missing fraction of the node's light, 0 to 1. It is 1 if no surface function
    /// covers the node.
    #[must_use]
    pub fn probe_fraction(&self) -> f32 {
        if self.has_bits(state::COVERED) {
            ((self.words[5] & state::PROBE_FRACTION) >> 8) as f32 / 255.0
        } else {
            1.0
        }
    }

    /// Returns `true` if all of `bits` are set.
    #[must_use]
    pub fn has_bits(&self, bits: u32) -> bool {
        self.words[5] & bits == bits
    }
}

fn pack(a: f32, b: f32) -> u32 {
    let bits = |v: f32| u32::from(f16::from_f32(v.clamp(-MAX_HALF, MAX_HALF)).to_bits());
    bits(a) | bits(b) << 16
}

fn unpack(word: u32) -> [f32; 2] {
    [word as u16, (word >> 16) as u16].map(|bits| f16::from_bits(bits).to_f32())
}

/// Weights of the channels in differences of light (Rec. 709).
pub const LUMINANCE: Vec3 = Vec3::new(0.2126, 0.7152, 0.0722);

/// Levels of a view: their numbers of cells and their positions in the arrays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SubsplatLevels {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Coarsest level.
    pub coarsest_level: u32,
    /// First cell of each level, level 0 last.
    pub starts: [u32; LEVELS],
}

impl SubsplatLevels {
    /// Creates levels 1 to `coarsest_level` of a picture, and the pixels evaluated directly.
    #[must_use]
    pub fn new(size: [u32; 2], coarsest: u32) -> Self {
        let mut levels = Self {
            size,
            coarsest_level: coarsest,
            starts: [0; LEVELS],
        };
        let mut next = 0;
        for k in 1..=coarsest {
            levels.starts[k as usize] = next;
            next += levels.cells(k);
        }
        levels.starts[0] = next;
        levels
    }

    /// Returns the columns and rows of level `k`.
    #[must_use]
    pub fn grid(&self, k: u32) -> [u32; 2] {
        self.size.map(|edge| edge.div_ceil(1 << k))
    }

    /// Returns the number of cells of level `k`. For level 0, returns the maximum number of pixels
    /// that are evaluated directly.
    #[must_use]
    pub fn cells(&self, k: u32) -> u32 {
        let [w, h] = self.grid(k);
        match k {
            0 => (w * h).div_ceil(PIXELS_PER_DIRECT_EVALUATION),
            _ => w * h,
        }
    }

    /// Returns the length of an array with an element for each cell of all levels.
    #[must_use]
    pub fn total(&self) -> u32 {
        self.starts[0] + self.cells(0)
    }

    /// Returns the index of cell (x, y) of level `k`, 1 or more.
    #[must_use]
    pub fn index(&self, k: u32, x: u32, y: u32) -> usize {
        (self.starts[k as usize] + y * self.grid(k)[0] + x) as usize
    }
}

impl SubsplatParams {
    /// Creates the parameters of a view from its matrices, the viewport in texels and the size of
    /// its targets.
    #[must_use]
    pub fn new(
        settings: &SubsplatSettings,
        view_from_clip: Mat4,
        view_from_world: Mat4,
        viewport: [f32; 4],
        size: [u32; 2],
    ) -> Self {
        let settings = settings.clamped();
        let (depth_test, depth_threshold) = match settings.depth {
            DepthTest::Plane(t) => (0, t),
            DepthTest::MinMax(t) => (1, t),
            DepthTest::Derivative(t) => (2, t),
        };
        let (normal_test, normal_threshold) = match settings.normal {
            NormalTest::MinMax(t) => (0, t),
            NormalTest::Curvature(t) => (1, t),
        };
        let turn = |c: Vec4| c.truncate().normalize_or_zero().extend(0.0).to_array();
        let levels = SubsplatLevels::new(size, settings.coarsest_level);
        let s = levels.starts;
        Self {
            view_from_clip: view_from_clip.to_cols_array_2d(),
            view_from_world: [
                view_from_world.x_axis,
                view_from_world.y_axis,
                view_from_world.z_axis,
            ]
            .map(turn),
            viewport,
            size,
            coarsest_level: settings.coarsest_level,
            finest_level: settings.finest_level,
            depth_test,
            normal_test,
            depth_threshold,
            normal_threshold,
            // WGSL has no literal for infinity.
            radiance_threshold: settings.radiance_threshold.min(1e30),
            min_similarity: settings.min_similarity,
            detail: settings.detail,
            diagonal: u32::from(settings.diagonal),
            starts: [[s[0], s[1], s[2], s[3]], [s[4], s[5], s[6], 0]],
        }
    }

    /// Returns the levels.
    #[must_use]
    pub fn levels(&self) -> SubsplatLevels {
        SubsplatLevels::new(self.size, self.coarsest_level)
    }

    /// Rotates world-space normals to view space.
    #[must_use]
    pub fn turn(&self) -> Mat3 {
        let [x, y, z] = self.view_from_world.map(|c| Vec4::from_array(c).truncate());
        Mat3::from_cols(x, y, z)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn subsplat_nodes_preserve_irradiance() {
        let e = VectorIrradiance {
            x: [1.0, -2.0, 3.5, 0.0],
            y: [0.25, 1e9, -1e9, 0.0],
            z: [0.0, 7.0, 0.125, 0.0],
        };
        let node = SubsplatNode::new(&e, 0.75, state::KNOWN | state::COVERED);
        let back = node.light();
        assert_eq!((back.x, back.z), (e.x, e.z));
        assert_eq!(back.y, [0.25, MAX_HALF, -MAX_HALF, 0.0]);
        assert_eq!(node.predicted_luminance(), 0.75);
        assert!(node.has_bits(state::COVERED) && !node.has_bits(state::EVALUATED | state::KNOWN));
    }

    #[test]
    fn subsplat_levels_are_stored_consecutively() {
        let levels = SubsplatLevels::new([67, 41], 4);
        assert_eq!(levels.grid(4), [5, 3]);
        assert_eq!(levels.index(1, 0, 0), 0);
        assert_eq!(levels.index(2, 0, 0), 34 * 21);
        assert_eq!(levels.starts[0] as usize, levels.index(4, 4, 2) + 1);
        assert_eq!(levels.total(), levels.starts[0] + (67 * 41u32).div_ceil(4));
    }

    #[test]
    fn subsplat_settings_out_of_range_are_clamped() {
        let wild = SubsplatSettings {
            coarsest_level: 99,
            finest_level: 99,
            depth: DepthTest::MinMax(f32::NAN),
            radiance_threshold: -1.0,
            min_similarity: 7.0,
            ..SubsplatSettings::default()
        };
        let tame = wild.clamped();
        assert_eq!(
            (tame.coarsest_level, tame.finest_level),
            (MAX_COARSEST_LEVEL, MAX_COARSEST_LEVEL - 1)
        );
        assert_eq!((tame.radiance_threshold, tame.min_similarity), (0.0, 1.0));
        assert_eq!(tame.depth, DepthTest::MinMax(0.0));
    }
}
