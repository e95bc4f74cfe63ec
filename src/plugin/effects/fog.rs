//! Effect `fog`: probe irradiance that fog scatters to the camera, added to the picture of each
//! view.
//!
//! Reads: the fog volumes of each view that lie in a scene with an irradiance volume. Runs in every
//! frame with such fog in view. Kernel: `fog_inscatter`; the draw `fog`. A system records it in
//! Bevy's post-processing, behind Bevy's own fog.

use super::{Effect, PassKind, Record, Recording};
use crate::gpu;
use crate::gpu::{FogBuffers, FogTextures, KernelPipelines, draw_fog};
use crate::plan::{FogState, FrameStage, FrameState, Plan, RunReason, SceneId, ViewId, Work};
use crate::plugin::extract::ExtractedGi;
pub(crate) use crate::plugin::fog::ExtractedFogs;
use crate::plugin::fog::{ExtractedFogView, FogScene, LitFog, meet};
use crate::plugin::record::Spans;
use crate::plugin::render_state::GiRender;
use crate::plugin::volume::{ExtractedVolume, ExtractedVolumes};
use bevy::ecs::prelude::*;
use bevy::ecs::system::SystemParam;
use bevy::math::{Affine3A, Mat4};
use bevy::render::camera::{ExtractedCamera, TemporalJitter};
use bevy::render::diagnostic::RecordDiagnostics;
use bevy::render::render_asset::RenderAssets;
use bevy::render::render_resource::RenderPassDescriptor;
use bevy::render::renderer::{RenderContext, RenderDevice, RenderQueue, ViewQuery};
use bevy::render::texture::{FallbackImage, GpuImage};
use bevy::render::view::{ExtractedView, Msaa, ViewDepthTexture, ViewTarget};
use meshless_gi::internals::frame::{Fog, FogInscatterParams, FogParams, FogView};

pub(super) const EFFECT: Effect = Effect {
    name: "fog",
    summary: "adds the probe irradiance that fog scatters to the camera, in scenes with a volume",
    schedule,
    passes: &[PassKind {
        stage: FrameStage::FOG,
        per_view: true,
        timed_with: Some(FrameStage::FOG),
        work: |state, pass| {
            let own = |f: &&FogState| Some(f.view) == pass.view && f.scene == pass.scene;
            let fog = state.fogs.iter().find(own);
            Work::Pixels(fog.map_or(0, |f| f.pixels * f.volumes as u64))
        },
        record: Recording {
            kernels: &[gpu::Pass::FogInscatter],
            draws: Some(|counters| counters.fogs),
            how: Record::System,
        },
    }],
};

/// Adds a pass for each view and scene. The effect `volume` reports a bake without probes.
fn schedule(state: &FrameState, plan: &mut Plan) {
    for fog in state.fogs.iter().filter(|f| f.volumes > 0) {
        let scene = state.active_scenes().find(|s| s.id == fog.scene);
        if scene.is_some_and(|s| s.volume.asked && s.probes) {
            let (stage, reason) = (FrameStage::FOG, RunReason::FogInView(fog.volumes));
            plan.push(EFFECT.name, stage, fog.scene, reason).view = Some(fog.view);
        }
    }
}

/// World and textures that fog reads.
#[derive(SystemParam)]
pub(crate) struct FogInput<'w> {
    fogs: Res<'w, ExtractedFogs>,
    volumes: Res<'w, ExtractedVolumes>,
    world: Res<'w, ExtractedGi>,
    images: Res<'w, RenderAssets<GpuImage>>,
    fallback: Res<'w, FallbackImage>,
}

