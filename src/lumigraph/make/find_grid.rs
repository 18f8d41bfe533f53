//! Fit of a camera grid to camera poses (the paper's limitation 1): plane, rows and columns.

use super::from_images_error::FromImagesError;
use glam::{DMat3, DVec2, DVec3};
use headbox_core::file_frame::FileFrame;
use headbox_images::Pose;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

/// Camera of an image set.
#[derive(Clone, Debug)]
pub(super) struct CameraPose<'a> {
    /// Name of the view in its set.
    pub(super) name: &'a str,
    pub(super) pose: Pose,
}

/// Grid that was fitted to camera poses.
#[derive(Clone, Debug)]
pub(super) struct GridFit {
    /// Middle of the grid, world metres.
    pub(super) origin: DVec3,
    /// Right, up and back (the negative normal of the plane).
    pub(super) world_from_eye: DMat3,
    /// Camera positions to the right of the origin, metres, ascending.
    pub(super) columns: Vec<f64>,
    /// Camera positions above the origin, metres, ascending.
    pub(super) rows: Vec<f64>,
    /// Index of the camera at each grid position, row by row from the lowest.
    pub(super) cameras: Vec<usize>,
    /// Distance of each camera from its grid position, metres, in the order of the set.
    pub(super) off_m: Vec<f64>,
}

/// Largest distance of a camera from its grid position, as a share of the distance between the two
/// closest cameras; beyond it positions would be ambiguous.
const TOLERANCE_SHARE: f64 = 0.25;

/// Distance, as a share of the set's extent, below which two cameras are at the same position.
const SAME_POSITION: f64 = 1e-6;

/// Maximum number of cameras whose nearest neighbours are searched: enough to find the axes of a
/// larger set.
const MAX_QUERIES: usize = 1024;

/// Fits a grid to cameras.
///
/// # Errors
/// [`FromImagesError`] that names a camera outside any grid, or the grid positions without a
/// camera.
pub(super) fn find_grid(
    poses: &[CameraPose],
    frame: &FileFrame,
) -> Result<GridFit, FromImagesError> {
    let count = poses.len() as f64;
    let middle = poses.iter().map(|camera| camera.pose.eye).sum::<DVec3>() / count;
    let neighbours = neighbours(poses, middle)?;
    let apart = neighbours
        .iter()
        .map(|n| n.length())
        .fold(f64::INFINITY, f64::min);
    let finder = Finder {
        poses,
        frame,
        middle,
        tolerance: if poses.len() > 1 {
            TOLERANCE_SHARE * apart
        } else {
            0.0
        },
    };
    let image_axes = finder.image_axes()?;
    let [by_neighbours, by_second, by_fourth] = rotations(&finder, &image_axes, &neighbours)
        .map(|angle| finder.grid(image_axes * DMat3::from_rotation_z(angle)));
    let worst = |grid: &GridFit| grid.off_m.iter().copied().fold(0.0, f64::max);
    let by_moments = [by_second, by_fourth]
        .into_iter()
        .filter_map(Result::ok)
        .min_by(|a, b| worst(a).total_cmp(&worst(b)));
    match (by_neighbours, by_moments) {
        (Ok(first), Some(other)) if worst(&other) < worst(&first) => Ok(other),
        (Ok(first), _) => Ok(first),
        (Err(error), other) => other.ok_or(error),
    }
}

/// Returns candidate rotations from the image axes to the grid's axes about the plane's normal,
/// radians, most trustworthy first.
///
/// The nearest camera is in the same row or column, even if positions are empty. If no position is
/// empty, the second and fourth moments of all positions give the axes more precisely: over a full
/// grid odd powers of either coordinate cancel out, and (x + iy)^2 and (x + iy)^4 are real.
fn rotations(finder: &Finder, image_axes: &DMat3, neighbours: &[DVec3]) -> [f64; 3] {
    let in_plane =
        |offset: DVec3| DVec2::new(offset.dot(image_axes.x_axis), offset.dot(image_axes.y_axis));
    // Squares a complex number, which doubles its angle.
    let square = |z: DVec2| z.rotate(z);
    let fourth_powers = neighbours
        .iter()
        .map(|step| square(square(in_plane(*step).normalize_or_zero())));
    let nearest = fourth_powers.sum::<DVec2>().to_angle() / 4.0;
    let squares: Vec<DVec2> = finder
        .eyes()
        .map(|eye| square(in_plane(eye - finder.middle)))
        .collect();
    let second = squares.iter().sum::<DVec2>().to_angle() / 2.0;
    let fourth = squares.iter().map(|z| square(*z)).sum::<DVec2>().to_angle() / 4.0;
    // Either axis may be the longer one, and a sum may be real and negative.
    let next_to = |angle: f64, step: f64| angle + ((nearest - angle) / step).round() * step;
    [
        nearest,
        next_to(second, FRAC_PI_2),
        next_to(fourth, FRAC_PI_4),
    ]
}

