//! Lens models: pinholes with OpenCV's distortion, and equirectangular panoramas.

use glam::{DMat2, DVec2, DVec3};

/// Mapping between pixels and rays in eye space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lens {
    /// A perspective image.
    Pinhole(Pinhole),
    /// All directions: longitude across, latitude down; the centre looks down -Z, as in Blender and
    /// nerfstudio.
    Equirectangular,
}

/// Intrinsics of a perspective image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pinhole {
    /// Focal lengths, pixels.
    pub focal_px: [f64; 2],
    /// Principal point, pixels; pixel centres at half-integers.
    pub principal_px: [f64; 2],
    /// Lens distortion.
    pub distortion: Distortion,
}

/// Maximum focal length and principal point of a camera, pixels: an image of 2^16 pixels through a
/// lens of a thousandth of a degree.
const FARTHEST_PX: f64 = 1e10;

impl Pinhole {
    /// Returns the lens if its numbers are plausible.
    ///
    /// # Errors
    /// The problem, as the rest of a sentence about the field.
    pub(crate) fn checked(self) -> Result<Self, &'static str> {
        check_px(self.focal_px, self.principal_px)?;
        let Distortion { radial, tangential } = self.distortion;
        if radial.iter().chain(&tangential).all(|k| k.is_finite()) {
            Ok(self)
        } else {
            Err("has a distortion coefficient that is not finite")
        }
    }

    /// Returns the length of the ray at eye depth 1 through a position in the distorted image.
    pub(crate) fn distorted_ray_length(&self, position: [f64; 2]) -> f64 {
        let [x, y] =
            [0, 1].map(|axis| (position[axis] - self.principal_px[axis]) / self.focal_px[axis]);
        self.distortion
            .invert(DVec2::new(x, y))
            .extend(1.0)
            .length()
    }

    /// Scales the lens from one size of the image to another.
    #[must_use]
    pub(crate) fn scaled(self, from: [u32; 2], to: [u32; 2]) -> Self {
        let factor = [0, 1].map(|axis| f64::from(to[axis]) / f64::from(from[axis]));
        Self {
            focal_px: [0, 1].map(|axis| self.focal_px[axis] * factor[axis]),
            principal_px: [0, 1].map(|axis| self.principal_px[axis] * factor[axis]),
            ..self
        }
    }
}

/// Checks that a focal length and a principal point are plausible.
///
/// # Errors
/// The problem, as the rest of a sentence about the field.
pub(super) fn check_px(focal_px: [f64; 2], principal_px: [f64; 2]) -> Result<(), &'static str> {
    if !focal_px.iter().all(|&focal| focal > 0.0) {
        return Err("has a focal length that is not above 0");
    }
    let is_near = |px: &f64| px.abs() <= FARTHEST_PX;
    if !focal_px.iter().chain(&principal_px).all(is_near) {
        return Err("has a focal length or a principal point of more than 1e10 pixels");
    }
    Ok(())
}

/// OpenCV's distortion of normalised positions: `radial` holds k1, k2, k3 of the numerator and k4,
/// k5, k6 of the denominator, `tangential` p1 and p2. All zero for none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Distortion {
    /// k1 to k6.
    pub radial: [f64; 6],
    /// p1, p2.
    pub tangential: [f64; 2],
}

impl Distortion {
    /// Returns true if the lens is ideal.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// Maps a position in the ideal image to the distorted one; positions are normalised (x right,
    /// y down, at depth 1).
    pub fn apply(&self, p: DVec2) -> DVec2 {
        let ([k1, k2, k3, k4, k5, k6], [p1, p2]) = (self.radial, self.tangential);
        let r2 = p.length_squared();
        let series = |a: f64, b: f64, c: f64| 1.0 + r2 * (a + r2 * (b + r2 * c));
        let radial = series(k1, k2, k3) / series(k4, k5, k6);
        let xy2 = 2.0 * p.x * p.y;
        let tangential = DVec2::new(
            p1 * xy2 + p2 * (r2 + 2.0 * p.x * p.x),
            p1 * (r2 + 2.0 * p.y * p.y) + p2 * xy2,
        );
        p * radial + tangential
    }

    /// Maps a position in the distorted image to the ideal one, by Newton's method; returns the
    /// position itself where that does not converge.
    pub(crate) fn invert(&self, distorted: DVec2) -> DVec2 {
        const STEPS: u32 = 20;
        const DIFFERENCE: f64 = 1e-5;
        let mut p = distorted;
        for _ in 0..STEPS {
            let error = self.apply(p) - distorted;
            if error.length() < 1e-10 {
                return p;
            }
            let slope = |axis: DVec2| {
                let step = axis * DIFFERENCE;
                (self.apply(p + step) - self.apply(p - step)) / (2.0 * DIFFERENCE)
            };
            p -= DMat2::from_cols(slope(DVec2::X), slope(DVec2::Y)).inverse() * error;
        }
        distorted
    }
}

