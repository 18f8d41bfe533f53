//! Pictures of regions: a texel for each face pixel, sharpened against the blur of lookups between
//! texels, cut into tiles.

use super::regions::{Grower, NOBODY, Region};
use crate::pack::{PlaneSet, PlaneTile};
use crate::planes::cost;

/// Face pixels a side of the largest tiles, and of the smallest into which these are cut.
const LARGEST_PX: i32 = 128;
const LEAST_PX: i32 = 64;

/// The pictures of a face.
#[derive(Default)]
pub(super) struct Pictures {
    pub(super) tiles: Vec<PlaneTile>,
    pub(super) texels: Vec<[u8; 4]>,
    /// Samples that they stand for.
    pub(super) samples: u64,
}

/// Number of the eight pixels around one without rays that must belong to a region for it to be a
/// gap in it.
const GAP_NEIGHBOURS: usize = 6;

/// Draws the regions of a face. What no tile is worth drawing gives its samples back to nobody.
pub(super) fn draw(grower: &mut Grower, first_plane: u32) -> Pictures {
    let mut pictures = Pictures::default();
    let regions = std::mem::take(&mut grower.regions);
    let mut drawn = TileCover::new(grower.face.size_px);
    let mut freed = Vec::new();
    for (id, region) in regions.iter().enumerate() {
        let painter = TexturePainter {
            grower,
            region,
            id: id as u32,
        };
        let kept: Vec<TextureTile> = painter
            .squares()
            .into_iter()
            .flat_map(|square| painter.choose(square).kept)
            .collect();
        drawn.begin();
        kept.iter().for_each(|square| drawn.add(square));
        for square in &kept {
            if let Some(rectangle) = painter.tile(square, drawn.lacks_beside(square)) {
                painter.paint(&rectangle, first_plane, &mut pictures);
            }
        }
        for &pixel in &region.pixels {
            let [x, y] = [pixel as i32 % painter.size(), pixel as i32 / painter.size()];
            match drawn.holds(x, y) {
                true => pictures.samples += painter.own(x, y).count() as u64,
                false => freed.extend(painter.own(x, y)),
            }
        }
    }
    for i in freed {
        grower.owner[i] = NOBODY;
    }
    grower.regions = regions;
    pictures
}

/// A square of face pixels, of which a tile may be.
#[derive(Clone, Copy)]
struct TextureTile {
    x: i32,
    y: i32,
    side: i32,
}

impl TextureTile {
    fn quarters(&self) -> [Self; 4] {
        let side = self.side / 2;
        [(0, 0), (side, 0), (0, side), (side, side)].map(|(x, y)| Self {
            x: self.x + x,
            y: self.y + y,
            side,
        })
    }
}

/// Squares worth drawing as textures.
#[derive(Default)]
struct TileSelection {
    kept: Vec<TextureTile>,
    /// Savings, as computed by [`cost::saved`].
    saved: f64,
}

/// Squares of a face drawn by one region, in units of the smallest squares.
struct TileCover {
    /// Last region of each of the smallest squares, row by row.
    last: Vec<u32>,
    across: i32,
    region: u32,
}

impl TileCover {
    fn new(size_px: u32) -> Self {
        let across = (size_px as i32).div_euclid(LEAST_PX) + 1;
        Self {
            last: vec![0; (across * across) as usize],
            across,
            region: 0,
        }
    }

    /// Another region: nothing of it is drawn.
    fn begin(&mut self) {
        self.region += 1;
    }

    fn add(&mut self, square: &TextureTile) {
        for y in (square.y..square.y + square.side).step_by(LEAST_PX as usize) {
            for x in (square.x..square.x + square.side).step_by(LEAST_PX as usize) {
                if let Some(at) = self.index(x, y) {
                    self.last[at] = self.region;
                }
            }
        }
    }

    fn index(&self, x: i32, y: i32) -> Option<usize> {
        let [column, row] = [x, y].map(|v| v.div_euclid(LEAST_PX));
        let inside = |v: i32| (0..self.across).contains(&v);
        (inside(column) && inside(row)).then(|| (row * self.across + column) as usize)
    }

    fn holds(&self, x: i32, y: i32) -> bool {
        self.index(x, y)
            .is_some_and(|at| self.last[at] == self.region)
    }

    /// A cell between four texels belongs to the tile of its upper left one. If that is not drawn,
    /// its neighbour draws the cell: by how many texels a tile begins further left and up.
    fn lacks_beside(&self, TextureTile { x, y, side }: &TextureTile) -> [i32; 2] {
        let along = || (0..*side).step_by(LEAST_PX as usize);
        [
            along().any(|k| !self.holds(x - 1, y + k)),
            along().any(|k| !self.holds(x + k, y - 1)),
        ]
        .map(i32::from)
    }
}

