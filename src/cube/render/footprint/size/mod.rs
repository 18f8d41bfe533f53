//! How large the footprint of a sample is in the frame.

use crate::pack::splat_index::{DEPTH_CODE_COUNT, SPLAT_INDEX_COUNT};
use crate::pack::{PackedSegment, SplatIndexLayout};
use crate::render::setup::transfer::Transfer;
use fearless_simd::{ExtractToken, Simd, f32x16, prelude::*, u32x16};
use glam::{DVec3, Vec3};
use headbox_core::camera::Camera;

/// Samples that are warped at a time.
pub(crate) const LANES: usize = 16;

/// Samples in the frame, as far as their sizes depend on it.
pub(crate) struct Lanes<S: Simd> {
    /// (X w, Y w, w) from the principal point; see [`Transfer`].
    pub(crate) homogeneous: [f32x16<S>; 3],
    /// 1 / w.
    pub(crate) reciprocal_w: f32x16<S>,
    /// Inverse depth in the LDI, 1/m.
    pub(crate) inverse_depth: f32x16<S>,
    /// Column on the face, px.
    pub(crate) x: f32x16<S>,
    /// Row on the face, px, the same for all.
    pub(crate) y: f32,
    pub(crate) normals: Normals<S>,
}

/// The normals of lanes.
pub(crate) enum Normals<S: Simd> {
    /// As the 11 bits say.
    Index(u32x16<S>),
    /// Unit vectors in the face's frame, and the 11 bits beside them.
    Exact {
        normal: [f32x16<S>; 3],
        index: u32x16<S>,
    },
}

impl<S: Simd> Normals<S> {
    #[inline]
    fn index(&self) -> [u32; LANES] {
        match self {
            Self::Index(index) | Self::Exact { index, .. } => index.to_array(),
        }
    }
}

/// The footprints of lanes, as [`crate::render::Footprint`].
pub(crate) struct FootprintLanes<S: Simd> {
    pub(crate) radius_x: f32x16<S>,
    pub(crate) radius_y: f32x16<S>,
    pub(crate) weight: f32x16<S>,
    /// Of x and y along the footprint, if it is an ellipse.
    pub(crate) correlation: f32x16<S>,
}

impl<S: Simd> FootprintLanes<S> {
    /// Squares of weight 1.
    #[inline(always)]
    fn of_squares(radius: f32x16<S>) -> Self {
        let simd = radius.token();
        let (weight, correlation) = (f32x16::splat(simd, 1.0), f32x16::splat(simd, 0.0));
        Self {
            radius_x: radius,
            radius_y: radius,
            weight,
            correlation,
        }
    }
}

/// A way to know sizes. What works on lanes is inlined into the kernel of the warp, for every SIMD level.
pub(crate) trait Size {
    /// Footprints are ellipses, whose correlations are to be kept.
    const IS_ELLIPTICAL: bool = false;

    /// No footprint is larger, px.
    const MAX_RADIUS_PX: f32;

    /// A radius, px, that no footprint exceeds whose sample has at most the inverse depth `q` and at least the ratio of
    /// depths `w`, in a frame of the given size.
    fn largest_radius_px(&self, transfer: &Transfer, q: f64, w: f64, frame_px: [u32; 2]) -> f64;

    /// The footprints of samples. Those of samples behind the eye may be anything.
    fn footprints<S: Simd>(&self, simd: S, lanes: &Lanes<S>) -> FootprintLanes<S>;
}

/// The paper's table of 2,048 widths, refilled for every segment of every frame (S20, corrected: C10).
///
/// `sqrt(size) = (1 / w) (f2 / f1) sqrt(cos phi2 / cos phi1)`, phi = angle between the normal and a camera's axis. With
/// [`SplatIndexLayout::Paper`] the table is multiplied by the eye depth of the index's depth code, and the width is the
/// entry times the inverse depth in the frame, as in the paper.
pub(crate) struct PaperSize {
    widths: Box<[f32; SPLAT_INDEX_COUNT]>,
    layout: SplatIndexLayout,
}

