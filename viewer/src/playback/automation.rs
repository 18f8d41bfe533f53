//! Scripted run of the window: its end, its screenshot and its outcome.

use crate::playback::export;
use crate::thread::slot::lock;
use crate::window::options::{Exit, Summary};
use egui::{Context, ViewportCommand};
use std::{
    path::PathBuf,
    sync::{Arc, Mutex},
};

/// Outcome of a run of the window; shared with [`run`](crate::run), which outlives the window.
#[derive(Clone, Debug, Default)]
pub(crate) struct Outcome {
    pub summary: Summary,
    pub error: Option<String>,
}

/// State of a scripted run.
pub(crate) struct Automation {
    exit: Exit,
    screenshot: Option<PathBuf>,
    stage: Stage,
    /// Result of the screenshot, written by the painter's callback.
    taken: Arc<Mutex<Option<Result<(), String>>>>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Running,
    Shooting,
    Closing,
}

/// State that the script tests after each pass.
pub(crate) struct Progress<'a> {
    pub frames_shown: u64,
    /// True if the replay has ended and its last frame is on the screen at full resolution.
    pub path_done: bool,
    /// True if the newest view is on the screen and cannot improve.
    pub refined: bool,
    /// True if every entry of the start page has its thumbnail.
    pub thumbnails_done: bool,
    /// Error message shown to the user.
    pub error: Option<&'a str>,
}

impl Automation {
    pub(crate) fn new(exit: Exit, screenshot: Option<PathBuf>) -> Self {
        Self {
            exit,
            screenshot,
            stage: Stage::Running,
            taken: Arc::default(),
        }
    }

    /// Returns true if frames must be rendered even if nothing changes.
    pub(crate) fn wants_frames(&self) -> bool {
        matches!(self.exit, Exit::AfterFrames(_)) && self.stage == Stage::Running
    }

    /// Returns true if the window is about to close.
    pub(crate) fn is_closing(&self) -> bool {
        self.stage == Stage::Closing
    }

    /// Runs one pass of the script; returns the error that ends the run, if any.
    pub(crate) fn step(&mut self, ctx: &Context, progress: &Progress<'_>) -> Option<String> {
        if self.exit == Exit::Never || self.is_closing() {
            return None;
        }
        if let Some(error) = progress.error {
            self.close(ctx);
            return Some(error.to_owned());
        }
        if self.stage == Stage::Running {
            let done = match self.exit {
                Exit::Never => false,
                Exit::AfterFrames(count) => progress.frames_shown >= count,
                Exit::AfterPath => progress.path_done,
                Exit::WhenRefined => progress.refined,
                Exit::AfterThumbnails => progress.thumbnails_done,
            };
            if done {
                self.stage = Stage::Shooting;
                match self.screenshot.take() {
                    Some(path) => save_screenshot(ctx, path, Arc::clone(&self.taken)),
                    None => self.close(ctx),
                }
            }
            return None;
        }
        let taken = lock(&self.taken).take();
        if let Some(result) = taken {
            self.close(ctx);
            return result.err();
        }
        ctx.request_repaint();
        None
    }

    fn close(&mut self, ctx: &Context) {
        self.stage = Stage::Closing;
        ctx.send_viewport_cmd(ViewportCommand::Close);
    }
}

/// Takes a screenshot of the whole window and writes it as PNG; the result goes to `taken`.
pub(crate) fn save_screenshot(
    ctx: &Context,
    path: PathBuf,
    taken: Arc<Mutex<Option<Result<(), String>>>>,
) {
    let repaint = ctx.clone();
    ctx.request_screenshot(move |image| {
        let written = export::write_png(&path, image.width(), bytemuck::cast_slice(&image.pixels));
        let result = written.map_err(|e| format!("{} cannot be written: {e}", path.display()));
        *lock(&taken) = Some(result);
        repaint.request_repaint();
    });
}
