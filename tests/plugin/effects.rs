//! Scenes use only required resources: runs the thirteen scenes of the example `pass_costs` in the
//! plugin. Each scene runs exactly its listed stages, with no pipeline or buffer of other stages.

#[path = "../../examples/reports/pass_costs/scenes.rs"]
mod scenes;

use crate::support::app::{app, run};
use crate::support::stage::counters;
use bevy::prelude::*;
use bevy_meshless_gi::internals::plan::{ColorModeSelection, FrameStage};
use bevy_meshless_gi::internals::plugin::FrameRecord;
use meshless_gi::{Channels, ProbeSettings, Recipe, VisibilityRecipe};
use scenes::{SCENES, bakes, spawn, step};

const SIZE: UVec2 = UVec2::new(128, 96);

#[test]
fn scene_runs_only_required_effects() {
    let recipe = Recipe {
        coarse_radius: Some(0.6),
        levels: Some(3),
        sender_levels: Some(2),
        rays_per_point: Some(64),
        probes: Some(ProbeSettings {
            spacing: Some(0.4),
            rays_per_probe: None,
        }),
        soft_shadows: Some(VisibilityRecipe {
            directions: 252,
            coefficients: 20,
            cluster_size: 100,
            ..VisibilityRecipe::default()
        }),
        ..Recipe::default()
    };
    let bakes = bakes(&recipe).expect("bakes");
    let mut records: Vec<FrameRecord> = Vec::new();
    for scene in &SCENES {
        let mut app = app();
        spawn(&mut app, scene, &bakes, SIZE);
        for k in 0..6 {
            step(&mut app, scene, k);
            run(&mut app, 1);
        }
        let found = counters(&app);
        let mut expected = scene.runs.to_vec();
        expected.sort_unstable();
        let ran: Vec<FrameStage> = found.dispatches.keys().copied().collect();
        println!(
            "{}: {ran:?}, {} buffers, {} bytes",
            scene.name, found.buffers, found.bytes
        );
        assert_eq!(ran, expected, "{}:\n{}", scene.name, found.plan);
        // Only gray scenes use one channel.
        let one = |c: &ColorModeSelection| matches!(c.channels, Channels::One(_));
        let channels = &found.plan.channels;
        assert_eq!(channels.len(), 1);
        assert_eq!(one(&channels[0].1), scene.gray, "{}", found.plan);
        records.push(found);
    }
    // Changes of the light add no pipeline, buffer or byte to a scene with one light.
    let of = |k: usize| (records[k].pipelines, records[k].buffers, records[k].bytes);
    assert_eq!(of(0), of(2));
    assert_eq!(of(0), of(3));
    // A gray scene has as many pipelines and buffers as a colored scene.
    assert_eq!((of(4).0, of(4).1), (of(3).0, of(3).1));
    let everything = records.len() - 1;
    for k in 0..everything {
        assert!(
            of(k).0 < of(everything).0 && of(k).1 < of(everything).1 && of(k).2 < of(everything).2
        );
    }
}
