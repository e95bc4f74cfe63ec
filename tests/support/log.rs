//! Subscribers for tests that read the plugin's log.

use std::sync::{Arc, Mutex};

/// Runs `work` and returns its result with the plugin's warnings on this thread.
pub fn warnings<T>(work: impl FnOnce() -> T) -> (T, Vec<String>) {
    let lines = Arc::new(Mutex::new(Vec::new()));
    let subscriber = Warnings(lines.clone());
    let value = bevy::log::tracing::subscriber::with_default(subscriber, work);
    let lines = lines.lock().unwrap().clone();
    (value, lines)
}

/// Subscriber that stores the plugin's warnings and errors.
struct Warnings(Arc<Mutex<Vec<String>>>);

impl bevy::log::tracing::Subscriber for Warnings {
    fn enabled(&self, metadata: &bevy::log::tracing::Metadata<'_>) -> bool {
        metadata.target().starts_with("bevy_meshless_gi")
            && *metadata.level() <= bevy::log::Level::WARN
    }
    fn new_span(
        &self,
        _: &bevy::log::tracing::span::Attributes<'_>,
    ) -> bevy::log::tracing::span::Id {
        bevy::log::tracing::span::Id::from_u64(1)
    }
    fn record(&self, _: &bevy::log::tracing::span::Id, _: &bevy::log::tracing::span::Record<'_>) {}
    fn record_follows_from(
        &self,
        _: &bevy::log::tracing::span::Id,
        _: &bevy::log::tracing::span::Id,
    ) {
    }
    fn event(&self, event: &bevy::log::tracing::Event<'_>) {
        struct Message<'a>(&'a mut Vec<String>);
        impl bevy::log::tracing::field::Visit for Message<'_> {
            fn record_debug(
                &mut self,
                field: &bevy::log::tracing::field::Field,
                value: &dyn std::fmt::Debug,
            ) {
                if field.name() == "message" {
                    self.0.push(format!("{value:?}"));
                }
            }
        }
        event.record(&mut Message(&mut self.0.lock().unwrap()));
    }
    fn enter(&self, _: &bevy::log::tracing::span::Id) {}
    fn exit(&self, _: &bevy::log::tracing::span::Id) {}
}

/// Subscriber that prints all errors and the plugin's log at `INFO` and above.
pub struct Log;

impl bevy::log::tracing::Subscriber for Log {
    fn enabled(&self, metadata: &bevy::log::tracing::Metadata<'_>) -> bool {
        let ours = metadata.target().starts_with("bevy_meshless_gi");
        *metadata.level() == bevy::log::Level::ERROR
            || (ours && *metadata.level() <= bevy::log::Level::INFO)
    }
    fn new_span(
        &self,
        _: &bevy::log::tracing::span::Attributes<'_>,
    ) -> bevy::log::tracing::span::Id {
        bevy::log::tracing::span::Id::from_u64(1)
    }
    fn record(&self, _: &bevy::log::tracing::span::Id, _: &bevy::log::tracing::span::Record<'_>) {}
    fn record_follows_from(
        &self,
        _: &bevy::log::tracing::span::Id,
        _: &bevy::log::tracing::span::Id,
    ) {
    }
    fn event(&self, event: &bevy::log::tracing::Event<'_>) {
        struct Message;
        impl bevy::log::tracing::field::Visit for Message {
            fn record_debug(
                &mut self,
                field: &bevy::log::tracing::field::Field,
                value: &dyn std::fmt::Debug,
            ) {
                if field.name() == "message" {
                    println!("LOG {value:?}");
                }
            }
        }
        event.record(&mut Message);
    }
    fn enter(&self, _: &bevy::log::tracing::span::Id) {}
    fn exit(&self, _: &bevy::log::tracing::span::Id) {}
}
