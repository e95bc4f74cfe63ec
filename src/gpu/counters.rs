//! Counters of recorded work.

use super::EntryPoint;

/// Work that a frame has recorded since its creation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GpuCounters {
    /// Number of dispatches of each entry point, in the order of [`EntryPoint::ALL`].
    pub dispatches: [u64; EntryPoint::COUNT],
    /// Number of projected light slots.
    pub projected: u64,
    /// Number of recorded solves.
    pub solves: u64,
    /// Number of triangles drawn by `composite`.
    pub composites: u64,
    /// Number of triangles drawn by `fog`.
    pub fogs: u64,
}

impl Default for GpuCounters {
    fn default() -> Self {
        Self {
            dispatches: [0; EntryPoint::COUNT],
            projected: 0,
            solves: 0,
            composites: 0,
            fogs: 0,
        }
    }
}

impl GpuCounters {
    /// Returns the number of dispatches of `entry_point`.
    #[must_use]
    pub fn dispatches_of(&self, entry_point: EntryPoint) -> u64 {
        self.dispatches[entry_point as usize]
    }

    /// Adds the work of other counters.
    pub fn add(&mut self, more: &Self) {
        for (sum, more) in self.dispatches.iter_mut().zip(more.dispatches) {
            *sum += more;
        }
        self.projected += more.projected;
        self.solves += more.solves;
        self.composites += more.composites;
        self.fogs += more.fogs;
    }

    /// Returns the work recorded since the counters were `before`.
    #[must_use]
    pub fn difference_from(&self, before: &Self) -> Self {
        Self {
            dispatches: core::array::from_fn(|i| self.dispatches[i] - before.dispatches[i]),
            projected: self.projected - before.projected,
            solves: self.solves - before.solves,
            composites: self.composites - before.composites,
            fogs: self.fogs - before.fogs,
        }
    }

    /// Returns the number of all dispatches.
    #[must_use]
    pub fn total(&self) -> u64 {
        self.dispatches.iter().sum()
    }
}
