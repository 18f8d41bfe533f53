//! A house in the window whose light is baked while it is walked.

use super::view;
use crate::file_name::file_name;
use crate::terms::TERMS;
use crate::threads::FewerThreads;
use headbox_core::file_frame::FileFrame;
use headbox_core::progress::{Progress, Silent};
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
use headbox_views::background;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{self, Receiver, TryRecvError};
use std::time::{Duration, Instant};

/// Interval between two polls of the background thread.
const LOOK_AGAIN: Duration = Duration::from_millis(250);

/// Largest number of a model's problems shown in the window.
const MOST_NOTES: usize = 3;

/// Triangles of the built-in house, at most, before its edges are cut to hold light: few enough to
/// be there in a second.
const BUILTIN_TRIANGLES: usize = 60_000;

/// Successive qualities of baked light: a first in a few seconds, and one with a third of the
/// vertices of the default.
const LIGHTS: [BakeOptions; 2] = [
    BakeOptions {
        edge_m: 1.0,
        max_triangles: 300_000,
        samples: 8,
        smoothing: 4,
        bounces: 1,
    },
    BakeOptions {
        edge_m: 0.4,
        max_triangles: 1_000_000,
        samples: 32,
        smoothing: 2,
        bounces: 1,
    },
];

/// A model whose light is still to come, in plain colours until then.
pub(super) struct HouseSource {
    title: String,
    view: HouseView,
    threads: FewerThreads,
    /// The same house with its light baked in, if that is still to come.
    lit: Option<LitLater>,
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

/// A house whose light is baked on a thread of low priority, for as long as this lives: once for
/// each of [`LIGHTS`].
struct LitLater {
    houses: Receiver<Result<MadeHouse, String>>,
    /// Number of light bakes received.
    come: usize,
    baking: Arc<BakeProgress>,
    begun: Instant,
}

/// Progress of the present light.
#[derive(Default)]
struct BakeProgress {
    cancelled: AtomicBool,
    samples_done: AtomicU64,
    samples: AtomicU64,
}

impl Progress for BakeProgress {
    fn begin(&self, _: &str, _: &str, total: u64) {
        self.samples_done.store(0, Ordering::Relaxed);
        self.samples.store(total, Ordering::Relaxed);
    }

    fn advance(&self, steps: u64) {
        self.samples_done.fetch_add(steps, Ordering::Relaxed);
    }

    fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }
}

impl Drop for LitLater {
    fn drop(&mut self) {
        self.baking.cancelled.store(true, Ordering::Relaxed);
    }
}

impl HouseSource {
    /// The built-in house.
    ///
    /// # Errors
    /// One sentence.
    pub(super) fn builtin() -> Result<Self, String> {
        let mut model = scenes::house(0, BUILTIN_TRIANGLES);
        model.mend();
        Self::of_model("builtin:house".into(), model)
    }

    /// A portal model: a home, or a TOML model.
    ///
    /// # Errors
    /// One sentence.
    pub(super) fn load(path: &Path) -> Result<Self, String> {
        let LoadedModel { model, findings } =
            load_model(path, &ModelOptions::default()).map_err(|error| error.to_string())?;
        let (frame, count) = (model.scene.frame, findings.len());
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
        Ok(Self { notes, ..source })
    }

    /// A model in plain colours at first; its light is baked meanwhile, and its backdrops are built
    /// as one walks.
    fn of_model(title: String, model: PortalModel) -> Result<Self, String> {
        let options = make_options(None);
        let plain = make_house(model.clone(), &options, &Silent);
        let MadeHouse { house, store, .. } = plain.map_err(|error| error.to_string())?;
        let lit = Some(LitLater::begin(model)?);
        Ok(Self {
            title,
            view: HouseView::new(house, store, options.quality),
            threads: FewerThreads::default(),
            lit,
            notes: Vec::new(),
        })
    }

    /// Takes the lit house over once it is there. Returns whether it is still to come.
    fn awaits_light(&mut self) -> Result<bool, String> {
        let Some(lit) = &mut self.lit else {
            return Ok(false);
        };
        let made = match lit.houses.try_recv() {
            Err(TryRecvError::Empty) => return Ok(true),
            Err(TryRecvError::Disconnected) => {
                Err("Light could not be baked because of an error in the program.".into())
            }
            Ok(made) => made,
        };
        lit.come += 1;
        if lit.come == LIGHTS.len() || made.is_err() {
            self.lit = None;
        }
        let MadeHouse { house, store, .. } = made?;
        self.view.replace(house, store, BackdropQuality::default());
        Ok(self.lit.is_some())
    }
}

impl LitLater {
    /// Begins to bake the light of a model.
    fn begin(model: PortalModel) -> Result<Self, String> {
        let (sender, houses) = mpsc::channel();
        let baking = Arc::new(BakeProgress::default());
        let watched = Arc::clone(&baking);
        let pool = background::pool("light")?;
        let work = move || {
            for light in LIGHTS {
                watched.begin("", "", 0);
                let options = make_options(Some(light));
                let made = pool.install(|| make_house(model.clone(), &options, &*watched));
                if watched.is_cancelled() {
                    return;
                }
                // The window may show something else by now.
                let _ = sender.send(made.map_err(|error| error.to_string()));
            }
        };
        let thread = std::thread::Builder::new().name("light".into()).spawn(work);
        thread.map_err(|error| format!("Cannot start a thread: {error}."))?;
        Ok(Self {
            houses,
            come: 0,
            baking,
            begun: Instant::now(),
        })
    }

    fn ongoing(&self) -> Ongoing {
        let done = self.baking.samples_done.load(Ordering::Relaxed);
        let all = self.baking.samples.load(Ordering::Relaxed);
        let share = (done as f64 / all.max(1) as f64).min(1.0);
        // Of a flat of three rooms the first light takes a third of the time: to learn where light
        // comes from takes as long as for the second.
        let [first, second] = [0.33, 0.67];
        let share = if self.come == 0 {
            first * share
        } else {
            first + second * share
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
        let awaits_light = self.awaits_light()?;
        let mut report = view::render(&mut self.view, &mut self.threads, request, pixels)?;
        if awaits_light {
            report.facts.push(Fact {
                name: "light",
                text: "is being baked".into(),
            });
            report.refinement = Refinement::Later(LOOK_AGAIN);
        }
        if let Some(lit) = &self.lit {
            report.ongoing = Some(lit.ongoing());
        }
        Ok(report)
    }
}
