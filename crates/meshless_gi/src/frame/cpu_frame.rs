//! A whole frame on the CPU. It owns all intermediate arrays and recomputes only changed data. The
//! result does not depend on the number of threads, because threads share no sums.

use super::materials::{current_surfaces, sanitize_factors};
use super::occlude::{occlude, occluder_set_transmittances, sanitize_transmittances};
use super::radiosity::SenderInputs;
use super::{
    FrameLight, FrameSettings, SceneDimensions, SolveSchedule, VectorIrradiance, bounce, project,
    pull, radiosity,
};
use crate::asset::{BakedScene, PointSurface, SceneData};
use crate::scene::{Bvh, MaterialFactors};
use crate::transport::Link;
use transport::{ReceiverSet, octree};

mod converge;
mod results;
mod transport;

/// Counters of a frame since it was created.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CpuFrameStats {
    /// Light slots projected.
    pub projected: u64,
    /// Solves that ran.
    pub solves: u64,
    /// Solves that were skipped because nothing changed.
    pub skipped_solves: u64,
    /// Jacobi sweeps within the solves.
    pub sweeps: u64,
}

/// State of a frame on the CPU. All calls require the scene for which the frame was created. A
/// scene of another size resets the frame.
#[derive(Clone, Debug, Default)]
pub struct CpuFrame {
    lights: Vec<FrameLight>,
    /// Lights for which the slots were projected.
    projected_for: Vec<FrameLight>,
    /// Projected irradiance, slot after slot, one value per sender.
    projected: Vec<f32>,
    senders: Vec<[f32; 4]>,
    direct: Vec<[f32; 4]>,
    further: Vec<[f32; 4]>,
    differences: Vec<[f32; 4]>,
    components: Vec<[f32; 4]>,
    applied: Vec<VectorIrradiance>,
    values: Vec<VectorIrradiance>,
    /// Values of the probes, three per probe.
    probes: Vec<VectorIrradiance>,
    solved: Option<FrameSettings>,
    /// Material factors of the surfaces. Empty if they are those of the bake.
    factors: Vec<MaterialFactors>,
    /// Surfaces of the senders. Empty if they are those of the bake.
    surfaces: Vec<PointSurface>,
    /// Scene data for the current state of the occluders. `None` if all are open or the bake has
    /// none.
    occluded: Option<Occluded>,
    /// Numbers of points, senders, columns, probe rows and sky terms of the scene for which the
    /// arrays were allocated.
    made_for: [usize; 5],
    counters: CpuFrameStats,
}

/// Scene data that depends on the occluders.
#[derive(Clone, Debug)]
struct Occluded {
    transmittances: Vec<f32>,
    links: Vec<Link>,
    probe_links: Vec<Link>,
    bvh: Bvh,
    /// Visibility of the sky's terms from the senders.
    sky_visibility: Vec<[f32; 8]>,
}

impl CpuFrame {
    /// Creates a frame without lights: everything is black.
    #[must_use]
    pub fn new(scene: &BakedScene) -> Self {
        Self::from_data(scene.data())
    }

