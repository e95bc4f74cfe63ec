//! Progress and cancellation of a bake.

use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

/// Stage of a bake that users see.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(
    feature = "bevy_reflect",
    derive(bevy_reflect::Reflect),
    reflect(Clone, Debug, PartialEq, Hash)
)]
#[non_exhaustive]
pub enum BakeStage {
    /// Building the BVH.
    Bvh,
    /// Scattering points.
    Points,
    /// Gathering and refining the operator.
    Transport,
    /// Gathering probes.
    Probes,
    /// Baking later bounces.
    Bounces,
    /// Baking visibility.
    Visibility,
    /// Estimating the error.
    ErrorEstimate,
}

impl BakeStage {
    const ALL: [Self; 7] = [
        Self::Bvh,
        Self::Points,
        Self::Transport,
        Self::Probes,
        Self::Bounces,
        Self::Visibility,
        Self::ErrorEstimate,
    ];

    /// Name for users.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Bvh => "building the BVH",
            Self::Points => "scattering points",
            Self::Transport => "gathering light",
            Self::Probes => "gathering light in free space",
            Self::Bounces => "baking bounces",
            Self::Visibility => "baking visibility",
            Self::ErrorEstimate => "measuring the error",
        }
    }
}

/// Progress of a bake, shared between threads.
#[derive(Debug, Default)]
pub struct Progress {
    stage: AtomicU32,
    permille: AtomicU32,
    canceled: AtomicBool,
}

impl Progress {
    /// Current stage, and the completed part of it from 0 to 1.
    #[must_use]
    pub fn get(&self) -> (BakeStage, f32) {
        let stage = BakeStage::ALL
            [(self.stage.load(Ordering::Relaxed) as usize).min(BakeStage::ALL.len() - 1)];
        (stage, self.permille.load(Ordering::Relaxed) as f32 / 1000.0)
    }

    /// Cancels the bake. It returns [`BakeError::Canceled`](super::BakeError) soon after.
    pub fn cancel(&self) {
        self.canceled.store(true, Ordering::Relaxed);
    }

    /// Returns `true` after [`cancel`](Self::cancel).
    #[must_use]
    pub fn is_canceled(&self) -> bool {
        self.canceled.load(Ordering::Relaxed)
    }

    /// Stores the completed part of `stage`. It never falls within a stage. Returns `false` if the
    /// bake should stop.
    pub(crate) fn set(&self, stage: BakeStage, done: f32) -> bool {
        let index = BakeStage::ALL.iter().position(|&s| s == stage).unwrap_or(0) as u32;
        let permille = (done.clamp(0.0, 1.0) * 1000.0) as u32;
        if self.stage.swap(index, Ordering::Relaxed) == index {
            self.permille.fetch_max(permille, Ordering::Relaxed);
        } else {
            self.permille.store(permille, Ordering::Relaxed);
        }
        !self.is_canceled()
    }
}
