//! Depth images of the surfaces behind a portal, from eye positions in front of it (R9, R11, P2).
//!
//! An image has six cube faces about its eye, with a ray through the centre of each pixel that
//! looks through the opening. One image is an LDI of one layer; several are merged into the cube
//! about the first, whose rays are those of the cube itself.

use super::BackdropQuality;
use super::gather::{CubeJob, RayBatch};
use crate::house::House;
use crate::portal_opening::Opening;
use glam::DVec3;
use headbox_core::cube_face::Face;
use headbox_cube::model::parameters::MergeRule;
use headbox_cube::pack::{CubeLdi, PackError};

/// Captures the images from all eye positions into one LDI about the first.
pub(super) fn ldi(
    house: &House,
    opening: &Opening,
    eyes: &[DVec3],
    rule: MergeRule,
    quality: &BackdropQuality,
) -> Result<CubeLdi, PackError> {
    let face_px = quality.face_px;
    let job = CubeJob {
        house,
        centre: eyes[0],
        face_px,
        rule,
        repairs: false,
    };
    // Number of rows of all faces of an image.
    let rows = 6 * face_px;
    job.run(eyes.len() as u32 * rows, |i, batch| {
        let (image, row) = (i / rows, i % rows);
        let eye = eyes[image as usize];
        batch.image = image.min(255) as u8;
        batch.eye = Some((eye - house.tracer().origin()).as_vec3());
        let face = Face::ALL[(row / face_px) as usize];
        fill_row(house, opening, eye, face, row % face_px, face_px, batch);
    })
}

/// Adds the rays through a row of pixels that pass the opening, starting on its plane.
fn fill_row(
    house: &House,
    opening: &Opening,
    eye: DVec3,
    face: Face,
    row: u32,
    face_px: u32,
    batch: &mut RayBatch,
) {
    let in_front = opening.distance_in_front(eye);
    let y = f64::from(row) + 0.5;
    for column in 0..face_px {
        let direction = face.direction(f64::from(column) + 0.5, y, face_px);
        let toward = -opening.normal.dot(direction);
        if toward <= 1e-9 {
            continue;
        }
        let at = eye + direction * (in_front / toward);
        if opening.contains(at) {
            batch.rays.push((
                (at - house.tracer().origin()).as_vec3(),
                direction.as_vec3(),
            ));
        }
    }
}
