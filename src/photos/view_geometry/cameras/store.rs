//! LRU cache of the cameras' images, bounded in bytes (E10).
//!
//! A caller that can wait (a frame for a file) has missing images decoded at once, in parallel. A
//! caller that cannot (a window) gets the best ranked images in memory, while a background thread
//! decodes the missing ones, the best ranked first. An image that can no longer be read is recorded
//! with the reason, and its camera is skipped.

use super::picture::Picture;
use super::samples::Samples;
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
    /// Decode missing images first.
    Wait,
    /// Use the next best cameras until missing images are decoded.
    Never,
}

/// Image cache of a set's views.
pub(crate) struct PictureStore {
    shared: Arc<StoreShared>,
    /// Wakes the decoding thread; set once a caller could not wait.
    worker: OnceLock<Sender<()>>,
}

struct StoreShared {
    views: Vec<View>,
    budget: usize,
    on_load: OnceLock<OnLoad>,
    state: Mutex<StoreState>,
}

/// Callback with a camera's index and view, once the view is loaded; returns the camera's samples
/// if they are stored in a file.
type OnLoad = Box<dyn Fn(u32, &LoadedView) -> Option<Arc<Samples>> + Send + Sync>;

#[derive(Default)]
struct StoreState {
    /// Images in memory; a tick of the LRU order is a call of `fetch`.
    images: LruCache<u32, LoadedImage>,
    /// Reasons why images cannot be read.
    lost: BTreeMap<u32, String>,
    /// Cameras that the thread is to decode, the best ranked last.
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
            on_load: OnceLock::new(),
            state: Mutex::default(),
        };
        Self {
            shared: Arc::new(shared),
            worker: OnceLock::new(),
        }
    }

    /// Sets the callback that gets each camera's view before its image is available; only the first
    /// call has an effect.
    pub(crate) fn set_on_load(
        &self,
        on_load: impl Fn(u32, &LoadedView) -> Option<Arc<Samples>> + Send + Sync + 'static,
    ) {
        self.shared.on_load.get_or_init(|| Box::new(on_load));
    }

    /// Stores an image that was loaded for another purpose, if there is room.
    pub(crate) fn offer(&self, camera: u32, picture: impl FnOnce() -> Picture) {
        if self.bytes() >= self.shared.budget {
            return;
        }
        let picture = picture();
        let mut state = self.shared.lock();
        if state.images.bytes() as usize + picture.bytes() <= self.shared.budget {
            state.insert(camera, picture);
        }
    }

    /// Returns the images of the first `count` cameras of a ranking that have one in memory, in
    /// order of rank, and the number of better ranked ones that are still missing.
    pub(crate) fn fetch(
        &self,
        ranked: impl Iterator<Item = u32>,
        count: usize,
        wait: WaitPolicy,
    ) -> (Vec<(u32, Arc<Picture>)>, usize) {
        let ranked: Vec<u32> = ranked.collect();
        self.shared.lock().images.next_tick();
        if wait == WaitPolicy::Wait {
            self.decode_missing(&ranked, count);
        }
        let mut state = self.shared.lock();
        let mut found = Vec::with_capacity(count.min(ranked.len()));
        let mut missing = Vec::new();
        for camera in ranked {
            if found.len() == count {
                break;
            }
            match state.images.get(camera) {
                Some(loaded) => found.push((camera, loaded.picture)),
                None if state.lost.contains_key(&camera) => {}
                None => missing.push(camera),
            }
        }
        let evicted = state.images.evict_to(self.shared.budget as u64);
        missing.truncate(count);
        let missing_count = missing.len();
        missing.reverse();
        // Replaces the queue: images that this frame does not need are no longer decoded.
        state.queued = missing;
        drop(state);
        drop(evicted);
        if missing_count > 0 {
            let worker = self
                .worker
                .get_or_init(|| StoreShared::start(Arc::clone(&self.shared)));
            // The thread only ends when the store is dropped.
            let _ = worker.send(());
        }
        (found, missing_count)
    }

    /// Decodes images until the first `count` readable cameras of a ranking are in memory.
    fn decode_missing(&self, ranked: &[u32], count: usize) {
        loop {
            let missing: Vec<u32> = {
                let mut state = self.shared.lock();
                let StoreState { images, lost, .. } = &mut *state;
                let readable = ranked
                    .iter()
                    .copied()
                    .filter(|camera| !lost.contains_key(camera))
                    .take(count);
                readable
                    .filter(|camera| images.get(*camera).is_none())
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

    /// Returns the name of a view.
    pub(crate) fn name(&self, camera: u32) -> String {
        self.shared
            .views
            .get(camera as usize)
            .map_or_else(String::new, |view| view.name.clone())
    }

    /// Returns an image that is in memory, without marking it as used.
    pub(crate) fn peek(&self, camera: u32) -> Option<Arc<Picture>> {
        self.shared
            .lock()
            .images
            .peek(camera)
            .map(|loaded| Arc::clone(&loaded.picture))
    }

    /// Returns the time since an image was loaded, seconds.
    pub(crate) fn age_s(&self, camera: u32) -> Option<f32> {
        self.shared
            .lock()
            .images
            .peek(camera)
            .map(|loaded| loaded.since.elapsed().as_secs_f32())
    }

    /// Returns the reasons why images can no longer be read, a sentence each.
    pub(crate) fn lost(&self) -> Vec<String> {
        self.shared.lock().lost.values().cloned().collect()
    }

    /// Bytes of the images in memory.
    pub(crate) fn bytes(&self) -> usize {
        self.shared.lock().images.bytes() as usize
    }
}

impl StoreShared {
    fn lock(&self) -> MutexGuard<'_, StoreState> {
        // A panic elsewhere leaves the state valid: each change is one insertion or removal.
        self.state
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner)
    }

    /// Loads a camera's image and evicts the least recently used ones.
    fn decode(&self, camera: u32) {
        let picture = match self.views.get(camera as usize).map(View::load) {
            Some(Ok(view)) => {
                let on_load = self.on_load.get();
                let samples = on_load.and_then(|on_load| on_load(camera, &view));
                Ok(Picture::new(&view).with_samples(samples))
            }
            Some(Err(error)) => Err(error.to_string()),
            None => Err(format!("there is no view {camera}")),
        };
        let mut state = self.lock();
        match picture {
            Ok(picture) => state.insert(camera, picture),
            Err(why) => {
                state.lost.insert(camera, why);
            }
        }
        let evicted = state.images.evict_to(self.budget as u64);
        drop(state);
        drop(evicted);
    }

    /// Starts the thread that decodes the queue whenever it is notified.
    fn start(shared: Arc<Self>) -> Sender<()> {
        let (sender, receiver): (Sender<()>, Receiver<()>) = channel();
        let work = move || {
            while receiver.recv().is_ok() {
                while let Some(camera) = { shared.lock().next_queued() } {
                    shared.decode(camera);
                }
            }
        };
        // Without a thread the images stay missing, and the next best cameras are used.
        let _ = std::thread::Builder::new()
            .name("pictures".into())
            .spawn(work);
        sender
    }
}

impl StoreState {
    fn insert(&mut self, camera: u32, picture: Picture) {
        let bytes = picture.bytes() as u64;
        self.images.put(
            camera,
            LoadedImage {
                picture: Arc::new(picture),
                since: Instant::now(),
            },
            bytes,
        );
    }

    fn next_queued(&mut self) -> Option<u32> {
        std::iter::from_fn(|| self.queued.pop())
            .find(|camera| self.images.peek(*camera).is_none() && !self.lost.contains_key(camera))
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
    fn least_recently_used_images_are_evicted() {
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
        let images: Vec<u32> = store
            .shared
            .lock()
            .images
            .iter()
            .map(|(camera, _)| camera)
            .collect();
        assert_eq!(
            images,
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
        for wait in [WaitPolicy::Wait, WaitPolicy::Never] {
            assert_eq!(
                cameras(&store.fetch([0, 1, 2].into_iter(), 2, wait)),
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
