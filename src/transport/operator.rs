//! The sparse transport operator in the layout that bake, asset, frame and GPU share.
//!
//! A row belongs to a point (same index) and lists links to senders. A link holds geometry only (design D1):
//! F_ij = (1/π) ∫ B_j(r(x_i, ω)) ω dω, a dimensionless 3-vector with |F_ij| ≤ 1 ([L08] Eq. (16) without ρ). The vector
//! irradiance at the point is E⃗_i = Σ_j F_ij b_j, with b_j the sender's radiosity coefficient in W/m².

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use half::f16;

/// A link: three halves, relative to its row's scale, and the sender's index. 8 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Link {
    /// x in the low half, y in the high half, both f16.
    pub xy: u32,
    /// z as f16 in the low half, the sender's index in the high half.
    pub z_sender: u32,
}

impl Link {
    /// Most senders an operator may have: a link has 16 bits for the index, and the last one is the sky.
    pub const MAX_SENDERS: usize = 65_535;

    /// Packs `vector / scale` and `sender`. `scale` must be positive and no component larger than it.
    #[must_use]
    pub fn pack(vector: Vec3, scale: f32, sender: u16) -> Self {
        let v = vector / scale;
        let bits = |f: f32| u32::from(f16::from_f32(f).to_bits());
        Self {
            xy: bits(v.x) | bits(v.y) << 16,
            z_sender: bits(v.z) | u32::from(sender) << 16,
        }
    }

    /// The vector relative to the row's scale.
    #[must_use]
    #[inline]
    pub fn vector(self) -> Vec3 {
        let half = |bits: u32| f16::from_bits(bits as u16).to_f32();
        Vec3::new(half(self.xy), half(self.xy >> 16), half(self.z_sender))
    }

    /// The sender's index.
    #[must_use]
    #[inline]
    pub fn sender(self) -> u32 {
        self.z_sender >> 16
    }
}

/// Where the links of a point are. 16 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Row {
    /// First link.
    pub start: u32,
    /// How many links. A row that is not active has none.
    pub count: u32,
    /// Multiplies every link's vector.
    pub scale: f32,
    /// 1 where the point has a row of its own; 0 where it takes its value from its parents.
    pub active: u32,
}

/// Which coefficients of a sender the links multiply.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
pub enum SenderForm {
    /// Radiosity averaged over the sender's support, the pulled values f_j; rows stand alone and keep their mass
    /// (rule `bounded`). An inactive point takes the weighted mean of its parents one level up.
    Averages,
    /// Differences to the coarser levels, α_j of \[L08\] Eq. (7); rows are differences too, Eq. (17) (rule `l08`).
    Differences,
}

/// The one-bounce operator G: sender radiosity to vector irradiance at every point.
#[derive(Clone, Debug, PartialEq)]
pub struct Operator {
    /// What the links multiply.
    pub form: SenderForm,
    /// One row a point.
    pub rows: Vec<Row>,
    /// All links, row after row, senders ascending within a row. The sender with the index "number of senders" is
    /// the sky: its coefficient is π times the sky's radiance.
    pub links: Vec<Link>,
}

/// One entry of the baked bounces, RGB because albedo is inside. 16 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct BounceLink {
    /// Dimensionless gain per colour channel.
    pub gain: [f32; 3],
    /// The sender's index (never the sky's).
    pub sender: u32,
}

/// The baked second and later bounces, S = T + T² + … (\[L08\] Eq. (15)) without its first and last gather: from the
/// senders' direct radiosity to the further radiosity of the coarsest points (\[L08\] §3.2: "using only the coarsest
/// functions as receivers").
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BounceOperator {
    /// Where each coarsest point's entries start; one more than there are coarsest points.
    pub starts: Vec<u32>,
    /// The entries, senders ascending within a row.
    pub links: Vec<BounceLink>,
    /// How many diffuse reflections the operator holds beyond the first.
    pub bounces: u32,
}
