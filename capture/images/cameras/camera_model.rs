//! Camera models beyond OpenCV's pinhole: fisheyes, division, extended unified and FOV cameras.
//!
//! A model maps directions to positions in the image and back. Directions are in the axes of OpenCV
//! and COLMAP (X right, Y down, Z forward) inside this module; the public methods take and return
//! eye space (X right, Y up, looking down -Z). Models of 180 degrees and more see behind the eye.

use glam::{DMat2, DVec2, DVec3};
use std::f64::consts::PI;

/// Camera of an image that has to be resampled into perspective views
/// ([`crate::cameras::rectify`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraModel {
    /// Focal lengths, pixels.
    pub focal_px: [f64; 2],
    /// Principal point, pixels; pixel centres at half-integers.
    pub principal_px: [f64; 2],
    /// Mapping from directions to positions at focal length 1.
    pub projection: Projection,
}

/// Mapping from directions to positions in an image of focal length 1, whose principal point is the
/// origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// Polynomial of the position in the plane at depth 1.
    Plane(Polynomial),
    /// Polynomial of the position at the distance of the angle from the axis, radians: an
    /// equidistant fisheye with distortion.
    Fisheye(Polynomial),
    /// Field-of-view model of Devernay and Faugeras: omega, radians.
    FieldOfView(f64),
    /// Division model of Fitzgibbon: the distorted position divided by 1 + k r^2.
    Division(f64),
    /// Extended unified camera model of Khomutenko: alpha (0..=1) and beta (above 0).
    ExtendedUnified([f64; 2]),
}

/// Polynomial distortion in two dimensions: radial, tangential and thin-prism terms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Polynomial {
    /// Coefficients of r^2, r^4, to r^12.
    radial: [f64; 6],
    /// p1 and p2 of OpenCV.
    tangential: [f64; 2],
    /// Thin prism: coefficients of r^2 and r^4 along X, then along Y.
    prism: [f64; 4],
    /// True if the tangential and thin-prism terms are of the radially distorted position.
    is_chained: bool,
    /// Radius up to which the radial terms increase: beyond it, positions would repeat.
    limit: f64,
}

/// Angle from the axis up to which planes are used, radians.
const PLANE_LIMIT: f64 = 1.56;

/// Number of steps of the search for the limit of a polynomial.
const LIMIT_STEPS: u32 = 4096;

impl Polynomial {
    /// Creates the distortion of a fisheye, whose positions are angles.
    pub fn of_angles(
        radial: &[f64],
        tangential: [f64; 2],
        prism: [f64; 4],
        is_chained: bool,
    ) -> Self {
        Self::new(radial, tangential, prism, is_chained, PI, |angle| angle)
    }

    /// Creates the distortion of positions in the plane at depth 1.
    pub fn of_plane(radial: &[f64], tangential: [f64; 2]) -> Self {
        Self::new(radial, tangential, [0.0; 4], false, PLANE_LIMIT, f64::tan)
    }

    fn new(
        terms: &[f64],
        tangential: [f64; 2],
        prism: [f64; 4],
        is_chained: bool,
        largest_angle: f64,
        radius: impl Fn(f64) -> f64,
    ) -> Self {
        let mut radial = [0.0; 6];
        radial
            .iter_mut()
            .zip(terms)
            .for_each(|(to, term)| *to = *term);
        let whole = Self {
            radial,
            tangential,
            prism,
            is_chained,
            limit: radius(largest_angle),
        };
        let step = |i: u32| radius(largest_angle * f64::from(i) / f64::from(LIMIT_STEPS));
        let first = (1..=LIMIT_STEPS).find(|&i| whole.radial_slope(step(i)) <= 0.0);
        let limit = first.map_or(whole.limit, |i| step(i - 1));
        Self { limit, ..whole }
    }

    /// Returns the factor on a position at a squared radius.
    fn radial_factor(&self, r2: f64) -> f64 {
        1.0 + self.radial.iter().rev().fold(0.0, |sum, k| (sum + k) * r2)
    }

    /// Returns the derivative of the distorted radius.
    fn radial_slope(&self, r: f64) -> f64 {
        let terms = (0..6)
            .rev()
            .map(|i| f64::from(2 * i + 3) * self.radial[i as usize]);
        1.0 + terms.fold(0.0, |sum, k| (sum + k) * r * r)
    }

