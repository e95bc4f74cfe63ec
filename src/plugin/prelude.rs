//! What most apps use, by name.

pub use super::{
    MeshlessGi, MeshlessGiAsset, MeshlessGiBouncer, MeshlessGiCamera, MeshlessGiDisplay,
    MeshlessGiGloss, MeshlessGiLight, MeshlessGiLighting, MeshlessGiPlugin, MeshlessGiPointCloud,
    MeshlessGiPoints, MeshlessGiQuality, MeshlessGiReflective, MeshlessGiSoftShadow,
    MeshlessGiSystems, MeshlessGiVolume,
};
