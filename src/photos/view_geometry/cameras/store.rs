//! The cameras' pictures within a budget of bytes (E10).
//!
//! Those used longest ago make room. Whoever can wait (a picture for a file) has missing ones
//! decoded at once, side by side; whoever cannot (a window) takes the best ranked of those at hand,
//! while a thread of its own decodes the missing ones, the best ranked first. A picture that cannot
//! be read any more is remembered as lost: its camera is passed over, and why is said.

use super::picture::Picture;
use headbox_core::lru::LruCache;
use headbox_images::{LoadedView, View};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock};
use std::time::Instant;

/// Waiting behaviour of a frame for missing images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WaitPolicy {
    /// Missing pictures are decoded first.
    Wait,
    /// The next best cameras serve until they are.
    Never,
}

/// Pictures of views.
pub(crate) struct PictureStore {
    shared: Arc<StoreShared>,
    /// To the thread that decodes, once somebody could not wait.
    worker: OnceLock<Sender<()>>,
}

struct StoreShared {
    views: Vec<View>,
    budget: usize,
    when_read: OnceLock<WhenRead>,
    state: Mutex<StoreState>,
}

/// Callback on a camera's view once it is in memory.
type WhenRead = Box<dyn Fn(u32, &LoadedView) + Send + Sync>;

#[derive(Default)]
struct StoreState {
    /// Moments are fetches.
    held: LruCache<u32, LoadedImage>,
    /// Why pictures cannot be read.
    lost: BTreeMap<u32, String>,
    /// Cameras that the thread has yet to decode.
    queued: Vec<u32>,
}

#[derive(Clone)]
struct LoadedImage {
    picture: Arc<Picture>,
    since: Instant,
}

impl PictureStore {
    pub(crate) fn new(views: Vec<View>, budget: usize) -> Self {
        let shared = StoreShared {
            views,
            budget,
            when_read: OnceLock::new(),
            state: Mutex::default(),
        };
        Self {
            shared: Arc::new(shared),
            worker: OnceLock::new(),
        }
    }

    /// From now on `look` is given each camera's view before its picture is at hand. It is told so
    /// once.
    pub(crate) fn when_read(&self, look: impl Fn(u32, &LoadedView) + Send + Sync + 'static) {
        self.shared.when_read.get_or_init(|| Box::new(look));
    }

    /// Keeps a picture that is at hand anyhow, if there is room.
    pub(crate) fn offer(&self, camera: u32, picture: impl FnOnce() -> Picture) {
        if self.bytes() >= self.shared.budget {
            return;
        }
        let picture = picture();
        let mut state = self.shared.lock();
        if state.held.bytes() as usize + picture.bytes() <= self.shared.budget {
            state.hold(camera, picture);
        }
    }

    /// The pictures of the first `count` cameras that have one, in order of rank, and how many
    /// better ones are still to come.
    pub(crate) fn fetch(
        &self,
        ranked: impl Iterator<Item = u32>,
        count: usize,
        patience: WaitPolicy,
    ) -> (Vec<(u32, Arc<Picture>)>, usize) {
        let ranked: Vec<u32> = ranked.collect();
        self.shared.lock().held.next_tick();
        if patience == WaitPolicy::Wait {
            self.decode_missing(&ranked, count);
        }
        let mut state = self.shared.lock();
        let mut found = Vec::with_capacity(count.min(ranked.len()));
        let mut missing = Vec::new();
        for camera in ranked {
            if found.len() == count {
                break;
            }
            match state.held.get(camera) {
                Some(at_hand) => found.push((camera, at_hand.picture)),
                None if state.lost.contains_key(&camera) => {}
                None => missing.push(camera),
            }
        }
        let gone = state.held.evict_to(self.shared.budget as u64);
        missing.truncate(count);
        let to_come = missing.len();
        missing.reverse();
        // What was wanted before and is not any more need not be decoded.
        state.queued = missing;
        drop(state);
        drop(gone);
        if to_come > 0 {
            let worker = self
                .worker
                .get_or_init(|| StoreShared::start(Arc::clone(&self.shared)));
            // The thread ends with the store alone.
            let _ = worker.send(());
        }
        (found, to_come)
    }

    /// Decodes until the first `count` readable cameras of a ranking are held.
    fn decode_missing(&self, ranked: &[u32], count: usize) {
        loop {
            let missing: Vec<u32> = {
                let mut state = self.shared.lock();
                let StoreState { held, lost, .. } = &mut *state;
                let readable = ranked
                    .iter()
                    .copied()
                    .filter(|camera| !lost.contains_key(camera))
                    .take(count);
                readable
                    .filter(|camera| held.get(*camera).is_none())
                    .collect()
            };
            if missing.is_empty() {
                return;
            }
            missing
                .into_par_iter()
                .for_each(|camera| self.shared.decode(camera));
        }
    }

    /// The name of a view.
    pub(crate) fn name(&self, camera: u32) -> String {
        self.shared
            .views
            .get(camera as usize)
            .map_or_else(String::new, |view| view.name.clone())
    }

    /// A picture, if it is at hand; to look at it is no use of it.
    pub(crate) fn at_hand(&self, camera: u32) -> Option<Arc<Picture>> {
        self.shared
            .lock()
            .held
            .peek(camera)
            .map(|at_hand| Arc::clone(&at_hand.picture))
    }

