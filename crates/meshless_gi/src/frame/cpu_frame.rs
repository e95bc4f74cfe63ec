//! A whole frame on the CPU: owns every intermediate array, runs what changed. The same answer for
//! any number of threads, for no sum is shared between threads.

use super::anderson::Anderson;
use super::materials::{current_surfaces, sanitize_factors};
use super::occlude::{occlude, occluder_set_transmittances, sanitize_transmittances};
use super::{
    FrameLight, FrameSettings, ProbeIrradiance, SceneDimensions, SolveParams, SolveSchedule,
    VectorIrradiance, apply, apply_one, bounce, compress, flatten, fmm_down, fmm_up, probe,
    project, pull, push, radiosity, splat,
};
use crate::asset::BakedScene;
use crate::asset::PointSurface;
use crate::scene::{Bvh, MaterialFactors};
use crate::transport::fmm::Passes;
use crate::transport::fmm::passes::Field;
use crate::transport::{Link, Row};
use glam::Vec3;
use std::ops::Range;

/// What a frame has run since it was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CpuFrameStats {
    /// Light slots projected.
    pub projected: u64,
    /// Solves that ran.
    pub solves: u64,
    /// Solves that had nothing to do.
    pub rested: u64,
    /// Jacobi sweeps within the solves.
    pub sweeps: u64,
}

/// The state of a frame on the CPU. Every call takes the scene that it was made for; a scene of
/// another size starts it anew.
#[derive(Clone, Debug, Default)]
pub struct CpuFrame {
    lights: Vec<FrameLight>,
    /// What each slot was projected for.
    projected_for: Vec<FrameLight>,
    /// Slot after slot, one value a sender.
    projected: Vec<f32>,
    senders: Vec<[f32; 4]>,
    direct: Vec<[f32; 4]>,
    further: Vec<[f32; 4]>,
    differences: Vec<[f32; 4]>,
    components: Vec<[f32; 4]>,
    applied: Vec<VectorIrradiance>,
    values: Vec<VectorIrradiance>,
    /// Three a probe.
    probes: Vec<VectorIrradiance>,
    solved: Option<FrameSettings>,
    /// The factors that the surfaces are of; none for those of the bake.
    factors: Vec<MaterialFactors>,
    /// The senders' surfaces, where they are not those of the bake.
    surfaces: Vec<PointSurface>,
    /// The scene as its occluders let it be; none where all are open, or the bake knows none.
    occluded: Option<Occluded>,
    /// Points, senders, columns, rows of probes and terms of the sky of the scene that the arrays
    /// were made for.
    made_for: [usize; 5],
    counters: CpuFrameStats,
}

/// What occluders change of a scene.
#[derive(Clone, Debug)]
struct Occluded {
    gains: Vec<f32>,
    links: Vec<Link>,
    probe_links: Vec<Link>,
    bvh: Bvh,
    /// What the senders see of the sky's terms.
    seen: Vec<[f32; 8]>,
}

impl CpuFrame {
    /// A frame without lights: everything is black.
    #[must_use]
    pub fn new(scene: &BakedScene) -> Self {
        let (points, senders) = (
            scene.points.len(),
            SceneDimensions::new(scene).coefficients(),
        );
        Self {
            senders: vec![[0.0; 4]; senders],
            direct: vec![[0.0; 4]; senders],
            further: vec![[0.0; 4]; senders],
            differences: vec![[0.0; 4]; senders],
            components: vec![[0.0; 4]; columns(scene)],
            applied: vec![VectorIrradiance::default(); points],
            values: vec![VectorIrradiance::default(); points],
            probes: vec![VectorIrradiance::default(); probe_rows(scene)],
            made_for: size(scene),
            ..Self::default()
        }
    }

