//! A camera's image as a texture: linear light, mip levels, and the inverse depth of every texel.

use super::samples::Samples;
use crate::view_geometry::render::fuse::NO_OWNER;
use glam::Vec4;
use headbox_core::color::linear_from_srgb8;
use headbox_core::image::mip::{MipLevel, OddEdge};
use headbox_core::image::texels::bilinear;
use headbox_images::{LoadedView, MAX_DEPTH_M};
use std::iter::successors;
use std::sync::Arc;

/// Full linear light in 16 bits.
const FULL: f32 = 65_535.0;

/// Fourth channel of a texel: masked, unknown depth, or from `LEAST_DEPTH` on quantised inverse
/// depth.
pub(super) const MASKED: u16 = 0;
const UNKNOWN: u16 = 1;
pub(super) const LEAST_DEPTH: u16 = 2;

/// An image and its mip levels.
#[derive(Debug)]
pub(crate) struct Picture {
    pub(super) levels: Vec<Level>,
    /// Quantisation step of the inverse depth in the texels' fourth channel, 1/m.
    pub(crate) inverse_depth_step: f32,
    /// Samples of the camera, if they are stored in a file.
    pub(crate) samples: Option<Arc<Samples>>,
}

/// Mip level. Texels are red, green, blue and quantised inverse depth, row by row; the last column
/// and row are repeated, so that every texel has neighbours.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Level {
    /// Width and height, without the repeated column and row.
    pub(super) size: [f32; 2],
    /// Last column and row, without the repeated ones.
    pub(super) last: [i32; 2],
    /// Size in proportion to that of the image.
    pub(super) scale: [f32; 2],
    /// Texels from one row to the next.
    pub(super) stride: usize,
    pub(super) texels: Vec<[u16; 4]>,
}

/// Maximum number of mip levels, including the image: another camera is a better choice for a
/// minification beyond 16 times.
const LEVELS: usize = 5;

impl Picture {
    /// Builds the texture of a view in memory.
    pub(crate) fn new(view: &LoadedView) -> Self {
        let inverse = |i: usize| {
            view.depth
                .get(i)
                .filter(|depth| **depth > 0.0)
                .map(|depth| 1.0 / depth.min(MAX_DEPTH_M))
        };
        let nearest = (0..view.depth.len())
            .filter_map(inverse)
            .fold(0.0, f32::max);
        let step = if nearest > 0.0 {
            nearest / f32::from(NO_OWNER - LEAST_DEPTH)
        } else {
            1.0
        };
        let texel = |i: usize| {
            let [r, g, b, a] = view.color.get(i).copied().unwrap_or_default();
            let [r, g, b] = [r, g, b].map(|c| (linear_from_srgb8(c) * FULL + 0.5) as u16);
            let depth = match inverse(i) {
                _ if a == 0 => MASKED,
                // A very distant depth is still known: at least one step, even if that is nearer.
                Some(inverse) => {
                    LEAST_DEPTH
                        + (inverse / step + 0.5).clamp(1.0, f32::from(NO_OWNER - LEAST_DEPTH))
                            as u16
                }
                None => UNKNOWN,
            };
            [r, g, b, depth]
        };
        let size = view.size_px.map(|side| side as usize);
        let finest = MipLevel {
            size,
            texels: (0..size[0] * size[1]).map(texel).collect(),
        };
        let levels = successors(Some(finest), |level| {
            let can_be_halved = level.size[0].min(level.size[1]) >= 2;
            can_be_halved.then(|| level.halved(OddEdge::Repeat, average_unmasked))
        });
        Self {
            levels: levels
                .take(LEVELS)
                .map(|level| Level::new(&level, size))
                .collect(),
            inverse_depth_step: step,
            samples: None,
        }
    }

    /// Adds the samples of the camera, if they are stored in a file.
    #[must_use]
    pub(crate) fn with_samples(self, samples: Option<Arc<Samples>>) -> Self {
        Self { samples, ..self }
    }

    /// Bytes in memory.
    pub(crate) fn bytes(&self) -> usize {
        let levels = self.levels.iter();
        let texels = levels.map(|level| size_of_val(level.texels.as_slice()));
        texels.sum::<usize>() + self.samples.as_ref().map_or(0, |samples| samples.bytes())
    }

