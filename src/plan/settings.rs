//! Settings of a baked scene that the plan reads: quality, number of bounces, color channels.

#[cfg(feature = "bevy")]
use bevy::{ecs::reflect::ReflectComponent, reflect::std_traits::ReflectDefault};
use std::time::Duration;

/// Requested quality of a scene's indirect light: it selects the tier of the operator. Goes on the
/// root, next to `GiScene`, which adds the default. It can change in any frame.
///
/// The selected tier and the reason are in `GiActiveTier` and in the log of the plan.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(
    feature = "bevy",
    derive(bevy::ecs::component::Component, bevy::reflect::Reflect),
    reflect(Component, Default, Clone, Debug, PartialEq)
)]
#[non_exhaustive]
pub enum GiQuality {
    /// All links of the bake.
    #[default]
    Full,
    /// Tier of this number, from 1 (fewest links). A number that the bake does not have selects the
    /// nearest tier.
    Tier(u32),
    /// Lowest tier whose estimated NRMSE is at most this value, 0.05 for 5 %. The upper end of the
    /// 95 % confidence interval counts. All links if no tier meets it.
    MaxError(f32),
    /// Highest tier whose solves take at most this GPU time. Needs Bevy's
    /// `RenderDiagnosticsPlugin` and timestamp queries. Without them all links are used.
    GpuBudget(Duration),
}

/// Milliseconds of a GPU budget.
pub(super) fn milliseconds(budget: Duration) -> f32 {
    (1e3 * budget.as_secs_f64()) as f32
}

/// Number of diffuse bounces of a scene's indirect light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(
    feature = "bevy",
    derive(bevy::reflect::Reflect),
    reflect(Default, Clone, Debug, PartialEq, Hash)
)]
#[non_exhaustive]
pub enum GiBounceCount {
    /// Smallest number whose truncation error is below 3 % by the bake's bound, at most 16.
    #[default]
    Auto,
    /// Fixed number, 1 (direct light reflected once) to 256. Values outside are clamped.
    Fixed(u32),
}

/// Color channels of a scene's solve. One channel costs less. It is exact if every surface is gray
/// and all light has one chromaticity.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(
    feature = "bevy",
    derive(bevy::reflect::Reflect),
    reflect(Default, Clone, Debug, PartialEq, Hash)
)]
#[non_exhaustive]
pub enum GiColorMode {
    /// One channel where it is exact, three elsewhere. A light of another color switches to three
    /// channels in the frame in which it is turned on. The plan logs the choice and the reason.
    #[default]
    Auto,
    /// Three channels.
    Rgb,
    /// One channel. If colors differ, the green channel is used and indirect light is white.
    Monochrome,
}
