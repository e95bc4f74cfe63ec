//! Effect `vpl_specular`: specular reflection of the virtual point lights in each view.
//!
//! Reads: the views that show specular reflections, and whether virtual lights light them.
//! Kernel: `vpl_specular`; the draw `composite`.

pub(crate) mod specular;

use super::display::draw_over_picture;
use super::rsm::{self, Reflections};
use super::{Effect, PassKind, Record, Recording};
use crate::gpu;
use crate::gpu::{Draw, GpuError, NodeLights, SpecularBuffers, SubsplatTargets};
use crate::plan::{
    FrameStage, FrameState, Pass, Plan, RunReason, SceneId, SkipReason, Timing, ViewState, Work,
};
use crate::plugin::GiSpecular;
use crate::plugin::effect_states::EffectState;
use crate::plugin::record::ViewContext;
use crate::plugin::view_state::screen_texture;
use bevy::app::App;
use meshless_gi::internals::frame::{SubsplatParams, VplParams, VplViewParams};

pub(super) const EFFECT: Effect = Effect {
    name: "vpl_specular",
    summary: "shows dynamic objects in glossy surfaces, in the views that enable it",
    schedule,
    passes: &[PassKind {
        stage: FrameStage::VPL_SPECULAR,
        per_view: true,
        timing: Timing::With(FrameStage::VPL_SPECULAR),
        work: |state, pass| Work::Pixels(state.pixels(pass.view)),
        record: Recording {
            kernels: &[
                gpu::EntryPoint::VplSpecular,
                gpu::EntryPoint::VplSpecularPixels,
            ],
            draws: None,
            how: Record::View(record),
        },
    }],
};

/// Adds the component to the main world.
pub(super) fn add_to_app(app: &mut App) {
    app.register_type::<GiSpecular>();
}

fn schedule(state: &FrameState, plan: &mut Plan) {
    let stage = FrameStage::VPL_SPECULAR;
    let shown = |view: &&ViewState| view.specular && rsm::lights_view(state, view);
    for view in state.views.iter().filter(shown) {
        if view.refused.contains(&stage) {
            let reason = SkipReason::ViewBeyondLimits;
            (plan.skipped).push((SceneId::WORLD, Some(view.id), reason));
            continue;
        }
        plan.push(EFFECT.name, stage, SceneId::WORLD, RunReason::InView)
            .view = Some(view.id);
    }
}

fn record(ctx: &mut ViewContext<'_>, _: &[&Pass]) -> Option<()> {
    let settings = ctx.input.camera.specular.map(|s| s.0)?;
    let reflections = ctx.world_states.get::<Reflections>()?;
    let surfaces = ctx.input.surfaces;
    let (screen, params) = settings.params(
        surfaces.clip_from_view().inverse(),
        surfaces.world_from_view().inverse(),
        surfaces.viewport(),
        surfaces.size,
    );
    let (device, before) = (ctx.kernels.device(), ctx.earlier.take());
    let mut view = match ViewSpecular::fit(before, device, ctx.queue, &screen) {
        Ok(view) => view,
        Err(error) => {
            let stage = FrameStage::VPL_SPECULAR;
            (ctx.runtime).refuse(stage, "shows no specular reflections", &error);
            return Some(());
        }
    };
    let lights = reflections.view_lights(ctx.input, ctx.scenes, &ctx.shown);
    (ctx.queue).write_buffer(&view.view, 0, bytemuck::bytes_of(&lights.view));
    (ctx.queue).write_buffer(&view.lit, 0, bytemuck::bytes_of(&lights.lit));
    view.buffers.write(ctx.queue, &screen, &params);
    let before = view.buffers.counters();
    view.buffers.record(
        ctx.kernels,
        ctx.encoder,
        &SubsplatTargets {
            depth: surfaces.depth,
            gbuffer: surfaces.gbuffer,
            output: &view.radiance,
        },
        &NodeLights {
            maps: lights.maps,
            view: &view.view,
            lit: &view.lit,
            shadows: lights.shadows,
        },
    );
    ctx.counters
        .add(&view.buffers.counters().difference_from(&before));
    let drawn = draw_over_picture(ctx, Draw::Specular, &view.radiance);
    ctx.runtime.states.insert(view);
    drawn
}

/// Buffers and the texture of a view.
pub(crate) struct ViewSpecular {
    buffers: SpecularBuffers,
    view: wgpu::Buffer,
    lit: wgpu::Buffer,
    /// Specular radiance of every pixel.
    radiance: wgpu::TextureView,
    size: [u32; 2],
}

impl ViewSpecular {
    /// Keeps buffers that fit the view, and creates others otherwise.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], see [`SpecularBuffers::new`].
    fn fit(
        before: Option<Self>,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        screen: &SubsplatParams,
    ) -> Result<Self, GpuError> {
        let levels = screen.levels();
        if let Some(view) = before.filter(|view| view.buffers.levels() == levels) {
            return Ok(view);
        }
        let uniform = |bytes: usize| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("meshless_gi vpl_specular of a view"),
                size: bytes as u64,
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        Ok(Self {
            buffers: SpecularBuffers::new(device, queue, levels)?,
            view: uniform(size_of::<VplViewParams>()),
            lit: uniform(size_of::<VplParams>()),
            radiance: screen_texture(device, "meshless_gi vpl_specular", levels.size),
            size: levels.size,
        })
    }
}

impl EffectState for ViewSpecular {
    fn size(&self) -> (u32, u64) {
        let texture = 8 * u64::from(self.size[0]) * u64::from(self.size[1]);
        let own = self.view.size() + self.lit.size();
        (
            self.buffers.count() + 2,
            self.buffers.bytes() + own + texture,
        )
    }
}
