//! What most apps use, by name.

pub use super::{
    MeshlessGi, MeshlessGiAsset, MeshlessGiBouncer, MeshlessGiCamera, MeshlessGiLight,
    MeshlessGiLighting, MeshlessGiPlugin, MeshlessGiQuality, MeshlessGiReflective,
    MeshlessGiSystems,
};
