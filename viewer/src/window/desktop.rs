//! The window on the desktop.

use crate::panels::theme;
use crate::playback::automation::Outcome;
use crate::playback::thumbnails::ThumbnailCache;
use crate::source::FrameSource;
use crate::thread::session::Session;
use crate::thread::slot::lock;
use crate::window::app::Viewer;
use crate::window::options::{Exit, Summary, ViewerError, ViewerOptions};
use eframe::{App, CreationContext, Frame, NativeOptions, Renderer};
use egui::Context;
use std::{
    sync::{Arc, Mutex},
    time::Duration,
};

/// Opens the window, shows `source` (or the start page of the options' library) and returns when
/// the window has been closed. Window systems require the main thread.
///
/// # Errors
/// [`ViewerError::NoDisplay`] without a display; [`ViewerError::Scripted`] if anything goes wrong
/// in a run that ends by itself ([`Exit`]); see [`ViewerError`] for the others.
pub fn run(
    source: Option<Box<dyn FrameSource>>,
    options: ViewerOptions,
) -> Result<Summary, ViewerError> {
    if source.is_none() && options.coming.is_none() && options.library.is_none() {
        return Err(ViewerError::NothingToShow);
    }
    if options.exit == Exit::AfterPath && options.path.is_none() {
        return Err(ViewerError::NoPath);
    }
    let outcome = Arc::new(Mutex::new(Outcome::default()));
    let shared = Arc::clone(&outcome);
    let size = options.window_size_points;
    let creator = move |cc: &CreationContext<'_>| create(&cc.egui_ctx, source, options, shared);
    let viewport = egui::ViewportBuilder::default()
        .with_title("headbox")
        .with_app_id("headbox")
        .with_inner_size(size);
    let native = NativeOptions {
        viewport,
        renderer: Renderer::Glow,
        dithering: false,
        ..NativeOptions::default()
    };
    let closed = eframe::run_native("headbox", native, Box::new(creator));
    let outcome = lock(&outcome).clone();
    match (closed, outcome.error) {
        (Err(eframe::Error::AppCreation(error)), _) => match error.downcast::<std::io::Error>() {
            Ok(error) => Err(ViewerError::Thread(*error)),
            Err(error) => Err(ViewerError::Window(error.to_string())),
        },
        (Err(eframe::Error::WinitEventLoop(_)), _) => {
            Err(ViewerError::NoDisplay(describe_displays()))
        }
        // The template in this error is for programmers.
        (Err(eframe::Error::NoGlutinConfigs(_, error)), _) => {
            Err(ViewerError::NoOpenGl(error.to_string()))
        }
        (Err(error @ (eframe::Error::Glutin(_) | eframe::Error::OpenGL(_))), _) => {
            Err(ViewerError::NoOpenGl(error.to_string()))
        }
        (Err(error), _) => Err(ViewerError::Window(error.to_string())),
        (Ok(()), Some(error)) => Err(ViewerError::Scripted(error)),
        (Ok(()), None) => Ok(outcome.summary),
    }
}

/// Describes the displays that the environment names.
fn describe_displays() -> String {
    let name = |key: &str| {
        std::env::var(key)
            .ok()
            .filter(|value| !value.is_empty())
            .map(|value| format!("{key}={value}"))
    };
    let named: Vec<_> = ["WAYLAND_DISPLAY", "DISPLAY"]
        .into_iter()
        .filter_map(name)
        .collect();
    if named.is_empty() {
        "neither WAYLAND_DISPLAY nor DISPLAY is set".into()
    } else {
        named.join(", ") + " does not answer"
    }
}

/// Repaint delay that triggers exactly one pass after an event. egui runs two passes for a delay of
/// zero ("to give things time to settle"), the second of which would draw the same again.
const ONE_PASS: Duration = Duration::from_nanos(1);

type Created = Result<Box<dyn App>, Box<dyn std::error::Error + Send + Sync>>;

fn create(
    ctx: &Context,
    source: Option<Box<dyn FrameSource>>,
    mut options: ViewerOptions,
    outcome: Arc<Mutex<Outcome>>,
) -> Created {
    theme::install(ctx);
    let waker = ctx.clone();
    let can_open = options.library.is_some();
    let opening = options.coming.as_ref().map(|coming| coming.name.clone());
    let session = Session::start(
        source,
        options.coming.take(),
        options.library.take(),
        ThumbnailCache::new(options.thumbnail_dir.clone()),
        Arc::new(move || waker.request_repaint_after(ONE_PASS)),
    )?;
    let mut viewer = Viewer::new(session, options, can_open, outcome);
    if let Some(name) = opening {
        viewer.set_opening(name);
    }
    Ok(Box::new(Desktop(viewer)))
}

struct Desktop(Viewer);

impl App for Desktop {
    fn ui(&mut self, ui: &mut egui::Ui, frame: &mut Frame) {
        let last_pass_ms = frame
            .info()
            .cpu_usage
            .map(|seconds| f64::from(seconds) * 1e3);
        self.0.pass(ui, last_pass_ms);
    }

    /// Background colour around the frame. The driver clears to it anyway, so no panel is painted
    /// behind the frame.
    fn clear_color(&self, _visuals: &egui::Visuals) -> [f32; 4] {
        theme::BACKDROP.to_normalized_gamma_f32()
    }

    fn on_exit(&mut self, _gl: Option<&eframe::glow::Context>) {
        self.0.write_summary();
        self.0.keep_thumbnail();
    }
}
