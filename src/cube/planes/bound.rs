//! Error bound: the maximum error of inverse depth that displaces a surface by at most a given
//! number of frame pixels for any eye in the headbox. `docs/primitives.md` derives it.

use crate::model::depth_bins::DepthBins;
use glam::DVec3;

/// Size of a face pixel on the face's axis in pixels of the reference frame on its axis: 1024x768
/// pixels at a vertical field of view of 60 degrees for a face of 1024.
const FOCAL_PER_FACE_PX: f64 = 384.0 * 1.732_050_807_568_877_2 / 1024.0;

/// 1 / cos^2 of the angle between the axis of the reference frame and its corners: the factor by
/// which pixels there subtend smaller angles.
const OBLIQUENESS: f64 = 1.0 + (1.0 + 16.0 / 9.0) / 3.0;

/// Error bound for the selection of primitives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bound {
    /// Sine of the maximum angle of displacement: the error in frame pixels over the frame's focal
    /// length at the corners.
    sine: f64,
    half_size_m: f64,
}

impl Bound {
    /// Creates the bound of `error_px` pixels anywhere in the reference frame, for any eye in the
    /// headbox. The reference frame is 4:3 at a vertical field of view of 60 degrees; its focal
    /// length is [`Self::focal_px`].
    pub fn new(error_px: f64, half_size_m: f64, face_size_px: u32) -> Self {
        Self {
            sine: error_px / (Self::focal_px(face_size_px) * OBLIQUENESS),
            half_size_m,
        }
    }

    /// Returns the width of a depth bin of a face, 1/m.
    pub(super) fn bin(&self, face_size_px: u32) -> f64 {
        DepthBins::new(self.half_size_m, face_size_px).inverse_depth(1.0)
    }

    /// Returns the focal length of the reference frame, px.
    pub fn focal_px(face_size_px: u32) -> f64 {
        FOCAL_PER_FACE_PX * f64::from(face_size_px)
    }

    /// Computes the maximum error of inverse depth, 1/m, of a primitive that replaces a sample of
    /// inverse depth `q` in the direction `d` (from the centre, at depth 1).
    ///
    /// Seen from an eye at b, two points P, P' of a ray from the centre are an angle apart whose
    /// sine is |P' - P| r / (|P - b| |P' - b|), r the eye's distance from the ray. With z, z' the
    /// distances from the eye to P, P' along the ray, the denominator is at least r^2 + z z'
    /// (Cauchy-Schwarz), and the nearer of the two is no nearer than z = |P| - (the headbox's
    /// extent along the ray). r / (r^2 + z^2) grows with r up to r = z.
    pub fn tolerance(&self, d: DVec3, q: f64) -> f64 {
        let first = self.tolerance_up_to(d, q, q);
        self.tolerance_up_to(d, q, q + first)
    }

    /// Computes the tolerance if the drawn inverse depth is at most `nearest`.
    fn tolerance_up_to(&self, d: DVec3, q: f64, nearest: f64) -> f64 {
        let length = d.length();
        let reach = self.half_size_m * d.abs().element_sum() / length;
        let z = length / nearest - reach;
        if z <= 0.0 {
            return 0.0;
        }
        // The corner of the headbox that is farthest from the ray.
        let squared =
            3.0 * self.half_size_m.powi(2) - least_corner_distance(d, self.half_size_m).powi(2);
        let r = squared.max(0.0).sqrt();
        // |P' - P| = |d| |q' - q| / (q q').
        let per_length = if r <= z { r / (r * r + z * z) } else { 0.5 / z };
        let nearer = q * q * self.sine / (per_length * length);
        // Farther by a length s: sine at most s r / (r^2 + z (z + s)), which any s satisfies if r
        // <= sine z.
        let farther = if r <= self.sine * z && r <= z {
            q
        } else if r <= z {
            from_length(q, length, self.sine * (r * r + z * z) / (r - self.sine * z))
        } else {
            from_length(q, length, self.sine / per_length)
        };
        farther.min(nearer)
    }
}

/// Computes the decrease of the inverse depth `q` of a point in a direction of length `d` if the
/// point moves away by `s`.
fn from_length(q: f64, d: f64, s: f64) -> f64 {
    q * q * s / (d + q * s)
}

/// Computes the least distance of the headbox's corners from the plane through the centre that is
/// perpendicular to the ray.
fn least_corner_distance(d: DVec3, half_size_m: f64) -> f64 {
    let [a, b, c] = d.abs().to_array();
    let signed = [a + b + c, a + b - c, a - b + c, b + c - a];
    signed
        .map(|sum| sum.abs() * half_size_m / d.length())
        .into_iter()
        .fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;
    use headbox_core::camera::Camera;
    use headbox_core::cube_face::Face;

    /// A sequence of numbers between 0 and 1.
    fn randoms() -> impl FnMut() -> f64 {
        let mut state = 7u64;
        move || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        }
    }

    #[test]
    fn no_eye_exceeds_error_bound() {
        const ERROR_PX: f64 = 0.5;
        let (half_size_m, face_px) = (0.5, 1024);
        let bound = Bound::new(ERROR_PX, half_size_m, face_px);
        let mut random = randoms();
        let (mut worst, mut seen) = (0.0f64, 0);
        while seen < 10_000 {
            let face = Face::ALL[(random() * 6.0) as usize % 6];
            let d = face.direction(random() * 1024.0, random() * 1024.0, face_px);
            let q = random().powi(3) / half_size_m * 0.999 + 1e-4;
            let eye = dvec3(random(), random(), random()) * 2.0 * half_size_m - half_size_m;
            let to = d / q - eye;
            let aside = dvec3(random() - 0.5, random() - 0.5, random() - 0.5) * to.length() * 0.9;
            let Ok(camera) = Camera::look_at(eye, eye + to + aside, DVec3::Y, 60.0, [1024, 768])
            else {
                continue;
            };
            let Some([x, y, _]) = camera.project(d / q) else {
                continue;
            };
            if !(0.0..1024.0).contains(&x) || !(0.0..768.0).contains(&y) {
                continue;
            }
            let tolerance = bound.tolerance(d, q);
            assert!(tolerance >= 0.0 && tolerance <= q);
            for q in [q + tolerance, (q - tolerance).max(1e-12)] {
                let Some([u, v, _]) = camera.project(d / q) else {
                    panic!("turned away")
                };
                if (0.0..1024.0).contains(&u) && (0.0..768.0).contains(&v) {
                    worst = worst.max((u - x).hypot(v - y));
                }
            }
            seen += 1;
        }
        assert!(worst <= ERROR_PX, "{worst}");
        assert!(
            worst > 0.5 * ERROR_PX,
            "the bound is nearly reached: {worst}"
        );
    }

    #[test]
    fn hopeless_cases_have_no_tolerance() {
        let bound = Bound::new(0.5, 1.0, 256);
        assert_eq!(bound.tolerance(DVec3::Z, 1.0), 0.0, "on the headbox");
        assert_eq!(
            bound.tolerance(dvec3(1.0, 1.0, 1.0), 1.0),
            0.0,
            "on its corner"
        );
        assert_eq!(bound.tolerance(DVec3::Z, 1e-9), 1e-9, "as far as infinity");
        assert_eq!(Bound::new(0.0, 1.0, 256).tolerance(DVec3::Z, 0.1), 0.0);
    }
}
