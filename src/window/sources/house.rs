//! A house in the window, to be walked: geometry near the eye, backdrops behind the portals farther
//! away.

use crate::background;
use crate::background::FewerThreads;
use crate::file_name::file_name;
use crate::overlays::effort::swatch;
use crate::overlays::overlay::{Overlay, paint_backdrops, paint_holes};
use crate::terms::TERMS;
use glam::{DVec2, DVec3};
use headbox_core::file_frame::FileFrame;
use headbox_core::progress::{Progress, Silent};
use headbox_house::backdrop::BackdropQuality;
use headbox_house::file;
use headbox_house::file::HouseFileError;
use headbox_house::house::House;
use headbox_house::make::{MadeHouse, MakeOptions, make_house};
use headbox_house::opening::Opening;
use headbox_house::settings::WalkStats;
use headbox_house::store::Store;
use headbox_house::tour::Tour;
use headbox_house::variant::HouseVariant;
use headbox_house::walk_path::WalkPath;
use headbox_model::PortalModel;
use headbox_model::bake::BakeOptions;
use headbox_model::load::{LoadedModel, ModelOptions, load_model};
use headbox_scenes as scenes;
use headbox_viewer::{
    Control, Fact, Figure, FrameReport, FrameRequest, FrameSource, Navigation, Ongoing, Pose,
    Refinement, Room, RoomMap, Setting, Stage,
};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{self, Receiver, TryRecvError};
use std::time::{Duration, Instant};

/// Memory for backdrops, bytes: those of the file, and those that are built while one walks.
const BUDGET_BYTES: u64 = 2 << 30;

/// Interval between two polls of the background thread.
const LOOK_AGAIN: Duration = Duration::from_millis(250);

/// Overlays: the frame, its holes, or its backdrops.
const OVERLAYS: [&str; 3] = ["none", "holes", "backdrops"];

/// Largest number of a model's problems shown in the window.
const MOST_NOTES: usize = 3;

/// Figure: how many backdrops are still to be built for this view.
const MISSING: &str = "backdrops missing";

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

