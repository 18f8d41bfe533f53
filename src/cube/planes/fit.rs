//! Least-squares planes through samples: planes are affine in inverse depth over face pixels.

use glam::{DMat3, DVec3};

/// Sums of a least-squares fit, about an origin on the face.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fit {
    origin: [f64; 2],
    /// Sums of 1, x, y, x^2, x y, y^2.
    moments: [f64; 6],
    /// Sum of inverse depth times (1, x, y).
    values: DVec3,
}

/// An affine inverse depth: `coefficients . (1, x - x0, y - y0)`, 1/m.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Affine {
    pub(super) origin: [f64; 2],
    pub(super) coefficients: DVec3,
}

impl Affine {
    /// Evaluates the inverse depth at a position on the face, 1/m.
    #[inline(always)]
    pub(super) fn inverse_depth(&self, x: f64, y: f64) -> f64 {
        let [q, along_x, along_y] = self.coefficients.to_array();
        q + along_x * (x - self.origin[0]) + along_y * (y - self.origin[1])
    }

    /// Computes the distance of an inverse depth `q` from the range of the plane within the pixel
    /// with centre (x, y): the position of a sample inside its pixel is unknown.
    #[inline(always)]
    pub(super) fn distance(&self, x: f64, y: f64, q: f64) -> f64 {
        let within = 0.5 * (self.coefficients.y.abs() + self.coefficients.z.abs());
        ((q - self.inverse_depth(x, y)).abs() - within).max(0.0)
    }

    /// Returns the coefficients of (1, x, y), about the face's upper left corner.
    pub(super) fn face_coefficients(&self) -> [f64; 3] {
        let [_, along_x, along_y] = self.coefficients.to_array();
        [self.inverse_depth(0.0, 0.0), along_x, along_y]
    }
}

impl Fit {
    pub(super) fn new(origin: [f64; 2]) -> Self {
        Self {
            origin,
            moments: [0.0; 6],
            values: DVec3::ZERO,
        }
    }

    /// Number of samples.
    pub(super) fn count(&self) -> f64 {
        self.moments[0]
    }

    #[inline(always)]
    pub(super) fn add(&mut self, x: f64, y: f64, q: f64) {
        let (x, y) = (x - self.origin[0], y - self.origin[1]);
        for (sum, value) in self
            .moments
            .iter_mut()
            .zip([1.0, x, y, x * x, x * y, y * y])
        {
            *sum += value;
        }
        self.values += DVec3::new(q, q * x, q * y);
    }

    /// Computes the least-squares plane, or `None` if the samples lie on a line.
    pub(super) fn solve(&self) -> Option<Affine> {
        let [n, x, y, xx, xy, yy] = self.moments;
        let matrix = DMat3::from_cols(
            DVec3::new(n, x, y),
            DVec3::new(x, xx, xy),
            DVec3::new(y, xy, yy),
        );
        let [spread_x, spread_y] = [xx - x * x / n, yy - y * y / n];
        if !(n >= 3.0
            && matrix.determinant() > 1e-6 * n * spread_x * spread_y
            && spread_x > 0.1
            && spread_y > 0.1)
        {
            return None;
        }
        let coefficients = matrix.inverse() * self.values;
        coefficients.is_finite().then_some(Affine {
            origin: self.origin,
            coefficients,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fit_finds_affine_depth_not_lines() {
        let q = |x: f64, y: f64| 0.4 + 0.002 * x - 0.013 * y;
        let mut fit = Fit::new([900.5, 30.5]);
        for (x, y) in [
            (890.5, 31.5),
            (903.5, 20.5),
            (901.5, 44.5),
            (900.5, 30.5),
            (920.5, 39.5),
        ] {
            fit.add(x, y, q(x, y));
        }
        let found = fit.solve().expect("a plane");
        assert!((found.inverse_depth(3.0, 700.0) - q(3.0, 700.0)).abs() < 1e-9);
        assert_eq!(
            found.distance(10.5, 7.5, q(10.9, 7.2)),
            0.0,
            "elsewhere in the pixel"
        );
        assert!((found.distance(10.5, 7.5, q(10.5, 7.5) + 1.0) - (1.0 - 0.0075)).abs() < 1e-9);
        let mut line = Fit::new([0.0; 2]);
        (0..9).for_each(|i| line.add(f64::from(i), 2.0 * f64::from(i), 1.0));
        assert_eq!(line.solve(), None);
    }
}
