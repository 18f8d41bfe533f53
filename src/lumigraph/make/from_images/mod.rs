//! Images of a grid of cameras from a set of pictures with known cameras and depth, whose cameras
//! stand in a plane (L5; the paper's limitation 1: columns and rows need not be evenly spaced).
//!
//! Cameras need not look the same way, nor have one lens: each picture is brought onto the image
//! plane that all share (`reproject`).

use super::find_grid::{CameraPose, FoundGrid, find_grid};
use super::from_images_error::{FromImagesError, MOST_TURNED_DEG};
use super::raw::{RawLumigraph, RawPicture};
use super::reproject::reproject;
use crate::{CameraGrid, GridParts, LumigraphError};
use glam::{DVec2, DVec3};
use headbox_core::environment::Environment;
use headbox_core::progress::{Progress, check_cancelled};
use headbox_core::statistics::median;
use headbox_images::{ImageSet, Lens, Pinhole, View};
use rayon::prelude::*;

/// The sides of the images that all share are at most so many times those of the largest picture;
/// what turned pictures show beyond is left out.
const MOST_GROWTH: f64 = 2.0;

/// A camera off its place shows things displaced; by at most so many pixels of the images, as
/// neighbouring cameras may disagree (Eq. 5).
const MOST_DISPLACED_PX: f64 = 1.0;

/// Rounding may put a camera off by this share of the grid's own lengths.
const ROUNDING: f64 = 1e-6;

/// Pictures of a set as images of a grid.
#[derive(Clone, Debug)]
pub struct FromImages {
    /// The images.
    pub raw: RawLumigraph,
    /// Data that was lost: a sentence each.
    pub notes: Vec<String>,
}

impl RawLumigraph {
    /// The pictures of a set as images of the grid that its cameras stand in. What its depth does
    /// not tell is not known of the images either; what it tells to be infinitely far is at
    /// infinity.
    ///
    /// # Errors
    /// [`FromImagesError`] of the first camera or picture that does not fit.
    pub fn from_images(
        set: &ImageSet,
        progress: &dyn Progress,
    ) -> Result<FromImages, FromImagesError> {
        let views: Vec<&View> = set.views.iter().collect();
        if views.is_empty() {
            return Err(LumigraphError::NoCameras.into());
        }
        if let Some(view) = views.iter().find(|view| view.depth.is_none()) {
            return Err(FromImagesError::NoDepth(view.name.clone()));
        }
        let stands: Vec<CameraPose> = views
            .iter()
            .map(|view| CameraPose {
                name: &view.name,
                pose: view.color_pose(),
            })
            .collect();
        let found = find_grid(&stands, &set.frame)?;
        let slopes = views
            .iter()
            .map(|view| Slopes::of(view, &found))
            .collect::<Result<Vec<_>, _>>()?;
        let (grid, notes) = common_images(&views, &slopes, &found)?;
        progress.begin("images", "images", views.len() as u64);
        let picture = |place: usize| -> Result<RawPicture, FromImagesError> {
            check_cancelled(progress)?;
            let loaded = views[found.cameras[place]].load()?;
            progress.advance(1);
            Ok(reproject(&loaded, &grid, place))
        };
        let pictures: Vec<RawPicture> = (0..found.cameras.len())
            .into_par_iter()
            .map(picture)
            .collect::<Result<_, _>>()?;
        let raw = Self::new(grid, pictures, Environment::default());
        let rounding = ROUNDING
            * found
                .columns
                .iter()
                .chain(&found.rows)
                .fold(0.0, |most: f64, at| most.max(at.abs()));
        let allowed_m = most_off_m(&raw).max(rounding);
        let worst = (0..views.len()).max_by(|&a, &b| found.off_m[a].total_cmp(&found.off_m[b]));
        match worst.filter(|&camera| found.off_m[camera] > allowed_m) {
            None => Ok(FromImages { raw, notes }),
            Some(camera) => Err(FromImagesError::Off {
                name: views[camera].name.clone(),
                what: "its place in the plane, a row and a column",
                off: found.off_m[camera] / set.frame.unit_m,
                allowed: allowed_m / set.frame.unit_m,
                why: "at which what it sees would be displaced by a pixel",
            }),
        }
    }
}

/// Largest distance of a camera from its grid position, metres. Its image is reprojected there for
/// the depth of the grid's convergence; by the bound of a layer (Eq. 4), nearer and farther
/// surfaces are then displaced.
fn most_off_m(raw: &RawLumigraph) -> f64 {
    let convergence = raw.grid().convergence();
    let apart = raw
        .range()
        .unwrap_or_default()
        .map(|disparity| (disparity - convergence).abs());
    MOST_DISPLACED_PX / (raw.grid().focal_px() * apart[0].max(apart[1]))
}

