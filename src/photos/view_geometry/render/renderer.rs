//! Frames: the steps in order (E13), each over buffers that stay from frame to frame.

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
    /// Pictures of better ranked cameras that were not at hand and are being decoded.
    pub pictures_missing: u64,
    /// Samples that were projected.
    pub samples: u64,
    /// Nodes that hold something.
    pub nodes: u64,
    /// Triangles that were drawn.
    pub triangles: u64,
    /// Edges that were flipped on the way from the lattice to Delaunay's mesh.
    pub flips: u64,
    /// Pixels of which nothing is known.
    pub hole_pixels: u64,
    /// Wall time of the stages, ms.
    pub rank_ms: f64,
    /// Waiting for pictures, if it was asked to.
    pub fetch_ms: f64,
    /// Projecting samples into the grid.
    pub fuse_ms: f64,
    /// Triangulating.
    pub mesh_ms: f64,
    /// From triangles to pixels.
    pub texture_ms: f64,
    /// All of them.
    pub frame_ms: f64,
}

/// Draws frames; owns its buffers.
pub struct GeometryRenderer {
    pub(super) level: Level,
    pub(crate) ranked: Vec<Ranked>,
    pub(super) hits: Vec<Vec<Hit>>,
    pub(crate) grid: Grid,
    pub(crate) mesh: Mesh,
    pub(crate) bins: Bins,
    /// Buffers of bands, reused by the next ones.
    pub(super) described: Mutex<Vec<BandBuffers>>,
    pub(crate) frame: Frame,
    /// State of the last frame: its camera, its cameras by rank, and the rule by which neighbours
    /// are separate surfaces.
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
    /// A renderer that has drawn nothing yet.
    pub fn new() -> Self {
        Self::with(simd::level())
    }

    /// One that uses a SIMD level. All give the same frame.
    pub fn with(level: Level) -> Self {
        Self {
            level,
            ranked: Vec::new(),
            hits: Vec::new(),
            grid: Grid::default(),
            mesh: Mesh::default(),
            bins: Bins::default(),
            described: Mutex::default(),
            frame: Frame::default(),
            camera: None,
            used: Vec::new(),
            edge: EdgeRule::new(1.0, 0.0),
        }
    }

    /// The last frame.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// The cameras of the last frame, the best first.
    pub fn used(&self) -> &[u32] {
        &self.used
    }

    /// Draws what `camera` sees, on the current rayon thread pool; the same bytes on any number of
    /// threads, as long as the same pictures are at hand.
    pub fn render(
        &mut self,
        geometry: &ViewGeometry,
        camera: &Camera,
        settings: &GeometrySettings,
        patience: WaitPolicy,
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
                .fetch(by_rank, settings.cameras.clamp(1, MOST_CAMERAS), patience);
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
            let points = |(number, _): &(u32, _)| {
                geometry.cameras[*number as usize]
                    .samples
                    .of_level(settings.level)
            };
            let samples: Vec<Points> = pictures.iter().map(points).collect();
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
                owners::settle(&mut self.grid, &cameras);
            }
            stats.nodes = self.grid.valid() as u64;
            stats.fuse_ms = lap();
            self.mesh.triangulate(&self.grid);
            stats.triangles = self
                .bins
                .sort(&self.grid, self.mesh.triangles(), camera.height());
            stats.flips = self.mesh.flips;
            stats.mesh_ms = lap();
        }
        self.paint(&cameras, camera, &edge, settings);
        stats.texture_ms = lap();
        stats.hole_pixels = self.frame.hole_count();
        stats.frame_ms = started.elapsed().as_secs_f64() * 1e3;
        (&self.frame, stats)
    }

    fn paint(
        &mut self,
        cameras: &[TextureCamera],
        camera: &Camera,
        edge: &EdgeRule,
        settings: &GeometrySettings,
    ) {
        let (width, height) = (camera.width(), camera.height());
        self.frame.reset(width, height, settings.hole_color_srgb);
        let Self {
            level,
            grid,
            mesh,
            bins,
            frame,
            ..
        } = self;
        let described = &self.described;
        let scanner = Scanner {
            grid,
            triangles: mesh.triangles(),
            bins,
            cameras,
            edge,
        };
        let painter = FramePainter {
            level: *level,
            scanner,
            texturing: settings.texturing,
        };
        let pixels = width as usize * BAND_ROWS as usize;
        let Frame {
            color, coverage, ..
        } = frame;
        let bands = color
            .par_chunks_mut(pixels)
            .zip(coverage.par_chunks_mut(pixels))
            .zip(0..height.div_ceil(BAND_ROWS));
        let spare = || described.lock().unwrap_or_else(PoisonError::into_inner);
        bands.for_each(|((colors, coverage), number)| {
            let rows = number * BAND_ROWS..((number + 1) * BAND_ROWS).min(height);
            let mut described = spare().pop().unwrap_or_default();
            painter.paint(
                &mut Band {
                    number,
                    width,
                    rows,
                    colors,
                    coverage,
                },
                &mut described,
            );
            spare().push(described);
        });
    }
}
