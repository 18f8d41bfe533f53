//! A folder of images with depth in the window: a cube LDI of the few images nearest to the view,
//! rebuilt in the background while the camera moves (S24).
//!
//! The window requests a view and keeps drawing the cube that it has. A low-priority thread selects
//! the images nearest to the view and builds their cube if they differ from those of the last one.
//! A newer request replaces one that is not started yet.

use super::cube::CubeSource;
use headbox_core::camera::Camera;
use headbox_core::task::{Shared, Task, low_priority_pool};
use headbox_cube::pack::{CubeLdi, SplatIndexLayout, Split};
use headbox_ldi::from_images::NearestImages;
use headbox_viewer::{
    EyeBounds, Fact, Figure, FrameReport, FrameRequest, FrameSource, Pose, Refinement, Setting,
};
use std::path::Path;
use std::time::{Duration, Instant};

/// Interval between two polls of the building thread.
const POLL_INTERVAL: Duration = Duration::from_millis(30);

/// An image set, shown by cubes of the images nearest to the view.
pub(super) struct LiveSource {
    title: String,
    start: Pose,
    speed_m_per_s: f64,
    /// Draws the newest cube.
    shown: CubeSource,
    builder: Task<BuilderState>,
    request: ViewRequest,
    /// Names of the shown cube's images, and its build time, ms.
    shown_images: (String, f64),
}

/// View request: camera and number of images.
type ViewRequest = (Camera, usize);

/// A cube with the indices and names of its images.
struct LiveCube {
    cube: CubeLdi,
    images: Vec<usize>,
    names: String,
    ms: f64,
}

impl LiveSource {
    /// Opens a set with the camera `start`, for which it builds the first cube.
    ///
    /// # Errors
    /// One sentence, if an image cannot be read or the thread cannot be started.
    pub(super) fn new(
        title: String,
        mut near: NearestImages,
        folder: &Path,
        start: &Camera,
    ) -> Result<Self, String> {
        let request = (*start, NearestImages::COUNT);
        let nearest = near.nearest(start, NearestImages::COUNT);
        let LiveCube {
            cube,
            images,
            names,
            ms,
        } = build(&mut near, nearest)?;
        let speed_m_per_s = near.depth_m() / 2.0;
        let builder = start_builder(near, images)?;
        let shown = CubeSource::from_images(cube, folder);
        Ok(Self {
            title,
            start: crate::start_at(start),
            speed_m_per_s,
            shown,
            builder,
            request,
            shown_images: (names, ms),
        })
    }
}

fn build(near: &mut NearestImages, images: Vec<usize>) -> Result<LiveCube, String> {
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

#[derive(Default)]
struct BuilderState {
    request: Option<ViewRequest>,
    /// True while a request is processed.
    busy: bool,
    newest: Option<LiveCube>,
    /// Error of the last build.
    build_error: Option<String>,
}

/// Starts the thread that builds cubes. `last` are the images of the cube that exists already.
fn start_builder(
    mut near: NearestImages,
    mut last: Vec<usize>,
) -> Result<Task<BuilderState>, String> {
    const NAME: &str = "image merging";
    let work = move |shared: &Shared<BuilderState>| {
        let next_request = |state: &mut BuilderState| {
            state.busy = state.request.is_some();
            state.request.take()
        };
        while let Some((camera, count)) = shared.next_request(next_request) {
            let images = near.nearest(&camera, count);
            // The same images in another order make the same cube.
            if images.len() == last.len() && images.iter().all(|i| last.contains(i)) {
                continue;
            }
            last.clone_from(&images);
            let built = build(&mut near, images);
            shared.update(|state| match built {
                Ok(built) => state.data.newest = Some(built),
                Err(error) => state.data.build_error = Some(error),
            });
        }
        Ok(())
    };
    Task::start(
        NAME,
        low_priority_pool(NAME)?,
        BuilderState::default(),
        work,
    )
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
            NearestImages::COUNT as u32,
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
        let view_request = (request.camera, request.settings.number("images")? as usize);
        let is_new = self.request != view_request;
        self.request = view_request;
        let (newest, error, may_come) = self.builder.update(|state| {
            if is_new {
                state.data.request = Some(view_request);
            }
            let error = state.error.take().or(state.data.build_error.take());
            let may_come = !state.ended && (state.data.busy || state.data.request.is_some());
            (state.data.newest.take(), error, may_come)
        });
        if let Some(error) = error {
            return Err(error);
        }
        if let Some(LiveCube {
            cube, names, ms, ..
        }) = newest
        {
            self.shown.show(cube);
            self.shown_images = (names, ms);
        }
        let mut report = self.shown.render(request, pixels)?;
        let (names, ms) = &self.shown_images;
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
            report.refinement = Refinement::Later(POLL_INTERVAL);
        }
        Ok(report)
    }

    fn save(&mut self, id: &str, path: &Path) -> Result<String, String> {
        self.shown.save(id, path)
    }
}
