//! A z-buffer rasteriser on the CPU: the geometry of the view cell and of cells too near for an
//! image (R3, R15).
//!
//! A frame is drawn in bands of rows, each by one thread from its first triangle to its last pixel:
//!
//! 1. `mesh`: triangles in clusters of at most 128, each with a box; clusters outside the window
//!    are dropped (`cull`; not those that nearer ones hide, see docs/decisions/0025);
//! 2. `cluster`, `view`: the vertices of a cluster are projected, 16 at a time, and snapped to
//!    1/256 px; triangles that reach behind the eye or far outside the frame are clipped (`clip`);
//! 3. `scan`: exact integer edge functions, so that no crack is left between neighbours; each pixel
//!    stores the depth and the number of its triangle, nothing else;
//! 4. `shade`: once per pixel at the end, triangle after triangle: perspective-correct weights
//!    (`weights`), colours, textures at the mip level of the frame (`mip`), tone curve and sRGB
//!    (`headbox_core::color::srgb_table`).
//!
//! Positions are IEEE `f32` in a fixed order of operations, the rest of coverage is integers: the
//! output has the same bytes with any number of threads and bands, and at any SIMD level.

mod clip;
mod cluster;
mod coplanar;
mod cull;
mod mesh;
mod mip;
mod scan;
mod shade;
mod view;
mod weights;

pub use mesh::RasterMesh;

use cull::VisibleCluster;
use fearless_simd::prelude::*;
use fearless_simd::{Level, u32x16};
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::color::srgb_table::SrgbTable;
use headbox_core::color::tone::ToneMap;
use headbox_core::environment::Environment;
use headbox_core::frame::{Coverage, Frame};
use headbox_core::simd;
use rayon::prelude::*;
use scan::{DrawnRows, DrawnTriangle};
use std::ops::Range;
use std::time::Instant;
use view::LocalCamera;

/// Number of pixels that are tested, or coloured, at once.
const LANES: usize = 16;

/// Content of a pixel of a [`RasterOutput`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PixelContent {
    /// No surface: the environment, or a hole.
    Nothing,
    /// A triangle of the scene.
    Triangle(u32),
    /// A [`Marker`].
    Marker(u32),
}

/// 32-bit encoding of a [`PixelContent`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(transparent)]
pub(crate) struct SurfaceId(u32);

impl SurfaceId {
    const NOTHING: Self = Self(u32::MAX);
    const MARKER: u32 = 1 << 31;

    /// Maximum number of triangles of a mesh.
    const MAX_TRIANGLES: u32 = Self::MARKER;

    fn marker(number: u32) -> Self {
        Self(Self::MARKER | number.min(Self::MARKER - 2))
    }

    /// Returns true if `pixels` are at least [`LANES`] and the first [`LANES`] show triangles.
    #[inline(always)]
    fn are_triangles<S: Simd>(simd: S, pixels: &[Self]) -> bool {
        let ids = bytemuck::cast_slice(pixels).first_chunk::<LANES>();
        ids.is_some_and(|ids| {
            u32x16::load_array_ref(simd, ids)
                .simd_lt(Self::MARKER)
                .all_true()
        })
    }

    /// Bit mask of the pixels that show this surface, among `count` pixels (at most [`LANES`]) from
    /// index `start` on.
    #[inline(always)]
    fn shown_in<S: Simd>(self, simd: S, pixels: &[Self], start: usize, count: u32) -> u32 {
        let ids: &[u32] = bytemuck::cast_slice(pixels.get(start..).unwrap_or_default());
        let shown = match ids.first_chunk::<LANES>() {
            Some(ids) => u32x16::load_array_ref(simd, ids)
                .simd_eq(self.0)
                .to_bitmask() as u32,
            None => ids
                .iter()
                .rev()
                .fold(0, |bits, id| bits << 1 | u32::from(*id == self.0)),
        };
        shown & ((1u32 << count.min(LANES as u32)) - 1)
    }