type View = (
    &'static ExtractedView,
    &'static ExtractedCamera,
    &'static ViewTarget,
    &'static ViewDepthTexture,
    &'static Msaa,
    Option<&'static TemporalJitter>,
);

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
    /// Collects the draws of a view, in the order of its fog volumes. `seen` is the camera without
    /// the intensity of a scene.
    fn new(
        view: &ExtractedFogView,
        seen: &FogView,
        input: &'a FogInput<'_>,
        ready: &ReadyVolumes<'a>,
    ) -> Self {
        let mut out = Self::default();
        for lit in &view.lit {
            out.add(lit, seen, input, ready);
        }
        out
    }

    /// Adds the draw of a fog volume. Does nothing if the scene's volume is not written yet.
    fn add(
        &mut self,
        lit: &LitFog,
        seen: &FogView,
        input: &'a FogInput<'_>,
        ready: &ReadyVolumes<'a>,
    ) {
        let find = |id: SceneId| ready.iter().find(|(scene, ..)| *scene == id);
        let own: &FogScene = &input.fogs.scenes[lit.scene];
        let extracted = input.world.scenes.iter().find(|s| s.id == own.scene);
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
        let seen = FogView {
            exposure: seen.exposure * own.strength,
            ..*seen
        };
        let world_from_local = Mat4::from(placement.world_from_local);
        let key = (lit.scene, fog.asymmetry);
        let light = self.lights.iter().position(|k| *k == key);
        let light = light.unwrap_or_else(|| {
            let shape = volume.shape();
            let params = FogInscatterParams::new(&seen, fog.asymmetry, shape, &world_from_local);
            self.lights.push(key);
            self.inscatter.push(params);
            self.volumes.push(written);
            self.lights.len() - 1
        });
        let cube = Affine3A::from_mat4(fog.world_from_local);
        let earlier: Vec<Mat4> = (input.fogs.scenes[..lit.scene].iter())
            .filter(|other| meet(&other.cube, &own.cube) && meet(&other.cube, &cube))
            .filter(|other| find(other.scene).is_some())
            .map(|other| other.cube.into())
            .collect();
        self.params.push(FogParams::new(
            &seen,
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
        (view, target, depth): (&ExtractedView, &ViewTarget, &wgpu::TextureView),
        sampled: bool,
    ) {
        let mut pass = encoder.begin_render_pass(&RenderPassDescriptor {
            label: Some("meshless_gi fog"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                // Multisampled pictures are resolved by now.
                view: target.main_texture_view(),
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
        let [x, y, width, height] = view.viewport.to_array();
        pass.set_viewport(x as f32, y as f32, width as f32, height as f32, 0.0, 1.0);
        pass.set_scissor_rect(x, y, width, height);
        let format = view.target_format;
        for (index, draw) in self.draws.iter().enumerate() {
            let textures = FogTextures {
                depth,
                sampled,
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

/// Records the fog passes of a view. Runs in
/// [`GiRenderSystems::CompositeFog`](crate::plugin::GiRenderSystems::CompositeFog).
pub(crate) fn draw(
    view: ViewQuery<View>,
    input: FogInput,
    mut render: ResMut<GiRender>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
    mut ctx: RenderContext,
) {
    let (view, camera, target, depth, msaa, jitter) = view.into_inner();
    let id = ViewId(view.retained_view_entity.main_entity.to_bits());
    let GiRender {
        plan,
        scenes,
        fogs,
        kernels,
        retired,
        ..
    } = &mut *render;
    let (Some(fogged), Some(kernels)) = (input.fogs.view(id), kernels) else {
        return;
    };
    let passes = plan.of_view(id).filter(|p| p.stage == FrameStage::FOG);
    let ready = passes.filter_map(|pass| {
        let volume = input.volumes.find(pass.scene)?;
        let written = scenes.get(&pass.scene)?.volume.texture(volume)?;
        Some((pass.scene, volume, written))
    });
    let ready: ReadyVolumes = ready.collect();
    let mut clip_from_view = view.clip_from_view;
    if let (Some(jitter), Some(size)) = (jitter, camera.physical_viewport_size) {
        jitter.jitter_projection(&mut clip_from_view, size.as_vec2());
    }
    let seen = FogView {
        view_from_clip: clip_from_view.inverse(),
        world_from_view: view.world_from_view.to_matrix(),
        viewport: view.viewport.as_vec4().to_array(),
        exposure: camera.exposure * fogged.intensity,
        steps: fogged.steps,
    };
    let draws = FogDraws::new(fogged, &seen, &input, &ready);
    let readable = wgpu::TextureUsages::TEXTURE_BINDING;
    if draws.params.is_empty() || !depth.texture.usage().contains(readable) {
        fogs.remove(&id);
        return;
    }
    let buffers = fogs.entry(id).or_default();
    buffers.write(
        device.wgpu_device(),
        &queue,
        &draws.inscatter,
        &draws.params,
    );
    let recorder = ctx.diagnostic_recorder();
    let recorder = recorder.as_deref();
    let encoder = ctx.command_encoder();
    let whole = recorder.time_span(encoder, "meshless_gi_fog");
    let mut spans = Spans::new(recorder);
    let scope = plan.of_view(id).find(|p| p.stage == FrameStage::FOG);
    spans.enter(encoder, scope.and_then(|p| p.timing));
    let recorded = buffers.record(kernels, encoder, &draws.volumes);
    let picture = (view, target, &**depth.view());
    draws.draw(kernels, encoder, buffers, picture, *msaa != Msaa::Off);
    spans.enter(encoder, None);
    whole.end(encoder);
    retired.add(&recorded);
    retired.fogs += draws.params.len() as u64;
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
    fn at_rest() -> FrameState {
        FrameState {
            scenes: vec![SceneState {
                resident: true,
                probes: true,
                slots: vec![SlotChange::None; 2],
                volume: VolumeState {
                    asked: true,
                    seen: true,
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
        let mut state = at_rest();
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
            |s| s.scenes[0].volume.asked = false,
            |s| s.scenes[0].probes = false,
            |s| s.device_able = false,
        ];
        for (k, change) in cases.into_iter().enumerate() {
            let mut state = at_rest();
            change(&mut state);
            assert_eq!(stages(&state), [], "{k}");
        }
        // A bake without probes skips the effect with a reason.
        let mut state = at_rest();
        state.scenes[0].probes = false;
        let why = (A, None, SkipReason::NoFreeSpace);
        assert!(plan_frame(&state).skipped.contains(&why));
    }
}
