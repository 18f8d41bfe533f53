//! Textures of regions: one texel for each face pixel, sharpened against the blur of bilinear
//! lookups, divided into tiles.

use super::regions::{Grower, NO_REGION, Region};
use crate::model::samples::DepthPixel;
use crate::pack::{PlaneSet, PlaneTile};
use crate::planes::cost;
use std::collections::BTreeSet;

/// Side of the largest squares, face pixels.
const MAX_SQUARE_PX: i32 = 128;

/// Side of the smallest squares into which larger ones are divided, face pixels.
const MIN_SQUARE_PX: i32 = 64;

/// The plane textures of a face.
#[derive(Default)]
pub(super) struct FaceTextures {
    pub(super) tiles: Vec<PlaneTile>,
    pub(super) texels: Vec<[u8; 4]>,
    /// Number of samples that the tiles replace.
    pub(super) samples: u64,
}

/// Minimum number of neighbours in a region of an empty pixel that is filled as a gap in the
/// region.
const GAP_NEIGHBOURS: u32 = 6;

/// Minimum ratio of the inverse depths of a sample and a plane that frames never blend. Their
/// tolerance for one surface is 2.2 % for faces of 1024 px, and larger for smaller ones.
const APART: f64 = 1.05;

/// Draws the tiles of the regions of a face, and unassigns the samples outside all tiles.
pub(super) fn draw(grower: &mut Grower) -> FaceTextures {
    let mut textures = FaceTextures::default();
    let regions = std::mem::take(&mut grower.regions);
    let mut drawn = SquareMask::new(grower.face.size_px);
    let mut freed = Vec::new();
    for (id, region) in regions.iter().enumerate() {
        let painter = TexturePainter {
            grower,
            region,
            id: id as u32,
        };
        let selected: Vec<Square> = painter
            .squares()
            .into_iter()
            .flat_map(|square| painter.select(square).squares)
            .collect();
        drawn.clear();
        selected.iter().for_each(|square| drawn.add(square));
        for square in &selected {
            if let Some(bounds) = painter.texel_bounds(square, drawn.overlap(square)) {
                painter.paint(&bounds, &mut textures);
            }
        }
        for &pixel in &region.pixels {
            let [x, y] = [pixel as i32 % painter.size(), pixel as i32 / painter.size()];
            if drawn.contains(x, y) {
                textures.samples += painter.samples(x, y).count() as u64;
            } else {
                freed.extend(painter.samples(x, y));
            }
        }
    }
    for i in freed {
        grower.owner[i] = NO_REGION;
    }
    grower.regions = regions;
    textures
}

/// A square of face pixels that may become a tile.
#[derive(Clone, Copy)]
struct Square {
    x: i32,
    y: i32,
    side: i32,
}

impl Square {
    fn quarters(&self) -> [Self; 4] {
        let side = self.side / 2;
        [(0, 0), (side, 0), (0, side), (side, side)].map(|(x, y)| Self {
            x: self.x + x,
            y: self.y + y,
            side,
        })
    }
}

/// Squares that are worth drawing as textures.
#[derive(Default)]
struct Selection {
    squares: Vec<Square>,
    /// Sum of [`cost::savings`].
    savings: f64,
}

/// Set of squares of a face, in units of the smallest squares.
struct SquareMask {
    is_set: Vec<bool>,
    /// Smallest squares along a side of the face.
    width: i32,
}

impl SquareMask {
    fn new(size_px: u32) -> Self {
        let width = (size_px as i32).div_euclid(MIN_SQUARE_PX) + 1;
        Self {
            is_set: vec![false; (width * width) as usize],
            width,
        }
    }

    fn clear(&mut self) {
        self.is_set.fill(false);
    }

    fn add(&mut self, square: &Square) {
        for y in (square.y..square.y + square.side).step_by(MIN_SQUARE_PX as usize) {
            for x in (square.x..square.x + square.side).step_by(MIN_SQUARE_PX as usize) {
                if let Some(i) = self.index(x, y) {
                    self.is_set[i] = true;
                }
            }
        }
    }

    fn index(&self, x: i32, y: i32) -> Option<usize> {
        let [column, row] = [x, y].map(|v| v.div_euclid(MIN_SQUARE_PX));
        let inside = |v: i32| (0..self.width).contains(&v);
        (inside(column) && inside(row)).then(|| (row * self.width + column) as usize)
    }