impl PaperSize {
    /// Below this, cosines are taken for this: a surface seen edge-on has no width of its own.
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
            let (cos1, cos2) = (
                normal.z.max(Self::MIN_COSINE),
                normal.dot(back_in_face).max(Self::MIN_COSINE),
            );
            ratio * (cos2 / cos1).sqrt()
        };
        let range = segment.depth_code_range();
        let depths: [f32; DEPTH_CODE_COUNT] = std::array::from_fn(|code| match layout {
            SplatIndexLayout::Paper => range.decode(code) as f32,
            SplatIndexLayout::Normal => 1.0,
        });
        let same_normal = match layout {
            SplatIndexLayout::Paper => DEPTH_CODE_COUNT,
            SplatIndexLayout::Normal => 1,
        };
        for (i, entries) in self.widths.chunks_exact_mut(same_normal).enumerate() {
            let width = width((i * same_normal) as u32);
            for (entry, depth) in entries.iter_mut().zip(depths) {
                *entry = width * depth;
            }
        }
    }
}

impl Size for PaperSize {
    const MAX_RADIUS_PX: f32 = 3.5;

    fn largest_radius_px(&self, _: &Transfer, _: f64, _: f64, _: [u32; 2]) -> f64 {
        f64::from(Self::MAX_RADIUS_PX)
    }

    /// Squares of 1, 3, 5 or 7 pixels: the smallest that is at least as wide as the sample. Rounded to the nearest, as C10 has
    /// it, they leave cracks.
    #[inline(always)]
    fn footprints<S: Simd>(&self, simd: S, lanes: &Lanes<S>) -> FootprintLanes<S> {
        let index = lanes.normals.index();
        let mut width = [0.0; LANES];
        for (width, index) in width.iter_mut().zip(index) {
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
        FootprintLanes::of_squares(radius)
    }
}

/// One size for all samples: the fixed stamps of R7.
pub(crate) struct FixedSize {
    pub(crate) radius_px: f32,
}

impl Size for FixedSize {
    const MAX_RADIUS_PX: f32 = 1.5;

    fn largest_radius_px(&self, _: &Transfer, _: f64, _: f64, _: [u32; 2]) -> f64 {
        f64::from(self.radius_px)
    }

    #[inline(always)]
    fn footprints<S: Simd>(&self, simd: S, _: &Lanes<S>) -> FootprintLanes<S> {
        FootprintLanes::of_squares(f32x16::splat(simd, self.radius_px))
    }
}

/// Exact sizes from the tangent plane (the differential that S20 approximates).
///
/// On the plane through the sample with normal n, the inverse depth is proportional to n . ray(x, y), which is linear
/// in the face position (x, y). So `dq/dx = q (n . ray)_x / (n . ray)`, and the derivative of the transfer follows:
/// where the neighbouring samples of the same surface land, in x and y, to first order. The radii are the lengths of the
/// rows of this 2x2 Jacobian, which do not change when the face's grid is rotated in the frame.
///
/// The angles of [`PaperSize`] say nothing of a floor seen through a side face (both cosines are 0). What that brings:
/// docs/decisions/0048.
pub(crate) struct TangentSize<'a> {
    table: &'a TangentTable,
    x_step: Vec3,
    y_step: Vec3,
    per_inverse_depth: Vec3,
}

/// What [`TangentSize`] knows before it knows the view.
pub(crate) struct TangentTable {
    /// n . ray(x, y) = plane.x * x + plane.y * y + plane.z
    planes: Box<[Vec3; SPLAT_INDEX_COUNT]>,
    /// A face pixel, of a face that is 2 wide.
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
    /// Relative change of inverse depth over one face pixel, times half of the face's size, at most. It is the tangent
    /// of the angle to the surface's normal; beyond it (85 degrees) the quantised normal says little. Less, and a floor seen
    /// edge-on from the centre, which an eye higher up sees stretched, is drawn with gaps between its rows that no ray can fill.
    pub(super) const MAX_SLOPE: f32 = 12.0;

