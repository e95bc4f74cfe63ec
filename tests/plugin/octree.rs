//! A bake by rule `fmm` with links on the same points, in the running plugin under a light that
//! moves: the octree solves while the plan says that it fits, the links do where a budget or the
//! device says that it does not, and the plan names the reason. Costs are given by the test, for no
//! test is decided by a clock.

use crate::support::app::{app, camera, picture, run, target};
use crate::support::scenes::{Room, cpu_indirect};
use crate::support::stage::{
    assert_alike, counters, indirect, light_source, settings, spawn_light_source, view,
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

/// The room, baked by rule `fmm` with links below the octree.
fn baked(order: u32) -> (Room, Arc<BakedScene>) {
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

struct Stand {
    app: App,
    root: Entity,
    light_source: Entity,
    image: Handle<Image>,
}

fn stand(room: &Room, bake: &Arc<BakedScene>) -> Stand {
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
    Stand {
        app,
        root,
        light_source,
        image,
    }
}

impl Stand {
    /// Moves the light, frame by frame, and leaves it at `TO`.
    fn walk(&mut self, frames: usize) {
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

    /// The last frame's plan, and how often what carries light from senders to receivers was
    /// dispatched in it.
    fn solved(&self) -> (String, u32) {
        let c = counters(&self.app);
        assert_eq!(c.solved.len(), 1, "the light moved: {}", c.plan);
        (c.plan.to_string(), c.dispatches_of(FrameStage::APPLY))
    }
}

#[test]
fn moving_light_uses_octree_if_it_fits_else_links() {
    let (room, bake) = baked(2);
    let tiers = bake.data().tiers();
    let links = bake.data().link_tiers();
    assert!(links >= 1 && tiers == links + 1);
    let mut stand = stand(&room, &bake);
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
    // For each reflection up and down all levels of the octree, and the positions; links take one
    // dispatch for each.
    let levels = bake.data().fmm.as_ref().expect("an octree").levels() as u32;
    let reflections = settings().sweeps + 1;
    let walked = reflections * (2 * levels + 1);

    // It fits: solved again in each frame in which the light moves, by the octree.
    stand.walk(4);
    let (plan, dispatched) = stand.solved();
    let reason = format!("with tier {tiers} of {tiers}, the octree: full quality is requested");
    assert!(plan.contains(&reason) && dispatched == walked, "{plan}");
    let found = picture(&mut stand.app, &stand.image);
    assert_alike("octree", &by_octree, &found);
    let own = found.nrmse(&by_octree);
    assert!(found.nrmse(&by_links) > 2.0 * own, "{own}");

    // It takes too long: the links on the same points, and the plan says what the octree would
    // take. A solve by all links takes 2 ms, by the octree ten times as long.
    let choices = TierCandidate::all_of(&bake, settings().sweeps);
    let work = choices[links as usize - 1].work;
    stand
        .app
        .insert_resource(SolveCostSource::Given(Arc::new(move |requested| {
            if requested > work {
                20.0
            } else {
                2.0 * requested as f32 / work as f32
            }
        })));
    let root = stand.root;
    let ask = |stand: &mut Stand, quality: GiQuality| {
        stand.app.world_mut().entity_mut(root).insert(quality);
    };
    ask(&mut stand, GiQuality::GpuBudget(Duration::from_millis(4)));
    stand.walk(20);
    let (plan, dispatched) = stand.solved();
    let reason = format!(
        "with tier {links} of {tiers}: 2.00 ms a solve, within 4 ms; tier {tiers}, the octree, would take"
    );
    assert!(
        plan.contains(&reason) && dispatched == reflections,
        "{plan}"
    );
    let found = picture(&mut stand.app, &stand.image);
    assert_alike("links below the octree", &by_links, &found);
    let own = found.nrmse(&by_links);
    assert!(found.nrmse(&by_octree) > 2.0 * own, "{own}");

    // With time enough the octree stays.
    ask(&mut stand, GiQuality::GpuBudget(Duration::from_millis(40)));
    stand.walk(20);
    let (plan, dispatched) = stand.solved();
    let reason = "the octree: 20.00 ms a solve, within 40 ms; there is no higher one";
    assert!(plan.contains(reason) && dispatched == walked, "{plan}");
}

#[test]
fn device_below_octree_limits_uses_links_with_reason() {
    // No workgroup holds the expansions of this order.
    let (room, bake) = baked(7);
    let links = bake.data().link_tiers();
    let mut stand = stand(&room, &bake);
    stand.walk(4);
    let (plan, dispatched) = stand.solved();
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
    assert_alike("no octree", &cpu, &picture(&mut stand.app, &stand.image));

    // A budget chooses among what runs: with 2 ms for all links, half of them below, and 3 ms to
    // spend, all links stay.
    let choices = TierCandidate::all_of(&bake, settings.sweeps);
    let work = choices[links as usize - 1].work;
    assert!(choices.len() as u32 == links + 1 && choices[links as usize].octree);
    let cost = move |requested: u64| 2.0 * requested as f32 / work as f32;
    (stand.app).insert_resource(SolveCostSource::Given(Arc::new(cost)));
    let root = stand.root;
    let ask = |stand: &mut Stand, ms: f32| {
        let budget = GiQuality::GpuBudget(Duration::from_secs_f32(1e-3 * ms));
        stand.app.world_mut().entity_mut(root).insert(budget);
        stand.walk(20);
        stand.solved().0
    };
    let plan = ask(&mut stand, 3.0);
    let reason = "2.00 ms a solve, within 3 ms; there is no higher one";
    assert!(plan.contains(reason), "{plan}");
    // And what is too much goes down one tier, not to the least.
    let below = 2.0 * choices[links as usize - 2].work as f32 / work as f32;
    // Where the tier below takes four fifths of the budget at most.
    let budget = 0.5 * (below / 0.8 + 2.0);
    assert!(below < 0.8 * budget && budget < 2.0, "{below}");
    let plan = ask(&mut stand, budget);
    assert!(
        links > 2 && plan.contains(&format!("with tier {} of {links}: ", links - 1)),
        "{plan}"
    );
}
