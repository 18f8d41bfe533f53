//! View-dependent geometry: many depth images shown without a global model (E4 to E13).
//!
//! For each frame anew: the cameras that serve it best are ranked (`rank`), their depth samples (`samples`) fused in a grid of the
//! frame (`fuse`), the grid's nodes triangulated (`delaunay`), and the triangles textured by the cameras' pictures (`picture`, `store`,
//! `texture`). Nothing needs to agree beyond what one frame shows, so that a long capture may drift, and a camera's data is at most read,
//! never merged. `oracle` does the same slowly, in `f64`, for tests.
//!
//! One owner for each thing: [`ViewGeometry`] has the cameras, their samples and the store of pictures, and does not change from frame to
//! frame but for the pictures at hand; [`GeometryRenderer`] has the grid, the mesh and the frame. The one invariant that the
//! steps share is the grid's: a node lies in its own cell.

#[cfg(test)]
mod castle;
mod delaunay;
mod fuse;
#[cfg(test)]
mod oracle;
mod picture;
mod rank;
mod samples;
mod store;
#[cfg(test)]
pub(crate) mod tests;
mod texture;

pub use rank::RankWeights;
pub use samples::SampleGrid;
pub use store::Patience;

use crate::capture::Camera;
use crate::capture::images::{ImageSet, ImagesError, Lens, LoadedView, Pinhole, Pose, View};
use crate::capture::scene::FileFrame;
use crate::frame::Frame;
use crate::progress::Progress;
use delaunay::Mesh;
use fuse::Grid;
use glam::DVec3;
use picture::Picture;
use rank::Ranked;
use rayon::prelude::*;
use samples::Samples;
use std::path::PathBuf;
use std::time::Instant;
use store::PictureStore;
use texture::{Band, Painter, TextureCamera};

/// Why there is no view-dependent geometry.
#[derive(Debug, thiserror::Error)]
pub enum GeometryError {
    /// A view could not be read.
    #[error(transparent)]
    Images(#[from] ImagesError),
    /// Nothing to draw from.
    #[error(
        "{}: none of its {views} views is a perspective picture with depth, which view-dependent geometry is made of",
        folder.display()
    )]
    NoCameras {
        /// The set.
        folder: PathBuf,
        /// Its views.
        views: usize,
    },
}

/// A camera that took a picture, and what its depth image was reduced to.
#[derive(Clone, Debug, PartialEq)]
pub struct RealCamera {
    /// Where it was, world metres.
    pub pose: Pose,
    /// Its ideal lens.
    pub lens: Pinhole,
    /// Takes no part in frames: what is judged is shown without itself.
    pub left_out: bool,
    samples: Samples,
}

impl RealCamera {
    /// Of a view in memory; `None` for a panorama. Samples are relative to `origin`, world metres.
    fn of_loaded(view: &LoadedView, grid: &SampleGrid, origin: DVec3) -> Option<Self> {
        let Lens::Pinhole(lens) = view.lens else { return None };
        Some(Self { pose: view.pose, lens, left_out: false, samples: Samples::new(view, grid, origin) })
    }

    /// Its viewing direction.
    fn forward(&self) -> DVec3 {
        -self.pose.world_from_eye.z_axis
    }

    /// (x w, y w, w) of a point or direction of its eye space, x and y in pixels.
    fn homogeneous(&self, p: DVec3) -> DVec3 {
        let Pinhole { focal_px, principal_px, .. } = self.lens;
        DVec3::new(focal_px[0] * p.x - principal_px[0] * p.z, -focal_px[1] * p.y - principal_px[1] * p.z, -p.z)
    }
}

/// How triangles are textured (E9).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub enum Texturing {
    /// The best camera's picture as it is, without depth: for comparison.
    Nearest,
    /// The best camera textures all that it sees.
    Single,
    /// Each triangle by the best ranked of its corners' cameras.
    Multi,
    /// Each triangle by all cameras of its corners, weighted by the corners.
    #[default]
    Blended,
    /// Each pixel by the mean of the best ranked cameras that see its point, whoever owns the corners.
    Averaged,
}

impl Texturing {
    /// Each with the name it has on the command line and in reports.
    pub const ALL: [(&str, Self); 5] = [
        ("geometry-nearest", Self::Nearest),
        ("geometry-single", Self::Single),
        ("geometry-multi", Self::Multi),
        ("geometry-blended", Self::Blended),
        ("geometry-averaged", Self::Averaged),
    ];

    /// The one of a name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.iter().find(|(known, _)| *known == name).map(|(_, texturing)| *texturing)
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(_, known)| *known == self).map_or("", |(name, _)| name)
    }
}

