//! Any [`View`] as a frame source.

use crate::facts::{axes_fact, simd_fact};
use crate::threads::FewerThreads;
use glam::DVec3;
use headbox_core::file_frame::FileFrame;
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

/// Settings of a view, with the number of threads inserted before the folded groups.
pub(super) fn settings(mut settings: Vec<Setting>) -> Vec<Setting> {
    let at = settings
        .iter()
        .position(|setting| setting.folded)
        .unwrap_or(settings.len());
    settings.insert(at, FewerThreads::setting());
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
        Ok::<_, String>(rendered.report)
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