    fn contains(&self, x: i32, y: i32) -> bool {
        self.index(x, y).is_some_and(|i| self.is_set[i])
    }

    /// Returns the number of texels by which a tile starts further left and further up. The cell
    /// between four texels belongs to the tile of its upper left texel; if that tile is not drawn,
    /// its neighbour draws the cell.
    fn overlap(&self, Square { x, y, side }: &Square) -> [i32; 2] {
        let steps = || (0..*side).step_by(MIN_SQUARE_PX as usize);
        [
            steps().any(|k| !self.contains(x - 1, y + k)),
            steps().any(|k| !self.contains(x + k, y - 1)),
        ]
        .map(i32::from)
    }
}

/// A rectangle of texels.
struct TexelBounds {
    x0: i32,
    y0: i32,
    width: u16,
    height: u16,
}

/// Drawing of the tiles of one region.
struct TexturePainter<'a, 'b> {
    grower: &'a Grower<'b>,
    region: &'a Region,
    /// Index of the region, and of its plane.
    id: u32,
}

impl TexturePainter<'_, '_> {
    fn size(&self) -> i32 {
        self.grower.face.size_px as i32
    }

    /// Finds the largest squares with pixels of the region, in row-major order.
    fn squares(&self) -> Vec<Square> {
        let corner = |&pixel: &u32| {
            [pixel as i32 / self.size(), pixel as i32 % self.size()]
                .map(|v| v / MAX_SQUARE_PX * MAX_SQUARE_PX)
        };
        let corners: BTreeSet<[i32; 2]> = self.region.pixels.iter().map(corner).collect();
        let side = MAX_SQUARE_PX;
        corners
            .into_iter()
            .map(|[y, x]| Square { x, y, side })
            .collect()
    }

    /// Selects a square or parts of it, by the largest savings.
    fn select(&self, square: Square) -> Selection {
        let samples = self.count_samples(&square);
        if samples == 0 {
            return Selection::default();
        }
        let savings = self
            .texel_bounds(&square, [0; 2])
            .and_then(|bounds| cost::savings(samples, bounds.width, bounds.height));
        let whole = savings.map_or(Selection::default(), |savings| Selection {
            squares: vec![square],
            savings,
        });
        if square.side == MIN_SQUARE_PX {
            return whole;
        }
        let mut parts = Selection::default();
        for quarter in square.quarters().map(|quarter| self.select(quarter)) {
            parts.squares.extend(quarter.squares);
            parts.savings += quarter.savings;
        }
        if parts.savings > whole.savings {
            parts
        } else {
            whole
        }
    }

