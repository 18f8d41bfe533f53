//! Small holes of a finished frame, filled from what lies around them (S9, as gaps of sprites are).
//!
//! What a nearer surface uncovers is the background: so a hole takes the colour of the neighbour that is farthest from the eye,
//! of the four beside it, and grows shut from its rim, [`STEPS`] pixels at most. Only pixels of which nothing is known are filled:
//! a speck of sky between leaves looks the same whether it is there or not. What was filled says so
//! ([`Coverage::FILLED`]), and counts as a hole for all that measures.

use crate::render::setup::clip::Band;
use headbox_core::frame::{Coverage, Frame};

/// Pixels by which a hole is filled from each side: gaps of three pixels and a little more are closed.
const STEPS: usize = 2;

/// Pixels that are looked at together.
const CHUNK: usize = 32;

/// Fills holes; keeps its buffers from frame to frame.
#[derive(Default)]
pub(crate) struct Filler {
    /// 1 / eye depth of pixels, 1/m, 0 where there is no surface. Of pixels that no hole is near it may be anything.
    inverse_depths: Vec<f32>,
    holes: Vec<usize>,
    found: Vec<(usize, Seen)>,
}

/// What a pixel shows.
#[derive(Clone, Copy)]
struct Seen {
    color: [u8; 4],
    inverse_depth: f32,
}

impl Filler {
    /// Makes room for a frame of so many pixels.
    pub(crate) fn prepare(&mut self, pixels: usize) {
        self.inverse_depths.resize(pixels, 0.0);
    }

    /// The inverse depths of the frame, to be written by those who draw it.
    pub(crate) fn inverse_depths(&mut self) -> &mut [f32] {
        &mut self.inverse_depths
    }

    /// Fills the small holes of a frame.
    pub(crate) fn fill(&mut self, frame: &mut Frame) {
        let width = frame.width as usize;
        self.holes.clear();
        for (i, chunk) in frame.coverage.chunks(CHUNK).enumerate() {
            // A minimum is what compilers make vectors of.
            if chunk
                .iter()
                .fold(u8::MAX, |least, coverage| least.min(coverage.byte()))
                == Coverage::HOLE.byte()
            {
                let is_hole = |k: &usize| chunk[*k] == Coverage::HOLE;
                self.holes
                    .extend((0..chunk.len()).filter(is_hole).map(|k| i * CHUNK + k));
            }
        }
        for _ in 0..STEPS {
            let mut found = std::mem::take(&mut self.found);
            found.clear();
            found.extend(
                self.holes
                    .iter()
                    .filter_map(|&i| Some((i, self.farthest_beside(frame, i, width)?))),
            );
            for &(i, seen) in &found {
                (frame.color[i], frame.coverage[i]) = (seen.color, Coverage::FILLED);
                self.inverse_depths[i] = seen.inverse_depth;
            }
            self.found = found;
            self.holes.retain(|&i| frame.coverage[i] == Coverage::HOLE);
        }
    }

    /// What the farthest of the four pixels beside a pixel shows; of those equally far the first: left, right, above, below.
    fn farthest_beside(&self, frame: &Frame, i: usize, width: usize) -> Option<Seen> {
        let column = i % width;
        let beside = [
            (column > 0).then(|| i - 1),
            (column + 1 < width).then_some(i + 1),
            i.checked_sub(width),
            Some(i + width).filter(|&below| below < frame.color.len()),
        ];
        let known = beside
            .into_iter()
            .flatten()
            .filter(|&j| frame.coverage[j] != Coverage::HOLE);
        let seen = known.map(|j| {
            let is_far = frame.coverage[j] == Coverage::ENVIRONMENT;
            Seen {
                color: frame.color[j],
                inverse_depth: if is_far { 0.0 } else { self.inverse_depths[j] },
            }
        });
        seen.min_by(|a, b| a.inverse_depth.total_cmp(&b.inverse_depth))
    }
}

