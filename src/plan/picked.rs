//! [`TierSelection`]: the tier of the operator that a scene is lit with, and why.
//! [`TierController`](super::TierController) says it.

use std::fmt;

/// A choice and its reason.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TierSelection {
    /// The tier, from 1 on.
    pub tier: u32,
    /// How many there are.
    pub tiers: u32,
    /// It is the octree of rule `fmm`; else, some or all of the links.
    pub octree: bool,
    /// Links that a solve reads ([`TierCandidate::work`](super::TierCandidate::work)).
    pub work: u64,
    /// A setting names the tier: nothing else has a say.
    pub forced: bool,
    /// Why this one.
    pub why: String,
}

impl fmt::Display for TierSelection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let octree = if self.octree { ", the octree" } else { "" };
        write!(
            f,
            "tier {} of {}{octree}: {}",
            self.tier, self.tiers, self.why
        )
    }
}
