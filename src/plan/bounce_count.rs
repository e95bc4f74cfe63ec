//! How many diffuse reflections a scene is solved with: as many as its surfaces call for. The bake
//! has proved what a reflection leaves of the light at most
//! ([`EnergyInfo::spectral_radius_bound`](meshless_gi::EnergyInfo::spectral_radius_bound), design
//! D12), so after n of them no more than gainⁿ of what all of them give is missing, about: dark
//! levels need two or three, white rooms ten.

use super::GiBounceCount;
use meshless_gi::internals::frame::materials::live_surfaces;
use meshless_gi::{BakedScene, FrameSettings, MaterialFactors};
use std::fmt;

/// What the reflections that are left out may be of all light, by the gain.
pub const MAX_TRUNCATED_FRACTION: f32 = 0.03;
/// Most reflections, where no setting asks for more: each takes its time in every frame in which
/// the light changes.
pub const MAX_AUTO_BOUNCES: u32 = 16;
/// Where a bake does not say what a reflection leaves.
const UNKNOWN: u32 = 4;
/// A choice and its reason.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BounceSelection {
    /// Diffuse reflections in all, 1 or more.
    pub bounces: u32,
    /// A setting says so: nothing else has a say.
    pub forced: bool,
    /// What a reflection leaves of the light at most; none where the bake does not say so.
    pub gain: Option<f32>,
}

impl BounceSelection {
    /// Why.
    #[must_use]
    pub fn why(&self) -> String {
        match (self.forced, self.gain) {
            (true, _) => "so many are asked for".into(),
            (false, None) => "the bake does not say what surfaces return".into(),
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
        write!(f, "{} reflections: {}", self.bounces, self.why())
    }
}

/// How many reflections a frame takes at a gain: the fewest that leave [`MAX_TRUNCATED_FRACTION`]
/// at most, and [`MAX_AUTO_BOUNCES`] where that is more.
#[must_use]
pub fn bounces_for_spectral_radius(gain: f32) -> u32 {
    match gain {
        g if g <= MAX_TRUNCATED_FRACTION => 1,
        g if g < 1.0 => (MAX_TRUNCATED_FRACTION.ln() / g.ln())
            .ceil()
            .min(MAX_AUTO_BOUNCES as f32) as u32,
        // Also what is no number.
        _ => MAX_AUTO_BOUNCES,
    }
}

/// Picks, frame by frame, for one scene with one bake. What live materials ask for goes up at once
/// and never down: there is nothing to see when they go dark, and nothing flickers.
#[derive(Clone, Debug, Default)]
pub struct BounceSelector {
    /// The largest gain that was asked for so far.
    gain: f32,
    /// The factors of the materials that it was asked for last.
    factors: Vec<MaterialFactors>,
}

impl BounceSelector {
    /// Nothing seen yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// What this frame's solve takes: `asked`, or as many as the bake's surfaces call for with
    /// these factors of its materials (as they were baked where there are none). None for a bake
    /// that holds its bounces.
    pub fn pick(
        &mut self,
        asked: GiBounceCount,
        bake: &BakedScene,
        factors: &[MaterialFactors],
    ) -> Option<BounceSelection> {
        if bake.bounces.is_some() {
            return None;
        }
        let baked = bake.info.energy.spectral_radius_bound;
        let known = baked.is_finite() && baked > 0.0;
        if known && (self.gain < baked || self.factors != factors) {
            self.factors = factors.to_vec();
            self.gain = self.gain.max(live_gain(bake, factors));
        }
        let gain = known.then_some(self.gain);
        let most = FrameSettings::MAX_SWEEPS + 1;
        Some(BounceSelection {
            bounces: match (asked, gain) {
                (GiBounceCount::Fixed(bounces), _) => bounces.clamp(1, most),
                (GiBounceCount::Auto, Some(gain)) => bounces_for_spectral_radius(gain),
                (GiBounceCount::Auto, None) => UNKNOWN,
            },
            forced: asked != GiBounceCount::Auto,
            gain,
        })
    }
}

/// A bound on what a reflection leaves of the light with these factors of the materials: the
/// bake's, times the largest factor by which a base color is above the baked one; and never more
/// than the brightest surface, for a row of the operator holds no more than the hemisphere.
fn live_gain(bake: &BakedScene, factors: &[MaterialFactors]) -> f32 {
    let baked = bake.info.energy.spectral_radius_bound;
    let Some(live) = &bake.materials else {
        return baked;
    };
    let pairs = live.factors.iter().zip(factors);
    let colors = pairs.flat_map(|(baked, now)| baked.base_color.into_iter().zip(now.base_color));
    let growth = colors
        .filter(|(baked, now)| now > baked)
        // Infinite where it was black.
        .map(|(baked, now)| now / baked.max(0.0))
        .fold(1.0, f32::max);
    if growth <= 1.0 {
        return baked;
    }
    let surfaces = live_surfaces(bake, factors).unwrap_or_default();
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
        let picked = |bounces, forced, gain| BounceSelection {
            bounces,
            forced,
            gain,
        };
        assert_eq!(
            picked(7, false, Some(0.58)).to_string(),
            "7 reflections: surfaces return 58 % of the light at most, and more would add 2.2 % at most"
        );
        let asked = picked(2, true, Some(0.58)).to_string();
        assert_eq!(asked, "2 reflections: so many are asked for");
        assert!(picked(4, false, None).why().contains("does not say"));
    }
}
