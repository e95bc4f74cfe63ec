//! Progress of recipes that are baked: in the log, and as messages of the main world.

use super::asset::GiBakedScene;
use bevy::asset::{AssetId, AssetPath, AssetServer};
use bevy::ecs::prelude::*;
use bevy::ecs::reflect::ReflectMessage;
use bevy::log::info;
use bevy::reflect::prelude::*;
use meshless_gi::{BakeStage, Progress};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Share of a stage that the log reports at a time.
const LOGGED_SHARE: f32 = 0.1;
/// Minimum time between two progress lines of a bake.
const LOG_INTERVAL: Duration = Duration::from_secs(1);

/// Progress message of a recipe, sent by its loader or by the app's asset processor. It is sent
/// when the stage or its fraction has changed, at most once per frame for each recipe. The end of
/// the bake is an [`AssetEvent`](bevy::asset::AssetEvent) of the asset.
#[derive(Message, Reflect, Clone, Debug, PartialEq)]
#[reflect(Message, Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct GiRecipeProgress {
    /// Path of the recipe.
    pub path: AssetPath<'static>,
    /// Asset of the recipe. `None` if the app has not loaded it yet, as for recipes that the asset
    /// processor bakes in advance.
    pub id: Option<AssetId<GiBakedScene>>,
    /// Stage of the bake.
    pub stage: BakeStage,
    /// Fraction of the stage that is done, 0 to 1.
    pub fraction: f32,
}

/// Recipes that are being baked, shared by the loaders, the processor and the main world.
#[derive(Resource, Clone, Debug, Default)]
pub(crate) struct RecipeBakes(Arc<Mutex<Vec<RunningBake>>>);

#[derive(Debug)]
struct RunningBake {
    path: AssetPath<'static>,
    progress: Arc<Progress>,
    sent: Option<(BakeStage, f32)>,
}

impl RecipeBakes {
    /// Lists a bake, and logs its progress, until the guard is dropped.
    pub fn start(&self, path: AssetPath<'static>) -> RecipeBake {
        self.start_with(path, |line| info!("{line}"))
    }

    /// Like [`Self::start`], with lines that go to `write` and not to the log.
    pub fn start_with(&self, path: AssetPath<'static>, write: fn(&str)) -> RecipeBake {
        let progress = Arc::new(Progress::default());
        self.change(|list| {
            list.push(RunningBake {
                path: path.clone(),
                progress: progress.clone(),
                sent: None,
            });
        });
        RecipeBake {
            _log: write_progress(format!("`{path}`"), progress.clone(), write),
            progress,
            list: self.clone(),
        }
    }

    fn change<T>(&self, change: impl FnOnce(&mut Vec<RunningBake>) -> T) -> T {
        change(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// Guard of a bake. Dropping it cancels the bake.
pub(crate) struct RecipeBake {
    pub progress: Arc<Progress>,
    list: RecipeBakes,
    /// Ends the thread of the log when it is dropped.
    _log: Sender<()>,
}

impl Drop for RecipeBake {
    fn drop(&mut self) {
        self.progress.cancel();
        self.list
            .change(|list| list.retain(|bake| !Arc::ptr_eq(&bake.progress, &self.progress)));
    }
}

/// Logs each stage, and each tenth of it, until the sender is dropped.
pub(crate) fn log_progress(name: String, progress: Arc<Progress>) -> Sender<()> {
    write_progress(name, progress, |line| info!("{line}"))
}

/// Writes each stage, and each tenth of it, until the sender is dropped. Without a thread for it
/// nothing is written.
fn write_progress(name: String, progress: Arc<Progress>, write: fn(&str)) -> Sender<()> {
    let (running, ended) = channel();
    let work = move || {
        let mut logged = None;
        while ended.recv_timeout(LOG_INTERVAL) == Err(RecvTimeoutError::Timeout) {
            let now = progress.get();
            if is_news(logged, now) {
                logged = Some(now);
                let (stage, fraction) = now;
                let percent = 100.0 * fraction;
                write(&format!("baking {name}: {}, {percent:.0} %", stage.name()));
            }
        }
    };
    let _ = std::thread::Builder::new()
        .name("meshless gi progress".into())
        .spawn(work);
    running
}

/// Returns true if the log reports `now` after `logged`.
fn is_news(logged: Option<(BakeStage, f32)>, now: (BakeStage, f32)) -> bool {
    logged.is_none_or(|(stage, fraction)| stage != now.0 || now.1 >= fraction + LOGGED_SHARE)
}

/// Runs in [`GiSystems::CollectBakes`](super::GiSystems::CollectBakes).
pub(crate) fn send_progress(
    bakes: Res<RecipeBakes>,
    server: Res<AssetServer>,
    mut messages: MessageWriter<GiRecipeProgress>,
) {
    let news: Vec<_> = bakes.change(|list| {
        let changed = list.iter_mut().filter_map(|bake| {
            let now = bake.progress.get();
            (bake.sent.replace(now) != Some(now)).then(|| (bake.path.clone(), now))
        });
        changed.collect()
    });
    for (path, (stage, fraction)) in news {
        messages.write(GiRecipeProgress {
            id: server.get_handle(&path).map(|handle| handle.id()),
            path,
            stage,
            fraction,
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn is_news_for_each_stage_and_each_tenth_of_it() {
        let mut logged = None;
        let mut lines = 0;
        for stage in [BakeStage::Points, BakeStage::Transport] {
            for permille in 0..1000 {
                let now = (stage, permille as f32 / 1000.0);
                if is_news(logged, now) {
                    logged = Some(now);
                    lines += 1;
                }
            }
        }
        assert!((18..=20).contains(&lines), "{lines}");
    }

    #[test]
    fn start_lists_a_bake_until_its_guard_is_dropped() {
        let bakes = RecipeBakes::default();
        let first = bakes.start("a.gi.ron".into());
        let second = bakes.start("a.gi.ron".into());
        assert_eq!(bakes.change(|list| list.len()), 2);
        let progress = first.progress.clone();
        drop(first);
        assert!(progress.is_canceled() && !second.progress.is_canceled());
        assert_eq!(bakes.change(|list| list.len()), 1);
    }
}
