//! Background tasks: a named thread with shared state, progress, cancellation and a panic trap.

use super::progress::Progress;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::ops::Deref;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// Handle of a running background task. Dropping it cancels the task and does not wait for its
/// thread.
#[derive(Debug)]
pub struct Task<S>(Arc<Shared<S>>);

/// State, progress and outcome of a task, shared by its thread and its owner.
///
/// As [`Progress`] it counts the steps of the current stage, and is cancelled once the task's
/// handle is dropped.
#[derive(Debug, Default)]
pub struct Shared<S> {
    state: Mutex<TaskState<S>>,
    changed: Condvar,
    cancelled: AtomicBool,
    steps_done: AtomicU64,
    steps: AtomicU64,
}

/// State of a task.
#[derive(Debug, Default)]
pub struct TaskState<S> {
    /// The task's own state.
    pub data: S,
    /// Names of the stages begun in the current round of the work, oldest first.
    pub stages: Vec<String>,
    /// True once the work has returned or panicked.
    pub ended: bool,
    /// Error of the work, one sentence; `None` after a cancelled task.
    pub error: Option<String>,
}

impl<S: Send + 'static> Task<S> {
    /// Runs `work` on a new thread, its parallel parts in `pool`.
    ///
    /// # Errors
    /// One sentence, if the thread cannot be started.
    pub fn start(
        name: &'static str,
        pool: ThreadPool,
        data: S,
        work: impl FnOnce(&Shared<S>) -> Result<(), String> + Send + 'static,
    ) -> Result<Self, String> {
        let shared = Arc::new(Shared {
            state: Mutex::new(TaskState {
                data,
                stages: Vec::new(),
                ended: false,
                error: None,
            }),
            changed: Condvar::new(),
            cancelled: AtomicBool::new(false),
            steps_done: AtomicU64::new(0),
            steps: AtomicU64::new(0),
        });
        let thread_shared = Arc::clone(&shared);
        let run = move || {
            let run_in_pool = || pool.install(|| work(&thread_shared));
            let result = catch_unwind(AssertUnwindSafe(run_in_pool));
            let result = result.unwrap_or_else(|_| {
                Err(format!(
                    "The {name} stopped because of an error in the program."
                ))
            });
            thread_shared.end(result);
        };
        let spawned = std::thread::Builder::new().name(name.into()).spawn(run);
        spawned.map_err(|error| format!("Cannot start a thread for the {name}: {error}."))?;
        Ok(Self(shared))
    }

    /// Access to the task that does not keep it alive.
    pub fn share(&self) -> Arc<Shared<S>> {
        Arc::clone(&self.0)
    }
}

impl<S> Deref for Task<S> {
    type Target = Shared<S>;

    fn deref(&self) -> &Shared<S> {
        &self.0
    }
}

impl<S> Drop for Task<S> {
    fn drop(&mut self) {
        // Under the lock, so that a thread that is about to wait sees it.
        self.0
            .update(|_| self.0.cancelled.store(true, Ordering::Relaxed));
    }
}

impl<S> Shared<S> {
    /// Locks the state. Every change leaves it consistent, so it is also used after a panic.
    pub fn lock(&self) -> MutexGuard<'_, TaskState<S>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes the state and wakes those who wait for it.
    pub fn update<T>(&self, change: impl FnOnce(&mut TaskState<S>) -> T) -> T {
        let result = change(&mut self.lock());
        self.changed.notify_all();
        result
    }

    /// Changes the task's own state at the end of a round, whose stages are forgotten.
    pub fn complete_round(&self, change: impl FnOnce(&mut S)) {
        self.update(|state| {
            change(&mut state.data);
            state.stages.clear();
            self.steps_done.store(0, Ordering::Relaxed);
        });
    }

    /// Waits while `condition` holds.
    pub fn wait_while(
        &self,
        condition: impl Fn(&TaskState<S>) -> bool,
    ) -> MutexGuard<'_, TaskState<S>> {
        self.changed
            .wait_while(self.lock(), |state| condition(state))
            .unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until `take` returns a request; `None` once the task is cancelled.
    pub fn next_request<R>(&self, mut take: impl FnMut(&mut S) -> Option<R>) -> Option<R> {
        let mut request = None;
        let waited = self.changed.wait_while(self.lock(), |state| {
            request = take(&mut state.data);
            request.is_none() && !self.cancelled()
        });
        drop(waited.unwrap_or_else(PoisonError::into_inner));
        request.filter(|_| !self.cancelled())
    }

