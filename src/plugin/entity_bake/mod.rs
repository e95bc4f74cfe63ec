//! Bakes from entities: the static meshes below a root become the geometry of a bake.
//!
//! ```no_run
//! use bevy::prelude::*;
//! use bevy_meshless_gi::prelude::*;
//!
//! fn set_up(
//!     mut commands: Commands,
//!     mut meshes: ResMut<Assets<Mesh>>,
//!     mut materials: ResMut<Assets<StandardMaterial>>,
//! ) {
//!     let floor = (
//!         Mesh3d(meshes.add(Cuboid::new(8.0, 0.1, 8.0))),
//!         MeshMaterial3d(materials.add(Color::srgb(0.8, 0.2, 0.2))),
//!     );
//!     commands
//!         .spawn((Transform::default(), Visibility::default(), children![floor]))
//!         .bake_gi(Recipe::default());
//! }
//! ```
//!
//! | file | content |
//! |---|---|
//! | `request` | the component that requests a bake |
//! | `commands` | [`GiBakeCommands::bake_gi`] |
//! | `exclude` | the marker that leaves entities out |
//! | `warning` | meshes, materials and images that a bake can't use |
//! | `walk` | visits the hierarchy: static meshes with their transforms in the root's space |
//! | `wait` | scenes and assets that are not there yet |
//! | `collect` | copies meshes, materials and images out of the world |
//! | `mesh_data` | triangles, texture coordinates and vertex colors of a Bevy mesh |
//! | `material` | a `StandardMaterial` as a material of the bake |
//! | `reflection` | components of types that this crate can't name |
//! | `texture` | a Bevy image as a texture of the bake |
//! | `assemble` | joins all of it to one mesh, in an order that depends on content alone |
//! | `job` | the work of the bake's thread: assembles, loads or bakes, and saves |
//! | `systems` | starts requested bakes |
//! | `stale` | compares loaded bakes with the meshes that are there |
//! | `wrong_file` | warns of a scene file instead of a bake |

mod assemble;
mod collect;
mod commands;
mod exclude;
mod job;
mod material;
mod mesh_data;
mod reflection;
mod request;
pub(super) mod stale;
pub(super) mod systems;
mod texture;
mod wait;
mod walk;
mod warning;
pub(super) mod wrong_file;

pub use commands::GiBakeCommands;
pub use exclude::GiBakeExclude;
pub use request::GiBakeRequest;
pub use warning::GiBakeWarning;

use bevy::ecs::prelude::*;

/// Entity and name, for logs and errors.
fn label(world: &World, entity: Entity) -> String {
    match world.get::<Name>(entity) {
        Some(name) => format!("entity {entity} (`{name}`)"),
        None => format!("entity {entity}"),
    }
}
