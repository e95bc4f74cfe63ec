//! What most apps use, by name.

pub use super::{
    GiActiveTier, GiBakeCommands, GiBakeError, GiBakeExclude, GiBakeFinished, GiBakeProgress,
    GiBakeRequest, GiBakeStage, GiBakeSummary, GiBakeTask, GiBakeWarning, GiBakedScene, GiCamera,
    GiColorMode, GiDebugView, GiDynamicMaterials, GiForwardCamera, GiFrameStats,
    GiIrradianceVolume, GiLight, GiLighting, GiOccluder, GiPointCloud, GiPointCloudAsset,
    GiQuality, GiReflectiveShadowMap, GiReflector, GiRsmCamera, GiScene, GiSettings, GiSky,
    GiSoftShadow, GiSpecular, GiSplatting, GiSystems, GiWarning, GiWarnings, MeshlessGiPlugin,
};
pub use meshless_gi::{OccluderDesc, Preset, ProbeSettings, Recipe};
