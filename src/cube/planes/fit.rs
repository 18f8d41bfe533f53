//! Planes through samples: least squares of inverse depth over face pixels, where planes are
//! affine.

use glam::{DMat3, DVec3};

/// Sums over samples, about an origin on the face.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fit {
    origin: [f64; 2],
    /// Moments: products of (1, x, y) with themselves.
    moments: [f64; 6],
    /// Inverse depth times (1, x, y).
    values: DVec3,
}

/// An affine inverse depth: `at . (1, x - x0, y - y0)`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Affine {
    pub(super) origin: [f64; 2],
    pub(super) at: DVec3,
}

impl Affine {
    /// Inverse depth at a position on the face, 1/m.
    #[inline(always)]
    pub(super) fn inverse_depth(&self, x: f64, y: f64) -> f64 {
        self.at.x + self.at.y * (x - self.origin[0]) + self.at.z * (y - self.origin[1])
    }

    /// Distance of an inverse depth in the pixel with centre (x, y) from the range of the plane
    /// within the pixel.
    ///
    /// A sample says in which pixel rays met a surface, not where in it.
    #[inline(always)]
    pub(super) fn distance(&self, x: f64, y: f64, q: f64) -> f64 {
        let within = 0.5 * (self.at.y.abs() + self.at.z.abs());
        ((q - self.inverse_depth(x, y)).abs() - within).max(0.0)
    }

    /// The coefficients of (1, x, y).
    pub(super) fn coefficients(&self) -> [f64; 3] {
        [self.inverse_depth(0.0, 0.0), self.at.y, self.at.z]
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

    /// The plane of least squares, or `None` if the samples lie on a line.
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
        let at = matrix.inverse() * self.values;
        at.is_finite().then_some(Affine {
            origin: self.origin,
            at,
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
