//! Ray-traced truth of the current view, refined in the background.

use super::background;
use super::growth::LitScene;
use crate::capture::Camera;
use crate::progress::Progress;
use crate::truth::{self, Truth};
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// Rays per pixel of one truth after the other: all together a third more than the last.
const SAMPLES: [u32; 4] = [2, 8, 32, 128];

/// Views asked for last that are worth tracing: two eyes with two settings each.
const VIEWS: usize = 4;

/// Truth of one view so far.
#[derive(Clone)]
pub(super) struct Traced {
    camera: Camera,
    /// Number of entries of [`SAMPLES`] behind it.
    rounds: usize,
    pub(super) truth: Arc<Truth>,
}

impl Traced {
    /// Rays per pixel.
    pub(super) fn samples(&self) -> u32 {
        SAMPLES[self.rounds - 1]
    }

    /// Nothing better will come.
    pub(super) fn is_final(&self) -> bool {
        self.rounds == SAMPLES.len()
    }
}

/// Traces truth for the views asked for. Dropping it ends that; nobody waits for the thread, which ends by itself.
pub(super) struct Reference {
    shared: Arc<Shared>,
}

#[derive(Default)]
struct Shared {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Default)]
struct State {
    /// The last views asked for, newest first, with repetitions.
    asked: VecDeque<Camera>,
    traced: Vec<Traced>,
    failed: Option<String>,
    closed: bool,
}

impl Reference {
    /// Starts the thread. `scene` is called there, and may take its time.
    ///
    /// # Errors
    /// One sentence, if there can be no thread.
    pub(super) fn start(scene: impl FnOnce() -> Result<LitScene, String> + Send + 'static) -> Result<Self, String> {
        let shared = Arc::new(Shared::default());
        let pool = background::pool("error map")?;
        let spawned = std::thread::Builder::new().name("error map".into()).spawn({
            let shared = Arc::clone(&shared);
            move || {
                let work = || pool.install(|| scene().map(|scene| shared.work(&scene)));
                let panicked = |_| Err("Ray tracing stopped because of an error in the program.".into());
                let done = catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(panicked);
                shared.lock().failed = done.err();
            }
        });
        spawned.map_err(|error| format!("Cannot start a thread: {error}."))?;
        Ok(Self { shared })
    }

    /// The best truth of a view so far; it goes on being refined.
    ///
    /// # Errors
    /// One sentence, if there will be none.
    pub(super) fn ask(&self, camera: &Camera) -> Result<Option<Traced>, String> {
        let mut state = self.shared.lock();
        if let Some(error) = &state.failed {
            return Err(error.clone());
        }
        state.asked.push_front(*camera);
        state.asked.truncate(VIEWS);
        let State { asked, traced, .. } = &mut *state;
        traced.retain(|t| asked.contains(&t.camera));
        self.shared.changed.notify_all();
        Ok(state.traced.iter().find(|t| t.camera == *camera).cloned())
    }

    /// No view needs truth until one asks again.
    pub(super) fn rest(&self) {
        let mut state = self.shared.lock();
        state.asked.clear();
        state.traced.clear();
    }
}

impl Drop for Reference {
    fn drop(&mut self) {
        self.shared.lock().closed = true;
        self.shared.changed.notify_all();
    }
}

impl Shared {
    /// A panic elsewhere leaves whole values here, so a poisoned lock is still good.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn work(&self, scene: &LitScene) {
        while let Some((camera, rounds)) = self.next() {
            let wanted = StillWanted { shared: self, camera };
            let samples = SAMPLES[rounds];
            let truth = truth::render(&scene.tracer, &scene.lighting, scene.lit, &camera, samples, &wanted);
            if wanted.is_cancelled() {
                continue;
            }
            let traced = Traced { camera, rounds: rounds + 1, truth: Arc::new(truth) };
            let mut state = self.lock();
            state.traced.retain(|t| t.camera != camera);
            state.traced.push(traced);
        }
    }

    /// The view that is the farthest behind, and the rounds it has had; waits for one. `None` ends the work.
    fn next(&self) -> Option<(Camera, usize)> {
        let mut state = self.lock();
        loop {
            if state.closed {
                return None;
            }
            let rounds = |camera: &Camera| state.traced.iter().find(|t| t.camera == *camera).map_or(0, |t| t.rounds);
            let behind = state.asked.iter().map(|camera| (*camera, rounds(camera))).min_by_key(|(_, rounds)| *rounds);
            match behind.filter(|(_, rounds)| *rounds < SAMPLES.len()) {
                Some(next) => return Some(next),
                None => state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner),
            }
        }
    }
}

/// Gives up once nobody asks for the view any more.
struct StillWanted<'a> {
    shared: &'a Shared,
    camera: Camera,
}

impl Progress for StillWanted<'_> {
    fn begin(&self, _: &str, _: &str, _: u64) {}
    fn advance(&self, _: u64) {}

    fn is_cancelled(&self) -> bool {
        let state = self.shared.lock();
        state.closed || !state.asked.contains(&self.camera)
    }
}
