//! Effect `fog`: probe irradiance that fog scatters to the camera, added to the picture of each
//! view.
//!
//! Reads: the fog volumes of each view that lie in a scene with an irradiance volume. Runs in every
//! frame with such fog in view, in Bevy's post-processing behind Bevy's own fog. Kernel:
//! `fog_inscatter`; the draw `fog`.

pub(crate) mod fog_volumes;
pub(crate) mod order;
pub(crate) mod volumetric_fog;

use super::{Effect, PassKind, Record, Recording};
use crate::gpu;
use crate::gpu::{FogBuffers, FogTextures, KernelPipelines, draw_fog};
use crate::plan::{FogState, FrameStage, FrameState, Pass, Plan, RunReason, SceneId, Timing, Work};
use crate::plugin::effect_states::EffectState;
use crate::plugin::effects::fog::fog_volumes::{ExtractedFogView, FogScene, LitFog, cubes_overlap};
use crate::plugin::effects::volume::irradiance_volume::ExtractedVolume;
use crate::plugin::record::{PostProcessContext, PostProcessView, PostProcessWorld};
use crate::plugin::{GiRenderSystems, GiSystems, GiVolumetricFog, extract, validation};
use bevy::app::{App, Last, SubApp};
use bevy::core_pipeline::schedule::Core3d;
use bevy::ecs::prelude::*;
use bevy::math::{Affine3A, Mat4};
use bevy::render::ExtractSchedule;
use bevy::render::render_resource::RenderPassDescriptor;
use bevy::render::texture::GpuImage;
use meshless_gi::internals::frame::{Fog, FogInscatterParams, FogParams, FogView};

pub(super) const EFFECT: Effect = Effect {
    name: "fog",
    summary: "adds the probe irradiance that fog scatters to the camera, in scenes with a volume",
    schedule,
    passes: &[PassKind {
        stage: FrameStage::FOG,
        per_view: true,
        timing: Timing::With(FrameStage::FOG),
        work: |state, pass| {
            let own = |f: &&FogState| Some(f.view) == pass.view && f.scene == pass.scene;
            let fog = state.fogs.iter().find(own);
            Work::Pixels(fog.map_or(0, |f| f.pixels * f.volumes as u64))
        },
        record: Recording {
            kernels: &[gpu::EntryPoint::FogInscatter],
            draws: Some(|counters| counters.fogs),
            how: Record::PostProcess(record),
        },
    }],
};

/// Adds a pass for each view and scene. The effect `volume` reports a bake without probes.
/// Adds the component and its check to the main world.
pub(super) fn add_to_app(app: &mut App) {
    app.register_type::<GiVolumetricFog>().add_systems(
        Last,
        (fog_volumes::check_fog.after(validation::check)).in_set(GiSystems::Validate),
    );
}

/// Adds the extraction to the render world, and the order of fog in a camera's passes.
pub(super) fn add_to_render_app(render_app: &mut SubApp) {
    render_app
        .init_resource::<fog_volumes::ExtractedFogs>()
        .add_systems(
            ExtractSchedule,
            (fog_volumes::extract_fogs.after(extract::extract)).in_set(GiRenderSystems::Extract),
        )
        .edit_schedule(Core3d, |schedule| {
            schedule.add_build_pass(order::FogFirst::default());
        });
}

fn schedule(state: &FrameState, plan: &mut Plan) {
    for fog in state.fogs.iter().filter(|f| f.volumes > 0) {
        let scene = state.active_scenes().find(|s| s.id == fog.scene);
        if scene.is_some_and(|s| s.volume.requested && s.probes) {
            let (stage, reason) = (FrameStage::FOG, RunReason::FogInView(fog.volumes));
            plan.push(EFFECT.name, stage, fog.scene, reason).view = Some(fog.view);
        }
    }
}

/// A draw of fog: a fog volume in a scene.
struct FogDraw<'a> {
    /// Index of its in-scattered light.
    light: usize,
    volume: &'a wgpu::TextureView,
    sampler: &'a wgpu::Sampler,
    density: &'a GpuImage,
}

/// Draws of a view, and the light that they read.
#[derive(Default)]
struct FogDraws<'a> {
    /// Scene and asymmetry of each in-scattered light.
    lights: Vec<(usize, f32)>,
    inscatter: Vec<FogInscatterParams>,
    /// Volume that each in-scattered light is computed from.
    volumes: Vec<&'a wgpu::TextureView>,
    params: Vec<FogParams>,
    draws: Vec<FogDraw<'a>>,
}

/// The volumes of the scenes whose fog passes a plan lists, by scene.
type ReadyVolumes<'a> = Vec<(SceneId, &'a ExtractedVolume, &'a wgpu::TextureView)>;

