//! State of the window, and one pass of it: events, keys, panels, the frame.

use crate::input::keymap::{self, Command};
use crate::input::motion::Motion;
use crate::input::pose::Pose;
use crate::input::steering::{Eye, SettingSets};
use crate::panels;
use crate::panels::dialogs::open::OpenList;
use crate::panels::dialogs::save::SaveDialog;
use crate::panels::side::display::Display;
use crate::panels::side::headbox::HeadboxPanel;
use crate::panels::start::StartPage;
use crate::playback::automation::{Automation, Outcome, Progress};
use crate::playback::bookmarks::Bookmarks;
use crate::playback::path_recorder::PathRecorder;
use crate::playback::recent::RecentFiles;
use crate::playback::thumbnails::ThumbnailCache;
use crate::thread::exchange::{FinishedFrame, Location, SourceInfo};
use crate::thread::history::History;
use crate::thread::resolution::ResolutionPolicy;
use crate::thread::session::{Opening, Session};
use crate::thread::slot::lock;
use crate::window::messages::{Kind, Messages};
use crate::window::options::ViewerOptions;
use crate::window::views::Stereo;
use egui::{CentralPanel, Context, Frame, TextureHandle, Ui};
use headbox_core::statistics::median;
use headbox_core::view::{Refinement, SettingValues};
use std::{
    path::PathBuf,
    sync::{Arc, Mutex},
    time::{Duration, Instant},
};

/// State of the window.
pub(crate) struct Viewer {
    pub session: Session,
    pub options: ViewerOptions,
    /// Description of the source; `None` for the start page.
    pub info: Option<SourceInfo>,
    /// Source being opened.
    pub opening: Option<Opening>,
    /// Recently opened files, newest first.
    pub recent: RecentFiles,
    /// Source being opened; its file becomes a recent file once it is open.
    pub being_opened: SourceOrigin,
    /// Origin of the source that is shown.
    pub origin: SourceOrigin,
    /// Number of orders to open or close a source.
    pub opening_orders: u64,
    pub bookmarks: Bookmarks,
    pub eye: Eye,
    pub display: Display,
    pub sets: SettingSets,
    /// Place of the pointer in the frame, as shares of width and height; `None` outside.
    pub pointed: Option<[f64; 2]>,
    pub path_recorder: PathRecorder,
    /// True after a replay has run to its end.
    pub replay_ended: bool,
    /// Number of frames written and total number, of a running export.
    pub exporting: Option<[usize; 2]>,
    pub messages: Messages,
    pub history: History,
    pub shown: Option<FinishedFrame>,
    pub textures: Vec<TextureHandle>,
    pub policy: ResolutionPolicy,
    pub view_request: Option<ViewRequest>,
    pub jobs_issued: u64,
    pub headbox: HeadboxPanel,
    pub show_panels: bool,
    /// True if the panel is open over the frame, in a window too narrow for both.
    pub panel_unfolded: bool,
    pub show_keys: bool,
    pub full_screen: bool,
    pub open_list: OpenList,
    pub save_dialog: SaveDialog,
    pub start_page: StartPage,
    /// Commands of panels and keys in this pass.
    pub commands: Vec<Command>,
    /// Screenshots of the window that are being written.
    pub pending_shots: Vec<PendingShot>,
    pub automation: Automation,
    pub outcome: Arc<Mutex<Outcome>>,
    pub run_times: RunTimes,
}

/// Origin of a source: its file, and its name for bookmarks. Empty if it has none.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct SourceOrigin {
    pub file: Option<PathBuf>,
    pub name: Option<String>,
}

/// A screenshot's file and the result of writing it, `None` until it is written.
pub(crate) type PendingShot = (PathBuf, Arc<Mutex<Option<Result<(), String>>>>);