impl Lens {
    /// Returns the ray in eye space through a position in pixels, ignoring distortion: at eye depth
    /// 1 for a pinhole, of length 1 for a panorama. A pixel's depth is a multiple of it.
    pub fn ray(&self, [x, y]: [f64; 2], [width, height]: [u32; 2]) -> DVec3 {
        match self {
            Self::Pinhole(Pinhole {
                focal_px,
                principal_px,
                ..
            }) => DVec3::new(
                (x - principal_px[0]) / focal_px[0],
                (principal_px[1] - y) / focal_px[1],
                -1.0,
            ),
            Self::Equirectangular => {
                let longitude = (x / f64::from(width) - 0.5) * std::f64::consts::TAU;
                let latitude = (0.5 - y / f64::from(height)) * std::f64::consts::PI;
                let (sin, cos) = longitude.sin_cos();
                DVec3::new(latitude.cos() * sin, latitude.sin(), -latitude.cos() * cos)
            }
        }
    }

    /// Projects a point in eye space: position in pixels, and depth as a multiple of [`Self::ray`];
    /// `None` behind a pinhole.
    pub fn project(&self, point: DVec3, [width, height]: [u32; 2]) -> Option<[f64; 3]> {
        match self {
            Self::Pinhole(Pinhole {
                focal_px,
                principal_px,
                ..
            }) => {
                let depth = -point.z;
                (depth > 0.0).then(|| {
                    [
                        principal_px[0] + focal_px[0] * point.x / depth,
                        principal_px[1] - focal_px[1] * point.y / depth,
                        depth,
                    ]
                })
            }
            Self::Equirectangular => {
                let distance = point.length();
                (distance > 0.0).then(|| {
                    let longitude = point.x.atan2(-point.z);
                    let latitude = (point.y / distance).clamp(-1.0, 1.0).asin();
                    [
                        (longitude / std::f64::consts::TAU + 0.5) * f64::from(width),
                        (0.5 - latitude / std::f64::consts::PI) * f64::from(height),
                        distance,
                    ]
                })
            }
        }
    }

    /// Returns the pixels per radian at the centre of the image.
    pub fn pixels_per_radian(&self, [width, _]: [u32; 2]) -> f64 {
        match self {
            Self::Pinhole(pinhole) => (pinhole.focal_px[0] * pinhole.focal_px[1]).sqrt(),
            Self::Equirectangular => f64::from(width) / std::f64::consts::TAU,
        }
    }

    /// Returns the lens without distortion.
    pub fn ideal(self) -> Self {
        match self {
            Self::Pinhole(pinhole) => Self::Pinhole(Pinhole {
                distortion: Distortion::default(),
                ..pinhole
            }),
            Self::Equirectangular => self,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [u32; 2] = [640, 480];

    #[test]
    fn inverted_distortion_is_exact() {
        let lens = Distortion {
            radial: [-0.2, 0.05, 0.01, 0.02, 0.0, 0.0],
            tangential: [0.003, -0.002],
        };
        for p in [DVec2::ZERO, DVec2::new(0.6, -0.4), DVec2::new(-0.1, 0.5)] {
            assert!((lens.invert(lens.apply(p)) - p).length() < 1e-9, "{p}");
        }
    }

    fn pinhole() -> Lens {
        let distortion = Distortion::default();
        Lens::Pinhole(Pinhole {
            focal_px: [500.0, 510.0],
            principal_px: [321.0, 239.5],
            distortion,
        })
    }

    #[test]
    fn implausible_lens_refused() {
        let Lens::Pinhole(good) = pinhole() else {
            panic!("not a pinhole")
        };
        assert_eq!(good.checked(), Ok(good));
        let refused = |change: fn(&mut Pinhole)| {
            let mut lens = good;
            change(&mut lens);
            lens.checked().expect_err("implausible")
        };
        assert!(refused(|lens| lens.focal_px[1] = 0.0).contains("not above 0"));
        assert!(refused(|lens| lens.focal_px[0] = f64::NAN).contains("not above 0"));
        assert!(refused(|lens| lens.focal_px[0] = 1e300).contains("more than 1e10"));
        assert!(refused(|lens| lens.principal_px[1] = -1e300).contains("more than 1e10"));
        assert!(refused(|lens| lens.distortion.radial[5] = f64::INFINITY).contains("distortion"));
    }

    #[test]
    fn project_inverts_ray() {
        for lens in [pinhole(), Lens::Equirectangular] {
            for (x, y, depth) in [(10.5, 20.5, 0.3), (320.0, 240.0, 2.0), (639.5, 479.5, 70.0)] {
                let [px, py, projected] = lens
                    .project(lens.ray([x, y], SIZE) * depth, SIZE)
                    .expect("in front");
                assert!(
                    (px - x).abs() < 1e-9
                        && (py - y).abs() < 1e-9
                        && (projected - depth).abs() < 1e-9
                );
            }
        }
        assert!(
            pinhole().project(DVec3::Z, SIZE).is_none(),
            "behind the eye"
        );
    }

    #[test]
    fn panorama_axes() {
        let ray = |x, y| Lens::Equirectangular.ray([x, y], SIZE);
        assert!((ray(320.0, 240.0) - DVec3::NEG_Z).length() < 1e-12);
        assert!((ray(480.0, 240.0) - DVec3::X).length() < 1e-12);
        assert!((ray(320.0, 0.0) - DVec3::Y).length() < 1e-12);
    }
}
