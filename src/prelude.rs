//! Names that most games use: `use bevy_meshless_gi::prelude::*`.

pub use crate::{
    GiActiveTier, GiBakeCommands, GiBakeError, GiBakeExclude, GiBakeFinished, GiBakeProgress,
    GiBakeRequest, GiBakeSummary, GiBakeTask, GiBakeWarning, GiBakedScene, GiBounceCount, GiCamera,
    GiDebugView, GiDynamicMaterials, GiEnvironment, GiForwardCamera, GiFrameStats,
    GiIrradianceVolume, GiLight, GiOccluder, GiQuality, GiReflectiveShadowMap, GiReflector,
    GiRenderSystems, GiRsmCamera, GiScene, GiSettings, GiSky, GiSoftShadow, GiSolver, GiSpecular,
    GiSplatting, GiSystems, GiVolumetricFog, GiWarning, GiWarnings, MeshlessGiDebugPlugin,
    MeshlessGiPlugin,
};
pub use meshless_gi::{BakeStage, OccluderDesc, Preset, ProbeSettings, Recipe};
