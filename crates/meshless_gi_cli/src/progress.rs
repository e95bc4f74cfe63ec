//! Progress bars on standard error, shown if that is a terminal.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use meshless_gi::Progress;
use std::io::IsTerminal;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Resolution of a bar.
const STEPS: u64 = 1000;

fn bar() -> ProgressBar {
    // Indicatif hides the bar if standard error is not a terminal.
    let bar = ProgressBar::with_draw_target(Some(STEPS), ProgressDrawTarget::stderr());
    if let Ok(style) =
        ProgressStyle::with_template("{prefix}{msg:20} [{bar:40}] {percent:>3} % {elapsed}")
    {
        bar.set_style(style.progress_chars("=> "));
    }
    bar
}

/// Runs `work` and shows its progress as a bar.
pub fn watch<T: Send>(work: impl FnOnce(&Progress) -> T + Send) -> T {
    watch_steps(|progress, _| work(progress))
}

/// Runs `work` and shows the progress of each step as a bar. `work` names its current step through
/// its second argument.
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
        // Ends the bar's thread, also if `work` panics.
        struct End<'a>(&'a AtomicBool);
        impl Drop for End<'_> {
            fn drop(&mut self) {
                self.0.store(true, Ordering::Release);
            }
        }
        let _end = End(&done);
        work(&progress, &|step| bar.set_prefix(step))
    })
}

/// Line with a spinner that names the current step until it is dropped.
pub struct Step(ProgressBar);

impl Step {
    pub fn new(step: impl Into<String>) -> Self {
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr());
        if let Ok(style) = ProgressStyle::with_template("{spinner} {msg} {elapsed}") {
            bar.set_style(style);
        }
        bar.set_message(step.into());
        bar.enable_steady_tick(Duration::from_millis(100));
        Self(bar)
    }
}

impl Drop for Step {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}