/// Returns the offset from each camera, or from evenly chosen ones, to its nearest neighbour.
fn neighbours(poses: &[CameraPose], middle: DVec3) -> Result<Vec<DVec3>, FromImagesError> {
    let extent = poses
        .iter()
        .map(|camera| camera.pose.eye.distance(middle))
        .fold(0.0, f64::max);
    let mut found = Vec::new();
    for (i, camera) in poses
        .iter()
        .enumerate()
        .step_by(poses.len().div_ceil(MAX_QUERIES).max(1))
    {
        let others = poses.iter().enumerate().filter(|(j, _)| *j != i);
        let step = others.map(|(j, other)| (j, other.pose.eye - camera.pose.eye));
        let Some((j, nearest)) =
            step.min_by(|a, b| a.1.length_squared().total_cmp(&b.1.length_squared()))
        else {
            break;
        };
        if nearest.length() <= SAME_POSITION * extent {
            return Err(FromImagesError::SamePlace([
                camera.name.into(),
                poses[j].name.into(),
            ]));
        }
        found.push(nearest);
    }
    Ok(found)
}

struct Finder<'a> {
    poses: &'a [CameraPose<'a>],
    frame: &'a FileFrame,
    middle: DVec3,
    /// Largest distance of a camera from its grid position, metres.
    tolerance: f64,
}

