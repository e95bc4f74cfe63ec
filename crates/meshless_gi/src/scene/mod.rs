//! Scenes: geometry, lights and readers. Basis and transport use a scene only through [`Geometry`]
//! (\[L08\] §5.1), so that any other representation can be added.
//!
//! Lengths are meters, right-handed, Y up. Light is linear RGB.

mod bvh;
mod bvh_build;
mod cornell;
#[cfg(feature = "json")]
mod description;
mod emitter_view;
mod emitters;
mod error;
mod geometry;
#[cfg(feature = "gltf")]
mod gltf;
mod implicit;
mod join;
mod light;
#[cfg(feature = "gltf")]
mod load;
#[cfg(feature = "gltf")]
mod loaded_scene;
mod material;
mod mesh;
mod mesh_problems;
#[cfg(not(feature = "point_clouds"))]
mod no_points;
mod occluder;
#[cfg(feature = "point_clouds")]
mod ply;
#[cfg(feature = "point_clouds")]
mod points;
mod read;
mod sh_deringing;
mod sky;
mod statue;
mod watertight;

#[cfg(not(feature = "point_clouds"))]
use no_points::RayOffsets;
#[cfg(feature = "point_clouds")]
use points::RayOffsets;

pub use bvh::{Bvh, BvhNode, BvhTriangle};
pub use cornell::Quad;
#[cfg(feature = "json")]
pub use description::SceneDescription;
pub use emitter_view::EmitterView;
pub use emitters::Emitters;
pub use error::SceneError;
pub use geometry::{Barrier, Bounds, Geometry, Hit, HitPoint, MaterialTerms, Ray, Surface};
#[cfg(feature = "gltf")]
pub use gltf::{Resolver, external_files, load_gltf, load_gltf_bytes, load_gltf_within};
pub use implicit::{ImplicitObject, ImplicitScene, Shape};
pub use light::{Light, sum_sky_lights};
#[cfg(feature = "gltf")]
pub use load::{load_geometry, load_geometry_within};
#[cfg(feature = "gltf")]
pub use loaded_scene::LoadedScene;
pub use material::{Material, MaterialFactors, Texture, Wrap};
pub use mesh::{TriangleMesh, TriangleUvs};
pub use mesh_problems::MeshProblems;
pub use occluder::{BoxPlanes, MeshNode, Occluder, OccluderGeometry};
#[cfg(feature = "point_clouds")]
pub use ply::{PlyEncoding, PlyError, PlyPoints, parse_ply, read_ply, read_ply_within, write_ply};
#[cfg(feature = "point_clouds")]
pub use points::{
    LoadedPoints, PointCloud, PointProblems, PointsError, load_ply, load_ply_bytes, load_ply_within,
};
pub use read::{InputBudget, ReadError, read_file};
pub use sky::SkyRadiance;
pub use statue::{statue, statue_room};
pub use watertight::{TriangleHit, WatertightRay};
