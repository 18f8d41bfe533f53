//! Clusters: samples of one surface of a face that can be drawn as one surfel.

use super::leaves::Leaf;
use crate::points::surfels::Surfel;
use glam::{DVec2, DVec3, Vec3};
use headbox_core::cube_face::Face;

/// Squared error of displaced rims and of missing samples, levels^2 of 255, the sum of three
/// channels: an assumed contrast of 64 levels.
pub(super) const RIM_ERROR: f64 = 3.0 * 64.0 * 64.0;
/// Largest relative change of inverse depth over a cluster: its surfel is an ellipse on a plane in
/// space, whose image is not one beyond that.
const MAX_RECESSION: f64 = 0.5;
/// Weight of the samples' own slopes in the fit of a plane, per sample.
const SLOPE_WEIGHT: f64 = 0.02;

/// Sums over the samples of a cluster.
#[derive(Clone)]
pub(super) struct Cluster {
    /// Samples merge within a surface only: a plane texture, the environment, or all samples.
    pub(super) surface: u32,
    /// Index of a leaf, the only one if `count` is 1.
    pub(super) leaf: u32,
    /// Number of samples.
    pub(super) count: f64,
    /// Sum of solid angle x visibility x coverage; 1 is a pixel in the middle of a face.
    pub(super) weight: f64,
    /// Squared error of colours, levels^2, the sum of three channels, times weight, if it is drawn
    /// as one surfel.
    pub(super) error: f64,
    /// Squared error per surfel saved, at least that of all clusters of which it was merged.
    pub(super) lambda: f64,
    /// Sum of coverages, 0 to 1 each.
    coverage: f64,
    /// Sums of weighted colours, and of their squares.
    color: DVec3,
    color_squared: f64,
    /// Sums of positions on the face, pixels.
    at: DVec2,
    /// Sums of x^2, x y and y^2.
    at_squared: [f64; 3],
    /// Sum of inverse depths, of their squares, and of their products with the position.
    inverse_depth: f64,
    inverse_depth_squared: f64,
    at_inverse_depth: DVec2,
    /// Sum of changes of inverse depth per pixel right and down.
    slopes: DVec2,
}

/// Plane of a cluster.
struct Fit {
    /// Mean position, pixels.
    at: DVec2,
    /// Inverse depth there, and its change per pixel right and down.
    inverse_depth: f64,
    slopes: DVec2,
    /// Variances and covariance of positions, with the area of the pixels: xx, xy, yy.
    spread: [f64; 3],
    /// Mean squared error of inverse depth.
    squared_error: f64,
}

impl Fit {
    /// Returns the area of a uniform parallelogram with this spread, pixels.
    fn area_px(&self) -> f64 {
        let [xx, xy, yy] = self.spread;
        12.0 * (xx * yy - xy * xy).max(0.0).sqrt()
    }

    /// Returns the sides of a uniform rectangle with this spread, pixels.
    fn sides(&self) -> [DVec2; 2] {
        let [xx, xy, yy] = self.spread;
        let angle = (2.0 * xy).atan2(xx - yy) / 2.0;
        let (mean, apart) = (f64::midpoint(xx, yy), ((xx - yy) / 2.0).hypot(xy));
        let major = DVec2::from_angle(angle);
        let side = |variance: f64| (12.0 * variance.max(0.0)).sqrt();
        [
            major * side(mean + apart),
            major.perp() * side(mean - apart),
        ]
    }
}

impl Cluster {
    /// Mean inverse depth, 1/m.
    pub(super) fn inverse_depth(&self) -> f64 {
        self.inverse_depth / self.count
    }

    fn sum(&self, other: &Self) -> Self {
        Self {
            surface: self.surface,
            leaf: self.leaf,
            count: self.count + other.count,
            weight: self.weight + other.weight,
            error: 0.0,
            lambda: 0.0,
            coverage: self.coverage + other.coverage,
            color: self.color + other.color,
            color_squared: self.color_squared + other.color_squared,
            at: self.at + other.at,
            at_squared: [0, 1, 2].map(|i| self.at_squared[i] + other.at_squared[i]),
            inverse_depth: self.inverse_depth + other.inverse_depth,
            inverse_depth_squared: self.inverse_depth_squared + other.inverse_depth_squared,
            at_inverse_depth: self.at_inverse_depth + other.at_inverse_depth,
            slopes: self.slopes + other.slopes,
        }
    }

    /// Fits a plane by least squares, with a small weight on the samples' own slopes.
    fn fit(&self) -> Fit {
        let n = self.count;
        let (at, q) = (self.at / n, self.inverse_depth / n);
        let squares = [at.x * at.x, at.x * at.y, at.y * at.y];
        let [xx, xy, yy] = [0, 1, 2].map(|i| self.at_squared[i] / n - squares[i]);
        let qq = self.inverse_depth_squared / n - q * q;
        let to_q = self.at_inverse_depth / n - at * q;
        let own = self.slopes / n;
        let (a, d) = (xx + SLOPE_WEIGHT, yy + SLOPE_WEIGHT);
        let right = to_q + own * SLOPE_WEIGHT;
        let determinant = a * d - xy * xy;
        let slopes =
            DVec2::new(d * right.x - xy * right.y, a * right.y - xy * right.x) / determinant;
        let explained = 2.0 * slopes.dot(to_q)
            - slopes.x * slopes.x * xx
            - 2.0 * slopes.x * slopes.y * xy
            - slopes.y * slopes.y * yy;
        /// Variance of the positions inside a pixel.
        const PIXEL: f64 = 1.0 / 12.0;
        Fit {
            at,
            inverse_depth: q,
            slopes,
            spread: [xx + PIXEL, xy, yy + PIXEL],
            squared_error: (qq - explained).max(0.0),
        }
    }
}

