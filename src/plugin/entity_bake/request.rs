//! The component that requests a bake of the meshes below its entity.

use super::super::bake_progress::GiBakeProgress;
use super::super::bake_task::GiBakeTask;
use bevy::camera::visibility::Visibility;
use bevy::ecs::lifecycle::HookContext;
use bevy::ecs::prelude::*;
use bevy::ecs::world::DeferredWorld;
use bevy::reflect::prelude::*;
use bevy::transform::components::Transform;
use meshless_gi::{Preset, Recipe};
use std::path::PathBuf;

/// Requests a bake of the static meshes on this entity and below it. Insert it with
/// [`bake_gi`](super::GiBakeCommands::bake_gi), or as a component.
///
/// The bake waits until scenes below the root are spawned and their meshes, materials and images
/// are loaded. Then it copies them and runs in the background. At its end the entity gets a
/// [`GiScene`](super::super::GiScene) and the event
/// [`GiBakeFinished`](super::super::GiBakeFinished), and this component is removed.
/// [`GiBakeProgress`] has the progress.
///
/// | action | effect |
/// |---|---|
/// | insert the component again | cancels the bake and starts the new one |
/// | remove the component, despawn the entity | cancels the bake |
///
/// # Collected meshes
///
/// | entity | in the bake |
/// |---|---|
/// | `Mesh3d` with `MeshMaterial3d<StandardMaterial>` | yes: base color, metallic and emissive factors and textures, UV transform, alpha cutoff, sides |
/// | `Mesh3d` with a material of another type | yes, as a gray surface (albedo 0.5), with a warning |
/// | `Mesh3d` without a material | no: Bevy does not draw it |
/// | [`GiBakeExclude`](super::GiBakeExclude), [`GiReflector`](super::super::GiReflector), or below one | no |
/// | `Visibility::Hidden` below the root, or inherited from there | no; the root's own visibility does not matter |
/// | `SkinnedMesh` | no |
/// | `GiPointCloud` | no, with a warning: join its mesh and use [`GiBakeTask`] |
/// | below another root with `GiScene` or `GiBakeRequest` | no: it belongs to that root |
///
/// Vertex colors multiply the base color, averaged over each triangle. Blended surfaces count as
/// opaque where their alpha is 0.5 or more. Morph targets have no effect. All surfaces block light,
/// `NotShadowCaster` ones too: exclude sky domes and glass.
///
/// A mesh or image without data in the main world (`RenderAssetUsages::RENDER_WORLD` alone) and a
/// compressed image can't be read. A warning names the entity, and the bake continues without them.
///
/// The name of an entity (`Name`, or the name of its
/// [`GiOccluder`](super::super::GiOccluder)) is the node name for the recipe's
/// `occluders`. With `dynamic_materials` the materials get names (from
/// [`GiDynamicMaterials`](super::super::GiDynamicMaterials) on the root, else `GltfMaterialName`,
/// else the asset path, else `material N`), and `GiDynamicMaterials` is inserted with all of them,
/// so that indirect light follows the assets.
#[derive(Component, Reflect, Clone, Debug, Default, PartialEq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
#[component(on_insert = restart, on_remove = cancel)]
#[require(Transform, Visibility)]
pub struct GiBakeRequest {
    /// Settings of the bake. `scene` is ignored.
    pub recipe: Recipe,
    /// File that holds the bake, relative to the working directory. If it exists and was baked from
    /// the same meshes with the same recipe, it is loaded instead of baking. If not, it is
    /// replaced. `None` keeps the bake in memory only.
    pub save_to: Option<PathBuf>,
}

impl GiBakeRequest {
    /// Creates a request with this recipe. The bake is kept in memory.
    #[must_use]
    pub fn new(recipe: Recipe) -> Self {
        Self {
            recipe,
            save_to: None,
        }
    }

    /// Sets the file that holds the bake ([`Self::save_to`](field@Self::save_to)).
    #[must_use]
    pub fn save_to(mut self, path: impl Into<PathBuf>) -> Self {
        self.save_to = Some(path.into());
        self
    }
}

impl From<Recipe> for GiBakeRequest {
    fn from(recipe: Recipe) -> Self {
        Self::new(recipe)
    }
}

impl From<Preset> for GiBakeRequest {
    fn from(preset: Preset) -> Self {
        Self::new(preset.into())
    }
}

fn restart(mut world: DeferredWorld, context: HookContext) {
    (world.commands().entity(context.entity))
        .try_remove::<GiBakeTask>()
        .try_insert(GiBakeProgress::default());
}

fn cancel(mut world: DeferredWorld, context: HookContext) {
    (world.commands().entity(context.entity)).try_remove::<(GiBakeTask, GiBakeProgress)>();
}
