//! Cameras of a lumigraph: a grid on a plane, all looking along its normal (L4).
//!
//! *Plane space* has its origin on the plane; x points right, y up and z *forward*, in the viewing
//! direction of the cameras, so that a surface at depth z has disparity 1/z, and an eye behind the
//! plane a negative z. A ray is described by its eye and its *slopes*: x and y per unit of z.

use super::LumigraphError;
use glam::{DMat3, DVec2, DVec3};
use headbox_core::camera::{Camera, fov_deg};

/// Grid of cameras in columns and rows, not necessarily evenly spaced (the paper's limitation 1),
/// with a common focal length and image size.
///
/// Invariants: at least one column and one row, each in ascending order; all numbers finite.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraGrid {
    parts: GridParts,
    /// Camera at the origin.
    first: Camera,
}

/// Parameters of a [`CameraGrid`].
#[derive(Clone, Debug, PartialEq)]
pub struct GridParts {
    /// Origin of plane space, a point of the plane, world metres.
    pub origin: DVec3,
    /// Axes of all cameras, as [`Camera::world_from_eye`]: right, up, and back, the negative normal
    /// of the plane.
    pub world_from_eye: DMat3,
    /// Camera positions to the right of the origin, metres, ascending.
    pub columns: Vec<f64>,
    /// Camera positions above the origin, metres, ascending.
    pub rows: Vec<f64>,
    /// Focal length of the images, pixels.
    pub focal_px: f64,
    /// Width and height of the images, pixels.
    pub size_px: [u32; 2],
    /// Disparity at which all images show the same part of the scene, 1/m; it shifts the principal
    /// points. 0 for the paper's parallel frusta.
    pub convergence: f64,
}

impl CameraGrid {
    /// Creates a grid from its parameters.
    ///
    /// # Errors
    /// [`LumigraphError::NoCameras`], [`LumigraphError::Grid`], [`LumigraphError::Size`],
    /// [`LumigraphError::TooLarge`].
    pub fn new(parts: GridParts) -> Result<Self, LumigraphError> {
        let GridParts {
            origin,
            world_from_eye,
            ref columns,
            ref rows,
            focal_px,
            size_px: [width, height],
            convergence,
        } = parts;
        if columns.is_empty() || rows.is_empty() {
            return Err(LumigraphError::NoCameras);
        }
        for (places, name) in [(columns, "columns"), (rows, "rows")] {
            let ascending = places.windows(2).all(|pair| pair[0] < pair[1]);
            if !ascending || !places.iter().all(|place| place.is_finite()) {
                return Err(LumigraphError::Grid(name));
            }
        }
        if !origin.is_finite() || !world_from_eye.is_finite() {
            return Err(LumigraphError::Grid("place"));
        }
        if !(1e-3..1e9).contains(&focal_px) || !convergence.is_finite() {
            return Err(LumigraphError::Grid("focal length"));
        }
        let sides = 2..=Camera::MAX_SIDE_PX;
        if !sides.contains(&width) || !sides.contains(&height) {
            return Err(LumigraphError::Size(width, height));
        }
        let cameras = columns.len().saturating_mul(rows.len());
        if (cameras as u64).saturating_mul(u64::from(width) * u64::from(height)) > super::MAX_PIXELS
        {
            return Err(LumigraphError::TooLarge {
                cameras,
                width,
                height,
            });
        }
        let first = Camera::from_parts(origin, world_from_eye, focal_px, width, height);
        let first = first.map_err(|_| LumigraphError::Size(width, height))?;
        Ok(Self { parts, first })
    }

    /// Returns `count` evenly spaced positions from -extent/2 to extent/2; 0 alone for one.
    pub fn even_positions(count: usize, extent: f64) -> Vec<f64> {
        if count == 1 {
            return vec![0.0];
        }
        let position = |i: usize| (i as f64 / (count.max(2) - 1) as f64 - 0.5) * extent;
        (0..count).map(position).collect()
    }

    /// Returns the axes of cameras that look along `normal`, with `up` (any length, not along the
    /// normal) pointing up.
    pub fn facing(normal: DVec3, up: DVec3) -> Option<DMat3> {
        let camera = Camera::look_at(DVec3::ZERO, normal, up, 60.0, [2, 2]).ok()?;
        Some(camera.world_from_eye())
    }

    /// Origin of plane space, world metres.
    pub fn origin(&self) -> DVec3 {
        self.parts.origin
    }

