//! A window run by a script: when it ends, its picture, and what it measured.

use crate::playback::export;
use crate::window::options::{Exit, Summary};
use egui::{Context, ViewportCommand};
use std::{
    path::PathBuf,
    sync::{Arc, Mutex, PoisonError},
};

/// Outcome of a run of the window; shared with [`run`](crate::run), which outlives the window.
#[derive(Clone, Debug, Default)]
pub(crate) struct Outcome {
    pub summary: Summary,
    pub error: Option<String>,
}

/// The script's end of the window.
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
    /// The replay has ended, and its last frame is on the screen in full.
    pub path_done: bool,
    /// The newest view is on the screen, and cannot become better.
    pub refined: bool,
    /// Every entry of the start page has its picture.
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

    /// Returns true if frames must be rendered although nothing changes.
    pub(crate) fn wants_frames(&self) -> bool {
        matches!(self.exit, Exit::AfterFrames(_)) && self.stage == Stage::Running
    }

    /// Returns true if the window is about to close.
    pub(crate) fn is_closing(&self) -> bool {
        self.stage == Stage::Closing
    }

    /// One pass; returns the error that ends the run, if any.
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
                    Some(path) => shoot(ctx, path, Arc::clone(&self.taken)),
                    None => self.close(ctx),
                }
            }
            return None;
        }
        let taken = self
            .taken
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .take();
        match taken {
            Some(result) => {
                self.close(ctx);
                result.err()
            }
            None => {
                ctx.request_repaint();
                None
            }
        }
    }

    fn close(&mut self, ctx: &Context) {
        self.stage = Stage::Closing;
        ctx.send_viewport_cmd(ViewportCommand::Close);
    }
}

/// Asks for a picture of the whole window and writes it as PNG; the result goes to `taken`.
pub(crate) fn shoot(ctx: &Context, path: PathBuf, taken: Arc<Mutex<Option<Result<(), String>>>>) {
    let repaint = ctx.clone();
    ctx.request_screenshot(move |image| {
        let written = export::write_png(&path, image.width(), bytemuck::cast_slice(&image.pixels));
        let result = written.map_err(|e| format!("{} cannot be written: {e}", path.display()));
        *taken.lock().unwrap_or_else(PoisonError::into_inner) = Some(result);
        repaint.request_repaint();
    });
}
