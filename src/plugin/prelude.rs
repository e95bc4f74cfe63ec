//! What most apps use, by name.

pub use super::{
    GiActiveTier, GiBakeCommands, GiBakeError, GiBakeExclude, GiBakeFinished, GiBakeProgress,
    GiBakeRequest, GiBakeStage, GiBakeSummary, GiBakeTask, GiBakeWarning, GiBakedScene,
    GiBounceCount, GiCamera, GiColorMode, GiDebugView, GiDynamicMaterials, GiEnvironment,
    GiForwardCamera, GiFrameStats, GiIrradianceVolume, GiLight, GiOccluder, GiPointCloud,
    GiPointCloudAsset, GiQuality, GiReflectiveShadowMap, GiReflector, GiRenderSystems, GiRsmCamera,
    GiScene, GiSettings, GiSky, GiSoftShadow, GiSolver, GiSpecular, GiSplatting, GiSystems,
    GiVolumetricFog, GiWarning, GiWarnings, MeshlessGiPlugin,
};
pub use meshless_gi::{OccluderDesc, Preset, ProbeSettings, Recipe};
