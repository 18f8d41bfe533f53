//! Footprint sizes of samples in the frame.

use crate::pack::splat_index::{DEPTH_CODE_COUNT, SPLAT_INDEX_COUNT};
use crate::pack::{PackedSegment, SplatIndexLayout};
use crate::render::setup::transfer::Transfer;
use fearless_simd::{ExtractToken, Simd, f32x16, prelude::*, u32x16};
use glam::{DVec3, Vec3};
use headbox_core::camera::Camera;

/// Samples that are processed at once.
pub(crate) const LANES: usize = 16;

/// Warped samples, input of the size computation.
pub(crate) struct SampleLanes<S: Simd> {
    /// (X w, Y w, w) from the principal point; see [`Transfer`].
    pub(crate) homogeneous: [f32x16<S>; 3],
    /// 1 / w.
    pub(crate) reciprocal_w: f32x16<S>,
    /// Inverse depth in the LDI, 1/m.
    pub(crate) inverse_depth: f32x16<S>,
    /// Column on the face, px.
    pub(crate) x: f32x16<S>,
    /// Row on the face, px, common to all lanes.
    pub(crate) y: f32,
    /// Surface normals.
    pub(crate) normals: Normals<S>,
}

/// Surface normals of samples.
pub(crate) enum Normals<S: Simd> {
    /// Splat indices of 11 bits.
    Index(u32x16<S>),
    /// Unit vectors in the face's frame, with the splat indices of 11 bits.
    Exact {
        normal: [f32x16<S>; 3],
        index: u32x16<S>,
    },
}

impl<S: Simd> Normals<S> {
    #[inline]
    fn indices(&self) -> [u32; LANES] {
        match self {
            Self::Index(index) | Self::Exact { index, .. } => index.to_array(),
        }
    }
}

/// Footprints of samples; see [`Splats`](super::splat::Splats).
pub(crate) struct FootprintLanes<S: Simd> {
    pub(crate) radius_x: f32x16<S>,
    pub(crate) radius_y: f32x16<S>,
    pub(crate) weight: f32x16<S>,
    /// Correlation of x and y of elliptical footprints.
    pub(crate) correlation: f32x16<S>,
}

impl<S: Simd> FootprintLanes<S> {
    /// Creates squares of weight 1.
    #[inline(always)]
    fn from_squares(radius: f32x16<S>) -> Self {
        let simd = radius.token();
        Self {
            radius_x: radius,
            radius_y: radius,
            weight: f32x16::splat(simd, 1.0),
            correlation: f32x16::splat(simd, 0.0),
        }
    }
}

/// A footprint size computation. Its work on lanes is inlined into the warp kernel, for every SIMD
/// level.
pub(crate) trait FootprintSize {
    /// True for elliptical footprints, whose correlations are written.
    const IS_ELLIPTICAL: bool = false;

    /// Upper bound of all radii, px.
    const MAX_RADIUS_PX: f32;

    /// Returns an upper bound of the radii, px, of samples of at most the inverse depth `q` and at
    /// least the depth ratio `w`, in a frame of the given size.
    fn radius_bound_px(&self, transfer: &Transfer, q: f64, w: f64, frame_px: [u32; 2]) -> f64;

    /// Computes the footprints of samples; undefined for samples behind the eye.
    fn footprints<S: Simd>(&self, simd: S, lanes: &SampleLanes<S>) -> FootprintLanes<S>;
}

