//! Execution of commands from keys, buttons and scripts.

use crate::input::keymap::Command;
use crate::playback::automation::save_screenshot;
use crate::playback::eye_path::CameraPath;
use crate::playback::{camera_file, export};
use crate::source::HeadboxRequest;
use crate::thread::exchange::{Location, Order};
use crate::thread::session::Opening;
use crate::thread::slot::lock;
use crate::window::app::{SourceOrigin, Viewer};
use crate::window::messages::Kind;
use egui::{Context, ViewportCommand};
use headbox_core::view::{Control, EXPOSURE, SettingValue};
use std::{
    path::Path,
    sync::{Arc, Mutex},
    time::Instant,
};

impl Viewer {
    /// Executes a command.
    pub(crate) fn execute(&mut self, ctx: &Context, command: Command, now_s: f64) {
        match command {
            Command::Centre => self.centre(now_s),
            Command::ToggleKeys => self.show_keys = !self.show_keys,
            Command::TogglePanels => self.show_panels = !self.show_panels,
            Command::ToggleCompare => self.display.compare = !self.display.compare,
            Command::NextStereo => self.display.stereo = self.display.stereo.next(),
            Command::SaveFrame => self.save_frame(now_s),
            Command::SaveCamera => self.save_camera(),
            Command::Save { path, replace } => self.save(path, replace, now_s),
            Command::SaveWindow => self.save_window(ctx, now_s),
            Command::ToggleRecording => self.toggle_recording(now_s),
            Command::TogglePlayback => self.toggle_playback(now_s),
            Command::SavePath => self.save_path(now_s),
            Command::LoadPath(path) => self.load_path(&path, now_s),
            Command::ExportPath => self.export_path(now_s),
            Command::CancelExport => self.session.order(Order::CancelExport),
            Command::ShowOpen => self.show_open(now_s),
            Command::AskSystem(question) => self.ask_system(question),
            Command::Open(location) => self.open(location),
            Command::Expose(stops) => self.expose(stops, now_s),
            Command::ToggleOrbit => self.toggle_orbit(now_s),
            Command::Approach => self.approach(),
            Command::AddBookmark(name) => self.add_bookmark(&name, now_s),
            Command::RemoveBookmark(index) => self.remove_bookmark(index, now_s),
            Command::GoToBookmark(index) => self.go_to_bookmark(index, now_s),
            Command::Start => self.back_to_start(ctx),
            Command::AskSave(id) => self.save_from_source(id),
            Command::ToggleLeave => self.toggle_leave(now_s),
            Command::PlaceHeadbox => self.place_headbox(now_s),
            Command::CaptureHere => self.capture_here(now_s),
            Command::ShowHeadbox(index) => {
                self.session
                    .order(Order::Headbox(HeadboxRequest::Show(index)));
            }
            Command::FullScreen => {
                self.full_screen = !self.full_screen;
                ctx.send_viewport_cmd(ViewportCommand::Fullscreen(self.full_screen));
            }
            Command::Dismiss => {
                self.messages.clear();
                self.show_keys = false;
                self.open_list.is_open = false;
            }
        }
        // The next pass shows the change.
        ctx.request_repaint();
    }

    /// Returns true if the source captures headboxes; reports that it does not otherwise.
    fn captures_headboxes(&mut self, now_s: f64) -> bool {
        let captures = self
            .info
            .as_ref()
            .is_some_and(|info| info.headboxes.is_some());
        if !captures && self.info.is_some() {
            let text =
                "Only a scene that is captured live can be seen from outside of its headbox.";
            self.messages.add(Kind::Done, text, now_s);
        }
        captures
    }

    /// Lets the eye leave the headbox, or brings it back.
    fn toggle_leave(&mut self, now_s: f64) {
        if self.captures_headboxes(now_s) {
            self.headbox.leaves = !self.headbox.leaves;
            self.headbox.placed = self.headbox.placed.filter(|_| self.headbox.leaves);
            self.return_to_headbox(now_s);
        }
    }

    /// Puts the next headbox where the eye is and lets the eye leave to see its handles, or takes it
    /// back.
    fn place_headbox(&mut self, now_s: f64) {
        if self.captures_headboxes(now_s) {
            let eye = self.eye.pose.eye;
            self.headbox.placed = self.headbox.placed.is_none().then_some(eye);
            self.headbox.leaves |= self.headbox.placed.is_some();
        }
    }

    /// Captures the headbox that was placed, or one about the eye.
    fn capture_here(&mut self, now_s: f64) {
        if self.captures_headboxes(now_s) {
            let request = HeadboxRequest::Capture {
                centre: self.headbox.placed.unwrap_or(self.eye.pose.eye),
                half_size_m: self.headbox.half_size_m,
            };
            self.session.order(Order::Headbox(request));
        }
    }

    /// Moves the eye back to the start of the headbox if it is outside and may not leave.
    pub(crate) fn return_to_headbox(&mut self, now_s: f64) {
        let bounds = self.info.as_ref().and_then(|info| info.bounds);
        if !self.headbox.leaves && bounds.is_some_and(|b| !b.contains(self.eye.pose.eye)) {
            self.centre(now_s);
        }
    }

    fn centre(&mut self, now_s: f64) {
        if let Some(info) = &self.info {
            self.path_recorder.stop();
            self.eye.pose = info.start_pose;
            self.eye.motion.stop();
            (self.eye.orbit, self.eye.flight) = (None, None);
            self.eye.moved_s = now_s;
        }
    }

