//! Layers over each other pixel by pixel, by depth (the z-buffer of S25, D14): what reaches through
//! each other comes out right.

use super::laid_over;
use headbox_cube::render::canvas::linear::LinearLight;
use rayon::prelude::*;

/// A layer's picture, row-major.
#[derive(Default)]
pub(super) struct LayerPicture {
    /// Straight colours, sRGB, each with the share of 255 of its pixel that it covers.
    pub(super) colors: Vec<[u8; 4]>,
    /// 1 / eye depth, 1/m, of what covers the pixel; 0 at infinity.
    pub(super) inverse_depth: Vec<f32>,
}

impl LayerPicture {
    /// Takes a picture, pixel by pixel.
    pub(super) fn set(
        &mut self,
        colors: impl IndexedParallelIterator<Item = [u8; 4]>,
        inverse_depth: impl IndexedParallelIterator<Item = f32>,
    ) {
        colors.collect_into_vec(&mut self.colors);
        inverse_depth.collect_into_vec(&mut self.inverse_depth);
    }
}

/// Lays the nearest of each pixel over the farther ones; of equally near ones the later. `to` takes
/// straight colours with shares.
///
/// A pixel has one depth in each layer: where a layer shows two of its own surfaces in a pixel,
/// another layer's surface between them comes out before or behind both.
pub(super) fn lay_by_depth(layers: &[LayerPicture], to: &mut [[u8; 4]]) {
    /// Pixels that a thread takes at least.
    const AT_LEAST: usize = 1 << 12;
    let light = LinearLight::tables();
    to.par_chunks_mut(AT_LEAST)
        .enumerate()
        .for_each_init(Vec::new, |found, (chunk, to)| {
            for (pixel, to) in to.iter_mut().enumerate() {
                let i = chunk * AT_LEAST + pixel;
                found.clear();
                found.extend(layers.iter().filter_map(|layer| {
                    let color = *layer.colors.get(i)?;
                    (color[3] > 0).then_some((*layer.inverse_depth.get(i)?, color))
                }));
                found.sort_by(|(a, _): &(f32, [u8; 4]), (b, _)| a.total_cmp(b));
                *to = found.iter().fold([0; 4], |behind, &(_, front)| {
                    laid_over(light, front, behind)
                });
            }
        });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_of_each_pixel_is_in_front() {
        let (red, blue) = ([200, 0, 0, 255], [0, 0, 200, 255]);
        let layers = [
            LayerPicture {
                colors: vec![red; 4],
                inverse_depth: vec![0.5, 1.5, 1.0, 0.5],
            },
            LayerPicture {
                colors: vec![blue, blue, blue, [0, 0, 200, 0]],
                inverse_depth: vec![1.0, 1.0, 1.0, 9.0],
            },
        ];
        let mut laid = [[7; 4]; 4];
        lay_by_depth(&layers, &mut laid);
        assert_eq!(laid, [blue, red, blue, red]);
        lay_by_depth(&[], &mut laid);
        assert_eq!(laid, [[0; 4]; 4]);
    }

    #[test]
    fn partial_coverage_lets_farther_through() {
        let half = |color: [u8; 3]| [color[0], color[1], color[2], 128];
        let layers = [([255; 3], 3.0), ([0; 3], 2.0), ([255, 0, 0], 1.0)].map(|(color, depth)| {
            LayerPicture {
                colors: vec![half(color)],
                inverse_depth: vec![depth],
            }
        });
        let mut laid = [[0; 4]];
        lay_by_depth(&layers, &mut laid);
        // In linear light: half white, a quarter black, an eighth red, over a share of 7/8.
        assert!(
            laid[0][3] > 220 && laid[0][0] > laid[0][1] && laid[0][1] > 190,
            "{:?}",
            laid[0]
        );
        assert_eq!(laid[0][1], laid[0][2]);
    }
}
