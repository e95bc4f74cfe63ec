//! The one public system set: what to order against.

use bevy::ecs::schedule::SystemSet;

/// Where the plugin's systems run.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum GiSystems {
    /// `PreUpdate` of the main world: counters of the last frame reach the diagnostics, finished
    /// bakes become [`GiScene`](super::GiScene) components. Order *after* it to see them in the
    /// same frame.
    Collect,
    /// `Update` of the main world: point clouds that have loaded get what they are drawn as
    /// ([`GiPointCloud`](super::GiPointCloud)).
    Points,
    /// `PostUpdate` of the main world: the tier of each root is picked
    /// ([`GiQuality`](super::GiQuality)). What was asked for before it counts in the same frame.
    Pick,
    /// `PostUpdate` of the main world, before transforms: volumes for forward cameras and
    /// transparent surfaces are made and removed
    /// ([`GiIrradianceVolume`](super::GiIrradianceVolume)).
    Shape,
    /// `PostUpdate` of the main world, after Bevy looked what its cameras see: our volumes are not
    /// for cameras of lamps' maps, nor for those whose [`GiCamera`](super::GiCamera) is off.
    Hide,
    /// `PostUpdate` of the main world, after transforms and before Bevy looks at its cameras: what
    /// moves is found, and the cameras of the lights that draw it
    /// ([`GiReflectiveShadowMap`](super::GiReflectiveShadowMap)) are aimed.
    Aim,
    /// `Last` of the main world: requested bakes start once everything below their roots is there
    /// ([`GiBakeRequest`](super::GiBakeRequest)). What was spawned before it counts.
    Request,
    /// `Last` of the main world: checks cameras and lights for what would be counted twice, and
    /// warns.
    Check,
    /// `ExtractSchedule` of the render world: scenes, lights and cameras are read. Change lights
    /// and transforms in the main world as always; everything written before the frame's end is
    /// seen in this frame.
    Extract,
    /// `RenderGraph` of the render world, before the cameras: the plan is made, and the passes that
    /// all cameras share are recorded. Order a pass of your own *after* it if it reads our buffers.
    Compute,
    /// `Core3d` of each camera, in its main pass, after the opaque pass and before transmissive and
    /// transparent ones: indirect light is added to the picture. Order *after* it what must lie
    /// over indirect light.
    Composite,
    /// `Core3d` of each camera, first of its early post-processing (anti-aliasing over time among
    /// it) and behind Bevy's volumetric fog: light that fog sends to the eye is added to the
    /// picture. What of that set is ordered *before* it stays so.
    Fog,
}
