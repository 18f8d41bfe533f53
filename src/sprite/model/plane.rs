//! The plane of a sprite, and its fit to depth samples.

use crate::SpriteError;
use glam::{DMat3, DVec3};
use headbox_core::camera::Camera;
use headbox_core::statistics::median;

/// The plane `normal . X + offset = 0`, world metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpritePlane {
    /// Unit normal ([A B C] of S2).
    pub normal: DVec3,
    /// Signed distance of the world's origin, metres (D of S2).
    pub offset: f64,
}

impl SpritePlane {
    /// Returns the plane through `point` with a normal of any length; a zero normal gives a plane
    /// that is not finite.
    pub fn through(point: DVec3, normal: DVec3) -> Self {
        let normal = normal.normalize();
        Self {
            normal,
            offset: -normal.dot(point),
        }
    }

    /// Returns the plane parallel to the image of `camera` at `eye_depth` metres.
    pub fn parallel_to_image(camera: &Camera, eye_depth: f64) -> Self {
        Self::through(
            camera.eye() + camera.forward() * eye_depth,
            -camera.forward(),
        )
    }

    /// Distance of `point` in metres, positive on the side to which the normal points.
    pub fn signed_distance(&self, point: DVec3) -> f64 {
        self.normal.dot(point) + self.offset
    }

    /// Returns true if every coefficient is finite.
    pub fn is_finite(&self) -> bool {
        self.normal.is_finite() && self.offset.is_finite()
    }

    /// Returns the same plane with its normal towards the side of `eye`.
    #[must_use]
    pub(crate) fn facing(self, eye: DVec3) -> Self {
        if self.signed_distance(eye) < 0.0 {
            Self {
                normal: -self.normal,
                offset: -self.offset,
            }
        } else {
            self
        }
    }

    /// Returns the inverse eye depth (1/Z) of the plane at pixel position (x, y) of `camera`:
    /// affine in (x, y). Zero or negative at and beyond the horizon of the plane.
    pub fn inverse_depth(&self, camera: &Camera, x_px: f64, y_px: f64) -> f64 {
        -self.normal.dot(camera.direction(x_px, y_px)) / self.signed_distance(camera.eye())
    }

    /// Fits a plane to samples of `camera` (x, y in pixels, inverse depth > 0). In inverse depth a
    /// plane is affine in pixels, and equal residuals are equal parallax. Iteratively reweighted
    /// least squares: first least absolute residuals, which a minority of another surface spread
    /// over the picture cannot pull away, then Tukey's biweight, which gives that minority no
    /// weight at all. (A minority all at one side tilts the plane: the remaining displacement is
    /// then larger, not wrong.) Samples that span no area (a single pixel, a row) give the plane
    /// parallel to the image at their median.
    ///
    /// # Errors
    /// [`SpriteError::NoValidDepth`] without samples.
    pub fn fit(camera: &Camera, samples: &[[f64; 3]]) -> Result<Self, SpriteError> {
        let median_inverse_depth =
            median(samples.iter().map(|s| s[2])).ok_or(SpriteError::NoValidDepth)?;
        let flat = Self::parallel_to_image(camera, 1.0 / median_inverse_depth);
        let center = [
            f64::from(camera.width()) / 2.0,
            f64::from(camera.height()) / 2.0,
        ];
        let Some([a, b, c]) = robust_affine(camera.focal_px(), center, samples) else {
            return Ok(flat);
        };
        // q = m . e with the eye-space direction e = (x, -y, -1) in units of the focal length.
        let m = DVec3::new(a, -b, -c);
        let distance = 1.0 / m.length();
        let normal = camera.world_from_eye() * m * -distance;
        let plane = Self {
            normal,
            offset: distance - normal.dot(camera.eye()),
        };
        Ok(
            if plane.is_finite() && plane.inverse_depth(camera, center[0], center[1]) > 0.0 {
                plane
            } else {
                flat
            },
        )
    }
}

/// Rounds of least absolute residuals: enough to remove the influence of a quarter of outliers.
const ABSOLUTE_ROUNDS: usize = 30;

/// Rounds with Tukey's biweight, which converge quickly from a good start.
const BIWEIGHT_ROUNDS: usize = 8;

/// Maximum number of samples; more do not improve the plane.
const MAX_SAMPLES: usize = 1 << 15;

/// Number of robust standard deviations beyond which Tukey's biweight is zero; 4.685 makes it 95 %
/// as efficient as least squares on normal noise.
const TUKEY: f64 = 4.685;

