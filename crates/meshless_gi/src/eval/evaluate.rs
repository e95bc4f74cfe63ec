//! Irradiance of a baked scene under lights at single positions, as in a frame. Direct and indirect
//! irradiance are separate.
//!
//! A frame computes the direct light of the sky and of emissive surfaces through links, together
//! with the indirect light. By linearity that part can be subtracted. A solve on black surfaces has
//! that part alone, and the difference of both solves was reflected at least once. The direct light
//! is integrated separately instead. The first transport step of emission is a link, that of lights
//! is a projection. Emission therefore needs one more sweep for the same number of bounces, and has
//! its own solve.

use super::EmissionIntegrator;
use crate::asset::BakedScene;
use crate::frame::{CpuFrame, FrameLight, FrameSettings, VectorIrradiance, probe, project, splat};
use crate::scene::{Light, SkyRadiance, TriangleMesh, sum_sky_lights};
use glam::Vec3;

/// Number of patches of a rectangle light for projection onto the points.
pub(crate) const PATCHES: u32 = 64;
/// Number of patches of a rectangle light for its direct light.
const FINE_PATCHES: u32 = 1024;
/// Largest contribution of further bounces, relative to the light, that is neglected.
const CONVERGED: f32 = 1e-4;

/// Number of diffuse bounces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bounces {
    /// Fixed number: at least 1, at most one more than [`FrameSettings::MAX_SWEEPS`].
    Count(u32),
    /// All bounces, until further ones are negligible.
    All,
}

/// Direct and indirect irradiance at a position.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Evaluated {
    /// Irradiance directly from lights, sky and emissive surfaces, in W/m².
    pub direct: Vec3,
    /// Irradiance that was diffusely reflected at least once, in W/m². `None` if neither a basis
    /// function nor a probe covers the position.
    pub indirect: Option<Vec3>,
}

/// Result of a solve: values at the points, and at the probes if there are any.
struct Solved {
    points: Vec<VectorIrradiance>,
    probes: Vec<VectorIrradiance>,
}

impl Solved {
    fn from_frame(frame: &CpuFrame) -> Self {
        Self {
            points: frame.vector_irradiance().to_vec(),
            probes: frame.probes().to_vec(),
        }
    }

    fn add(&mut self, weight: f32, more: &Self) {
        let points = self.points.iter_mut().zip(&more.points);
        for (value, more) in points.chain(self.probes.iter_mut().zip(&more.probes)) {
            value.add_scaled(weight, more);
        }
    }
}

/// Solved light of a baked scene under given lights.
pub struct Evaluator<'a> {
    scene: &'a BakedScene,
    /// Reflected light only.
    solved: Solved,
    light_sources: Vec<FrameLight>,
    emission_integrator: EmissionIntegrator<'a>,
    /// Number of simulated bounces. `None` if baked bounces were used or the solve ran to
    /// convergence.
    bounces: Option<u32>,
}

impl<'a> Evaluator<'a> {
    /// Solves `scene` under `lights`. `meshes` is the geometry of the scene, for the direct light
    /// of emissive surfaces and the sky.
    #[must_use]
    pub fn new(
        scene: &'a BakedScene,
        meshes: &'a [TriangleMesh],
        lights: &[Light],
        bounces: Bounces,
    ) -> Self {
        Self::with_tier(scene, meshes, lights, bounces, FrameSettings::ALL_TIERS)
    }

    /// Solves like [`new`](Self::new), with the links of a tier of the operator
    /// ([`FrameSettings::tier`]).
    #[must_use]
    pub fn with_tier(
        scene: &'a BakedScene,
        meshes: &'a [TriangleMesh],
        lights: &[Light],
        bounces: Bounces,
        tier: u32,
    ) -> Self {
        let expand = |patches: u32| -> Vec<FrameLight> {
            lights
                .iter()
                .flat_map(|light| FrameLight::expand(light, patches))
                .collect()
        };
        let sky = sum_sky_lights(lights);
        let (frame, used) = solve(scene, &expand(PATCHES), &settings(sky, 1, tier), bounces);
        let mut solved = Solved::from_frame(&frame);
        let emits = scene.data().surfaces.iter().any(|s| s.emission != [0.0; 3]);
        if emits {
            let emission_bounces = match bounces {
                Bounces::Count(count) => Bounces::Count(count.max(1).saturating_add(1)),
                Bounces::All => Bounces::All,
            };
            solved.add(1.0, &solve_emission(scene, emission_bounces, tier));
        }
        if emits || !sky.is_black() {
            let mut black = scene.clone();
            for surface in &mut black.data_mut().surfaces {
                surface.albedo = [0.0; 3];
            }
            let mut unreflected = CpuFrame::new(&black);
            let both = FrameSettings {
                emission: 1.0,
                ..settings(sky, 1, tier)
            };
            unreflected.solve(&black, &both);
            solved.add(-1.0, &Solved::from_frame(&unreflected));
        }
        Self {
            scene,
            solved,
            light_sources: expand(FINE_PATCHES),
            emission_integrator: EmissionIntegrator::new(meshes, sky),
            bounces: used,
        }
    }

