//! Per-frame state that all bands share: segments in drawing order, footprint tables, plane
//! textures in view.

use super::clip::{Band, SegmentClip};
use super::order::{EyeInFace, LayerOrder, sort_segments};
use super::transfer::Transfer;
use crate::model::depth_bins::DepthBins;
use crate::model::validate::MAX_FACE_SIZE_PX;
use crate::pack::CubeLdi;
use crate::render::RenderSettings;
use crate::render::canvas::Tolerance;
use crate::render::canvas::depth;
use crate::render::canvas::surface_canvas::SurfaceCanvas;
use crate::render::footprint::size::{
    EllipseSize, PaperSize, SegmentSize, StampSize, TangentSize, TangentTable,
};
use crate::render::footprint::splat::SplatKernel;
use crate::render::footprint::tent;
use crate::render::planes::PlanesInView;
use fearless_simd::Level;
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::simd;

/// Per-frame state that all bands share.
pub struct FramePlan {
    pub(crate) level: Level,
    pub(crate) settings: RenderSettings,
    /// True if the inverse depth of every pixel is read, not only near holes.
    pub(crate) reads_all_depths: bool,
    pub(crate) face_px: u32,
    order: Vec<usize>,
    /// In drawing order.
    segments: Vec<SegmentPlan>,
    /// One for each of `segments`, if the kernel is the paper's.
    paper_sizes: Vec<PaperSize>,
    tangent_table: TangentTable,
    pub(crate) tolerance: Tolerance,
    pub(crate) planes: PlanesInView,
}

/// A segment under the frame's camera.
pub struct SegmentPlan {
    /// Index in [`CubeLdi::segments`].
    pub index: usize,
    /// From the segment's face to the frame.
    pub transfer: Transfer,
    /// The camera's eye.
    pub eye: EyeInFace,
    pub(crate) layers: LayerOrder,
}

impl Default for FramePlan {
    fn default() -> Self {
        Self::with_level(simd::level())
    }
}

impl FramePlan {
    /// Creates an empty plan for a SIMD level of this machine.
    pub(crate) fn with_level(level: Level) -> Self {
        Self {
            level,
            settings: RenderSettings::default(),
            reads_all_depths: false,
            face_px: 0,
            order: Vec::new(),
            segments: Vec::new(),
            paper_sizes: Vec::new(),
            tangent_table: TangentTable::default(),
            tolerance: Tolerance::default(),
            planes: PlanesInView::default(),
        }
    }

    /// Prepares a frame, reusing the memory of the last one.
    pub fn prepare(&mut self, cube: &CubeLdi, camera: &Camera, settings: &RenderSettings) {
        let face_px = cube.face_size_px.min(MAX_FACE_SIZE_PX);
        let eye_from_centre = camera.eye() - cube.info.centre;
        let kernel = settings.kernel;
        self.settings = *settings;
        self.face_px = face_px;
        sort_segments(&cube.segments, eye_from_centre, &mut self.order);
        // From the centre, drawing order is memory order.
        let ordered_for = if kernel.needs_order() || settings.depth {
            eye_from_centre
        } else {
            DVec3::ZERO
        };
        self.segments.clear();
        self.segments.extend(self.order.iter().map(|&index| {
            let segment = &cube.segments[index];
            let eye = EyeInFace::new(ordered_for, segment.face, face_px);
            SegmentPlan {
                index,
                transfer: Transfer::new(camera, eye_from_centre, segment.face, face_px),
                layers: eye.layer_order(segment),
                eye,
            }
        }));
        self.tolerance = Tolerance {
            relative: SurfaceCanvas::tolerance(face_px),
            least: DepthBins::new(cube.info.half_size_m, face_px).inverse_depth(1.0) as f32,
        };
        self.planes
            .prepare(&cube.planes, camera, eye_from_centre, face_px);
        self.prepare_sizes(cube, camera);
    }

    fn prepare_sizes(&mut self, cube: &CubeLdi, camera: &Camera) {
        let layout = cube.layout;
        let face_px = self.face_px;
        let mut refill = |scale, min_radius_px| {
            self.tangent_table
                .refill(layout, face_px, scale, min_radius_px);
        };
        match self.settings.kernel {
            SplatKernel::Tent => refill(1.0, tent::MIN_RADIUS_PX),
            SplatKernel::Ellipse => refill(EllipseSize::SCALE, 0.0),
            // A rectangle is as wide as the spacing; 15 % more closes the cracks that quantised
            // normals open.
            SplatKernel::Opaque => refill(0.575, 0.5),
            SplatKernel::Point
            | SplatKernel::Plus
            | SplatKernel::Square2
            | SplatKernel::Square3 => {}
            SplatKernel::Paper => {
                let count = self.order.len().max(self.paper_sizes.len());
                self.paper_sizes.resize_with(count, PaperSize::new);
                for (&index, size) in self.order.iter().zip(&mut self.paper_sizes) {
                    size.refill(camera, &cube.segments[index], layout, face_px);
                }
            }
        }
    }

    /// Returns the face size, px.
    pub fn face_px(&self) -> u32 {
        self.face_px
    }

    /// Returns true if the kernel's canvas compares and stores the depths of splats.
    pub fn compares_depths(&self) -> bool {
        self.settings.kernel.compares_depths()
    }

    /// Returns the excess, px, of a splat's depth over its radius; 0 if the frame has no depths.
    pub fn depth_border_px(&self) -> f64 {
        if self.settings.depth {
            f64::from(depth::BORDER)
        } else {
            0.0
        }
    }

    /// Returns the cube's segments in drawing order.
    pub fn segments(&self) -> &[SegmentPlan] {
        &self.segments
    }

    /// Returns the clipping of the `i`th segment in drawing order against a band.
    pub fn clip<'a>(&'a self, cube: &'a CubeLdi, i: usize, band: &'a Band) -> SegmentClip<'a> {
        let planned = &self.segments[i];
        SegmentClip {
            transfer: &planned.transfer,
            segment: &cube.segments[planned.index],
            band,
            face_px: self.face_px,
            size: self.segment_size(i),
            unclipped: self.settings.unclipped,
        }
    }

    /// Returns the footprint size computation of the `i`th segment in drawing order.
    pub(crate) fn segment_size(&self, i: usize) -> SegmentSize<'_> {
        let tangent = || TangentSize::new(&self.tangent_table, &self.segments[i].transfer);
        let stamp = |radius_px| SegmentSize::Stamp(StampSize { radius_px });
        match self.settings.kernel {
            SplatKernel::Tent | SplatKernel::Opaque => SegmentSize::Tangent(tangent()),
            SplatKernel::Ellipse => SegmentSize::Ellipse(EllipseSize(tangent())),
            SplatKernel::Paper => SegmentSize::Paper(&self.paper_sizes[i]),
            SplatKernel::Point => stamp(0.5),
            SplatKernel::Square2 => stamp(1.0),
            SplatKernel::Plus | SplatKernel::Square3 => stamp(1.5),
        }
    }
}
