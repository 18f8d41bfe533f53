//! Events of the render thread: sources that were opened, finished frames.

use crate::input::keymap::Command;
use crate::input::steering::SettingSets;
use crate::panels::side::headbox::HeadboxPanel;
use crate::playback::bookmarks::Bookmarks;
use crate::playback::path_recorder::PathRecorder;
use crate::playback::{camera_file, thumbnails};
use crate::thread::exchange::{Event, FinishedFrame, SourceInfo};
use crate::thread::history::{FrameTimes, add_stages};
use crate::window::app::{SourceOrigin, Viewer};
use crate::window::messages::{Kind, Messages};
use egui::{Context, ViewportCommand};
use headbox_core::view::SettingValues;
use std::sync::Arc;
use std::time::Instant;

impl Viewer {
    /// Handles an event of the render thread.
    pub(super) fn handle_event(&mut self, ctx: &Context, event: Event, now_s: f64) {
        match event {
            // Obsolete: the user has chosen something else meanwhile.
            Event::Opened { orders, .. } | Event::OpenFailed { orders, .. }
                if orders != self.opening_orders => {}
            Event::Opened { info, .. } => self.handle_opened(ctx, *info, now_s),
            Event::HeadboxChanged(info) => self.handle_headbox(*info, now_s),
            Event::OpenFailed { error, .. } => {
                self.opening = None;
                self.being_opened = SourceOrigin::default();
                self.messages.add(Kind::Error, error, now_s);
            }
            Event::Probed { probe, point } => self.handle_probed(&probe, point, now_s),
            Event::Lost(error) => {
                (self.info, self.exporting) = (None, None);
                self.origin = SourceOrigin::default();
                self.messages.add(Kind::Error, error, now_s);
            }
            Event::Error(error) => self.messages.add(Kind::Error, error, now_s),
            Event::Done(text) => self.messages.add(Kind::Done, text, now_s),
            Event::Library {
                entries,
                extensions,
            } => {
                self.start_page.set_entries(entries);
                self.open_list.extensions = extensions;
            }
            Event::Thumbnail { id, thumbnail } => {
                self.start_page.set_thumbnail(ctx, &id, &thumbnail);
            }
            Event::Chosen {
                question,
                path,
                is_shown,
            } => self.handle_chosen(question, path, is_shown, now_s),
            Event::Exported(progress) => self.exporting = progress,
        }
    }

    fn handle_opened(&mut self, ctx: &Context, info: SourceInfo, now_s: f64) {
        self.keep_thumbnail();
        ctx.send_viewport_cmd(ViewportCommand::Title(format!("{} - headbox", info.title)));
        let mut values = SettingValues::initial(&info.settings);
        let set =
            |values: &mut SettingValues, texts: Vec<(String, String)>, messages: &mut Messages| {
                for (id, text) in texts {
                    if let Err(error) = values.set_text(&info.settings, &id, &text) {
                        messages.add(Kind::Error, error, now_s);
                    }
                }
            };
        set(
            &mut values,
            std::mem::take(&mut self.options.settings),
            &mut self.messages,
        );
        let a = Arc::new(values);
        let b = self.options.compare.take().map(|texts| {
            let mut values = (*a).clone();
            set(&mut values, texts, &mut self.messages);
            Arc::new(values)
        });
        self.display.compare = b.is_some();
        self.sets = SettingSets {
            b: b.unwrap_or_else(|| Arc::clone(&a)),
            a,
            edits_b: false,
        };
        self.eye.pose = self.options.pose.take().unwrap_or(info.start_pose);
        self.eye.motion.stop();
        (self.eye.orbit, self.eye.flight) = (None, None);
        self.eye.speed_m_per_s = info.speed_m_per_s;
        self.headbox = HeadboxPanel::new(&info);
        self.path_recorder = PathRecorder::new(self.path_recorder.mode);
        (self.opening, self.view_request, self.exporting) = (None, None, None);
        self.origin = std::mem::take(&mut self.being_opened);
        if let Some(file) = &self.origin.file {
            self.recent.add(file);
        }
        self.read_bookmarks(now_s);
        if let Some(old) = self.shown.take() {
            self.session.recycle(old.pictures);
        }
        self.policy.reset();
        self.history.clear();
        self.open_list.is_open = false;
        for note in &info.notes {
            self.messages.add(Kind::Done, note, now_s);
        }
        self.info = Some(info);
        self.replay_given_path(now_s);
    }

