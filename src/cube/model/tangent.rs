//! Tangent plane of a sample: the slope of inverse depth over its LDI.

use crate::model::samples::{DepthPixel, LayeredDepthImage};
use glam::{DVec2, dvec2};

impl LayeredDepthImage {
    /// Computes the relative change of inverse depth over one pixel to the right and one down,
    /// `(dq/dx, dq/dy) / q`, on the tangent plane of a sample at the position (x, y) in pixels.
    ///
    /// On a plane with normal n, q is proportional to n . ray(x, y), and the ray is linear in (x,
    /// y). Each component is clamped to `max_slope` times a pixel's angle, 2 / size: `max_slope` is
    /// the tangent of the largest plausible angle between normal and line of sight.
    pub fn inverse_depth_slope(
        &self,
        x: f64,
        y: f64,
        sample: &DepthPixel,
        max_slope: f64,
    ) -> DVec2 {
        let n = sample.normal.decode().as_dvec3();
        let pixel = 2.0 / f64::from(self.size_px);
        let along_ray = n.dot(self.face.direction(x, y, self.size_px));
        let slope = dvec2(n.dot(self.face.right()), -n.dot(self.face.up())) * pixel / along_ray;
        // `min` and `max` also turn the NaN of 0 / 0 into a number.
        slope
            .min(DVec2::splat(max_slope * pixel))
            .max(DVec2::splat(-max_slope * pixel))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::samples::EncodedNormal;
    use glam::dvec3;
    use headbox_core::cube_face::Face;

    #[test]
    fn slopes_follow_the_plane() {
        let (normal, through) = (dvec3(0.3, 0.2, -0.9).normalize(), dvec3(0.0, 0.0, 3.0));
        let face = LayeredDepthImage::empty(Face::PosZ, 64);
        let inverse_depth =
            |x: f64, y: f64| Face::PosZ.direction(x, y, 64).dot(normal) / through.dot(normal);
        let q = inverse_depth(20.5, 40.5);
        let normal = EncodedNormal::new(normal.as_vec3());
        let sample = DepthPixel {
            inverse_depth: q as f32,
            normal,
            color_srgb: [0; 4],
        };
        let slope = face.inverse_depth_slope(20.5, 40.5, &sample, 10.0);
        assert!(
            (slope.x * q - (inverse_depth(21.5, 40.5) - q)).abs() < 1e-6,
            "the encoded normal errs by 7e-5"
        );
        assert!((slope.y * q - (inverse_depth(20.5, 41.5) - q)).abs() < 1e-6);
        assert!(
            face.inverse_depth_slope(20.5, 40.5, &sample, 0.1)
                .abs()
                .max_element()
                <= 0.1 * 2.0 / 64.0 + 1e-15
        );
    }
}