    /// Fills the table of planes. Radii are the spacing of the samples times `scale`, at least `min_radius_px`.
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
        (self.step, self.max_slope) = (step, Self::MAX_SLOPE * step);
        (self.scale, self.min_radius_px) = (scale, min_radius_px);
    }
}

impl<'a> TangentSize<'a> {
    /// For the samples of one segment.
    pub(crate) fn new(table: &'a TangentTable, transfer: &Transfer) -> Self {
        Self {
            table,
            x_step: transfer.x_step.as_vec3(),
            y_step: transfer.y_step.as_vec3(),
            per_inverse_depth: transfer.inverse_depth.as_vec3(),
        }
    }
}

impl Size for TangentSize<'_> {
    const MAX_RADIUS_PX: f32 = 32.0;

    /// From the largest of each term of [`Self::footprints`]; the slopes are clamped, and positions lie in the frame or at
    /// most a radius outside.
    fn largest_radius_px(&self, transfer: &Transfer, q: f64, w: f64, frame_px: [u32; 2]) -> f64 {
        let most = f64::from(Self::MAX_RADIUS_PX);
        if w <= 0.0 {
            return most;
        }
        let slope = transfer.inverse_depth.abs() * (q * f64::from(self.table.max_slope));
        let [along_x, along_y] = [transfer.x_step, transfer.y_step].map(|step| step.abs() + slope);
        let radius = |axis: usize| {
            let reach = f64::from(frame_px[axis]) / 2.0 + most;
            let along = |step: DVec3| (step[axis] + reach * step.z) / w;
            along(along_x).hypot(along(along_y)) * f64::from(self.table.scale)
        };
        // A hair more than f32 can round up to.
        (radius(0).max(radius(1)) * (1.0 + 1e-5))
            .max(f64::from(self.table.min_radius_px))
            .min(most)
    }

    #[inline(always)]
    fn footprints<S: Simd>(&self, simd: S, lanes: &Lanes<S>) -> FootprintLanes<S> {
        let [[xx, xy], [yx, yy]] = self.jacobian(simd, lanes);
        let (radius_x, radius_y) = (self.radius(xx, xy), self.radius(yx, yy));
        let area = (xx * yy - xy * yx).abs();
        let weight = (area / (radius_x * radius_y)).min_precise(1.0);
        FootprintLanes {
            radius_x,
            radius_y,
            weight,
            correlation: f32x16::splat(simd, 0.0),
        }
    }
}

