//! A frame of a walk: geometry for the eye's cell and for near ones, backdrops behind all other
//! portals (R3, R15, P1).
//!
//! 1. From the eye's cell on, cells are visited through portals ([`visit`](super::visit)). A portal
//!    near the eye is passed: the next cell is drawn as geometry too. Any other ends the visit, if
//!    its backdrop is at hand; without one it is passed as well, so that a missing image never
//!    leaves a hole.
//! 2. The visited cells are rasterised, and the portals where the visit ended with them, as markers
//!    without colour: the depth buffer says which pixels look through which portal, whatever
//!    overlaps (the order that R15 leaves open).
//! 3. Each backdrop is drawn for the smallest rectangle that holds its portal's pixels, and copied
//!    into these alone.

use super::backdrop::{
    Backdrop, BackdropError, BackdropQuality, BackdropStats, Drawer, PortalSide,
};
use super::house::House;
use super::settings::{WalkSettings, WalkStats};
use super::store::Store;
use super::visit::{BackedPortal, Visit, union, visit};
use headbox_core::camera::Camera;
use headbox_core::frame::Frame;
use headbox_raster::{Marker, PixelContent, RasterOutput, RasterView, Rasterizer};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

/// The part of a frame that a backdrop fills.
struct BackdropArea<'a> {
    /// Number of the portal's marker.
    number: u32,
    backdrop: &'a Backdrop,
    columns: Range<u32>,
    rows: Range<u32>,
    /// Sees just that.
    camera: Camera,
}

/// Draws the frames of a walk; owns the buffers.
#[derive(Default)]
pub struct Walker {
    rasterizer: Rasterizer,
    /// One for each portal that shows a backdrop.
    drawers: Vec<Drawer>,
    previous: Frame,
    stats: WalkStats,
}

impl Walker {
    /// A walker that has drawn nothing yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Captures the backdrops that a frame needs and the store lacks; returns how many. What the
    /// store's budget cannot keep stays geometry.
    ///
    /// # Errors
    /// See [`BackdropError`].
    pub fn prepare(
        house: &House,
        store: &Store,
        camera: &Camera,
        settings: &WalkSettings,
        quality: &BackdropQuality,
    ) -> Result<u32, BackdropError> {
        let Some(kind) = settings.backdrops else {
            return Ok(0);
        };
        let mut captured = 0;
        // One at a time: a portal that is missing only behind another one is none that the frame
        // needs.
        while let Some(at) = Self::missing(house, store, camera, settings)
            .first()
            .copied()
        {
            let backdrop = Backdrop::capture(house, at, kind, quality)?;
            if !store.insert((at, kind), Arc::new(backdrop)) {
                break;
            }
            captured += 1;
        }
        Ok(captured)
    }

    /// The sides of portals whose backdrops a frame would use if the store had them, the eye's own
    /// cell first.
    pub fn missing(
        house: &House,
        store: &Store,
        camera: &Camera,
        settings: &WalkSettings,
    ) -> Vec<PortalSide> {
        let cell = house.cell_of_eye(camera.eye());
        visit(house, store, camera, settings, cell).missing
    }

    /// The backdrops that a frame uses.
    pub fn shown(
        house: &House,
        store: &Store,
        camera: &Camera,
        settings: &WalkSettings,
    ) -> Vec<Arc<Backdrop>> {
        let cell = house.cell_of_eye(camera.eye());
        visit(house, store, camera, settings, cell)
            .boundaries
            .into_iter()
            .map(|boundary| boundary.backdrop)
            .collect()
    }

    /// Draws what a camera sees of a house, with the backdrops that the store has, on the current
    /// rayon thread pool.
    pub fn frame(
        &mut self,
        house: &House,
        store: &Store,
        camera: &Camera,
        settings: &WalkSettings,
    ) -> (&Frame, &WalkStats) {
        let started = Instant::now();
        let cell = house.cell_of_eye(camera.eye());
        let Visit {
            groups,
            boundaries,
            missing,
        } = visit(house, store, camera, settings, cell);
        let mut stats = WalkStats {
            cell,
            missing,
            ..WalkStats::default()
        };
        let markers: Vec<Marker> = (0..)
            .zip(&boundaries)
            .filter_map(|(n, b)| marker(house, n, b))
            .collect();
        let view = RasterView {
            groups: &groups,
            markers: &markers,
            exposure: house.lighting().exposure,
            hole_color_srgb: settings.warp.hole_color_srgb,
        };
        stats.raster = *self
            .rasterizer
            .draw(house.mesh(), camera, &view, house.sky())
            .1;
        stats.geometry_cells = groups.len() as u32;
        stats.pixels = u64::from(camera.width()) * u64::from(camera.height());
        stats.backdrop_pixels = stats.raster.marker_pixels;
        let geometry_done = Instant::now();
        self.fill(&boundaries, camera, settings, &mut stats);
        let output = self.rasterizer.output_mut();
        if settings.persistence {
            persist(output, &self.previous, camera);
            self.previous.clone_from(&output.frame);
        } else {
            self.previous = Frame::default();
        }
        stats.geometry_ms = (geometry_done - started).as_secs_f64() * 1e3;
        stats.backdrop_ms = geometry_done.elapsed().as_secs_f64() * 1e3;
        stats.frame_ms = started.elapsed().as_secs_f64() * 1e3;
        self.stats = stats;
        (&output.frame, &self.stats)
    }

