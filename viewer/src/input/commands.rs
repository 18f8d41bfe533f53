//! Execution of commands from keys, buttons and scripts.

use crate::input::keymap::Command;
use crate::playback::eye_path::CameraPath;
use crate::playback::{camera_file, export};
use crate::thread::exchange::{ExportOrder, Location, Order};
use crate::thread::session::Opening;
use crate::window::app::Viewer;
use crate::window::messages::Kind;
use egui::{Context, ViewportCommand};
use std::{
    path::Path,
    sync::{Arc, Mutex},
};

impl Viewer {
    /// Does what was asked.
    pub(crate) fn execute(&mut self, ctx: &Context, command: Command, now_s: f64) {
        match command {
            Command::Centre => self.centre(now_s),
            Command::ToggleKeys => self.show_keys = !self.show_keys,
            Command::TogglePanels => self.show_panels = !self.show_panels,
            Command::ToggleCompare => self.display.compare = !self.display.compare,
            Command::NextStereo => self.display.stereo = self.display.stereo.next(),
            Command::SaveFrame => self.save_frame(now_s),
            Command::SaveCamera => self.save_camera(),
            Command::SaveWindow => self.save_window(ctx),
            Command::ToggleRecording => self.toggle_recording(now_s),
            Command::TogglePlayback => self.toggle_playback(now_s),
            Command::SavePath => self.save_path(now_s),
            Command::LoadPath(path) => self.load_path(&path, now_s),
            Command::ExportPath => self.export_path(now_s),
            Command::CancelExport => self.session.order(Order::CancelExport),
            Command::ShowOpen => self.show_open(now_s),
            Command::Open(location) => self.open(location),
            Command::Start => self.back_to_start(ctx),
            Command::Act(action) => self.session.order(Order::Act(action)),
            Command::FullScreen => {
                self.full_screen = !self.full_screen;
                ctx.send_viewport_cmd(ViewportCommand::Fullscreen(self.full_screen));
            }
            Command::Dismiss => {
                self.messages.clear();
                self.show_keys = false;
                self.open_list.close();
            }
        }
        // What a command changed shows in the next pass.
        ctx.request_repaint();
    }

    fn centre(&mut self, now_s: f64) {
        if let Some(info) = &self.info {
            self.tape.stop();
            self.eye.pose = info.start_pose;
            self.eye.motion.stop();
            self.eye.moved_s = now_s;
        }
    }

    /// Lets go of the view and shows what can be opened.
    fn back_to_start(&mut self, ctx: &Context) {
        if !self.start_page.has_library() {
            return;
        }
        (self.info, self.opening, self.wish, self.exporting) = (None, None, None, None);
        self.tape.stop();
        if let Some(old) = self.shown.take() {
            self.session.recycle(old.pictures);
        }
        self.session.order(Order::Close);
        ctx.send_viewport_cmd(ViewportCommand::Title("headbox".into()));
    }

    /// Shows that something is being opened.
    pub(crate) fn await_opening(&mut self, what: String) {
        self.opening = Some(Opening::begin(what));
    }

    fn open(&mut self, location: Location) {
        self.await_opening(match &location {
            Location::Entry(id) => id.clone(),
            Location::File(path) => path.display().to_string(),
        });
        self.opening_file = match &location {
            Location::Entry(_) => None,
            Location::File(path) => Some(path.clone()),
        };
        self.session.order(Order::Open(location));
    }

    fn show_open(&mut self, now_s: f64) {
        if self.start_page.has_library() {
            self.open_list.toggle();
        } else {
            self.messages.add(
                Kind::Done,
                "This window shows one view only and opens no other.",
                now_s,
            );
        }
    }

    fn save_frame(&mut self, now_s: f64) {
        let Some(frame) = self.frame_on_screen() else {
            return self
                .messages
                .add(Kind::Error, "There is no frame to save yet.", now_s);
        };
        let dir = self.options.output_dir.clone();
        self.session.in_background(move || {
            let (width, pixels) = frame();
            let path = export::free_name(&dir, "frame", "png");
            told(&path, export::write_png(&path, width, &pixels))
        });
    }

    fn save_camera(&mut self) {
        let (Some(info), Some(wish)) = (&self.info, &self.wish) else {
            return;
        };
        let mut record = camera_file::record(&self.eye.pose, &info.file_frame);
        record.size = Some(wish.size_px);
        let dir = self.options.output_dir.clone();
        self.session.in_background(move || {
            let path = export::free_name(&dir, "camera", "json");
            told(&path, export::write_json(&path, &record))
        });
    }