    /// Axes of all cameras: right, up, back.
    pub fn world_from_eye(&self) -> DMat3 {
        self.parts.world_from_eye
    }

    /// Camera positions to the right of the origin, metres.
    pub fn columns(&self) -> &[f64] {
        &self.parts.columns
    }

    /// Camera positions above the origin, metres.
    pub fn rows(&self) -> &[f64] {
        &self.parts.rows
    }

    /// Focal length of the images, pixels.
    pub fn focal_px(&self) -> f64 {
        self.parts.focal_px
    }

    /// Width and height of the images, pixels.
    pub fn size_px(&self) -> [u32; 2] {
        self.parts.size_px
    }

    /// Disparity at which all images show the same part of the scene, 1/m.
    pub fn convergence(&self) -> f64 {
        self.parts.convergence
    }

    /// Returns the vertical field of view, degrees, of the initial view: a frame of `size_px` that
    /// looks straight ahead from the grid's origin, and that the cameras about the origin cover at
    /// every disparity of `range` (1/m). At least a quarter of the images' own field of view.
    pub fn clear_fov_deg(&self, range: [f64; 2], size_px: [u32; 2]) -> f64 {
        let apart = range.map(|d| (d - self.parts.convergence).abs());
        // A point of slope s and disparity d lies s - c (d - convergence) from the middle of the
        // image of a camera at c.
        let half = [(self.columns(), 0), (self.rows(), 1)].map(|(positions, axis)| {
            let whole = f64::from(self.parts.size_px[axis]) / 2.0 / self.parts.focal_px;
            (whole - gap_about_zero(positions) * apart[0].max(apart[1])).max(whole / 4.0)
        });
        let aspect = f64::from(size_px[1]) / f64::from(size_px[0].max(1));
        fov_deg(2.0 * half[1].min(half[0] * aspect), 1.0)
    }

    /// Number of cameras.
    pub fn camera_count(&self) -> usize {
        self.parts.columns.len() * self.parts.rows.len()
    }

    /// Number of pixels of an image.
    pub fn picture_pixels(&self) -> usize {
        self.parts.size_px[0] as usize * self.parts.size_px[1] as usize
    }

    /// Returns the widest gap between neighbours in a row or column, metres; 0 for a single camera.
    pub fn spacing(&self) -> f64 {
        let widest_gap = |positions: &[f64]| {
            positions
                .windows(2)
                .map(|pair| pair[1] - pair[0])
                .fold(0.0, f64::max)
        };
        widest_gap(self.columns()).max(widest_gap(self.rows()))
    }

    /// Transforms a point to plane space.
    pub fn plane_from_world(&self, point: DVec3) -> DVec3 {
        self.direction_from_world(point - self.parts.origin)
    }

    /// Transforms a direction to plane space.
    pub fn direction_from_world(&self, direction: DVec3) -> DVec3 {
        let in_eye = self.parts.world_from_eye.transpose() * direction;
        DVec3::new(in_eye.x, in_eye.y, -in_eye.z)
    }

    /// Returns the camera in a column and row.
    pub fn camera(&self, column: usize, row: usize) -> Camera {
        let (right, up) = (self.parts.columns[column], self.parts.rows[row]);
        let axes = self.parts.world_from_eye;
        let eye = self.parts.origin + axes.x_axis * right + axes.y_axis * up;
        let [x, y] = self.parts.size_px.map(|side| f64::from(side) / 2.0);
        let shift = self.parts.focal_px * self.parts.convergence;
        self.first
            .with_eye(eye)
            .with_principal_px([x + shift * right, y - shift * up])
    }

    /// Returns the parameters of the grid.
    pub fn parts(&self) -> GridParts {
        self.parts.clone()
    }

    /// Returns the grid turned about a line through `centre` along `axis`, by an angle in radians;
    /// `None` if the line has no direction.
    pub fn turned(&self, centre: DVec3, axis: DVec3, angle: f64) -> Option<Self> {
        let turn = DMat3::from_axis_angle(axis.try_normalize()?, angle);
        Self::new(GridParts {
            origin: centre + turn * (self.parts.origin - centre),
            world_from_eye: turn * self.parts.world_from_eye,
            ..self.parts.clone()
        })
        .ok()
    }
}

