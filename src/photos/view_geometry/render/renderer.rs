//! Renderer: runs the steps of a frame in order (E13), with buffers that are reused from frame to
//! frame.

use super::delaunay::Mesh;
use super::fuse::Grid;
use super::project::{Hit, Projection};
use super::rank::Ranked;
use super::scan::{BAND_ROWS, BandBuffers, Bins, MOST_CAMERAS, Scanner};
use super::texture::{Band, FramePainter};
use super::texture_camera::TextureCamera;
use crate::view_geometry::cameras::samples::Points;
use crate::view_geometry::render::fuse;
use crate::view_geometry::render::owners;
use crate::view_geometry::render::rank;
use crate::view_geometry::{EdgeRule, GeometrySettings, Texturing, ViewGeometry, WaitPolicy};
use fearless_simd::Level;
use headbox_core::camera::Camera;
use headbox_core::frame::Frame;
use headbox_core::simd;
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// Statistics of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct GeometryStats {
    /// Cameras that were valid for the frame.
    pub cameras_valid: u64,
    /// Cameras that were fused.
    pub cameras_used: u64,
    /// Images of better ranked cameras that are not in memory yet.
    pub pictures_missing: u64,
    /// Samples that were projected.
    pub samples: u64,
    /// Nodes with a sample.
    pub nodes: u64,
    /// Triangles that were drawn.
    pub triangles: u64,
    /// Number of edge flips from the lattice to the Delaunay mesh.
    pub flips: u64,
    /// Hole pixels.
    pub hole_pixels: u64,
    /// Time of ranking, ms. All times are wall times.
    pub rank_ms: f64,
    /// Time of waiting for images, ms.
    pub fetch_ms: f64,
    /// Time of projecting and fusing samples, ms.
    pub fuse_ms: f64,
    /// Time of triangulation, ms.
    pub mesh_ms: f64,
    /// Time from triangles to pixels, ms.
    pub texture_ms: f64,
    /// Time of the whole frame, ms.
    pub frame_ms: f64,
}

/// Renderer of view-dependent geometry, with its buffers.
pub struct GeometryRenderer {
    pub(super) level: Level,
    pub(crate) ranked: Vec<Ranked>,
    pub(super) hits: Vec<Vec<Hit>>,
    pub(crate) grid: Grid,
    pub(crate) mesh: Mesh,
    pub(crate) bins: Bins,
    /// Spare buffers of bands.
    pub(super) buffers: Mutex<Vec<BandBuffers>>,
    pub(crate) frame: Frame,
    /// State of the last frame: its camera, the cameras that it used, by rank, and its edge rule.
    pub(crate) camera: Option<Camera>,
    pub(crate) used: Vec<u32>,
    pub(crate) edge: EdgeRule,
}

impl Default for GeometryRenderer {
    fn default() -> Self {
        Self::new()
    }
}

impl GeometryRenderer {
    /// Creates a renderer for the best SIMD level of this machine.
    pub fn new() -> Self {
        Self::with(simd::level())
    }

    /// Creates a renderer for a SIMD level. All levels give the same frame.
    pub fn with(level: Level) -> Self {
        Self {
            level,
            ranked: Vec::new(),
            hits: Vec::new(),
            grid: Grid::default(),
            mesh: Mesh::default(),
            bins: Bins::default(),
            buffers: Mutex::default(),
            frame: Frame::default(),
            camera: None,
            used: Vec::new(),
            edge: EdgeRule::new(1.0, 0.0),
        }
    }

    /// Returns the last frame.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// Returns the cameras of the last frame, the best first.
    pub fn used(&self) -> &[u32] {
        &self.used
    }

