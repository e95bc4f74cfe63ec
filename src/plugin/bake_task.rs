//! Baking inside a running game: a component that bakes in the background and becomes the scene's
//! light when it is done.
//!
//! ```no_run
//! use bevy::prelude::*;
//! use bevy_meshless_gi::prelude::*;
//! use bevy_meshless_gi::meshless_gi::{Quad, TriangleMesh};
//!
//! fn start(mut commands: Commands) {
//!     // A `TriangleMesh` in the local space of the entity that it is spawned on.
//!     let room = TriangleMesh::from_quads(&Quad::cornell_box());
//!     commands.spawn((Transform::default(), GiBakeTask::spawn(room, Recipe::default())));
//! }
//! ```
//!
//! Scenes of Bevy meshes need no `TriangleMesh`: see [`GiBakeRequest`].
//!
//! The bake runs on threads of its own, one less than the machine has, so that the game stays
//! responsive. It blocks none of Bevy's task pools. Despawning the entity or removing the component
//! cancels it.

use super::asset::GiBakedScene;
use super::background::Background;
use super::bake_error::GiBakeError;
use super::bake_finished::GiBakeFinished;
use super::bake_progress::GiBakeProgress;
use super::bake_summary::GiBakeSummary;
use super::effects::materials::dynamic_materials::GiDynamicMaterials;
use super::entity_bake::{GiBakeRequest, GiBakeWarning};
use super::scene::GiScene;
use super::scene_log::entity_label;
use bevy::asset::{Assets, Handle};
use bevy::ecs::lifecycle::HookContext;
use bevy::ecs::name::Name;
use bevy::ecs::prelude::*;
use bevy::ecs::world::DeferredWorld;
use bevy::log::{debug, error, warn};
use bevy::pbr::StandardMaterial;
use bevy::reflect::prelude::*;
use meshless_gi::{
    BakeSceneError, BakeStage, Baked, BakedScene, Progress, Recipe, TriangleMesh, bake_scene,
};
use std::sync::Arc;

/// Running bake. When it ends, the entity gets the event [`GiBakeFinished`], and after
/// success a [`GiScene`]. [`GiBakeProgress`] on the entity has its progress. Removing
/// the component cancels the bake.
#[derive(Component, Reflect)]
#[reflect(Component, from_reflect = false)]
#[component(on_remove = remove_progress)]
#[require(GiBakeProgress)]
pub struct GiBakeTask {
    #[reflect(ignore)]
    progress: Arc<Progress>,
    #[reflect(ignore)]
    work: Result<Background<Outcome>, String>,
    /// Materials that are inserted as [`GiDynamicMaterials`] with the light.
    #[reflect(ignore)]
    materials: NamedMaterials,
    /// Warnings that are in the log already.
    #[reflect(ignore)]
    warnings: Vec<GiBakeWarning>,
}

/// Names of a bake's materials and their assets.
pub(super) type NamedMaterials = Vec<(String, Handle<StandardMaterial>)>;

/// Result of the thread of a [`GiBakeTask`].
pub(super) type Outcome = Result<BakeOutput, GiBakeError>;

/// Baked scene, and the data of its summary.
pub(super) struct BakeOutput {
    pub(super) scene: BakedScene,
    pub(super) seconds: f64,
    /// The bake was loaded and not computed.
    pub(super) loaded: bool,
    /// Warnings that are in the log already.
    pub(super) logged: Vec<GiBakeWarning>,
    pub(super) warnings: Vec<GiBakeWarning>,
}

impl From<Baked> for BakeOutput {
    fn from(Baked { scene, stats, .. }: Baked) -> Self {
        let warnings = stats.warnings.into_iter();
        Self {
            scene,
            seconds: stats.seconds.total,
            loaded: false,
            logged: Vec::new(),
            warnings: warnings.map(GiBakeWarning::Bake).collect(),
        }
    }
}

impl GiBakeTask {
    /// Starts a bake of `scene`.
    #[must_use]
    pub fn spawn(mesh: TriangleMesh, recipe: Recipe) -> Self {
        Self::start(move |progress| {
            let baked = bake_scene(&mesh, &recipe, bake_threads(), progress)?;
            Ok(baked.into())
        })
    }

    /// Starts `work` on a thread of its own.
    pub(super) fn start(work: impl FnOnce(&Arc<Progress>) -> Outcome + Send + 'static) -> Self {
        let progress = Arc::new(Progress::default());
        let of_thread = progress.clone();
        let panicked = || Err(BakeSceneError::Threads("the bake panicked".into()).into());
        let work = Background::spawn("meshless gi bake", move || work(&of_thread), panicked);
        Self {
            progress,
            work: work.map_err(|error| error.to_string()),
            materials: Vec::new(),
            warnings: Vec::new(),
        }
    }

