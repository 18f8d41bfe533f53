//! A folder of images with depth in the window: a cube LDI of the few images nearest to the view,
//! built anew in the background while one moves (S24).
//!
//! The window says where the eye is, and goes on drawing the cube it has; a thread of low priority
//! asks which images are nearest now, builds their cube if they are others than those of the last
//! one, and hands it over whole. What was wished for before and is not any more is never built.

use super::cube::CubeSource;
use headbox_core::camera::Camera;
use headbox_cube::pack::{CubeLdi, SplatIndexLayout, Split};
use headbox_ldi::from_images::NearImages;
use headbox_viewer::{
    EyeBounds, Fact, Figure, FrameReport, FrameRequest, FrameSource, Pose, Refinement, Setting,
};
use headbox_views::background;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Interval between two polls of the building thread.
const LOOK_AGAIN: Duration = Duration::from_millis(30);

/// Images, walked through by cubes of those nearest.
pub(super) struct LiveSource {
    title: String,
    start: Pose,
    speed_m_per_s: f64,
    /// Draws the newest cube.
    shown: CubeSource,
    builder: Builder,
    wish: ViewRequest,
    /// Images of the shown cube, and its build time, ms.
    made_of: (String, f64),
}

/// View request: camera and number of images.
type ViewRequest = (Camera, usize);

/// A cube, and which images it is of.
struct LiveCube {
    cube: CubeLdi,
    images: Vec<usize>,
    names: String,
    ms: f64,
}

impl LiveSource {
    /// Looks at a set from `start`; the first cube is built at once.
    ///
    /// # Errors
    /// One sentence: an image cannot be read, or no thread started.
    pub(super) fn new(
        title: String,
        mut near: NearImages,
        folder: &Path,
        start: &Camera,
    ) -> Result<Self, String> {
        let wish = (*start, NearImages::COUNT);
        let nearest = near.nearest(start, NearImages::COUNT);
        let LiveCube {
            cube,
            images,
            names,
            ms,
        } = build(&mut near, nearest)?;
        let speed_m_per_s = near.depth_m() / 2.0;
        let builder = Builder::start(near, images)?;
        let shown = CubeSource::of_images(cube, folder);
        Ok(Self {
            title,
            start: crate::start_at(start),
            speed_m_per_s,
            shown,
            builder,
            wish,
            made_of: (names, ms),
        })
    }
}

fn build(near: &mut NearImages, images: Vec<usize>) -> Result<LiveCube, String> {
    let started = Instant::now();
    let ldi = near.cube(&images).map_err(|error| error.to_string())?;
    let cube = CubeLdi::pack(&ldi, SplatIndexLayout::Normal, Split::Auto)
        .map_err(|error| error.to_string())?;
    let names = images
        .iter()
        .map(|&i| near.views()[i].name.as_str())
        .collect::<Vec<_>>()
        .join(", ");
    Ok(LiveCube {
        cube,
        images,
        names,
        ms: started.elapsed().as_secs_f64() * 1e3,
    })
}

/// The thread that builds cubes. Dropping it ends the thread after the cube in hand; nobody waits
/// for it.
struct Builder {
    shared: Arc<LiveShared>,
}

#[derive(Default)]
struct LiveShared {
    state: Mutex<LiveState>,
    wished: Condvar,
}

#[derive(Default)]
struct LiveState {
    wish: Option<ViewRequest>,
    /// A wish is being looked into.
    busy: bool,
    newest: Option<LiveCube>,
    failed: Option<String>,
    closed: bool,
}

impl Builder {
    /// `images` is what the cube that is shown already was built of.
    fn start(near: NearImages, images: Vec<usize>) -> Result<Self, String> {
        let pool = background::pool("images")?;
        let shared = Arc::new(LiveShared::default());
        let spawned = std::thread::Builder::new().name("images".into()).spawn({
            let shared = Arc::clone(&shared);
            move || {
                let work = || pool.install(|| shared.work(near, images));
                if catch_unwind(AssertUnwindSafe(work)).is_err() {
                    let mut state = shared.lock();
                    state.failed = Some(
                        "The images cannot be merged because of an error in the program.".into(),
                    );
                    state.busy = false;
                }
            }
        });
        spawned.map_err(|error| format!("Cannot start a thread: {error}."))?;
        Ok(Self { shared })
    }

