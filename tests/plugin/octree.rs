//! Bake of method `fmm` with links on the same points, in the running plugin under a moving light.
//! The octree solves while it fits the budget and the device. Otherwise the links solve, and the
//! plan contains the reason. The test provides the costs, so that no test depends on a clock.

use crate::support::app::{app, camera, picture, run, target};
use crate::support::scenes::{Room, cpu_indirect};
use crate::support::stage::{
    assert_pictures_match, counters, indirect, light_source, settings, spawn_light_source, view,
};
use bevy::prelude::*;
use bevy_meshless_gi::internals::plan::{FrameStage, TierCandidate};
use bevy_meshless_gi::internals::plugin::SolveCostSource;
use bevy_meshless_gi::prelude::*;
use meshless_gi::{BakedScene, FmmRecipe, FrameSettings, Recipe, TransportMethod};
use std::sync::Arc;
use std::time::Duration;

const FROM: Vec3 = Vec3::new(-0.3, 1.5, 0.3);
const TO: Vec3 = Vec3::new(0.4, 1.4, 0.2);

/// Returns the room and its bake of method `fmm`, with links as the lower tiers.
fn bake_room(order: u32) -> (Room, Arc<BakedScene>) {
    let room = Room::cornell();
    let bake = room.bake_as(&Recipe {
        viewpoints: vec![[0.0, 1.0, 0.6]],
        coarse_radius: Some(0.6),
        levels: Some(3),
        sender_levels: Some(2),
        refinement_levels: Some(0),
        rays_per_point: Some(128),
        transport: TransportMethod::Fmm(FmmRecipe {
            order,
            fallback_links: true,
            ..FmmRecipe::default()
        }),
        ..Recipe::default()
    });
    (room, bake)
}

struct TestScene {
    app: App,
    root: Entity,
    light_source: Entity,
    image: Handle<Image>,
}

fn test_scene(room: &Room, bake: &Arc<BakedScene>) -> TestScene {
    let mut app = app();
    let asset = (app.world_mut().resource_mut::<Assets<GiBakedScene>>()).add(GiBakedScene {
        scene: bake.clone(),
    });
    let root = app
        .world_mut()
        .spawn((GiScene(asset), Transform::default()));
    let root = root.id();
    room.spawn(&mut app, root);
    let image = target(&mut app);
    app.world_mut().spawn((camera(&image, view()), indirect()));
    let light_source = spawn_light_source(&mut app, FROM);
    TestScene {
        app,
        root,
        light_source,
        image,
    }
}

impl TestScene {
    /// Moves the light in each of `frames` frames. The last position is `TO`.
    fn move_light(&mut self, frames: usize) {
        for k in 1..=frames {
            let position = FROM.lerp(TO, k as f32 / frames as f32);
            let world = self.app.world_mut();
            world
                .get_mut::<Transform>(self.light_source)
                .unwrap()
                .translation = position;
            run(&mut self.app, 1);
        }
    }

    /// Returns the last frame's plan and the number of its transport dispatches.
    fn solved(&self) -> (String, u32) {
        let c = counters(&self.app);
        assert_eq!(c.solved.len(), 1, "the light moved: {}", c.plan);
        (c.plan.to_string(), c.dispatches_of(FrameStage::APPLY))
    }
}