    /// Sets the lights, slot by slot, in the bake's local space, and projects the slots whose
    /// geometry is not what they were last projected for. Returns how many those were.
    pub fn set_lights(&mut self, scene: &BakedScene, lights: &[FrameLight]) -> usize {
        self.check(scene);
        if self.lights != lights {
            self.solved = None;
        }
        self.lights.clear();
        self.lights.extend_from_slice(lights);
        let senders = scene.senders();
        if self.projected_for.len() < lights.len() {
            self.projected_for
                .resize(lights.len(), FrameLight::default());
            self.projected.resize(lights.len() * senders, 0.0);
        }
        let (extent, sample_spacing) = (project::extent(scene), project::sample_spacing(scene));
        let mut count = 0;
        for (slot, light) in lights.iter().enumerate() {
            if light.kind == FrameLight::NONE || light.same_geometry(&self.projected_for[slot]) {
                continue;
            }
            let out = &mut self.projected[slot * senders..(slot + 1) * senders];
            project::project(
                scene,
                bvh(&self.occluded, scene),
                extent,
                sample_spacing,
                light,
                out,
            );
            self.projected_for[slot] = *light;
            count += 1;
        }
        self.counters.projected += count as u64;
        count
    }

    /// Sets the factors of the materials, one each; those that are missing are as baked. Only a
    /// bake of live materials has any. Returns whether the senders' surfaces changed: the next
    /// [`solve`](Self::solve) then runs with them.
    pub fn set_materials(&mut self, scene: &BakedScene, factors: &[MaterialFactors]) -> bool {
        self.check(scene);
        let Some(live) = &scene.materials else {
            return false;
        };
        let factors = sanitize_factors(live, factors);
        let now = match self.factors.is_empty() {
            true => &live.factors,
            false => &self.factors,
        };
        if factors == *now {
            return false;
        }
        self.factors = factors;
        self.paint(scene);
        true
    }

    /// Sets what passes the occluders, one each in [0, 1]; those that are missing are open. Only a
    /// bake that knows occluders has any. Returns whether that changed anything: the lights are
    /// projected again then, and the next [`solve`](Self::solve) runs.
    pub fn set_occluders(&mut self, scene: &BakedScene, gains: &[f32]) -> bool {
        self.check(scene);
        let Some(known) = &scene.occluders else {
            return false;
        };
        let gains = sanitize_transmittances(known, gains);
        let same = match &self.occluded {
            Some(now) => now.gains == gains,
            None => gains.iter().all(|&g| g == 1.0),
        };
        if same {
            return false;
        }
        let probe_links = scene.probes.as_ref().map_or(&[][..], |p| &p.links);
        let occluded = self.occluded.get_or_insert_with(|| Occluded {
            gains: Vec::new(),
            links: scene.operator.links.clone(),
            probe_links: probe_links.to_vec(),
            bvh: scene.bvh.clone(),
            seen: Vec::new(),
        });
        let passing = occluder_set_transmittances(known, &gains);
        occlude(&known.links, &passing, &mut occluded.links);
        occlude(&known.probes, &passing, &mut occluded.probe_links);
        occluded.bvh.set_transmittances(&gains);
        occluded.gains = gains;
        self.paint(scene);
        self.projected_for.fill(FrameLight::default());
        let lights = std::mem::take(&mut self.lights);
        self.set_lights(scene, &lights);
        true
    }

    /// The senders' surfaces anew, for the materials and the occluders as they are.
    fn paint(&mut self, scene: &BakedScene) {
        let passing = match (&self.occluded, &scene.occluders) {
            (Some(now), Some(known)) => occluder_set_transmittances(known, &now.gains),
            _ => Vec::new(),
        };
        let (surfaces, seen) = current_surfaces(scene, &self.factors, &passing);
        self.surfaces = surfaces;
        if let Some(occluded) = &mut self.occluded {
            occluded.seen = seen;
        }
        self.solved = None;
    }

    /// The scene's BVH with the gains that its occluders have now.
    #[must_use]
    pub fn bvh<'a>(&'a self, scene: &'a BakedScene) -> &'a Bvh {
        bvh(&self.occluded, scene)
    }

