//! Levels of detail of the images: colours are low-pass filtered in linear light, layer indices by
//! majority vote, never averaged (L7, C19).

use crate::{CameraGrid, Picture};
use headbox_core::color::linear_from_srgb8;
use headbox_core::image::mip::half_size;
use rayon::prelude::*;

/// Texel of an image: linear red, green and blue, 65535 for 1, and the layer index.
pub(crate) type Texel = [u16; 4];

/// Layout of a level of detail.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Level {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Index of the first texel among each camera's texels.
    pub(crate) first: usize,
}

/// All images at all levels of detail; level 0 has the resolution of the images.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Pyramid {
    pub(crate) levels: Vec<Level>,
    /// Number of texels of a camera.
    pub(crate) stride: usize,
    /// Texels, camera by camera, level by level, row-major.
    pub(crate) texels: Vec<Texel>,
}

/// The paper's Gaussian kernel: the binomial one with four taps, symmetric about the middle of two
/// pixels.
const KERNEL: [u32; 4] = [1, 3, 3, 1];

impl Pyramid {
    pub(crate) fn new(grid: &CameraGrid, pictures: &[Picture]) -> Self {
        let [width, height] = grid.size_px().map(|side| side as usize);
        let mut levels = vec![Level {
            width,
            height,
            first: 0,
        }];
        let mut stride = width * height;
        while let Some(&Level { width, height, .. }) = levels.last() {
            let [width, height] = half_size([width, height]);
            if width.min(height) < 2 {
                break;
            }
            levels.push(Level {
                width,
                height,
                first: stride,
            });
            stride += width * height;
        }
        let linear: [u16; 256] =
            std::array::from_fn(|c| (linear_from_srgb8(c as u8) * 65535.0 + 0.5) as u16);
        let mut texels = vec![[0; 4]; stride * pictures.len()];
        texels
            .par_chunks_mut(stride)
            .zip(pictures)
            .for_each(|(texels, picture)| {
                let pixels = picture.color.iter().zip(&picture.index);
                for (texel, (color, &index)) in texels.iter_mut().zip(pixels) {
                    let [r, g, b] = color.map(|c| linear[usize::from(c)]);
                    *texel = [r, g, b, index];
                }
                for pair in levels.windows(2) {
                    let (finer, coarser) = texels.split_at_mut(pair[1].first);
                    halve(
                        &finer[pair[0].first..],
                        pair[0],
                        &mut coarser[..pair[1].width * pair[1].height],
                        pair[1],
                    );
                }
            });
        Self {
            levels,
            stride,
            texels,
        }
    }

    /// Returns the size of all texels, bytes.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&self.texels[..])
    }
}

/// Filters a level down to the next coarser one.
fn halve(finer: &[Texel], from: Level, coarser: &mut [Texel], to: Level) {
    let source =
        |at: usize, tap: usize, count: usize| (2 * at + tap).saturating_sub(1).min(count - 1);
    for (y, row) in coarser.chunks_exact_mut(to.width).enumerate() {
        for (x, texel) in row.iter_mut().enumerate() {
            let mut sum = [0u32; 3];
            for (j, down) in KERNEL.iter().enumerate() {
                let source_row = &finer[source(y, j, from.height) * from.width..];
                for (i, across) in KERNEL.iter().enumerate() {
                    let [r, g, b, _] = source_row[source(x, i, from.width)].map(u32::from);
                    let weight = across * down;
                    sum = [
                        sum[0] + weight * r,
                        sum[1] + weight * g,
                        sum[2] + weight * b,
                    ];
                }
            }
            let [r, g, b] = sum.map(|sum| ((sum + 32) / 64) as u16);
            let index = |i: usize, j: usize| {
                finer[source(y, j, from.height) * from.width + source(x, i, from.width)][3]
            };
            let index = vote([index(1, 1), index(2, 1), index(1, 2), index(2, 2)]);
            *texel = [r, g, b, index];
        }
    }
}

/// Returns the most frequent of four indices; on a tie that of the nearest layer, which preserves
/// thin objects (C19).
fn vote(indices: [u16; 4]) -> u16 {
    let votes = |index: u16| indices.iter().filter(|other| **other == index).count();
    indices
        .into_iter()
        .max_by_key(|&index| (votes(index), index))
        .unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::GridParts;
    use crate::grid::tests::any_grid;

    fn grid(size_px: [u32; 2]) -> CameraGrid {
        let grid = any_grid();
        let (origin, world_from_eye) = (grid.origin(), grid.world_from_eye());
        let parts = GridParts {
            origin,
            world_from_eye,
            columns: vec![0.0],
            rows: vec![0.0],
            focal_px: 50.0,
            size_px,
            convergence: 0.0,
        };
        CameraGrid::new(parts).expect("a grid")
    }

    #[test]
    fn indices_are_voted_on_and_never_invented() {
        assert_eq!(vote([1, 9, 1, 5]), 1);
        assert_eq!(vote([1, 9, 9, 1]), 9);
        assert_eq!(vote([1, 2, 3, 4]), 4);
        assert_eq!(vote([0, 0, 0, 7]), 0);
        let pixels = 13 * 7;
        let index: Vec<u16> = (0..pixels)
            .map(|i| if i * 7919 % 13 < 6 { 3 } else { 200 })
            .collect();
        let pyramid = Pyramid::new(
            &grid([13, 7]),
            &[Picture {
                color: vec![[9; 3]; pixels],
                index,
            }],
        );
        assert!(
            pyramid
                .texels
                .iter()
                .all(|texel| texel[3] == 3 || texel[3] == 200)
        );
    }

    #[test]
    fn levels_halve_and_keep_the_light() {
        let color = |i: usize| {
            if (i + i / 16).is_multiple_of(2) {
                [255; 3]
            } else {
                [0; 3]
            }
        };
        let picture = Picture {
            color: (0..256).map(color).collect(),
            index: vec![1; 256],
        };
        let pyramid = Pyramid::new(&grid([16, 16]), &[picture]);
        let sizes: Vec<[usize; 2]> = pyramid
            .levels
            .iter()
            .map(|level| [level.width, level.height])
            .collect();
        assert_eq!(sizes, [[16, 16], [8, 8], [4, 4], [2, 2]]);
        // A checkerboard of black and white is half the light, which is no half of sRGB.
        let inner = pyramid.texels[pyramid.levels[1].first + 3 * 8 + 3];
        assert!(
            inner[..3].iter().all(|c| c.abs_diff(32768) <= 1),
            "{inner:?}"
        );
        let [wide, high] = [[2, 900], [900, 3]].map(|size| {
            let pixels = (size[0] * size[1]) as usize;
            let picture = Picture {
                color: vec![[1, 2, 3]; pixels],
                index: vec![0; pixels],
            };
            Pyramid::new(&grid(size), &[picture]).levels.len()
        });
        assert_eq!((wide, high), (1, 2), "no level is narrower than two texels");
    }
}
