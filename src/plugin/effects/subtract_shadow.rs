//! Effect `subtract_shadow`: subtracts shadowed light from the picture of each view.
//!
//! Reads: the views that show the final picture, and the scenes with soft shadows in them. Kernel:
//! `subtract_shadow`; the draw `composite`. The effect `soft_shadows` computes the shadows.

use super::display::draw_over_picture;
use super::soft_shadows::{SceneSoft, check_supported};
use super::{Effect, PassKind, Record, Recording};
use crate::gpu;
use crate::gpu::{
    Draw, GpuCounters, GpuError, SceneBuffers, SoftShadowBuffers, SplatTargets,
    SubtractShadowBuffers, ViewBuffers,
};
use crate::plan::{
    FrameStage, FrameState, Pass, Plan, RunReason, SceneId, SkipReason, Timing, Work,
};
use crate::plugin::effect_states::EffectState;
use crate::plugin::record::{ViewContext, report_missing};
use crate::plugin::render_state::SceneRuntime;
use crate::plugin::view_state::screen_texture;
use meshless_gi::internals::frame::SoftLight;
use std::collections::BTreeMap;

pub(super) const EFFECT: Effect = Effect {
    name: "subtract_shadow",
    summary: "subtracts shadowed light from the picture of each view",
    schedule,
    passes: &[PassKind {
        stage: FrameStage::SUBTRACT_SHADOW,
        per_view: true,
        timing: Timing::With(FrameStage::SUBTRACT_SHADOW),
        work: |state, pass| Work::Pixels(state.pixels(pass.view)),
        record: Recording {
            kernels: &[
                gpu::EntryPoint::SubtractShadow,
                gpu::EntryPoint::SubtractShadowOver,
            ],
            draws: None,
            how: Record::View(record),
        },
    }],
};

fn schedule(state: &FrameState, plan: &mut Plan) {
    let stage = FrameStage::SUBTRACT_SHADOW;
    for view in state.views.iter().filter(|view| view.lit) {
        for scene in state.active_scenes().filter(|s| s.soft.lights > 0) {
            if !view.shows(scene.id) || check_supported(state, scene).is_err() {
                continue;
            }
            if view.refused.contains(&stage) {
                let reason = SkipReason::ViewBeyondLimits;
                plan.skipped.push((scene.id, Some(view.id), reason));
                continue;
            }
            plan.push(EFFECT.name, stage, scene.id, RunReason::InView)
                .view = Some(view.id);
        }
    }
}

fn record(ctx: &mut ViewContext<'_>, passes: &[&Pass]) -> Option<()> {
    match ViewShadow::record(ctx, passes) {
        Ok(radiance) => draw_over_picture(ctx, Draw::Shadow, &radiance?),
        Err(error) => {
            ctx.runtime
                .refuse(FrameStage::SUBTRACT_SHADOW, "shows no soft shadows", &error);
            Some(())
        }
    }
}

/// A scene with soft shadows in a view.
struct ShadowedScene<'a> {
    id: SceneId,
    soft: &'a SceneSoft,
    shadows: &'a SoftShadowBuffers,
    scene: &'a SceneBuffers,
    view: &'a ViewBuffers,
}

impl<'a> ShadowedScene<'a> {
    /// Finds the buffers of a scene. `None` if one is missing.
    fn find(
        scenes: &'a BTreeMap<SceneId, SceneRuntime>,
        views: &'a BTreeMap<SceneId, ViewBuffers>,
        id: SceneId,
    ) -> Option<Self> {
        let instance = scenes.get(&id)?;
        let soft = instance.states.get::<SceneSoft>()?;
        Some(Self {
            id,
            soft,
            shadows: soft.buffers.as_ref()?,
            scene: instance.frame.as_ref()?.buffers(),
            view: views.get(&id)?,
        })
    }
}

/// Textures and buffers of a view: radiance to subtract, in two textures for several scenes.
pub(crate) struct ViewShadow {
    size: [u32; 2],
    radiance: [Option<wgpu::TextureView>; 2],
    scenes: BTreeMap<SceneId, SubtractShadowBuffers>,
}

impl ViewShadow {
    /// Records the radiance to subtract. Each scene adds to the output of the previous one. Returns
    /// the last output. `None` if there is nothing to subtract.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] for more lights than the device binds.
    fn record(
        ctx: &mut ViewContext<'_>,
        passes: &[&Pass],
    ) -> Result<Option<wgpu::TextureView>, GpuError> {
        let Some(picture) = &ctx.input.picture else {
            return Ok(None);
        };
        let (instances, views) = (&*ctx.scenes, &ctx.runtime.buffers);
        let scenes: Vec<ShadowedScene> = (passes.iter())
            .filter_map(|pass| {
                let found = ShadowedScene::find(instances, views, pass.scene);
                report_missing(found.as_ref().map(drop), pass);
                found
            })
            .collect();
        let size = ctx.input.surfaces.size;
        let before = ctx.earlier.take::<Self>().filter(|held| held.size == size);
        if scenes.is_empty() {
            return Ok(None);
        }
        let mut view = before.unwrap_or_else(|| Self {
            size,
            radiance: [None, None],
            scenes: BTreeMap::new(),
        });
        (view.scenes).retain(|id, _| scenes.iter().any(|s| s.id == *id));
        let device = ctx.kernels.device();
        for (turn, made) in view.radiance.iter_mut().enumerate() {
            match turn < scenes.len() {
                true => {
                    let label = "meshless_gi subtract_shadow";
                    made.get_or_insert_with(|| screen_texture(device, label, size));
                }
                false => *made = None,
            }
        }
        let last = (scenes.len() - 1) % 2;
        for (turn, scene) in scenes.into_iter().enumerate() {
            // The lights that Bevy draws in this view.
            let layers = &ctx.input.camera.layers;
            let lights: Vec<SoftLight> = (scene.soft.lights.iter())
                .filter(|(of, _)| of.intersects(layers))
                .map(|(_, light)| *light)
                .collect();
            let buffers = match view.scenes.entry(scene.id) {
                std::collections::btree_map::Entry::Occupied(held) => held.into_mut(),
                std::collections::btree_map::Entry::Vacant(free) => {
                    free.insert(SubtractShadowBuffers::new(device, lights.len())?)
                }
            };
            let tables = picture.soft.tables.as_ref();
            buffers.write(
                ctx.kernels,
                ctx.queue,
                scene.scene,
                &lights,
                tables.is_some(),
            )?;
            let [output, earlier] = [&view.radiance[turn % 2], &view.radiance[1 - turn % 2]];
            let Some(output) = output else { continue };
            let before: GpuCounters = buffers.counters();
            let targets = SplatTargets {
                depth: ctx.input.surfaces.depth,
                gbuffer: ctx.input.surfaces.gbuffer,
                earlier: earlier.as_ref().filter(|_| turn > 0),
                output,
            };
            buffers.record(
                ctx.kernels,
                ctx.encoder,
                (scene.scene, scene.shadows),
                scene.view,
                &targets,
                tables,
            );
            ctx.counters
                .add(&buffers.counters().difference_from(&before));
        }
        let radiance = view.radiance[last].clone();
        ctx.runtime.states.insert(view);
        Ok(radiance)
    }
}

impl EffectState for ViewShadow {
    fn size(&self) -> (u32, u64) {
        let texture = 8 * u64::from(self.size[0]) * u64::from(self.size[1]);
        let textures = self.radiance.iter().flatten().count() as u64 * texture;
        let (count, bytes) =
            (self.scenes.values()).fold((0, 0), |(n, b), s| (n + s.count(), b + s.bytes()));
        (count, textures + bytes)
    }
}
