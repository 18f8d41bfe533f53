//! A house in the window, to be walked: geometry near the eye, backdrops behind the portals farther away.

use super::background::FewerThreads;
use super::library::file_name;
use super::overlay::{paint_backdrops, paint_holes};
use crate::capture::scene::FileFrame;
use crate::portal::file::{self, HouseFileError};
use crate::portal::house::House;
use crate::portal::opening::Opening;
use crate::portal::path::WalkPath;
use crate::portal::tour::Tour;
use crate::portal::variant::Variant;
use crate::portal::walk::WalkStats;
use glam::{DVec2, DVec3};
use headbox_viewer::{
    Control, Figure, FrameReport, FrameRequest, FrameSource, Navigation, Plan, Pose, Refinement, Room, Setting, Stage,
};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// Memory for backdrops, bytes: those of the file, and those that are built while one walks.
const BUDGET_BYTES: u64 = 2 << 30;

/// How long the background thread is left to itself between two looks for a backdrop of its making.
const LOOK_AGAIN: Duration = Duration::from_millis(250);

/// What the pixels show: the frame, or where it has holes or shows backdrops.
const OVERLAYS: [&str; 3] = ["none", "holes", "backdrops"];

/// A house, seen from anywhere: the eye may leave it and pass through walls.
pub(super) struct HouseSource {
    title: String,
    tour: Tour,
    start: Pose,
    /// The variant to begin with.
    initial: Variant,
    threads: FewerThreads,
}

impl HouseSource {
    /// Opens a `.house` file, to be drawn by what it holds.
    ///
    /// # Errors
    /// See [`HouseFileError`].
    pub(super) fn read(path: &Path) -> Result<Self, HouseFileError> {
        let (house, store, quality) = file::read(path, BUDGET_BYTES)?;
        let initial = Variant::of_store(&store);
        let title = format!("{} (house)", file_name(path));
        let start = start_in(&house);
        let tour = Tour::new(Arc::new(house), Arc::new(store), quality, initial.settings());
        Ok(Self { title, tour, start, initial, threads: FewerThreads::default() })
    }
}

/// Inside a room, at the height of an eye, looking toward the door by which a walk through the house begins. Where there is
/// no room, the middle of everything.
fn start_in(house: &House) -> Pose {
    let walk = WalkPath { poses: 1, ..WalkPath::default() };
    let first = walk.cameras(house).ok().and_then(|cameras| cameras.first().copied());
    let (eye, forward) =
        first.map_or((house.tracer().origin(), DVec3::NEG_Z), |camera| (camera.eye(), camera.forward()));
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

    fn plan(&self) -> Option<Plan> {
        let model = self.tour.house().plan();
        let spaces = model.cells.iter().flat_map(|cell| cell.space.iter().map(move |prism| (&cell.name, prism)));
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
        (!rooms.is_empty()).then_some(Plan { rooms, openings })
    }

    fn file_frame(&self) -> FileFrame {
        self.tour.house().scene().frame
    }

    fn settings(&self) -> Vec<Setting> {
        let options = Variant::ALL.map(|variant| variant.name.to_owned()).to_vec();
        let selected = Variant::ALL.iter().position(|variant| *variant == self.initial).unwrap_or(0);
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

    fn render(&mut self, request: &FrameRequest, pixels: &mut [[u8; 4]]) -> Result<FrameReport, String> {
        let Self { tour, initial, threads, .. } = self;
        tour.settings = Variant::ALL.get(request.settings.choice("variant")?).unwrap_or(initial).settings();
        let (_, stats) = threads.install(&request.settings, || tour.frame(&request.camera))?;
        let (stages, mut figures) = (stages(stats), figures(stats));
        figures.push(figure("memory of backdrops", tour.store().bytes() as f64 / f64::from(1 << 20), "MiB"));
        match OVERLAYS.get(request.settings.choice("overlay")?) {
            Some(&"holes") => paint_holes(&tour.last().frame, pixels),
            Some(&"backdrops") => paint_backdrops(tour.last(), pixels),
            _ => pixels.copy_from_slice(&tour.last().frame.color),
        }
        let refinement = if tour.can_improve() { Refinement::Later(LOOK_AGAIN) } else { Refinement::Done };
        Ok(FrameReport { stages, figures, refinement })
    }
}

fn stages(stats: &WalkStats) -> Vec<Stage> {
    vec![Stage { name: "geometry", ms: stats.geometry_ms }, Stage { name: "backdrops", ms: stats.backdrop_ms }]
}

fn figure(name: &'static str, value: f64, unit: &'static str) -> Figure {
    Figure { name, value, unit }
}

fn figures(stats: &WalkStats) -> Vec<Figure> {
    let share = |pixels: u64| 100.0 * pixels as f64 / stats.pixels.max(1) as f64;
    // In a wall there is no cell.
    let cell = stats.cell.map(|cell| figure("cell of the eye", f64::from(cell), ""));
    let others = [
        figure("cells as geometry", f64::from(stats.geometry_cells), ""),
        figure("triangles drawn", stats.raster.triangles_set_up as f64, ""),
        figure("portals as backdrops", f64::from(stats.portals), ""),
        figure("backdrops missing", stats.missing.len() as f64, ""),
        figure("pixels of backdrops", share(stats.backdrop_pixels), "%"),
        figure("depth pixels splatted", stats.backdrop.splatted as f64, ""),
        figure("hole pixels", stats.hole_pixels as f64, ""),
    ];
    cell.into_iter().chain(others).collect()
}
