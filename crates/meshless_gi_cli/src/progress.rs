//! Work with a bar on standard error, where that is a terminal.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use meshless_gi::Progress;
use std::io::IsTerminal;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Parts of a bar.
const STEPS: u64 = 1000;

fn bar() -> ProgressBar {
    // Hidden where standard error is no terminal.
    let bar = ProgressBar::with_draw_target(Some(STEPS), ProgressDrawTarget::stderr());
    // The template is a constant, and valid.
    if let Ok(style) =
        ProgressStyle::with_template("{prefix}{msg:20} [{bar:40}] {percent:>3} % {elapsed}")
    {
        bar.set_style(style.progress_chars("=> "));
    }
    bar
}

/// Runs `work` while a bar follows its progress.
pub fn watch<T: Send>(work: impl FnOnce(&Progress) -> T + Send) -> T {
    watch_steps(|progress, _| work(progress))
}

/// Runs `work`, which says what it is doing, while a bar follows the progress of each step.
pub fn watch_steps<T: Send>(
    work: impl FnOnce(&Progress, &(dyn Fn(String) + Sync)) -> T + Send,
) -> T {
    let progress = Progress::default();
    if !std::io::stderr().is_terminal() {
        return work(&progress, &|_| ());
    }
    let bar = bar();
    let done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            while !done.load(Ordering::Acquire) {
                let (stage, share) = progress.get();
                bar.set_message(stage.name());
                bar.set_position((share * STEPS as f32) as u64);
                std::thread::park_timeout(Duration::from_millis(100));
            }
            bar.finish_and_clear();
        });
        // Ends the watching thread, however the work ends.
        struct End<'a>(&'a AtomicBool);
        impl Drop for End<'_> {
            fn drop(&mut self) {
                self.0.store(true, Ordering::Release);
            }
        }
        let _end = End(&done);
        work(&progress, &|what| bar.set_prefix(what))
    })
}

/// A line that says what is being done, until it is dropped.
pub struct Step(ProgressBar);

impl Step {
    pub fn new(what: impl Into<String>) -> Self {
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr());
        if let Ok(style) = ProgressStyle::with_template("{spinner} {msg} {elapsed}") {
            bar.set_style(style);
        }
        bar.set_message(what.into());
        bar.enable_steady_tick(Duration::from_millis(100));
        Self(bar)
    }
}

impl Drop for Step {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}