/// How frames are drawn: time against quality (E11).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct GeometrySettings {
    /// How triangles are textured.
    pub texturing: Texturing,
    /// Cameras whose samples are fused.
    pub cameras: usize,
    /// Level of detail of the samples, 0 the finest.
    pub level: u32,
    /// Pixels between nodes of the frame's grid.
    pub grid_px: f32,
    /// By which share of its distance a sample of a camera must be nearer than that of a better ranked one, to take its place.
    pub margin: f32,
    /// Holes of at most so many nodes are closed.
    pub close_nodes: u32,
    /// What makes a camera good.
    pub weights: RankWeights,
    /// Colour of pixels of which nothing is known, sRGB.
    pub hole_color_srgb: [u8; 3],
}

impl Default for GeometrySettings {
    fn default() -> Self {
        Self {
            texturing: Texturing::default(),
            cameras: 10,
            level: 0,
            grid_px: 4.0,
            margin: 0.02,
            close_nodes: 3,
            weights: RankWeights::default(),
            hole_color_srgb: [0; 3],
        }
    }
}

/// When two neighbours in a frame belong to different surfaces: if what lies between them would be seen at a grazing angle and is
/// no noise.
#[derive(Clone, Copy, Debug, PartialEq)]
struct EdgeRule {
    /// Share of inverse depth for a pixel.
    steepness: f32,
    /// 1/m.
    least: f32,
}

impl EdgeRule {
    /// The tangent of the angle between a surface and the frame from which on it is taken for a gap between two: 80 degrees.
    const STEEPEST: f32 = 5.67;

    /// For a frame of a focal length, and the standard deviation of inverse depths, 1/m.
    fn new(focal_px: f32, noise: f32) -> Self {
        Self { steepness: Self::STEEPEST / focal_px, least: 3.0 * noise }
    }

    /// The largest difference of inverse depths of one surface over a distance in the frame, 1/m.
    #[inline]
    fn most(&self, nearer: f32, length_px: f32) -> f32 {
        nearer * self.steepness * length_px + self.least
    }

    /// Whether two inverse depths are of different surfaces.
    #[inline]
    fn parts(&self, a: f32, b: f32, length_px: f32) -> bool {
        (a - b).abs() > self.most(a.max(b), length_px)
    }

    /// The difference that is never an edge, 1/m.
    #[inline]
    fn least(&self) -> f32 {
        self.least
    }
}

/// An image set ready to be walked through.
pub struct ViewGeometry {
    /// The cameras, in the set's order.
    cameras: Vec<RealCamera>,
    pictures: PictureStore,
    /// Of the samples, world metres.
    origin: DVec3,
    /// Standard deviation of inverse depths, 1/m.
    depth_noise: f32,
    /// How the set's positions map to the world.
    pub frame: FileFrame,
    folder: PathBuf,
}

impl ViewGeometry {
    /// Bytes of pictures that are kept in memory, if nothing else is asked for.
    pub const DEFAULT_BUDGET: usize = 1 << 30;

    /// Loads views (perspective pictures with depth; others are left out), samples their depth, and keeps as many of their pictures as
    /// fit into a budget of bytes.
    ///
    /// # Errors
    /// [`GeometryError`] of the first view that cannot be read, or if there is none to draw from.
    pub fn open(
        set: &ImageSet,
        views: &[&View],
        grid: &SampleGrid,
        budget: usize,
        progress: &dyn Progress,
    ) -> Result<Self, GeometryError> {
        let usable = |view: &&&View| matches!(view.lens, Lens::Pinhole(_)) && view.depth.is_some();
        let views: Vec<View> = views.iter().filter(usable).map(|view| (*view).clone()).collect();
        if views.is_empty() {
            return Err(GeometryError::NoCameras { folder: set.folder.clone(), views: set.views.len() });
        }
        let origin = views.iter().map(|view| view.pose.eye).sum::<DVec3>() / views.len() as f64;
        let pictures = PictureStore::new(views.clone(), budget);
        progress.begin("sampling depth", "images", views.len() as u64);
        let cameras: Result<Vec<Option<RealCamera>>, ImagesError> = views
            .par_iter()
            .zip(0..views.len() as u32)
            .map(|(view, number)| {
                let loaded = view.load()?;
                pictures.offer(number, || Picture::new(&loaded));
                progress.advance(1);
                Ok(RealCamera::of_loaded(&loaded, grid, origin))
            })
            .collect();
        let cameras = cameras?.into_iter().flatten().collect();
        let depth_noise = set.depth_noise();
        Ok(Self { cameras, pictures, origin, depth_noise, frame: set.frame, folder: set.folder.clone() })
    }

    /// The cameras.
    pub fn cameras(&self) -> &[RealCamera] {
        &self.cameras
    }

    /// Leaves out the cameras of these indices, and no others.
    pub fn leave_out(&mut self, left_out: &[usize]) {
        for (number, camera) in self.cameras.iter_mut().enumerate() {
            camera.left_out = left_out.contains(&number);
        }
    }