impl<'a> FogDraws<'a> {
    /// Collects the draws of a view, in the order of its fog volumes. `camera` does not include the
    /// intensity of a scene.
    fn new(
        view: &ExtractedFogView,
        camera: &FogView,
        input: &'a PostProcessWorld<'_>,
        ready: &ReadyVolumes<'a>,
    ) -> Self {
        let mut out = Self::default();
        for lit in &view.lit {
            out.add(lit, camera, input, ready);
        }
        out
    }

    /// Adds the draw of a fog volume. Does nothing if the scene's volume is not written yet.
    fn add(
        &mut self,
        lit: &LitFog,
        camera: &FogView,
        input: &'a PostProcessWorld<'_>,
        ready: &ReadyVolumes<'a>,
    ) {
        let find = |id: SceneId| ready.iter().find(|(scene, ..)| *scene == id);
        let own: &FogScene = &input.fogs.scenes[lit.scene];
        let extracted = input.gi.scenes.iter().find(|s| s.id == own.scene);
        let placement = extracted.and_then(|s| s.placement);
        let (Some(placement), Some(&(_, volume, written))) = (placement, find(own.scene)) else {
            return;
        };
        // Fog is homogeneous until its texture is loaded, as in Bevy.
        let density = lit.density.and_then(|image| input.images.get(image));
        let fog = Fog {
            texture: lit.fog.texture.filter(|_| density.is_some()),
            ..lit.fog
        };
        let camera = FogView {
            exposure: camera.exposure * own.strength,
            ..*camera
        };
        let world_from_local = Mat4::from(placement.world_from_local);
        let key = (lit.scene, fog.asymmetry);
        let light = self.lights.iter().position(|k| *k == key);
        let light = light.unwrap_or_else(|| {
            let shape = volume.shape();
            let params = FogInscatterParams::new(&camera, fog.asymmetry, shape, &world_from_local);
            self.lights.push(key);
            self.inscatter.push(params);
            self.volumes.push(written);
            self.lights.len() - 1
        });
        let cube = Affine3A::from_mat4(fog.world_from_local);
        let earlier: Vec<Mat4> = (input.fogs.scenes[..lit.scene].iter())
            .filter(|other| {
                cubes_overlap(&other.cube, &own.cube) && cubes_overlap(&other.cube, &cube)
            })
            .filter(|other| find(other.scene).is_some())
            .map(|other| other.cube.into())
            .collect();
        self.params.push(FogParams::new(
            &camera,
            &fog,
            volume.shape(),
            own.bounds,
            &world_from_local,
            &earlier,
        ));
        self.draws.push(FogDraw {
            light,
            volume: written,
            sampler: volume.sampler(),
            density: density.unwrap_or(&input.fallback.d3),
        });
    }

    /// Draws all of them over the picture.
    fn draw(
        &self,
        kernels: &KernelPipelines,
        encoder: &mut wgpu::CommandEncoder,
        buffers: &FogBuffers,
        view: &PostProcessView<'_>,
    ) {
        let mut pass = encoder.begin_render_pass(&RenderPassDescriptor {
            label: Some("meshless_gi fog"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                // Multisampled pictures are resolved by now.
                view: view.target.main_texture_view(),
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Load,
                    store: wgpu::StoreOp::Store,
                },
            })],
            depth_stencil_attachment: None,
            timestamp_writes: None,
            occlusion_query_set: None,
            multiview_mask: None,
        });
        let [x, y, width, height] = view.view.viewport.to_array();
        pass.set_viewport(x as f32, y as f32, width as f32, height as f32, 0.0, 1.0);
        pass.set_scissor_rect(x, y, width, height);
        let format = view.view.target_format;
        for (index, draw) in self.draws.iter().enumerate() {
            let textures = FogTextures {
                depth: view.depth.view(),
                sampled: view.sampled,
                voxels: draw.volume,
                between: draw.sampler,
                density: (&draw.density.texture_view, &draw.density.sampler),
            };
            draw_fog(
                kernels, &mut pass, format, buffers, index, draw.light, &textures,
            );
        }
    }
}

impl EffectState for FogBuffers {
    fn size(&self) -> (u32, u64) {
        (self.count(), self.bytes())
    }
}