    fn wish(&self, wish: ViewRequest) {
        self.shared.lock().wish = Some(wish);
        self.shared.wished.notify_one();
    }

    /// The newest cube, once, and whether another may come.
    ///
    /// # Errors
    /// Why one could not be built, told once.
    fn look(&self) -> Result<(Option<LiveCube>, bool), String> {
        let mut state = self.shared.lock();
        match state.failed.take() {
            Some(failed) => Err(failed),
            None => Ok((state.newest.take(), state.busy || state.wish.is_some())),
        }
    }
}

impl Drop for Builder {
    fn drop(&mut self) {
        self.shared.lock().closed = true;
        self.shared.wished.notify_one();
    }
}

impl LiveShared {
    /// A panic elsewhere leaves whole values here, so a poisoned lock is still good.
    fn lock(&self) -> MutexGuard<'_, LiveState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Builds what is wished for until nobody can wish any more.
    fn work(&self, mut near: NearImages, mut last: Vec<usize>) {
        while let Some((camera, count)) = self.next_wish() {
            let images = near.nearest(&camera, count);
            // The same images about the eye of another of them show the same.
            if images.len() == last.len() && images.iter().all(|i| last.contains(i)) {
                continue;
            }
            last.clone_from(&images);
            let built = build(&mut near, images);
            let mut state = self.lock();
            match built {
                Ok(built) => state.newest = Some(built),
                Err(error) => state.failed = Some(error),
            }
        }
    }

    fn next_wish(&self) -> Option<ViewRequest> {
        let mut state = self.lock();
        loop {
            state.busy = false;
            if state.closed {
                return None;
            }
            if let Some(wish) = state.wish.take() {
                state.busy = true;
                return Some(wish);
            }
            state = self
                .wished
                .wait(state)
                .unwrap_or_else(PoisonError::into_inner);
        }
    }
}

impl FrameSource for LiveSource {
    fn title(&self) -> String {
        self.title.clone()
    }

    fn start_pose(&self) -> Pose {
        self.start
    }

    /// The cubes follow the eye.
    fn bounds(&self) -> Option<EyeBounds> {
        None
    }

    fn speed_m_per_s(&self) -> f64 {
        self.speed_m_per_s
    }

    fn file_frame(&self) -> headbox_core::file_frame::FileFrame {
        self.shown.file_frame()
    }

    fn terms(&self) -> &'static [(&'static str, &'static str)] {
        self.shown.terms()
    }

    fn settings(&self) -> Vec<Setting> {
        let images = Setting::count(
            "images",
            "Images",
            "How many of the images nearest to the view make up the cube that is shown (no unit).",
            NearImages::COUNT as u32,
            1..=16,
        );
        std::iter::once(images)
            .chain(self.shown.settings())
            .collect()
    }

    fn render(
        &mut self,
        request: &FrameRequest,
        pixels: &mut [[u8; 4]],
    ) -> Result<FrameReport, String> {
        let wish = (request.camera, request.settings.number("images")? as usize);
        if self.wish != wish {
            self.builder.wish(wish);
            self.wish = wish;
        }
        let (newest, may_come) = self.builder.look()?;
        if let Some(LiveCube {
            cube, names, ms, ..
        }) = newest
        {
            self.shown.show(cube);
            self.made_of = (names, ms);
        }
        let mut report = self.shown.render(request, pixels)?;
        let (names, ms) = &self.made_of;
        report.facts.push(Fact {
            name: "made of",
            text: names.clone(),
        });
        report.figures.push(Figure {
            name: "the cube took",
            value: *ms,
            unit: "ms",
        });
        if may_come {
            report.refinement = Refinement::Later(LOOK_AGAIN);
        }
        Ok(report)
    }

    fn act(&mut self, action: &str) -> Result<String, String> {
        self.shown.act(action)
    }
}
