//! What most apps use, by name.

pub use super::{
    MeshlessGi, MeshlessGiAsset, MeshlessGiBouncer, MeshlessGiCamera, MeshlessGiDisplay,
    MeshlessGiLight, MeshlessGiLighting, MeshlessGiPlugin, MeshlessGiQuality, MeshlessGiReflective,
    MeshlessGiSystems,
};
