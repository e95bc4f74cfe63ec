//! Settings of a solve, and the steps that follow from them: one list that the CPU runs and the GPU
//! records.

use super::Channels;
use super::layout::SolveParams;
use super::light::MAX_INTENSITY;
use super::project::{extent, sample_spacing};
use crate::asset::SceneData;
use crate::scene::SkyRadiance;
use crate::transport::SenderForm;
use glam::Vec3;
use std::f32::consts::PI;
use std::ops::Range;

/// Settings of a solve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameSettings {
    /// Jacobi sweeps: reflections beyond the first. At most [`FrameSettings::MAX_SWEEPS`] run. Not
    /// used if the bake holds its bounces and `baked_bounces` is on.
    pub sweeps: u32,
    /// `true` to use the bake's further bounces, if it has them.
    pub baked_bounces: bool,
    /// Radiance of the sky, W/(m² sr). A bake that supports a uniform sky only uses the mean over
    /// all directions.
    pub sky: SkyRadiance,
    /// Factor on the emission of the surfaces: 1 as baked, 0 off.
    pub emission: f32,
    /// Tier, starting at 1 (the fewest links). Values beyond the bake's tiers mean its highest
    /// tier: all links (design D11), or the octree of method `fmm`.
    pub tier: u32,
    /// Channels in which links are applied. An octree always uses all three.
    pub channels: Channels,
}

impl Default for FrameSettings {
    fn default() -> Self {
        Self {
            sweeps: 1,
            baked_bounces: true,
            sky: SkyRadiance::BLACK,
            emission: 1.0,
            tier: Self::ALL_TIERS,
            channels: Channels::Three,
        }
    }
}

impl FrameSettings {
    /// Maximum number of sweeps of a solve. Each is recorded separately, so a frame needs a limit.
    /// Walls that reflect 95 % of the light leave 2e-6 of it after this number.
    pub const MAX_SWEEPS: u32 = 255;

    /// Highest tier of any bake.
    pub const ALL_TIERS: u32 = u32::MAX;

    /// Creates settings for `bounces` diffuse reflections in total (at least one). Sweeps compute
    /// them if the bake holds none.
    #[must_use]
    pub fn bounces(bounces: u32) -> Self {
        Self {
            sweeps: bounces.max(1) - 1,
            ..Self::default()
        }
    }
}

/// Sizes of a baked scene on which the steps of a solve depend.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneDimensions {
    /// Start of each level's points, followed by the end of the last level.
    pub level_starts: Vec<u32>,
    /// Number of levels with senders.
    pub sender_levels: usize,
    /// Number of light samples of each sender of the finest sender level.
    pub samples_per_sender: u32,
    /// Number of tiers that use links: those of the operator, or 0.
    pub link_tiers: u32,
    /// `true` if an octree can replace the links, as the tier above theirs.
    pub octree: bool,
    /// Form of the coefficients that the links multiply.
    pub form: SenderForm,
    /// Columns of an operator of components, including those of the sky. 0 in the other forms.
    pub columns: usize,
    /// `true` if the bake supports non-uniform skies. [`SkyRadiance::TERMS`] further coefficients
    /// then follow the sky's coefficient.
    pub sky_terms: bool,
    /// `true` if the bake holds further bounces.
    pub bounces: bool,
    /// Number of nodes of the BVH.
    pub nodes: usize,
    /// Largest edge of the geometry's bounding box, meters.
    pub extent: f32,
    /// Spacing of a sender's samples, meters.
    pub sample_spacing: f32,
}

impl SceneDimensions {
    /// Returns the dimensions of `scene`.
    #[must_use]
    pub fn new(scene: &SceneData) -> Self {
        Self {
            level_starts: scene.level_starts.clone(),
            sender_levels: (scene.sender_levels as usize).min(scene.levels()),
            samples_per_sender: scene.light_samples.per_sender,
            link_tiers: scene.link_tiers(),
            octree: scene.fmm.is_some(),
            form: scene.operator.form,
            columns: (scene.operator.compression.as_ref()).map_or(0, |c| c.columns.len()),
            sky_terms: scene.sky.is_some(),
            bounces: scene.bounces.is_some(),
            nodes: scene.bvh.nodes.len(),
            extent: extent(scene),
            sample_spacing: sample_spacing(scene),
        }
    }

