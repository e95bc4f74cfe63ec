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
    /// Returns the scene's BVH with the current transmittances of its occluders.
    #[must_use]
    pub fn bvh<'a>(&'a self, scene: &'a BakedScene) -> &'a Bvh {
        bvh(&self.occluded, scene.data())
    }

    /// Returns the links of the operator and of the probes for the current occluders.
    #[must_use]
    pub fn links<'a>(&'a self, scene: &'a BakedScene) -> [&'a [Link]; 2] {
        let scene = scene.data();
        let probes = scene.probes.as_ref().map_or(&[][..], |p| &p.links);
        match &self.occluded {
            Some(o) => [&o.links, &o.probe_links],
            None => [&scene.operator.links, probes],
        }
    }

    /// Returns the current surfaces of the senders.
    #[must_use]
    pub fn surfaces<'a>(&'a self, scene: &'a BakedScene) -> &'a [PointSurface] {
        surfaces(&self.surfaces, scene.data())
    }

    /// Returns the probe irradiance at `x`. Inside an occluder, it is that of the side that `n`
    /// faces (zero selects the nearer side). Returns `None` if no probe reaches `x` or the scene
    /// has no probes.
    #[must_use]
    pub fn probe_irradiance(
        &self,
        scene: &BakedScene,
        x: Vec3,
        n: Vec3,
    ) -> Option<ProbeIrradiance> {
        probe::probe(scene.data().probes.as_ref()?, &self.probes, x, n)
    }

    /// Returns the values of the probes, three per probe, W/m².
    #[must_use]
    pub fn probes(&self) -> &[VectorIrradiance] {
        &self.probes
    }

    /// Returns the indirect irradiance at (x, n), W/m². Includes the light of the sky and of
    /// emissive surfaces. Returns `None` if no basis function covers the point.
    #[must_use]
    pub fn irradiance(&self, scene: &BakedScene, x: Vec3, n: Vec3) -> Option<Vec3> {
        let scene = scene.data();
        splat::splat(&scene.points, &scene.display, &self.values, x, n)
    }

    /// Returns the indirect irradiance that a view shows at (x, n), W/m². It includes estimates for
    /// points that no basis function covers ([`splat::splat_displayed`]). Probes are left out.
    #[must_use]
    pub fn displayed_irradiance(&self, scene: &BakedScene, x: Vec3, n: Vec3) -> Option<Vec3> {
        let scene = scene.data();
        splat::splat_displayed(&scene.points, &scene.display, &self.values, x, n)
            .map(|(e, _)| e.dot(n).max(Vec3::ZERO))
    }

    /// Returns the direct irradiance at (x, n) from the lights, W/m². Includes shadows, but not the
    /// sky and emissive surfaces.
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

    /// Returns the lights, slot by slot.
    #[must_use]
    pub fn lights(&self) -> &[FrameLight] {
        &self.lights
    }

    /// Returns the irradiance of the senders from the light of `slot` with color one.
    #[must_use]
    pub fn projected(&self, slot: usize) -> &[f32] {
        let senders = self.made_for[1];
        &self.projected[slot * senders..(slot + 1) * senders]
    }

    /// Returns the senders' coefficients after all bounces, followed by those of the sky, W/m².
    #[must_use]
    pub fn senders(&self) -> &[[f32; 4]] {
        &self.senders
    }

    /// Returns the senders' coefficients of direct light, W/m². They are valid only after a solve
    /// with more than one bounce.
    #[must_use]
    pub fn direct_senders(&self) -> &[[f32; 4]] {
        &self.direct
    }

    /// Returns the senders' further radiosity from baked bounces, W/m².
    #[must_use]
    pub fn multibounce_radiosity(&self) -> &[[f32; 4]] {
        &self.further
    }

    /// Returns the senders' differences if the operator is in that form, W/m².
    #[must_use]
    pub fn differences(&self) -> &[[f32; 4]] {
        &self.differences
    }

    /// Returns the senders' light in bases of direct light, followed by that of the sky. The unit
    /// is W/m² (times that of a dimensionless vector). Empty if the operator is not in that form.
    #[must_use]
    pub fn components(&self) -> &[[f32; 4]] {
        &self.components
    }

    /// Returns the vector irradiance of the operator alone at each point, for the form of
    /// differences, W/m².
    #[must_use]
    pub fn applied_irradiance(&self) -> &[VectorIrradiance] {
        &self.applied
    }

    /// Returns the vector irradiance at every point, W/m².
    #[must_use]
    pub fn vector_irradiance(&self) -> &[VectorIrradiance] {
        &self.values
    }

    /// Returns the counters so far.
    #[must_use]
    pub fn counters(&self) -> CpuFrameStats {
        self.counters
    }

    /// Returns the parameters of a solve with these settings and the current lights.
    #[must_use]
    pub fn params(&self, scene: &BakedScene, settings: &FrameSettings) -> SolveParams {
        SceneDimensions::new(scene.data()).params(settings, self.lights.len())
    }
}
