//! Probes: recipe, placement and gathered rows.

use super::recipe::{RecipeError, in_range};
use super::{BakeError, BakeStage, Progress};
use crate::asset::Probes;
use crate::basis::{Hierarchy, probe_basis};
use crate::samples::{ProbePlacementSettings, place_probes};
use crate::scene::Bounds;
use crate::transport::{
    GatherSettings, PackSettings, SenderForm, SenderTree, Training, UnindexedLinkTerm, pack,
    probe_rows,
};
#[cfg(feature = "bevy_reflect")]
use bevy_reflect::std_traits::ReflectDefault;
use glam::Vec3;
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// Irradiance probes in open space, for dynamic objects.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(
    feature = "bevy_reflect",
    derive(bevy_reflect::Reflect),
    reflect(Default, Clone, Debug, PartialEq)
)]
#[cfg_attr(feature = "documentation", derive(documented::DocumentedFields))]
#[serde(default, deny_unknown_fields)]
pub struct ProbeSettings {
    /// Distance between mutually visible probes, in meters, 1e-9 to 1e9. Default: about 2048 probes
    /// in the bounding box of the scene. Halving it takes eight times more probes.
    pub spacing: Option<f32>,
    /// Number of gather rays per probe, 64 to 65536. Default: twice those of a surface point.
    #[serde(alias = "rays")]
    pub rays_per_probe: Option<u32>,
}

/// Approximate number of probes for the automatic spacing.
pub const PROBES: f32 = 2048.0;

/// [`ProbeSettings`] with every value filled in.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ResolvedProbeSettings {
    /// See [`ProbeSettings::spacing`].
    pub spacing: f32,
    /// See [`ProbeSettings::rays_per_probe`].
    pub rays: u32,
}

impl ProbeSettings {
    /// Checks every value.
    pub(super) fn check(&self) -> Result<(), RecipeError> {
        in_range("probes.spacing", self.spacing, 1e-9..=1e9)?;
        in_range("probes.rays_per_probe", self.rays_per_probe, 64..=65_536)
    }

    /// Returns the settings for a scene with these `bounds` and `rays` per surface point.
    #[must_use]
    pub fn settings(&self, bounds: &Bounds, rays: u32) -> ResolvedProbeSettings {
        // A flat scene has a box without volume. Its height is at least a tenth of its width.
        let size = bounds.size();
        let size = size.max(Vec3::splat(0.1 * size.max_element()));
        let usual = (size.x * size.y * size.z / PROBES).cbrt();
        ResolvedProbeSettings {
            spacing: self.spacing.unwrap_or(usual).max(f32::MIN_POSITIVE),
            rays: self
                .rays_per_probe
                .unwrap_or(rays.saturating_mul(2))
                .max(64),
        }
    }
}

/// Input of the probes' bake.
pub(super) struct ProbeInput<'a> {
    pub gathering: &'a GatherSettings<'a>,
    pub hierarchy: &'a Hierarchy,
    pub viewpoints: &'a [Vec3],
    pub tree: &'a SenderTree,
    pub training: &'a Training,
    pub epsilon: f32,
    pub sky_terms: bool,
    pub drop_first: bool,
}

/// Probes of a bake.
pub(super) struct BakedProbes {
    pub probes: Probes,
    /// Terms of the links that cross occluders.
    pub occluded: Vec<UnindexedLinkTerm>,
    /// See [`BakeStats::probes_lost`](super::BakeStats::probes_lost).
    pub lost: f64,
    pub rays: u64,
    pub seconds: f64,
    pub warning: Option<String>,
}

/// Distributes probes in open space and gathers their rows.
pub(super) fn bake_probes(
    recipe: &ProbeSettings,
    input: &ProbeInput<'_>,
    progress: &Progress,
) -> Result<BakedProbes, BakeError> {
    let began = Instant::now();
    let geometry = input.gathering.geometry;
    let settings = recipe.settings(&geometry.bounds(), input.gathering.rays);
    if !progress.set(BakeStage::Probes, 0.0) {
        return Err(BakeError::Canceled);
    }
    let placement = place_probes(
        geometry,
        input.viewpoints,
        &ProbePlacementSettings {
            spacing: settings.spacing,
            max: Probes::MAX,
            seed: input.gathering.seed,
            drop_first: input.drop_first,
        },
    );
    let warning = placement.truncated.then(|| format!(
        "probes: a spacing of {} m needs more than {} probes, some of the open space has none; increase `probes.spacing`",
        settings.spacing,
        Probes::MAX
    ));
    let (basis, rays) = probe_basis(
        geometry,
        &placement.probes,
        &placement.crossed,
        settings.spacing,
    );
    let gathering = GatherSettings {
        rays: settings.rays,
        ..*input.gathering
    };
    let gathered = probe_rows(
        &gathering.scene(input.hierarchy),
        &placement.probes,
        input.tree,
        input.training,
        input.epsilon,
        input.sky_terms,
        &|done| progress.set(BakeStage::Probes, done),
    )
    .ok_or(BakeError::Canceled)?;
    let tiers = vec![1; gathered.rows.len()];
    let settings = PackSettings {
        form: SenderForm::Averages,
        senders: input.tree.parent.len(),
        points: &[],
        link_step: 0.0,
        precision: &[],
    };
    let (rows, sky, terms) = (&gathered.rows, &gathered.sky, &gathered.terms);
    let packed = pack(rows, &tiers, sky, terms, &settings);
    Ok(BakedProbes {
        probes: Probes {
            points: basis.points,
            planes: basis.planes,
            grid: basis.grid,
            rows: packed.operator.rows,
            links: packed.operator.links,
        },
        occluded: packed.link_terms,
        lost: gathered.lost,
        rays: placement.rays + rays + gathered.rays,
        seconds: began.elapsed().as_secs_f64(),
        warning,
    })
}