    fn tangential_and_prism(&self, p: DVec2) -> DVec2 {
        let ([p1, p2], [sx1, sx2, sy1, sy2]) = (self.tangential, self.prism);
        let r2 = p.length_squared();
        let xy2 = 2.0 * p.x * p.y;
        DVec2::new(
            p1 * xy2 + p2 * (r2 + 2.0 * p.x * p.x) + r2 * (sx1 + r2 * sx2),
            p1 * (r2 + 2.0 * p.y * p.y) + p2 * xy2 + r2 * (sy1 + r2 * sy2),
        )
    }

    /// Distorts a position; `None` beyond the limit.
    fn apply(&self, p: DVec2) -> Option<DVec2> {
        (p.length() <= self.limit).then(|| self.evaluate(p))
    }

    fn evaluate(&self, p: DVec2) -> DVec2 {
        let radial = p * self.radial_factor(p.length_squared());
        radial + self.tangential_and_prism(if self.is_chained { radial } else { p })
    }

    /// Returns the derivative of [`Self::evaluate`].
    fn jacobian(&self, p: DVec2) -> DMat2 {
        let r = p.length();
        let factor = self.radial_factor(r * r);
        // The slope along the radius differs from the factor across it.
        let along = if r > 0.0 { p / r } else { DVec2::X };
        let excess = self.radial_slope(r) - factor;
        let radial = DMat2::from_diagonal(DVec2::splat(factor))
            + DMat2::from_cols(along * along.x, along * along.y) * excess;
        let at = if self.is_chained { p * factor } else { p };
        let ([p1, p2], [sx1, sx2, sy1, sy2]) = (self.tangential, self.prism);
        let r2 = at.length_squared();
        let prism = 2.0 * DVec2::new(sx1 + 2.0 * r2 * sx2, sy1 + 2.0 * r2 * sy2);
        let cross = 2.0 * (p1 * at.x + p2 * at.y);
        let tangential = DMat2::from_cols(
            DVec2::new(2.0 * p1 * at.y + 6.0 * p2 * at.x, cross) + prism * at.x,
            DVec2::new(cross, 6.0 * p1 * at.y + 2.0 * p2 * at.x) + prism * at.y,
        );
        radial
            + if self.is_chained {
                tangential * radial
            } else {
                tangential
            }
    }

    /// Removes the distortion of a position; `None` if no position within the limit has it.
    fn undo(&self, distorted: DVec2) -> Option<DVec2> {
        /// Number of halvings and of Newton's steps: enough for the last digit.
        const STEPS: u32 = 60;
        /// Largest error, focal lengths.
        const TOLERANCE: f64 = 1e-12;
        let radius = distorted.length();
        let mut range = [0.0, self.limit];
        for _ in 0..STEPS {
            let middle = 0.5 * (range[0] + range[1]);
            let is_below = middle * self.radial_factor(middle * middle) < radius;
            range[usize::from(!is_below)] = middle;
        }
        let mut p = distorted.normalize_or_zero() * range[0];
        for _ in 0..STEPS {
            let error = self.evaluate(p) - distorted;
            if error.length() <= TOLERANCE * (1.0 + radius) {
                break;
            }
            let jacobian = self.jacobian(p);
            let step = jacobian.inverse() * error;
            if !step.is_finite() {
                return None;
            }
            p -= step.clamp_length_max(0.1 + 0.1 * p.length());
        }
        let error = (self.evaluate(p) - distorted).length();
        (error <= 1e3 * TOLERANCE * (1.0 + radius) && p.length() <= self.limit + 1e-9).then_some(p)
    }
}

impl Projection {
    /// Projects a direction; `None` outside the field of view.
    fn project(&self, direction: DVec3) -> Option<DVec2> {
        let across = direction.truncate();
        let rho = across.length();
        let z = direction.z;
        match *self {
            Self::Plane(polynomial) => (z > 0.0).then(|| polynomial.apply(across / z)).flatten(),
            Self::Fisheye(polynomial) => {
                let angle = rho.atan2(z);
                polynomial.apply(across.normalize_or(DVec2::X) * angle)
            }
            Self::FieldOfView(omega) => (z > 0.0).then(|| {
                let radius = rho / z;
                let scale = 2.0 * (omega / 2.0).tan();
                let factor = if radius > 0.0 {
                    (radius * scale).atan() / (radius * omega)
                } else {
                    scale / omega
                };
                across / z * factor
            }),
            Self::Division(k) => {
                let square = z * z - 4.0 * rho * rho * k;
                let sum = z + square.max(0.0).sqrt();
                (square >= 0.0 && sum > 0.0 && (k < 0.0 || z > 0.0)).then(|| across * 2.0 / sum)
            }
            Self::ExtendedUnified([alpha, beta]) => {
                let distance = (beta * rho * rho + z * z).sqrt();
                let below = if alpha <= 0.5 {
                    alpha / (1.0 - alpha)
                } else {
                    (1.0 - alpha) / alpha
                };
                let divisor = alpha * distance + (1.0 - alpha) * z;
                (divisor > 0.0 && z > -below * distance).then(|| across / divisor)
            }
        }
    }