    /// The operator's links and the probes' as the occluders let them be.
    #[must_use]
    pub fn links<'a>(&'a self, scene: &'a BakedScene) -> [&'a [Link]; 2] {
        let probes = scene.probes.as_ref().map_or(&[][..], |p| &p.links);
        match &self.occluded {
            Some(o) => [&o.links, &o.probe_links],
            None => [&scene.operator.links, probes],
        }
    }

    /// The senders' surfaces as they are now.
    #[must_use]
    pub fn surfaces<'a>(&'a self, scene: &'a BakedScene) -> &'a [PointSurface] {
        surfaces(&self.surfaces, scene)
    }

    /// Carries the light on to all points, unless lights and settings are those of the last solve.
    /// Returns whether anything ran.
    pub fn solve(&mut self, scene: &BakedScene, settings: &FrameSettings) -> bool {
        self.check(scene);
        if self.solved == Some(*settings) {
            self.counters.rested += 1;
            return false;
        }
        let shape = SceneDimensions::new(scene);
        let params = shape.params(settings, self.lights.len());
        let steps = SolveSchedule::new(&shape, settings);
        radiosity::radiosity(
            &params,
            &self.lights,
            &self.projected,
            &scene.points,
            surfaces(&self.surfaces, scene),
            seen(&self.occluded, scene),
            &mut self.senders,
        );
        for level in &steps.pull {
            pull::pull(&scene.pull, level.clone(), &mut self.senders);
        }
        if let (true, Some(bounces)) = (steps.baked, &scene.bounces) {
            self.direct.copy_from_slice(&self.senders);
            bounce::gather(
                &bounces.starts,
                &bounces.links,
                &self.direct,
                &mut self.further,
            );
            for level in steps.senders.iter().skip(1) {
                bounce::spread(&params, &scene.parents, level.clone(), &mut self.further);
            }
            bounce::add(&params, &self.direct, &self.further, &mut self.senders);
        }
        if steps.sweeps > 0 {
            self.direct.copy_from_slice(&self.senders);
        }
        let mut octree = octree(scene, &steps);
        for _ in 0..steps.sweeps {
            self.sweep(scene, &params, &steps, &mut octree);
        }
        self.transport(scene, &params, &steps, &mut octree, Whom::All);
        self.light_space(scene, &params, &steps);
        self.solved = Some(*settings);
        self.counters.solves += 1;
        self.counters.sweeps += u64::from(steps.sweeps);
        true
    }

    /// As [`solve`](Self::solve) with as many sweeps as change anything, whatever `settings` says
    /// of them: until what further ones would add, by the bake's own bound on the gain of a
    /// reflection, is below `tolerance` times the light, or single precision says no more. The
    /// sweeps are accelerated: they are no single reflections, but end where all of those would.
    /// Returns how many ran, at most [`MAX_ACCELERATED`](Self::MAX_ACCELERATED).
    pub fn converge(
        &mut self,
        scene: &BakedScene,
        settings: &FrameSettings,
        tolerance: f32,
    ) -> u32 {
        let one = FrameSettings {
            sweeps: 1,
            baked_bounces: false,
            ..*settings
        };
        self.solved = None;
        self.solve(scene, &one);
        let shape = SceneDimensions::new(scene);
        let params = shape.params(&one, self.lights.len());
        let steps = SolveSchedule::new(&shape, &one);
        let mut octree = octree(scene, &steps);
        let gain = scene.info.energy.spectral_radius_bound;
        let gain = if gain.is_finite() { gain } else { 1.0 };
        let enough = f64::from(tolerance) * f64::from(1.0 - gain.clamp(0.0, 0.9995));
        // Sums of a few hundred links round by so much.
        let enough = enough.max(3e-7);
        let finest = params.finest_sender as usize;
        let own: Vec<usize> = (0..scene.senders())
            .filter(|&j| j >= finest || scene.pull.row(j).is_empty())
            .collect();
        // Colors have nothing to do with one another.
        let mut memory: [Anderson; 3] = Default::default();
        let values = |senders: &[[f32; 4]], c: usize| -> Vec<f32> {
            own.iter().map(|&j| senders[j][c]).collect()
        };
        let mut sweeps = 1;
        let mut x = [0, 1, 2].map(|c| values(&self.senders, c));
        loop {
            self.sweep(scene, &params, &steps, &mut octree);
            sweeps += 1;
            let g = [0, 1, 2].map(|c| values(&self.senders, c));
            let mut change = 0.0f64;
            for ((memory, x), g) in memory.iter_mut().zip(&mut x).zip(&g) {
                change = change.max(memory.step(x, g));
            }
            // The sweep's own result is light that arrived; what lies beyond it is a guess.
            if change <= enough || sweeps >= Self::MAX_ACCELERATED {
                break;
            }
            for (c, x) in x.iter_mut().enumerate() {
                for (&j, x) in own.iter().zip(x) {
                    *x = x.max(0.0);
                    self.senders[j][c] = *x;
                }
            }
            for level in &steps.pull {
                pull::pull(&scene.pull, level.clone(), &mut self.senders);
            }
        }
        self.transport(scene, &params, &steps, &mut octree, Whom::All);
        self.light_space(scene, &params, &steps);
        // No plain solve is like this one.
        self.solved = None;
        self.counters.sweeps += u64::from(sweeps - 1);
        sweeps
    }

    /// Most sweeps of [`converge`](Self::converge).
    pub const MAX_ACCELERATED: u32 = 200;

    /// One reflection: the senders' light carried to them again, and added to their direct light.
    fn sweep(
        &mut self,
        scene: &BakedScene,
        params: &SolveParams,
        steps: &SolveSchedule,
        octree: &mut Option<Passes<'_, f32>>,
    ) {
        self.transport(scene, params, steps, octree, Whom::Senders);
        bounce::sweep(
            params,
            &scene.points,
            surfaces(&self.surfaces, scene),
            seen(&self.occluded, scene),
            &scene.pull,
            &self.direct,
            &self.values,
            &mut self.senders,
        );
        for level in &steps.pull {
            pull::pull(&scene.pull, level.clone(), &mut self.senders);
        }
    }

    /// Push or compress, apply and flatten; or up and down the octree.
    fn transport(
        &mut self,
        scene: &BakedScene,
        params: &SolveParams,
        steps: &SolveSchedule,
        octree: &mut Option<Passes<'_, f32>>,
        whom: Whom,
    ) {
        let operator = &scene.operator;
        let (points, levels): (Range<usize>, _) = match whom {
            Whom::All => (0..scene.points.len(), &steps.levels),
            Whom::Senders => (0..scene.senders(), &steps.senders),
        };
        if let (Some(passes), Some(operator)) = (octree, &scene.fmm) {
            fmm_up::fmm_up(passes, &self.senders);
            let sky = scene.senders();
            fmm_down::fmm_down(passes, operator, &self.senders, sky, &mut self.values);
            // Finer points than senders take their parents' mean: no row is used.
            for level in levels.iter().skip(steps.senders.len()) {
                let rows = &scene.operator.rows;
                flatten::averages(
                    params,
                    rows,
                    &scene.parents,
                    level.clone(),
                    &mut self.values,
                );
            }
        } else if steps.differences {
            for level in &steps.senders {
                push::push(
                    &scene.parents,
                    level.clone(),
                    &self.senders,
                    &mut self.differences,
                );
            }
            // The sky is no function of any level.
            let sky = scene.senders();
            self.differences[sky] = self.senders[sky];
            operate(
                steps,
                params,
                &operator.rows,
                &operator.links,
                points.clone(),
                &self.differences,
                &mut self.applied,
            );
            flatten::differences(&scene.parents, points, &self.applied, &mut self.values);
        } else {
            let coefficients = match &operator.compression {
                Some(compression) => {
                    compress::compress(compression, &self.senders, &mut self.components);
                    &self.components
                }
                None => &self.senders,
            };
            let links = match &self.occluded {
                Some(occluded) => &occluded.links,
                None => &operator.links,
            };
            operate(
                steps,
                params,
                &operator.rows,
                links,
                points,
                coefficients,
                &mut self.values,
            );
            for level in levels {
                flatten::averages(
                    params,
                    &operator.rows,
                    &scene.parents,
                    level.clone(),
                    &mut self.values,
                );
            }
        }
    }

    /// The senders' light at the probes.
    fn light_space(&mut self, scene: &BakedScene, params: &SolveParams, steps: &SolveSchedule) {
        if let Some(probes) = &scene.probes {
            let all = 0..probes.rows.len();
            let links = match &self.occluded {
                Some(occluded) => &occluded.probe_links,
                None => &probes.links,
            };
            let rows = &probes.rows;
            let (senders, out) = (&self.senders, &mut self.probes);
            operate(steps, params, rows, links, all, senders, out);
        }
    }

    /// What arrives at `x` in free space, inside of an occluder on the side that `n` faces (zero
    /// for the nearer one); None where no probe reaches, or the scene has none.
    #[must_use]
    pub fn probe_irradiance(
        &self,
        scene: &BakedScene,
        x: Vec3,
        n: Vec3,
    ) -> Option<ProbeIrradiance> {
        probe::probe(scene.probes.as_ref()?, &self.probes, x, n)
    }

    /// The probes' values, three each, W/m².
    #[must_use]
    pub fn probes(&self) -> &[VectorIrradiance] {
        &self.probes
    }

    /// Indirect irradiance at (x, n), W/m²; None where no basis function covers the place. What the
    /// sky and emissive surfaces send is in it.
    #[must_use]
    pub fn irradiance(&self, scene: &BakedScene, x: Vec3, n: Vec3) -> Option<Vec3> {
        splat::splat(&scene.points, &scene.display, &self.values, x, n)
    }

    /// Direct irradiance at (x, n) from the lights set, W/m²: shadows included, the sky and
    /// emissive surfaces not.
    #[must_use]
    pub fn direct(&self, scene: &BakedScene, x: Vec3, n: Vec3) -> Vec3 {
        let extent = project::extent(scene);
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

    /// What the operator alone gives each point, where it is in the form of differences, W/m².
    #[must_use]
    pub fn applied(&self) -> &[VectorIrradiance] {
        &self.applied
    }

    /// Vector irradiance at every point, W/m².
    #[must_use]
    pub fn values(&self) -> &[VectorIrradiance] {
        &self.values
    }

    /// What has run so far.
    #[must_use]
    pub fn counters(&self) -> CpuFrameStats {
        self.counters
    }

    /// The parameters of a solve with these settings and the lights set.
    #[must_use]
    pub fn params(&self, scene: &BakedScene, settings: &FrameSettings) -> SolveParams {
        SceneDimensions::new(scene).params(settings, self.lights.len())
    }

    /// Starts anew where the scene has another size.
    fn check(&mut self, scene: &BakedScene) {
        if self.made_for != size(scene) {
            *self = Self::new(scene);
        }
    }
}

