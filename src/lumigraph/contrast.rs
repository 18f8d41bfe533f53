//! How plain the images are, layer by layer: what a displaced layer costs (the paper's limitation 7).
//!
//! A layer that is drawn a little beside its place errs by displacement times gradient. Where images are plain, the bound of [`crate::render::merge`]
//! may be relaxed: more layers are shown as one as long as the error in levels stays small. Edges against what is nearer or farther count
//! as well, so that a plain thing with a sharp outline is not plain.

use super::{CameraGrid, Picture};
use rayon::prelude::*;

/// How much farther than the bound's tolerance a plain layer may be displaced: outlines move, even where they are few.
pub(super) const MOST: f64 = 4.0;

/// The root of the mean squared gradient of each layer's pixels, levels of sRGB for each pixel of the images, far layers first.
pub(super) fn contrasts(grid: &CameraGrid, pictures: &[Picture], layers: usize) -> Vec<f64> {
    let [width, height] = grid.size_px().map(|side| side as usize);
    let of_picture = |picture: &Picture| {
        let mut sums = vec![(0u64, 0u64); layers + 2];
        for y in 0..height - 1 {
            for x in 0..width - 1 {
                let at = y * width + x;
                let squares = squared_difference(picture, at, at + 1) + squared_difference(picture, at, at + width);
                let sum = &mut sums[usize::from(picture.index[at])];
                *sum = (sum.0 + squares, sum.1 + 1);
            }
        }
        sums
    };
    let add = |mut a: Vec<(u64, u64)>, b: Vec<(u64, u64)>| {
        a.iter_mut().zip(b).for_each(|(a, b)| *a = (a.0 + b.0, a.1 + b.1));
        a
    };
    let sums = pictures.par_iter().map(of_picture).reduce(|| vec![(0, 0); layers + 2], add);
    // The mean of three channels.
    sums[1..=layers].iter().map(|(squares, count)| (*squares as f64 / (3 * count).max(1) as f64).sqrt()).collect()
}

fn squared_difference(picture: &Picture, a: usize, b: usize) -> u64 {
    let of = |c: usize| u64::from(picture.color[a][c].abs_diff(picture.color[b][c])).pow(2);
    of(0) + of(1) + of(2)
}

/// How much the tolerance of a merged layer grows: the displacement at which it errs by `levels`, over `tolerance_px`, both in pixels of the
/// images; from 1 to [`MOST`].
pub(super) fn relaxed(contrasts: &[f64], levels: f64, tolerance_px: f64) -> f64 {
    let sharpest = contrasts.iter().copied().fold(0.0, f64::max);
    (levels / (sharpest * tolerance_px).max(f64::MIN_POSITIVE)).clamp(1.0, MOST)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::tests::any_grid;

    #[test]
    fn ramps_have_their_slope_and_outlines_count() {
        let grid = any_grid();
        let [width, height] = grid.size_px().map(|side| side as usize);
        // The left half a ramp of 2 levels a pixel, the right half plain and far darker.
        let pixel = |i: usize| match i % width {
            x if x < 32 => ([200 - 2 * x as u8; 3], 2),
            _ => ([10; 3], 1),
        };
        let (color, index) = (0..width * height).map(pixel).unzip();
        let found = contrasts(&grid, &vec![Picture { color, index }; grid.camera_count()], 3);
        let outline = f64::from(200 - 2 * 31 - 10);
        let of_ramp = ((31.0 * 4.0 + outline * outline) / 32.0).sqrt();
        assert!((found[1] - of_ramp).abs() < 1e-9, "{found:?} {of_ramp}");
        assert_eq!((found[0], found[2]), (0.0, 0.0), "plain, and of no pixel");
    }

    #[test]
    fn plain_layers_may_move_farther_and_never_less() {
        assert_eq!(relaxed(&[0.0, 0.0], 2.0, 1.0), MOST);
        assert_eq!(relaxed(&[0.0, 100.0], 2.0, 1.0), 1.0);
        assert_eq!(relaxed(&[0.5, 1.0], 2.0, 1.0), 2.0);
        assert_eq!(relaxed(&[0.5, 1.0], 2.0, 2.0), 1.0);
        assert_eq!(relaxed(&[], 0.0, 1.0), 1.0);
        // More layers never allow more: merging stays greedy.
        assert!(relaxed(&[0.5, 1.5], 2.0, 1.0) <= relaxed(&[0.5], 2.0, 1.0));
    }
}
