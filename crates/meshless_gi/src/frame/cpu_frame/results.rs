//! Results of a frame: irradiance at any point, and the intermediate arrays.

use super::{CpuFrame, CpuFrameStats, bvh, surfaces};
use crate::asset::{BakedScene, PointSurface};
use crate::frame::{
    FrameLight, FrameSettings, ProbeIrradiance, SceneDimensions, SolveParams, VectorIrradiance,
    probe, project, splat,
};
use crate::scene::Bvh;
use crate::transport::Link;
use glam::Vec3;

impl CpuFrame {
    /// The scene's BVH with the gains that its occluders have now.
    #[must_use]
    pub fn bvh<'a>(&'a self, scene: &'a BakedScene) -> &'a Bvh {
        bvh(&self.occluded, scene.data())
    }

    /// The operator's links and the probes' as the occluders let them be.
    #[must_use]
    pub fn links<'a>(&'a self, scene: &'a BakedScene) -> [&'a [Link]; 2] {
        let scene = scene.data();
        let probes = scene.probes.as_ref().map_or(&[][..], |p| &p.links);
        match &self.occluded {
            Some(o) => [&o.links, &o.probe_links],
            None => [&scene.operator.links, probes],
        }
    }

    /// The senders' surfaces as they are now.
    #[must_use]
    pub fn surfaces<'a>(&'a self, scene: &'a BakedScene) -> &'a [PointSurface] {
        surfaces(&self.surfaces, scene.data())
    }

    /// Probe irradiance at `x`, inside an occluder on the side that `n` faces (zero for the nearer
    /// one). Returns `None` if no probe reaches `x` or the scene has no probes.
    #[must_use]
    pub fn probe_irradiance(
        &self,
        scene: &BakedScene,
        x: Vec3,
        n: Vec3,
    ) -> Option<ProbeIrradiance> {
        probe::probe(scene.data().probes.as_ref()?, &self.probes, x, n)
    }

    /// The probes' values, three each, W/m².
    #[must_use]
    pub fn probes(&self) -> &[VectorIrradiance] {
        &self.probes
    }

    /// Indirect irradiance at (x, n), W/m². Includes the light of the sky and of emissive surfaces.
    /// Returns `None` where no basis function covers the point.
    #[must_use]
    pub fn irradiance(&self, scene: &BakedScene, x: Vec3, n: Vec3) -> Option<Vec3> {
        let scene = scene.data();
        splat::splat(&scene.points, &scene.display, &self.values, x, n)
    }

    /// Direct irradiance at (x, n) from the lights set, W/m²: shadows included, the sky and
    /// emissive surfaces not.
    #[must_use]
    pub fn direct(&self, scene: &BakedScene, x: Vec3, n: Vec3) -> Vec3 {
        let extent = project::extent(scene.data());
        let mut e = Vec3::ZERO;
        for light in &self.lights {
            e += Vec3::from_array(light.color)
                * project::project_at(self.bvh(scene), extent, light, x, n);
        }
        e
    }

    /// The lights, slot by slot.
    #[must_use]
    pub fn lights(&self) -> &[FrameLight] {
        &self.lights
    }

    /// Irradiance of the senders from the light of `slot` with color one.
    #[must_use]
    pub fn projected(&self, slot: usize) -> &[f32] {
        let senders = self.made_for[1];
        &self.projected[slot * senders..(slot + 1) * senders]
    }

    /// The senders' coefficients after all bounces, the sky's behind them, W/m².
    #[must_use]
    pub fn senders(&self) -> &[[f32; 4]] {
        &self.senders
    }

    /// The senders' coefficients of direct light, W/m²; only where there was more than one bounce.
    #[must_use]
    pub fn direct_senders(&self) -> &[[f32; 4]] {
        &self.direct
    }

    /// The baked bounces' further radiosity at the senders, W/m².
    #[must_use]
    pub fn multibounce_radiosity(&self) -> &[[f32; 4]] {
        &self.further
    }

    /// The senders' differences, where the operator is in that form, W/m².
    #[must_use]
    pub fn differences(&self) -> &[[f32; 4]] {
        &self.differences
    }

    /// The senders' light in bases of direct light, the sky's behind them, where the operator is in
    /// that form, W/m² (times a dimensionless vector's unit).
    #[must_use]
    pub fn components(&self) -> &[[f32; 4]] {
        &self.components
    }

    /// Vector irradiance of the operator alone at each point, for the form of differences, W/m².
    #[must_use]
    pub fn applied_irradiance(&self) -> &[VectorIrradiance] {
        &self.applied
    }

    /// Vector irradiance at every point, W/m².
    #[must_use]
    pub fn vector_irradiance(&self) -> &[VectorIrradiance] {
        &self.values
    }

    /// Counters so far.
    #[must_use]
    pub fn counters(&self) -> CpuFrameStats {
        self.counters
    }

    /// The parameters of a solve with these settings and the lights set.
    #[must_use]
    pub fn params(&self, scene: &BakedScene, settings: &FrameSettings) -> SolveParams {
        SceneDimensions::new(scene.data()).params(settings, self.lights.len())
    }
}
