//! [`TierSelection`]: the operator tier of a scene, and its reason.
//! [`TierController`](super::TierController) returns it.

use std::fmt;

/// Selected tier and the reason of the choice.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TierSelection {
    /// Number of the tier, from 1.
    pub tier: u32,
    /// Number of tiers.
    pub tiers: u32,
    /// `true` for the octree of method `fmm`, `false` for some or all links.
    pub octree: bool,
    /// Number of links that a solve reads ([`TierCandidate::work`](super::TierCandidate::work)).
    pub work: u64,
    /// `true` if a setting names the tier.
    pub forced: bool,
    /// Reason of the choice.
    pub reason: String,
}

impl fmt::Display for TierSelection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let octree = if self.octree { ", the octree" } else { "" };
        write!(
            f,
            "tier {} of {}{octree}: {}",
            self.tier, self.tiers, self.reason
        )
    }
}