/// Parameters of the view that was requested last.
#[derive(Clone, PartialEq)]
pub(crate) struct ViewRequest {
    pub pose: Pose,
    pub size_px: [u32; 2],
    pub scale: f64,
    pub moving: bool,
    pub stereo: Stereo,
    pub separation: f64,
    pub sets: Vec<Arc<SettingValues>>,
}

/// Frame counts and times of the run, for the summary.
#[derive(Default)]
pub(crate) struct RunTimes {
    /// True after the first pass.
    passed: bool,
    pub frames_shown: u64,
    pub first: Option<Instant>,
    pub last: Option<Instant>,
    pass_ms: Vec<f64>,
    /// Sum of the scales of the frames shown.
    pub scales: f64,
}

/// Number of passes in the median of the window's own time.
const MAX_PASS_TIMES: usize = 256;

impl Viewer {
    pub(crate) fn new(
        session: Session,
        options: ViewerOptions,
        can_open: bool,
        outcome: Arc<Mutex<Outcome>>,
    ) -> Self {
        let display = Display::new(options.stereo, options.moving_limit_ms);
        let pose = Pose::looking_at(glam::DVec3::ZERO, glam::DVec3::NEG_Z, 60.0);
        let eye = Eye {
            pose,
            motion: Motion::default(),
            speed_m_per_s: 1.0,
            grab_scene: false,
            orbit: None,
            flight: None,
            moved_s: f64::MIN,
        };
        let mut recent = RecentFiles::read(options.recent_file.clone());
        recent.set_cache(ThumbnailCache::new(options.thumbnail_dir.clone()));
        Self {
            session,
            info: None,
            opening: None,
            recent,
            being_opened: SourceOrigin {
                file: options.file.clone(),
                name: options.name.clone(),
            },
            origin: SourceOrigin::default(),
            opening_orders: 0,
            bookmarks: Bookmarks::default(),
            eye,
            display,
            sets: SettingSets::default(),
            pointed: None,
            path_recorder: PathRecorder::new(options.replay),
            replay_ended: false,
            exporting: None,
            messages: Messages::default(),
            history: History::default(),
            shown: None,
            textures: Vec::new(),
            policy: ResolutionPolicy::default(),
            view_request: None,
            jobs_issued: 0,
            headbox: HeadboxPanel::default(),
            show_panels: options.panels,
            panel_unfolded: false,
            show_keys: false,
            full_screen: false,
            open_list: OpenList::default(),
            save_dialog: SaveDialog::new(options.output_dir.clone()),
            start_page: StartPage {
                has_library: can_open,
                ..StartPage::default()
            },
            commands: Vec::new(),
            pending_shots: Vec::new(),
            automation: Automation::new(options.exit, options.screenshot.clone()),
            outcome,
            run_times: RunTimes::default(),
            options,
        }
    }

    /// Runs one pass of the window. `last_pass_ms` is the time of the previous pass, drawing
    /// included.
    pub(crate) fn pass(&mut self, ui: &mut Ui, last_pass_ms: Option<f64>) {
        let ctx = ui.ctx().clone();
        let now_s = ui.input(|i| i.time);
        if let Some(ms) = last_pass_ms {
            self.run_times.pass_ms.truncate(MAX_PASS_TIMES - 1);
            self.run_times.pass_ms.insert(0, ms);
        }
        while let Some(event) = self.session.next_event() {
            self.handle_event(&ctx, event, now_s);
        }
        // egui may lay out a frame in several passes and draws only the last: taking a finished
        // frame in each of them would lose one.
        if ctx.current_pass_index() == 0
            && let Some(finished) = self.session.take_frame()
        {
            self.upload_frame(&ctx, finished, now_s);
        }
        self.collect_shots(now_s);
        if !ctx.text_edit_focused() && !self.save_dialog.is_open() {
            self.commands.extend(ui.input(keymap::commands));
        }
        let dropped = ui.input(|i| i.raw.dropped_files.first().map(|f| f.path().to_owned()));
        self.commands
            .extend(dropped.map(|path| Command::Open(Location::File(path))));
        self.panels(ui, now_s);
        CentralPanel::default().frame(Frame::NONE).show(ui, |ui| {
            if self.info.is_some() {
                self.show_viewport(ui, now_s);
            } else {
                panels::start::show(
                    ui,
                    &mut self.start_page,
                    self.opening.as_ref(),
                    &mut self.recent,
                    &mut self.commands,
                );
            }
        });
        panels::overlay::messages::show(&ctx, &mut self.messages);
        panels::dialogs::keys::show(&ctx, &mut self.show_keys);
        let recent = &mut self.recent;
        panels::dialogs::open::show(&ctx, &mut self.open_list, recent, &mut self.commands);
        panels::dialogs::save::show(&ctx, &mut self.save_dialog, &mut self.commands);
        for command in std::mem::take(&mut self.commands) {
            self.execute(&ctx, command, now_s);
        }
        if let Some(left_s) = self.messages.expire(now_s) {
            ctx.request_repaint_after(Duration::from_secs_f64(left_s.max(0.0)));
        }
        self.step_automation(&ctx);
    }

