//! What most apps use, by name.

pub use super::{
    MeshlessGi, MeshlessGiAsset, MeshlessGiBake, MeshlessGiBakeCommands, MeshlessGiBakeError,
    MeshlessGiBakeExclude, MeshlessGiBakeFinished, MeshlessGiBakeProgress, MeshlessGiBakeRequest,
    MeshlessGiBakeStage, MeshlessGiBakeSummary, MeshlessGiBakeWarning, MeshlessGiBouncer,
    MeshlessGiCamera, MeshlessGiCapture, MeshlessGiChannels, MeshlessGiDisplay, MeshlessGiFinding,
    MeshlessGiFindings, MeshlessGiForwardCamera, MeshlessGiGloss, MeshlessGiLight,
    MeshlessGiLighting, MeshlessGiMaterials, MeshlessGiOccluder, MeshlessGiPlugin,
    MeshlessGiPointCloud, MeshlessGiPoints, MeshlessGiQuality, MeshlessGiReflective,
    MeshlessGiSettings, MeshlessGiSky, MeshlessGiSoftShadow, MeshlessGiStatus, MeshlessGiSystems,
    MeshlessGiTier, MeshlessGiView, MeshlessGiVolume,
};
pub use meshless_gi::bake::{FreeSpaceLight, OccluderShape, Preset, Recipe};