    #[inline]
    fn content(self) -> PixelContent {
        match self.0 {
            u32::MAX => PixelContent::Nothing,
            id if id & Self::MARKER != 0 => PixelContent::Marker(id & !Self::MARKER),
            id => PixelContent::Triangle(id),
        }
    }
}

/// A group of the mesh's triangles to be drawn, and the part of the frame that can show it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GroupWindow {
    /// Index of the group, as given to [`RasterMesh::new`].
    pub group: u32,
    /// Columns and rows of the frame outside of which the group need not be drawn; `None` for the
    /// whole frame.
    pub window: Option<[Range<u32>; 2]>,
}

/// A planar convex polygon that takes part in the depth test but has no colour: where it is
/// visible, the frame has a hole for the caller to fill. Portals are drawn as markers.
#[derive(Clone, Debug, PartialEq)]
pub struct Marker {
    /// Corners, world metres.
    pub polygon: Vec<DVec3>,
    /// Number of the marker in [`PixelContent::Marker`]; below 2^31 - 1.
    pub number: u32,
}

/// Input of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct RasterView<'a> {
    /// Groups of triangles; front to back is fastest.
    pub groups: &'a [GroupWindow],
    /// Polygons without colour.
    pub markers: &'a [Marker],
    /// Factor from linear colour to the argument of `tone`.
    pub exposure: f32,
    /// Tone curve of surfaces; the environment's colours are final.
    pub tone: ToneMap,
    /// Colour of pixels that show neither a surface nor the environment, sRGB.
    pub hole_color_srgb: [u8; 3],
}

/// A drawn frame.
#[derive(Clone, Debug, Default)]
pub struct RasterOutput {
    /// Colours and coverage; pixels that show a marker are holes.
    pub frame: Frame,
    /// 1 / eye depth of each pixel, 1/m; 0 where there is no surface.
    pub inverse_depth: Vec<f32>,
    surface: Vec<SurfaceId>,
}

impl RasterOutput {
    /// Returns the content of the pixel at this index (row-major).
    #[inline]
    pub fn seen(&self, pixel: usize) -> PixelContent {
        self.surface
            .get(pixel)
            .map_or(PixelContent::Nothing, |id| id.content())
    }
}

/// Statistics of a frame. Counts are sums over bands.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct RasterStats {
    /// Triangles of the requested groups.
    pub triangles_in: u64,
    /// Triangles in clusters that may be visible.
    pub triangles_kept: u64,
    /// Triangles that were set up: their bounding box contains a pixel centre.
    pub triangles_set_up: u64,
    /// Pixels that passed the depth test.
    pub pixels_written: u64,
    /// Pixels that show a marker.
    pub marker_pixels: u64,
    /// Wall-clock time of the whole frame, ms.
    pub frame_ms: f64,
}

/// Draws frames; owns its buffers.
pub struct Rasterizer {
    level: Level,
    /// Rows of a band, or 0 for [`BANDS_PER_THREAD`] bands; any number gives the same frame.
    band_rows: u32,
    output: RasterOutput,
    stats: RasterStats,
    visible: Vec<VisibleCluster>,
    /// For each band, the triangles that were drawn into it.
    drawn: Vec<Vec<DrawnTriangle>>,
}

impl Default for Rasterizer {
    fn default() -> Self {
        Self::new()
    }
}

/// Number of bands per thread: few, as a cluster is projected once for each band that it touches,
/// but enough to balance the load.
const BANDS_PER_THREAD: u32 = 3;

impl Rasterizer {
    /// Creates a rasteriser with the best SIMD level and the default number of bands.
    pub fn new() -> Self {
        Self::with(simd::level(), 0)
    }

    /// Creates a rasteriser with a SIMD level and bands of `band_rows` rows (0: the default). All
    /// combinations give the same frame.
    pub fn with(level: Level, band_rows: u32) -> Self {
        Self {
            level,
            band_rows,
            output: RasterOutput::default(),
            stats: RasterStats::default(),
            visible: Vec::new(),
            drawn: Vec::new(),
        }
    }

