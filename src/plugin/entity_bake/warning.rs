//! Warnings of a bake: parts of a scene that it can't use as they are.

use bevy::mesh::PrimitiveTopology;
use bevy::reflect::prelude::*;
use std::path::PathBuf;

/// Part of a scene that a bake left out or replaced, or a result that it could not save. `Display`
/// has the cause and the remedy. Entities are given with their names, assets with their paths.
#[derive(Reflect, Clone, Debug, PartialEq, thiserror::Error)]
#[reflect(opaque)]
#[reflect(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum GiBakeWarning {
    /// The mesh has no data in the main world.
    #[error(
        "{entity}: mesh {mesh} is in the render world alone and is not in the bake; \
         give it `RenderAssetUsages::MAIN_WORLD` (glTF: `GltfLoaderSettings::load_meshes`)"
    )]
    MeshInRenderWorld {
        /// Entity with the mesh.
        entity: String,
        /// The mesh.
        mesh: String,
    },
    /// The mesh can't be read for another reason.
    #[error("{entity}: mesh {mesh} is not in the bake: {reason}")]
    MeshUnreadable {
        /// Entity with the mesh.
        entity: String,
        /// The mesh.
        mesh: String,
        /// Cause.
        reason: String,
    },
    /// The mesh consists of points or lines.
    #[error("{entity}: mesh {mesh} is not in the bake: {topology:?} has no surface")]
    NoTriangles {
        /// Entity with the mesh.
        entity: String,
        /// The mesh.
        mesh: String,
        /// Topology of the mesh.
        topology: PrimitiveTopology,
    },
    /// Some triangles of the mesh can't be used.
    #[error(
        "{entity}: triangles left out of the bake: {count}. Their positions are not finite or their \
         indices out of range"
    )]
    BadTriangles {
        /// Entity with the mesh.
        entity: String,
        /// Number of triangles.
        count: u64,
    },
    /// An occluder is open when the meshes are collected.
    #[error(
        "{entity}: occluder `{name}` is {percent} % open, and the bake uses the current positions \
         of its meshes; shut it before `bake_gi`, with `GiOccluder::transmittance` 0"
    )]
    OpenOccluder {
        /// Entity with the occluder.
        entity: String,
        /// Name of the occluder.
        name: String,
        /// Transmittance in percent.
        percent: u32,
    },
    /// No triangle of the mesh has an area.
    #[error("{entity}: its mesh has no area and is not in the bake; is a scale zero?")]
    NoArea {
        /// Entity with the mesh.
        entity: String,
    },
    /// A textured mesh has no texture coordinates.
    #[error(
        "{entity}: mesh {mesh} has no texture coordinates for a texture of its material; they are 0"
    )]
    NoTextureCoordinates {
        /// Entity with the mesh.
        entity: String,
        /// The mesh.
        mesh: String,
    },
    /// The material is not a `StandardMaterial`.
    #[error(
        "{entity}: its material is not a `StandardMaterial`; the bake has a gray surface (albedo \
         0.5) there. Add `GiBakeExclude` to leave it out"
    )]
    CustomMaterial {
        /// Entity with the mesh.
        entity: String,
    },
    /// The material is not loaded and never will be.
    #[error("{entity}: material {material} is missing; the bake has a gray surface (albedo 0.5)")]
    MaterialMissing {
        /// Entity with the material.
        entity: String,
        /// The material.
        material: String,
    },
    /// An image of the material can't be read.
    #[error(
        "{entity}: image {image} can't be read: {reason}. The bake has the {texture} factor of \
         material {material} without the texture"
    )]
    ImageUnreadable {
        /// First entity with the material.
        entity: String,
        /// The material.
        material: String,
        /// Use of the image in the material.
        texture: &'static str,
        /// The image.
        image: String,
        /// Cause and remedy.
        reason: String,
    },
    /// Values of materials are outside of the range of surfaces.
    #[error("{root}: {count} materials: {problem}")]
    MaterialRange {
        /// The root of the bake.
        root: String,
        /// Number of materials.
        count: u64,
        /// Problem and consequence.
        problem: &'static str,
    },
    /// A scene below the root is not loaded and never will be.
    #[error("{entity}: its scene is not in the bake: {reason}")]
    SceneMissing {
        /// Entity with the scene.
        entity: String,
        /// Cause.
        reason: String,
    },
    /// Point clouds are not collected.
    #[cfg(feature = "point_clouds")]
    #[error(
        "{entity}: point clouds are not collected; \
         join their meshes (`PointCloud::mesh`) with the others and use `GiBakeTask::spawn`"
    )]
    PointCloud {
        /// Entity with the cloud.
        entity: String,
    },
    /// The file of an earlier bake can't be read.
    #[error("{}: can't be used and is baked again: {reason}", path.display())]
    NotLoaded {
        /// The file.
        path: PathBuf,
        /// Cause.
        reason: String,
    },
    /// The bake could not be saved. Its light is used all the same.
    #[error("{}: the bake is not saved: {reason}", path.display())]
    NotSaved {
        /// The file.
        path: PathBuf,
        /// Cause.
        reason: String,
    },
    /// A warning of the bake itself.
    #[error("{0}")]
    Bake(String),
}
