//! Progress and cancellation of a bake.

#[cfg(feature = "bevy_reflect")]
use bevy_reflect::std_traits::ReflectDefault;
use std::fmt;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

/// Stage of a bake, as reported to users.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(
    feature = "bevy_reflect",
    derive(bevy_reflect::Reflect),
    reflect(Default, Clone, Debug, PartialEq, Hash)
)]
#[non_exhaustive]
pub enum BakeStage {
    /// Waiting for the scene to load. Only bakes in a running app have this stage.
    #[default]
    Waiting,
    /// Collecting triangles and building the BVH.
    Geometry,
    /// Scattering points.
    Points,
    /// Gathering and refining the operator.
    Transport,
    /// Gathering probes.
    Probes,
    /// Packing rows and bounding their energy.
    Packing,
    /// Baking later bounces.
    Bounces,
    /// Baking visibility.
    Visibility,
    /// Estimating the error.
    ErrorEstimate,
}

impl BakeStage {
    /// Stages of a bake after the scene has loaded, in their order.
    const LOADED: [Self; 8] = [
        Self::Geometry,
        Self::Points,
        Self::Transport,
        Self::Probes,
        Self::Packing,
        Self::Bounces,
        Self::Visibility,
        Self::ErrorEstimate,
    ];

    /// Returns the name for users.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Waiting => "waiting for assets",
            Self::Geometry => "building the BVH",
            Self::Points => "scattering points",
            Self::Transport => "gathering light",
            Self::Probes => "gathering light of probes",
            Self::Packing => "packing links",
            Self::Bounces => "baking bounces",
            Self::Visibility => "baking visibility",
            Self::ErrorEstimate => "measuring the error",
        }
    }
}

impl fmt::Display for BakeStage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
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
    /// Returns the current stage, and its completed fraction from 0 to 1.
    #[must_use]
    pub fn get(&self) -> (BakeStage, f32) {
        let index = self.stage.load(Ordering::Relaxed) as usize;
        let stage = BakeStage::LOADED[index.min(BakeStage::LOADED.len() - 1)];
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

    /// Stores the completed fraction of `stage`. It never decreases within a stage. Returns `false`
    /// if the bake should stop.
    pub(crate) fn set(&self, stage: BakeStage, done: f32) -> bool {
        let index = BakeStage::LOADED
            .iter()
            .position(|&s| s == stage)
            .unwrap_or(0) as u32;
        let permille = (done.clamp(0.0, 1.0) * 1000.0) as u32;
        if self.stage.swap(index, Ordering::Relaxed) == index {
            self.permille.fetch_max(permille, Ordering::Relaxed);
        } else {
            self.permille.store(permille, Ordering::Relaxed);
        }
        !self.is_canceled()
    }
}
