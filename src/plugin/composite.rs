//! Recording of the passes of a deferred camera, over its picture.

use super::effects::soft_shadows::soft_lights::ExtractedSoft;
use super::extract::ExtractedGi;
use super::record::{Picture, Surfaces, ViewInput, record_view};
use super::render_state::GiRender;
use crate::plan::ViewId;
use bevy::core_pipeline::prepass::ViewPrepassTextures;
use bevy::ecs::prelude::*;
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
    let gbuffer = prepass.depth_view().zip(prepass.deferred_view());
    let gbuffer = gbuffer.zip(prepass.deferred_lighting_pass_id.as_ref());
    let surfaces = gbuffer.map(|((depth, gbuffer), passes)| {
        let surfaces = Surfaces {
            view,
            camera,
            jitter,
            depth,
            gbuffer,
            size: [prepass.size.width, prepass.size.height],
        };
        (surfaces, &passes.texture.default_view)
    });
    let input = (surfaces.as_ref()).map(|(surfaces, lighting_passes)| ViewInput {
        camera: settings,
        surfaces,
        picture: Some(Picture {
            target,
            lighting_passes,
            soft: &soft,
        }),
        world: &world,
    });
    record_view(&mut render, id, input.as_ref(), &queue, &mut ctx);
}