/// Has those rows of a band told to whose pixels holes may look, the band's own or those of its neighbours: `tell` writes a row,
/// counted from the band's first. Nothing if `inverse_depths` is empty.
pub(crate) fn tell_rows(
    inverse_depths: &mut [f32],
    band: &Band,
    has_holes: bool,
    tell: impl Fn(usize, &mut [f32]),
) {
    let last = band.rows.len();
    for (row, to) in inverse_depths
        .chunks_mut(band.width.max(1) as usize)
        .enumerate()
    {
        if has_holes || row < STEPS || row + STEPS >= last {
            tell(row, to);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use headbox_core::random::Rng;

    /// The same, said plainly: a whole image at a time.
    fn oracle(frame: &Frame, inverse_depths: &[f32]) -> Frame {
        let (width, height) = (i64::from(frame.width), i64::from(frame.height));
        let (mut frame, mut depths) = (frame.clone(), inverse_depths.to_vec());
        for _ in 0..STEPS {
            let (before, depths_before) = (frame.clone(), depths.clone());
            for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
                let at = (y * width + x) as usize;
                let mut farthest = f32::INFINITY;
                for (dx, dy) in [(-1, 0), (1, 0), (0, -1), (0, 1)] {
                    let (nx, ny) = (x + dx, y + dy);
                    if before.coverage[at] != Coverage::HOLE
                        || nx < 0
                        || ny < 0
                        || nx >= width
                        || ny >= height
                    {
                        continue;
                    }
                    let n = (ny * width + nx) as usize;
                    let depth = match before.coverage[n] {
                        Coverage::HOLE => continue,
                        Coverage::ENVIRONMENT => 0.0,
                        _ => depths_before[n],
                    };
                    if depth < farthest {
                        farthest = depth;
                        (frame.color[at], frame.coverage[at]) = (before.color[n], Coverage::FILLED);
                        depths[at] = depth;
                    }
                }
            }
        }
        frame
    }

    #[test]
    fn filling_is_what_the_oracle_does() {
        let mut random = Rng::new(5);
        for [width, height, hole_share] in [
            [40, 30, 10],
            [64, 64, 60],
            [1, 90, 50],
            [33, 1, 95],
            [7, 5, 100],
            [3, 3, 0],
        ] {
            let mut frame = Frame::default();
            frame.reset(width, height, [0; 3]);
            let mut inverse_depths = vec![0.0; frame.color.len()];
            for i in 0..frame.color.len() {
                if random.below(100) < u64::from(hole_share) {
                    continue;
                }
                let kinds = [
                    Coverage::ENVIRONMENT,
                    Coverage::from_splat_share(9),
                    Coverage::FULL,
                ];
                frame.coverage[i] = kinds[random.below(3) as usize];
                frame.color[i] = [random.below(256) as u8, random.below(256) as u8, 7, 255];
                inverse_depths[i] = random.below(4) as f32;
            }
            let expected = oracle(&frame, &inverse_depths);
            let mut filler = Filler {
                inverse_depths,
                ..Filler::default()
            };
            filler.fill(&mut frame);
            assert!(
                frame == expected,
                "{width}x{height}, {hole_share} %: not a bit differs"
            );
        }
    }

    #[test]
    fn bands_tell_the_rows_that_holes_may_look_at() {
        let told = |has_holes: bool, rows: u32, pixels: usize| {
            let (mut depths, band) = (
                vec![0.0; pixels],
                Band {
                    width: 3,
                    height: 20,
                    principal_px: [0.0; 2],
                    rows: 4..4 + rows,
                },
            );
            tell_rows(&mut depths, &band, has_holes, |row, to| {
                to.fill(1.0 + row as f32)
            });
            depths
        };
        let three = |rows: [usize; 7]| rows.map(|row| [row as f32; 3]).concat();
        assert_eq!(
            told(false, 7, 21),
            three([1, 2, 0, 0, 0, 6, 7]),
            "two rows at either border"
        );
        assert_eq!(told(true, 7, 21), three([1, 2, 3, 4, 5, 6, 7]));
        assert_eq!(
            (told(true, 7, 0), told(false, 1, 3)),
            (vec![], vec![1.0; 3])
        );
    }

    #[test]
    fn a_speck_takes_the_background_and_a_large_hole_stays() {
        let mut frame = Frame::default();
        frame.reset(9, 1, [0; 3]);
        let mut filler = Filler::default();
        filler.prepare(9);
        let (near, far) = ([200, 0, 0, 255], [0, 0, 200, 255]);
        for (i, color, inverse_depth) in [(0, near, 2.0), (2, far, 0.1), (8, near, 2.0)] {
            (frame.color[i], frame.coverage[i]) = (color, Coverage::FULL);
            filler.inverse_depths()[i] = inverse_depth;
        }
        filler.fill(&mut frame);
        assert_eq!(frame.color[1], far);
        assert_eq!(
            (frame.coverage[1], frame.coverage[5]),
            (Coverage::FILLED, Coverage::HOLE)
        );
        assert!(
            frame.coverage[1].is_hole() && frame.coverage[1].splat_share() == 0,
            "a guess, and no sample"
        );
    }
}
