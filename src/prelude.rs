//! Names that most games use: `use bevy_meshless_gi::prelude::*`.

pub use crate::{
    BakeStage, GiActiveTier, GiBakeCommands, GiBakeError, GiBakeExclude, GiBakeFinished,
    GiBakeProgress, GiBakeRequest, GiBakeSummary, GiBakeTask, GiBakeWarning, GiBakedScene,
    GiBounceCount, GiCamera, GiDebugView, GiDynamicMaterials, GiEnvironment, GiForwardCamera,
    GiFrameStats, GiIrradianceVolume, GiLight, GiOccluder, GiQuality, GiReflectiveShadowMap,
    GiReflector, GiRenderSystems, GiRsmCamera, GiScene, GiSettings, GiSky, GiSoftShadow, GiSolver,
    GiSpecular, GiSplatting, GiSystems, GiVolumetricFog, GiWarning, GiWarnings,
    MeshlessGiDebugPlugin, MeshlessGiPlugin, OccluderDesc, Preset, ProbeSettings, Recipe,
};