/// Footprint size computation of the frame's kernel, for one segment.
pub(crate) enum SegmentSize<'a> {
    Tangent(TangentSize<'a>),
    Ellipse(EllipseSize<'a>),
    Paper(&'a PaperSize),
    Stamp(StampSize),
}

impl SegmentSize<'_> {
    /// Returns [`FootprintSize::MAX_RADIUS_PX`].
    pub(crate) fn max_radius_px(&self) -> f32 {
        match self {
            Self::Tangent(_) => TangentSize::MAX_RADIUS_PX,
            Self::Ellipse(_) => EllipseSize::MAX_RADIUS_PX,
            Self::Paper(_) => PaperSize::MAX_RADIUS_PX,
            Self::Stamp(_) => StampSize::MAX_RADIUS_PX,
        }
    }

    /// Returns [`FootprintSize::radius_bound_px`].
    pub(crate) fn radius_bound_px(
        &self,
        transfer: &Transfer,
        q: f64,
        w: f64,
        frame_px: [u32; 2],
    ) -> f64 {
        match self {
            Self::Tangent(size) => size.radius_bound_px(transfer, q, w, frame_px),
            Self::Ellipse(size) => size.radius_bound_px(transfer, q, w, frame_px),
            Self::Paper(size) => size.radius_bound_px(transfer, q, w, frame_px),
            Self::Stamp(size) => size.radius_bound_px(transfer, q, w, frame_px),
        }
    }
}

/// Size table of the paper: 2,048 widths, refilled for every segment of every frame (S20,
/// corrected: C10).
///
/// `sqrt(size) = (1 / w) (f2 / f1) sqrt(cos phi2 / cos phi1)`, phi = angle between the normal and a
/// camera's axis. With [`SplatIndexLayout::Paper`] the table is multiplied by the eye depth of the
/// index's depth code, and the width is the entry times the inverse depth in the frame, as in the
/// paper.
pub(crate) struct PaperSize {
    widths: Box<[f32; SPLAT_INDEX_COUNT]>,
    layout: SplatIndexLayout,
}

impl PaperSize {
    /// Lower bound of cosines: the width of a surface seen edge-on is undefined.
    const MIN_COSINE: f32 = 0.1;

    pub(crate) fn new() -> Self {
        Self {
            widths: Box::new([0.0; SPLAT_INDEX_COUNT]),
            layout: SplatIndexLayout::Paper,
        }
    }

    /// Refills the table.
    pub(crate) fn refill(
        &mut self,
        camera: &Camera,
        segment: &PackedSegment,
        layout: SplatIndexLayout,
        face_px: u32,
    ) {
        self.layout = layout;
        let ratio = (camera.focal_px() / (f64::from(face_px) / 2.0)) as f32;
        let back_in_face =
            (segment.face.world_from_eye().transpose() * -camera.forward()).as_vec3();
        let width = |index: u32| {
            let normal = layout.normal(index);
            let cos1 = normal.z.max(Self::MIN_COSINE);
            let cos2 = normal.dot(back_in_face).max(Self::MIN_COSINE);
            ratio * (cos2 / cos1).sqrt()
        };
        let range = segment.depth_code_range();
        let code_depths: [f32; DEPTH_CODE_COUNT] =
            std::array::from_fn(|code| range.decode(code) as f32);
        let depths: &[f32] = match layout {
            SplatIndexLayout::Paper => &code_depths,
            SplatIndexLayout::Normal => &[1.0],
        };
        for (i, entries) in self.widths.chunks_exact_mut(depths.len()).enumerate() {
            let width = width((i * depths.len()) as u32);
            for (entry, depth) in entries.iter_mut().zip(depths) {
                *entry = width * depth;
            }
        }
    }
}

impl FootprintSize for PaperSize {
    const MAX_RADIUS_PX: f32 = 3.5;

    fn radius_bound_px(&self, _: &Transfer, _: f64, _: f64, _: [u32; 2]) -> f64 {
        f64::from(Self::MAX_RADIUS_PX)
    }

    /// Squares of 1, 3, 5 or 7 pixels: the smallest at least as wide as the sample. Rounding to the
    /// nearest, as in C10, leaves cracks.
    #[inline(always)]
    fn footprints<S: Simd>(&self, simd: S, lanes: &SampleLanes<S>) -> FootprintLanes<S> {
        let mut width = [0.0; LANES];
        for (width, index) in width.iter_mut().zip(lanes.normals.indices()) {
            *width = self.widths[index as usize % SPLAT_INDEX_COUNT];
        }
        let mut width = f32x16::load_array(simd, width) * lanes.reciprocal_w;
        if self.layout == SplatIndexLayout::Paper {
            width *= lanes.inverse_depth;
        }
        let radius = ((width - 1.0) * 0.5)
            .ceil()
            .max_precise(0.0)
            .min_precise(3.0)
            + 0.5;
        FootprintLanes::from_squares(radius)
    }
}

/// Stamps of one size for all samples (R7).
pub(crate) struct StampSize {
    pub(crate) radius_px: f32,
}

impl FootprintSize for StampSize {
    const MAX_RADIUS_PX: f32 = 1.5;

    fn radius_bound_px(&self, _: &Transfer, _: f64, _: f64, _: [u32; 2]) -> f64 {
        f64::from(self.radius_px)
    }

    #[inline(always)]
    fn footprints<S: Simd>(&self, simd: S, _: &SampleLanes<S>) -> FootprintLanes<S> {
        FootprintLanes::from_squares(f32x16::splat(simd, self.radius_px))
    }
}

/// Exact sizes from the tangent plane (the differential that S20 approximates).
///
/// On the plane through the sample with normal n, the inverse depth is proportional to n . ray(x,
/// y), which is linear in the face position (x, y). So `dq/dx = q (n . ray)_x / (n . ray)`, and the
/// derivative of the transfer follows: the frame positions of the adjacent samples of the same
/// surface, in x and y, to first order. The radii are the lengths of the rows of this 2x2 Jacobian,
/// which do not change when the face's grid is rotated in the frame.
///
/// A footprint weighs as much as the area between adjacent samples has of the rectangle of the
/// radii, so that the weights of a surface add up to 1. Of a surface that the view stretches there
/// are few samples, whose tents fall off far before its ends: they weigh more, by the root of the
/// ratio of the radii, but at most 1 (docs/decisions/0079).
///
/// The angles of [`PaperSize`] fail for a floor seen through a side face (both cosines are 0).
/// Gain: docs/decisions/0048.
pub(crate) struct TangentSize<'a> {
    table: &'a TangentTable,
    x_step: Vec3,
    y_step: Vec3,
    per_inverse_depth: Vec3,
}

