//! Error bound: the largest error of inverse depth for which no eye in the headbox sees a surface
//! displaced by more than a number of frame pixels. `docs/primitives.md` derives it.

use glam::DVec3;

/// Frame pixels on the axis for one face pixel on its axis, in the frame that errors are counted
/// in: 1024x768 pixels at a vertical field of view of 60 degrees for a face of 1024.
const FOCAL_PER_FACE_PX: f64 = 384.0 * 1.732_050_807_568_877_2 / 1024.0;

/// 1 / cos^2 of the angle between that frame's axis and its corners: a pixel there is so much
/// smaller an angle.
const OBLIQUENESS: f64 = 1.0 + (1.0 + 16.0 / 9.0) / 3.0;

/// The one bound that chooses primitives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bound {
    /// Largest error, frame pixels, times 1 over frame pixels for a tangent of 1: the sine of an
    /// angle.
    sine: f64,
    half_size_m: f64,
}

impl Bound {
    /// At most `error_px` pixels anywhere in a frame of 4:3 at a vertical field of view of 60
    /// degrees whose pixels are 0.77 of a face's pixel in the middle, from any eye in a headbox of
    /// a half size.
    pub fn new(error_px: f64, half_size_m: f64, face_size_px: u32) -> Self {
        Self {
            sine: error_px / (Self::focal_px(face_size_px) * OBLIQUENESS),
            half_size_m,
        }
    }

    /// Focal length, px, of the frames that errors are counted in.
    pub fn focal_px(face_size_px: u32) -> f64 {
        FOCAL_PER_FACE_PX * f64::from(face_size_px)
    }

    /// The largest difference of inverse depth, 1/m, that a sample in the direction `d` (from the
    /// centre, at depth 1) with the inverse depth `q` may have from what is drawn for it.
    ///
    /// Two points P, P' of a ray from the centre, seen from an eye at b, are apart by an angle of
    /// which the sine is
    /// |P' - P| r / (|P - b| |P' - b|), r the eye's distance from the ray. With z, z' the distances from the eye to P, P'
    /// along the ray, the denominator is at least r^2 + z z' (Cauchy-Schwarz), and the nearer of
    /// the two is no nearer than z = |P| - (the headbox's reach along the ray). r / (r^2 + z^2)
    /// grows with r up to r = z.
    pub fn tolerance(&self, d: DVec3, q: f64) -> f64 {
        let first = self.tolerance_if_no_nearer_than(d, q, q);
        self.tolerance_if_no_nearer_than(d, q, q + first)
    }

    fn tolerance_if_no_nearer_than(&self, d: DVec3, q: f64, nearest: f64) -> f64 {
        let (length, reach) = (
            d.length(),
            self.half_size_m * d.abs().element_sum() / d.length(),
        );
        let z = length / nearest - reach;
        if z <= 0.0 {
            return 0.0;
        }
        // The corner that is farthest from the ray.
        let squared = 3.0 * self.half_size_m.powi(2) - least_reach(d, self.half_size_m).powi(2);
        let r = squared.max(0.0).sqrt();
        // |P' - P| = |d| |q' - q| / (q q').
        let per_length = if r <= z { r / (r * r + z * z) } else { 0.5 / z };
        let nearer = q * q * self.sine / (per_length * length);
        // Farther by a length s: sine at most s r / (r^2 + z (z + s)), which any s satisfies if r
        // <= sine z.
        let farther = match r <= z {
            true if r <= self.sine * z => q,
            true => from_length(q, length, self.sine * (r * r + z * z) / (r - self.sine * z)),
            false => from_length(q, length, self.sine / per_length),
        };
        farther.min(nearer)
    }
}

/// Decrease of the inverse depth `q` of a point in a direction of length `d` if the point moves
/// away by `s`.
fn from_length(q: f64, d: f64, s: f64) -> f64 {
    q * q * s / (d + q * s)
}

/// Distance along the ray of the corner of a cube that is nearest to the plane through the centre
/// across the ray.
fn least_reach(d: DVec3, half_size_m: f64) -> f64 {
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
