//! What most apps use, by name.

pub use super::{
    MeshlessGi, MeshlessGiAsset, MeshlessGiCamera, MeshlessGiLight, MeshlessGiLighting,
    MeshlessGiPlugin, MeshlessGiQuality, MeshlessGiSystems,
};
