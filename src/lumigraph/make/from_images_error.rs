//! Errors of building a lumigraph from images.

use crate::LumigraphError;
use glam::DVec3;
use headbox_core::file_frame::FileFrame;
use headbox_images::ImagesError;
use std::io;

/// Why a set of pictures is no lumigraph. Positions and lengths are in the set's own axes and unit.
#[derive(Debug, thiserror::Error)]
pub enum FromImagesError {
    /// A picture cannot be read.
    #[error(transparent)]
    Images(#[from] ImagesError),
    /// The images form no camera grid or no layers.
    #[error(transparent)]
    Lumigraph(#[from] LumigraphError),
    /// It was given up.
    #[error("given up: {0}")]
    GivenUp(#[from] io::Error),
    /// Nothing is known of a picture's depth.
    #[error(
        "{0} has no depth, and without it no pixel has a layer; find it from the pictures with `headbox images DIR --depth`"
    )]
    NoDepth(String),
    /// A picture shows all directions.
    #[error("{0} is a panorama; a lumigraph is made of perspective pictures")]
    Panorama(String),
    /// The cameras' directions cancel out.
    #[error(
        "the cameras look all ways; those of a lumigraph look across the plane that they stand in"
    )]
    AllWays,
    /// A camera looks along the plane, or back.
    #[error("{name} looks {degrees:.0} degrees away from straight across the plane of the cameras; {most} degrees at most can be brought onto one image plane: leave it out", most = MOST_TURNED_DEG)]
    Turned {
        /// The picture.
        name: String,
        /// Between its viewing axis and the plane's normal.
        degrees: f64,
    },
    /// A camera is not where a grid has one.
    #[error(
        "{name} stands {off:.5} off {what}, more than {allowed:.5}, {why}: leave it out, or give it the place that it was meant to have"
    )]
    Off {
        /// The picture.
        name: String,
        /// Off what.
        what: &'static str,
        /// Distance from the grid position.
        off: f64,
        /// Allowed distance.
        allowed: f64,
        /// Why no farther.
        why: &'static str,
    },
    /// Two cameras are at one place.
    #[error("{} and {} were taken from the same place; leave one of them out", .0[0], .0[1])]
    SamePlace([String; 2]),
    /// The cameras leave places of the grid empty.
    #[error("the {cameras} cameras stand in {columns} columns and {rows} rows, but none where these cross at {}; a lumigraph needs all of a grid: take the missing pictures, or leave out the rows or columns that lack them", listed(.places))]
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

impl FromImagesError {
    pub(super) fn off(
        name: &str,
        off_m: f64,
        allowed_m: f64,
        what: &'static str,
        frame: &FileFrame,
    ) -> Self {
        let why = "a quarter of the way between the two that are closest to each other";
        Self::Off {
            name: name.into(),
            what,
            off: off_m / frame.unit_m,
            allowed: allowed_m / frame.unit_m,
            why,
        }
    }
}

/// The first of some places.
fn listed(places: &[DVec3]) -> String {
    const SHOWN: usize = 4;
    let first = places
        .iter()
        .take(SHOWN)
        .map(|p| format!("{:.3},{:.3},{:.3}", p.x, p.y, p.z));
    let more = places.len().saturating_sub(SHOWN);
    let more = (more > 0).then(|| format!("{more} more"));
    first.chain(more).collect::<Vec<_>>().join(" and ")
}

/// Between a picture's viewing axis and the normal of the cameras' plane, at most, degrees:
/// pictures turned farther would be stretched more than fourfold.
pub(super) const MOST_TURNED_DEG: f64 = 60.0;