/// What the arrays' lengths follow from.
fn size(scene: &BakedScene) -> [usize; 5] {
    [
        scene.points.len(),
        scene.senders(),
        columns(scene),
        probe_rows(scene),
        usize::from(scene.sky.is_some()),
    ]
}

fn probe_rows(scene: &BakedScene) -> usize {
    scene.probes.as_ref().map_or(0, |p| p.rows.len())
}

/// The senders' surfaces: those of the frame, where it has any.
fn surfaces<'a>(own: &'a [PointSurface], scene: &'a BakedScene) -> &'a [PointSurface] {
    match own.is_empty() {
        true => &scene.surfaces,
        false => own,
    }
}

/// What the senders see of the sky's terms; nothing where the bake knows a uniform sky only.
fn seen<'a>(occluded: &'a Option<Occluded>, scene: &'a BakedScene) -> &'a [[f32; 8]] {
    match occluded {
        Some(o) => &o.seen,
        None => scene.sky.as_ref().map_or(&[], |sky| &sky.senders),
    }
}

/// The BVH: that of the frame, where it has one.
fn bvh<'a>(occluded: &'a Option<Occluded>, scene: &'a BakedScene) -> &'a Bvh {
    occluded.as_ref().map_or(&scene.bvh, |o| &o.bvh)
}

/// Who is to get light.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Whom {
    /// All points.
    All,
    /// The senders, for their next reflection.
    Senders,
}

/// The operator, in as many channels as the frame takes.
fn operate(
    steps: &SolveSchedule,
    params: &SolveParams,
    rows: &[Row],
    links: &[Link],
    points: Range<usize>,
    coefficients: &[[f32; 4]],
    out: &mut [VectorIrradiance],
) {
    let apply = match steps.one {
        true => apply_one::apply_one,
        false => apply::apply,
    };
    apply(params, rows, links, points, coefficients, out);
}

/// Room for the passes, where the octree carries the light.
fn octree<'a>(scene: &'a BakedScene, steps: &SolveSchedule) -> Option<Passes<'a, f32>> {
    let operator = scene.fmm.as_ref().filter(|_| steps.octree)?;
    Some(Passes::new(Field::of(operator)))
}

/// Columns of an operator of components, the sky's among them.
fn columns(scene: &BakedScene) -> usize {
    (scene.operator.compression.as_ref()).map_or(0, |c| c.columns.len())
}