    /// Returns the unit direction of a position; `None` outside the field of view.
    fn direction(&self, p: DVec2) -> Option<DVec3> {
        let r2 = p.length_squared();
        let direction = match *self {
            Self::Plane(polynomial) => polynomial.undo(p)?.extend(1.0),
            Self::Fisheye(polynomial) => {
                let position = polynomial.undo(p)?;
                let (sin, cos) = position.length().sin_cos();
                (position.normalize_or_zero() * sin).extend(cos)
            }
            Self::FieldOfView(omega) => {
                let angle = p.length() * omega.abs();
                if angle >= PLANE_LIMIT {
                    return None;
                }
                let scale = 2.0 * (omega.abs() / 2.0).tan();
                (p.normalize_or_zero() * (angle.tan() / scale)).extend(1.0)
            }
            Self::Division(k) => {
                if k * r2 > 1.0 {
                    return None;
                }
                p.extend(1.0 + k * r2)
            }
            Self::ExtendedUnified([alpha, beta]) => {
                let square = 1.0 - (2.0 * alpha - 1.0) * beta * r2;
                let divisor = alpha * square.max(0.0).sqrt() + 1.0 - alpha;
                if square < 0.0 || divisor <= 0.0 {
                    return None;
                }
                p.extend((1.0 - alpha * alpha * beta * r2) / divisor)
            }
        };
        direction.try_normalize()
    }

    fn is_finite(&self) -> bool {
        match *self {
            Self::Plane(p) | Self::Fisheye(p) => {
                let terms = p.radial.iter().chain(&p.tangential).chain(&p.prism);
                terms.into_iter().all(|term| term.is_finite())
            }
            Self::FieldOfView(number) | Self::Division(number) => number.is_finite(),
            Self::ExtendedUnified(numbers) => numbers.iter().all(|number| number.is_finite()),
        }
    }
}

