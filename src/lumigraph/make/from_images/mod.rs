//! Images of a camera grid from an image set with known cameras and depth, whose cameras lie on a
//! plane (L5; the paper's limitation 1: columns and rows need not be evenly spaced).
//!
//! The cameras may differ in direction and lens: each image is reprojected onto the common image
//! plane (`reproject`).

use super::find_grid::{CameraPose, GridFit, find_grid};
use super::from_images_error::{FromImagesError, MAX_TURN_DEG};
use super::raw::{RawLumigraph, RawPicture};
use super::reproject::reproject;
use crate::{CameraGrid, GridParts, LumigraphError};
use glam::{DVec2, DVec3};
use headbox_core::environment::Environment;
use headbox_core::progress::{Progress, check_cancelled};
use headbox_core::statistics::median;
use headbox_images::{ImageSet, Lens, View};
use rayon::prelude::*;

/// Largest size of the common images, in sizes of the largest image of the set; turned images are
/// cropped to it.
const MAX_GROWTH: f64 = 2.0;

/// Largest displacement of a surface because its camera is off its grid position, pixels: as much
/// as neighbouring cameras may disagree (Eq. 5).
const MAX_DISPLACEMENT_PX: f64 = 1.0;

/// Rounding error of a camera position, as a share of the grid's extent.
const ROUNDING: f64 = 1e-6;

/// Result of [`RawLumigraph::from_images`].
#[derive(Clone, Debug)]
pub struct FromImages {
    /// The images.
    pub raw: RawLumigraph,
    /// Notes about lost data, a sentence each.
    pub notes: Vec<String>,
}

impl RawLumigraph {
    /// Reprojects an image set to the grid of its cameras. Pixels without depth are unknown; pixels
    /// of infinite depth are at infinity.
    ///
    /// # Errors
    /// [`FromImagesError`] of the first camera or image that does not fit.
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
        let poses: Vec<CameraPose> = views
            .iter()
            .map(|view| CameraPose {
                name: &view.name,
                pose: view.color_pose(),
            })
            .collect();
        let fit = find_grid(&poses, &set.frame)?;
        let slopes = views
            .iter()
            .map(|view| Slopes::new(view, &fit))
            .collect::<Result<Vec<_>, _>>()?;
        let (grid, notes) = common_grid(&views, &slopes, &fit)?;
        progress.begin("images", "images", views.len() as u64);
        let picture = |place: usize| -> Result<RawPicture, FromImagesError> {
            check_cancelled(progress)?;
            let loaded = views[fit.cameras[place]].load()?;
            progress.advance(1);
            Ok(reproject(&loaded, &grid, place))
        };
        let pictures: Vec<RawPicture> = (0..fit.cameras.len())
            .into_par_iter()
            .map(picture)
            .collect::<Result<_, _>>()?;
        let raw = Self {
            grid,
            pictures,
            environment: Environment::default(),
        };
        let positions = fit.columns.iter().chain(&fit.rows);
        let extent = positions.fold(0.0, |most: f64, at| most.max(at.abs()));
        let allowed_m = max_offset_m(&raw).max(ROUNDING * extent);
        let worst = (0..views.len()).max_by(|&a, &b| fit.off_m[a].total_cmp(&fit.off_m[b]));
        match worst.filter(|&camera| fit.off_m[camera] > allowed_m) {
            None => Ok(FromImages { raw, notes }),
            Some(camera) => Err(FromImagesError::Off {
                name: views[camera].name.clone(),
                what: "its place in the plane, a row and a column",
                off: fit.off_m[camera] / set.frame.unit_m,
                allowed: allowed_m / set.frame.unit_m,
                why: "at which what it sees would be displaced by a pixel",
            }),
        }
    }
}

/// Returns the largest allowed distance of a camera from its grid position, metres. Its image is
/// reprojected there for the depth of the grid's convergence; by the bound of a layer (Eq. 4),
/// nearer and farther surfaces are then displaced.
fn max_offset_m(raw: &RawLumigraph) -> f64 {
    let convergence = raw.grid().convergence();
    let apart = raw
        .range()
        .unwrap_or_default()
        .map(|disparity| (disparity - convergence).abs());
    MAX_DISPLACEMENT_PX / (raw.grid().focal_px() * apart[0].max(apart[1]))
}

/// Slopes (x and y per unit forward) in plane space of an image's centre and corners. Corners that
/// look backward are omitted.
struct Slopes {
    middle: DVec2,
    corners: Vec<DVec2>,
    focal_px: f64,
}

impl Slopes {
    fn new(view: &View, fit: &GridFit) -> Result<Self, FromImagesError> {
        let Some(pinhole) = view.pinhole() else {
            return Err(FromImagesError::Panorama(view.name.clone()));
        };
        let [across, down] = pinhole.focal_px;
        let plane_from_eye = fit.world_from_eye.transpose() * view.color_pose().world_from_eye;
        let forward = (plane_from_eye * DVec3::NEG_Z).normalize();
        let degrees = (-forward.z).clamp(-1.0, 1.0).acos().to_degrees();
        if degrees > MAX_TURN_DEG {
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

/// Chooses the grid whose images contain all images of the set: its convergence is the disparity at
/// which the image centres meet, its focal length the median.
fn common_grid(
    views: &[&View],
    slopes: &[Slopes],
    fit: &GridFit,
) -> Result<(CameraGrid, Vec<String>), FromImagesError> {
    let place = |place: usize| {
        DVec2::new(
            fit.columns[place % fit.columns.len()],
            fit.rows[place / fit.columns.len()],
        )
    };
    let pairs = || {
        fit.cameras
            .iter()
            .enumerate()
            .map(|(at, &camera)| (place(at), &slopes[camera]))
    };
    let count = views.len() as f64;
    let (mean_position, mean_slope) = pairs().fold((DVec2::ZERO, DVec2::ZERO), |sum, (at, s)| {
        (sum.0 + at / count, sum.1 + s.middle / count)
    });
    // Least-squares line of image centres over camera positions.
    let products: f64 = pairs()
        .map(|(at, s)| (at - mean_position).dot(s.middle - mean_slope))
        .sum();
    let squares: f64 = pairs()
        .map(|(at, _)| (at - mean_position).length_squared())
        .sum();
    let convergence = if squares > 0.0 {
        0.0 - products / squares
    } else {
        0.0
    };
    let focal_px = median(slopes.iter().map(|s| s.focal_px)).unwrap_or(1.0);
    let mut half = DVec2::ZERO;
    for (at, s) in pairs() {
        for corner in &s.corners {
            half = half.max((*corner + at * convergence).abs() * focal_px);
        }
    }
    let most = [0, 1].map(|axis| {
        let largest = views.iter().map(|view| view.size_px[axis]).max();
        MAX_GROWTH * f64::from(largest.unwrap_or(1))
    });
    // Rounding errors beyond the last pixel do not add a pixel.
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
    let parts = GridParts {
        origin: fit.origin,
        world_from_eye: fit.world_from_eye,
        columns: fit.columns.clone(),
        rows: fit.rows.clone(),
        focal_px,
        size_px: [side(0) as u32, side(1) as u32],
        convergence,
    };
    Ok((CameraGrid::new(parts)?, notes))
}

#[cfg(test)]
mod tests;
