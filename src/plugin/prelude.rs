//! What most apps use, by name.

pub use super::{
    MeshlessGi, MeshlessGiAsset, MeshlessGiBouncer, MeshlessGiCamera, MeshlessGiDisplay,
    MeshlessGiGloss, MeshlessGiLight, MeshlessGiLighting, MeshlessGiMaterials, MeshlessGiPlugin,
    MeshlessGiPointCloud, MeshlessGiPoints, MeshlessGiQuality, MeshlessGiReflective, MeshlessGiSky,
    MeshlessGiSoftShadow, MeshlessGiSystems, MeshlessGiVolume,
};
