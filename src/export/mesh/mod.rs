//! Captures as textured quadrilaterals: plane textures, and sheets of samples that are split until
//! a plane fits them.

mod atlas;
pub mod glb;
pub(crate) mod glb_file;
mod resample;
mod sheets;

use crate::mesh::atlas::AtlasPicture;
use crate::mesh::sheets::{SHEET_COLUMNS, SHEET_ROWS, SurfaceSheet};
use crate::points::surfels::straight;
use glam::{DMat3, DVec3, dvec3};
use headbox_core::cube_face::Face;
use headbox_cube::pack::CubeLdi;
use rayon::prelude::*;

/// Width, pixels, by which a quadrilateral exceeds its samples on every side, so that neighbours
/// leave no crack.
const OVERLAP_PX: f64 = 0.1;
/// Largest displacement of a texel from its sample, pixels; transparent texels at the rims of
/// textures would leave cracks otherwise.
const TEXEL_ERROR_PX: f64 = 0.25;
/// Share by which inverse depth at the corners of a quadrilateral may exceed the range of its
/// samples: it must not stick out of leaves that are slanted to each other.
const MAX_EXTRAPOLATION: f64 = 0.02;
/// Weight of the samples' own slopes in a fit, per sample.
const SLOPE_WEIGHT: f64 = 0.02;

/// Quadrilateral in space with its texture coordinates.
#[derive(Clone, Copy)]
pub(crate) struct Quad {
    /// Upper left, upper right, lower left, lower right corner; metres from the centre.
    pub(crate) corners: [DVec3; 4],
    /// The same corners in the texture, pixels.
    pub(crate) texels: [[f64; 2]; 4],
}

/// Texture and the quadrilaterals that show its parts ("chart").
pub(crate) struct TexturedQuads {
    pub(crate) picture: AtlasPicture,
    pub(crate) quads: Vec<Quad>,
    /// True if every texel is opaque.
    pub(crate) opaque: bool,
    /// Number of samples in the texture.
    pub(crate) samples: u32,
}

/// Returns true if texels stay in place although engines interpolate them linearly over a receding
/// quadrilateral: over a length L with end distances of ratio r, the middle is displaced by L (r -
/// 1) / (2 (r + 1)).
fn keeps_texels_in_place(length_px: f64, [q0, q1]: [f64; 2]) -> bool {
    let ratio = q0.max(q1) / q0.min(q1);
    length_px * (ratio - 1.0) / (2.0 * (ratio + 1.0)) <= TEXEL_ERROR_PX
}

/// Makes charts of sheets. Seen from the headbox, no sample is displaced by more than `error_px`
/// face pixels.
pub(crate) fn sheet_charts(
    cube: &CubeLdi,
    sheets: &[SurfaceSheet],
    error_px: f64,
) -> Vec<TexturedQuads> {
    let tolerance = error_px * 2.0 / (f64::from(cube.face_size_px) * cube.info.half_size_m);
    sheets
        .par_iter()
        .map(|sheet| sheet_chart(cube, sheet, tolerance))
        .collect()
}

/// Inverse depth as a plane over a face: coefficients of (1, x, y).
type Affine = DVec3;

/// Rectangle of a face that becomes a quadrilateral.
struct Rectangle {
    face: Face,
    face_px: u32,
    /// Left, top, right, bottom, face pixels.
    sides: [f64; 4],
    /// Face position of the texture's upper left corner.
    picture: [f64; 2],
}

impl Rectangle {
    fn quad(&self, inverse_depth: Affine, [least, most]: [f64; 2]) -> Quad {
        let [left, top, right, bottom] = self.sides;
        let corners = [[left, top], [right, top], [left, bottom], [right, bottom]];
        Quad {
            corners: corners.map(|[x, y]| {
                let q = inverse_depth.dot(dvec3(1.0, x, y)).clamp(least, most);
                self.face.direction(x, y, self.face_px) / q
            }),
            texels: corners.map(|[x, y]| [x - self.picture[0], y - self.picture[1]]),
        }
    }
}

