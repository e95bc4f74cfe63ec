//! Number of diffuse reflections that a scene is solved with: as many as its surfaces need. The
//! bake bounds the share of the light that a reflection leaves
//! ([`EnergyInfo::spectral_radius_bound`](meshless_gi::EnergyInfo::spectral_radius_bound), design
//! D12). After n reflections, about gainⁿ of the light of all reflections is missing at most. Dark
//! scenes need two or three reflections, white rooms ten.

use super::GiBounceCount;
use meshless_gi::internals::frame::materials::dynamic_surfaces;
use meshless_gi::{BakedScene, FrameSettings, MaterialFactors};
use std::fmt;

/// Largest share of all light that the omitted reflections may carry, estimated from the gain.
pub const MAX_TRUNCATED_FRACTION: f32 = 0.03;
/// Largest number of reflections that is chosen without a setting. Each takes time in every frame
/// in which the light changes.
pub const MAX_AUTO_BOUNCES: u32 = 16;
/// Number of reflections for a bake without a bound on the gain.
const DEFAULT_BOUNCES: u32 = 4;
/// A choice and its reason.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BounceSelection {
    /// Number of diffuse reflections, 1 or more.
    pub bounces: u32,
    /// `true` if a setting fixes the number.
    pub forced: bool,
    /// Bound on the share of the light that a reflection leaves. `None` if the bake has no bound.
    pub gain: Option<f32>,
}

impl BounceSelection {
    /// Returns the reason of the choice.
    #[must_use]
    pub fn reason(&self) -> String {
        match (self.forced, self.gain) {
            (true, _) => "requested".into(),
            (false, None) => "the bake stores no gain".into(),
            (false, Some(gain)) => format!(
                "surfaces return {:.0} % of the light at most, and more would add {:.1} % at most",
                100.0 * gain,
                100.0 * gain.powi(self.bounces as i32)
            ),
        }
    }
}

impl fmt::Display for BounceSelection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} reflections: {}", self.bounces, self.reason())
    }
}

/// Returns the number of reflections for a gain: the smallest that leaves
/// [`MAX_TRUNCATED_FRACTION`] at most. The limit is [`MAX_AUTO_BOUNCES`].
#[must_use]
pub fn bounces_for_spectral_radius(gain: f32) -> u32 {
    match gain {
        g if g <= MAX_TRUNCATED_FRACTION => 1,
        g if g < 1.0 => (MAX_TRUNCATED_FRACTION.ln() / g.ln())
            .ceil()
            .min(MAX_AUTO_BOUNCES as f32) as u32,
        // Includes NaN.
        _ => MAX_AUTO_BOUNCES,
    }
}

/// Selects the number of reflections of one scene with one bake, frame by frame. Dynamic
/// materials raise the number in the same frame and never lower it, so nothing flickers.
#[derive(Clone, Debug, Default)]
pub struct BounceSelector {
    /// Largest gain that was requested so far.
    gain: f32,
    /// Factors of the materials at the last request.
    factors: Vec<MaterialFactors>,
}

impl BounceSelector {
    /// Creates a selector without history.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Returns the number of reflections of this frame's solve: `requested`, or the number that the
    /// bake's surfaces need with these factors of its materials. Without factors, the materials are
    /// as baked. Returns `None` for a bake that holds its bounces.
    pub fn select(
        &mut self,
        requested: GiBounceCount,
        bake: &BakedScene,
        factors: &[MaterialFactors],
    ) -> Option<BounceSelection> {
        if bake.data().bounces.is_some() {
            return None;
        }
        let baked = bake.info().energy.spectral_radius_bound;
        let known = baked.is_finite() && baked > 0.0;
        if known && (self.gain < baked || self.factors != factors) {
            self.factors = factors.to_vec();
            self.gain = self.gain.max(max_spectral_radius(bake, factors));
        }
        let gain = known.then_some(self.gain);
        let max = FrameSettings::MAX_SWEEPS + 1;
        Some(BounceSelection {
            bounces: match (requested, gain) {
                (GiBounceCount::Fixed(bounces), _) => bounces.clamp(1, max),
                (GiBounceCount::Auto, Some(gain)) => bounces_for_spectral_radius(gain),
                (GiBounceCount::Auto, None) => DEFAULT_BOUNCES,
            },
            forced: requested != GiBounceCount::Auto,
            gain,
        })
    }
}

/// Returns a bound on the share of the light that a reflection leaves with these factors of the
/// materials. It is the bake's bound times the largest factor by which a base color exceeds the
/// baked one. It never exceeds the albedo of the brightest surface, because a row of the operator
/// covers one hemisphere at most.
fn max_spectral_radius(bake: &BakedScene, factors: &[MaterialFactors]) -> f32 {
    let baked = bake.info().energy.spectral_radius_bound;
    let Some(dynamic) = &bake.data().materials else {
        return baked;
    };
    let pairs = dynamic.factors.iter().zip(factors);
    let colors = pairs.flat_map(|(baked, now)| baked.base_color.into_iter().zip(now.base_color));
    let growth = colors
        .filter(|(baked, now)| now > baked)
        // Infinite where the baked color was black.
        .map(|(baked, now)| now / baked.max(0.0))
        .fold(1.0, f32::max);
    if growth <= 1.0 {
        return baked;
    }
    let surfaces = dynamic_surfaces(bake.data(), factors).unwrap_or_default();
    let albedos = surfaces.iter().flat_map(|s| s.albedo);
    let brightest = albedos.fold(0.0, f32::max);
    (baked * growth).min(brightest).max(baked)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounce_count_falls_with_albedo() {
        let found = [0.0, 0.03, 0.031, 0.1, 0.3, 0.5, 0.58, 0.7, 0.8, 0.95, 1.0]
            .map(bounces_for_spectral_radius);
        assert_eq!(found, [1, 1, 2, 2, 3, 6, 7, 10, 16, 16, 16]);
        assert_eq!(
            [f32::NAN, f32::INFINITY, 1.5].map(bounces_for_spectral_radius),
            [MAX_AUTO_BOUNCES; 3]
        );
        for gain in [0.04f32, 0.2, 0.41, 0.6, 0.75] {
            let n = bounces_for_spectral_radius(gain) as i32;
            assert!(
                gain.powi(n) <= MAX_TRUNCATED_FRACTION && gain.powi(n - 1) > MAX_TRUNCATED_FRACTION,
                "{gain}"
            );
        }
    }

    #[test]
    fn bounce_reason_states_truncated_fraction() {
        let selection = |bounces, forced, gain| BounceSelection {
            bounces,
            forced,
            gain,
        };
        assert_eq!(
            selection(7, false, Some(0.58)).to_string(),
            "7 reflections: surfaces return 58 % of the light at most, and more would add 2.2 % at most"
        );
        let requested = selection(2, true, Some(0.58)).to_string();
        assert_eq!(requested, "2 reflections: requested");
        assert!(
            selection(4, false, None)
                .reason()
                .contains("stores no gain")
        );
    }
}