    /// Returns the irradiance at surface point (x, n), n of unit length. `stream` numbers the
    /// position. See [`EmissionIntegrator::irradiance`].
    #[must_use]
    pub fn at(&self, x: Vec3, n: Vec3, stream: u64) -> Evaluated {
        let scene = self.scene.data();
        let extent = project::extent(scene);
        let above = x + n * self.emission_integrator.surface_relief(x);
        let light_sources: Vec3 = self
            .light_sources
            .iter()
            .map(|light| {
                Vec3::from_array(light.color)
                    * project::project_at(&scene.bvh, extent, light, above, n)
            })
            .sum();
        let values = &self.solved.points;
        let (points, display) = (&scene.points, &scene.display);
        let indirect = match splat::splat_covered(points, display, values, x, n) {
            Some((e, cover)) => {
                let (e, share) = (
                    e.dot(n).max(Vec3::ZERO),
                    splat::surface_fraction(cover, splat::FULL_COVER),
                );
                let rest = (share < 1.0).then(|| self.probe_irradiance(x, n)).flatten();
                Some(rest.map_or(e, |space| space.lerp(e, share)))
            }
            None => self.probe_irradiance(x, n),
        };
        Evaluated {
            direct: finite(light_sources + self.emission_integrator.irradiance(x, n, stream)),
            indirect: indirect.map(finite),
        }
    }

    /// Returns the indirect irradiance of the probes at a position between surfaces, in W/m².
    /// Returns `None` if no probe covers the position.
    #[must_use]
    pub fn probe_irradiance(&self, x: Vec3, n: Vec3) -> Option<Vec3> {
        let probes = self.scene.data().probes.as_ref()?;
        let light = probe::probe(probes, &self.solved.probes, x, n)?;
        Some(finite(light.irradiance(n)))
    }

    /// Returns the number of simulated bounces. Returns `None` if baked bounces were used or the
    /// solve ran to convergence.
    #[must_use]
    pub fn bounces(&self) -> Option<u32> {
        self.bounces
    }
}

/// Returns settings for a number of bounces, without baked bounces and without emission.
fn settings(sky: SkyRadiance, bounces: u32, tier: u32) -> FrameSettings {
    FrameSettings {
        sky,
        tier,
        baked_bounces: false,
        emission: 0.0,
        ..FrameSettings::bounces(bounces)
    }
}

/// Solves a frame with a number of bounces, which replaces that of `settings`. Uses the baked
/// bounces if the bake has exactly this number. Returns the number of simulated bounces: `None` if
/// baked bounces were used or the solve ran to convergence.
pub(crate) fn solve(
    scene: &BakedScene,
    light_sources: &[FrameLight],
    settings: &FrameSettings,
    bounces: Bounces,
) -> (CpuFrame, Option<u32>) {
    let mut frame = CpuFrame::new(scene);
    frame.set_lights(scene, light_sources);
    let baked_count = scene.info().bounces;
    if scene.data().bounces.is_some() && bounces == Bounces::Count(baked_count) {
        let baked = FrameSettings {
            sweeps: baked_count.max(1) - 1,
            baked_bounces: true,
            ..*settings
        };
        frame.solve(scene, &baked);
        return (frame, None);
    }
    let runtime = FrameSettings {
        baked_bounces: false,
        ..*settings
    };
    let count = sweep(scene, &mut frame, &runtime, bounces);
    (frame, count)
}

/// Returns the light of emissive surfaces. Its first step through links counts as a bounce.
fn solve_emission(scene: &BakedScene, bounces: Bounces, tier: u32) -> Solved {
    let mut frame = CpuFrame::new(scene);
    let alone = FrameSettings {
        emission: 1.0,
        ..settings(SkyRadiance::BLACK, 1, tier)
    };
    sweep(scene, &mut frame, &alone, bounces);
    Solved::from_frame(&frame)
}

/// Solves with a number of bounces and returns the number. Returns `None` after a solve to
/// convergence.
fn sweep(
    scene: &BakedScene,
    frame: &mut CpuFrame,
    settings: &FrameSettings,
    bounces: Bounces,
) -> Option<u32> {
    let Bounces::Count(count) = bounces else {
        frame.converge(scene, settings, CONVERGED);
        return None;
    };
    let sweeps = (count.max(1) - 1).min(FrameSettings::MAX_SWEEPS);
    let settings = FrameSettings {
        sweeps,
        ..*settings
    };
    frame.solve(scene, &settings);
    Some(sweeps + 1)
}

/// Clamps irradiance to 0 to `f32::MAX` and replaces NaN by 0.
fn finite(e: Vec3) -> Vec3 {
    let one = |c: f32| {
        if c.is_nan() {
            0.0
        } else {
            c.clamp(0.0, f32::MAX)
        }
    };
    Vec3::new(one(e.x), one(e.y), one(e.z))
}
