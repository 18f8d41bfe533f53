//! Mip levels of plane textures: half, a quarter and an eighth of their size, and a smoothed level
//! between each, for frames whose pixels are larger than texels.
//!
//! A bilinear lookup is a tent as wide as the distance of texels. If that is less than a pixel, the
//! texture aliases; a texture of half the size blurs. So there are about two levels per octave: an
//! odd level is the level before it, smoothed by 1, 10, 1 (twelfths); an even level is the level
//! two before it, filtered by -1, 4, 10, 4, -1 (sixteenths) and decimated by 2. That filter neither
//! blurs (its variance is 0) nor aliases (0 at the highest frequency). The outermost lines of
//! texels are not filtered across, so that tiles that share one still meet. Measured in
//! docs/decisions/0051.

use std::sync::OnceLock;

/// Number of levels after level 0.
pub(crate) const LEVELS: usize = 6;

/// One level of all plane textures of a set.
#[derive(Debug)]
pub(crate) struct Mip {
    /// First texel of each texture, and the end.
    starts: Vec<usize>,
    texels: Vec<[u8; 4]>,
}

impl Mip {
    pub(crate) fn new(textures: Vec<Vec<[u8; 4]>>) -> Self {
        let mut mip = Self {
            starts: vec![0],
            texels: Vec::new(),
        };
        for texture in textures {
            mip.texels.extend(texture);
            mip.starts.push(mip.texels.len());
        }
        mip
    }

    /// Returns the texels of a texture; empty if there is none.
    pub(crate) fn texture(&self, index: usize) -> &[[u8; 4]] {
        self.starts
            .get(index..index + 2)
            .and_then(|ends| self.texels.get(ends[0]..ends[1]))
            .unwrap_or(&[])
    }
}

/// Mip levels that are computed on first use. Clones start empty, and all are equal.
#[derive(Debug, Default)]
pub struct LazyMips([OnceLock<Mip>; LEVELS]);

impl LazyMips {
    /// Returns a level from 1 on, and computes it if it is missing. Concurrent callers may compute
    /// it twice: waiting could deadlock, as a pool thread that computes it in parallel may steal a
    /// task that needs it too.
    pub(crate) fn level(&self, level: usize, compute: impl FnOnce() -> Mip) -> &Mip {
        let slot = &self.0[(level - 1).min(LEVELS - 1)];
        if let Some(mip) = slot.get() {
            return mip;
        }
        let mip = compute();
        slot.get_or_init(|| mip)
    }
}

impl Clone for LazyMips {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl PartialEq for LazyMips {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

/// Returns the number of halvings of the size at a level.
pub(crate) fn halvings(level: usize) -> usize {
    level / 2
}

/// Returns the number of texels at a level along a side of `length` texels: each halving keeps
/// every second one, and the last.
pub(crate) fn side(length: u16, level: usize) -> usize {
    usize::from(length)
        .saturating_sub(1)
        .div_ceil(1 << halvings(level))
        + 1
}

/// A separable filter with decimation.
pub(super) struct Filter {
    /// Weights at distance 0, 1 and 2.
    weights: [i32; 3],
    /// Decimation: one of `step` texels remains. Also the number of levels back to the source.
    pub(crate) step: usize,
}

const SMOOTH: Filter = Filter {
    weights: [10, 1, 0],
    step: 1,
};

const HALVE: Filter = Filter {
    weights: [10, 4, -1],
    step: 2,
};

impl Filter {
    /// Returns the filter from the level [`Self::step`] before to `level`.
    pub(super) fn for_level(level: usize) -> &'static Self {
        if level % 2 == 1 { &SMOOTH } else { &HALVE }
    }

    /// Returns the sum of all weights along an axis.
    const fn total(&self) -> i32 {
        self.weights[0] + 2 * (self.weights[1] + self.weights[2])
    }

    /// Filters a texture of `width` x `height` texels to `columns` x `rows`; empty if the source
    /// has the wrong number of texels.
    pub(crate) fn apply(
        &self,
        source: &[[u8; 4]],
        [width, height]: [usize; 2],
        [columns, rows]: [usize; 2],
    ) -> Vec<[u8; 4]> {
        if source.len() != width * height {
            return Vec::new();
        }
        let mut narrow = Vec::with_capacity(columns * height);
        for row in source.chunks_exact(width) {
            narrow.extend((0..columns).map(|x| self.sum(x, width, |i| row[i].map(i32::from))));
        }
        let (total, mut texels) = (self.total().pow(2), Vec::with_capacity(columns * rows));
        for y in 0..rows {
            for x in 0..columns {
                let sums = self.sum(y, height, |i| narrow[i * columns + x]);
                let [r, g, b, alpha] =
                    sums.map(|sum| ((sum + total / 2) / total).clamp(0, 255) as u8);
                // Colours are premultiplied.
                texels.push([r.min(alpha), g.min(alpha), b.min(alpha), alpha]);
            }
        }
        texels
    }

    /// Computes the weighted sum for the `i`th output texel of a line of `length` source texels.
    fn sum(&self, i: usize, length: usize, texel: impl Fn(usize) -> [i32; 4]) -> [i32; 4] {
        let (middle, last) = (i * self.step, length.saturating_sub(1));
        if middle == 0 || middle >= last {
            return texel(middle.min(last)).map(|c| c * self.total());
        }
        let [own, near, far] = self.weights;
        let pair = |k: usize| {
            [
                texel(middle.saturating_sub(k)),
                texel((middle + k).min(last)),
            ]
        };
        let (here, [a, b], [c, d]) = (texel(middle), pair(1), pair(2));
        std::array::from_fn(|k| own * here[k] + near * (a[k] + b[k]) + far * (c[k] + d[k]))
    }
}
