//! Kind of links that a transport method computes, with its parameters. It is selected once, before
//! points are scattered.

use super::{FmmRecipe, PcaRecipe};
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
    /// Octree, with links to averages if the recipe has fallback links, see
    /// [`crate::transport::fmm`].
    Octree(FmmRecipe),
}

impl LinkMethod {
    /// Returns `false` for an octree without links.
    pub fn has_links(self) -> bool {
        match self {
            Self::Octree(fmm) => fmm.fallback_links,
            Self::Averages | Self::Components(_) | Self::Differences => true,
        }
    }

    /// Returns `true` if senders on emitters have functions of their own.
    pub fn separates_emitters(self) -> bool {
        self == Self::Averages
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
            Self::Averages | Self::Components(_) | Self::Octree(_) => Deposit::Finest,
        }
    }

    /// Returns `true` if rows use the parents of all coarser levels ([L08] Eq. (17)).
    pub fn has_all_parents(self) -> bool {
        self == Self::Differences
    }

    /// Returns `true` if coarse senders are means over a tree of senders.
    pub fn has_sender_tree(self) -> bool {
        self != Self::Differences && self.has_links()
    }

    /// Returns the form of the operator's rows.
    pub fn form(self) -> SenderForm {
        match self {
            Self::Averages | Self::Octree(_) => SenderForm::Averages,
            Self::Components(_) => SenderForm::Components,
            Self::Differences => SenderForm::Differences,
        }
    }
}