    /// Bytes in memory: samples, and the pictures at hand.
    pub fn bytes(&self) -> usize {
        self.cameras.iter().map(|camera| camera.samples.bytes()).sum::<usize>() + self.pictures.bytes()
    }

    /// Of pictures that cannot be read any more, why: a sentence each.
    pub fn lost(&self) -> Vec<String> {
        self.pictures.lost()
    }

    /// A sentence for a frame that no camera serves.
    pub fn nothing_seen(&self) -> String {
        format!(
            "none of the {} cameras of {} sees what this eye looks at, within its field of view: the frame is empty",
            self.cameras.len(),
            self.folder.display()
        )
    }
}

/// What a frame took.
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
    /// Of the stages, by the clock, ms.
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
#[derive(Default)]
pub struct GeometryRenderer {
    ranked: Vec<Ranked>,
    grid: Grid,
    mesh: Mesh,
    triangles: Vec<[u32; 3]>,
    frame: Frame,
}

/// Bands of rows for each thread: few, as each looks through all triangles, but enough to even out the work.
const BANDS_A_THREAD: u32 = 4;

impl GeometryRenderer {
    /// A renderer that has drawn nothing yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// The last frame.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// Draws what `camera` sees, on the current rayon thread pool; the same bytes on any number of threads, as long as the same
    /// pictures are at hand.
    pub fn render(
        &mut self,
        geometry: &ViewGeometry,
        camera: &Camera,
        settings: &GeometrySettings,
        patience: Patience,
    ) -> (&Frame, GeometryStats) {
        let started = Instant::now();
        let mut last = started;
        let mut lap = || {
            let now = Instant::now();
            (now - std::mem::replace(&mut last, now)).as_secs_f64() * 1e3
        };
        let mut stats = GeometryStats::default();
        rank::rank(&geometry.cameras, camera, geometry.origin, &settings.weights, &mut self.ranked);
        stats.cameras_valid = self.ranked.len() as u64;
        stats.rank_ms = lap();
        let by_rank = self.ranked.iter().map(|ranked| ranked.camera);
        let (pictures, missing) = geometry.pictures.fetch(by_rank, settings.cameras.max(1), patience);
        (stats.cameras_used, stats.pictures_missing) = (pictures.len() as u64, missing as u64);
        stats.fetch_ms = lap();
        let edge = EdgeRule::new(camera.focal_px() as f32, geometry.depth_noise);
        self.triangles.clear();
        if settings.texturing != Texturing::Nearest {
            let samples = |(number, _): &(u32, _)| geometry.cameras[*number as usize].samples.of_level(settings.level);
            stats.samples = pictures.iter().map(|picture| samples(picture).len() as u64).sum();
            fuse::fuse(&mut self.grid, pictures.iter().map(samples), camera, geometry.origin, &edge, settings);
            stats.nodes = self.grid.valid() as u64;
            stats.fuse_ms = lap();
            self.mesh.triangulate(&self.grid);
            self.triangles.extend(self.mesh.valid(&self.grid));
            (stats.flips, stats.triangles) = (self.mesh.flips, self.triangles.len() as u64);
            stats.mesh_ms = lap();
        }
        let textured = |(number, picture)| {
            let real = &geometry.cameras[number as usize];
            match settings.texturing {
                Texturing::Nearest => TextureCamera::pasted(real, picture, camera),
                _ => TextureCamera::new(real, picture, camera),
            }
        };
        let cameras: Vec<TextureCamera> = pictures.into_iter().map(textured).collect();
        self.paint(&cameras, camera, &edge, settings);
        stats.texture_ms = lap();
        stats.hole_pixels = self.frame.hole_count();
        stats.frame_ms = started.elapsed().as_secs_f64() * 1e3;
        (&self.frame, stats)
    }

    fn paint(&mut self, cameras: &[TextureCamera], camera: &Camera, edge: &EdgeRule, settings: &GeometrySettings) {
        let (width, height) = (camera.width(), camera.height());
        self.frame.reset(width, height, settings.hole_color_srgb);
        let rows = height.div_ceil(BANDS_A_THREAD * rayon::current_num_threads() as u32).max(1);
        let painter =
            Painter { grid: &self.grid, triangles: &self.triangles, cameras, texturing: settings.texturing, edge };
        let pixels = width as usize * rows as usize;
        let Frame { color, coverage, .. } = &mut self.frame;
        let bands = color.par_chunks_mut(pixels).zip(coverage.par_chunks_mut(pixels)).enumerate();
        bands.for_each(|(band, (colors, coverage))| {
            let rows = band as u32 * rows..((band as u32 + 1) * rows).min(height);
            painter.paint(&mut Band { width, rows, colors, coverage });
        });
    }
}