/// Pixels of a face, and what they are worth.
pub(super) struct FaceGrid {
    pub(super) face: Face,
    /// Width of the face, pixels.
    pub(super) face_px: u32,
    /// Solid angle of a pixel in the middle, relative to one of the cube's faces.
    pub(super) solid_angle: f64,
    /// Displacement per inverse depth, pixels x metres.
    pub(super) parallax: f64,
    /// Largest root mean square displacement of the samples of a cluster, as seen from a face of
    /// the headbox, face pixels: more is another surface.
    pub(super) max_displacement_px: f64,
}

impl FaceGrid {
    /// Returns the direction through a position, pixels.
    pub(super) fn direction(&self, at: DVec2) -> DVec3 {
        self.face.direction(at.x, at.y, self.face_px)
    }

    /// Returns the position of a leaf relative to the centre, metres.
    pub(super) fn position(&self, leaf: &Leaf) -> Vec3 {
        (self.direction(leaf.at()) / f64::from(leaf.inverse_depth)).as_vec3()
    }

    /// Returns the cluster of one sample.
    pub(super) fn cluster(&self, leaf: &Leaf) -> Cluster {
        let at = leaf.at();
        let d = self.direction(at);
        let [r, g, b, a] = leaf.color_srgb.map(f64::from);
        let coverage = a / 255.0;
        let weight =
            self.solid_angle * d.length_squared().powf(-1.5) * leaf.visibility() * coverage;
        let color = DVec3::new(r, g, b);
        let (q, normal) = (f64::from(leaf.inverse_depth), leaf.normal.as_dvec3());
        let slopes = DVec2::from(Surfel::slopes(self.face, self.face_px, d, normal)) * q;
        Cluster {
            surface: leaf.surface,
            leaf: leaf.number,
            count: 1.0,
            weight,
            error: 0.0,
            lambda: 0.0,
            coverage,
            color: color * weight,
            color_squared: color.length_squared() * weight,
            at,
            at_squared: [at.x * at.x, at.x * at.y, at.y * at.y],
            inverse_depth: q,
            inverse_depth_squared: q * q,
            at_inverse_depth: at * q,
            slopes,
        }
    }

    /// Merges two clusters; `None` if they do not lie on one plane.
    pub(super) fn merged(&self, a: &Cluster, b: &Cluster) -> Option<Cluster> {
        if a.surface != b.surface {
            return None;
        }
        let mut merged = a.sum(b);
        let fit = merged.fit();
        let displacement = fit.squared_error.sqrt() * self.parallax;
        let [major, minor] = fit.sides();
        let recession = fit.slopes.dot(major).abs() + fit.slopes.dot(minor).abs();
        if displacement > self.max_displacement_px || recession > MAX_RECESSION * fit.inverse_depth
        {
            return None;
        }
        let weight = merged.weight.max(f64::MIN_POSITIVE);
        let colors = merged.color_squared - merged.color.length_squared() / weight;
        // The share of the surfel that reaches over the rims of the samples.
        let beyond = (fit.area_px() / merged.count - 1.0).max(0.0);
        let rims = RIM_ERROR * (displacement.powi(2) + beyond) * merged.weight;
        merged.error = colors.max(0.0) + rims;
        Some(merged)
    }

    /// Returns the surfel of a cluster of several samples: on their plane, with their spread.
    pub(super) fn surfel(&self, cluster: &Cluster) -> Surfel {
        let fit = cluster.fit();
        let (d, q) = (self.direction(fit.at), fit.inverse_depth);
        let pixel = 2.0 / f64::from(self.face_px);
        let [right, down] = [self.face.right(), -self.face.up()].map(|step| step * pixel);
        let along = fit.sides().map(|side| {
            let step = right * side.x + down * side.y;
            (step - d * (fit.slopes.dot(side) / q)) / q
        });
        // On a plane n . d is proportional to inverse depth, negative toward the centre.
        let middle = DVec2::splat(f64::from(self.face_px) / 2.0);
        let ahead = q + fit.slopes.dot(middle - fit.at);
        let [to_right, to_bottom] = (fit.slopes / pixel).to_array();
        let normal =
            self.face.normal() * ahead + self.face.right() * to_right - self.face.up() * to_bottom;
        let opacity = (cluster.coverage / fit.area_px()).min(1.0);
        let [r, g, b] = (cluster.color / cluster.weight.max(f64::MIN_POSITIVE)).to_array();
        Surfel {
            position: d / q,
            normal: -normal.try_normalize().unwrap_or(d.normalize()),
            along,
            color_srgb: [r, g, b, opacity * 255.0].map(|c| c.round() as u8),
        }
    }
}