/// A rectangle of texels.
struct Rectangle {
    x0: i32,
    y0: i32,
    width: u16,
    height: u16,
}

struct TexturePainter<'a, 'b> {
    grower: &'a Grower<'b>,
    region: &'a Region,
    id: u32,
}

impl TexturePainter<'_, '_> {
    fn size(&self) -> i32 {
        self.grower.face.size_px as i32
    }

    /// The largest squares that hold pixels of the region, in order.
    fn squares(&self) -> Vec<TextureTile> {
        let mut squares = Vec::new();
        for &pixel in &self.region.pixels {
            let square = [pixel as i32 / self.size(), pixel as i32 % self.size()]
                .map(|v| v / LARGEST_PX * LARGEST_PX);
            if squares.last() != Some(&square) {
                squares.push(square);
            }
        }
        squares.sort_unstable();
        squares.dedup();
        squares
            .into_iter()
            .map(|[y, x]| TextureTile {
                x,
                y,
                side: LARGEST_PX,
            })
            .collect()
    }

    /// The tiles, of a square or of parts of it, that save most.
    fn choose(&self, square: TextureTile) -> TileSelection {
        let samples = self.home_samples(&square).count();
        if samples == 0 {
            return TileSelection::default();
        }
        let saved = self
            .tile(&square, [0; 2])
            .and_then(|t| cost::saved(samples, t.width, t.height));
        let whole = saved.map_or(TileSelection::default(), |saved| TileSelection {
            kept: vec![square],
            saved,
        });
        if square.side == LEAST_PX {
            return whole;
        }
        let mut parts = TileSelection::default();
        for quarter in square.quarters().map(|quarter| self.choose(quarter)) {
            parts.kept.extend(quarter.kept);
            parts.saved += quarter.saved;
        }
        if parts.saved > whole.saved {
            parts
        } else {
            whole
        }
    }