    /// Time since an image was loaded, seconds.
    pub(crate) fn age_s(&self, camera: u32) -> Option<f32> {
        self.shared
            .lock()
            .held
            .peek(camera)
            .map(|at_hand| at_hand.since.elapsed().as_secs_f32())
    }

    /// Images that can no longer be read: a sentence each.
    pub(crate) fn lost(&self) -> Vec<String> {
        self.shared.lock().lost.values().cloned().collect()
    }

    /// Bytes of the pictures at hand.
    pub(crate) fn bytes(&self) -> usize {
        self.shared.lock().held.bytes() as usize
    }
}

impl StoreShared {
    fn lock(&self) -> MutexGuard<'_, StoreState> {
        // A panic elsewhere leaves the state whole: each change is one insertion or removal.
        self.state
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner)
    }

    /// Reads a camera's picture, and lets go of what it takes the room of.
    fn decode(&self, camera: u32) {
        let picture = match self.views.get(camera as usize).map(View::load) {
            Some(Ok(view)) => {
                if let Some(look) = self.when_read.get() {
                    look(camera, &view);
                }
                Ok(Picture::new(&view))
            }
            Some(Err(error)) => Err(error.to_string()),
            None => Err(format!("there is no view {camera}")),
        };
        let mut state = self.lock();
        match picture {
            Ok(picture) => state.hold(camera, picture),
            Err(why) => {
                state.lost.insert(camera, why);
            }
        }
        let gone = state.held.evict_to(self.budget as u64);
        drop(state);
        drop(gone);
    }

    /// Starts the thread that decodes what is queued whenever it is told to look.
    fn start(shared: Arc<Self>) -> Sender<()> {
        let (sender, receiver): (Sender<()>, Receiver<()>) = channel();
        let work = move || {
            while receiver.recv().is_ok() {
                while let Some(camera) = { shared.lock().next_queued() } {
                    shared.decode(camera);
                }
            }
        };
        // Without a thread the pictures stay missing, and the next best cameras go on serving.
        let _ = std::thread::Builder::new()
            .name("pictures".into())
            .spawn(work);
        sender
    }
}

impl StoreState {
    fn hold(&mut self, camera: u32, picture: Picture) {
        let bytes = picture.bytes() as u64;
        self.held.put(
            camera,
            LoadedImage {
                picture: Arc::new(picture),
                since: Instant::now(),
            },
            bytes,
        );
    }

    fn next_queued(&mut self) -> Option<u32> {
        while let Some(camera) = self.queued.pop() {
            if self.held.peek(camera).is_none() && !self.lost.contains_key(&camera) {
                return Some(camera);
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    pub(crate) use crate::view_geometry::tests::{plane_view, saved};
    use glam::DVec3;

    fn views(count: usize, folder: &std::path::Path) -> Vec<View> {
        let view = |i: usize| {
            saved(
                &plane_view(DVec3::X * i as f64, 2.0, [32, 24]),
                folder,
                &format!("{i}"),
            )
        };
        (0..count).map(view).collect()
    }

    fn cameras((found, _): &(Vec<(u32, Arc<Picture>)>, usize)) -> Vec<u32> {
        found.iter().map(|(camera, _)| *camera).collect()
    }

    #[test]
    fn pictures_used_longest_ago_make_room() {
        let folder = tempfile::tempdir().expect("a folder");
        let views = views(6, folder.path());
        let one = Picture::new(&views[0].load().expect("loads")).bytes();
        let store = PictureStore::new(views, 3 * one);
        let fetch =
            |ranked: &[u32]| cameras(&store.fetch(ranked.iter().copied(), 2, WaitPolicy::Wait));
        assert_eq!(fetch(&[0, 1, 2]), [0, 1]);
        assert_eq!(fetch(&[2, 0]), [2, 0]);
        assert_eq!(fetch(&[3, 4]), [3, 4]);
        assert_eq!(store.bytes(), 3 * one);
        let held: Vec<u32> = store
            .shared
            .lock()
            .held
            .iter()
            .map(|(camera, _)| camera)
            .collect();
        assert_eq!(
            held,
            [2, 3, 4],
            "1 was used before 0 and 2; of these the lower number went"
        );
    }

    #[test]
    fn vanished_image_is_skipped_and_reported() {
        let folder = tempfile::tempdir().expect("a folder");
        let views = views(3, folder.path());
        std::fs::remove_file(&views[1].color).expect("removed");
        let store = PictureStore::new(views, usize::MAX);
        for patience in [WaitPolicy::Wait, WaitPolicy::Never] {
            assert_eq!(
                cameras(&store.fetch([0, 1, 2].into_iter(), 2, patience)),
                [0, 2]
            );
        }
        assert!(
            matches!(&store.lost()[..], [why] if why.contains("1.png")),
            "{:?}",
            store.lost()
        );
    }

    #[test]
    fn no_wait_uses_loaded_images_first() {
        let folder = tempfile::tempdir().expect("a folder");
        let store = PictureStore::new(views(4, folder.path()), usize::MAX);
        store.fetch([3].into_iter(), 1, WaitPolicy::Wait);
        assert_eq!(
            cameras(&store.fetch([0, 1, 2, 3].into_iter(), 2, WaitPolicy::Never)),
            [3]
        );
        let started = Instant::now();
        while cameras(&store.fetch([0, 1, 2, 3].into_iter(), 2, WaitPolicy::Never)) != [0, 1] {
            assert!(started.elapsed().as_secs() < 60, "the thread decodes");
            std::thread::yield_now();
        }
    }
}