    /// Adds named materials, and warnings for the summary.
    pub(super) fn with(mut self, materials: NamedMaterials, warnings: Vec<GiBakeWarning>) -> Self {
        (self.materials, self.warnings) = (materials, warnings);
        self
    }

    /// The result, once, when it is there.
    fn take(&mut self) -> Option<Outcome> {
        match &mut self.work {
            Ok(work) => work.take(),
            Err(error) => Some(Err(BakeSceneError::Threads(std::mem::take(error)).into())),
        }
    }

    /// Stage of the bake and completed fraction of the stage, 0 to 1.
    #[must_use]
    pub fn progress(&self) -> (BakeStage, f32) {
        self.progress.get()
    }

    /// Requests that the bake stops. It ends soon after with
    /// [`BakeError::Canceled`](meshless_gi::BakeError::Canceled).
    pub fn cancel(&self) {
        self.progress.cancel();
    }
}

impl Drop for GiBakeTask {
    fn drop(&mut self) {
        self.progress.cancel();
    }
}

fn remove_progress(mut world: DeferredWorld, context: HookContext) {
    let mut commands = world.commands();
    (commands.entity(context.entity)).try_remove::<GiBakeProgress>();
}

/// Number of threads for a bake in a running game: one less than the machine has.
pub(crate) fn bake_threads() -> usize {
    std::thread::available_parallelism().map_or(1, |n| n.get().saturating_sub(1).max(1))
}

/// Runs in [`GiSystems::CollectBakes`](super::GiSystems::CollectBakes).
pub(crate) fn collect_bakes(
    mut commands: Commands,
    mut bakes: Query<(Entity, &mut GiBakeTask, &mut GiBakeProgress)>,
    mut assets: ResMut<Assets<GiBakedScene>>,
) {
    for (entity, mut bake, mut progress) in &mut bakes {
        let Some(outcome) = bake.take() else {
            progress.set_if_neq((&*bake.progress).into());
            continue;
        };
        let mut warnings = std::mem::take(&mut bake.warnings);
        let materials = std::mem::take(&mut bake.materials);
        let result = outcome.map(|output| {
            for warning in &output.warnings {
                warn!("{warning}");
            }
            warnings.extend(output.logged);
            warnings.extend(output.warnings);
            let scene = output.scene;
            let summary = GiBakeSummary {
                seconds: output.seconds,
                estimated_nrmse: scene.info().estimated_nrmse,
                triangles: scene.info().triangles,
                points: scene.data().points.len() as u64,
                links: scene.data().operator.links.len() as u64,
                loaded: output.loaded,
                warnings,
            };
            debug!(
                "{entity}: {} {} points and {} links in {:.1} s, estimated error {:.1} %",
                if summary.loaded { "loaded" } else { "baked" },
                summary.points,
                summary.links,
                summary.seconds,
                100.0 * summary.estimated_nrmse,
            );
            let light = GiScene(assets.add(GiBakedScene::from(scene)));
            (light, materials, summary)
        });
        // The entity may have been despawned, or another bake requested, in this very frame.
        (commands.entity(entity)).queue_silenced(move |entity: EntityWorldMut| {
            if entity.contains::<GiBakeTask>() {
                end(entity, result);
            }
        });
    }
}

/// Ends the bake of an entity: light and materials, if there are any, then the event.
pub(super) fn end(
    mut entity: EntityWorldMut,
    result: Result<(GiScene, NamedMaterials, GiBakeSummary), GiBakeError>,
) {
    entity.remove::<(GiBakeTask, GiBakeRequest, GiBakeProgress)>();
    let result = result.map(|(light, materials, summary)| {
        entity.insert(light);
        if !materials.is_empty() {
            // Names that the app has set stay.
            let own = entity.take::<GiDynamicMaterials>().unwrap_or_default();
            let known = |name: &String| own.0.iter().any(|(n, _)| n == name);
            let added: NamedMaterials = (materials.into_iter())
                .filter(|(name, _)| !known(name))
                .collect();
            entity.insert(GiDynamicMaterials([own.0, added].concat()));
        }
        summary
    });
    if let Err(error) = &result {
        let root = entity_label(entity.id(), entity.get::<Name>());
        error!("the bake of {root} failed: {error}");
    }
    entity.trigger(|entity| GiBakeFinished { entity, result });
}