    /// Creates a frame of a scene without its facts. See [`new`](Self::new).
    pub(crate) fn from_data(scene: &SceneData) -> Self {
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

    /// Creates a frame with other surfaces than the scene's.
    pub(crate) fn with_surfaces(scene: &SceneData, surfaces: Vec<PointSurface>) -> Self {
        Self {
            surfaces,
            ..Self::from_data(scene)
        }
    }

    /// Sets the lights, slot by slot, in the bake's local space. Projects the slots with another
    /// geometry than at their last projection. Returns the number of projected slots.
    pub fn set_lights(&mut self, scene: &BakedScene, lights: &[FrameLight]) -> usize {
        self.set_lights_of_data(scene.data(), lights)
    }

    /// Sets the lights of a scene without its facts. See [`set_lights`](Self::set_lights).
    pub(crate) fn set_lights_of_data(&mut self, scene: &SceneData, lights: &[FrameLight]) -> usize {
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
            if light.kind == FrameLight::NONE || light.has_same_geometry(&self.projected_for[slot])
            {
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

    /// Sets the factors of the materials, one per material. Missing factors are as baked. Bakes
    /// without dynamic materials ignore it. Returns `true` if the senders' surfaces changed. The
    /// next [`solve`](Self::solve) then runs with them.
    pub fn set_materials(&mut self, scene: &BakedScene, factors: &[MaterialFactors]) -> bool {
        let scene = scene.data();
        self.check(scene);
        let Some(dynamic) = &scene.materials else {
            return false;
        };
        let factors = sanitize_factors(dynamic, factors);
        let now = match self.factors.is_empty() {
            true => &dynamic.factors,
            false => &self.factors,
        };
        if factors == *now {
            return false;
        }
        self.factors = factors;
        self.update_surfaces(scene);
        true
    }

    /// Sets the transmittance of each occluder, in [0, 1]. Missing ones are open. Bakes without
    /// occluders ignore it. Returns `true` if a value changed. The lights are then projected again,
    /// and the next [`solve`](Self::solve) runs.
    pub fn set_occluders(&mut self, scene: &BakedScene, transmittances: &[f32]) -> bool {
        let data = scene.data();
        self.check(data);
        let Some(known) = &data.occluders else {
            return false;
        };
        let transmittances = sanitize_transmittances(known, transmittances);
        let same = match &self.occluded {
            Some(now) => now.transmittances == transmittances,
            None => transmittances.iter().all(|&g| g == 1.0),
        };
        if same {
            return false;
        }
        let probe_links = data.probes.as_ref().map_or(&[][..], |p| &p.links);
        let occluded = self.occluded.get_or_insert_with(|| Occluded {
            transmittances: Vec::new(),
            links: data.operator.links.clone(),
            probe_links: probe_links.to_vec(),
            bvh: data.bvh.clone(),
            sky_visibility: Vec::new(),
        });
        let set_transmittances = occluder_set_transmittances(known, &transmittances);
        occlude(&known.links, &set_transmittances, &mut occluded.links);
        occlude(
            &known.probes,
            &set_transmittances,
            &mut occluded.probe_links,
        );
        occluded.bvh.set_transmittances(&transmittances);
        occluded.transmittances = transmittances;
        self.update_surfaces(data);
        self.projected_for.fill(FrameLight::default());
        let lights = std::mem::take(&mut self.lights);
        self.set_lights(scene, &lights);
        true
    }

    /// Recomputes the senders' surfaces for the current materials and occluders.
    fn update_surfaces(&mut self, scene: &SceneData) {
        let set_transmittances = match (&self.occluded, &scene.occluders) {
            (Some(now), Some(known)) => occluder_set_transmittances(known, &now.transmittances),
            _ => Vec::new(),
        };
        let (surfaces, sky_visibility) =
            current_surfaces(scene, &self.factors, &set_transmittances);
        self.surfaces = surfaces;
        if let Some(occluded) = &mut self.occluded {
            occluded.sky_visibility = sky_visibility;
        }
        self.solved = None;
    }

    /// Transports the light to all points, unless lights and settings are those of the last solve.
    /// Returns `true` if it ran.
    pub fn solve(&mut self, scene: &BakedScene, settings: &FrameSettings) -> bool {
        self.solve_data(scene.data(), settings)
    }

    /// Solves a frame of a scene without its facts. See [`solve`](Self::solve).
    pub(crate) fn solve_data(&mut self, scene: &SceneData, settings: &FrameSettings) -> bool {
        self.check(scene);
        if self.solved == Some(*settings) {
            self.counters.skipped_solves += 1;
            return false;
        }
        let shape = SceneDimensions::new(scene);
        let params = shape.params(settings, self.lights.len());
        let steps = SolveSchedule::new(&shape, settings);
        radiosity::radiosity(
            &params,
            &self.lights,
            &self.projected,
            &sender_inputs(&self.surfaces, &self.occluded, scene),
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
                bounce::interpolate(&params, &scene.parents, level.clone(), &mut self.further);
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
        self.transport(scene, &params, &steps, &mut octree, ReceiverSet::All);
        self.transport_to_probes(scene, &params, &steps);
        self.solved = Some(*settings);
        self.counters.solves += 1;
        self.counters.sweeps += u64::from(steps.sweeps);
        true
    }

    /// Resets the frame if the scene has another size.
    fn check(&mut self, scene: &SceneData) {
        if self.made_for != size(scene) {
            *self = Self::from_data(scene);
        }
    }
}

/// Returns the sizes that determine the lengths of the arrays.
fn size(scene: &SceneData) -> [usize; 5] {
    [
        scene.points.len(),
        scene.senders(),
        columns(scene),
        probe_rows(scene),
        usize::from(scene.sky.is_some()),
    ]
}

fn probe_rows(scene: &SceneData) -> usize {
    scene.probes.as_ref().map_or(0, |p| p.rows.len())
}

/// Returns the senders' surfaces: those of the frame if it has any, otherwise those of the scene.
fn surfaces<'a>(own: &'a [PointSurface], scene: &'a SceneData) -> &'a [PointSurface] {
    match own.is_empty() {
        true => &scene.surfaces,
        false => own,
    }
}

/// Returns the inputs of the senders for the frame's materials and occluders.
fn sender_inputs<'a>(
    own: &'a [PointSurface],
    occluded: &'a Option<Occluded>,
    scene: &'a SceneData,
) -> SenderInputs<'a> {
    SenderInputs {
        points: &scene.points,
        surfaces: surfaces(own, scene),
        sky: match occluded {
            Some(o) => &o.sky_visibility,
            None => scene.sky.as_ref().map_or(&[], |sky| &sky.senders),
        },
    }
}

/// Returns the BVH of the frame if it has one, otherwise that of the scene.
fn bvh<'a>(occluded: &'a Option<Occluded>, scene: &'a SceneData) -> &'a Bvh {
    occluded.as_ref().map_or(&scene.bvh, |o| &o.bvh)
}

/// Returns the number of columns of an operator of components, including that of the sky.
fn columns(scene: &SceneData) -> usize {
    (scene.operator.compression.as_ref()).map_or(0, |c| c.columns.len())
}