    /// Shows another headbox of the same source.
    fn handle_headbox(&mut self, info: SourceInfo, now_s: f64) {
        self.headbox = HeadboxPanel::new(&info);
        self.eye.speed_m_per_s = info.speed_m_per_s;
        self.info = Some(info);
        self.view_request = None;
        self.return_to_headbox(now_s);
    }

    /// Replays the path that the window was started with.
    fn replay_given_path(&mut self, now_s: f64) {
        let (Some(file), Some(info)) = (self.options.path.take(), &self.info) else {
            return;
        };
        match camera_file::read_path(&file, &info.file_frame, info.start_pose.up) {
            Ok(path) => {
                self.set_path(path, now_s);
                self.commands.push(Command::TogglePlayback);
            }
            Err(error) => self.messages.add(Kind::Error, error.to_string(), now_s),
        }
    }

    fn read_bookmarks(&mut self, now_s: f64) {
        let (bookmarks, read) = match &self.origin.name {
            Some(name) => Bookmarks::read(self.options.bookmark_dir.as_ref(), name),
            None => (Bookmarks::default(), Ok(())),
        };
        self.bookmarks = bookmarks;
        if let Err(error) = read {
            self.messages.add(Kind::Error, error, now_s);
        }
    }

    /// Keeps the last frame as the thumbnail of its file, unless it is coarse or in false colours.
    pub(crate) fn keep_thumbnail(&mut self) {
        let (Some(file), Some(shown)) = (&self.origin.file, &self.shown) else {
            return;
        };
        let picture = &shown.pictures[0];
        if shown.job.scale < 1.0 || !picture.report.legend.is_empty() {
            return;
        }
        let pixels = bytemuck::cast_slice(&picture.image.pixels);
        if let Some(thumbnail) = thumbnails::of_frame(picture.image.width(), pixels) {
            self.recent.keep_thumbnail(file, &thumbnail);
        }
    }

    /// Uploads the pictures of a finished frame as textures, and adds its times to the history.
    pub(super) fn upload_frame(&mut self, ctx: &Context, finished: FinishedFrame, now_s: f64) {
        let Some(info) = self
            .info
            .as_ref()
            .filter(|info| info.id == finished.job.source_id)
        else {
            return;
        };
        // Nearest at full resolution; linear where fewer pixels are stretched over the window.
        let exact = finished.job.scale == 1.0;
        let filter = if exact {
            egui::TextureOptions::NEAREST
        } else {
            egui::TextureOptions::LINEAR
        };
        for (i, picture) in finished.pictures.iter().enumerate() {
            match self.textures.get_mut(i) {
                // A texture of the same size is overwritten, which is faster than a new one.
                Some(texture) if texture.size() == picture.image.size => {
                    texture.set_partial([0, 0], Arc::clone(&picture.image), filter);
                }
                Some(texture) => texture.set(Arc::clone(&picture.image), filter),
                None => {
                    let name = format!("{} {i}", info.title);
                    self.textures
                        .push(ctx.load_texture(name, Arc::clone(&picture.image), filter));
                }
            }
        }
        let mut stages = Vec::new();
        finished
            .pictures
            .iter()
            .for_each(|p| add_stages(&mut stages, &p.report.stages));
        if finished.job.moving {
            self.policy.observe(
                finished.job.scale,
                finished.render_ms,
                self.display.target_ms,
            );
        }
        if finished.job.round == 0 {
            self.history.push(FrameTimes {
                shown_s: now_s,
                render_ms: finished.render_ms,
                latency_ms: finished.job.issued.elapsed().as_secs_f64() * 1e3,
                stages,
            });
        }
        if let Some(index) = finished.job.replayed {
            self.path_recorder.advance_after(index);
        }
        self.run_times.scales += finished.job.scale;
        self.count_frame(ctx);
        if let Some(old) = self.shown.replace(finished) {
            self.session.recycle(old.pictures);
        }
    }

    fn count_frame(&mut self, ctx: &Context) {
        self.run_times.frames_shown += 1;
        self.run_times.last = Some(Instant::now());
        if self.run_times.first.is_none() {
            self.run_times.first = self.run_times.last;
            // The next pass notes the time of the first image: only then is it on the screen.
            ctx.request_repaint();
        }
    }
}
