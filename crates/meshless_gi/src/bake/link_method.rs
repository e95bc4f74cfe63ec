//! Kind of links that a transport method computes. It is selected once, before points are
//! scattered.

use super::{BakeSettings, PcaRecipe, TransportMethod};
use crate::transport::{Deposit, SenderForm};

/// C of the senders' functions: the smallest overlap that covers a saturated Poisson-disk set (C =
/// 1) with a margin.
const SENDER_OVERLAP: f32 = 1.25;

/// Links of a bake.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum LinkMethod {
    /// Links to averages of senders, see [`crate::transport::bounded_truncation`].
    Averages,
    /// Links to components of light bases, see [`crate::transport::pca`].
    Components(PcaRecipe),
    /// Links to differences of senders, see [`crate::transport::l08_truncation`].
    Differences,
    /// Octree without links.
    Octree,
}

impl LinkMethod {
    pub fn new(settings: &BakeSettings) -> Self {
        match settings.transport {
            TransportMethod::Bounded => Self::Averages,
            TransportMethod::L08 => Self::Differences,
            TransportMethod::Pca(pca) => Self::Components(pca),
            TransportMethod::Fmm(fmm) if fmm.fallback_links => Self::Averages,
            TransportMethod::Fmm(_) => Self::Octree,
        }
    }

    /// Returns the overlap of the senders' functions. Returns `None` for the functions of the
    /// hierarchy.
    pub fn sender_overlap(self) -> Option<f32> {
        (self != Self::Differences).then_some(SENDER_OVERLAP)
    }

    /// Returns the senders that get the deposit of a gather ray.
    pub fn deposit(self) -> Deposit {
        match self {
            Self::Differences => Deposit::All,
            Self::Averages | Self::Components(_) | Self::Octree => Deposit::Finest,
        }
    }

    /// Returns `true` if rows use the parents of all coarser levels ([L08] Eq. (17)).
    pub fn has_all_parents(self) -> bool {
        self == Self::Differences
    }

    /// Returns `true` if coarse senders are means over a tree of senders.
    pub fn has_sender_tree(self) -> bool {
        matches!(self, Self::Averages | Self::Components(_))
    }

    /// Returns the form of the operator's rows.
    pub fn form(self) -> SenderForm {
        match self {
            Self::Averages | Self::Octree => SenderForm::Averages,
            Self::Components(_) => SenderForm::Components,
            Self::Differences => SenderForm::Differences,
        }
    }
}