    /// Returns the level in which a footprint of `texels` of the image along an axis is nearest to
    /// one texel.
    #[inline]
    pub(crate) fn level_for(&self, texels: f32) -> usize {
        // Level boundaries are at half octaves.
        if texels * texels < 2.0 {
            0
        } else {
            ((texels * texels * 2.0).log2() * 0.5).min((self.levels.len() - 1) as f32) as usize
        }
    }

    /// Samples the image at a position in pixels: linear colour, 0 to [`FULL`], bilinear over
    /// unmasked texels, and inverse depth of the nearest texel, 1/m, 0 where unknown. `None`
    /// outside and where all texels are masked.
    #[inline(always)]
    pub(crate) fn sample(&self, level: usize, x: f32, y: f32) -> Option<([f32; 3], f32)> {
        let level = self.levels.get(level)?;
        let (x, y) = (x * level.scale[0], y * level.scale[1]);
        let [width, height] = level.size;
        if !((x >= 0.0) & (y >= 0.0) & (x <= width) & (y <= height)) {
            return None;
        }
        // The colour is constant beyond the centres of the outermost texels.
        let x = (x - 0.5).max(0.0).min(width - 1.0);
        let y = (y - 0.5).max(0.0).min(height - 1.0);
        let (column, row) = ((x as i32).min(level.last[0]), (y as i32).min(level.last[1]));
        let (fx, fy) = (x - column as f32, y - row as f32);
        let first = row as usize * level.stride + column as usize;
        let [a, b] = *level.texels.get(first..)?.first_chunk::<2>()?;
        let [c, d] = *level
            .texels
            .get(first + level.stride..)?
            .first_chunk::<2>()?;
        let upper = if fx < 0.5 { a[3] } else { b[3] };
        let lower = if fx < 0.5 { c[3] } else { d[3] };
        let depth = if fy < 0.5 { upper } else { lower };
        let shown = f32::from(depth.max(LEAST_DEPTH) - LEAST_DEPTH) * self.inverse_depth_step;
        if a[3].min(b[3]).min(c[3].min(d[3])) == MASKED {
            return Some((blend_unmasked([a, b, c, d], fx, fy)?, shown));
        }
        let [a, b, c, d] = [a, b, c, d].map(|texel| Vec4::from(texel.map(f32::from)));
        let color = bilinear([a, b, c, d], [fx, fy]);
        Some(([color.x, color.y, color.z], shown))
    }
}

/// Blends the unmasked texels bilinearly.
fn blend_unmasked(four: [[u16; 4]; 4], fx: f32, fy: f32) -> Option<[f32; 3]> {
    let weights = [
        (1.0 - fx) * (1.0 - fy),
        fx * (1.0 - fy),
        (1.0 - fx) * fy,
        fx * fy,
    ];
    let (mut sum, mut total) = ([0.0; 3], 0.0);
    for (texel, weight) in four
        .into_iter()
        .zip(weights)
        .filter(|(texel, _)| texel[3] != MASKED)
    {
        (0..3).for_each(|k| sum[k] += f32::from(texel[k]) * weight);
        total += weight;
    }
    (total > 0.0).then(|| sum.map(|c| c / total))
}

/// Averages the unmasked of four texels; takes the nearest of the four depths.
fn average_unmasked(four: [[u16; 4]; 4]) -> [u16; 4] {
    let color = blend_unmasked(four, 0.5, 0.5).unwrap_or_default();
    let [r, g, b] = color.map(|c| (c + 0.5) as u16);
    let depth = four.iter().map(|texel| texel[3]).max().unwrap_or(MASKED);
    [r, g, b, depth]
}

