//! A house in the window whose light is baked while it is walked.

use super::view;
use crate::file_name::file_name;
use crate::terms::TERMS;
use crate::threads::FewerThreads;
use headbox_core::bounces::Bounces;
use headbox_core::file_frame::FileFrame;
use headbox_core::progress::Silent;
use headbox_core::read_note;
use headbox_core::task::{Shared, Task, low_priority_pool};
use headbox_core::view::View;
use headbox_house::backdrop::BackdropQuality;
use headbox_house::make::{MadeHouse, MakeOptions, make_house};
use headbox_house::view::{BUDGET_BYTES, HouseView};
use headbox_model::PortalModel;
use headbox_model::bake::BakeOptions;
use headbox_model::load::{LoadedModel, ModelOptions, load_model};
use headbox_scenes as scenes;
use headbox_viewer::{
    Fact, FrameReport, FrameRequest, FrameSource, Navigation, Ongoing, Pose, Refinement, RoomMap,
    Setting,
};
use std::path::Path;
use std::time::{Duration, Instant};

/// Interval between two polls of the background thread.
const POLL_INTERVAL: Duration = Duration::from_millis(250);

/// Largest number of a model's problems shown in the window.
const MOST_NOTES: usize = 3;

/// Maximum number of triangles of the built-in house before edges are cut for baked light: few
/// enough to open in a second.
const BUILTIN_TRIANGLES: usize = 60_000;

/// Successive qualities of baked light: a first in a few seconds, and one with a third of the
/// vertices of the default.
const LIGHTS: [BakeOptions; 2] = [
    BakeOptions {
        edge_m: 1.0,
        max_triangles: 300_000,
        samples: 8,
        smoothing: 4,
        bounces: Bounces::Full,
    },
    BakeOptions {
        edge_m: 0.4,
        max_triangles: 1_000_000,
        samples: 32,
        smoothing: 2,
        bounces: Bounces::Full,
    },
];

/// A model shown in plain colours until its light is baked.
pub(super) struct HouseSource {
    title: String,
    view: HouseView,
    threads: FewerThreads,
    /// The task that bakes the light, until it has ended.
    baking: Option<Baking>,
    /// Problems of the model.
    notes: Vec<String>,
}

/// Options of a house without backdrops, which are built during the walk.
fn make_options(light: Option<BakeOptions>) -> MakeOptions {
    MakeOptions {
        light,
        backdrops: Vec::new(),
        quality: BackdropQuality::default(),
        budget_bytes: BUDGET_BYTES,
    }
}

/// A task that bakes the light of a house, once for each of [`LIGHTS`].
struct Baking {
    task: Task<Baked>,
    begun: Instant,
}

#[derive(Default)]
struct Baked {
    newest: Option<MadeHouse>,
    rounds_done: usize,
}

impl HouseSource {
    /// The built-in house.
    ///
    /// # Errors
    /// One sentence.
    pub(super) fn builtin() -> Result<Self, String> {
        let mut model = scenes::house(0, BUILTIN_TRIANGLES);
        model.repair();
        Self::of_model("builtin:house".into(), model)
    }

    /// A portal model: a home, or a TOML model; refused if there are notes on its scene and reading
    /// is strict.
    ///
    /// # Errors
    /// One sentence.
    pub(super) fn load(path: &Path, is_strict: bool) -> Result<Self, String> {
        let LoadedModel { model, findings } =
            load_model(path, &ModelOptions::default()).map_err(|error| error.to_string())?;
        let (frame, count) = (model.scene.frame, findings.len());
        let scene_notes = model.scene.summary.notes.clone();
        if is_strict {
            read_note::refuse(&path.display().to_string(), &scene_notes)
                .map_err(|error| error.to_string())?;
        }
        let source = Self::of_model(format!("{} (home)", file_name(path)), model)?;
        let most = findings.into_iter().take(MOST_NOTES);
        let mut notes: Vec<String> = most
            .map(|finding| finding.in_file(&frame).to_string())
            .collect();
        if count > notes.len() {
            let more = count - notes.len();
            notes.push(format!(
                "{more} more things are told by: headbox house {}",
                path.display()
            ));
        }
        notes.extend(scene_notes.iter().map(ToString::to_string));
        Ok(Self { notes, ..source })
    }

