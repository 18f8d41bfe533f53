//! A house as a [`View`]: geometry near the eye, backdrops behind farther portals.

use crate::backdrop::BackdropQuality;
use crate::file::{self, HouseFileError};
use crate::house::House;
use crate::portal_opening::Opening;
use crate::settings::WalkStats;
use crate::store::Store;
use crate::tour::Tour;
use crate::variant::HouseVariant;
use crate::walk_path::WalkPath;
use glam::{DVec2, DVec3};
use headbox_core::camera::Camera;
use headbox_core::file_frame::FileFrame;
use headbox_core::frame::Frame;
use headbox_core::view::paint::{expose, figure, hole_legend, paint_holes, swatch};
use headbox_core::view::{
    EXPOSURE, Fact, FrameReport, FrameRequest, Navigation, OVERLAY, Ongoing, RENDERING, Refinement,
    Rendered, Room, RoomMap, Setting, Stage, StartView, Statistics, Swatch, View,
};
use headbox_raster::{PixelContent, RasterOutput};
use serde_json::json;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// Name of the representation.
pub const KIND: &str = "house";

/// Memory budget of backdrops, bytes: those of the file, and those built during a walk.
pub const BUDGET_BYTES: u64 = 4 << 30;

/// Polling interval of backdrops that are built in the background.
const POLL_INTERVAL: Duration = Duration::from_millis(250);

/// Overlays: the frame, its holes, or its backdrops.
const OVERLAYS: [&str; 3] = ["none", "holes", "backdrops"];

/// View of a house; the eye may leave it and pass through walls.
pub struct HouseView {
    tour: Tour,
    /// Bounding box of the house, world metres.
    bounds: [DVec3; 2],
    start: StartView,
    size_px: [u32; 2],
    /// Initial variant.
    initial: HouseVariant,
    painted: Frame,
    stats: WalkStats,
}

impl HouseView {
    /// Opens a `.house` file with its backdrops.
    ///
    /// # Errors
    /// See [`HouseFileError`].
    pub fn read(path: &Path) -> Result<Self, HouseFileError> {
        let (house, store, quality) = file::read(path, BUDGET_BYTES)?;
        Ok(Self::new(house, store, quality))
    }

    /// Creates the view of a house with the backdrops in `store`; others are built in the given
    /// quality.
    pub fn new(house: House, store: Store, quality: BackdropQuality) -> Self {
        let initial = HouseVariant::for_store(&store);
        let (start, size_px) = initial_view(&house);
        Self {
            bounds: house.scene().bounds(),
            tour: Tour::new(
                Arc::new(house),
                Arc::new(store),
                quality,
                initial.settings(),
            ),
            start,
            size_px,
            initial,
            painted: Frame::default(),
            stats: WalkStats::default(),
        }
    }

    /// Replaces the house by the same rooms with other light and backdrops.
    pub fn replace(&mut self, house: House, store: Store, quality: BackdropQuality) {
        let settings = self.tour.settings;
        self.tour = Tour::new(Arc::new(house), Arc::new(store), quality, settings);
    }

    /// The house.
    pub fn house(&self) -> &House {
        self.tour.house()
    }

    /// Settings of all houses; the selected variant depends on a house's backdrops.
    pub fn setting_table() -> Vec<Setting> {
        Self::settings_from(HouseVariant::ALL.first())
    }

    fn settings_from(initial: Option<&HouseVariant>) -> Vec<Setting> {
        let selected = HouseVariant::ALL
            .iter()
            .position(|variant| Some(variant) == initial)
            .unwrap_or(0);
        vec![
            Setting::choice_at(
                "variant",
                "Variant",
                "Backdrop behind portals that are not near: geometry, textures, warped images, layered depth \
                 images or sprites, with footprints of fixed size or composed over the last frame (no unit). \
                 Backdrops missing from the file are built in the background; until then geometry is drawn.",
                &HouseVariant::ALL.map(|variant| variant.name),
                selected,
            )
            .with_flag("variant")
            .folded_under(RENDERING),
            Setting::choice(
                OVERLAY,
                "Overlay",
                "Content of the image: the frame; holes of its backdrops in magenta; backdrops in colour and \
                 geometry in grey.",
                &OVERLAYS,
            )
            .with_flag(OVERLAY),
            Setting::exposure(),
        ]
    }

    /// Paints an overlay over a copy of the last frame, which is `stops` brighter, and returns its
    /// legend; `None` if there is nothing to paint.
    fn paint(&mut self, overlay: Option<&&str>, stops: f64) -> Option<Vec<Swatch>> {
        let walk = self.tour.last();
        let is_plain = overlay.is_none_or(|name| *name == "none");
        if is_plain && stops == 0.0 {
            return None;
        }
        self.painted.clone_from(&walk.frame);
        if stops != 0.0 {
            let tone = self.tour.house().lighting().tone;
            expose(&mut self.painted.color, tone, stops);
        }
        Some(match overlay {
            Some(&"holes") => {
                paint_holes(&walk.frame, &mut self.painted.color);
                hole_legend()
            }
            Some(&"backdrops") => {
                paint_backdrops(walk, &mut self.painted.color);
                vec![
                    swatch([230, 159, 0], "in its colours: a backdrop"),
                    swatch([128; 3], "grey: geometry"),
                ]
            }
            _ => Vec::new(),
        })
    }
}

/// Paints the geometry of a frame grey, so that backdrops stand out.
fn paint_backdrops(walk: &RasterOutput, pixels: &mut [[u8; 4]]) {
    for (i, pixel) in pixels.iter_mut().enumerate() {
        if !matches!(walk.seen(i), PixelContent::Marker(_)) {
            let [r, g, b, a] = *pixel;
            let grey = ((u16::from(r) + u16::from(g) + u16::from(b)) / 3) as u8;
            *pixel = [grey, grey, grey, a];
        }
    }
}

