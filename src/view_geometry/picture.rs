//! A camera's picture as a texture: linear light, minified copies, and with every texel how near what it shows is.

use super::fuse::NOBODY;
use crate::capture::images::LoadedView;
use crate::capture::linear_from_srgb8;

/// Sixteen bits of linear light.
const FULL: f32 = 65_535.0;

/// The fourth part of texels that are masked out, and of texels of unknown depth; above them inverse depth.
const MASKED: u16 = 0;
const UNKNOWN: u16 = 1;
const LEAST_DEPTH: u16 = 2;

/// A picture and copies of half the size each, as far as they are of use.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Picture {
    levels: Vec<Level>,
    /// 1/m for a step of the texels' fourth part.
    inverse_depth_step: f32,
}

/// Red, green, blue, and inverse depth in steps, row by row.
#[derive(Clone, Debug, PartialEq)]
struct Level {
    width: usize,
    height: usize,
    texels: Vec<[u16; 4]>,
}

/// Halvings at most: what is seen 16 times smaller than it was taken is better served by another camera.
const HALVINGS: usize = 4;

impl Picture {
    /// Of a view in memory.
    pub(super) fn new(view: &LoadedView) -> Self {
        let inverse = |i: usize| view.depth.get(i).filter(|depth| **depth > 0.0).map(|depth| 1.0 / depth);
        let nearest = (0..view.depth.len()).filter_map(inverse).fold(0.0, f32::max);
        let step = if nearest > 0.0 { nearest / f32::from(NOBODY - LEAST_DEPTH) } else { 1.0 };
        let texels = view.color.iter().enumerate().map(|(i, &[r, g, b, a])| {
            let [r, g, b] = [r, g, b].map(|c| (linear_from_srgb8(c) * FULL + 0.5) as u16);
            let depth = match inverse(i) {
                _ if a == 0 => MASKED,
                Some(inverse) => LEAST_DEPTH + (inverse / step + 0.5).min(f32::from(NOBODY - LEAST_DEPTH)) as u16,
                None => UNKNOWN,
            };
            [r, g, b, depth]
        });
        let [width, height] = view.size_px.map(|side| side as usize);
        let mut levels = vec![Level { width, height, texels: texels.collect() }];
        while let Some(next) = levels.last().filter(|_| levels.len() <= HALVINGS).and_then(Level::halved) {
            levels.push(next);
        }
        Self { levels, inverse_depth_step: step }
    }

    /// Bytes in memory.
    pub(super) fn bytes(&self) -> usize {
        self.levels.iter().map(|level| size_of_val(level.texels.as_slice())).sum()
    }

    /// The copy in which `texels` of the picture along an axis are nearest to one.
    #[inline]
    pub(super) fn level_for(&self, texels: f32) -> usize {
        // Half an octave belongs to either side.
        let finest = texels * texels < 2.0;
        if finest { 0 } else { ((texels * texels * 2.0).log2() * 0.5).min((self.levels.len() - 1) as f32) as usize }
    }

    /// Linear colour, up to [`FULL`], at a position in pixels of the picture, bilinear over what is not masked out; `None`
    /// outside and where all is.
    #[inline]
    pub(super) fn color(&self, level: usize, x: f32, y: f32) -> Option<[f32; 3]> {
        let level = &self.levels[level.min(self.levels.len() - 1)];
        let whole = &self.levels[0];
        let [x, y] =
            [(x, level.width, whole.width), (y, level.height, whole.height)].map(|(at, of_level, of_whole)| {
                if of_level == of_whole { at } else { at * of_level as f32 / of_whole as f32 }
            });
        if !(x >= 0.0 && y >= 0.0 && x <= level.width as f32 && y <= level.height as f32) {
            return None;
        }
        let x = (x - 0.5).max(0.0).min((level.width - 1) as f32);
        let y = (y - 0.5).max(0.0).min((level.height - 1) as f32);
        let (x0, y0) = (x as usize, y as usize);
        let (fx, fy) = (x - x0 as f32, y - y0 as f32);
        let (x1, y1) = ((x0 + 1).min(level.width - 1), (y0 + 1).min(level.height - 1));
        let texel = |x: usize, y: usize| level.texels.get(y * level.width + x).copied().unwrap_or_default();
        let four = [texel(x0, y0), texel(x1, y0), texel(x0, y1), texel(x1, y1)];
        if four.iter().any(|texel| texel[3] == MASKED) {
            return unmasked(four, fx, fy);
        }
        let [a, b, c, d] = four.map(|texel| texel.map(f32::from));
        let mut color = [0.0; 3];
        for k in 0..3 {
            let (top, bottom) = (a[k] + (b[k] - a[k]) * fx, c[k] + (d[k] - c[k]) * fx);
            color[k] = top + (bottom - top) * fy;
        }
        Some(color)
    }