/// Records the fog of a view, from the volumes of the scenes whose passes are planned.
fn record(ctx: &mut PostProcessContext<'_>, passes: &[&Pass]) -> Option<()> {
    let (view, world) = (ctx.view, ctx.world);
    let fogged = world.fogs.view(view.id)?;
    let ready = passes.iter().filter_map(|pass| {
        let volume = world.volumes.find(pass.scene)?;
        let written = ctx.scenes.get(&pass.scene)?.volume_texture(volume)?;
        Some((pass.scene, volume, written))
    });
    let ready: ReadyVolumes = ready.collect();
    let camera = FogView {
        view_from_clip: view.clip_from_view().inverse(),
        world_from_view: view.view.world_from_view.to_matrix(),
        viewport: view.view.viewport.as_vec4().to_array(),
        exposure: view.camera.exposure * fogged.intensity,
        steps: fogged.steps,
    };
    let draws = FogDraws::new(fogged, &camera, world, &ready);
    let readable = wgpu::TextureUsages::TEXTURE_BINDING;
    if !view.depth.texture.usage().contains(readable) {
        return None;
    }
    // The weights of a new volume are computed over several frames.
    if draws.params.is_empty() {
        return Some(());
    }
    let mut buffers = ctx.earlier.take::<FogBuffers>().unwrap_or_default();
    let device = ctx.kernels.device();
    buffers.write(device, ctx.queue, &draws.inscatter, &draws.params);
    let recorded = buffers.record(ctx.kernels, ctx.encoder, &draws.volumes);
    draws.draw(ctx.kernels, ctx.encoder, &buffers, view);
    ctx.states.insert(buffers);
    ctx.counters.add(&recorded);
    ctx.counters.fogs += draws.params.len() as u64;
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::{
        FogState, SceneId, SceneState, SkipReason, SlotChange, TimingScope, ViewId, VolumeState,
        Work,
    };
    use crate::plugin::effects::plan_frame;

    const A: SceneId = SceneId(1);

    /// Returns a scene on the device with a complete volume. A camera without display settings
    /// shows fog in it.
    fn static_state() -> FrameState {
        FrameState {
            scenes: vec![SceneState {
                resident: true,
                probes: true,
                slots: vec![SlotChange::None; 2],
                volume: VolumeState {
                    requested: true,
                    is_visible: true,
                    held: true,
                    voxels: 100,
                },
                ..SceneState::new(A)
            }],
            fogs: vec![FogState {
                view: ViewId(7),
                scene: A,
                volumes: 2,
                pixels: 1000,
            }],
            ..FrameState::default()
        }
    }

    fn stages(state: &FrameState) -> Vec<FrameStage> {
        plan_frame(state).passes.iter().map(|p| p.stage).collect()
    }

    #[test]
    fn fog_is_composited_every_frame_and_lit_on_change() {
        let mut state = static_state();
        assert_eq!(stages(&state), [FrameStage::FOG]);
        let plan = plan_frame(&state);
        assert_eq!(plan.passes[0].view, Some(ViewId(7)));
        assert_eq!(plan.passes[0].reason, RunReason::FogInView(2));
        let words = plan.to_string();
        let line = "fog of scene 1 in view 7 (fog): 2 fog volume(s) of the view lie in the scene";
        assert!(words.contains(line), "{words}");
        // The pass runs once for each scene. The second scene is timed with the first.
        let timed = TimingScope {
            stage: FrameStage::FOG,
            scene: SceneId::WORLD,
            view: Some(ViewId(7)),
            light: None,
            is_solve: false,
        };
        assert_eq!(plan.costs[0].0, timed);
        assert_eq!(plan.costs[0].1.work, Work::Pixels(2000));
        let mut second = state.clone();
        second.scenes.push(SceneState {
            id: SceneId(2),
            ..state.scenes[0].clone()
        });
        second.fogs.push(FogState {
            scene: SceneId(2),
            volumes: 1,
            ..state.fogs[0]
        });
        let plan = plan_frame(&second);
        assert_eq!((plan.count(FrameStage::FOG), plan.costs.len()), (2, 1));
        assert_eq!(plan.costs[0].1.work, Work::Pixels(3000));
        // A light moves: its light is in the fog of the same frame.
        state.scenes[0].slots[1] = SlotChange::Geometry;
        assert_eq!(
            stages(&state),
            [
                FrameStage::PROJECT,
                FrameStage::PULL_PUSH,
                FrameStage::APPLY,
                FrameStage::FLATTEN,
                FrameStage::PROBE,
                FrameStage::VOLUME,
                FrameStage::FOG
            ]
        );
    }

    #[test]
    fn fog_without_light_runs_no_pass() {
        type Change = fn(&mut FrameState);
        let cases: [Change; 6] = [
            |s| s.fogs.clear(),
            |s| s.fogs[0].volumes = 0,
            |s| s.fogs[0].scene = SceneId(9),
            |s| s.scenes[0].volume.requested = false,
            |s| s.scenes[0].probes = false,
            |s| s.is_device_supported = false,
        ];
        for (k, change) in cases.into_iter().enumerate() {
            let mut state = static_state();
            change(&mut state);
            assert_eq!(stages(&state), [], "{k}");
        }
        // A bake without probes skips the effect with a reason.
        let mut state = static_state();
        state.scenes[0].probes = false;
        let reason = (A, None, SkipReason::NoProbes);
        assert!(plan_frame(&state).skipped.contains(&reason));
    }
}
