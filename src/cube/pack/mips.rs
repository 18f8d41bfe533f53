//! Pictures on planes at half, a quarter and an eighth of their size, and each of these softened,
//! for frames whose pixels are larger than texels.
//!
//! A lookup between four texels is a tent as wide as their distance. Where that is less than a
//! pixel, texels fall between pixels; a picture of half the size at once would blur. So the sizes
//! come in steps of the square root of 2 or so: an odd level is the one before it, softened by 1,
//! 10, 1 (twelfths), an even one every second texel of the one two before it, of which each is a
//! mean with its neighbours by -1, 4, 10, 4, -1 (sixteenths). That neither blurs (its variance is
//! 0) nor keeps what half as many texels cannot show (0 at the highest frequency). The outermost
//! lines of texels are taken as they are, so that tiles that share one still meet. What that
//! brings: docs/decisions/0051.

use std::sync::OnceLock;

/// Levels after the first.
pub(crate) const LEVELS: usize = 6;

/// All pictures of a set at one size.
#[derive(Debug)]
pub(super) struct Mip {
    /// First texel of each texture, and the end.
    starts: Vec<usize>,
    texels: Vec<[u8; 4]>,
}

impl Mip {
    pub(super) fn of(pictures: Vec<Vec<[u8; 4]>>) -> Self {
        let mut mip = Self {
            starts: vec![0],
            texels: Vec::new(),
        };
        for picture in pictures {
            mip.texels.extend(picture);
            mip.starts.push(mip.texels.len());
        }
        mip
    }

    /// The texels of a picture; empty if there is none.
    pub(super) fn picture(&self, index: usize) -> &[[u8; 4]] {
        self.starts
            .get(index..index + 2)
            .and_then(|ends| self.texels.get(ends[0]..ends[1]))
            .unwrap_or(&[])
    }
}

/// [`Mip`]s that are made when they are first asked for. A copy has none.
#[derive(Debug, Default)]
pub struct LazyMips([OnceLock<Mip>; LEVELS]);

impl LazyMips {
    /// Level 1 or a higher one. Whoever finds it missing makes it; nobody waits for another, since
    /// a thread of the pool that makes it in parallel may be given a task that asks for it too.
    pub(super) fn level(&self, level: usize, make: impl FnOnce() -> Mip) -> &Mip {
        let slot = &self.0[(level - 1).min(LEVELS - 1)];
        if let Some(mip) = slot.get() {
            return mip;
        }
        let made = make();
        slot.get_or_init(|| made)
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

/// Number of halvings of the size at a level.
pub(crate) fn halvings(level: usize) -> usize {
    level / 2
}

/// Texels at a level along a side that has `length` of them: with each halving every second one,
/// and the last.
pub(crate) fn side(length: u16, level: usize) -> usize {
    usize::from(length)
        .saturating_sub(1)
        .div_ceil(1 << halvings(level))
        + 1
}

/// Means of neighbours along both axes.
pub(super) struct Filter {
    /// Weights of a texel, of its neighbours, and of theirs.
    weights: [i32; 3],
    /// Number of texels of which one remains.
    pub(super) step: usize,
}

const SOFTEN: Filter = Filter {
    weights: [10, 1, 0],
    step: 1,
};

const HALVE: Filter = Filter {
    weights: [10, 4, -1],
    step: 2,
};

impl Filter {
    /// By which a level is made from the one [`Self::step`] before it.
    pub(super) fn of_level(level: usize) -> &'static Self {
        if level % 2 == 1 { &SOFTEN } else { &HALVE }
    }

    /// The sum of all weights along an axis.
    const fn total(&self) -> i32 {
        self.weights[0] + 2 * (self.weights[1] + self.weights[2])
    }

    /// A picture of some columns and rows as one of others.
    pub(super) fn apply(
        &self,
        from: &[[u8; 4]],
        [width, height]: [usize; 2],
        [columns, rows]: [usize; 2],
    ) -> Vec<[u8; 4]> {
        if from.len() != width * height {
            return Vec::new();
        }
        let mut narrow = Vec::with_capacity(columns * height);
        for row in from.chunks_exact(width) {
            narrow.extend((0..columns).map(|x| self.mean(x, width, |i| row[i].map(i32::from))));
        }
        let (total, mut texels) = (self.total().pow(2), Vec::with_capacity(columns * rows));
        for y in 0..rows {
            for x in 0..columns {
                let sums = self.mean(y, height, |i| narrow[i * columns + x]);
                let [r, g, b, alpha] =
                    sums.map(|sum| ((sum + total / 2) / total).clamp(0, 255) as u8);
                // Colours are multiplied by alpha.
                texels.push([r.min(alpha), g.min(alpha), b.min(alpha), alpha]);
            }
        }
        texels
    }

    /// The weighted sum about the texel that the `i`th of a line comes from, of a line of `length`.
    fn mean(&self, i: usize, length: usize, at: impl Fn(usize) -> [i32; 4]) -> [i32; 4] {
        let (middle, last) = (i * self.step, length.saturating_sub(1));
        if middle == 0 || middle >= last {
            return at(middle.min(last)).map(|c| c * self.total());
        }
        let [own, near, far] = self.weights;
        let pair = |k: usize| [at(middle.saturating_sub(k)), at((middle + k).min(last))];
        let (here, [a, b], [c, d]) = (at(middle), pair(1), pair(2));
        std::array::from_fn(|k| own * here[k] + near * (a[k] + b[k]) + far * (c[k] + d[k]))
    }
}