/// View-independent part of [`TangentSize`]: the planes of all splat indices.
pub(crate) struct TangentTable {
    /// n . ray(x, y) = plane.x * x + plane.y * y + plane.z
    planes: Box<[Vec3; SPLAT_INDEX_COUNT]>,
    /// Size of a pixel on a face of width 2.
    step: f32,
    max_slope: f32,
    scale: f32,
    min_radius_px: f32,
}

impl Default for TangentTable {
    fn default() -> Self {
        Self {
            planes: Box::new([Vec3::ZERO; SPLAT_INDEX_COUNT]),
            step: 0.0,
            max_slope: 0.0,
            scale: 1.0,
            min_radius_px: 0.0,
        }
    }
}

impl TangentTable {
    /// Upper bound of the relative change of inverse depth over one face pixel, times half the
    /// face's size: the tangent of the angle to the surface's normal. Beyond it (85 degrees) the
    /// quantised normal is unreliable. With a smaller bound, a floor that the centre sees edge-on
    /// has gaps between its rows, which no ray can fill, when seen from above.
    pub(super) const MAX_SLOPE: f32 = 12.0;

    /// Fills the table. Radii are the spacing of the samples times `scale`, at least
    /// `min_radius_px`.
    pub(crate) fn refill(
        &mut self,
        layout: SplatIndexLayout,
        face_px: u32,
        scale: f32,
        min_radius_px: f32,
    ) {
        let step = 2.0 / face_px as f32;
        for (i, plane) in self.planes.iter_mut().enumerate() {
            let n = layout.normal(i as u32);
            *plane = Vec3::new(n.x * step, -n.y * step, -n.x + n.y - n.z);
        }
        self.step = step;
        self.max_slope = Self::MAX_SLOPE * step;
        self.scale = scale;
        self.min_radius_px = min_radius_px;
    }
}

impl<'a> TangentSize<'a> {
    /// Creates the computation for one segment.
    pub(crate) fn new(table: &'a TangentTable, transfer: &Transfer) -> Self {
        Self {
            table,
            x_step: transfer.x_step.as_vec3(),
            y_step: transfer.y_step.as_vec3(),
            per_inverse_depth: transfer.inverse_depth.as_vec3(),
        }
    }
}

