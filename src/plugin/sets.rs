//! System sets of the plugin, to order systems of a game against.

use bevy::ecs::schedule::SystemSet;

/// System sets in the schedules of the main world.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum GiSystems {
    /// `PreUpdate`: publishes the counters of the last frame as diagnostics, and adds
    /// [`GiScene`](super::GiScene) to the roots of finished bakes. Run after it to read them in the
    /// same frame.
    CollectBakes,
    /// `Update`: spawns the meshes of loaded point clouds ([`GiPointCloud`](super::GiPointCloud)).
    #[cfg(feature = "point_clouds")]
    UpdatePointClouds,
    /// `PostUpdate`: selects the tier of each root ([`GiQuality`](super::GiQuality)). Settings that
    /// change before it apply to the same frame.
    SelectTiers,
    /// `PostUpdate`, before transform propagation: creates and removes the irradiance volumes of
    /// roots ([`GiIrradianceVolume`](super::GiIrradianceVolume)).
    UpdateVolumes,
    /// `PostUpdate`, after Bevy's visibility checks: removes irradiance volumes from the visible
    /// entities of cameras that must not use them. These are the cameras of reflective shadow maps
    /// and cameras whose [`GiCamera`](super::GiCamera) is disabled.
    FilterVolumes,
    /// `PostUpdate`, after transform propagation and before Bevy's camera update: finds dynamic
    /// objects and positions the cameras of [`GiReflectiveShadowMap`](super::GiReflectiveShadowMap)
    /// lights.
    UpdateRsmCameras,
    /// `Last`: starts requested bakes whose scene is complete
    /// ([`GiBakeRequest`](super::GiBakeRequest)). Entities that are spawned before it are included.
    StartBakes,
    /// `Last`: checks cameras, lights and scenes, and warns about settings without effect or with
    /// light that is counted twice.
    Validate,
}

/// System sets in the schedules of the render world.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum GiRenderSystems {
    /// `ExtractSchedule`: reads scenes, lights and cameras. Changes of the main world's frame apply
    /// to the same frame.
    Extract,
    /// `RenderGraph`, before the cameras: computes the plan and records the passes that all cameras
    /// share. Run a pass that reads the plugin's buffers after it.
    Solve,
    /// `Core3d` of each camera, in the main pass, after the opaque pass and before the transmissive
    /// and transparent passes: adds indirect light to the picture. Run a pass that draws over
    /// indirect light after it.
    Composite,
    /// `Core3d` of each camera, first in early post-processing and after Bevy's volumetric fog:
    /// adds indirect light that fog scatters. Systems that are ordered before it stay before it.
    CompositeFog,
}
