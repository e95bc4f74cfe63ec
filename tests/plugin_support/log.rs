//! What the tests read of logs, and how they wait.

use bevy::app::App;
use bevy::log::Level;
use bevy::log::tracing::field::{Field, Visit};
use bevy::log::tracing::span::{Attributes, Id, Record};
use bevy::log::tracing::{Event, Metadata, Subscriber, subscriber};
use std::fmt::Debug;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Updates until `done` gives something.
#[track_caller]
pub fn until<T>(app: &mut App, what: &str, mut done: impl FnMut(&mut App) -> Option<T>) -> T {
    let end = Instant::now() + Duration::from_secs(120);
    loop {
        app.update();
        if let Some(value) = done(app) {
            return value;
        }
        assert!(Instant::now() < end, "{what} takes too long");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// What the plugin warns of while `work` runs on this thread.
pub fn warnings<T>(work: impl FnOnce() -> T) -> (T, Vec<String>) {
    let told = Arc::new(Mutex::new(Vec::new()));
    let value = subscriber::with_default(Warnings(told.clone()), work);
    let told = told.lock().unwrap().clone();
    (value, told)
}

/// Keeps the plugin's warnings and errors.
struct Warnings(Arc<Mutex<Vec<String>>>);

impl Subscriber for Warnings {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        metadata.target().starts_with("bevy_meshless_gi") && *metadata.level() <= Level::WARN
    }
    fn new_span(&self, _: &Attributes<'_>) -> Id {
        Id::from_u64(1)
    }
    fn record(&self, _: &Id, _: &Record<'_>) {}
    fn record_follows_from(&self, _: &Id, _: &Id) {}
    fn event(&self, event: &Event<'_>) {
        struct Message<'a>(&'a mut Vec<String>);
        impl Visit for Message<'_> {
            fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
                if field.name() == "message" {
                    self.0.push(format!("{value:?}"));
                }
            }
        }
        event.record(&mut Message(&mut self.0.lock().unwrap()));
    }
    fn enter(&self, _: &Id) {}
    fn exit(&self, _: &Id) {}
}