impl CameraModel {
    /// Returns the model if its numbers are plausible.
    ///
    /// # Errors
    /// The problem, as the rest of a sentence about the field.
    pub(crate) fn checked(self) -> Result<Self, &'static str> {
        super::lens::check_px(self.focal_px, self.principal_px)?;
        if !self.projection.is_finite() {
            return Err("has a distortion coefficient that is not finite");
        }
        match self.projection {
            Projection::FieldOfView(omega) if !(omega != 0.0 && omega.abs() < PI) => {
                Err("has an omega that is 0 or not below pi")
            }
            Projection::ExtendedUnified([alpha, beta])
                if !((0.0..=1.0).contains(&alpha) && beta > 0.0) =>
            {
                Err("has an alpha outside 0..=1 or a beta that is not above 0")
            }
            _ => Ok(self),
        }
    }

    /// Projects a point of eye space to a position in pixels; `None` outside the field of view.
    pub fn project(&self, point: DVec3) -> Option<[f64; 2]> {
        let p = self
            .projection
            .project(point * DVec3::new(1.0, -1.0, -1.0))?;
        Some([0, 1].map(|axis| self.principal_px[axis] + self.focal_px[axis] * p[axis]))
    }

    /// Returns the unit ray of eye space through a position in pixels; `None` outside the field of
    /// view.
    pub fn ray(&self, position: [f64; 2]) -> Option<DVec3> {
        let [x, y] =
            [0, 1].map(|axis| (position[axis] - self.principal_px[axis]) / self.focal_px[axis]);
        let direction = self.projection.direction(DVec2::new(x, y))?;
        Some(direction * DVec3::new(1.0, -1.0, -1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fisheye(radial: &[f64]) -> Projection {
        Projection::Fisheye(Polynomial::of_angles(radial, [0.0; 2], [0.0; 4], false))
    }

    fn model(projection: Projection, focal: f64) -> CameraModel {
        let model = CameraModel {
            focal_px: [focal, focal * 1.02],
            principal_px: [81.3, 58.2],
            projection,
        };
        model.checked().expect("plausible")
    }

    #[test]
    fn project_inverts_ray_over_whole_image() {
        let strong = Polynomial::of_angles(
            &[0.03, -0.01, 0.002, 0.001, -0.0002, 0.00001],
            [0.002, -0.001],
            [0.001, 0.0003, -0.002, 0.0001],
            true,
        );
        let prism = Polynomial::of_angles(
            &[0.05, -0.01],
            [0.001, 0.002],
            [0.002, 0.0, 0.001, 0.0],
            false,
        );
        let plane = Polynomial::of_plane(&[-0.1, 0.05, -0.01, 0.3], [0.001, -0.002]);
        // Half the width of the image is 81 px: an angle of 81 / focal for an equidistant fisheye.
        for (projection, focal, is_whole) in [
            (Projection::Plane(plane), 120.0, true),
            (fisheye(&[]), 70.0, true),
            (fisheye(&[]), 40.0, true),
            (fisheye(&[0.1, 0.0, 0.0, 0.0]), 60.0, true),
            (fisheye(&[-0.05, 0.01]), 60.0, true),
            (Projection::Fisheye(strong), 60.0, true),
            (Projection::Fisheye(prism), 60.0, true),
            (Projection::FieldOfView(0.9), 110.0, true),
            (Projection::FieldOfView(1e-4), 110.0, true),
            (Projection::Division(-0.3), 60.0, true),
            (Projection::Division(0.1), 60.0, true),
            (Projection::ExtendedUnified([0.6, 1.1]), 60.0, true),
            (Projection::ExtendedUnified([0.0, 1.0]), 60.0, true),
            (Projection::ExtendedUnified([0.3, 0.8]), 60.0, true),
            (fisheye(&[]), 25.0, false),
            (fisheye(&[-0.3]), 60.0, false),
        ] {
            let model = model(projection, focal);
            let mut seen = 0;
            for (x, y) in (0..120).flat_map(|y| (0..160).map(move |x| (x, y))) {
                let position = [f64::from(x) + 0.5, f64::from(y) + 0.5];
                let Some(ray) = model.ray(position) else {
                    assert!(!is_whole, "{projection:?} at {position:?}");
                    continue;
                };
                seen += 1;
                let back = model.project(ray * 3.0).expect("in the field of view");
                let error = (back[0] - position[0]).hypot(back[1] - position[1]);
                assert!(error < 1e-8, "{projection:?} at {position:?}: {back:?}");
            }
            assert!(seen > 5000, "{projection:?}: {seen}");
        }
    }

    #[test]
    fn fisheye_sees_behind_eye() {
        let model = model(fisheye(&[]), 40.0);
        // 81 px at 40 px a radian: 2.03 rad from the axis.
        let ray = model.ray([0.0, 58.2]).expect("seen");
        assert!(ray.z > 0.4 && ray.x < 0.0, "{ray}");
        let angle: f64 = 100_f64.to_radians();
        let [x, y] = model
            .project(DVec3::new(angle.sin(), 0.0, -angle.cos()))
            .expect("seen");
        assert!((x - (81.3 + 40.0 * angle)).abs() < 1e-9 && (y - 58.2).abs() < 1e-9);
    }

    #[test]
    fn folded_polynomial_ends_at_its_maximum() {
        let model = model(fisheye(&[-0.3]), 60.0);
        // The distorted angle a - 0.3 a^3 grows up to a = 1.054.
        let seen = |angle: f64| model.project(DVec3::new(angle.sin(), 0.0, -angle.cos()));
        assert!(seen(1.05).is_some() && seen(1.06).is_none());
    }

    #[test]
    fn implausible_model_refused() {
        let refused = |projection| {
            let model = CameraModel {
                focal_px: [50.0; 2],
                principal_px: [50.0; 2],
                projection,
            };
            model.checked().expect_err("implausible")
        };
        assert!(refused(fisheye(&[f64::NAN])).contains("not finite"));
        assert!(refused(Projection::FieldOfView(0.0)).contains("omega"));
        assert!(refused(Projection::ExtendedUnified([1.5, 1.0])).contains("alpha"));
    }
}
