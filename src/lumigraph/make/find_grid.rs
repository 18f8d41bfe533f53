//! The grid that cameras stand in, found from where they stand (the paper's limitation 1): their
//! plane, its rows and columns.

use super::from_images_error::FromImagesError;
use glam::{DMat3, DVec2, DVec3};
use headbox_core::file_frame::FileFrame;
use headbox_images::Pose;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

/// A camera of a set.
#[derive(Clone, Debug)]
pub(super) struct CameraPose<'a> {
    /// Name of the view in its set.
    pub(super) name: &'a str,
    pub(super) pose: Pose,
}

/// Cameras in rows and columns of a plane.
#[derive(Clone, Debug)]
pub(super) struct FoundGrid {
    /// The middle of the grid.
    pub(super) origin: DVec3,
    /// Right, up and back, which is the plane's normal turned round.
    pub(super) world_from_eye: DMat3,
    /// Places to the right of the origin, metres, ascending.
    pub(super) columns: Vec<f64>,
    /// Places above it, metres, ascending.
    pub(super) rows: Vec<f64>,
    /// The number of the camera at each place, row by row from the lowest.
    pub(super) cameras: Vec<usize>,
    /// Distance of each camera from its grid position, metres, in the order of the set.
    pub(super) off_m: Vec<f64>,
}

/// Cameras may be off their places by this share of the distance between the two that are closest
/// to each other, or nobody could tell their places apart.
const OFF_SHARE: f64 = 0.25;

/// Two cameras nearer to each other than this share of the set's extent stand in one place.
const SAME_PLACE: f64 = 1e-6;

/// Cameras whose neighbours are looked for; of a larger set these are enough to know its axes.
const MOST_ASKED: usize = 1024;

/// The grid of some cameras.
///
/// # Errors
/// [`FromImagesError`] that names the camera that is in no grid, or the places without a camera.
pub(super) fn find_grid(
    stands: &[CameraPose],
    frame: &FileFrame,
) -> Result<FoundGrid, FromImagesError> {
    let count = stands.len() as f64;
    let middle = stands.iter().map(|stand| stand.pose.eye).sum::<DVec3>() / count;
    let neighbours = neighbours(stands, middle)?;
    let apart = neighbours
        .iter()
        .map(|n| n.length())
        .fold(f64::INFINITY, f64::min);
    let finder = Finder {
        stands,
        frame,
        middle,
        tolerance: if stands.len() > 1 {
            OFF_SHARE * apart
        } else {
            0.0
        },
    };
    let image_axes = finder.image_axes()?;
    let mut tried = turns(&finder, &image_axes, &neighbours)
        .into_iter()
        .map(|turn| {
            // About the plane's normal.
            finder.grid(image_axes * DMat3::from_rotation_z(turn))
        });
    let by_neighbours = tried.next().unwrap_or_else(|| finder.grid(image_axes));
    let worst = |grid: &FoundGrid| grid.off_m.iter().copied().fold(0.0, f64::max);
    let others = tried
        .filter_map(Result::ok)
        .min_by(|a, b| worst(a).total_cmp(&worst(b)));
    match (by_neighbours, others) {
        (Ok(first), Some(other)) => Ok(if worst(&other) < worst(&first) {
            other
        } else {
            first
        }),
        (first, other) => first.or_else(|error| other.ok_or(error)),
    }
}

/// Candidate rotations of the grid about the plane's normal, starting with the image axes; most
/// trustworthy first.
///
/// The nearest camera is in the same row or column, whatever places are empty. Where none is, the
/// second and fourth moments of all places know the axes more exactly: over a full grid odd powers
/// of either coordinate cancel out, and (x + iy)^2 and (x + iy)^4 are real.
fn turns(finder: &Finder, image_axes: &DMat3, neighbours: &[DVec3]) -> Vec<f64> {
    let in_plane =
        |offset: DVec3| DVec2::new(offset.dot(image_axes.x_axis), offset.dot(image_axes.y_axis));
    // A power of complex numbers; its angle is so many times theirs.
    let square = |z: DVec2| z.rotate(z);
    let of_four = neighbours
        .iter()
        .map(|step| square(square(in_plane(*step).normalize_or_zero())));
    let nearest = of_four.sum::<DVec2>().to_angle() / 4.0;
    let squares: Vec<DVec2> = finder
        .eyes()
        .map(|eye| square(in_plane(eye - finder.middle)))
        .collect();
    let second = squares.iter().sum::<DVec2>().to_angle() / 2.0;
    let fourth = squares.iter().map(|z| square(*z)).sum::<DVec2>().to_angle() / 4.0;
    // Either axis may be the longer one, and a sum may be real and negative.
    let next_to = |angle: f64, step: f64| angle + ((nearest - angle) / step).round() * step;
    vec![
        nearest,
        next_to(second, FRAC_PI_2),
        next_to(fourth, FRAC_PI_4),
    ]
}

/// From each camera, or from some that lie all over the set, to the nearest other.
fn neighbours(stands: &[CameraPose], middle: DVec3) -> Result<Vec<DVec3>, FromImagesError> {
    let extent = stands
        .iter()
        .map(|stand| stand.pose.eye.distance(middle))
        .fold(0.0, f64::max);
    let mut found = Vec::new();
    for (i, stand) in stands
        .iter()
        .enumerate()
        .step_by(stands.len().div_ceil(MOST_ASKED).max(1))
    {
        let others = stands.iter().enumerate().filter(|(j, _)| *j != i);
        let step = others.map(|(j, other)| (j, other.pose.eye - stand.pose.eye));
        let Some((j, nearest)) =
            step.min_by(|a, b| a.1.length_squared().total_cmp(&b.1.length_squared()))
        else {
            break;
        };
        if nearest.length() <= SAME_PLACE * extent {
            return Err(FromImagesError::SamePlace([
                stand.name.into(),
                stands[j].name.into(),
            ]));
        }
        found.push(nearest);
    }
    Ok(found)
}