    /// Closes the source and shows the start page.
    fn back_to_start(&mut self, ctx: &Context) {
        if !self.start_page.has_library {
            return;
        }
        self.keep_thumbnail();
        (self.origin, self.being_opened) = Default::default();
        (self.info, self.opening, self.view_request, self.exporting) = (None, None, None, None);
        self.path_recorder.stop();
        if let Some(old) = self.shown.take() {
            self.session.recycle(old.pictures);
        }
        self.opening_orders += 1;
        self.session.order(Order::Close);
        ctx.send_viewport_cmd(ViewportCommand::Title("headbox".into()));
    }

    /// Shows that the file or scene `name` is being opened.
    pub(crate) fn set_opening(&mut self, name: String) {
        self.opening = Some(Opening {
            name,
            since: Instant::now(),
        });
    }

    fn open(&mut self, location: Location) {
        let (name, origin) = match &location {
            Location::Entry(id) => {
                let name = Some(id.clone());
                (id.clone(), SourceOrigin { file: None, name })
            }
            Location::File(path) => {
                let absolute = std::path::absolute(path);
                let absolute = absolute.and_then(|path| path.canonicalize()).ok();
                let origin = SourceOrigin {
                    file: Some(path.clone()),
                    name: absolute.map(|path| path.display().to_string()),
                };
                (path.display().to_string(), origin)
            }
        };
        self.set_opening(name);
        self.being_opened = origin;
        self.opening_orders += 1;
        self.session.order(Order::Open(location));
    }

    /// Changes the exposure of the settings that the panel edits.
    fn expose(&mut self, stops: f64, now_s: f64) {
        let compare = self.display.compare;
        let exposure = self.info.as_ref().and_then(|info| {
            let mut settings = info.settings.iter();
            let setting = settings.find(|setting| setting.id == EXPOSURE)?;
            let value = self.sets.edited(compare).get_mut(EXPOSURE)?;
            match (&setting.control, value) {
                (Control::Number { range, .. }, SettingValue::Number(value)) => {
                    *value = (*value + stops).clamp(*range.start(), *range.end());
                    Some(*value)
                }
                _ => None,
            }
        });
        if self.info.is_some() && exposure.is_none() {
            let text = "The exposure of this view cannot be changed.";
            self.messages.add(Kind::Done, text, now_s);
        }
    }

    fn show_open(&mut self, now_s: f64) {
        if self.start_page.has_library {
            self.open_list.toggle();
        } else {
            self.messages.add(
                Kind::Done,
                "This window shows one view only and opens no other.",
                now_s,
            );
        }
    }

    fn save_window(&mut self, ctx: &Context, now_s: f64) {
        // The dialog would be in the picture, so this does not ask.
        let dir = &self.options.output_dir;
        let path = match export::claim_free_name(dir, "window", "png") {
            Ok(path) => path,
            Err(error) => {
                let text = format!("{} cannot be written to: {error}.", dir.display());
                return self.messages.add(Kind::Error, text, now_s);
            }
        };
        let result = Arc::new(Mutex::new(None));
        save_screenshot(ctx, path.clone(), Arc::clone(&result));
        self.pending_shots.push((path, result));
    }

    /// Reports screenshots that have been written since the last pass.
    pub(crate) fn collect_shots(&mut self, now_s: f64) {
        let messages = &mut self.messages;
        self.pending_shots.retain(|(path, result)| {
            let result = lock(result).take();
            match &result {
                Some(Ok(())) => {
                    messages.add(Kind::Done, format!("Saved {}.", path.display()), now_s);
                }
                Some(Err(error)) => messages.add(Kind::Error, error, now_s),
                None => {}
            }
            result.is_none()
        });
    }

    fn toggle_recording(&mut self, now_s: f64) {
        if self.path_recorder.recorded().is_some() {
            let kept = self.path_recorder.stop_recording();
            let poses = self
                .path_recorder
                .path
                .as_ref()
                .map_or(0, |path| path.poses().len());
            let text = if kept {
                format!("Recorded {poses} poses.")
            } else {
                "Nothing was recorded.".into()
            };
            self.messages.add(Kind::Done, text, now_s);
        } else {
            self.path_recorder.record();
        }
    }

    fn toggle_playback(&mut self, now_s: f64) {
        if self.path_recorder.is_playing() {
            self.path_recorder.stop();
        } else if self.path_recorder.play(now_s) {
            self.replay_ended = false;
            self.eye.motion.stop();
        } else {
            self.messages.add(
                Kind::Done,
                "There is no path to replay: record one (R) or load one.",
                now_s,
            );
        }
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
                self.path_recorder.stop();
                self.messages.add(Kind::Done, text, now_s);
                self.set_path(path, now_s);
            }
            Err(error) => self.messages.add(Kind::Error, error.to_string(), now_s),
        }
    }

    /// Sets the path to replay. Poses outside of the headbox are kept, with a message if there is
    /// no preview: a script may show the holes there on purpose.
    pub(crate) fn set_path(&mut self, path: CameraPath, now_s: f64) {
        let info = self.info.as_ref().filter(|info| info.headboxes.is_none());
        if let Some(bounds) = info.and_then(|info| info.bounds) {
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
        self.path_recorder.path = Some(path);
    }
}