    /// Returns the last frame.
    pub fn output(&self) -> &RasterOutput {
        &self.output
    }

    /// Returns the last frame, to be completed where markers are visible.
    pub fn output_mut(&mut self) -> &mut RasterOutput {
        &mut self.output
    }

    /// Draws the requested groups over the environment, on the current rayon thread pool. Groups
    /// that the mesh does not have are skipped.
    pub fn draw(
        &mut self,
        mesh: &RasterMesh,
        camera: &Camera,
        request: &RasterView,
        environment: &Environment,
    ) -> (&RasterOutput, &RasterStats) {
        let started = Instant::now();
        let (width, height) = (camera.width(), camera.height());
        let count = width as usize * height as usize;
        let output = &mut self.output;
        output.frame.resize(width, height, false);
        output.inverse_depth.resize(count, 0.0);
        output.surface.resize(count, SurfaceId::NOTHING);

        let view = LocalCamera::new(camera, mesh.origin(), self.level);
        let triangles_in = cull::visible_clusters(mesh, &view, request.groups, &mut self.visible);
        let markers: Vec<_> = request
            .markers
            .iter()
            .map(|marker| (marker, clip::project_polygon(camera, marker)))
            .collect();

        let rows = match self.band_rows {
            0 => height.div_ceil(BANDS_PER_THREAD * rayon::current_num_threads() as u32),
            rows => rows.min(height),
        };
        let pixels = width as usize * rows as usize;
        let visible = &self.visible;
        self.drawn
            .resize_with(height.div_ceil(rows.max(1)) as usize, Vec::new);
        let colors = output
            .frame
            .color
            .par_chunks_mut(pixels)
            .zip(output.frame.coverage.par_chunks_mut(pixels));
        let depths = output
            .inverse_depth
            .par_chunks_mut(pixels)
            .zip(output.surface.par_chunks_mut(pixels));
        let shader = shade::PixelShader {
            mesh,
            view: &view,
            camera,
            environment,
            exposure: request.exposure,
            table: SrgbTable::get(request.tone),
        };
        let bands = colors
            .zip(depths)
            .zip(&mut self.drawn)
            .enumerate()
            .with_max_len(1);
        let drawn = bands.map(
            |(i, (((color, coverage), (inverse_depth, surface)), drawn))| {
                let [red, green, blue] = request.hole_color_srgb;
                color.fill([red, green, blue, 255]);
                coverage.fill(Coverage::HOLE);
                inverse_depth.fill(0.0);
                surface.fill(SurfaceId::NOTHING);
                drawn.clear();
                let start = i as u32 * rows;
                let band = start..start.saturating_add(rows).min(height);
                let mut target = DrawnRows {
                    width,
                    rows: band.clone(),
                    inverse_depth,
                    surface,
                    drawn,
                    stats: RasterStats::default(),
                };
                // Markers first, as occluders: at equal depth they lose against triangles.
                for (marker, triangles) in &markers {
                    triangles
                        .iter()
                        .for_each(|corners| view.draw_marker(*corners, marker.number, &mut target));
                }
                for cluster in visible.iter().filter(|cluster| cluster.touches(&band)) {
                    view.draw_cluster(mesh, cluster, &mut target);
                }
                shader.resolve(&mut target, color, coverage);
                target.stats
            },
        );
        self.stats = drawn.reduce(RasterStats::default, |a, b| RasterStats {
            triangles_set_up: a.triangles_set_up + b.triangles_set_up,
            pixels_written: a.pixels_written + b.pixels_written,
            marker_pixels: a.marker_pixels + b.marker_pixels,
            ..a
        });
        self.stats.triangles_in = triangles_in;
        self.stats.triangles_kept = self
            .visible
            .iter()
            .map(|cluster| u64::from(cluster.triangles))
            .sum();
        self.stats.frame_ms = started.elapsed().as_secs_f64() * 1e3;
        (&self.output, &self.stats)
    }
}