/// Slopes (x and y per unit forward) in plane space of an image's centre and corners. Corners that
/// look backward are omitted.
struct Slopes {
    middle: DVec2,
    corners: Vec<DVec2>,
    focal_px: f64,
}

impl Slopes {
    fn of(view: &View, found: &FoundGrid) -> Result<Self, FromImagesError> {
        let Some(pinhole) = view.pinhole() else {
            return Err(FromImagesError::Panorama(view.name.clone()));
        };
        let Pinhole {
            focal_px: [across, down],
            ..
        } = pinhole;
        let plane_from_eye = found.world_from_eye.transpose() * view.color_pose().world_from_eye;
        let forward = (plane_from_eye * DVec3::NEG_Z).normalize();
        let degrees = (-forward.z).clamp(-1.0, 1.0).acos().to_degrees();
        if degrees > MOST_TURNED_DEG {
            return Err(FromImagesError::Turned {
                name: view.name.clone(),
                degrees,
            });
        }
        let [width, height] = view.size_px.map(f64::from);
        let slope = |x: f64, y: f64| {
            let ray = plane_from_eye * Lens::Pinhole(pinhole).ray([x, y], view.size_px);
            (ray.z < 0.0).then(|| ray.truncate() / -ray.z)
        };
        let corners = [[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]];
        Ok(Self {
            middle: slope(0.5 * width, 0.5 * height).unwrap_or(DVec2::ZERO),
            corners: corners
                .into_iter()
                .filter_map(|[x, y]| slope(x, y))
                .collect(),
            focal_px: (across * down).sqrt(),
        })
    }
}

/// The images that hold all that the pictures show: at the disparity at which the pictures' middles
/// meet, with the median of their focal lengths.
fn common_images(
    views: &[&View],
    slopes: &[Slopes],
    found: &FoundGrid,
) -> Result<(CameraGrid, Vec<String>), FromImagesError> {
    let place = |place: usize| {
        DVec2::new(
            found.columns[place % found.columns.len()],
            found.rows[place / found.columns.len()],
        )
    };
    let pairs = || {
        found
            .cameras
            .iter()
            .enumerate()
            .map(|(at, &camera)| (place(at), &slopes[camera]))
    };
    let count = views.len() as f64;
    let (mean_place, mean_slope) = pairs().fold((DVec2::ZERO, DVec2::ZERO), |sum, (at, s)| {
        (sum.0 + at / count, sum.1 + s.middle / count)
    });
    // The line of middles over places, by least squares.
    let products = pairs()
        .map(|(at, s)| (at - mean_place).dot(s.middle - mean_slope))
        .sum::<f64>();
    let squares = pairs()
        .map(|(at, _)| (at - mean_place).length_squared())
        .sum::<f64>();
    let convergence = if squares > 0.0 {
        0.0 - products / squares
    } else {
        0.0
    };
    let focal_px = median(slopes.iter().map(|s| s.focal_px)).unwrap_or(1.0);
    let mut half = DVec2::ZERO;
    for (at, s) in pairs() {
        s.corners
            .iter()
            .for_each(|corner| half = half.max((*corner + at * convergence).abs() * focal_px));
    }
    let largest = |axis: usize| {
        views
            .iter()
            .map(|view| view.size_px[axis])
            .max()
            .unwrap_or(1)
    };
    let most = [largest(0), largest(1)].map(|side| MOST_GROWTH * f64::from(side));
    // What is beyond the last pixel by rounding needs no pixel.
    let wanted = [half.x, half.y].map(|half| (2.0 * half - 1e-3).ceil());
    let mut notes = Vec::new();
    let sees_back = slopes.iter().any(|s| s.corners.len() < 4);
    if sees_back || wanted[0] > most[0] || wanted[1] > most[1] {
        notes.push(format!(
            "the pictures look so differently that images of {}x{} pixels do not hold all of them; what they show beyond is left out",
            wanted[0].min(most[0]),
            wanted[1].min(most[1])
        ));
    }
    let side = |axis: usize| {
        if sees_back {
            most[axis]
        } else {
            wanted[axis].min(most[axis])
        }
    };
    let size_px = [side(0), side(1)].map(|side| side as u32);
    let (origin, world_from_eye) = (found.origin, found.world_from_eye);
    let (columns, rows) = (found.columns.clone(), found.rows.clone());
    let parts = GridParts {
        origin,
        world_from_eye,
        columns,
        rows,
        focal_px,
        size_px,
        convergence,
    };
    Ok((CameraGrid::new(parts)?, notes))
}

#[cfg(test)]
mod tests;
