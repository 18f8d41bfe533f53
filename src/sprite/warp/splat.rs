//! Forward mapping of colours (Eq. 4; S4): the baseline that the paper argues against. Every
//! visible pixel is moved to the frame and drawn there as one pixel (or 2 x 2 around its position)
//! with a depth test; where pixels move apart gaps remain.

use super::cell::VISIBLE;
use super::field::Field;
use super::second_pass::sampling::SpriteSampling;
use super::transfer::SpriteTransfer;
use crate::model::texture::Texture;
use glam::dvec3;

/// Draws a sprite into `pixels`, row-major with `width` columns; `nearness` is the depth buffer.
pub(super) fn splat(
    texture: &Texture,
    field: &Field,
    cell_px: [f64; 2],
    transfer: &SpriteTransfer,
    sampling: SpriteSampling,
    width: u32,
    pixels: &mut [u32],
    nearness: &mut Vec<f32>,
) {
    pixels.fill(0);
    nearness.clear();
    nearness.resize(pixels.len(), f32::NEG_INFINITY);
    let height = (pixels.len() as u32).checked_div(width).unwrap_or(0);
    let level = texture.levels[0];
    for y in 0..level.height {
        for x in 0..level.width {
            let color = texture.texels[(level.origin + y * level.stride + x) as usize][0];
            if color >> 24 == 0 {
                continue;
            }
            let (px, py) = (f64::from(x) + 0.5, f64::from(y) + 0.5);
            let d = f64::from(displacement(field, px / cell_px[0], py / cell_px[1]));
            let p =
                transfer.target_from_sprite * dvec3(px, py, 1.0) + transfer.epipole_in_target * d;
            if p.z.is_nan() || p.z <= 0.0 {
                continue;
            }
            // d2 = d1 / w2: at one frame position the larger is nearer (C7).
            let nearer = (d * transfer.side / p.z) as f32;
            let (tx, ty) = (p.x / p.z, p.y / p.z);
            let (first, count) = match sampling {
                SpriteSampling::Nearest => ([tx.floor(), ty.floor()], 1),
                SpriteSampling::Bilinear => ([(tx - 0.5).floor(), (ty - 0.5).floor()], 2),
            };
            for (dx, dy) in (0..count).flat_map(|dy| (0..count).map(move |dx| (dx, dy))) {
                let (column, row) = (first[0] + f64::from(dx), first[1] + f64::from(dy));
                if column < 0.0
                    || row < 0.0
                    || column >= f64::from(width)
                    || row >= f64::from(height)
                {
                    continue;
                }
                let index = row as usize * width as usize + column as usize;
                if nearer > nearness[index] {
                    nearness[index] = nearer;
                    pixels[index] = color;
                }
            }
        }
    }
}

/// Returns the displacement at a position in cells.
fn displacement(field: &Field, x: f64, y: f64) -> f32 {
    let column = (x as u32).min(field.width - 1);
    let row = (y as u32).min(field.height - 1);
    let cell = field.cells[row as usize * field.width as usize + column as usize] | VISIBLE;
    field.coding.displacement(
        cell,
        (x - f64::from(column)) as f32 - 0.5,
        (y - f64::from(row)) as f32 - 0.5,
    )
}