impl Level {
    /// Builds a padded level from a mip level of an image of `image_size` texels.
    fn new(mip: &MipLevel<[u16; 4]>, image_size: [usize; 2]) -> Self {
        let [width, height] = mip.size;
        let rows = (0..=height).map(|y| y.min(height - 1));
        let places = rows.flat_map(|y| (0..=width).map(move |x| y * width + x.min(width - 1)));
        Self {
            size: mip.size.map(|side| side as f32),
            last: mip.size.map(|side| side as i32 - 1),
            scale: [0, 1].map(|axis| mip.size[axis] as f32 / image_size[axis] as f32),
            stride: width + 1,
            texels: places.map(|place| mip.texels[place]).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    pub(crate) use crate::view_geometry::tests::make_view;
    use glam::DVec3;

    fn view() -> LoadedView {
        let depth = |x: u32, _| if x == 0 { f32::NAN } else { 1.0 + x as f32 };
        make_view(
            DVec3::ZERO,
            depth,
            |x, y| [x as u8 * 10, y as u8 * 20, 200],
            [13, 7],
        )
    }

    fn color(picture: &Picture, level: usize, x: f32, y: f32) -> Option<[f32; 3]> {
        picture.sample(level, x, y).map(|(color, _)| color)
    }

    fn shown(picture: &Picture, x: f32, y: f32) -> f32 {
        picture.sample(0, x, y).expect("inside").1
    }

    #[test]
    fn colours_are_bilinear_in_linear_light() {
        let picture = Picture::new(&view());
        let linear = |level: u8| linear_from_srgb8(level) * FULL;
        for (x, y) in [
            (4.5, 3.5),
            (4.75, 3.5),
            (4.5, 3.75),
            (0.0, 0.0),
            (13.0, 7.0),
        ] {
            let found = color(&picture, 0, x, y).expect("inside");
            let mixed = |at: f32, side: f32, step: f32| {
                let at = (at - 0.5).clamp(0.0, side - 1.0);
                let [low, high] = [at.floor(), at.ceil()].map(|at| linear((at * step) as u8));
                low + (high - low) * at.fract()
            };
            let expected = [mixed(x, 13.0, 10.0), mixed(y, 7.0, 20.0), linear(200)];
            // Half a step of sixteen bits for each of the texels.
            assert!(
                (0..3).all(|k| (found[k] - expected[k]).abs() < 1.1),
                "{x} {y}: {found:?} {expected:?}"
            );
        }
        assert!(
            color(&picture, 0, -0.01, 1.0).is_none() && color(&picture, 0, 13.01, 1.0).is_none()
        );
        assert!(
            color(&picture, 0, f32::NAN, 1.0).is_none()
                && picture.sample(1, f32::NAN, 1.0).is_none()
        );
    }

    #[test]
    fn texture_keeps_depth_ignores_masked() {
        let mut view = view();
        let width = view.size_px[0] as usize;
        view.color[3 * width + 5][3] = 0;
        let picture = Picture::new(&view);
        for x in 1..13 {
            let found = shown(&picture, x as f32 + 0.5, 1.5);
            assert!(
                (found - 1.0 / (1.0 + x as f32)).abs() < 0.5 / 65_000.0,
                "{x}"
            );
        }
        assert!(shown(&picture, 0.5, 1.5) == 0.0, "unknown");
        assert!(picture.sample(0, 13.5, 3.5).is_none() && picture.sample(0, 2.0, 9.0).is_none());
        assert_eq!(color(&picture, 0, 5.5, 3.5), None);
        let beside = color(&picture, 0, 5.9, 3.5).expect("its neighbour");
        assert!((beside[0] - linear_from_srgb8(60) * FULL).abs() < 1.0);
    }

    #[test]
    fn infinite_depth_is_known() {
        let depth = |x: u32, _| [f32::NAN, 1.0, f32::INFINITY, 1e5][x as usize % 4];
        let picture = Picture::new(&make_view(DVec3::ZERO, depth, |_, _| [90; 3], [8, 4]));
        let found = [0, 1, 2, 3].map(|x| shown(&picture, x as f32 + 0.5, 1.5));
        let step = picture.inverse_depth_step;
        assert!(
            found[0] == 0.0
                && (found[1] - 1.0).abs() < step
                && found[2] == step
                && found[3] == step,
            "{found:?}"
        );
    }

    #[test]
    fn levels_are_means_of_the_image() {
        let view = make_view(
            DVec3::ZERO,
            |_, _| 1.0,
            |x, y| [if (x + y) % 2 == 0 { 255 } else { 0 }; 3],
            [16, 8],
        );
        let picture = Picture::new(&view);
        assert_eq!(
            (
                picture.level_for(1.0),
                picture.level_for(1.5),
                picture.level_for(4.1)
            ),
            (0, 1, 2)
        );
        for (x, y) in [(3.0, 3.0), (8.3, 4.0), (15.0, 1.0)] {
            let found = color(&picture, 1, x, y).expect("inside");
            assert!((found[0] - FULL / 2.0).abs() < 1.0, "{found:?}");
        }
    }
}