    fn save_window(&mut self, ctx: &Context) {
        let path = export::free_name(&self.options.output_dir, "window", "png");
        let taken = Arc::new(Mutex::new(None));
        crate::playback::automation::shoot(ctx, path.clone(), Arc::clone(&taken));
        self.pending_shots.push((path, taken));
    }

    /// Tells the outcome of window pictures that have been written meanwhile.
    pub(crate) fn collect_shots(&mut self, now_s: f64) {
        let messages = &mut self.messages;
        self.pending_shots.retain(|(path, taken)| {
            let taken = taken
                .lock()
                .unwrap_or_else(std::sync::PoisonError::into_inner)
                .take();
            match &taken {
                Some(Ok(())) => {
                    messages.add(Kind::Done, format!("Saved {}.", path.display()), now_s);
                }
                Some(Err(error)) => messages.add(Kind::Error, error, now_s),
                None => {}
            }
            taken.is_none()
        });
    }

    fn toggle_recording(&mut self, now_s: f64) {
        if self.tape.recorded().is_some() {
            let kept = self.tape.stop_recording();
            let poses = self.tape.path.as_ref().map_or(0, |path| path.poses().len());
            let text = if kept {
                format!("Recorded {poses} poses.")
            } else {
                "Nothing was recorded.".into()
            };
            self.messages.add(Kind::Done, text, now_s);
        } else {
            self.tape.record();
        }
    }

    fn toggle_playback(&mut self, now_s: f64) {
        if self.tape.is_playing() {
            self.tape.stop();
        } else if self.tape.play(now_s) {
            self.path_ended = false;
            self.eye.motion.stop();
        } else {
            self.messages.add(
                Kind::Done,
                "There is no path to replay: record one (R) or load one.",
                now_s,
            );
        }
    }

    fn save_path(&mut self, now_s: f64) {
        let (Some(info), Some(path), Some(wish)) = (&self.info, &self.tape.path, &self.wish) else {
            return self.messages.add(
                Kind::Done,
                "There is no path to save: record one (R).",
                now_s,
            );
        };
        let record = camera_file::path_record(path, wish.size_px, &info.file_frame);
        let dir = self.options.output_dir.clone();
        self.session.in_background(move || {
            let path = export::free_name(&dir, "path", "json");
            told(&path, export::write_json(&path, &record))
        });
    }

    fn load_path(&mut self, file: &Path, now_s: f64) {
        let Some(info) = &self.info else { return };
        match camera_file::read_path(file, &info.file_frame, info.start_pose.up) {
            Ok(path) => {
                let text = format!(
                    "{} poses, {:.1} s, from {}.",
                    path.poses().len(),
                    path.duration_s(),
                    file.display()
                );
                self.tape.stop();
                self.messages.add(Kind::Done, text, now_s);
                self.take_path(path, now_s);
            }
            Err(error) => self.messages.add(Kind::Error, error.to_string(), now_s),
        }
    }

    /// Takes a path over as it is, also where it leaves the headbox: a script may want to see what
    /// is there.
    pub(crate) fn take_path(&mut self, path: CameraPath, now_s: f64) {
        if let Some(bounds) = self.info.as_ref().and_then(|info| info.bounds) {
            let outside = path
                .poses()
                .iter()
                .filter(|timed| !bounds.contains(timed.pose.eye))
                .count();
            if outside > 0 {
                let text = format!(
                    "{outside} poses of the path are outside of the headbox: holes are to be expected."
                );
                self.messages.add(Kind::Done, text, now_s);
            }
        }
        self.tape.path = Some(path);
    }

    fn export_path(&mut self, now_s: f64) {
        let (Some(path), Some(wish)) = (&self.tape.path, &self.wish) else {
            return self.messages.add(
                Kind::Done,
                "There is no path to render: record one (R) or load one.",
                now_s,
            );
        };
        let dir = export::free_name(&self.options.output_dir, "path", "frames");
        let (path, size, settings) = (path.clone(), wish.size_px, Arc::clone(&self.sets.a));
        self.exporting = Some([0, path.poses().len()]);
        self.session.order(Order::Export(ExportOrder {
            path,
            size,
            settings,
            dir,
        }));
    }
}

/// The message about a file that was written, or not.
fn told(path: &Path, result: std::io::Result<()>) -> Result<String, String> {
    let path = path.display();
    result
        .map(|()| format!("Saved {path}."))
        .map_err(|e| format!("{path} cannot be written: {e}."))
}
