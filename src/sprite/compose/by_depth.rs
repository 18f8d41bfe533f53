//! Compositing of layers by depth, pixel by pixel (the z-buffer of S25, D14): correct for layers
//! that intersect.

use super::blend_over;
use headbox_cube::render::canvas::linear::LinearLight;
use rayon::prelude::*;

/// Rendered layer with depth, row-major.
#[derive(Default)]
pub(super) struct LayerImage {
    /// Straight sRGB colours, with coverage in units of 1/255 as alpha.
    pub(super) colors: Vec<[u8; 4]>,
    /// Inverse eye depth of each pixel, 1/m; 0 at infinity.
    pub(super) inverse_depth: Vec<f32>,
}

impl LayerImage {
    /// Replaces colours and inverse depths.
    pub(super) fn set(
        &mut self,
        colors: impl IndexedParallelIterator<Item = [u8; 4]>,
        inverse_depth: impl IndexedParallelIterator<Item = f32>,
    ) {
        colors.collect_into_vec(&mut self.colors);
        inverse_depth.collect_into_vec(&mut self.inverse_depth);
    }
}

/// Composites the layers into `to`, each pixel from far to near; among equal depths the later layer
/// is in front. `to` receives straight colours with coverage.
///
/// A pixel has one depth in each layer: if a layer has two surfaces in a pixel, another layer's
/// surface between them is drawn in front of both or behind both.
pub(super) fn composite_by_depth(layers: &[LayerImage], to: &mut [[u8; 4]]) {
    /// Minimum number of pixels per thread.
    const MIN_PIXELS_PER_THREAD: usize = 1 << 12;
    let light = LinearLight::tables();
    to.par_chunks_mut(MIN_PIXELS_PER_THREAD)
        .enumerate()
        .for_each_init(Vec::new, |fragments, (chunk, to)| {
            for (pixel, to) in to.iter_mut().enumerate() {
                let i = chunk * MIN_PIXELS_PER_THREAD + pixel;
                fragments.clear();
                fragments.extend(layers.iter().filter_map(|layer| {
                    let color = *layer.colors.get(i)?;
                    (color[3] > 0).then_some((*layer.inverse_depth.get(i)?, color))
                }));
                fragments.sort_by(|(a, _): &(f32, [u8; 4]), (b, _)| a.total_cmp(b));
                *to = fragments.iter().fold([0; 4], |behind, &(_, front)| {
                    blend_over(light, front, behind)
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
            LayerImage {
                colors: vec![red; 4],
                inverse_depth: vec![0.5, 1.5, 1.0, 0.5],
            },
            LayerImage {
                colors: vec![blue, blue, blue, [0, 0, 200, 0]],
                inverse_depth: vec![1.0, 1.0, 1.0, 9.0],
            },
        ];
        let mut laid = [[7; 4]; 4];
        composite_by_depth(&layers, &mut laid);
        assert_eq!(laid, [blue, red, blue, red]);
        composite_by_depth(&[], &mut laid);
        assert_eq!(laid, [[0; 4]; 4]);
    }

    #[test]
    fn partial_coverage_lets_farther_through() {
        let half = |color: [u8; 3]| [color[0], color[1], color[2], 128];
        let layers =
            [([255; 3], 3.0), ([0; 3], 2.0), ([255, 0, 0], 1.0)].map(|(color, depth)| LayerImage {
                colors: vec![half(color)],
                inverse_depth: vec![depth],
            });
        let mut laid = [[0; 4]];
        composite_by_depth(&layers, &mut laid);
        // In linear light: half white, a quarter black, an eighth red, over a share of 7/8.
        assert!(
            laid[0][3] > 220 && laid[0][0] > laid[0][1] && laid[0][1] > 190,
            "{:?}",
            laid[0]
        );
        assert_eq!(laid[0][1], laid[0][2]);
    }
}
