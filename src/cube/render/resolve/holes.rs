//! Filling of small holes in a finished frame from the pixels around them (S9, like the gaps of
//! sprites).
//!
//! A disocclusion uncovers the background: a hole therefore takes the colour of the farthest of its
//! four adjacent pixels, step by step from its rim, up to [`STEPS`] pixels. Environment pixels are
//! not filled: an isolated speck of sky between leaves is not noticeable. Filled pixels are marked
//! ([`Coverage::FILLED`]) and count as holes in all measurements.

use crate::render::setup::clip::Band;
use headbox_core::frame::{Coverage, Frame};

/// Pixels filled from each side of a hole: gaps of slightly more than three pixels are closed.
const STEPS: usize = 2;

/// Pixels that are searched for holes at once.
const CHUNK: usize = 32;

/// Hole filling; its buffers are reused from frame to frame.
#[derive(Default)]
pub struct HoleFiller {
    /// 1 / eye depth of pixels, 1/m, 0 where there is no surface. Undefined far from holes.
    inverse_depths: Vec<f32>,
    holes: Vec<usize>,
    fills: Vec<(usize, Surface)>,
}

/// Colour and depth of a pixel.
#[derive(Clone, Copy)]
struct Surface {
    color: [u8; 4],
    inverse_depth: f32,
}

impl HoleFiller {
    /// Allocates a frame of `pixels` pixels.
    pub fn prepare(&mut self, pixels: usize) {
        self.inverse_depths.resize(pixels, 0.0);
    }

    /// Returns the inverse depths of the frame, to be written by its renderer.
    pub fn inverse_depths(&mut self) -> &mut [f32] {
        &mut self.inverse_depths
    }

    /// Fills the small holes of a frame.
    pub fn fill(&mut self, frame: &mut Frame) {
        let width = frame.width as usize;
        self.holes.clear();
        for (i, chunk) in frame.coverage.chunks(CHUNK).enumerate() {
            // A minimum is vectorised by the compiler.
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
            let mut fills = std::mem::take(&mut self.fills);
            fills.clear();
            fills.extend(
                self.holes
                    .iter()
                    .filter_map(|&i| Some((i, self.farthest_adjacent(frame, i, width)?))),
            );
            for &(i, surface) in &fills {
                frame.color[i] = surface.color;
                frame.coverage[i] = Coverage::FILLED;
                self.inverse_depths[i] = surface.inverse_depth;
            }
            self.fills = fills;
            self.holes.retain(|&i| frame.coverage[i] == Coverage::HOLE);
        }
    }

    /// Returns the farthest of the four pixels adjacent to a pixel; of equally far ones the first:
    /// left, right, above, below.
    fn farthest_adjacent(&self, frame: &Frame, i: usize, width: usize) -> Option<Surface> {
        let column = i % width;
        let adjacent = [
            (column > 0).then(|| i - 1),
            (column + 1 < width).then_some(i + 1),
            i.checked_sub(width),
            Some(i + width).filter(|&below| below < frame.color.len()),
        ];
        let known = adjacent
            .into_iter()
            .flatten()
            .filter(|&j| frame.coverage[j] != Coverage::HOLE);
        let surfaces = known.map(|j| {
            let is_environment = frame.coverage[j] == Coverage::ENVIRONMENT;
            Surface {
                color: frame.color[j],
                inverse_depth: if is_environment {
                    0.0
                } else {
                    self.inverse_depths[j]
                },
            }
        });
        surfaces.min_by(|a, b| a.inverse_depth.total_cmp(&b.inverse_depth))
    }
}

/// Reads the inverse depths of those rows of a band that filling may use, for its own holes or
/// those of adjacent bands: `read` writes a row, counted from the band's first. Does nothing if
/// `inverse_depths` is empty.
pub(crate) fn read_depths_near_holes(
    inverse_depths: &mut [f32],
    band: &Band,
    has_holes: bool,
    read: impl Fn(usize, &mut [f32]),
) {
    let last = band.rows.len();
    for (row, to) in inverse_depths
        .chunks_mut(band.width.max(1) as usize)
        .enumerate()
    {
        if has_holes || row < STEPS || row + STEPS >= last {
            read(row, to);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use headbox_core::random::Rng;

    /// Fills a whole image per step.
    fn fill_reference(frame: &Frame, inverse_depths: &[f32]) -> Frame {
        let width = i64::from(frame.width);
        let height = i64::from(frame.height);
        let mut frame = frame.clone();
        let mut depths = inverse_depths.to_vec();
        for _ in 0..STEPS {
            let before = frame.clone();
            let depths_before = depths.clone();
            for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
                let i = (y * width + x) as usize;
                let mut farthest = f32::INFINITY;
                for (dx, dy) in [(-1, 0), (1, 0), (0, -1), (0, 1)] {
                    let nx = x + dx;
                    let ny = y + dy;
                    if before.coverage[i] != Coverage::HOLE
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
                        frame.color[i] = before.color[n];
                        frame.coverage[i] = Coverage::FILLED;
                        depths[i] = depth;
                    }
                }
            }
        }
        frame
    }

    #[test]
    fn filling_matches_reference() {
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
            let expected = fill_reference(&frame, &inverse_depths);
            let mut filler = HoleFiller {
                inverse_depths,
                ..HoleFiller::default()
            };
            filler.fill(&mut frame);
            assert!(frame == expected, "{width}x{height}, {hole_share} %");
        }
    }

    #[test]
    fn bands_read_depths_of_rows_near_holes() {
        let read_depths = |has_holes: bool, rows: u32, pixels: usize| {
            let mut depths = vec![0.0; pixels];
            let band = Band {
                width: 3,
                height: 20,
                principal_px: [0.0; 2],
                rows: 4..4 + rows,
            };
            read_depths_near_holes(&mut depths, &band, has_holes, |row, to| {
                to.fill(1.0 + row as f32);
            });
            depths
        };
        let three = |rows: [usize; 7]| rows.map(|row| [row as f32; 3]).concat();
        assert_eq!(
            read_depths(false, 7, 21),
            three([1, 2, 0, 0, 0, 6, 7]),
            "two rows at either border"
        );
        assert_eq!(read_depths(true, 7, 21), three([1, 2, 3, 4, 5, 6, 7]));
        assert!(read_depths(true, 7, 0).is_empty());
        assert_eq!(read_depths(false, 1, 3), [1.0; 3]);
    }

    #[test]
    fn small_hole_is_filled_and_large_hole_stays() {
        let mut frame = Frame::default();
        frame.reset(9, 1, [0; 3]);
        let mut filler = HoleFiller::default();
        filler.prepare(9);
        let near = [200, 0, 0, 255];
        let far = [0, 0, 200, 255];
        for (i, color, inverse_depth) in [(0, near, 2.0), (2, far, 0.1), (8, near, 2.0)] {
            frame.color[i] = color;
            frame.coverage[i] = Coverage::FULL;
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
            "filled, not covered by a splat"
        );
    }
}
