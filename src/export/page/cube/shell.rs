//! Preview of a page: a small image with depth in all directions from the centre of the headbox.
//! From other positions it has parallax and no holes, but nothing behind the nearest surface.

use super::super::Part;
use crate::ExportError;
use headbox_core::camera::Camera;
use headbox_core::cube_face::Face;
use headbox_core::image::codec::PictureError;
use headbox_cube::pack::CubeLdi;
use headbox_cube::render::{RenderSettings, Renderer};
use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;
use serde_json::json;

/// Maximum size of a face's image, pixels; smaller faces keep their size.
const MAX_PX: u32 = 384;
/// Size of a square of constant depth, preview pixels.
const SQUARE_PX: u32 = 4;
/// JPEG quality.
const QUALITY: u8 = 45;

/// Encodes the preview: inverse eye depths of a byte each, row by row and face by face, as
/// differences; then a JPEG file of the faces, stacked vertically.
pub(super) fn part(cube: &CubeLdi) -> Result<Part, ExportError> {
    let color_px = (cube.face_size_px / SQUARE_PX * SQUARE_PX).clamp(16, MAX_PX);
    let mut picture = RgbImage::new(color_px, 6 * color_px);
    let mut inverse_depths = Vec::new();
    let mut renderer = Renderer::new();
    let settings = RenderSettings {
        depth: true,
        ..RenderSettings::default()
    };
    for (i, face) in Face::ALL.into_iter().enumerate() {
        let camera = Camera::from_parts(
            cube.center(),
            face.world_from_eye(),
            f64::from(color_px) / 2.0,
            color_px,
            color_px,
        )?;
        let frame = renderer.render(cube, &camera, &settings);
        let colors = frame
            .color
            .iter()
            .map(|[r, g, b, _]| image::Rgb([*r, *g, *b]));
        let rows = picture
            .pixels_mut()
            .skip(i * (color_px * color_px) as usize);
        rows.zip(colors).for_each(|(to, from)| *to = from);
        inverse_depths.extend(median_inverse_depths(&frame.depth_m, color_px));
    }
    let nearest = inverse_depths.iter().copied().fold(0.0, f32::max);
    let quantise = |q: &f32| {
        if nearest > 0.0 {
            (q / nearest * 255.0).round() as u8
        } else {
            0
        }
    };
    let mut before = 0u8;
    let mut bytes: Vec<u8> = Vec::new();
    for code in inverse_depths.iter().map(quantise) {
        bytes.push(code.wrapping_sub(before));
        before = code;
    }
    JpegEncoder::new_with_quality(&mut bytes, QUALITY)
        .encode_image(&picture)
        .map_err(PictureError::from)?;
    Ok(Part {
        header: json!({"kind": "shell", "first": true, "depthPx": color_px / SQUARE_PX, "nearest": nearest}),
        bytes,
    })
}

/// Reduces the eye depths of a face of `side` pixels to one inverse eye depth per square: the upper
/// median.
fn median_inverse_depths(depths_m: &[f32], side: u32) -> Vec<f32> {
    let corners = || (0..side).step_by(SQUARE_PX as usize);
    let squares = corners().flat_map(|y| corners().map(move |x| (x, y)));
    let median = |(x, y): (u32, u32)| {
        let pixels = (0..SQUARE_PX * SQUARE_PX)
            .map(|k| ((y + k / SQUARE_PX) * side + x + k % SQUARE_PX) as usize);
        let mut found: Vec<f32> = pixels.map(|i| 1.0 / depths_m[i]).collect();
        found.sort_by(f32::total_cmp);
        found[found.len() / 2]
    };
    squares.map(median).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn preview_square_takes_majority_depth() {
        let mut depths_m = vec![f32::INFINITY; 16 * 16];
        // The second square, but for its first row, is at 2 m; one pixel of the third is at 1 m.
        for y in 1..4 {
            depths_m[y * 16..][4..8].fill(2.0);
        }
        depths_m[9] = 1.0;
        let found = median_inverse_depths(&depths_m, 16);
        assert_eq!(found.len(), 16);
        assert_eq!(found[..3], [0.0, 0.5, 0.0]);
    }
}