struct Finder<'a> {
    stands: &'a [CameraPose<'a>],
    frame: &'a FileFrame,
    middle: DVec3,
    /// Largest distance of a camera from its grid position, metres.
    tolerance: f64,
}

impl Finder<'_> {
    fn eyes(&self) -> impl Iterator<Item = DVec3> {
        self.stands.iter().map(|stand| stand.pose.eye)
    }

    /// Right, up and back: across the plane, and in it as near to what is right in the images as
    /// can be.
    fn image_axes(&self) -> Result<DMat3, FromImagesError> {
        let mean = |axis: fn(&DMat3) -> DVec3| {
            self.stands
                .iter()
                .map(|s| axis(&s.pose.world_from_eye))
                .sum::<DVec3>()
        };
        let (right, ahead) = (
            mean(|axes| axes.x_axis),
            -mean(|axes| axes.z_axis).normalize_or_zero(),
        );
        if ahead == DVec3::ZERO {
            return Err(FromImagesError::AllWays);
        }
        let normal = self.normal(ahead);
        let right = (right - normal * right.dot(normal))
            .try_normalize()
            .unwrap_or(normal.any_orthonormal_vector());
        Ok(DMat3::from_cols(right, right.cross(normal), -normal))
    }

    /// Across the plane, to where the cameras look. Of a single camera, or of cameras in a row, the
    /// plane that faces most what they look at.
    fn normal(&self, ahead: DVec3) -> DVec3 {
        let offsets = || self.eyes().map(|eye| eye - self.middle);
        let farthest = offsets().max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
        let along = farthest.unwrap_or(DVec3::ZERO).normalize_or_zero();
        let beside = |offset: DVec3| (offset - along * offset.dot(along)).length();
        if offsets().all(|offset| beside(offset) <= self.tolerance) {
            let across = ahead - along * ahead.dot(along);
            // One behind the other they look along every such plane.
            let is_along = across.length() < 1e-6;
            return if is_along {
                along.any_orthonormal_vector()
            } else {
                across.normalize()
            };
        }
        // The direction in which cameras spread least: of their scatter's adjugate the largest,
        // found by multiplying with it.
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

    /// The rows and columns along some axes.
    fn grid(&self, world_from_eye: DMat3) -> Result<FoundGrid, FromImagesError> {
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
            return Err(self.off(i, place.z.abs(), self.tolerance, "the plane of the others"));
        }
        let columns = clusters(places.iter().map(|place| place.x), self.tolerance);
        let rows = clusters(places.iter().map(|place| place.y), self.tolerance);
        let mut cameras = vec![None; columns.len() * rows.len()];
        let mut off_m = Vec::with_capacity(places.len());
        for (i, place) in places.iter().enumerate() {
            let (column, row) = (nearest(&columns, place.x), nearest(&rows, place.y));
            let off = DVec3::new(place.x - columns[column], place.y - rows[row], place.z).length();
            if off > self.tolerance {
                return Err(self.off(i, off, self.tolerance, "its place in a row and a column"));
            }
            off_m.push(off);
            if let Some(other) = cameras[row * columns.len() + column].replace(i) {
                let name = |i: usize| self.stands[i].name.to_owned();
                return Err(FromImagesError::SamePlace([name(other), name(i)]));
            }
        }
        let middle = |places: &[f64]| 0.5 * (places[0] + places[places.len() - 1]);
        let (x, y) = (middle(&columns), middle(&rows));
        let at = |x: f64, y: f64| self.middle + world_from_eye * DVec3::new(x, y, 0.0);
        if cameras.contains(&None) {
            let empty = (0..cameras.len()).filter(|place| cameras[*place].is_none());
            let eye =
                |place: usize| at(columns[place % columns.len()], rows[place / columns.len()]);
            let places = empty
                .map(|place| self.frame.file_from_world(eye(place)))
                .collect();
            let (columns, rows) = (columns.len(), rows.len());
            return Err(FromImagesError::Missing {
                cameras: self.stands.len(),
                columns,
                rows,
                places,
            });
        }
        let about = |places: Vec<f64>, middle: f64| {
            places.into_iter().map(|place| place - middle).collect()
        };
        let (columns, rows) = (about(columns, x), about(rows, y));
        let cameras = cameras.into_iter().flatten().collect();
        Ok(FoundGrid {
            origin: at(x, y),
            world_from_eye,
            columns,
            rows,
            cameras,
            off_m,
        })
    }

    fn off(
        &self,
        camera: usize,
        off_m: f64,
        allowed_m: f64,
        what: &'static str,
    ) -> FromImagesError {
        FromImagesError::off(self.stands[camera].name, off_m, allowed_m, what, self.frame)
    }
}

/// The middles of groups of positions that are farther from each other than two cameras of one
/// place could be, ascending.
fn clusters(positions: impl Iterator<Item = f64>, tolerance: f64) -> Vec<f64> {
    let mut sorted: Vec<f64> = positions.collect();
    sorted.sort_by(f64::total_cmp);
    let groups = sorted.chunk_by(|a, b| b - a <= 2.0 * tolerance);
    groups
        .map(|group| 0.5 * (group[0] + group[group.len() - 1]))
        .collect()
}

/// The nearest of ascending places, of which there is at least one.
fn nearest(places: &[f64], position: f64) -> usize {
    let above = places
        .partition_point(|place| *place < position)
        .clamp(1, places.len().max(2) - 1);
    let is_below =
        above >= places.len() || position - places[above - 1] <= places[above] - position;
    if is_below { above - 1 } else { above }
}