#[test]
fn moving_light_uses_octree_if_it_fits_else_links() {
    let (room, bake) = bake_room(2);
    let tiers = bake.data().tiers();
    let links = bake.data().link_tiers();
    assert!(links >= 1 && tiers == links + 1);
    let mut test_scene = test_scene(&room, &bake);
    let cpu = |tier| {
        let settings = FrameSettings { tier, ..settings() };
        let lights = [light_source(TO)];
        cpu_indirect(
            &room,
            &bake,
            Transform::IDENTITY,
            view(),
            &lights,
            &settings,
        )
    };
    let [by_octree, by_links] = [tiers, links].map(cpu);
    // Per bounce the octree takes two dispatches for each of its levels (up and down) and one for
    // the points. Links take one dispatch per bounce.
    let levels = bake.data().fmm.as_ref().expect("an octree").levels() as u32;
    let reflections = settings().sweeps + 1;
    let octree_dispatches = reflections * (2 * levels + 1);

    // The octree fits: it solves in each frame in which the light moves.
    test_scene.move_light(4);
    let (plan, dispatched) = test_scene.solved();
    let reason = format!("with tier {tiers} of {tiers}, the octree: full quality is requested");
    assert!(
        plan.contains(&reason) && dispatched == octree_dispatches,
        "{plan}"
    );
    let found = picture(&mut test_scene.app, &test_scene.image);
    assert_pictures_match("octree", &by_octree, &found);
    let own = found.nrmse(&by_octree);
    assert!(found.nrmse(&by_links) > 2.0 * own, "{own}");

    // The octree is too slow: the links on the same points solve, and the plan contains the
    // octree's cost. A solve takes 2 ms with all links and 20 ms with the octree.
    let choices = TierCandidate::all_of(&bake, settings().sweeps);
    let work = choices[links as usize - 1].work;
    test_scene
        .app
        .insert_resource(SolveCostSource::Given(Arc::new(move |requested| {
            if requested > work {
                20.0
            } else {
                2.0 * requested as f32 / work as f32
            }
        })));
    let root = test_scene.root;
    let request_quality = |test_scene: &mut TestScene, quality: GiQuality| {
        test_scene.app.world_mut().entity_mut(root).insert(quality);
    };
    request_quality(
        &mut test_scene,
        GiQuality::GpuBudget(Duration::from_millis(4)),
    );
    test_scene.move_light(20);
    let (plan, dispatched) = test_scene.solved();
    let reason = format!(
        "with tier {links} of {tiers}: 2.00 ms a solve, within 4 ms; tier {tiers}, the octree, would take"
    );
    assert!(
        plan.contains(&reason) && dispatched == reflections,
        "{plan}"
    );
    let found = picture(&mut test_scene.app, &test_scene.image);
    assert_pictures_match("links below the octree", &by_links, &found);
    let own = found.nrmse(&by_links);
    assert!(found.nrmse(&by_octree) > 2.0 * own, "{own}");

    // With a sufficient budget the octree is used.
    request_quality(
        &mut test_scene,
        GiQuality::GpuBudget(Duration::from_millis(40)),
    );
    test_scene.move_light(20);
    let (plan, dispatched) = test_scene.solved();
    let reason = "the octree: 20.00 ms a solve, within 40 ms; there is no higher one";
    assert!(
        plan.contains(reason) && dispatched == octree_dispatches,
        "{plan}"
    );
}

#[test]
fn device_below_octree_limits_uses_links_with_reason() {
    // Expansions of this order do not fit into a workgroup.
    let (room, bake) = bake_room(7);
    let links = bake.data().link_tiers();
    let mut test_scene = test_scene(&room, &bake);
    test_scene.move_light(4);
    let (plan, dispatched) = test_scene.solved();
    assert_eq!(dispatched, settings().sweeps + 1, "{plan}");
    let reason = format!("with tier {links} of {links}: full quality is requested");
    assert!(plan.contains(&reason), "{plan}");
    let reason = "with its links: the octree's order is 7, the kernels take 6";
    assert!(plan.contains(reason), "{plan}");
    let settings = FrameSettings {
        tier: links,
        ..settings()
    };
    let lights = [light_source(TO)];
    let cpu = cpu_indirect(
        &room,
        &bake,
        Transform::IDENTITY,
        view(),
        &lights,
        &settings,
    );
    assert_pictures_match(
        "no octree",
        &cpu,
        &picture(&mut test_scene.app, &test_scene.image),
    );

    // A budget selects among the available tiers. The cost is 2 ms for all links and proportional
    // to the number of links. A budget of 3 ms selects all links.
    let choices = TierCandidate::all_of(&bake, settings.sweeps);
    let work = choices[links as usize - 1].work;
    assert!(choices.len() as u32 == links + 1 && choices[links as usize].octree);
    let cost = move |requested: u64| 2.0 * requested as f32 / work as f32;
    (test_scene.app).insert_resource(SolveCostSource::Given(Arc::new(cost)));
    let root = test_scene.root;
    let request_quality = |test_scene: &mut TestScene, ms: f32| {
        let budget = GiQuality::GpuBudget(Duration::from_secs_f32(1e-3 * ms));
        test_scene.app.world_mut().entity_mut(root).insert(budget);
        test_scene.move_light(20);
        test_scene.solved().0
    };
    let plan = request_quality(&mut test_scene, 3.0);
    let reason = "2.00 ms a solve, within 3 ms; there is no higher one";
    assert!(plan.contains(reason), "{plan}");
    // A slightly smaller budget selects the next lower tier, not the lowest one.
    let below = 2.0 * choices[links as usize - 2].work as f32 / work as f32;
    // The lower tier takes at most 4/5 of the budget.
    let budget = 0.5 * (below / 0.8 + 2.0);
    assert!(below < 0.8 * budget && budget < 2.0, "{below}");
    let plan = request_quality(&mut test_scene, budget);
    assert!(
        links > 2 && plan.contains(&format!("with tier {} of {links}: ", links - 1)),
        "{plan}"
    );
}
