//! Recording of the passes of a deferred camera, over its picture.

use super::extract::ExtractedGi;
use super::record::{FramePoint, Picture, Surfaces, ViewInput, has_passes, record_view};
use super::render_state::GiRender;
use super::soft_shadow::ExtractedSoft;
use crate::plan::ViewId;
use bevy::core_pipeline::prepass::ViewPrepassTextures;
use bevy::ecs::prelude::*;
use bevy::log::warn_once;
use bevy::render::camera::{ExtractedCamera, TemporalJitter};
use bevy::render::renderer::{RenderContext, RenderQueue, ViewQuery};
use bevy::render::view::{ExtractedView, ViewTarget};

type View = (
    &'static ExtractedView,
    &'static ExtractedCamera,
    &'static ViewTarget,
    &'static ViewPrepassTextures,
    Option<&'static TemporalJitter>,
);

/// Runs in [`GiRenderSystems::Composite`](super::GiRenderSystems::Composite).
pub(crate) fn composite(
    view: ViewQuery<View>,
    world: Res<ExtractedGi>,
    soft: Res<ExtractedSoft>,
    mut render: ResMut<GiRender>,
    queue: Res<RenderQueue>,
    mut ctx: RenderContext,
) {
    let (view, camera, target, prepass, jitter) = view.into_inner();
    let id = ViewId(view.retained_view_entity.main_entity.to_bits());
    let Some(settings) = world.views.iter().find(|v| v.id == id && !v.forward) else {
        return;
    };
    if !has_passes(render.effects, &render.plan, id, FramePoint::MainPass) {
        return;
    }
    let (Some(depth), Some(gbuffer), Some(passes)) = (
        prepass.depth_view(),
        prepass.deferred_view(),
        prepass.deferred_lighting_pass_id.as_ref(),
    ) else {
        warn_once!(
            "a camera with indirect light has no G-buffer: it has no deferred materials in view, or not all prepasses"
        );
        return;
    };
    let surfaces = Surfaces {
        view,
        camera,
        jitter,
        depth,
        gbuffer,
        size: [prepass.size.width, prepass.size.height],
    };
    let input = ViewInput {
        camera: settings,
        surfaces: &surfaces,
        picture: Some(Picture {
            target,
            lighting_passes: &passes.texture.default_view,
            soft: &soft,
        }),
        world: &world,
    };
    record_view(&mut render, &input, &queue, &mut ctx);
}
