//! Whether a device holds the octree of rule `fmm`: where it does not, frames go through the links
//! on the same points, if the bake has any.

use meshless_gi::BakedScene;
use meshless_gi::internals::frame::fmm_layout::MAX_FMM_ORDER;
use meshless_gi::internals::transport::fmm::FmmOperator;
use std::fmt;

/// Why a device does not hold an octree.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FmmLimit {
    /// Its expansions have more terms than a workgroup's memory.
    Order {
        /// The highest order that kernels take.
        have: u64,
        /// Its order.
        need: u64,
    },
    /// One of its arrays is larger than the device binds.
    TooLarge {
        /// Which.
        what: &'static str,
        /// Its bytes.
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

/// Whether a device that binds `largest` bytes at most runs the octree. Its expansions are most
/// often what does not fit: larger leaves or a lower order make them smaller.
///
/// # Errors
/// The limit that it does not keep.
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
        ("fmm points", size_of_val(&octree.places[..]) as u64),
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

/// Why frames of `scene` go through its links and not through its octree on a device that binds
/// `largest` bytes; nothing where the octree runs, where there is none, and where there are no
/// links in its place.
#[must_use]
pub fn falls_back(scene: &BakedScene, largest: u64) -> Option<FmmLimit> {
    let why = octree_fits(scene.fmm.as_ref()?, largest).err();
    why.filter(|_| scene.link_tiers() > 0)
}