/// A house, seen from anywhere: the eye may leave it and pass through walls.
pub(super) struct HouseSource {
    title: String,
    tour: Tour,
    start: Pose,
    /// The variant to begin with.
    initial: HouseVariant,
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
    /// Opens a `.house` file, to be drawn by what it holds.
    ///
    /// # Errors
    /// See [`HouseFileError`].
    pub(super) fn read(path: &Path) -> Result<Self, HouseFileError> {
        let (house, store, quality) = file::read(path, BUDGET_BYTES)?;
        Ok(Self::new(
            format!("{} (house)", file_name(path)),
            house,
            store,
            quality,
        ))
    }

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
        let plain = Self::new(title, house, store, options.quality);
        Ok(Self { lit, ..plain })
    }

    fn new(title: String, house: House, store: Store, quality: BackdropQuality) -> Self {
        let (initial, start) = (HouseVariant::of_store(&store), start_in(&house));
        let tour = Tour::new(
            Arc::new(house),
            Arc::new(store),
            quality,
            initial.settings(),
        );
        Self {
            title,
            tour,
            start,
            initial,
            threads: FewerThreads::default(),
            lit: None,
            notes: Vec::new(),
        }
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
        self.tour = Tour::new(
            Arc::new(house),
            Arc::new(store),
            BackdropQuality::default(),
            self.tour.settings,
        );
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

/// Inside a room, at the height of an eye, looking toward the door by which a walk through the
/// house begins. Where there is no room, the middle of everything.
fn start_in(house: &House) -> Pose {
    let walk = WalkPath::default();
    let first = WalkPath::first(house).ok().flatten();
    let (eye, forward) = first.map_or((house.tracer().origin(), DVec3::NEG_Z), |camera| {
        (camera.eye(), camera.forward())
    });
    Pose::looking_at(eye, eye + forward, walk.fov_y_deg)
}

impl FrameSource for HouseSource {
    fn title(&self) -> String {
        self.title.clone()
    }

    fn start_pose(&self) -> Pose {
        self.start
    }

    fn navigation(&self) -> Navigation {
        Navigation::Walk
    }

    fn plan(&self) -> Option<RoomMap> {
        let model = self.tour.house().plan();
        let spaces = model
            .cells
            .iter()
            .flat_map(|cell| cell.space.iter().map(move |prism| (&cell.name, prism)));
        let rooms: Vec<_> = spaces
            .map(|(name, prism)| Room {
                name: name.clone(),
                outline: prism.outline.iter().map(DVec2::to_array).collect(),
            })
            .collect();
        let openings = model.portals.iter().filter_map(|portal| {
            let opening = Opening::new(portal, 0)?;
            Some([-1.0, 1.0].map(|side| {
                let end = opening.point(DVec2::new(side, 0.0));
                [end.x, end.z]
            }))
        });
        let openings = openings.collect();
        (!rooms.is_empty()).then_some(RoomMap { rooms, openings })
    }

    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    fn terms(&self) -> &'static [(&'static str, &'static str)] {
        &TERMS
    }

    fn file_frame(&self) -> FileFrame {
        self.tour.house().scene().frame
    }

    fn settings(&self) -> Vec<Setting> {
        let options = HouseVariant::ALL
            .map(|variant| variant.name.to_owned())
            .to_vec();
        let selected = HouseVariant::ALL
            .iter()
            .position(|variant| *variant == self.initial)
            .unwrap_or(0);
        vec![
            Setting::new(
                "variant",
                "Variant",
                "What stands behind portals that are not near: geometry, or textures, warped images, layered depth images or \
                 sprites, with footprints of fixed size or over the last frame (no unit). What is not in the file is built \
                 in the background; until then geometry is drawn.",
                Control::Choice { options, selected },
            ),
            Setting::choice(
                "overlay",
                "Overlay",
                "What is painted: the frame; the holes of its backdrops in magenta; its backdrops in colour and its geometry \
                 in grey.",
                &OVERLAYS,
            ),
            FewerThreads::setting(),
        ]
    }

    fn render(
        &mut self,
        request: &FrameRequest,
        pixels: &mut [[u8; 4]],
    ) -> Result<FrameReport, String> {
        let awaits_light = self.awaits_light()?;
        let Self {
            tour,
            initial,
            threads,
            ..
        } = self;
        tour.settings = HouseVariant::ALL
            .get(request.settings.choice("variant")?)
            .unwrap_or(initial)
            .settings();
        let (_, stats) = threads.install(&request.settings, || tour.frame(&request.camera))?;
        let (stages, mut figures, cell) = (stages(stats), figures(stats), stats.cell);
        let mut facts = vec![place(tour.house(), cell)];
        if awaits_light {
            facts.push(Fact {
                name: "light",
                text: "is being baked".into(),
            });
        }
        facts.push(crate::facts::simd_fact());
        figures.push(figure(
            "memory of backdrops",
            tour.store().bytes() as f64 / f64::from(1 << 20),
            "MiB",
        ));
        let legend = match OVERLAYS.get(request.settings.choice("overlay")?) {
            Some(&"holes") => {
                paint_holes(&tour.last().frame, pixels);
                Overlay::Holes.legend()
            }
            Some(&"backdrops") => {
                paint_backdrops(tour.last(), pixels);
                vec![
                    swatch([230, 159, 0], "in its colours: a backdrop"),
                    swatch([128; 3], "grey: geometry"),
                ]
            }
            _ => {
                pixels.copy_from_slice(&tour.last().frame.color);
                Vec::new()
            }
        };
        let refinement = if awaits_light || tour.can_improve() {
            Refinement::Later(LOOK_AGAIN)
        } else {
            Refinement::Done
        };
        let missing = figures
            .iter()
            .find(|figure| figure.name == MISSING)
            .map_or(0.0, |figure| figure.value);
        let ongoing = self.lit.as_ref().map(LitLater::ongoing).or_else(|| {
            let what = format!("building {missing} backdrops");
            (refinement != Refinement::Done).then_some(Ongoing {
                what,
                share: 0.0,
                left: None,
            })
        });
        Ok(FrameReport {
            stages,
            figures,
            facts,
            legend,
            refinement,
            ongoing,
        })
    }
}

fn stages(stats: &WalkStats) -> Vec<Stage> {
    vec![
        Stage {
            name: "geometry",
            ms: stats.geometry_ms,
        },
        Stage {
            name: "backdrops",
            ms: stats.backdrop_ms,
        },
    ]
}

fn figure(name: &'static str, value: f64, unit: &'static str) -> Figure {
    Figure { name, value, unit }
}

fn figures(stats: &WalkStats) -> Vec<Figure> {
    let share = |pixels: u64| 100.0 * pixels as f64 / stats.pixels.max(1) as f64;
    vec![
        figure("cells as geometry", f64::from(stats.geometry_cells), ""),
        figure("triangles drawn", stats.raster.triangles_set_up as f64, ""),
        figure("portals as backdrops", f64::from(stats.portals), ""),
        figure(MISSING, stats.missing.len() as f64, ""),
        figure("pixels of backdrops", share(stats.backdrop_pixels), "%"),
        figure("depth pixels splatted", stats.backdrop.splatted as f64, ""),
        figure("hole pixels", stats.hole_pixels as f64, ""),
    ]
}

/// The cell in which the eye stands, by its name in the model.
fn place(house: &House, cell: Option<u32>) -> Fact {
    let text = match cell.and_then(|cell| Some((cell, house.plan().cells.get(cell as usize)?))) {
        Some((number, cell)) => format!("{} (cell {number})", cell.name),
        None => "in a wall".into(),
    };
    Fact {
        name: "the eye is in",
        text,
    }
}