/// Camera of a frame in plane space.
#[derive(Clone, Copy, Debug)]
pub(super) struct PlaneView {
    pub(super) eye: DVec3,
    /// Direction of pixel position (0, 0).
    pub(super) start: DVec3,
    /// Change of the direction per column and per row.
    pub(super) step: [DVec3; 2],
    /// Width and height of the frame, pixels.
    pub(super) size: [f64; 2],
}

/// Smallest forward component of a direction, in units of the frame's image plane; the slopes of
/// smaller ones would have no significant digits.
pub(super) const LEAST_FORWARD: f64 = 1e-6;

impl PlaneView {
    pub(super) fn new(grid: &CameraGrid, camera: &Camera) -> Self {
        let direction = |x: f64, y: f64| grid.direction_from_world(camera.direction(x, y));
        let start = direction(0.0, 0.0);
        Self {
            eye: grid.plane_from_world(camera.eye()),
            start,
            step: [direction(1.0, 0.0) - start, direction(0.0, 1.0) - start],
            size: [f64::from(camera.width()), f64::from(camera.height())],
        }
    }

    /// Distance of the eye behind the plane; negative in front of it.
    pub(super) fn behind(&self) -> f64 {
        -self.eye.z
    }

    /// Returns the slopes of a pixel position; `None` if its ray does not point forward.
    pub(super) fn slopes(&self, [x, y]: [f64; 2]) -> Option<DVec2> {
        let direction = self.start + self.step[0] * x + self.step[1] * y;
        (direction.z > LEAST_FORWARD).then(|| direction.truncate() / direction.z)
    }

    /// Intersects a ray with the camera plane.
    pub(super) fn crossing(&self, slopes: DVec2) -> DVec2 {
        self.eye.truncate() - slopes * self.eye.z
    }

    /// Returns the pixels of the frame per unit of slope: the maximum over the frame, and the value
    /// in the middle (square root of the area ratio). Both are the focal length if the frame is
    /// parallel to the plane. `None` if the middle of the frame does not point forward.
    pub(super) fn px_per_slope(&self) -> Option<[f64; 2]> {
        let scale = |share_x: f64, share_y: f64| {
            let at = [self.size[0] * share_x, self.size[1] * share_y];
            let direction = self.start + self.step[0] * at[0] + self.step[1] * at[1];
            let slopes = self.slopes(at)?;
            let [across, down] = self
                .step
                .map(|step| (step.truncate() - slopes * step.z) / direction.z);
            // Singular values of the matrix with these columns.
            let (area, squares) = (
                across.perp_dot(down).abs(),
                across.length_squared() + down.length_squared(),
            );
            let least = 0.5 * (squares - (squares * squares - 4.0 * area * area).max(0.0).sqrt());
            (area > 0.0 && least > 0.0).then(|| [1.0 / least.sqrt(), 1.0 / area.sqrt()])
        };
        let [_, middle] = scale(0.5, 0.5)?;
        let shares = [0.0, 0.5, 1.0];
        let most = shares
            .into_iter()
            .flat_map(|x| shares.map(|y| [x, y]))
            .filter_map(|[x, y]| scale(x, y))
            .map(|[most, _]| most)
            .fold(middle, f64::max);
        Some([most, middle])
    }
}