impl TangentSize<'_> {
    /// The length of a row of the Jacobian, times the scale of radii, within their bounds.
    #[inline(always)]
    fn radius<S: Simd>(&self, of_x: f32x16<S>, of_y: f32x16<S>) -> f32x16<S> {
        let length = (of_x * of_x + of_y * of_y).sqrt();
        (length * self.table.scale)
            .max_precise(self.table.min_radius_px)
            .min_precise(Self::MAX_RADIUS_PX)
    }

    /// Where in the frame, px, the next samples of the same surface land to the right and below: of x to both, and of y.
    #[inline(always)]
    fn jacobian<S: Simd>(&self, simd: S, lanes: &Lanes<S>) -> [[f32x16<S>; 2]; 2] {
        let [plane_x, plane_y, plane_z] = self.planes(simd, &lanes.normals);
        let reciprocal =
            f32x16::splat(simd, 1.0) / (plane_x * lanes.x + plane_y * lanes.y + plane_z);
        let most = self.table.max_slope;
        // The precise forms also turn the NaN of 0 / 0 into a number.
        let slope_x =
            (plane_x * reciprocal).min_precise(most).max_precise(-most) * lanes.inverse_depth;
        let slope_y =
            (plane_y * reciprocal).min_precise(most).max_precise(-most) * lanes.inverse_depth;
        let p = self.per_inverse_depth;
        let (dx, dy) = (self.x_step, self.y_step);
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
        let (x, y) = (lanes.homogeneous[0] * w, lanes.homogeneous[1] * w);
        let of_x = [
            (along_x[0] - x * along_x[2]) * w,
            (along_y[0] - x * along_y[2]) * w,
        ];
        let of_y = [
            (along_x[1] - y * along_x[2]) * w,
            (along_y[1] - y * along_y[2]) * w,
        ];
        [of_x, of_y]
    }

    /// The planes of [`TangentTable`].
    #[inline(always)]
    fn planes<S: Simd>(&self, simd: S, normals: &Normals<S>) -> [f32x16<S>; 3] {
        match normals {
            Normals::Index(index) => {
                let index = index.to_array();
                let (mut xs, mut ys, mut zs) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
                for i in 0..LANES {
                    let plane = self.table.planes[index[i] as usize % SPLAT_INDEX_COUNT];
                    (xs[i], ys[i], zs[i]) = (plane.x, plane.y, plane.z);
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

/// Ellipses: Gaussians of half a sample's spacing on its surface, carried into the frame by the same differential, and
/// blurred by [`Self::BLUR_PX`] so that they are not lost between pixels (Heckbert's elliptical weighted average).
pub(crate) struct EllipseSize<'a>(pub(crate) TangentSize<'a>);

impl EllipseSize<'_> {
    /// Footprints end at so many standard deviations, where a Gaussian is below 0.05.
    pub(crate) const DEVIATIONS: f32 = 2.5;
    /// Standard deviation of the Gaussian, in spacings. Half of one ripples by 1.4 %, as 2 exp(-2 (pi / 2)^2).
    const SPACINGS: f32 = 0.5;
    /// Spacings to the end of a footprint.
    pub(crate) const SCALE: f32 = Self::DEVIATIONS * Self::SPACINGS;
    /// Standard deviation of the blur, px.
    const BLUR_PX: f32 = 0.3;

    /// The radius along one axis of the frame: of a row of the Jacobian, blurred.
    #[inline(always)]
    fn radius<S: Simd>(of_x: f32x16<S>, of_y: f32x16<S>) -> f32x16<S> {
        let (along, blur) = (
            Self::SCALE * Self::SCALE,
            (Self::BLUR_PX * Self::DEVIATIONS).powi(2),
        );
        ((of_x * of_x + of_y * of_y) * along + blur)
            .sqrt()
            .min_precise(Self::MAX_RADIUS_PX)
    }
}

impl Size for EllipseSize<'_> {
    const IS_ELLIPTICAL: bool = true;
    const MAX_RADIUS_PX: f32 = TangentSize::MAX_RADIUS_PX;

    fn largest_radius_px(&self, transfer: &Transfer, q: f64, w: f64, frame_px: [u32; 2]) -> f64 {
        let blur = f64::from(Self::BLUR_PX * Self::DEVIATIONS) * (1.0 + 1e-5);
        self.0
            .largest_radius_px(transfer, q, w, frame_px)
            .hypot(blur)
            .min(f64::from(Self::MAX_RADIUS_PX))
    }

    #[inline(always)]
    fn footprints<S: Simd>(&self, simd: S, lanes: &Lanes<S>) -> FootprintLanes<S> {
        let [[xx, xy], [yx, yy]] = self.0.jacobian(simd, lanes);
        let along = Self::SCALE * Self::SCALE;
        let (radius_x, radius_y) = (Self::radius(xx, xy), Self::radius(yx, yy));
        let area = (xx * yy - xy * yx).abs();
        let reciprocal = f32x16::splat(simd, 1.0) / (radius_x * radius_y);
        let correlation = (xx * yx + xy * yy) * along * reciprocal;
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