/// Returns the initial view ([`WalkPath::first_view`]) and the size of its frames.
fn initial_view(house: &House) -> (StartView, [u32; 2]) {
    let walk = WalkPath::default();
    let ahead = StartView {
        eye: house.tracer().origin(),
        forward: DVec3::NEG_Z,
        up: DVec3::Y,
        fov_y_deg: walk.fov_y_deg,
    };
    let first = WalkPath::first_view(house);
    let start = first.map_or(ahead, |camera| StartView::from_camera(&camera));
    (start, walk.size)
}

impl View for HouseView {
    fn kind(&self) -> &'static str {
        KIND
    }

    fn start(&self, _: [u32; 2]) -> StartView {
        self.start
    }

    fn default_size_px(&self) -> [u32; 2] {
        self.size_px
    }

    /// Walks through all rooms, wherever `first` stands.
    fn film_path(&self, first: &Camera, fps: u32) -> Option<Vec<Camera>> {
        let walk = WalkPath {
            size: [first.width(), first.height()],
            fov_y_deg: first.fov_y_deg(),
            ..WalkPath::default()
        };
        let seconds = walk.length_m(self.house()) / self.speed_m_per_s();
        let poses = 1 + (seconds * f64::from(fps)) as usize;
        let cameras = WalkPath { poses, ..walk }.cameras(self.house()).ok()?;
        (cameras.len() > 1).then_some(cameras)
    }

    fn navigation(&self) -> Navigation {
        Navigation::Walk
    }

    fn file_frame(&self) -> FileFrame {
        self.house().scene().frame
    }

    fn plan(&self) -> Option<RoomMap> {
        let model = self.house().plan();
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
        (!rooms.is_empty()).then(|| RoomMap {
            rooms,
            openings: openings.collect(),
        })
    }

    fn primitives(&self) -> (u64, &'static str) {
        (self.house().scene().triangles.len() as u64, "triangles")
    }

    fn bytes(&self) -> u64 {
        self.house().scene().bytes() + self.tour.store().bytes()
    }

    fn settings(&self) -> Vec<Setting> {
        Self::settings_from(Some(&self.initial))
    }

    fn render(&mut self, request: &FrameRequest) -> Result<Rendered<'_>, String> {
        self.tour.settings = HouseVariant::ALL
            .get(request.settings.choice("variant")?)
            .unwrap_or(&self.initial)
            .settings();
        let stats = if request.complete {
            let frame = self.tour.complete_frame(&request.camera);
            frame.map_err(|error| error.to_string())?.1
        } else {
            self.tour.frame(&request.camera).1
        };
        self.stats = stats.clone();
        let mut report = report(&self.stats);
        report
            .facts
            .push(eye_location(self.house(), self.stats.cell));
        report.figures.push(figure(
            "memory of backdrops",
            self.tour.store().bytes() as f64 / f64::from(1 << 20),
            "MiB",
        ));
        let eye = request.camera.eye();
        if let Some(warning) = self.file_frame().distant_eye_warning(self.bounds, eye) {
            report.warnings.push(warning);
        } else if self.stats.cell.is_none() {
            let why = "the eye is in no cell (inside a wall?); all cells are drawn as geometry";
            report.warnings.push(why.into());
        }
        if self.stats.is_culling_cut {
            let why = "more cells are visible through portals than portal culling follows; some are not drawn: look in \
                       another direction, or merge cells";
            report.warnings.push(why.into());
        }
        if !request.complete && self.tour.can_improve() {
            report.refinement = Refinement::Later(POLL_INTERVAL);
            report.ongoing = Some(Ongoing {
                what: format!("building {} backdrops", self.stats.missing.len()),
                share: 0.0,
                left: None,
            });
        }
        let overlay = OVERLAYS.get(request.settings.choice(OVERLAY)?);
        let frame = match self.paint(overlay, request.settings.number(EXPOSURE)?) {
            Some(legend) => {
                report.legend = legend;
                &self.painted
            }
            None => &self.tour.last().frame,
        };
        Ok(Rendered { frame, report })
    }

    fn statistics(&mut self, _: &FrameRequest) -> Statistics {
        json!(self.stats)
    }
}

fn report(stats: &WalkStats) -> FrameReport {
    let share = |pixels: u64| 100.0 * pixels as f64 / stats.pixels.max(1) as f64;
    let count = |name, value: u64| figure(name, value as f64, "");
    let stages = [
        ("geometry", stats.geometry_ms),
        ("backdrop", stats.backdrop_ms),
    ];
    FrameReport {
        stages: stages.map(|(name, ms)| Stage { name, ms }).to_vec(),
        ms: stats.frame_ms,
        hole_pixels: stats.hole_pixels,
        figures: vec![
            count("cells as geometry", stats.geometry_cells.into()),
            count("triangles drawn", stats.raster.triangles_set_up),
            count("portals as backdrops", stats.portals.into()),
            count("backdrops missing", stats.missing.len() as u64),
            figure("pixels of backdrops", share(stats.backdrop_pixels), "%"),
            count("depth pixels in", stats.backdrop.depth_pixels_in),
            count("splatted", stats.backdrop.splatted),
            count("hole pixels", stats.hole_pixels),
        ],
        ..FrameReport::default()
    }
}

/// Returns the cell of the eye by its name in the model.
fn eye_location(house: &House, cell: Option<u32>) -> Fact {
    let text = match cell.and_then(|cell| Some((cell, house.plan().cells.get(cell as usize)?))) {
        Some((number, cell)) => format!("{} (cell {number})", cell.name),
        None => "in a wall".into(),
    };
    Fact {
        name: "the eye is in",
        text,
    }
}