/// Makes charts of the plane textures.
pub(crate) fn plane_charts(cube: &CubeLdi) -> Vec<TexturedQuads> {
    let (set, face_px) = (&cube.planes, cube.face_size_px);
    let min_inverse_depth = crate::points::surfels::min_inverse_depth(cube);
    let chart = |tile: &headbox_cube::pack::PlaneTile| {
        let (width, height) = (usize::from(tile.width), usize::from(tile.height));
        let picture = with_border(set.texels.get(tile.texel_range())?, width, height);
        let face = Face::ALL[usize::from(tile.face) % 6];
        let inverse_depth = Affine::from(
            set.planes
                .get(tile.plane as usize)?
                .inverse_depth(face, face_px),
        );
        let (x0, y0) = (f64::from(tile.x0), f64::from(tile.y0));
        let (right, bottom) = (x0 + width as f64, y0 + height as f64);
        let mut quads = Vec::new();
        let whole = Rectangle {
            face,
            face_px,
            sides: [x0, y0, right, bottom],
            picture: [x0 - 1.0, y0 - 1.0],
        };
        split_plane(whole, inverse_depth, min_inverse_depth, &mut quads);
        Some(TexturedQuads {
            picture,
            quads,
            opaque: tile.opaque == 1,
            samples: tile.texel_count() as u32,
        })
    };
    set.tiles.par_iter().filter_map(chart).collect()
}

/// Makes a plane texture with straight alpha and a border that repeats its outermost texels: the
/// renderer's tents reach from there to the next surface, here half a texel must suffice.
fn with_border(texels: &[[u8; 4]], width: usize, height: usize) -> AtlasPicture {
    let inside = |i: usize, length: usize| i.saturating_sub(1).min(length.saturating_sub(1));
    let rows = (0..height + 2).map(|row| inside(row, height) * width);
    let framed = rows.flat_map(|start| {
        (0..width + 2).map(move |column| straight(texels[start + inside(column, width)]))
    });
    let mut picture = AtlasPicture {
        width: width + 2,
        height: height + 2,
        texels: framed.collect(),
    };
    fill_transparent(&mut picture);
    picture
}

/// Splits a rectangle until its texels are in place.
fn split_plane(whole: Rectangle, inverse_depth: Affine, least: f64, to: &mut Vec<Quad>) {
    let [left, top, right, bottom] = whole.sides;
    let q = |x: f64, y: f64| inverse_depth.dot(dvec3(1.0, x, y)).max(least);
    let across = [q(left, top), q(right, top)];
    let down = [q(left, top), q(left, bottom)];
    let holds = [
        keeps_texels_in_place(right - left, across),
        keeps_texels_in_place(bottom - top, down),
    ];
    let halves = |at: usize| {
        let middle = f64::midpoint(whole.sides[at], whole.sides[at + 2]);
        let (mut first, mut second) = (whole.sides, whole.sides);
        (first[at + 2], second[at]) = (middle, middle);
        [first, second]
    };
    let cut = match holds {
        [false, _] if right - left > 1.0 => halves(0),
        [_, false] if bottom - top > 1.0 => halves(1),
        _ => return to.push(whole.quad(inverse_depth, [least, f64::INFINITY])),
    };
    for sides in cut {
        split_plane(Rectangle { sides, ..whole }, inverse_depth, least, to);
    }
}

/// Column, row, and inverse depth with its change per pixel right and down.
type PlacedSample = (usize, usize, [f64; 3]);

/// Splitting of a sheet into quadrilaterals.
struct SheetSplitter<'a> {
    sheet: &'a SurfaceSheet,
    face_px: u32,
    /// Largest error of inverse depth, 1/m.
    tolerance: f64,
}

fn sheet_chart(cube: &CubeLdi, sheet: &SurfaceSheet, tolerance: f64) -> TexturedQuads {
    let splitter = SheetSplitter {
        sheet,
        face_px: cube.face_size_px,
        tolerance,
    };
    let mut quads = Vec::new();
    splitter.split([1, 1, SHEET_COLUMNS - 1, SHEET_ROWS - 1], &mut quads);
    let texels: Vec<[u8; 4]> = sheet
        .entries
        .iter()
        .map(|entry| entry.map_or([0; 4], |entry| entry.color_srgb))
        .collect();
    let opaque = texels.iter().all(|texel| texel[3] == 255);
    let mut picture = AtlasPicture {
        width: SHEET_COLUMNS,
        height: SHEET_ROWS,
        texels,
    };
    fill_transparent(&mut picture);
    TexturedQuads {
        picture,
        quads,
        opaque,
        samples: sheet.samples,
    }
}

