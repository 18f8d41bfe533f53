//! Pictures of regions: a texel for each face pixel, with skirts where a surface goes on as something else, cut into tiles.

use super::cost;
use super::regions::{Grower, NOBODY, Region};
use crate::packed::{PlaneSet, PlaneTile};

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

/// Of the eight pixels around one that no ray reached, how many must be of a region for it to be a gap in it.
const GAP_NEIGHBOURS: usize = 6;

/// Draws the regions of a face. What no tile is worth drawing gives its samples back to nobody.
pub(super) fn draw(grower: &mut Grower, first_plane: u32) -> Pictures {
    let mut pictures = Pictures::default();
    let regions = std::mem::take(&mut grower.regions);
    let mut drawn = Drawn::new(grower.face.size_px);
    let mut freed = Vec::new();
    for (id, region) in regions.iter().enumerate() {
        let painter = Painter { grower, region, id: id as u32 };
        let kept: Vec<Square> = painter.squares().into_iter().flat_map(|square| painter.choose(square).kept).collect();
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
struct Square {
    x: i32,
    y: i32,
    side: i32,
}

impl Square {
    fn quarters(&self) -> [Self; 4] {
        let side = self.side / 2;
        [(0, 0), (side, 0), (0, side), (side, side)].map(|(x, y)| Self { x: self.x + x, y: self.y + y, side })
    }
}

/// What is worth drawing of a square.
#[derive(Default)]
struct Choice {
    kept: Vec<Square>,
    /// What that saves, as [`cost::saved`] counts.
    saved: f64,
}

/// Which squares of a face are drawn of one region, by the least ones.
struct Drawn {
    /// Of each of the least squares, row by row, the last region.
    last: Vec<u32>,
    across: i32,
    region: u32,
}

impl Drawn {
    fn new(size_px: u32) -> Self {
        let across = (size_px as i32).div_euclid(LEAST_PX) + 1;
        Self { last: vec![0; (across * across) as usize], across, region: 0 }
    }

    /// Another region: nothing of it is drawn.
    fn begin(&mut self) {
        self.region += 1;
    }

    fn add(&mut self, square: &Square) {
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
        self.index(x, y).is_some_and(|at| self.last[at] == self.region)
    }

    /// A cell between four texels belongs to the tile of its upper left one. If that is not drawn, its neighbour draws the cell:
    /// by how many texels a tile begins further left and up.
    fn lacks_beside(&self, Square { x, y, side }: &Square) -> [i32; 2] {
        let along = || (0..*side).step_by(LEAST_PX as usize);
        [along().any(|k| !self.holds(x - 1, y + k)), along().any(|k| !self.holds(x + k, y - 1))].map(i32::from)
    }
}

/// A rectangle of texels.
struct Rectangle {
    x0: i32,
    y0: i32,
    width: u16,
    height: u16,
}

struct Painter<'a, 'b> {
    grower: &'a Grower<'b>,
    region: &'a Region,
    id: u32,
}

impl Painter<'_, '_> {
    fn size(&self) -> i32 {
        self.grower.face.size_px as i32
    }

    /// The largest squares that hold pixels of the region, in order.
    fn squares(&self) -> Vec<Square> {
        let mut squares = Vec::new();
        for &pixel in &self.region.pixels {
            let square = [pixel as i32 / self.size(), pixel as i32 % self.size()].map(|v| v / LARGEST_PX * LARGEST_PX);
            if squares.last() != Some(&square) {
                squares.push(square);
            }
        }
        squares.sort_unstable();
        squares.dedup();
        squares.into_iter().map(|[y, x]| Square { x, y, side: LARGEST_PX }).collect()
    }

    /// The tiles, of a square or of parts of it, that save most.
    fn choose(&self, square: Square) -> Choice {
        let samples = self.home_samples(&square).count();
        if samples == 0 {
            return Choice::default();
        }
        let saved = self.tile(&square, [0; 2]).and_then(|t| cost::saved(samples, t.width, t.height));
        let whole = saved.map_or(Choice::default(), |saved| Choice { kept: vec![square], saved });
        if square.side == LEAST_PX {
            return whole;
        }
        let mut parts = Choice::default();
        for quarter in square.quarters().map(|quarter| self.choose(quarter)) {
            parts.kept.extend(quarter.kept);
            parts.saved += quarter.saved;
        }
        if parts.saved > whole.saved { parts } else { whole }
    }

    /// The samples of the region in pixel (x, y), as indices.
    fn own(&self, x: i32, y: i32) -> impl Iterator<Item = usize> + use<'_> {
        let pixel = (y * self.size() + x) as usize;
        let inside = (0..self.size()).contains(&x) && (0..self.size()).contains(&y);
        let ends = if inside { &self.grower.face.offsets[pixel..pixel + 2] } else { &[0, 0] };
        (ends[0] as usize..ends[1] as usize).filter(|i| self.grower.owner[*i] == self.id)
    }

    /// The region's samples that lie in a square.
    fn home_samples(&self, square: &Square) -> impl Iterator<Item = usize> {
        let of = |start: i32| start..(start + square.side).min(self.size());
        let columns = of(square.x);
        of(square.y).flat_map(move |y| columns.clone().flat_map(move |x| self.own(x, y)))
    }

    /// The texels of a square that are of any use; the tile begins so many texels further left and up.
    fn tile(&self, square: &Square, more: [i32; 2]) -> Option<Rectangle> {
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
        let ([x0, x1], [y0, y1]) =
            ([(x0 - 1).max(left), (x1 + 1).min(right)], [(y0 - 1).max(top), (y1 + 1).min(bottom)]);
        (x1 > x0 && y1 > y0).then_some(Rectangle { x0, y0, width: (x1 - x0 + 1) as u16, height: (y1 - y0 + 1) as u16 })
    }

    fn paint(&self, at: &Rectangle, first_plane: u32, to: &mut Pictures) {
        let first_texel = to.texels.len();
        for y in at.y0..at.y0 + i32::from(at.height) {
            to.texels.extend((at.x0..at.x0 + i32::from(at.width)).map(|x| PlaneSet::covered(self.texel(x, y))));
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
            sum.iter_mut().zip(color).for_each(|(sum, c)| *sum += u32::from(c));
            (count, alpha) = (count + 1, alpha.saturating_add(color[3]));
        }
        if count == 0 {
            return None;
        }
        let [r, g, b] = sum.map(|sum| ((sum + count / 2) / count) as u8);
        Some([r, g, b, alpha])
    }

    fn texel(&self, x: i32, y: i32) -> [u8; 4] {
        self.member(x, y).unwrap_or_else(|| self.beyond(x, y))
    }

    /// What a picture has in a pixel that the region does not reach.
    ///
    /// Where something nearer hides it, it goes on by a pixel, so that no crack opens when the eye moves. Where it ends, or goes
    /// on as something else, its alpha falls as a tent's weight does: what lies beside it is added to it, as samples are.
    fn beyond(&self, x: i32, y: i32) -> [u8; 4] {
        let around = [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)];
        let (mut sum, mut count) = ([0u32; 4], 0);
        for color in around.into_iter().filter_map(|(dx, dy)| self.member(x + dx, y + dy)) {
            sum.iter_mut().zip(color).for_each(|(sum, c)| *sum += u32::from(c));
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
        let q = self.region.affine.inverse_depth(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let hides = q + (q * self.grower.one_surface).max(self.grower.bin);
        let pixel = self.grower.face.pixel(x as u32, y as u32);
        let is_hidden = pixel.iter().any(|sample| f64::from(sample.inverse_depth) > hides);
        let is_gap = pixel.is_empty() && count as usize >= GAP_NEIGHBOURS;
        [r, g, b, if is_hidden || is_gap { 255 } else { 0 }]
    }
}
