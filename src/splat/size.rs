//! How large the footprint of a sample is in the frame.

use super::Footprint;
use crate::capture::Camera;
use crate::packed::splat_index::{DEPTH_CODE_COUNT, SPLAT_INDEX_COUNT};
use crate::packed::{PackedSegment, SplatIndexLayout};
use crate::warp::transfer::Transfer;
use glam::Vec3;

/// A sample in the frame, as far as its size depends on it.
pub(crate) struct Sample {
    /// (X w, Y w, w) from the principal point; see [`Transfer`].
    pub(crate) homogeneous: Vec3,
    /// 1 / w.
    pub(crate) reciprocal_w: f32,
    /// Inverse depth in the LDI, 1/m.
    pub(crate) inverse_depth: f32,
    /// Position on the face, px.
    pub(crate) x: f32,
    /// Position on the face, px.
    pub(crate) y: f32,
    /// The 11 bits.
    pub(crate) splat_index: u32,
}

/// A way to know sizes.
pub(crate) trait Size {
    /// No footprint is larger, px.
    const MAX_RADIUS_PX: f32;

    /// The footprint of a sample.
    fn footprint(&self, sample: &Sample) -> Footprint;
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
        Self { widths: Box::new([0.0; SPLAT_INDEX_COUNT]), layout: SplatIndexLayout::Paper }
    }

    /// Refills the table.
    pub(crate) fn refill(&mut self, camera: &Camera, segment: &PackedSegment, layout: SplatIndexLayout, face_px: u32) {
        self.layout = layout;
        let ratio = (camera.focal_px() / (f64::from(face_px) / 2.0)) as f32;
        let back_in_face = (segment.face.world_from_eye().transpose() * -camera.forward()).as_vec3();
        let width = |index: u32| {
            let normal = layout.normal(index);
            let (cos1, cos2) = (normal.z.max(Self::MIN_COSINE), normal.dot(back_in_face).max(Self::MIN_COSINE));
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

    /// Squares of 1, 3, 5 or 7 pixels: the smallest that is at least as wide as the sample. (With the thresholds 2, 4, 6
    /// of C10, rounding to the nearest, 20 % of the pixels of the test bed's room stay empty.)
    #[inline(always)]
    fn footprint(&self, sample: &Sample) -> Footprint {
        let mut width = self.widths[sample.splat_index as usize % SPLAT_INDEX_COUNT] * sample.reciprocal_w;
        if self.layout == SplatIndexLayout::Paper {
            width *= sample.inverse_depth;
        }
        let radius = ((width - 1.0) * 0.5).ceil().clamp(0.0, 3.0) + 0.5;
        Footprint { radius_x: radius, radius_y: radius, weight: 1.0 }
    }
}

/// Exact sizes from the tangent plane (the differential that S20 approximates).
///
/// On the plane through the sample with normal n, the inverse depth is proportional to n . ray(x, y), which is linear
/// in the face position (x, y). So `dq/dx = q (n . ray)_x / (n . ray)`, and the derivative of the transfer follows:
/// where the neighbouring samples of the same surface land, in x and y, to first order. The radii are the lengths of the
/// rows of this 2x2 Jacobian, which do not change when the face's grid is rotated in the frame.
///
/// On the test bed this gained up to 1.5 dB over `w^-3/2 f2/f1` (no normals), and 8 dB over the angles of
/// [`PaperSize`], which say nothing of a floor seen through a side face (both cosines are 0).
pub(crate) struct TangentSize {
    /// n . ray(x, y) = plane.x * x + plane.y * y + plane.z
    planes: Box<[Vec3; SPLAT_INDEX_COUNT]>,
    x_step: Vec3,
    y_step: Vec3,
    per_inverse_depth: Vec3,
    max_slope: f32,
    scale: f32,
    min_radius_px: f32,
}

impl TangentSize {
    /// Relative change of inverse depth over one face pixel, times half of the face's size, at most. It is the tangent
    /// of the angle to the surface's normal; beyond it (76 degrees) the quantised normal says little, and a capture
    /// resolves the slope into several samples a pixel. 1 to 16 were tried: 4 is best in the room, 1 to 2 by 0.2 dB
    /// among leaves.
    const MAX_SLOPE: f32 = 4.0;

    pub(crate) fn new() -> Self {
        Self {
            planes: Box::new([Vec3::ZERO; SPLAT_INDEX_COUNT]),
            x_step: Vec3::ZERO,
            y_step: Vec3::ZERO,
            per_inverse_depth: Vec3::ZERO,
            max_slope: 0.0,
            scale: 1.0,
            min_radius_px: 0.0,
        }
    }

    /// Fills the table of planes: once for each LDI. Radii are the spacing of the samples times `scale`, at least
    /// `min_radius_px`.
    pub(crate) fn refill(&mut self, layout: SplatIndexLayout, face_px: u32, scale: f32, min_radius_px: f32) {
        let step = 2.0 / face_px as f32;
        for (i, plane) in self.planes.iter_mut().enumerate() {
            let n = layout.normal(i as u32);
            *plane = Vec3::new(n.x * step, -n.y * step, -n.x + n.y - n.z);
        }
        self.max_slope = Self::MAX_SLOPE * step;
        (self.scale, self.min_radius_px) = (scale, min_radius_px);
    }

    /// Prepares for the samples of one segment.
    pub(crate) fn set_transfer(&mut self, transfer: &Transfer) {
        self.x_step = transfer.x_step.as_vec3();
        self.y_step = transfer.y_step.as_vec3();
        self.per_inverse_depth = transfer.inverse_depth.as_vec3();
    }
}

impl Size for TangentSize {
    const MAX_RADIUS_PX: f32 = 32.0;

    #[inline(always)]
    fn footprint(&self, sample: &Sample) -> Footprint {
        let plane = self.planes[sample.splat_index as usize % SPLAT_INDEX_COUNT];
        let reciprocal = 1.0 / (plane.x * sample.x + plane.y * sample.y + plane.z);
        // `min` and `max` also turn the NaN of 0 / 0 into a number.
        let slope = |s: f32| (s * reciprocal).min(self.max_slope).max(-self.max_slope);
        let along_x = self.x_step + self.per_inverse_depth * (sample.inverse_depth * slope(plane.x));
        let along_y = self.y_step + self.per_inverse_depth * (sample.inverse_depth * slope(plane.y));
        let w = sample.reciprocal_w;
        let (x, y) = (sample.homogeneous.x * w, sample.homogeneous.y * w);
        let (xx, xy) = ((along_x.x - x * along_x.z) * w, (along_y.x - x * along_y.z) * w);
        let (yx, yy) = ((along_x.y - y * along_x.z) * w, (along_y.y - y * along_y.z) * w);
        let radius =
            |a: f32, b: f32| ((a * a + b * b).sqrt() * self.scale).max(self.min_radius_px).min(Self::MAX_RADIUS_PX);
        let (radius_x, radius_y) = (radius(xx, xy), radius(yx, yy));
        let area = (xx * yy - xy * yx).abs();
        Footprint { radius_x, radius_y, weight: (area / (radius_x * radius_y)).min(1.0) }
    }
}
