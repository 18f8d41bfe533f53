//! Errors of building a lumigraph from images.

use crate::LumigraphError;
use glam::DVec3;
use headbox_images::ImagesError;
use std::io;

/// Error of building a lumigraph from an image set. Positions and lengths are in the set's own axes
/// and unit.
#[derive(Debug, thiserror::Error)]
pub enum FromImagesError {
    /// An image cannot be read.
    #[error(transparent)]
    Images(#[from] ImagesError),
    /// The images form no camera grid or no layers.
    #[error(transparent)]
    Lumigraph(#[from] LumigraphError),
    /// The build was cancelled.
    #[error("given up: {0}")]
    GivenUp(#[from] io::Error),
    /// An image has no depth.
    #[error(
        "{0} has no depth, and without it no pixel has a layer; find it from the pictures with `headbox images DIR --depth`"
    )]
    NoDepth(String),
    /// An image is a panorama.
    #[error("{0} is a panorama; a lumigraph is made of perspective pictures")]
    Panorama(String),
    /// The cameras' directions cancel out.
    #[error(
        "the cameras look all ways; those of a lumigraph look across the plane that they stand in"
    )]
    AllWays,
    /// A camera looks along the plane, or backward.
    #[error("{name} looks {degrees:.0} degrees away from straight across the plane of the cameras; {most} degrees at most can be brought onto one image plane: leave it out", most = MAX_TURN_DEG)]
    Turned {
        /// Name of the image.
        name: String,
        /// Angle between its viewing axis and the plane's normal, degrees.
        degrees: f64,
    },
    /// A camera is too far from a grid position.
    #[error(
        "{name} stands {off:.5} off {what}, more than {allowed:.5}, {why}: leave it out, or give it the place that it was meant to have"
    )]
    Off {
        /// Name of the image.
        name: String,
        /// Description of the position that it misses.
        what: &'static str,
        /// Distance from the grid position.
        off: f64,
        /// Allowed distance.
        allowed: f64,
        /// Reason for the limit.
        why: &'static str,
    },
    /// Two cameras are at the same position.
    #[error("{} and {} were taken from the same place; leave one of them out", .0[0], .0[1])]
    SamePlace([String; 2]),
    /// Grid positions have no camera.
    #[error("the {cameras} cameras stand in {columns} columns and {rows} rows, but none where these cross at {}; a lumigraph needs all of a grid: take the missing pictures, or leave out the rows or columns that lack them", format_positions(.places))]
    Missing {
        /// Number of cameras.
        cameras: usize,
        /// Number of columns.
        columns: usize,
        /// Number of rows.
        rows: usize,
        /// Grid positions without a camera.
        places: Vec<DVec3>,
    },
}

/// Formats the first of some positions.
fn format_positions(places: &[DVec3]) -> String {
    const SHOWN: usize = 4;
    let first = places
        .iter()
        .take(SHOWN)
        .map(|p| format!("{:.3},{:.3},{:.3}", p.x, p.y, p.z));
    let more = places.len().saturating_sub(SHOWN);
    let more = (more > 0).then(|| format!("{more} more"));
    first.chain(more).collect::<Vec<_>>().join(" and ")
}

/// Largest angle between a viewing axis and the normal of the cameras' plane, degrees: images
/// turned farther would be stretched more than fourfold.
pub(super) const MAX_TURN_DEG: f64 = 60.0;
