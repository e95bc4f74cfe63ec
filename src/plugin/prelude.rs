//! What most apps use, by name.

pub use super::{
    MeshlessGi, MeshlessGiAsset, MeshlessGiBouncer, MeshlessGiCamera, MeshlessGiChannels,
    MeshlessGiDisplay, MeshlessGiForwardCamera, MeshlessGiGloss, MeshlessGiLight,
    MeshlessGiLighting, MeshlessGiMaterials, MeshlessGiOccluder, MeshlessGiPlugin,
    MeshlessGiPointCloud, MeshlessGiPoints, MeshlessGiQuality, MeshlessGiReflective, MeshlessGiSky,
    MeshlessGiSoftShadow, MeshlessGiSystems, MeshlessGiVolume,
};
