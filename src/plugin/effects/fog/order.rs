//! Order of the pass that adds light in fog to a picture. It runs after Bevy's volumetric fog,
//! which is private and runs before all of `EarlyPostProcess`. It runs before all other systems in
//! that set, such as temporal anti-aliasing. This crate cannot name that system, because an app may
//! lack that part of Bevy.

use crate::plugin::sets::GiRenderSystems;
use bevy::core_pipeline::schedule::Core3dSystems;
use bevy::ecs::schedule::graph::{DiGraph, Direction};
use bevy::ecs::schedule::{
    FlattenedDependencies, InternedSystemSet, NodeId, ScheduleBuildError, ScheduleBuildPass,
    ScheduleGraph, SystemKey, SystemSet, SystemSetKey,
};
use bevy::ecs::world::World;
use bevy::platform::collections::{HashMap, HashSet};

/// Puts [`GiRenderSystems::CompositeFog`] before the other systems of `EarlyPostProcess`, except
/// for those that are ordered before it.
#[derive(Debug, Default)]
pub(crate) struct FogFirst {
    members: HashMap<SystemSetKey, Vec<SystemKey>>,
}

/// No edge has any.
#[derive(Debug)]
pub(crate) struct NoOptions;

impl ScheduleBuildPass for FogFirst {
    type EdgeOptions = NoOptions;

    fn add_dependency(&mut self, _: NodeId, _: NodeId, _: Option<&NoOptions>) {}

    fn collapse_set(
        &mut self,
        set: SystemSetKey,
        systems: &indexmap::IndexSet<SystemKey, bevy::platform::hash::FixedHasher>,
        _: &DiGraph<NodeId>,
    ) -> impl Iterator<Item = (NodeId, NodeId)> {
        self.members.insert(set, systems.iter().copied().collect());
        std::iter::empty()
    }

    fn build(
        &mut self,
        _: &mut World,
        graph: &mut ScheduleGraph,
        mut dependencies: FlattenedDependencies<'_>,
    ) -> Result<(), ScheduleBuildError> {
        let members = std::mem::take(&mut self.members);
        let of = |set: InternedSystemSet| {
            let key = graph.system_sets.get_key(set);
            key.and_then(|key| members.get(&key).cloned())
                .unwrap_or_default()
        };
        let ours = of(GiRenderSystems::CompositeFog.intern());
        let all = of(Core3dSystems::EarlyPostProcess.intern());
        for &fog in &ours {
            let before = predecessors(&dependencies, fog);
            for &other in all.iter().filter(|s| !ours.contains(s)) {
                if !before.contains(&other) {
                    dependencies.add_edge(fog, other);
                }
            }
        }
        Ok(())
    }
}

/// Returns the systems that run before a system.
fn predecessors(graph: &DiGraph<SystemKey>, system: SystemKey) -> HashSet<SystemKey> {
    let (mut found, mut next) = (HashSet::default(), vec![system]);
    while let Some(system) = next.pop() {
        for before in graph.neighbors_directed(system, Direction::Incoming) {
            if found.insert(before) {
                next.push(before);
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::core_pipeline::schedule::Core3d;
    use bevy::ecs::prelude::*;

    #[derive(Resource, Default)]
    struct RunOrder(Vec<&'static str>);

    fn record_run(name: &'static str) -> impl Fn(ResMut<RunOrder>) {
        move |mut ran| ran.0.push(name)
    }

    #[test]
    fn fog_pass_runs_between_early_and_late_post_processing() {
        let early = Core3dSystems::EarlyPostProcess;
        let mut schedule = Core3d::base_schedule();
        schedule.add_build_pass(FogFirst::default());
        let anti_alias = record_run("anti_alias").in_set(early.clone());
        schedule.add_systems((anti_alias, record_run("upscale").in_set(early.clone())));
        schedule.add_systems(record_run("tonemap").in_set(Core3dSystems::PostProcess));
        let fog = record_run("fog").in_set(GiRenderSystems::CompositeFog);
        schedule.add_systems(fog.in_set(early.clone()));
        let requested = record_run("requested").before(GiRenderSystems::CompositeFog);
        schedule.add_systems(requested.in_set(early.clone()));
        let bevys = record_run("bevys_fog").after(Core3dSystems::MainPass);
        schedule.add_systems(bevys.before(early));
        schedule.add_systems(record_run("opaque").in_set(Core3dSystems::MainPass));
        let mut world = World::new();
        world.init_resource::<RunOrder>();
        schedule.run(&mut world);
        let ran = &world.resource::<RunOrder>().0;
        assert_eq!(ran[..4], ["opaque", "bevys_fog", "requested", "fog"]);
        assert_eq!(ran.len(), 7);
        assert_eq!(ran[6], "tonemap");
    }
}
