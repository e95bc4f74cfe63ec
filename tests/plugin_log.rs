//! Log lines of the plugin over a run. The file has only one test: systems log from many threads,
//! so the subscriber is global to the process.

mod support;

use bevy::log::tracing::field::{Field, Visit};
use bevy::log::tracing::span::{Attributes, Id, Record};
use bevy::log::tracing::subscriber::set_global_default;
use bevy::log::tracing::{Event, Metadata, Subscriber};
use bevy::log::{Level, LogPlugin};
use bevy::prelude::*;
use bevy_meshless_gi::prelude::*;
use meshless_gi::BakedScene;
use std::collections::BTreeSet;
use std::sync::{Arc, Mutex};
use support::app::{camera, finish_plugins, headless_plugins, run, target};
use support::scenes::cornell;
use support::stage::{indirect, spawn_baked, spawn_light_source, view};

/// Log lines of the crate at all levels.
#[derive(Clone, Default)]
struct Lines(Arc<Mutex<Vec<(Level, String)>>>);

impl Lines {
    fn at(&self, level: Level) -> Vec<String> {
        let lines = self.0.lock().unwrap();
        let found = lines.iter().filter(|(l, _)| *l == level);
        found.map(|(_, line)| line.clone()).collect()
    }
}

impl Subscriber for Lines {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        metadata.target().starts_with("bevy_meshless_gi")
    }
    fn new_span(&self, _: &Attributes<'_>) -> Id {
        Id::from_u64(1)
    }
    fn record(&self, _: &Id, _: &Record<'_>) {}
    fn record_follows_from(&self, _: &Id, _: &Id) {}
    fn event(&self, event: &Event<'_>) {
        struct Message(String);
        impl Visit for Message {
            fn record_debug(&mut self, field: &Field, value: &dyn std::fmt::Debug) {
                if field.name() == "message" {
                    self.0 = format!("{value:?}");
                }
            }
        }
        let mut message = Message(String::new());
        event.record(&mut message);
        let mut lines = self.0.lock().unwrap();
        lines.push((*event.metadata().level(), message.0));
    }
    fn enter(&self, _: &Id) {}
    fn exit(&self, _: &Id) {}
}

fn set_bake(app: &mut App, root: Entity, scene: Arc<BakedScene>) {
    let mut assets = app.world_mut().resource_mut::<Assets<GiBakedScene>>();
    let asset = assets.add(GiBakedScene { scene });
    app.world_mut().entity_mut(root).insert(GiScene(asset));
}

/// Moves both lights in two of three frames, and changes the color of one in every frame.
fn move_lights(app: &mut App, lights: [Entity; 2], frames: usize) {
    for k in 0..frames {
        for light in lights.iter().filter(|_| k % 3 != 0) {
            let mut transform = app.world_mut().get_mut::<Transform>(*light).unwrap();
            transform.translation.x += 0.002;
        }
        let mut light = app.world_mut().get_mut::<PointLight>(lights[0]).unwrap();
        light.color = Color::linear_rgb(1.0, 1.0 - 0.01 * (k % 2) as f32, 1.0);
        run(app, 1);
    }
}

#[test]
fn log_of_two_scenes_has_two_info_lines_and_the_plan_at_debug() {
    let lines = Lines::default();
    set_global_default(lines.clone()).unwrap();
    let mut app = App::new();
    app.add_plugins((
        headless_plugins().disable::<LogPlugin>(),
        MeshlessGiPlugin::default(),
    ))
    .insert_resource(GlobalAmbientLight::NONE);
    finish_plugins(&mut app);
    let (room, bake) = cornell();
    let named = spawn_baked(&mut app, &room, &bake, Transform::IDENTITY);
    app.world_mut().entity_mut(named).insert(Name::new("Room"));
    let behind = Transform::from_xyz(0.0, 0.0, -6.0);
    let other = spawn_baked(&mut app, &room, &bake, behind);
    let image = target(&mut app);
    let eye = (camera(&image, view()), indirect(), Name::new("Eye"));
    let eye = app.world_mut().spawn(eye).id();
    let position = Vec3::new(-0.3, 1.5, 0.3);
    let first = spawn_light_source(&mut app, position);
    let second = spawn_light_source(&mut app, position - 6.0 * Vec3::Z);
    move_lights(&mut app, [first, second], 40);

    let info = lines.at(Level::INFO);
    println!("{}", info.join("\n"));
    assert_eq!(info.len(), 2, "{info:?}");
    for label in [format!("\"Room\" ({named})"), other.to_string()] {
        let start = format!("indirect light on {label}: ");
        let line = info.iter().find(|line| line.starts_with(&start));
        let line = line.unwrap_or_else(|| panic!("no line of {label}: {info:?}"));
        let points = format!(": {} points, ", bake.data().points.len());
        assert!(
            line.replace(',', "").contains(&points.replace(',', "")),
            "{line}"
        );
        assert!(line.contains(" links, ") && line.contains(" MB"), "{line}");
        assert!(line.len() <= 120, "{line}");
    }

    // The plan lists every decision once, with names.
    let debug = lines.at(Level::DEBUG);
    println!("{}", debug.join("\n"));
    let label = format!("\"Room\" ({named})");
    for start in [
        format!("tier of {label}: "),
        format!("reflections of {label}: "),
        format!("effect lights of {label}: runs"),
        format!("effect display of {label} in \"Eye\" ({eye}): runs"),
        format!("tier of {other}: "),
    ] {
        let found = debug.iter().filter(|l| l.starts_with(&start)).count();
        assert_eq!(found, 1, "{start}: {debug:#?}");
    }

    // Another bake of one scene adds one line. The same bake in another asset adds none.
    let again = room.bake(3);
    assert_ne!(again.data().points.len(), bake.data().points.len());
    set_bake(&mut app, named, again.clone());
    move_lights(&mut app, [first, second], 5);
    set_bake(&mut app, named, Arc::new((*again).clone()));
    move_lights(&mut app, [first, second], 5);
    let info = lines.at(Level::INFO);
    assert_eq!(info.len(), 3, "{info:?}");
    assert!(info[2].contains("\"Room\""), "{info:?}");

    // No repeated line, no unknown costs, no entity bits instead of names, no warning.
    let all = lines.0.lock().unwrap().clone();
    let different: BTreeSet<&String> = all.iter().map(|(_, line)| line).collect();
    assert_eq!(different.len(), all.len(), "{all:#?}");
    let bits = [named, other, eye].map(|entity| format!(" {:x}", entity.to_bits()));
    for (level, line) in &all {
        assert!(*level > Level::WARN, "{line}");
        let unknown = ["unknown", "not measured"].iter();
        assert!(!unknown.clone().any(|odd| line.contains(odd)), "{line}");
        assert!(!bits.iter().any(|bits| line.contains(bits)), "{line}");
    }
}
