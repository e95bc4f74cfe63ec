//! Recording of the passes of a camera in its post-processing.

use super::record::{PostProcessResources, PostProcessView, PostProcessWorld, record_post_process};
use super::render_state::GiRender;
use crate::plan::ViewId;
use bevy::ecs::prelude::*;
use bevy::render::camera::{ExtractedCamera, TemporalJitter};
use bevy::render::renderer::{RenderContext, RenderQueue, ViewQuery};
use bevy::render::view::{ExtractedView, Msaa, ViewDepthTexture, ViewTarget};

type View = (
    &'static ExtractedView,
    &'static ExtractedCamera,
    &'static ViewTarget,
    &'static ViewDepthTexture,
    &'static Msaa,
    Option<&'static TemporalJitter>,
);

/// Runs in [`GiRenderSystems::CompositeFog`](super::GiRenderSystems::CompositeFog).
pub(crate) fn post_process(
    view: ViewQuery<View>,
    resources: PostProcessResources,
    mut render: ResMut<GiRender>,
    queue: Res<RenderQueue>,
    mut ctx: RenderContext,
) {
    let (view, camera, target, depth, msaa, jitter) = view.into_inner();
    let view = PostProcessView {
        id: ViewId(view.retained_view_entity.main_entity.to_bits()),
        view,
        camera,
        target,
        depth,
        sampled: *msaa != Msaa::Off,
        jitter,
    };
    let world = PostProcessWorld::from(resources);
    record_post_process(&mut render, &view, &world, &queue, &mut ctx);
}