    /// Returns the tier that a frame with these settings uses.
    #[must_use]
    pub fn tier(&self, settings: &FrameSettings) -> u32 {
        let tiers = self.link_tiers + u32::from(self.octree);
        settings.tier.clamp(1, tiers.max(1))
    }

    /// Returns the number of points.
    #[must_use]
    pub fn points(&self) -> usize {
        self.level_starts.last().map_or(0, |&n| n as usize)
    }

    /// Returns the number of senders, without the sky.
    #[must_use]
    pub fn senders(&self) -> usize {
        self.level_starts[self.sender_levels] as usize
    }

    /// Returns the number of coefficients that links can refer to: those of the senders, of the sky
    /// and of its terms.
    #[must_use]
    pub fn coefficients(&self) -> usize {
        self.senders()
            + 1
            + if self.sky_terms {
                SkyRadiance::TERMS
            } else {
                0
            }
    }

    /// Returns the number of levels.
    #[must_use]
    pub fn levels(&self) -> usize {
        self.level_starts.len() - 1
    }

    /// Returns the points of level `l`.
    #[must_use]
    pub fn level(&self, l: usize) -> Range<usize> {
        self.level_starts[l] as usize..self.level_starts[l + 1] as usize
    }

    /// Returns the parameters of all kernels of a solve.
    #[must_use]
    pub fn params(&self, settings: &FrameSettings, slots: usize) -> SolveParams {
        let finite = |v: f32| match v.is_finite() {
            true => v.clamp(-MAX_INTENSITY, MAX_INTENSITY),
            false => 0.0,
        };
        let (channel, hue) = settings.channels.one().unwrap_or((0, Vec3::ONE));
        SolveParams {
            sky: (settings.sky.mean * PI).to_array().map(finite),
            // Baked emission can already be as bright as a light, so its factor has a smaller
            // bound.
            emission: finite(settings.emission).clamp(-1e9, 1e9),
            points: self.points() as u32,
            samples_per_sender: self.samples_per_sender,
            senders: self.senders() as u32,
            finest_sender: self.level_starts[self.sender_levels.saturating_sub(1)],
            slots: slots as u32,
            nodes: self.nodes as u32,
            extent: self.extent,
            sample_spacing: self.sample_spacing,
            // The octree is the tier above all rows and uses none of them.
            tier: match self.tier(settings) {
                tier if tier > self.link_tiers => 0,
                tier => tier,
            },
            sky_sender: self.senders() as u32,
            coarsest_points: self.level_starts.get(1).copied().unwrap_or(0),
            differences: u32::from(self.form == SenderForm::Differences),
            sky_terms: if self.sky_terms {
                SkyRadiance::TERMS as u32
            } else {
                0
            },
            channel: channel as u32,
            pad: [0; 2],
            hue: hue.extend(0.0).to_array(),
            sky_more: (settings.sky.terms)
                .map(|t| (t * PI).to_array().map(finite))
                .map(|[r, g, b]| [r, g, b, 0.0]),
        }
    }
}