impl FootprintSize for TangentSize<'_> {
    const MAX_RADIUS_PX: f32 = 32.0;

    /// Bounds each term of [`Self::footprints`]; slopes are clamped, and positions lie in the frame
    /// or at most a radius outside.
    fn radius_bound_px(&self, transfer: &Transfer, q: f64, w: f64, frame_px: [u32; 2]) -> f64 {
        let max_px = f64::from(Self::MAX_RADIUS_PX);
        if w <= 0.0 {
            return max_px;
        }
        let slope = transfer.inverse_depth.abs() * (q * f64::from(self.table.max_slope));
        let [along_x, along_y] = [transfer.x_step, transfer.y_step].map(|step| step.abs() + slope);
        let radius = |axis: usize| {
            let reach = f64::from(frame_px[axis]) / 2.0 + max_px;
            let along = |step: DVec3| (step[axis] + reach * step.z) / w;
            along(along_x).hypot(along(along_y)) * f64::from(self.table.scale)
        };
        // Slightly more than f32 rounding can add.
        (radius(0).max(radius(1)) * (1.0 + 1e-5))
            .max(f64::from(self.table.min_radius_px))
            .min(max_px)
    }

    #[inline(always)]
    fn footprints<S: Simd>(&self, simd: S, lanes: &SampleLanes<S>) -> FootprintLanes<S> {
        let [[xx, xy], [yx, yy]] = self.jacobian(simd, lanes);
        let radius_x = self.radius(xx, xy);
        let radius_y = self.radius(yx, yy);
        let area = (xx * yy - xy * yx).abs();
        let shorter = radius_x.min_precise(radius_y);
        let weight = (area / (shorter * (radius_x * radius_y).sqrt())).min_precise(1.0);
        FootprintLanes {
            radius_x,
            radius_y,
            weight,
            correlation: f32x16::splat(simd, 0.0),
        }
    }
}

impl TangentSize<'_> {
    /// Returns the length of a row of the Jacobian, scaled and clamped to the bounds of radii.
    #[inline(always)]
    fn radius<S: Simd>(&self, along_x: f32x16<S>, along_y: f32x16<S>) -> f32x16<S> {
        let length = (along_x * along_x + along_y * along_y).sqrt();
        (length * self.table.scale)
            .max_precise(self.table.min_radius_px)
            .min_precise(Self::MAX_RADIUS_PX)
    }

    /// Returns the derivative of the frame position, px, along the columns and rows of the face:
    /// the row of x, and of y.
    #[inline(always)]
    fn jacobian<S: Simd>(&self, simd: S, lanes: &SampleLanes<S>) -> [[f32x16<S>; 2]; 2] {
        let [plane_x, plane_y, plane_z] = self.planes(simd, &lanes.normals);
        let reciprocal =
            f32x16::splat(simd, 1.0) / (plane_x * lanes.x + plane_y * lanes.y + plane_z);
        let max = self.table.max_slope;
        // The precise forms also turn the NaN of 0 / 0 into a number.
        let slope_x =
            (plane_x * reciprocal).min_precise(max).max_precise(-max) * lanes.inverse_depth;
        let slope_y =
            (plane_y * reciprocal).min_precise(max).max_precise(-max) * lanes.inverse_depth;
        let p = self.per_inverse_depth;
        let dx = self.x_step;
        let dy = self.y_step;
        let along_x = [
            slope_x * p.x + dx.x,
            slope_x * p.y + dx.y,
            slope_x * p.z + dx.z,
        ];
        let along_y = [
            slope_y * p.x + dy.x,
            slope_y * p.y + dy.y,
            slope_y * p.z + dy.z,
        ];
        let w = lanes.reciprocal_w;
        let x = lanes.homogeneous[0] * w;
        let y = lanes.homogeneous[1] * w;
        let row_x = [
            (along_x[0] - x * along_x[2]) * w,
            (along_y[0] - x * along_y[2]) * w,
        ];
        let row_y = [
            (along_x[1] - y * along_x[2]) * w,
            (along_y[1] - y * along_y[2]) * w,
        ];
        [row_x, row_y]
    }

    /// Returns the components of the planes; see [`TangentTable`].
    #[inline(always)]
    fn planes<S: Simd>(&self, simd: S, normals: &Normals<S>) -> [f32x16<S>; 3] {
        match normals {
            Normals::Index(index) => {
                let index = index.to_array();
                let mut xs = [0.0; LANES];
                let mut ys = [0.0; LANES];
                let mut zs = [0.0; LANES];
                for i in 0..LANES {
                    let plane = self.table.planes[index[i] as usize % SPLAT_INDEX_COUNT];
                    xs[i] = plane.x;
                    ys[i] = plane.y;
                    zs[i] = plane.z;
                }
                [
                    f32x16::load_array(simd, xs),
                    f32x16::load_array(simd, ys),
                    f32x16::load_array(simd, zs),
                ]
            }
            Normals::Exact {
                normal: [x, y, z], ..
            } => {
                let step = self.table.step;
                [*x * step, *y * -step, *y - *x - *z]
            }
        }
    }
}

