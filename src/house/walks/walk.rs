//! Rendering of a walk: geometry for the eye's cell and for near cells, backdrops behind all other
//! portals (R3, R15, P1).
//!
//! 1. Starting from the eye's cell, cells are visited through portals ([`visit`](super::visit)). A
//!    portal near the eye is passed: the next cell is drawn as geometry too. At any other portal
//!    the visit ends if its backdrop is in the store; without one the portal is passed as well, so
//!    that a missing backdrop never leaves a hole.
//! 2. The visited cells are rasterised together with the portals where the visit ended, which are
//!    markers without colour: the depth buffer determines which pixels look through which portal,
//!    even if portals overlap (the order that R15 leaves open).
//! 3. Each backdrop is drawn for the bounding rectangle of its portal's pixels, and copied only
//!    into these pixels.

use super::settings::{WalkSettings, WalkStats};
use super::visit::{BackdropPortal, Visit, union, visit};
use crate::backdrop::{
    Backdrop, BackdropError, BackdropQuality, BackdropStats, Drawer, PortalSide,
};
use crate::house::House;
use crate::store::Store;
use headbox_core::camera::Camera;
use headbox_core::frame::Frame;
use headbox_raster::{Marker, PixelContent, RasterOutput, RasterView, Rasterizer};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

/// Part of a frame that a backdrop fills.
struct BackdropArea<'a> {
    /// Number of the portal's marker.
    number: u32,
    backdrop: &'a Backdrop,
    columns: Range<u32>,
    rows: Range<u32>,
    /// Camera of that part.
    camera: Camera,
}

/// Renderer of walks; reuses its buffers from frame to frame.
#[derive(Default)]
pub struct Walker {
    rasterizer: Rasterizer,
    /// Drawer of each portal with a backdrop.
    drawers: Vec<Drawer>,
    previous: Frame,
    stats: WalkStats,
}

impl Walker {
    /// Creates a walker.
    pub fn new() -> Self {
        Self::default()
    }

    /// Captures the backdrops that a frame needs and the store lacks; returns their number.
    /// Backdrops that exceed the store's budget are replaced by geometry.
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
        // One at a time: a new backdrop may hide other portals, whose backdrops are then not
        // needed.
        while let Some(&at) = Self::missing(house, store, camera, settings).first() {
            let backdrop = Backdrop::capture(house, at, kind, quality)?;
            if !store.insert((at, kind), Arc::new(backdrop)) {
                break;
            }
            captured += 1;
        }
        Ok(captured)
    }

    /// Returns the portal sides whose backdrops a frame needs and the store lacks, the eye's own
    /// cell first.
    pub fn missing(
        house: &House,
        store: &Store,
        camera: &Camera,
        settings: &WalkSettings,
    ) -> Vec<PortalSide> {
        let cell = house.find_cell(camera.eye());
        visit(house, store, camera, settings, cell).missing
    }

    /// Returns the backdrops that a frame uses.
    pub fn shown(
        house: &House,
        store: &Store,
        camera: &Camera,
        settings: &WalkSettings,
    ) -> Vec<Arc<Backdrop>> {
        let cell = house.find_cell(camera.eye());
        visit(house, store, camera, settings, cell)
            .boundaries
            .into_iter()
            .map(|boundary| boundary.backdrop)
            .collect()
    }

    /// Renders a frame of a house with the backdrops in the store, on the current rayon thread
    /// pool.
    pub fn frame(
        &mut self,
        house: &House,
        store: &Store,
        camera: &Camera,
        settings: &WalkSettings,
    ) -> (&Frame, &WalkStats) {
        let started = Instant::now();
        let cell = house.find_cell(camera.eye());
        let Visit {
            groups,
            boundaries,
            missing,
            is_complete,
        } = visit(house, store, camera, settings, cell);
        let mut stats = WalkStats {
            cell,
            missing,
            is_culling_cut: !is_complete,
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
            tone: house.lighting().tone,
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

    /// Last frame, with the content of each pixel.
    pub fn last(&self) -> &RasterOutput {
        self.rasterizer.output()
    }

    /// Draws the backdrops into the pixels of their markers.
    fn fill(
        &mut self,
        boundaries: &[BackdropPortal],
        camera: &Camera,
        settings: &WalkSettings,
        stats: &mut WalkStats,
    ) {
        let output = self.rasterizer.output_mut();
        let numbered = (0..).zip(boundaries);
        let areas: Vec<BackdropArea> = numbered
            .filter_map(|(number, boundary)| BackdropArea::new(output, number, boundary, camera))
            .collect();
        self.drawers
            .resize_with(self.drawers.len().max(areas.len()), Drawer::default);
        let tasks = self.drawers.par_iter_mut().zip(&areas).with_max_len(1);
        let drawn: Vec<_> = tasks
            .map(|(drawer, area)| area.draw(drawer, settings))
            .collect();
        for (area, (frame, backdrop_stats)) in areas.iter().zip(drawn) {
            area.copy(frame, backdrop_stats, output, stats);
        }
    }
}

impl<'a> BackdropArea<'a> {
    fn new(
        output: &RasterOutput,
        number: u32,
        boundary: &'a BackdropPortal,
        camera: &Camera,
    ) -> Option<Self> {
        let [columns, rows] = marker_bounds(output, number, &boundary.window)?;
        Some(Self {
            number,
            backdrop: &boundary.backdrop,
            camera: camera.cropped(columns.clone(), rows.clone()).ok()?,
            columns,
            rows,
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

    /// Copies the drawn backdrop into the marker's pixels, and adds its statistics.
    fn copy(
        &self,
        drawn: &Frame,
        backdrop_stats: BackdropStats,
        output: &mut RasterOutput,
        stats: &mut WalkStats,
    ) {
        stats.portals += 1;
        stats.backdrop.samples += backdrop_stats.samples;
        stats.backdrop.depth_pixels_in += backdrop_stats.depth_pixels_in;
        stats.backdrop.splatted += backdrop_stats.splatted;
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

fn marker(house: &House, number: u32, boundary: &BackdropPortal) -> Option<Marker> {
    Some(Marker {
        polygon: boundary.at.opening(house)?.corners,
        number,
    })
}

/// Returns the bounding rectangle of a marker's pixels inside a window; `None` if there are none.
fn marker_bounds(
    output: &RasterOutput,
    number: u32,
    [columns, rows]: &[Range<u32>; 2],
) -> Option<[Range<u32>; 2]> {
    let mut bounds: Option<[Range<u32>; 2]> = None;
    for y in rows.clone() {
        let start = y as usize * output.frame.width as usize;
        let shows = |x: &u32| output.seen(start + *x as usize) == PixelContent::Marker(number);
        let first = columns.clone().find(shows);
        let last = columns.clone().rev().find(shows);
        if let (Some(first), Some(last)) = (first, last) {
            let row = [first..last + 1, y..y + 1];
            bounds = Some(bounds.map_or(row.clone(), |bounds| union(&bounds, &row)));
        }
    }
    bounds
}

/// Fills holes with the colours of the last frame, if it has the same size.
fn persist(output: &mut RasterOutput, previous: &Frame, camera: &Camera) {
    if (previous.width, previous.height) != (camera.width(), camera.height()) {
        return;
    }
    let frame = &mut output.frame;
    let pixels = frame.color.iter_mut().zip(&frame.coverage);
    for ((color, coverage), old) in pixels.zip(&previous.color) {
        if coverage.is_hole() {
            *color = *old;
        }
    }
}