/// Returns the distance from 0 to the farther of its two neighbours among ascending positions; 0 if
/// it is one of them.
fn gap_about_zero(positions: &[f64]) -> f64 {
    let next = positions.partition_point(|position| *position < 0.0);
    let after = positions.get(next).copied().unwrap_or(0.0);
    if next == 0 || positions.get(next) == Some(&0.0) {
        after
    } else {
        after.max(-positions[next - 1])
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A turned and moved grid of 3 columns, unevenly spaced, and 2 rows.
    pub(crate) fn any_grid() -> CameraGrid {
        let axes = CameraGrid::facing(DVec3::new(0.3, -0.2, -1.0), DVec3::Y).expect("a direction");
        CameraGrid::new(GridParts {
            origin: DVec3::new(1.0, 2.0, -3.0),
            world_from_eye: axes,
            columns: vec![-0.5, 0.1, 0.4],
            rows: vec![-0.2, 0.3],
            focal_px: 50.0,
            size_px: [64, 48],
            convergence: 0.25,
        })
        .expect("a grid")
    }

    #[test]
    fn slope_and_disparity_find_pixel() {
        let grid = any_grid();
        let eye = grid.origin() + grid.world_from_eye() * DVec3::new(0.2, 0.1, 0.7);
        let at = eye - grid.world_from_eye().z_axis + DVec3::new(0.1, 0.2, 0.0);
        let frame =
            Camera::look_at(eye, at, DVec3::new(0.2, 1.0, 0.0), 40.0, [30, 20]).expect("valid");
        let view = PlaneView::new(&grid, &frame);
        assert!((view.behind() - 0.7).abs() < 1e-12);
        for (pixel, d) in [([3.0, 4.5], 0.2), ([29.0, 1.0], 1.3), ([15.0, 10.0], 0.05)] {
            let slopes = view.slopes(pixel).expect("forward");
            // Meets depth 1/d behind the plane at that distance from the eye.
            let forward = 1.0 / d - view.eye.z;
            let direction = frame.direction(pixel[0], pixel[1]);
            let point = eye + direction * (forward / grid.direction_from_world(direction).z);
            assert!((grid.plane_from_world(point).z - 1.0 / d).abs() < 1e-9);
            for (column, row) in [(0, 0), (2, 1)] {
                let [u, v, depth] = grid.camera(column, row).project(point).expect("in front");
                let (s, t) = (grid.columns()[column], grid.rows()[row]);
                let shift = grid.focal_px() * (d - grid.convergence());
                let found = [
                    32.0 + grid.focal_px() * (view.eye.x * d + (1.0 - view.eye.z * d) * slopes.x)
                        - s * shift,
                    24.0 - grid.focal_px() * (view.eye.y * d + (1.0 - view.eye.z * d) * slopes.y)
                        + t * shift,
                ];
                assert!(
                    (found[0] - u).abs() < 1e-9
                        && (found[1] - v).abs() < 1e-9
                        && (depth * d - 1.0).abs() < 1e-9
                );
            }
            let crossing = view.crossing(slopes);
            let back = direction * (view.behind() / grid.direction_from_world(direction).z);
            assert!((grid.plane_from_world(eye + back) - crossing.extend(0.0)).length() < 1e-9);
        }
    }

    #[test]
    fn turned_frame_has_larger_scale() {
        let grid = any_grid();
        let ahead = -grid.world_from_eye().z_axis;
        let frame = |look: DVec3| {
            Camera::look_at(DVec3::ZERO, look, DVec3::Y, 60.0, [40, 30]).expect("valid")
        };
        let scale = |look: DVec3| PlaneView::new(&grid, &frame(look)).px_per_slope();
        let focal = frame(ahead).focal_px();
        let [most, middle] = scale(ahead).expect("forward");
        // The root of a difference of squares keeps half the digits.
        assert!((most / focal - 1.0).abs() < 1e-6 && (middle / focal - 1.0).abs() < 1e-6);
        let [most, middle] = scale(ahead + DVec3::new(0.5, 0.0, 0.0)).expect("forward");
        assert!(most > focal && most > middle);
        assert_eq!(scale(-ahead), None);
    }

    #[test]
    fn bad_grids_are_refused() {
        let good = || any_grid().parts();
        assert!(CameraGrid::new(good()).is_ok());
        let refused = |change: fn(&mut GridParts)| {
            let mut parts = good();
            change(&mut parts);
            CameraGrid::new(parts).expect_err("refused")
        };
        let check = |change: fn(&mut GridParts), expected: LumigraphError| {
            assert_eq!(refused(change), expected);
        };
        check(|grid| grid.columns.clear(), LumigraphError::NoCameras);
        check(
            |grid| grid.rows = vec![1.0; 2],
            LumigraphError::Grid("rows"),
        );
        check(
            |grid| grid.columns = vec![f64::NAN],
            LumigraphError::Grid("columns"),
        );
        check(
            |grid| grid.origin.x = f64::INFINITY,
            LumigraphError::Grid("place"),
        );
        check(
            |grid| grid.focal_px = 0.0,
            LumigraphError::Grid("focal length"),
        );
        check(|grid| grid.size_px = [1, 9], LumigraphError::Size(1, 9));
        let large = refused(|grid| {
            (grid.columns, grid.size_px) = ((0..300).map(f64::from).collect(), [4096, 4096]);
        });
        assert!(matches!(large, LumigraphError::TooLarge { .. }));
        assert!(CameraGrid::facing(DVec3::ZERO, DVec3::Y).is_none());
        assert_eq!(CameraGrid::even_positions(1, 3.0), [0.0]);
        assert_eq!(CameraGrid::even_positions(3, 3.0), [-1.5, 0.0, 1.5]);
    }
}
