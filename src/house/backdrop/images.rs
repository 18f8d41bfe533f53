//! Depth images of what is behind a portal, from places in front of it (R9, R11, P2).
//!
//! An image is what the six faces of a cube about its place see through the opening: a ray through
//! the centre of each such pixel. One image is an LDI of one layer; more are merged into the cube
//! about the first, whose rays are that cube's own.

use super::BackdropQuality;
use super::gather::{CubeJob, RayBatch};
use crate::house::House;
use crate::opening::Opening;
use glam::DVec3;
use headbox_core::cube_face::Face;
use headbox_cube::model::parameters::MergeRule;
use headbox_cube::pack::{CubeLdi, PackError};

/// One LDI of the images from all places, about the first.
pub(super) fn ldi(
    house: &House,
    opening: &Opening,
    places: &[DVec3],
    rule: MergeRule,
    quality: &BackdropQuality,
) -> Result<CubeLdi, PackError> {
    let face_px = quality.face_px;
    let job = CubeJob {
        house,
        centre: places[0],
        face_px,
        rule,
        mends: false,
    };
    // Rows of all faces of all images.
    let rows = 6 * face_px;
    job.run(places.len() as u32 * rows, |i, batch| {
        let (image, row) = (i / rows, i % rows);
        let place = places[image as usize];
        batch.image = image.min(255) as u8;
        batch.eye = Some((place - house.tracer().origin()).as_vec3());
        fill_row(
            house,
            opening,
            place,
            Face::ALL[(row / face_px) as usize],
            row % face_px,
            face_px,
            batch,
        );
    })
}

/// The rays through a row of pixels that pass the opening, from where they do.
fn fill_row(
    house: &House,
    opening: &Opening,
    place: DVec3,
    face: Face,
    row: u32,
    face_px: u32,
    batch: &mut RayBatch,
) {
    let in_front = opening.distance_in_front(place);
    let y = f64::from(row) + 0.5;
    for column in 0..face_px {
        let direction = face.direction(f64::from(column) + 0.5, y, face_px);
        let toward = -opening.normal.dot(direction);
        if toward <= 1e-9 {
            continue;
        }
        let at = place + direction * (in_front / toward);
        if opening.contains(at) {
            batch.rays.push((
                (at - house.tracer().origin()).as_vec3(),
                direction.as_vec3(),
            ));
        }
    }
}