    /// Shows a model in plain colours, starts baking its light, and builds backdrops during the
    /// walk.
    fn of_model(title: String, model: PortalModel) -> Result<Self, String> {
        let options = make_options(None);
        let plain = make_house(model.clone(), &options, &Silent);
        let MadeHouse { house, store, .. } = plain.map_err(|error| error.to_string())?;
        let baking = Some(Baking::start(model)?);
        Ok(Self {
            title,
            view: HouseView::new(house, store, options.quality),
            threads: FewerThreads::default(),
            baking,
            notes: Vec::new(),
        })
    }

    /// Shows the newest lit house. Returns true while a better one is being baked.
    fn update_light(&mut self) -> Result<bool, String> {
        let Some(baking) = &self.baking else {
            return Ok(false);
        };
        let (newest, ended, error) = baking
            .task
            .update(|state| (state.data.newest.take(), state.ended, state.error.take()));
        if ended {
            self.baking = None;
        }
        if let Some(MadeHouse { house, store, .. }) = newest {
            self.view.replace(house, store, BackdropQuality::default());
        }
        error.map_or(Ok(!ended), Err)
    }
}

impl Baking {
    fn start(model: PortalModel) -> Result<Self, String> {
        const NAME: &str = "light";
        let work = move |shared: &Shared<Baked>| {
            for light in LIGHTS {
                let options = make_options(Some(light));
                let made = make_house(model.clone(), &options, shared);
                let made = made.map_err(|error| error.to_string())?;
                shared.complete_round(|state| {
                    state.newest = Some(made);
                    state.rounds_done += 1;
                });
            }
            Ok(())
        };
        Ok(Self {
            task: Task::start(NAME, low_priority_pool(NAME)?, Baked::default(), work)?,
            begun: Instant::now(),
        })
    }

    fn ongoing(&self) -> Ongoing {
        /// Share of the first light in the total time of a flat with three rooms: preparing the
        /// light guide takes as long as for the second.
        const FIRST_SHARE: f64 = 0.33;
        let current = self.task.stage_share();
        let share = if self.task.lock().data.rounds_done == 0 {
            FIRST_SHARE * current
        } else {
            FIRST_SHARE + (1.0 - FIRST_SHARE) * current
        };
        Ongoing::since("computing light", share, self.begun)
    }
}

impl FrameSource for HouseSource {
    fn title(&self) -> String {
        self.title.clone()
    }

    fn start_pose(&self) -> Pose {
        view::pose(&self.view.start(self.view.default_size_px()))
    }

    fn navigation(&self) -> Navigation {
        self.view.navigation()
    }

    fn plan(&self) -> Option<RoomMap> {
        self.view.plan()
    }

    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    fn terms(&self) -> &'static [(&'static str, &'static str)] {
        &TERMS
    }

    fn file_frame(&self) -> FileFrame {
        self.view.file_frame()
    }

    fn settings(&self) -> Vec<Setting> {
        view::settings(self.view.settings())
    }

    fn render(
        &mut self,
        request: &FrameRequest,
        pixels: &mut [[u8; 4]],
    ) -> Result<FrameReport, String> {
        let awaits_light = self.update_light()?;
        let mut report = view::render(&mut self.view, &mut self.threads, request, pixels)?;
        if awaits_light {
            report.facts.push(Fact {
                name: "light",
                text: "is being baked".into(),
            });
            report.refinement = Refinement::Later(POLL_INTERVAL);
        }
        if let Some(baking) = &self.baking {
            report.ongoing = Some(baking.ongoing());
        }
        Ok(report)
    }
}