/// Fills texels without a sample by the mean colour of their neighbours, so that filtering does not
/// darken rims.
fn fill_transparent(
    AtlasPicture {
        width,
        height,
        texels,
    }: &mut AtlasPicture,
) {
    let known = texels.clone();
    for at in (0..texels.len()).filter(|at| known[*at][3] == 0) {
        let (x, y) = (at % *width, at / *width);
        let rows = y.saturating_sub(1)..(y + 2).min(*height);
        let around =
            rows.flat_map(|y| (x.saturating_sub(1)..(x + 2).min(*width)).map(move |x| (x, y)));
        let (mut sum, mut count) = ([0u32; 3], 0);
        for [r, g, b, _] in around
            .map(|(x, y)| known[y * *width + x])
            .filter(|texel| texel[3] > 0)
        {
            sum = [
                sum[0] + u32::from(r),
                sum[1] + u32::from(g),
                sum[2] + u32::from(b),
            ];
            count += 1;
        }
        if count > 0 {
            let [r, g, b] = sum.map(|c| (c / count) as u8);
            texels[at] = [r, g, b, 0];
        }
    }
}

impl SheetSplitter<'_> {
    /// Returns the inverse depth of an entry, and its change per pixel right and down.
    fn sample(&self, column: usize, row: usize) -> Option<[f64; 3]> {
        let entry = self.sheet.entries[row * SHEET_COLUMNS + column]?;
        Some([entry.inverse_depth, entry.slopes[0], entry.slopes[1]])
    }

    /// Returns the centre of an entry on the face.
    fn centre(&self, column: usize, row: usize) -> [f64; 2] {
        [
            self.sheet.origin[0] + column as f64 + 0.5,
            self.sheet.origin[1] + row as f64 + 0.5,
        ]
    }

    /// Splits entries (left, top, right, bottom) until a plane fits the samples among them.
    fn split(&self, [left, top, right, bottom]: [usize; 4], to: &mut Vec<Quad>) {
        let samples: Vec<PlacedSample> = (top..bottom)
            .flat_map(|row| (left..right).map(move |column| (column, row)))
            .filter_map(|(column, row)| Some((column, row, self.sample(column, row)?)))
            .collect();
        let bound = |index: fn(&PlacedSample) -> usize| {
            let ends = (
                samples.iter().map(index).min(),
                samples.iter().map(index).max(),
            );
            ends.0.zip(ends.1)
        };
        let (Some((left, last_column)), Some((top, last_row))) = (bound(|s| s.0), bound(|s| s.1))
        else {
            return;
        };
        let (right, bottom) = (last_column + 1, last_row + 1);
        let plane = self.fit(&samples);
        let (mut least, mut most, mut off) = (f64::INFINITY, 0.0f64, 0.0f64);
        for (column, row, [q, ..]) in &samples {
            let [x, y] = self.centre(*column, *row);
            (least, most) = (least.min(*q), most.max(*q));
            off = off.max((plane.dot(dvec3(1.0, x, y)) - q).abs());
        }
        let single = right - left == 1 && bottom - top == 1;
        let longer = (right - left).max(bottom - top) as f64;
        let holds = off <= self.tolerance && keeps_texels_in_place(longer, [least, most]);
        if single || holds {
            let [x, y] = self.sheet.origin;
            let sides = [
                x + left as f64 - OVERLAP_PX,
                y + top as f64 - OVERLAP_PX,
                x + right as f64 + OVERLAP_PX,
                y + bottom as f64 + OVERLAP_PX,
            ];
            let rectangle = Rectangle {
                face: self.sheet.face,
                face_px: self.face_px,
                sides,
                picture: self.sheet.origin,
            };
            // The plane of few samples must not extrapolate at their rim.
            to.push(rectangle.quad(
                plane,
                [
                    least * (1.0 - MAX_EXTRAPOLATION),
                    most * (1.0 + MAX_EXTRAPOLATION),
                ],
            ));
        } else if right - left >= bottom - top {
            let middle = usize::midpoint(left, right);
            self.split([left, top, middle, bottom], to);
            self.split([middle, top, right, bottom], to);
        } else {
            let middle = usize::midpoint(top, bottom);
            self.split([left, top, right, middle], to);
            self.split([left, middle, right, bottom], to);
        }
    }

    /// Fits a plane to some samples by least squares, with a small weight on their mean slope,
    /// which decides where they lie on a line.
    fn fit(&self, samples: &[PlacedSample]) -> Affine {
        let count = samples.len().max(1) as f64;
        let mean =
            |value: &dyn Fn(&PlacedSample) -> f64| samples.iter().map(value).sum::<f64>() / count;
        let [middle_x, middle_y] = [0, 1].map(|i| mean(&|s| self.centre(s.0, s.1)[i]));
        let [q, slope_x, slope_y] = [0, 1, 2].map(|i| mean(&|s| s.2[i]));
        let prior = SLOPE_WEIGHT * count;
        let mut matrix = DMat3::from_diagonal(dvec3(0.0, prior, prior));
        let mut right = dvec3(0.0, slope_x, slope_y) * prior;
        for (column, row, [q, ..]) in samples {
            let [x, y] = self.centre(*column, *row);
            let v = dvec3(1.0, x - middle_x, y - middle_y);
            matrix += DMat3::from_cols(v * v.x, v * v.y, v * v.z);
            right += v * *q;
        }
        let found = matrix.inverse() * right;
        let [a, b, c] = if found.is_finite() {
            found.to_array()
        } else {
            [q, slope_x, slope_y]
        };
        dvec3(a - b * middle_x - c * middle_y, b, c)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use headbox_cube::model::samples::{CubeSamples, DepthPixel, EncodedNormal, LayeredDepthImage};
    use headbox_cube::pack::{SplatIndexLayout, Split};

    /// A wall across the right half of a face, two metres away, before one all over it, four metres
    /// away.
    fn two_walls(face_px: u32) -> CubeLdi {
        let sample = |depth: f64| DepthPixel {
            inverse_depth: (1.0 / depth) as f32,
            normal: EncodedNormal::new(glam::Vec3::Z),
            color_srgb: [(depth * 50.0) as u8, 7, 9, 255],
        };
        let faces = Face::ALL.map(|face| {
            let mut ldi = LayeredDepthImage::empty(face, face_px);
            for i in 0..face_px * face_px {
                if face == Face::NegZ {
                    ldi.samples.push(sample(4.0));
                    ldi.samples
                        .extend((i % face_px >= face_px / 2).then(|| sample(2.0)));
                }
                ldi.offsets[i as usize + 1] = ldi.samples.len() as u32;
            }
            ldi
        });
        let mut info = headbox_cube::model::info::CaptureInfo::default();
        (info.half_size_m, info.exposure) = (0.4, 1.0);
        let ldi = CubeSamples {
            info,
            faces: faces.to_vec(),
            environment: Default::default(),
        };
        CubeLdi::pack(&ldi, SplatIndexLayout::Normal, Split::None).unwrap()
    }

    #[test]
    fn walls_are_quadrilaterals_on_their_planes() {
        let face_px = 64;
        let cube = two_walls(face_px);
        let charts = sheet_charts(&cube, &sheets::sheets(&cube), 0.5);
        let mut area = [0.0; 2];
        for quad in charts.iter().flat_map(|chart| &chart.quads) {
            let wall = usize::from(quad.corners[0].z < -3.0);
            // Normals of eleven bits are up to 2.9 degrees off, and have a little part in the fit.
            quad.corners
                .iter()
                .for_each(|corner| assert!((corner.z + [2.0, 4.0][wall]).abs() < 1e-3, "{corner}"));
            let [a, b, c, _] = quad.corners;
            area[wall] += (b - a).length() * (c - a).length();
        }
        // Widths on the walls, and overlaps of a fifth of a pixel in at least 14.
        for (found, expected) in area.into_iter().zip([2.0 * 4.0, 8.0 * 8.0]) {
            assert!(
                found >= expected && found < expected * 1.05,
                "{found} {expected}"
            );
        }
        let quads: usize = charts.iter().map(|chart| chart.quads.len()).sum();
        assert!(
            quads <= charts.len() && charts.len() <= 40,
            "{quads} {}",
            charts.len()
        );
    }
}