    /// The samples of the region in pixel (x, y), as indices.
    fn own(&self, x: i32, y: i32) -> impl Iterator<Item = usize> + use<'_> {
        let pixel = (y * self.size() + x) as usize;
        let inside = (0..self.size()).contains(&x) && (0..self.size()).contains(&y);
        let ends = if inside {
            &self.grower.face.offsets[pixel..pixel + 2]
        } else {
            &[0, 0]
        };
        (ends[0] as usize..ends[1] as usize).filter(|i| self.grower.owner[*i] == self.id)
    }

    /// The region's samples that lie in a square.
    fn home_samples(&self, square: &TextureTile) -> impl Iterator<Item = usize> {
        let of = |start: i32| start..(start + square.side).min(self.size());
        let columns = of(square.x);
        of(square.y).flat_map(move |y| columns.clone().flat_map(move |x| self.own(x, y)))
    }

    /// The texels of a square that are of any use; the tile begins so many texels further left and
    /// up.
    fn tile(&self, square: &TextureTile, more: [i32; 2]) -> Option<Rectangle> {
        let of = |start: i32, more: i32| [start - more, (start + square.side).min(self.size())];
        let ([left, right], [top, bottom]) = (of(square.x, more[0]), of(square.y, more[1]));
        let mut bounds: Option<[i32; 4]> = None;
        for y in top - 1..=bottom + 1 {
            for x in left - 1..=right + 1 {
                if self.own(x, y).next().is_some() {
                    let [x0, y0, x1, y1] = bounds.unwrap_or([x, y, x, y]);
                    bounds = Some([x0.min(x), y0.min(y), x1.max(x), y1.max(y)]);
                }
            }
        }
        let [x0, y0, x1, y1] = bounds?;
        let ([x0, x1], [y0, y1]) = (
            [(x0 - 1).max(left), (x1 + 1).min(right)],
            [(y0 - 1).max(top), (y1 + 1).min(bottom)],
        );
        (x1 > x0 && y1 > y0).then_some(Rectangle {
            x0,
            y0,
            width: (x1 - x0 + 1) as u16,
            height: (y1 - y0 + 1) as u16,
        })
    }

    fn paint(&self, at: &Rectangle, first_plane: u32, to: &mut Pictures) {
        let first_texel = to.texels.len();
        let (columns, rows) = (i32::from(at.width), i32::from(at.height));
        let columns_and_beside = at.x0 - 1..=at.x0 + columns;
        let means: Vec<_> = (at.y0 - 1..=at.y0 + rows)
            .flat_map(|y| columns_and_beside.clone().map(move |x| self.member(x, y)))
            .collect();
        for (y, three) in (at.y0..).zip(
            means
                .chunks_exact(columns as usize + 2)
                .collect::<Vec<_>>()
                .windows(3),
        ) {
            for (x, i) in (at.x0..at.x0 + columns).zip(1..) {
                let [above, here, below] =
                    [three[0], three[1], three[2]].map(|row| [row[i - 1], row[i], row[i + 1]]);
                let texel = match here[1] {
                    Some(own) => sharpened(own, [here[0], here[2], above[1], below[1]]),
                    None => self.beyond(x, y, [above, here, below].as_flattened()),
                };
                to.texels.push(PlaneSet::covered(texel));
            }
        }
        to.tiles.push(PlaneTile {
            plane: first_plane + self.id,
            first_texel: first_texel as u32,
            x0: at.x0 as i16,
            y0: at.y0 as i16,
            width: at.width,
            height: at.height,
            face: self.grower.face.face.index() as u16,
            opaque: u16::from(to.texels[first_texel..].iter().all(|t| t[3] == 255)),
        });
    }

    /// The colour of the region in a pixel, if it is there.
    fn member(&self, x: i32, y: i32) -> Option<[u8; 4]> {
        let (mut sum, mut count, mut alpha) = ([0u32; 3], 0, 0u8);
        for i in self.own(x, y) {
            let color = self.grower.face.samples[i].color_srgb;
            sum.iter_mut()
                .zip(color)
                .for_each(|(sum, c)| *sum += u32::from(c));
            (count, alpha) = (count + 1, alpha.saturating_add(color[3]));
        }
        if count == 0 {
            return None;
        }
        let [r, g, b] = sum.map(|sum| ((sum + count / 2) / count) as u8);
        Some([r, g, b, alpha])
    }

    /// Texel in a pixel that the region does not reach, extrapolated from the region's colours
    /// there and in the eight pixels around it.
    ///
    /// In a gap it goes on. Where it ends, goes on as something else, or is hidden from everywhere,
    /// its alpha falls as a tent's weight does: what lies beside it is added to it, as samples are.
    fn beyond(&self, x: i32, y: i32, around: &[Option<[u8; 4]>]) -> [u8; 4] {
        let (mut sum, mut count) = ([0u32; 4], 0);
        for color in around.iter().flatten() {
            sum.iter_mut()
                .zip(color)
                .for_each(|(sum, c)| *sum += u32::from(*c));
            count += 1;
        }
        if count == 0 {
            return [0; 4];
        }
        let [r, g, b, alpha] = sum.map(|sum| ((sum + count / 2) / count) as u8);
        let inside = (0..self.size()).contains(&x) && (0..self.size()).contains(&y);
        if !inside {
            return [r, g, b, alpha];
        }
        let is_gap = self.grower.face.pixel(x as u32, y as u32).is_empty()
            && count as usize >= GAP_NEIGHBOURS;
        [r, g, b, if is_gap { 255 } else { 0 }]
    }
}

/// The texel of a pixel, from its mean and those of the pixels left, right, above and below it, as
/// far as they are of the region.
///
/// A lookup between texels is a tent, which blurs by a variance of a sixth of a texel along each
/// axis. A twelfth of what tells a texel from each of its neighbours would take that away (Condat,
/// Blu and Unser 2005, "Beyond interpolation: optimal reconstruction by quasi-interpolation"). Half
/// of it is taken: all of it makes more of the noise of fine textures than it sharpens others
/// (docs/primitives.md, "Texels").
fn sharpened(own: [u8; 4], beside: [Option<[u8; 4]>; 4]) -> [u8; 4] {
    const PART: i32 = 24;
    let mut sums = own.map(|c| PART * i32::from(c));
    for other in beside.iter().flatten() {
        for c in 0..3 {
            sums[c] += i32::from(own[c]) - i32::from(other[c]);
        }
    }
    sums.map(|sum| (sum + PART / 2).div_euclid(PART).clamp(0, 255) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(level: u8) -> [u8; 4] {
        [level, level, level, 255]
    }

    #[test]
    fn sharpening_keeps_ramps_and_borders() {
        let ramp = [110, 90, 80, 120].map(|level| Some(grey(level)));
        assert_eq!(sharpened(grey(100), ramp), grey(100));
        assert_eq!(sharpened(grey(100), [None; 4]), grey(100));
        let [one, other] = [[40, 200, 255, 9], [160, 80, 0, 255]];
        // A 24th of 120 and of 255 away from each neighbour, as far as bytes go; alpha stays.
        assert_eq!(
            sharpened(one, [Some(other), None, None, None]),
            [35, 205, 255, 9]
        );
        assert_eq!(sharpened(other, [Some(one); 4]), [180, 60, 0, 255]);
    }
}