    /// Completed share of the current stage, 0 to 1.
    pub fn stage_share(&self) -> f64 {
        let done = self.steps_done.load(Ordering::Relaxed);
        let all = self.steps.load(Ordering::Relaxed);
        (done as f64 / all.max(1) as f64).min(1.0)
    }

    fn cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }

    fn end(&self, result: Result<(), String>) {
        self.update(|state| {
            state.ended = true;
            state.error = result.err().filter(|_| !self.cancelled());
        });
    }
}

impl<S: Send> Progress for Shared<S> {
    fn begin(&self, stage: &str, _: &str, total: u64) {
        self.update(|state| {
            self.steps_done.store(0, Ordering::Relaxed);
            self.steps.store(total, Ordering::Relaxed);
            state.stages.push(stage.into());
        });
    }

    fn advance(&self, steps: u64) {
        self.steps_done.fetch_add(steps, Ordering::Relaxed);
    }

    fn is_cancelled(&self) -> bool {
        self.cancelled()
    }
}

/// Creates a pool with as many threads as the program uses elsewhere, at the lowest priority where
/// the system supports that.
///
/// # Errors
/// One sentence, if threads cannot be started.
pub fn low_priority_pool(name: &'static str) -> Result<ThreadPool, String> {
    ThreadPoolBuilder::new()
        .num_threads(rayon::current_num_threads())
        .thread_name(move |i| format!("{name} {i}"))
        .start_handler(|_| lower_priority())
        .build()
        .map_err(|error| format!("Cannot start threads for the {name}: {error}."))
}

/// Sets the nice value of the calling thread: on Linux `setpriority` of "this process" concerns one
/// thread. If that fails, frames are less smooth, nothing else.
#[cfg(target_os = "linux")]
fn lower_priority() {
    let _ = rustix::process::setpriority_process(None, 19);
}

#[cfg(not(target_os = "linux"))]
fn lower_priority() {}

#[cfg(test)]
mod tests {
    use super::*;

    fn start<S: Send + 'static>(
        data: S,
        work: impl FnOnce(&Shared<S>) -> Result<(), String> + Send + 'static,
    ) -> Task<S> {
        let pool = ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        Task::start("test", pool, data, work).unwrap()
    }

    #[test]
    fn result_and_stages_reach_the_owner() {
        let task = start(0, |shared| {
            shared.begin("first", "steps", 4);
            shared.advance(4);
            shared.complete_round(|data| *data = 7);
            shared.begin("second", "steps", 4);
            shared.advance(1);
            Err("no light".into())
        });
        let state = task.wait_while(|state| !state.ended);
        assert_eq!((state.data, state.error.as_deref()), (7, Some("no light")));
        assert_eq!(state.stages, ["second"], "of the last round");
        assert_eq!(task.stage_share(), 0.25);
    }

    #[test]
    fn panic_becomes_an_error() {
        let task = start((), |_| panic!("on purpose"));
        let error = task.wait_while(|state| !state.ended).error.clone();
        let expected = "The test stopped because of an error in the program.";
        assert_eq!(error.as_deref(), Some(expected));
    }

    #[test]
    fn drop_cancels_without_an_error() {
        let task = start((), |shared| {
            while !shared.is_cancelled() {
                std::thread::yield_now();
            }
            Err("cancelled".into())
        });
        let shared = task.share();
        drop(task);
        assert_eq!(shared.wait_while(|state| !state.ended).error, None);
    }

    #[test]
    fn requests_are_answered_until_drop() {
        let task = start((None, 0), |shared| {
            while let Some(request) = shared.next_request(|(request, _)| request.take()) {
                shared.update(|state| state.data.1 += request);
            }
            Ok(())
        });
        for request in [1, 2] {
            task.update(|state| state.data.0 = Some(request));
            drop(task.wait_while(|state| state.data.0.is_some()));
        }
        drop(task.wait_while(|state| state.data.1 < 3));
        let shared = task.share();
        drop(task);
        drop(shared.wait_while(|state| !state.ended));
    }
}
