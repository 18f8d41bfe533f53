//! What a page shows first: the scene as it is seen from the middle of the headbox, a small picture with depth in all directions. Looked at
//! from elsewhere it has parallax and no gaps; nothing behind what is nearest.

use super::super::Part;
use crate::capture::Camera;
use crate::capture::picture::PictureError;
use crate::capture::rig::Face;
use crate::export::ExportError;
use crate::packed::PackedCube;
use crate::render::{RenderSettings, Renderer};
use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;
use serde_json::json;

/// Pixels a side of a face's picture.
const COLOR_PX: u32 = 384;
/// And of its depths.
const DEPTH_PX: u32 = 96;
/// Quality of the JPEG file.
const QUALITY: u8 = 45;

/// The depths, a byte of 1 / eye depth each, row by row and face by face, each less the one before; then a JPEG file of the faces, one
/// below another.
pub(super) fn part(cube: &PackedCube) -> Result<Part, ExportError> {
    let mut picture = RgbImage::new(COLOR_PX, 6 * COLOR_PX);
    let mut inverse_depths = Vec::new();
    let mut renderer = Renderer::new();
    let settings = RenderSettings { depth: true, ..RenderSettings::default() };
    for (i, face) in Face::ALL.into_iter().enumerate() {
        let camera = Camera::from_parts(cube.center(), face.world_from_eye(), f64::from(COLOR_PX) / 2.0, COLOR_PX, COLOR_PX)?;
        let frame = renderer.render(cube, &camera, &settings);
        let colors = frame.color.iter().map(|[r, g, b, _]| image::Rgb([*r, *g, *b]));
        let rows = picture.pixels_mut().skip(i * (COLOR_PX * COLOR_PX) as usize);
        rows.zip(colors).for_each(|(to, from)| *to = from);
        inverse_depths.extend(shrunk(&frame.depth_m));
    }
    let nearest = inverse_depths.iter().copied().fold(0.0, f32::max);
    let coded = |q: &f32| if nearest > 0.0 { (q / nearest * 255.0).round() as u8 } else { 0 };
    let mut before = 0u8;
    let mut bytes: Vec<u8> = Vec::new();
    for code in inverse_depths.iter().map(coded) {
        bytes.push(code.wrapping_sub(before));
        before = code;
    }
    JpegEncoder::new_with_quality(&mut bytes, QUALITY).encode_image(&picture).map_err(PictureError::from)?;
    Ok(Part { header: json!({"kind": "shell", "first": true, "depthPx": DEPTH_PX, "nearest": nearest}), bytes })
}

/// 1 / eye depth of a face in squares: what most of a square's pixels have at least.
fn shrunk(depths_m: &[f32]) -> Vec<f32> {
    let side = COLOR_PX / DEPTH_PX;
    let squares = (0..DEPTH_PX).flat_map(|y| (0..DEPTH_PX).map(move |x| (x * side, y * side)));
    let median = |(x, y): (u32, u32)| {
        let pixels = (0..side * side).map(|k| ((y + k / side) * COLOR_PX + x + k % side) as usize);
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
    fn a_square_has_the_depth_of_most_of_it() {
        let mut depths_m = vec![f32::INFINITY; (COLOR_PX * COLOR_PX) as usize];
        // The second square, but for its first row, is at 2 m; one pixel of the third is at 1 m.
        for y in 1..4 {
            depths_m[(y * COLOR_PX) as usize..][4..8].fill(2.0);
        }
        depths_m[9] = 1.0;
        let found = shrunk(&depths_m);
        assert_eq!(found.len(), (DEPTH_PX * DEPTH_PX) as usize);
        assert_eq!(found[..3], [0.0, 0.5, 0.0]);
    }
}