/// Fits `inverse depth = a x + b y + c`, with x and y from the centre in units of the focal length.
/// `None` if the samples span no area.
fn robust_affine(focal_px: f64, center: [f64; 2], samples: &[[f64; 3]]) -> Option<[f64; 3]> {
    let stride = samples.len().div_ceil(MAX_SAMPLES).max(1);
    let relative =
        |&[x, y, q]: &[f64; 3]| [(x - center[0]) / focal_px, (y - center[1]) / focal_px, q];
    let rows: Vec<[f64; 3]> = samples.iter().step_by(stride).map(relative).collect();
    let mut weights = vec![1.0; rows.len()];
    let mut fit = [0.0; 3];
    for round in 0..ABSOLUTE_ROUNDS + BIWEIGHT_ROUNDS {
        fit = weighted_affine(&rows, &weights)?;
        let residuals: Vec<f64> = rows
            .iter()
            .map(|[x, y, q]| q - (fit[0] * x + fit[1] * y + fit[2]))
            .collect();
        // 1.4826 times the median absolute deviation estimates the standard deviation of normal
        // noise.
        let spread = 1.4826 * median(residuals.iter().map(|r| r.abs()))?;
        let spread = spread.max(1e-12 * fit[2].abs()).max(f64::MIN_POSITIVE);
        for (weight, residual) in weights.iter_mut().zip(&residuals) {
            *weight = if round < ABSOLUTE_ROUNDS {
                spread / residual.abs().max(0.1 * spread)
            } else {
                (1.0 - (residual / (TUKEY * spread)).powi(2))
                    .max(0.0)
                    .powi(2)
            };
        }
    }
    Some(fit)
}

/// Fits the coefficients by weighted least squares about the weighted mean.
fn weighted_affine(rows: &[[f64; 3]], weights: &[f64]) -> Option<[f64; 3]> {
    let total: f64 = weights.iter().sum();
    let mean =
        [0, 1, 2].map(|k| rows.iter().zip(weights).map(|(r, w)| r[k] * w).sum::<f64>() / total);
    let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for (row, &weight) in rows.iter().zip(weights) {
        let (x, y, q) = (row[0] - mean[0], row[1] - mean[1], row[2] - mean[2]);
        normal += DMat3::from_cols(
            DVec3::new(x * x, x * y, 0.0),
            DVec3::new(x * y, y * y, 0.0),
            DVec3::ZERO,
        ) * weight;
        right += DVec3::new(x * q, y * q, 0.0) * weight;
    }
    let [xx, xy, yy] = [normal.x_axis.x, normal.x_axis.y, normal.y_axis.y];
    let determinant = xx * yy - xy * xy;
    // Samples on a line have a determinant of zero up to rounding.
    if determinant.is_nan() || determinant <= 1e-12 * (xx + yy).powi(2) || xx + yy <= 0.0 {
        return None;
    }
    let a = (right.x * yy - right.y * xy) / determinant;
    let b = (right.y * xx - right.x * xy) / determinant;
    Some([a, b, mean[2] - a * mean[0] - b * mean[1]])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slanted_plane_found_among_outliers() {
        let camera = Camera::look_at(
            DVec3::new(100.0, 2.0, 5.0),
            DVec3::new(100.3, 1.0, 0.0),
            DVec3::Y,
            50.0,
            [64, 48],
        )
        .expect("valid");
        let truth = SpritePlane::through(DVec3::new(100.0, 1.0, 0.0), DVec3::new(0.3, 0.2, 1.0))
            .facing(camera.eye());
        let samples: Vec<[f64; 3]> = (0..64 * 48)
            .map(|i| {
                let [x, y] = [f64::from(i % 64) + 0.5, f64::from(i / 64) + 0.5];
                let q = truth.inverse_depth(&camera, x, y);
                [
                    x,
                    y,
                    if (i % 64 / 8 + i / 64 / 8) % 4 == 0 {
                        q * 1.5
                    } else {
                        q
                    },
                ] // a quarter is another surface
            })
            .collect();
        let found = SpritePlane::fit(&camera, &samples).expect("samples");
        assert!(
            found.normal.distance(truth.normal) < 1e-9
                && (found.offset - truth.offset).abs() < 1e-7,
            "{found:?}"
        );
    }

    #[test]
    fn too_few_samples_give_the_parallel_plane() {
        let camera =
            Camera::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, 50.0, [8, 8]).expect("valid");
        assert_eq!(
            SpritePlane::fit(&camera, &[]),
            Err(SpriteError::NoValidDepth)
        );
        let single = SpritePlane::fit(&camera, &[[1.5, 2.5, 0.25]]).expect("one sample");
        assert!(
            (single.signed_distance(DVec3::ZERO) - 4.0).abs() < 1e-12
                && single.normal.z.abs() > 0.999_999
        );
        let row: Vec<[f64; 3]> = (0..8).map(|i| [f64::from(i), 3.5, 0.25]).collect();
        assert_eq!(SpritePlane::fit(&camera, &row).expect("a row"), single);
    }
}