    /// Statistics of the last frame.
    pub fn stats(&self) -> &WalkStats {
        &self.stats
    }

    /// The last frame with what each of its pixels shows.
    pub fn last(&self) -> &RasterOutput {
        self.rasterizer.output()
    }

    /// Draws the backdrops into the pixels of their markers.
    fn fill(
        &mut self,
        boundaries: &[BackedPortal],
        camera: &Camera,
        settings: &WalkSettings,
        stats: &mut WalkStats,
    ) {
        let output = self.rasterizer.output_mut();
        let numbered = (0..).zip(boundaries);
        let parts: Vec<BackdropArea> = numbered
            .filter_map(|(number, boundary)| BackdropArea::of(output, number, boundary, camera))
            .collect();
        self.drawers
            .resize_with(self.drawers.len().max(parts.len()), Drawer::default);
        let side_by_side = self.drawers.par_iter_mut().zip(&parts).with_max_len(1);
        let drawn: Vec<_> = side_by_side
            .map(|(drawer, part)| part.draw(drawer, settings))
            .collect();
        for (part, (drawn, took)) in parts.iter().zip(drawn) {
            part.copy(drawn, took, output, stats);
        }
    }
}

impl<'a> BackdropArea<'a> {
    fn of(
        output: &RasterOutput,
        number: u32,
        boundary: &'a BackedPortal,
        camera: &Camera,
    ) -> Option<Self> {
        let [columns, rows] = touched(output, number, &boundary.window)?;
        let part = camera.cropped(columns.clone(), rows.clone()).ok()?;
        Some(Self {
            number,
            backdrop: &boundary.backdrop,
            columns,
            rows,
            camera: part,
        })
    }

    fn draw<'d>(
        &self,
        drawer: &'d mut Drawer,
        settings: &WalkSettings,
    ) -> (&'d Frame, BackdropStats) {
        let warp = settings
            .division
            .settings(&settings.warp, self.rows.len() as u32);
        drawer.draw(self.backdrop, &self.camera, &warp)
    }

    /// Copies what was drawn of it into the marker's pixels.
    fn copy(
        &self,
        drawn: &Frame,
        took: BackdropStats,
        output: &mut RasterOutput,
        stats: &mut WalkStats,
    ) {
        stats.portals += 1;
        stats.backdrop.samples += took.samples;
        stats.backdrop.depth_pixels_in += took.depth_pixels_in;
        stats.backdrop.splatted += took.splatted;
        for (y, row) in self.rows.clone().zip(0..) {
            for (x, column) in self.columns.clone().zip(0..) {
                let at = y as usize * output.frame.width as usize + x as usize;
                if output.seen(at) == PixelContent::Marker(self.number) {
                    let from = row as usize * drawn.width as usize + column as usize;
                    (output.frame.color[at], output.frame.coverage[at]) =
                        (drawn.color[from], drawn.coverage[from]);
                    stats.hole_pixels += u64::from(drawn.coverage[from].is_hole());
                }
            }
        }
    }
}

fn marker(house: &House, number: u32, boundary: &BackedPortal) -> Option<Marker> {
    Some(Marker {
        polygon: boundary.at.opening(house)?.corners,
        number,
    })
}

/// The smallest rectangle, inside a window, that holds the pixels of a marker.
fn touched(
    output: &RasterOutput,
    number: u32,
    [columns, rows]: &[Range<u32>; 2],
) -> Option<[Range<u32>; 2]> {
    let mut found: Option<[Range<u32>; 2]> = None;
    for y in rows.clone() {
        let start = y as usize * output.frame.width as usize;
        let shows = |x: &u32| output.seen(start + *x as usize) == PixelContent::Marker(number);
        let (Some(first), Some(last)) = (
            columns.clone().find(shows),
            columns.clone().rev().find(shows),
        ) else {
            continue;
        };
        let row = [first..last + 1, y..y + 1];
        found = Some(found.map_or(row.clone(), |found| union(&found, &row)));
    }
    found
}

/// Holes keep the colour that they had in the last frame of the same size.
fn persist(output: &mut RasterOutput, previous: &Frame, camera: &Camera) {
    if (previous.width, previous.height) != (camera.width(), camera.height()) {
        return;
    }
    let frame = &mut output.frame;
    for ((color, coverage), old) in frame
        .color
        .iter_mut()
        .zip(&frame.coverage)
        .zip(&previous.color)
    {
        if coverage.is_hole() {
            *color = *old;
        }
    }
}