    /// Renders a frame on the current rayon thread pool; the same bytes on any number of threads,
    /// as long as the same images are in memory.
    pub fn render(
        &mut self,
        geometry: &ViewGeometry,
        camera: &Camera,
        settings: &GeometrySettings,
        wait: WaitPolicy,
    ) -> (&Frame, GeometryStats) {
        let started = Instant::now();
        let mut last = started;
        let mut lap = || {
            let now = Instant::now();
            (now - std::mem::replace(&mut last, now)).as_secs_f64() * 1e3
        };
        let mut stats = GeometryStats::default();
        rank::rank(
            &geometry.cameras,
            camera,
            geometry.origin,
            &settings.weights,
            &mut self.ranked,
        );
        stats.cameras_valid = self.ranked.len() as u64;
        stats.rank_ms = lap();
        let by_rank = self.ranked.iter().map(|ranked| ranked.camera);
        let (pictures, missing) =
            geometry
                .pictures
                .fetch(by_rank, settings.cameras.clamp(1, MOST_CAMERAS), wait);
        (stats.cameras_used, stats.pictures_missing) = (pictures.len() as u64, missing as u64);
        stats.fetch_ms = lap();
        let edge = EdgeRule::new(camera.focal_px() as f32, geometry.depth_noise);
        (self.edge, self.camera) = (edge, Some(*camera));
        self.used.clear();
        self.used.extend(pictures.iter().map(|(camera, _)| *camera));
        self.bins.clear();
        let textured = |(number, picture)| {
            let real = &geometry.cameras[number as usize];
            match settings.texturing {
                Texturing::Nearest => TextureCamera::pasted(real, picture, camera),
                _ => TextureCamera::new(real, picture, camera, &edge),
            }
        };
        let cameras: Vec<TextureCamera> = pictures.iter().cloned().map(textured).collect();
        if settings.texturing != Texturing::Nearest {
            let samples = pictures.iter().map(|(number, picture)| {
                let in_memory = &geometry.cameras[*number as usize].samples;
                let samples = picture.samples.as_ref().unwrap_or(in_memory);
                samples.of_level(settings.level)
            });
            let samples: Vec<Points> = samples.collect();
            stats.samples = samples.iter().map(|[x, ..]| x.len() as u64).sum();
            let projection = Projection::new(camera, geometry.origin, self.level);
            fuse::fuse(
                &mut self.grid,
                &mut self.hits,
                &samples,
                &projection,
                &edge,
                settings,
            );
            if settings.by_sight {
                owners::assign(&mut self.grid, &cameras);
            }
            stats.nodes = self.grid.sample_count() as u64;
            stats.fuse_ms = lap();
            self.mesh.triangulate(&self.grid);
            stats.triangles = self
                .bins
                .sort(&self.grid, self.mesh.triangles(), camera.height());
            stats.flips = self.mesh.flips;
            stats.mesh_ms = lap();
        }
        self.paint(&cameras, camera, settings);
        stats.texture_ms = lap();
        stats.hole_pixels = self.frame.hole_count();
        stats.frame_ms = started.elapsed().as_secs_f64() * 1e3;
        (&self.frame, stats)
    }

    fn paint(&mut self, cameras: &[TextureCamera], camera: &Camera, settings: &GeometrySettings) {
        let (width, height) = (camera.width(), camera.height());
        self.frame.reset(width, height, settings.hole_color_srgb);
        let painter = FramePainter {
            level: self.level,
            scanner: Scanner {
                grid: &self.grid,
                triangles: self.mesh.triangles(),
                bins: &self.bins,
                cameras,
                edge: &self.edge,
            },
            texturing: settings.texturing,
        };
        let pixels = width as usize * BAND_ROWS as usize;
        let bands = self
            .frame
            .color
            .par_chunks_mut(pixels)
            .zip(self.frame.coverage.par_chunks_mut(pixels))
            .zip(0..height.div_ceil(BAND_ROWS));
        let spare = || self.buffers.lock().unwrap_or_else(PoisonError::into_inner);
        bands.for_each(|((colors, coverage), number)| {
            let rows = number * BAND_ROWS..((number + 1) * BAND_ROWS).min(height);
            let mut buffers = spare().pop().unwrap_or_default();
            painter.paint(
                &mut Band {
                    number,
                    width,
                    rows,
                    colors,
                    coverage,
                },
                &mut buffers,
            );
            spare().push(buffers);
        });
    }
}