    fn step_automation(&mut self, ctx: &Context) {
        let first_image = self.run_times.frames_shown > 0;
        {
            let mut outcome = lock(&self.outcome);
            if self.run_times.passed {
                let elapsed_s = self.options.started.elapsed().as_secs_f64();
                outcome.summary.window_s.get_or_insert(elapsed_s);
            } else {
                // The next pass notes the time of the first one: only then is it on the screen.
                self.run_times.passed = true;
                ctx.request_repaint();
            }
            // `shown` was painted in an earlier pass if the summary already counts a frame.
            if first_image
                && outcome.summary.first_image_s.is_none()
                && outcome.summary.frames_shown > 0
            {
                outcome.summary.first_image_s = Some(self.options.started.elapsed().as_secs_f64());
            }
            outcome.summary.frames_shown = self.run_times.frames_shown;
        }
        let settled = self
            .shown
            .as_ref()
            .is_some_and(|s| s.job.number == self.jobs_issued && !s.job.moving);
        let error = self
            .messages
            .iter()
            .find(|m| m.kind == Kind::Error)
            .map(|m| m.text.as_str());
        let path_done = self.replay_ended && settled && !self.path_recorder.is_playing();
        let done = |shown: &FinishedFrame| {
            shown
                .pictures
                .iter()
                .all(|p| p.report.refinement == Refinement::Done)
        };
        let refined = settled && self.shown.as_ref().is_some_and(done);
        let progress = Progress {
            frames_shown: self.run_times.frames_shown,
            path_done,
            refined,
            thumbnails_done: self.start_page.has_all_thumbnails(),
            error,
        };
        if let Some(error) = self.automation.step(ctx, &progress) {
            lock(&self.outcome).error = Some(error);
        }
        if self.automation.is_closing() {
            self.write_summary();
        }
    }

    /// Writes the measurements of the run to the summary.
    pub(crate) fn write_summary(&self) {
        let mut outcome = lock(&self.outcome);
        let summary = &mut outcome.summary;
        if let (Some(first), Some(last)) = (self.run_times.first, self.run_times.last)
            && last > first
        {
            summary.shown_per_s =
                (self.run_times.frames_shown - 1) as f64 / (last - first).as_secs_f64();
        }
        summary.render_ms_median = self.history.median(|f| f.render_ms).unwrap_or(0.0);
        summary.latency_ms_median = self.history.median(|f| f.latency_ms).unwrap_or(0.0);
        summary.pass_ms_median = median(self.run_times.pass_ms.iter().copied()).unwrap_or(0.0);
        summary.scale_mean = self.run_times.scales / self.run_times.frames_shown.max(1) as f64;
        summary.frame_size_px = self
            .view_request
            .as_ref()
            .map_or([0; 2], |request| request.size_px);
    }
}