/// Ellipses: Gaussians of half the sample spacing on the surface, mapped to the frame by the same
/// differential, and blurred by [`Self::BLUR_PX`] so that they do not fall between pixels
/// (Heckbert's elliptical weighted average).
pub(crate) struct EllipseSize<'a>(pub(crate) TangentSize<'a>);

impl EllipseSize<'_> {
    /// Radius of a footprint in standard deviations; the Gaussian is below 0.05 there.
    pub(crate) const DEVIATIONS: f32 = 2.5;
    /// Standard deviation of the Gaussian in sample spacings. A half ripples by 1.4 %, 2 exp(-2 (pi
    /// / 2)^2).
    const SPACINGS: f32 = 0.5;
    /// Radius of a footprint in sample spacings.
    pub(crate) const SCALE: f32 = Self::DEVIATIONS * Self::SPACINGS;
    /// Standard deviation of the blur, px.
    const BLUR_PX: f32 = 0.3;

    /// Returns the blurred radius of a row of the Jacobian.
    #[inline(always)]
    fn radius<S: Simd>(along_x: f32x16<S>, along_y: f32x16<S>) -> f32x16<S> {
        let scale = Self::SCALE * Self::SCALE;
        let blur = (Self::BLUR_PX * Self::DEVIATIONS).powi(2);
        ((along_x * along_x + along_y * along_y) * scale + blur)
            .sqrt()
            .min_precise(Self::MAX_RADIUS_PX)
    }
}

impl FootprintSize for EllipseSize<'_> {
    const IS_ELLIPTICAL: bool = true;
    const MAX_RADIUS_PX: f32 = TangentSize::MAX_RADIUS_PX;

    fn radius_bound_px(&self, transfer: &Transfer, q: f64, w: f64, frame_px: [u32; 2]) -> f64 {
        let blur = f64::from(Self::BLUR_PX * Self::DEVIATIONS) * (1.0 + 1e-5);
        self.0
            .radius_bound_px(transfer, q, w, frame_px)
            .hypot(blur)
            .min(f64::from(Self::MAX_RADIUS_PX))
    }

    #[inline(always)]
    fn footprints<S: Simd>(&self, simd: S, lanes: &SampleLanes<S>) -> FootprintLanes<S> {
        let [[xx, xy], [yx, yy]] = self.0.jacobian(simd, lanes);
        let scale = Self::SCALE * Self::SCALE;
        let radius_x = Self::radius(xx, xy);
        let radius_y = Self::radius(yx, yy);
        let area = (xx * yy - xy * yx).abs();
        let reciprocal = f32x16::splat(simd, 1.0) / (radius_x * radius_y);
        let correlation = (xx * yx + xy * yy) * scale * reciprocal;
        FootprintLanes {
            radius_x,
            radius_y,
            weight: area * reciprocal,
            correlation,
        }
    }
}

#[cfg(test)]
mod tests;
