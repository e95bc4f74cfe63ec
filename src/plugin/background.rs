//! Work on a thread of its own, awaited from anywhere.
//!
//! Bevy's task pools have one thread each on small machines, and Bevy itself needs them all the
//! time: the `AsyncComputeTaskPool` compiles pipelines. A bake of seconds to minutes on it would
//! leave the window empty until the end.

use std::future::Future;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll, Waker};

/// Result of the thread.
enum State<T> {
    Running(Option<Waker>),
    Done(T),
    Taken,
}

/// The result of work on another thread: a future. Dropping it does not stop the work.
pub(crate) struct Background<T>(Arc<Mutex<State<T>>>);

impl<T: Send + 'static> Background<T> {
    /// Runs `work` on a new thread called `name`. If it panics, `panicked` gives the result, so
    /// that no caller waits forever.
    ///
    /// # Errors
    /// The error of the operating system if it creates no thread.
    pub fn spawn(
        name: &str,
        work: impl FnOnce() -> T + Send + 'static,
        panicked: impl FnOnce() -> T + Send + 'static,
    ) -> std::io::Result<Self> {
        let state = Arc::new(Mutex::new(State::Running(None)));
        let to = state.clone();
        std::thread::Builder::new()
            .name(name.into())
            .spawn(move || {
                let done = catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|_| panicked());
                let done = State::Done(done);
                let before = std::mem::replace(
                    &mut *to.lock().unwrap_or_else(PoisonError::into_inner),
                    done,
                );
                if let State::Running(Some(waker)) = before {
                    waker.wake();
                }
            })?;
        Ok(Self(state))
    }

    /// The result, once, as soon as it is there.
    pub fn take(&mut self) -> Option<T> {
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match std::mem::replace(&mut *state, State::Taken) {
            State::Done(value) => Some(value),
            before => {
                *state = before;
                None
            }
        }
    }
}

impl<T: Send + 'static> Future for Background<T> {
    type Output = T;

    fn poll(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<T> {
        // The waker is stored before the state is read, so a thread that ends in between wakes the
        // task.
        if let State::Running(waker) = &mut *self.0.lock().unwrap_or_else(PoisonError::into_inner) {
            *waker = Some(context.waker().clone());
        }
        self.take().map_or(Poll::Pending, Poll::Ready)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn background_result_arrives_once() {
        let (go, wait) = std::sync::mpsc::channel::<()>();
        let mut work =
            Background::spawn("test", move || wait.recv().map_or(0, |()| 7), || 8).unwrap();
        assert!(work.take().is_none(), "it waits");
        go.send(()).unwrap();
        assert_eq!(bevy::tasks::block_on(&mut work), 7);
        assert!(work.take().is_none(), "it was taken");
    }

    #[test]
    fn background_waiter_is_woken() {
        let nap = || std::thread::sleep(Duration::from_millis(20));
        let work = Background::spawn("test", nap, || ());
        bevy::tasks::block_on(work.unwrap());
    }

    #[test]
    fn background_panic_is_returned() {
        let work = Background::spawn("test", || panic!("expected by the test"), || 8);
        assert_eq!(bevy::tasks::block_on(work.unwrap()), 8);
    }
}
