//! Sparse transport operator in the layout that bake, asset, frame and GPU share.
//!
//! A row belongs to a point (same index) and lists links to senders. A link depends on geometry
//! only (design D1): F_ij = (1/π) ∫ B_j(r(x_i, ω)) ω dω ([L08] Eq. (16) without ρ). It is a
//! dimensionless 3-vector with |F_ij| ≤ 1. The vector irradiance at the point is
//! E⃗_i = Σ_j F_ij b_j, with the sender's radiosity coefficient b_j in W/m².

use super::pca::Compression;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use half::f16;

/// Link: three f16 numbers relative to its row's scale, and the sender's index. 8 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Link {
    /// x in the low half, y in the high half, both f16.
    pub xy: u32,
    /// z as f16 in the low half, the sender's index in the high half.
    pub z_sender: u32,
}

impl Link {
    /// Maximum number of senders of an operator. A link has 16 bits for the index. The last index
    /// is the sky (the last nine, if the bake has the sky's terms).
    pub const MAX_SENDERS: usize = 65_535;

    /// Packs `vector / scale` and `sender`. `scale` must be positive and at least the largest
    /// absolute component.
    #[must_use]
    pub fn pack(vector: Vec3, scale: f32, sender: u16) -> Self {
        let v = vector / scale;
        let bits = |f: f32| u32::from(f16::from_f32(f).to_bits());
        Self {
            xy: bits(v.x) | bits(v.y) << 16,
            z_sender: bits(v.z) | u32::from(sender) << 16,
        }
    }

    /// Returns the vector relative to the row's scale.
    #[must_use]
    #[inline]
    pub fn vector(self) -> Vec3 {
        // `to_f32_const` is inlined. `to_f32` selects the instructions of the processor on every
        // call.
        let half = |bits: u32| f16::from_bits(bits as u16).to_f32_const();
        Vec3::new(half(self.xy), half(self.xy >> 16), half(self.z_sender))
    }

    /// Returns the index of the sender or of the column.
    #[must_use]
    #[inline]
    pub fn sender(self) -> u32 {
        self.z_sender >> 16
    }
}

/// Range of a point's links. 16 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Row {
    /// First link.
    pub start: u32,
    /// Number of links. A row of tier 0 has none.
    pub count: u32,
    /// Scale of every link's vector.
    pub scale: f32,
    /// Smallest tier of a frame that uses the row, from 1 on (design D11). In frames of lower tiers
    /// the point takes its value from its parents. 0 if the point has no row.
    pub tier: u32,
}

impl Row {
    /// Returns `true` if a frame of this tier uses the row.
    #[must_use]
    #[inline]
    pub fn used(&self, tier: u32) -> bool {
        self.tier != 0 && self.tier <= tier
    }
}

/// Coefficients of a sender that links multiply.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
pub enum SenderForm {
    /// Radiosity averaged over the sender's support, the pulled values f_j. Rows replace the
    /// prediction and keep their mass (method `bounded`). An inactive point takes the weighted mean
    /// of its parents in the next coarser level.
    Averages,
    /// Differences to the coarser levels, α_j of \[L08\] Eq. (7). Rows are differences too, Eq.
    /// (17) (method `l08`).
    Differences,
    /// Coefficients of the senders' radiosity in light bases, one basis per cluster
    /// ([`Compression`]). Rows replace the prediction. An inactive point takes the weighted mean of
    /// its parents, as with averages (method `pca`, \[P14\] Eq. (10)).
    Components,
}

impl SenderForm {
    /// Returns `true` if a point without a row takes its parents' mean.
    #[must_use]
    pub fn has_independent_rows(self) -> bool {
        self != Self::Differences
    }
}