impl Finder<'_> {
    fn eyes(&self) -> impl Iterator<Item = DVec3> {
        self.poses.iter().map(|camera| camera.pose.eye)
    }

    /// Returns axes right, up and back, with back normal to the plane and right as close as
    /// possible to the right of the images.
    fn image_axes(&self) -> Result<DMat3, FromImagesError> {
        let sum = |axis: fn(&DMat3) -> DVec3| {
            self.poses
                .iter()
                .map(|s| axis(&s.pose.world_from_eye))
                .sum::<DVec3>()
        };
        let right = sum(|axes| axes.x_axis);
        let ahead = -sum(|axes| axes.z_axis).normalize_or_zero();
        if ahead == DVec3::ZERO {
            return Err(FromImagesError::AllWays);
        }
        let normal = self.normal(ahead);
        let right = (right - normal * right.dot(normal))
            .try_normalize()
            .unwrap_or(normal.any_orthonormal_vector());
        Ok(DMat3::from_cols(right, right.cross(normal), -normal))
    }

    /// Returns the normal of the cameras' plane, in their viewing direction. For a single camera,
    /// or cameras on a line, the plane that most directly faces the viewing direction.
    fn normal(&self, ahead: DVec3) -> DVec3 {
        let offsets = || self.eyes().map(|eye| eye - self.middle);
        let farthest = offsets().max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
        let along = farthest.unwrap_or(DVec3::ZERO).normalize_or_zero();
        let beside = |offset: DVec3| (offset - along * offset.dot(along)).length();
        if offsets().all(|offset| beside(offset) <= self.tolerance) {
            let across = ahead - along * ahead.dot(along);
            // Cameras on a line along their viewing direction look along every such plane.
            return if across.length() < 1e-6 {
                along.any_orthonormal_vector()
            } else {
                across.normalize()
            };
        }
        // Direction of least spread: dominant eigenvector of the scatter matrix's adjugate, by
        // power iteration.
        let outer = |offset: DVec3| {
            DMat3::from_cols(offset * offset.x, offset * offset.y, offset * offset.z)
        };
        let scatter = offsets().map(outer).fold(DMat3::ZERO, |sum, one| sum + one);
        let (x, y, z) = (scatter.x_axis, scatter.y_axis, scatter.z_axis);
        let adjugate = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y));
        let step = |normal: DVec3| (adjugate * normal).try_normalize().unwrap_or(normal);
        let least = (0..32).fold(ahead, |normal, _| step(normal));
        if least.dot(ahead) < 0.0 {
            -least
        } else {
            least
        }
    }

    /// Finds the rows and columns along given axes.
    fn grid(&self, world_from_eye: DMat3) -> Result<GridFit, FromImagesError> {
        let in_eye = world_from_eye.transpose();
        let places: Vec<DVec3> = self
            .eyes()
            .map(|eye| in_eye * (eye - self.middle))
            .collect();
        let far = places
            .iter()
            .enumerate()
            .max_by(|a, b| a.1.z.abs().total_cmp(&b.1.z.abs()));
        if let Some((i, place)) = far.filter(|(_, place)| place.z.abs() > self.tolerance) {
            return Err(self.off_grid_error(i, place.z.abs(), "the plane of the others"));
        }
        let columns = clusters(places.iter().map(|place| place.x), self.tolerance);
        let rows = clusters(places.iter().map(|place| place.y), self.tolerance);
        let mut cameras = vec![None; columns.len() * rows.len()];
        let mut off_m = Vec::with_capacity(places.len());
        for (i, place) in places.iter().enumerate() {
            let (column, row) = (nearest(&columns, place.x), nearest(&rows, place.y));
            let off = DVec3::new(place.x - columns[column], place.y - rows[row], place.z).length();
            if off > self.tolerance {
                return Err(self.off_grid_error(i, off, "its place in a row and a column"));
            }
            off_m.push(off);
            if let Some(other) = cameras[row * columns.len() + column].replace(i) {
                let name = |i: usize| self.poses[i].name.to_owned();
                return Err(FromImagesError::SamePlace([name(other), name(i)]));
            }
        }
        let middle = |positions: &[f64]| 0.5 * (positions[0] + positions[positions.len() - 1]);
        let (x, y) = (middle(&columns), middle(&rows));
        let world = |x: f64, y: f64| self.middle + world_from_eye * DVec3::new(x, y, 0.0);
        if cameras.contains(&None) {
            let empty = (0..cameras.len()).filter(|i| cameras[*i].is_none());
            let eye = |i: usize| world(columns[i % columns.len()], rows[i / columns.len()]);
            return Err(FromImagesError::Missing {
                cameras: self.poses.len(),
                columns: columns.len(),
                rows: rows.len(),
                places: empty.map(|i| self.frame.file_from_world(eye(i))).collect(),
            });
        }
        let centred = |positions: Vec<f64>, middle: f64| {
            positions.into_iter().map(|at| at - middle).collect()
        };
        Ok(GridFit {
            origin: world(x, y),
            world_from_eye,
            columns: centred(columns, x),
            rows: centred(rows, y),
            cameras: cameras.into_iter().flatten().collect(),
            off_m,
        })
    }

    /// Creates the error of a camera that is `off_m` away from `what`.
    fn off_grid_error(&self, camera: usize, off_m: f64, what: &'static str) -> FromImagesError {
        FromImagesError::Off {
            name: self.poses[camera].name.into(),
            what,
            off: off_m / self.frame.unit_m,
            allowed: self.tolerance / self.frame.unit_m,
            why: "a quarter of the way between the two that are closest to each other",
        }
    }
}

/// Returns the middles of groups of positions, ascending. Groups are farther apart than two cameras
/// of one grid position can be.
fn clusters(positions: impl Iterator<Item = f64>, tolerance: f64) -> Vec<f64> {
    let mut sorted: Vec<f64> = positions.collect();
    sorted.sort_by(f64::total_cmp);
    let groups = sorted.chunk_by(|a, b| b - a <= 2.0 * tolerance);
    groups
        .map(|group| 0.5 * (group[0] + group[group.len() - 1]))
        .collect()
}

/// Returns the index of the nearest of ascending positions (at least one).
fn nearest(places: &[f64], position: f64) -> usize {
    let above = places
        .partition_point(|place| *place < position)
        .clamp(1, places.len().max(2) - 1);
    let is_below =
        above >= places.len() || position - places[above - 1] <= places[above] - position;
    if is_below { above - 1 } else { above }
}