    /// Inverse depth of the texel at a position in pixels of the picture, 1/m; `None` outside and where it is unknown.
    #[inline]
    pub(super) fn inverse_depth(&self, x: f32, y: f32) -> Option<f32> {
        let level = &self.levels[0];
        if !(x >= 0.0 && y >= 0.0) {
            return None;
        }
        let (x, y) = (x as usize, y as usize);
        let texel = (x < level.width).then(|| level.texels.get(y * level.width + x)).flatten()?;
        (texel[3] >= LEAST_DEPTH).then(|| f32::from(texel[3] - LEAST_DEPTH) * self.inverse_depth_step)
    }
}

/// Bilinear over the texels that are not masked out.
fn unmasked(four: [[u16; 4]; 4], fx: f32, fy: f32) -> Option<[f32; 3]> {
    let weights = [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy];
    let (mut sum, mut total) = ([0.0; 3], 0.0);
    for (texel, weight) in four.into_iter().zip(weights).filter(|(texel, _)| texel[3] != MASKED) {
        (0..3).for_each(|k| sum[k] += f32::from(texel[k]) * weight);
        total += weight;
    }
    (total > 0.0).then(|| sum.map(|c| c / total))
}

impl Level {
    /// Half the size, rounded up; each texel is the mean of those of the four that are not masked out.
    fn halved(&self) -> Option<Self> {
        if self.width.min(self.height) < 2 {
            return None;
        }
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let mean = |i: usize| {
            let (x, y) = (2 * (i % width), 2 * (i / width));
            let (x1, y1) = ((x + 1).min(self.width - 1), (y + 1).min(self.height - 1));
            let four = [(x, y), (x1, y), (x, y1), (x1, y1)].map(|(x, y)| self.texels[y * self.width + x]);
            let [r, g, b] = unmasked(four, 0.5, 0.5).unwrap_or_default().map(|c| (c + 0.5) as u16);
            let depth = four.iter().map(|texel| texel[3]).max().unwrap_or(MASKED);
            [r, g, b, depth]
        };
        Some(Self { width, height, texels: (0..width * height).map(mean).collect() })
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::view_of;
    use super::*;
    use glam::DVec3;

    fn view() -> LoadedView {
        let depth = |x: u32, _| if x == 0 { f32::NAN } else { 1.0 + x as f32 };
        view_of(DVec3::ZERO, depth, |x, y| [x as u8 * 10, y as u8 * 20, 200], [13, 7])
    }

    #[test]
    fn colours_are_bilinear_in_linear_light() {
        let picture = Picture::new(&view());
        let linear = |level: u8| linear_from_srgb8(level) * FULL;
        for (x, y) in [(4.5, 3.5), (4.75, 3.5), (4.5, 3.75), (0.0, 0.0), (13.0, 7.0)] {
            let found = picture.color(0, x, y).expect("inside");
            let mixed = |at: f32, side: f32, step: f32| {
                let at = (at - 0.5).clamp(0.0, side - 1.0);
                let [low, high] = [at.floor(), at.ceil()].map(|at| linear((at * step) as u8));
                low + (high - low) * at.fract()
            };
            let expected = [mixed(x, 13.0, 10.0), mixed(y, 7.0, 20.0), linear(200)];
            // Half a step of sixteen bits for each of the texels.
            assert!((0..3).all(|k| (found[k] - expected[k]).abs() < 1.1), "{x} {y}: {found:?} {expected:?}");
        }
        assert!(picture.color(0, -0.01, 1.0).is_none() && picture.color(0, 13.01, 1.0).is_none());
        assert!(picture.color(0, f32::NAN, 1.0).is_none() && picture.inverse_depth(f32::NAN, 1.0).is_none());
    }

    #[test]
    fn depth_comes_back_and_what_is_masked_does_not_count() {
        let mut view = view();
        let width = view.size_px[0] as usize;
        view.color[3 * width + 5][3] = 0;
        let picture = Picture::new(&view);
        for x in 1..13 {
            let found = picture.inverse_depth(x as f32 + 0.5, 1.5).expect("known");
            assert!((found - 1.0 / (1.0 + x as f32)).abs() < 0.5 / 65_000.0, "{x}");
        }
        assert!(picture.inverse_depth(0.5, 1.5).is_none() && picture.inverse_depth(5.5, 3.5).is_none());
        assert!(picture.inverse_depth(13.5, 3.5).is_none() && picture.inverse_depth(2.0, 9.0).is_none());
        assert_eq!(picture.color(0, 5.5, 3.5), None);
        let beside = picture.color(0, 5.9, 3.5).expect("its neighbour");
        assert!((beside[0] - linear_from_srgb8(60) * FULL).abs() < 1.0);
    }

    #[test]
    fn copies_are_means_of_the_picture() {
        let view = view_of(DVec3::ZERO, |_, _| 1.0, |x, y| [if (x + y) % 2 == 0 { 255 } else { 0 }; 3], [16, 8]);
        let picture = Picture::new(&view);
        assert_eq!((picture.level_for(1.0), picture.level_for(1.5), picture.level_for(4.1)), (0, 1, 2));
        for (x, y) in [(3.0, 3.0), (8.3, 4.0), (15.0, 1.0)] {
            let found = picture.color(1, x, y).expect("inside");
            assert!((found[0] - FULL / 2.0).abs() < 1.0, "{found:?}");
        }
    }
}