/// One-bounce operator G, from sender radiosity to vector irradiance at every point.
#[derive(Clone, Debug, PartialEq)]
pub struct Operator {
    /// Coefficients that links multiply.
    pub form: SenderForm,
    /// One row per point.
    pub rows: Vec<Row>,
    /// All links, in the order of tiers, then of rows, then of senders. The links of a tier and of
    /// those below it are a prefix. The sender with the index "number of senders" (of columns, in
    /// the form of components) is the sky. Its coefficient is π times the sky's radiance. The eight
    /// terms of a sky that is not uniform follow it ([`SkyRadiance`](crate::scene::SkyRadiance)).
    pub links: Vec<Link>,
    /// Code of the step of each row's quantized links (`link_quantization`), 0 for rows that are
    /// not quantized. Empty if no row is.
    pub steps: Vec<u8>,
    /// Code by which links to each sender have a smaller step, the sky last
    /// ([`precision_of`](super::precision_of)). Empty if no row is quantized.
    pub precision: Vec<u8>,
    /// Map from senders to the columns that links of the form of components use. `None` in other
    /// forms.
    pub compression: Option<Compression>,
}

impl Operator {
    /// Largest number of tiers.
    pub const MAX_TIERS: u32 = 16;

    /// Returns the number of coefficients of links without the sky: columns in the form of
    /// components, otherwise `senders`.
    #[must_use]
    pub fn coefficients(&self, senders: usize) -> usize {
        self.compression
            .as_ref()
            .map_or(senders, Compression::components)
    }

    /// Returns the number of tiers, at least 1.
    #[must_use]
    pub fn tiers(&self) -> u32 {
        self.rows
            .iter()
            .map(|row| row.tier)
            .max()
            .unwrap_or(0)
            .max(1)
    }

    /// Returns the number of rows and links that a frame of each tier uses, tier 1 first.
    #[must_use]
    pub fn tier_sizes(&self) -> Vec<(u64, u64)> {
        let mut sizes = vec![(0, 0); self.tiers() as usize];
        for row in self.rows.iter().filter(|row| row.tier > 0) {
            let size = &mut sizes[row.tier as usize - 1];
            size.0 += 1;
            size.1 += u64::from(row.count);
        }
        for t in 1..sizes.len() {
            let below = sizes[t - 1];
            sizes[t].0 += below.0;
            sizes[t].1 += below.1;
        }
        sizes
    }
}

/// Returns the points with rows in the order of their links: by tier, then by index.
#[must_use]
pub fn row_order(rows: &[Row]) -> Vec<u32> {
    let mut order = Vec::with_capacity(rows.len());
    order.extend((0..rows.len() as u32).filter(|&i| rows[i as usize].tier != 0));
    order.sort_unstable_by_key(|&i| (rows[i as usize].tier, i));
    order
}

/// Sets the start of each row's links from tiers and counts. Returns the number of links, or `None`
/// if it exceeds 32 bits.
#[must_use]
pub fn place_links(rows: &mut [Row]) -> Option<u32> {
    let order = row_order(rows);
    let mut start = 0u32;
    for row in rows.iter_mut() {
        row.start = 0;
    }
    for i in order {
        let row = &mut rows[i as usize];
        row.start = start;
        start = start.checked_add(row.count)?;
    }
    Some(start)
}

/// Entry of the baked bounces, per color channel since it includes albedo. 16 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct BounceLink {
    /// Dimensionless gain per color channel.
    pub gain: [f32; 3],
    /// Index of the sender, never the sky.
    pub sender: u32,
}

/// Baked second and later bounces, S = T + T² + … (\[L08\] Eq. (15)) without its first and last
/// gather. The operator maps the senders' direct radiosity to the later radiosity of the coarsest
/// points (\[L08\] §3.2: "using only the coarsest functions as receivers").
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BounceOperator {
    /// Start of each coarsest point's entries, and the end of the last.
    pub starts: Vec<u32>,
    /// Entries, senders ascending within a row.
    pub links: Vec<BounceLink>,
    /// Number of diffuse bounces beyond the first.
    pub bounces: u32,
}
