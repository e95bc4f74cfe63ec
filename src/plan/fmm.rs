//! Limits of a device for the octree of method `fmm`. If it exceeds one, frames use the links on
//! the same points, if the bake has any.

use meshless_gi::BakedScene;
use meshless_gi::internals::frame::fmm_layout::MAX_FMM_ORDER;
use meshless_gi::internals::transport::fmm::FmmOperator;
use std::fmt;

/// Limit that keeps an octree off a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FmmLimit {
    /// Its expansions have more terms than a workgroup's memory.
    Order {
        /// Highest order that the kernels support.
        have: u64,
        /// Order of the octree.
        need: u64,
    },
    /// One of its arrays is larger than the device binds.
    TooLarge {
        /// Name of the array.
        what: &'static str,
        /// Size of the array, bytes.
        needs: u64,
        /// Bytes that the device binds.
        has: u64,
    },
}

impl fmt::Display for FmmLimit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Order { have, need } => {
                write!(f, "the octree's order is {need}, the kernels take {have}")
            }
            Self::TooLarge { what, needs, has } => {
                write!(f, "{what} take {needs} bytes, the device binds {has}")
            }
        }
    }
}

/// Checks that a device that binds `largest` bytes at most can run the octree. Most often the
/// expansions are too large: larger leaves or a lower order make them smaller.
///
/// # Errors
/// Returns the limit that the octree exceeds.
pub fn octree_fits(octree: &FmmOperator, largest: u64) -> Result<(), FmmLimit> {
    if octree.order as usize > MAX_FMM_ORDER {
        return Err(FmmLimit::Order {
            have: MAX_FMM_ORDER as u64,
            need: octree.order.into(),
        });
    }
    let arrays = [
        ("fmm nodes", size_of_val(&octree.nodes[..]) as u64),
        ("fmm lists", size_of_val(&octree.entries[..]) as u64),
        ("fmm points", size_of_val(&octree.points[..]) as u64),
        ("fmm expansions", octree.expansion_bytes()),
    ];
    match arrays.into_iter().find(|(_, bytes)| *bytes > largest) {
        Some((what, needs)) => Err(FmmLimit::TooLarge {
            what,
            needs,
            has: largest,
        }),
        None => Ok(()),
    }
}

/// Returns the reason why frames of `scene` use links in place of its octree on a device that binds
/// `largest` bytes. Returns `None` if the octree runs, if there is none, or if there are no links
/// to replace it.
#[must_use]
pub fn fmm_fallback_reason(scene: &BakedScene, largest: u64) -> Option<FmmLimit> {
    let reason = octree_fits(scene.data().fmm.as_ref()?, largest).err();
    reason.filter(|_| scene.data().link_tiers() > 0)
}