/// Levels that each kernel of a solve runs on, for the frames of the CPU and the GPU.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SolveSchedule {
    /// Levels that `pull` fills from the next finer level, in order (fine to coarse): all sender
    /// levels except the finest. Empty if no kernel reads the result: components and the octree use
    /// direct light of the senders themselves.
    pub pull: Vec<Range<usize>>,
    /// Sender levels, coarse to fine, for `push`, and for `flatten` in a sweep.
    pub senders: Vec<Range<usize>>,
    /// All levels, coarse to fine, for the last `flatten`.
    pub levels: Vec<Range<usize>>,
    /// Number of Jacobi sweeps.
    pub sweeps: u32,
    /// `true` if the bake's further bounces are used.
    pub baked: bool,
    /// `true` if coefficients are differences.
    pub differences: bool,
    /// `true` if coefficients are components: `compress` runs before every `apply`.
    pub components: bool,
    /// `true` if links are applied in one channel: `apply_one` replaces `apply`.
    pub one: bool,
    /// `true` if the octree replaces the links. `fmm_up` and `fmm_down` then replace `apply`, and
    /// `flatten` runs only on levels finer than the senders.
    pub octree: bool,
}

impl SolveSchedule {
    /// Creates the steps of a solve.
    #[must_use]
    pub fn new(shape: &SceneDimensions, settings: &FrameSettings) -> Self {
        let level = |l: usize| shape.level(l);
        let octree = shape.octree && shape.tier(settings) > shape.link_tiers;
        let baked = settings.baked_bounces && shape.bounces && !octree;
        let components = shape.form == SenderForm::Components && !octree;
        let pulled = match components || octree {
            true => 0,
            false => shape.sender_levels.saturating_sub(1),
        };
        Self {
            pull: (0..pulled).rev().map(level).collect(),
            senders: (0..shape.sender_levels).map(level).collect(),
            levels: (0..shape.levels()).map(level).collect(),
            sweeps: if baked {
                0
            } else {
                settings.sweeps.min(FrameSettings::MAX_SWEEPS)
            },
            baked,
            differences: shape.form == SenderForm::Differences && !octree,
            components,
            one: settings.channels.one().is_some() && !octree,
            octree,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shape(level_starts: &[u32], sender_levels: usize) -> SceneDimensions {
        SceneDimensions {
            level_starts: level_starts.to_vec(),
            sender_levels,
            samples_per_sender: 0,
            link_tiers: 4,
            octree: false,
            form: SenderForm::Averages,
            columns: 0,
            sky_terms: false,
            bounces: false,
            nodes: 0,
            extent: 1.0,
            sample_spacing: 0.0,
        }
    }

    #[test]
    fn solve_schedule_pulls_fine_to_coarse_and_flattens_coarse_to_fine() {
        let steps = SolveSchedule::new(&shape(&[0, 3, 10, 40], 2), &FrameSettings::bounces(3));
        assert_eq!(steps.pull, std::slice::from_ref(&(0..3)));
        assert_eq!(steps.senders, [0..3, 3..10]);
        assert_eq!(steps.levels, [0..3, 3..10, 10..40]);
        assert_eq!(steps.sweeps, 2);
        let components = SceneDimensions {
            form: SenderForm::Components,
            columns: 5,
            ..shape(&[0, 3, 10, 40], 2)
        };
        let steps = SolveSchedule::new(&components, &FrameSettings::bounces(3));
        assert!(steps.components && steps.pull.is_empty() && !steps.differences);
        let octree = SceneDimensions {
            octree: true,
            ..shape(&[0, 3, 10, 40], 2)
        };
        let steps = SolveSchedule::new(&octree, &FrameSettings::bounces(3));
        assert!(steps.octree && steps.pull.is_empty() && steps.sweeps == 2);
        let fourth = FrameSettings {
            tier: 4,
            ..FrameSettings::bounces(3)
        };
        let steps = SolveSchedule::new(&octree, &fourth);
        assert!(!steps.octree && steps.pull.len() == 1);
        let endless = FrameSettings::bounces(u32::MAX);
        assert_eq!(
            SolveSchedule::new(&shape(&[0, 3], 1), &endless).sweeps,
            FrameSettings::MAX_SWEEPS
        );
    }

    #[test]
    fn solve_schedule_without_levels_is_empty() {
        let empty = SolveSchedule::new(&shape(&[0], 0), &FrameSettings::default());
        assert!(empty.pull.is_empty() && empty.levels.is_empty());
    }
}
