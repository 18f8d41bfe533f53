//! Any [`View`] as a frame source.

use crate::facts::{axes_fact, simd_fact};
use crate::threads::FewerThreads;
use glam::DVec3;
use headbox_core::file_frame::FileFrame;
use headbox_core::frame::Frame;
use headbox_core::view::{StartView, View};
use headbox_viewer::{
    EyeBounds, Fact, FrameReport, FrameRequest, FrameSource, Navigation, Pose, RoomMap, Setting,
};
use std::path::Path;

/// Frame size for which the start pose is chosen, pixels: about that of a window.
const WINDOW_PX: [u32; 2] = [1024, 768];

/// A view as a source of frames, with a setting for the number of threads.
pub(crate) struct ViewSource {
    title: String,
    view: Box<dyn View>,
    threads: FewerThreads,
}

impl ViewSource {
    /// Creates the source of a view whose data come from the file or folder `origin`.
    pub(crate) fn new(view: Box<dyn View>, origin: &Path) -> Self {
        let name = crate::file_name::file_name(origin);
        Self {
            title: format!("{name} ({})", view.kind()),
            view,
            threads: FewerThreads::default(),
        }
    }
}

/// Pose of a start view.
pub(crate) fn pose(start: &StartView) -> Pose {
    let StartView {
        eye,
        forward,
        up,
        fov_y_deg,
    } = *start;
    Pose::upright(eye, eye + forward, up, fov_y_deg)
}

/// Settings of a view, with the number of threads.
pub(super) fn settings(mut settings: Vec<Setting>) -> Vec<Setting> {
    settings.push(FewerThreads::setting());
    settings
}

/// Renders a view into the window's pixels.
pub(super) fn render(
    view: &mut dyn View,
    threads: &mut FewerThreads,
    request: &FrameRequest,
    pixels: &mut [[u8; 4]],
) -> Result<FrameReport, String> {
    let mut report = threads.install(&request.settings, || {
        let rendered = view.render(request)?;
        pixels.copy_from_slice(&rendered.frame.color);
        let mut report = rendered.report;
        if request.depth {
            report.depth_m = depth_in_middle(rendered.frame);
        }
        Ok::<_, String>(report)
    })??;
    let notes = report.warnings.iter().map(|text| Fact {
        name: "note",
        text: text.clone(),
    });
    report.facts.extend(notes);
    report
        .facts
        .extend([simd_fact(), axes_fact(&view.file_frame())]);
    Ok(report)
}

/// Eye depth of the sample nearest to the middle of a frame, metres; `None` without samples.
fn depth_in_middle(frame: &Frame) -> Option<f64> {
    let [width, height] = [frame.width, frame.height].map(|side| side as usize);
    let distance = |i: usize| {
        let from_middle = |at: usize, side: usize| (2 * at + 1).abs_diff(side);
        from_middle(i % width, width).pow(2) + from_middle(i / width, height).pow(2)
    };
    let depths = frame.depth_m.iter().enumerate();
    depths
        .filter(|(_, depth_m)| depth_m.is_finite() && **depth_m > 0.0)
        .min_by_key(|(i, _)| distance(*i))
        .map(|(_, depth_m)| f64::from(*depth_m))
}

/// Bounds of the eye in a view: its headbox.
pub(super) fn bounds(view: &dyn View) -> Option<EyeBounds> {
    view.headbox().map(|headbox| EyeBounds {
        centre: headbox.centre,
        half_size: DVec3::splat(headbox.half_size_m),
    })
}

impl FrameSource for ViewSource {
    fn title(&self) -> String {
        self.title.clone()
    }

    fn start_pose(&self) -> Pose {
        pose(&self.view.start(WINDOW_PX))
    }

    fn bounds(&self) -> Option<EyeBounds> {
        bounds(&*self.view)
    }

    fn navigation(&self) -> Navigation {
        self.view.navigation()
    }

    fn speed_m_per_s(&self) -> f64 {
        self.view.speed_m_per_s()
    }

    fn plan(&self) -> Option<RoomMap> {
        self.view.plan()
    }

    fn terms(&self) -> &'static [(&'static str, &'static str)] {
        &crate::terms::TERMS
    }

    fn file_frame(&self) -> FileFrame {
        self.view.file_frame()
    }

    fn settings(&self) -> Vec<Setting> {
        settings(self.view.settings())
    }

    fn render(
        &mut self,
        request: &FrameRequest,
        pixels: &mut [[u8; 4]],
    ) -> Result<FrameReport, String> {
        render(&mut *self.view, &mut self.threads, request, pixels)
    }
}