    /// Returns the indices of the region's samples in pixel (x, y).
    fn samples(&self, x: i32, y: i32) -> impl Iterator<Item = usize> + use<'_> {
        let pixel = (y * self.size() + x) as usize;
        let inside = (0..self.size()).contains(&x) && (0..self.size()).contains(&y);
        let ends = if inside {
            &self.grower.face.offsets[pixel..pixel + 2]
        } else {
            &[0, 0]
        };
        (ends[0] as usize..ends[1] as usize).filter(|i| self.grower.owner[*i] == self.id)
    }

    /// Counts the region's samples in a square.
    fn count_samples(&self, square: &Square) -> usize {
        let range = |start: i32| start..(start + square.side).min(self.size());
        let pixels = range(square.y).flat_map(|y| range(square.x).map(move |x| (x, y)));
        pixels.map(|(x, y)| self.samples(x, y).count()).sum()
    }

    /// Returns the bounds of the texels of a square that affect the frame; `overlap` is from
    /// [`SquareMask::overlap`].
    fn texel_bounds(&self, square: &Square, overlap: [i32; 2]) -> Option<TexelBounds> {
        let ends =
            |start: i32, overlap: i32| [start - overlap, (start + square.side).min(self.size())];
        let [left, right] = ends(square.x, overlap[0]);
        let [top, bottom] = ends(square.y, overlap[1]);
        let mut bounds: Option<[i32; 4]> = None;
        for y in top - 1..=bottom + 1 {
            for x in left - 1..=right + 1 {
                if self.samples(x, y).next().is_some() {
                    let [x0, y0, x1, y1] = bounds.unwrap_or([x, y, x, y]);
                    bounds = Some([x0.min(x), y0.min(y), x1.max(x), y1.max(y)]);
                }
            }
        }
        let [x0, y0, x1, y1] = bounds?;
        let [x0, x1] = [(x0 - 1).max(left), (x1 + 1).min(right)];
        let [y0, y1] = [(y0 - 1).max(top), (y1 + 1).min(bottom)];
        (x1 > x0 && y1 > y0).then_some(TexelBounds {
            x0,
            y0,
            width: (x1 - x0 + 1) as u16,
            height: (y1 - y0 + 1) as u16,
        })
    }

    /// Appends a tile and its texels.
    fn paint(&self, bounds: &TexelBounds, textures: &mut FaceTextures) {
        let first_texel = textures.texels.len();
        let (columns, rows) = (i32::from(bounds.width), i32::from(bounds.height));
        // With a border of one pixel.
        let means: Vec<Vec<_>> = (bounds.y0 - 1..=bounds.y0 + rows)
            .map(|y| {
                (bounds.x0 - 1..=bounds.x0 + columns)
                    .map(|x| self.mean_color(x, y))
                    .collect()
            })
            .collect();
        for (y, three) in (bounds.y0..).zip(means.windows(3)) {
            for (x, i) in (bounds.x0..bounds.x0 + columns).zip(1..) {
                let [above, here, below] =
                    [0, 1, 2].map(|row| [three[row][i - 1], three[row][i], three[row][i + 1]]);
                let texel = match here[1] {
                    Some(own) => sharpen(own, [here[0], here[2], above[1], below[1]]),
                    None => self.extrapolate(x, y, [above, here, below].as_flattened()),
                };
                textures.texels.push(PlaneSet::covered(texel));
            }
        }
        let is_opaque = textures.texels[first_texel..].iter().all(|t| t[3] == 255);
        textures.tiles.push(PlaneTile {
            plane: self.id,
            first_texel: first_texel as u32,
            x0: bounds.x0 as i16,
            y0: bounds.y0 as i16,
            width: bounds.width,
            height: bounds.height,
            face: self.grower.face.face.index() as u16,
            opaque: u16::from(is_opaque),
        });
    }

    /// Averages the region's samples in a pixel; `None` if there are none.
    fn mean_color(&self, x: i32, y: i32) -> Option<[u8; 4]> {
        let (mut sum, mut count, mut alpha) = ([0u32; 3], 0, 0u8);
        for i in self.samples(x, y) {
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

    /// Extrapolates the texel of a pixel outside the region from the region's colours in the eight
    /// pixels `around` it.
    ///
    /// In a gap of an opaque region the texel is opaque, and outside the face it has the mean alpha.
    /// It is opaque, too, behind occluders that frames never blend with the region: they hide it,
    /// and no crack opens beside them for other eyes. Behind occluders close to it, such as the
    /// other wall at a corner of a room, and where another facet continues it, it is opaque in their
    /// colour, so that blending with it changes nothing (docs/decisions/0084, 0088). At other borders
    /// it is transparent, so that the bilinear alpha falls like the weight of a tent, and adjacent
    /// surfaces are accumulated as with samples. It is transparent in a gap among partly covered
    /// pixels: of leaves or a fence, where all rays have passed.
    fn extrapolate(&self, x: i32, y: i32, around: &[Option<[u8; 4]>]) -> [u8; 4] {
        let (mut sum, mut count, mut is_opaque) = ([0u32; 4], 0, true);
        for color in around.iter().flatten() {
            sum.iter_mut()
                .zip(color)
                .for_each(|(sum, c)| *sum += u32::from(*c));
            count += 1;
            is_opaque &= color[3] == 255;
        }
        if count == 0 {
            return [0; 4];
        }
        let [r, g, b, alpha] = sum.map(|sum| ((sum + count / 2) / count) as u8);
        let is_on_face = (0..self.size()).contains(&x) && (0..self.size()).contains(&y);
        if !is_on_face {
            return [r, g, b, alpha];
        }
        let is_empty = self.grower.face.pixel(x as u32, y as u32).is_empty();
        let continues = if is_empty {
            count >= GAP_NEIGHBOURS
        } else {
            self.is_occluded(x, y)
        };
        let color = match is_opaque {
            false => None,
            true if continues => Some([r, g, b]),
            true => self.color_blended(x, y),
        };
        let alpha = if color.is_some() { 255 } else { 0 };
        let [r, g, b] = color.unwrap_or([r, g, b]);
        [r, g, b, alpha]
    }

    /// Returns the colour of what frames blend with the region's plane in a pixel, if it is opaque:
    /// what is close in front of the plane, or continues it smoothly.
    fn color_blended(&self, x: i32, y: i32) -> Option<[u8; 3]> {
        let in_front = self.plane_at(x, y)..=self.far_in_front(x, y);
        let is_blended = |sample: &&DepthPixel| {
            in_front.contains(&f64::from(sample.inverse_depth))
                || self.is_continued_by(sample, x, y)
        };
        let mut samples = self.grower.face.pixel(x as u32, y as u32).iter();
        let [r, g, b, alpha] = samples.rfind(is_blended)?.color_srgb;
        (alpha == 255).then_some([r, g, b])
    }

    /// Returns true if a sample of pixel (x, y) continues the region's plane smoothly, as the next
    /// facet of a curved surface does. At the outer edge of a box, the texture would grow over what
    /// is behind the box.
    fn is_continued_by(&self, sample: &DepthPixel, x: i32, y: i32) -> bool {
        /// Maximum distance from the plane, bins: each primitive may be off by half a bin.
        const MAX_BINS: f64 = 1.5;
        /// Minimum cosine of the angle between the normals: 45 degrees.
        const MIN_COS: f32 = 0.707;
        let distance = (self.plane_at(x, y) - f64::from(sample.inverse_depth)).abs();
        let normal = self.region.plane.normal_per_distance.normalize_or_zero();
        distance <= MAX_BINS * self.grower.bin
            && normal.dot(sample.normal.decode()).abs() >= MIN_COS
    }

    /// Inverse depth of the region's plane at the middle of a pixel, 1/m.
    fn plane_at(&self, x: i32, y: i32) -> f64 {
        let [x, y] = [x, y].map(|v| f64::from(v) + 0.5);
        self.region.affine.inverse_depth(x, y)
    }

    /// Inverse depth from which a sample is so far in front of the region's plane that no frame
    /// blends it with the plane, 1/m.
    fn far_in_front(&self, x: i32, y: i32) -> f64 {
        APART * self.plane_at(x, y).max(0.0) + 2.0 * self.grower.bin
    }

    /// Returns true if all samples of a pixel are far in front of the region's plane.
    fn is_occluded(&self, x: i32, y: i32) -> bool {
        let in_front = self.far_in_front(x, y);
        let samples = self.grower.face.pixel(x as u32, y as u32);
        let is_in_front = |sample: &DepthPixel| f64::from(sample.inverse_depth) > in_front;
        samples.iter().all(is_in_front)
    }
}

/// Computes the texel of a pixel from its mean colour and those of its four neighbours, if they
/// belong to the region.
///
/// A bilinear lookup is a tent, which blurs by a variance of a sixth of a texel along each axis.
/// Adding a twelfth of the difference to each neighbour would compensate this (Condat, Blu and
/// Unser 2005, "Beyond interpolation: optimal reconstruction by quasi-interpolation"). Only half of
/// it is added: all of it amplifies the noise of fine textures more than it sharpens others
/// (docs/primitives.md, "Texels").
fn sharpen(own: [u8; 4], neighbours: [Option<[u8; 4]>; 4]) -> [u8; 4] {
    const PART: i32 = 24;
    let mut sums = own.map(|c| PART * i32::from(c));
    for other in neighbours.iter().flatten() {
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
        assert_eq!(sharpen(grey(100), ramp), grey(100));
        assert_eq!(sharpen(grey(100), [None; 4]), grey(100));
        let [one, other] = [[40, 200, 255, 9], [160, 80, 0, 255]];
        // A 24th of 120 and of 255 away from each neighbour, as far as bytes go; alpha stays.
        assert_eq!(
            sharpen(one, [Some(other), None, None, None]),
            [35, 205, 255, 9]
        );
        assert_eq!(sharpen(other, [Some(one); 4]), [180, 60, 0, 255]);
    }
}
