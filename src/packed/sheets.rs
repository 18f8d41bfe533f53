//! The samples of a cube as small images of surfaces: what the renderer needs that looks every frame pixel up.
//!
//! A face is cut into places of [`PLACE_COLUMNS`] x [`PLACE_ROWS`] pixels. The samples of a place are dealt out to *sheets*,
//! images with at most one sample a pixel, such that samples that lie beside each other on one surface lie beside each other
//! on one sheet. A sheet has a border of one pixel on all sides, copies of samples of the places around, so that whatever is
//! looked up between samples lies on one sheet, and any sample's neighbours are a fixed step away.
//!
//! All of it follows from the packed samples, and is made when it is first asked for.

use super::layout::{PackedCube, PackedDepthPixel, PackedSegment};
use crate::capture::rig::Face;
use crate::ldi::accumulate::DepthBins;
use glam::Vec3;
use rayon::prelude::*;
use std::sync::OnceLock;

/// Columns of a sheet with its border.
pub(crate) const SHEET_COLUMNS: usize = 32;
/// Rows of a sheet with its border.
pub(crate) const SHEET_ROWS: usize = 16;
/// Entries of a sheet.
pub(crate) const SHEET_LEN: usize = SHEET_COLUMNS * SHEET_ROWS;
/// Columns of a place.
pub(crate) const PLACE_COLUMNS: u32 = SHEET_COLUMNS as u32 - 2;
/// Rows of a place.
pub(crate) const PLACE_ROWS: u32 = SHEET_ROWS as u32 - 2;
/// Entries of a row that are one bit of [`Sheet::occupied`].
pub(crate) const GROUP: usize = 8;
/// The bit of an entry's inverse depth that says that it is solid.
pub(crate) const SOLID: u32 = 1 << 31;
/// Largest slope that an entry can hold, in units of its last place.
const SLOPE_MAX: f32 = 2047.0;

/// One image of surfaces.
#[derive(Clone, Debug)]
pub(crate) struct Sheet {
    pub(crate) face: Face,
    /// Column on the face of the first one inside the border.
    pub(crate) x0: u32,
    /// Row on the face of the first one inside the border.
    pub(crate) y0: u32,
    /// Least and largest inverse depth inside the border, 1/m.
    pub(crate) inverse_depth: [f32; 2],
    /// Of each row inside the border, from the lowest bit, and each [`GROUP`] columns, whether there is a sample.
    pub(crate) occupied: u64,
    /// Samples inside the border.
    pub(crate) len: u32,
}

/// Shape of an entry.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(crate) struct Shape {
    /// Inverse depth, 1/m, as the bits of an `f32`, and [`SOLID`] if the sample and its eight neighbours are of one surface and
    /// hide their pixels wholly; 0 for no sample.
    pub(crate) inverse_depth: u32,
    /// From the lowest bit: which of the eight neighbours are of one surface with it (8 bits, row by row), and the slopes of the
    /// inverse depth along x and y, relative to it (12 bits each).
    pub(crate) slopes: u32,
}

/// All sheets of a cube.
#[derive(Debug, Default)]
pub(crate) struct Sheets {
    /// Those of one place follow each other.
    pub(crate) sheets: Vec<Sheet>,
    /// [`SHEET_LEN`] for each sheet, row by row.
    pub(crate) shapes: Vec<Shape>,
    /// Of each sheet: column, row (14 bits each) and face of [`Sheet`].
    pub(crate) places: Vec<u32>,
    /// As many as shapes: sRGB, straight alpha.
    pub(crate) colors: Vec<u32>,
    /// Relative change of inverse depth over one pixel for one unit of a slope.
    pub(crate) slope_unit: f32,
}

/// [`Sheets`] that are made when they are first asked for. A copy has none.
#[derive(Debug, Default)]
pub struct LazySheets(OnceLock<Sheets>);

impl Clone for LazySheets {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl PartialEq for LazySheets {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

/// Relative difference of inverse depth up to which two samples beside each other are of one surface: 1.5 % for what a
/// capture merges, and the change of depth over one face pixel of a surface at 74 degrees to the line of sight (2 / `face_px`
/// is a face pixel's angle, tan 74 = 3.6).
pub(crate) fn surface_tolerance(face_px: u32) -> f32 {
    0.015 + 3.6 * 2.0 / face_px as f32
}

/// Relative change of inverse depth over one face pixel that is believed at most, times half of the face's size.
const MAX_SLOPE: f32 = 4.0;

impl PackedCube {
    /// The cube's sheets.
    pub(crate) fn sheets(&self) -> &Sheets {
        self.sheets.0.get_or_init(|| Sheets::of(self))
    }
}

impl Sheets {
    fn of(cube: &PackedCube) -> Self {
        let face_px = cube.face_size_px;
        let slope_unit = MAX_SLOPE * 2.0 / face_px.max(1) as f32 / SLOPE_MAX;
        let mut places = Vec::new();
        for face in Face::ALL {
            let segments: Vec<&PackedSegment> = cube.segments.iter().filter(|s| s.face == face).collect();
            let Some(bounds) = bounds(&segments, face_px) else { continue };
            let [columns, rows] = bounds;
            for y in rows[0] / PLACE_ROWS..rows[1].div_ceil(PLACE_ROWS) {
                for x in columns[0] / PLACE_COLUMNS..columns[1].div_ceil(PLACE_COLUMNS) {
                    places.push((face, x * PLACE_COLUMNS, y * PLACE_ROWS));
                }
            }
        }
        let planes: Vec<Vec3> = (0..1 << 11).map(|i| plane(cube.layout.normal(i), face_px)).collect();
        let scale = Scale {
            tolerance: surface_tolerance(face_px),
            bin: DepthBins::new(cube.info.half_size_m, face_px).inverse_depth(1.0) as f32,
            slope_unit,
            face_px,
        };
        let chunks: Vec<Self> = places
            .par_chunks(64)
            .map(|places| {
                let (mut made, mut builder) = (Self::default(), Builder::default());
                for &(face, x0, y0) in places {
                    builder.read(cube, face, x0, y0);
                    builder.finish(&scale, &planes, face, x0, y0, &mut made);
                }
                made
            })
            .collect();
        let mut all = Self { slope_unit, ..Self::default() };
        all.sheets.reserve_exact(chunks.iter().map(|c| c.sheets.len()).sum());
        all.shapes.reserve_exact(chunks.iter().map(|c| c.shapes.len()).sum());
        all.colors.reserve_exact(chunks.iter().map(|c| c.colors.len()).sum());
        for chunk in chunks {
            all.sheets.extend(chunk.sheets);
            all.places.extend(chunk.places);
            all.shapes.extend(chunk.shapes);
            all.colors.extend(chunk.colors);
        }
        all
    }
}

/// n . ray(x, y) = plane . (x, y, 1), in face pixels.
fn plane(n: Vec3, face_px: u32) -> Vec3 {
    let step = 2.0 / face_px.max(1) as f32;
    Vec3::new(n.x * step, -n.y * step, -n.x + n.y - n.z)
}

/// Columns and rows of a face that hold samples.
fn bounds(segments: &[&PackedSegment], face_px: u32) -> Option<[[u32; 2]; 2]> {
    let mut bounds = None;
    for s in segments.iter().filter(|s| s.width > 0 && s.height > 0) {
        let end = |start: u32, length: u32| start.saturating_add(length).min(face_px);
        let (x, y) = ([s.x0.min(face_px), end(s.x0, s.width)], [s.y0.min(face_px), end(s.y0, s.height)]);
        let [bx, by] = bounds.unwrap_or([x, y]);
        bounds = Some([[bx[0].min(x[0]), bx[1].max(x[1])], [by[0].min(y[0]), by[1].max(y[1])]]);
    }
    bounds
}

/// What decides whether samples are of one surface.
struct Scale {
    tolerance: f32,
    bin: f32,
    slope_unit: f32,
    face_px: u32,
}

impl Scale {
    fn connects(&self, a: f32, b: f32) -> bool {
        (a - b).abs() <= (a.max(b) * self.tolerance).max(self.bin)
    }

    /// The sample beyond one at a border, which goes on as it came from its neighbour inside.
    fn beyond(&self, border: Sample, inner: Sample) -> Sample {
        let goes_on = inner.inverse_depth > 0.0 && self.connects(border.inverse_depth, inner.inverse_depth);
        let next = 2.0 * border.inverse_depth - inner.inverse_depth;
        Sample { inverse_depth: if goes_on && next > 0.0 { next } else { border.inverse_depth }, ..border }
    }
}

/// A sample on its way to a sheet; without inverse depth, none.
#[derive(Clone, Copy, Default)]
struct Sample {
    inverse_depth: f32,
    normal: u32,
    color: u32,
}

/// The samples of a place and its border, and the sheets they are dealt out to.
#[derive(Default)]
struct Builder {
    samples: Vec<Sample>,
    /// Of each pixel, the first of its samples; and the end.
    starts: Vec<u32>,
    /// [`SHEET_LEN`] for each sheet.
    dealt: Vec<Sample>,
}

impl Builder {
    /// Reads the samples of a place and its border.
    fn read(&mut self, cube: &PackedCube, face: Face, x0: u32, y0: u32) {
        self.samples.clear();
        self.starts.clear();
        for (row, column) in (0..SHEET_ROWS as u32).flat_map(|r| (0..SHEET_COLUMNS as u32).map(move |c| (r, c))) {
            self.starts.push(self.samples.len() as u32);
            let at = (x0 + column).checked_sub(1).zip((y0 + row).checked_sub(1));
            let Some((x, y)) = at.filter(|(x, y)| *x < cube.face_size_px && *y < cube.face_size_px) else { continue };
            for s in cube.segments.iter().filter(|s| s.face == face) {
                let Some((x, y)) = x.checked_sub(s.x0).zip(y.checked_sub(s.y0)) else { continue };
                if x >= s.width || y >= s.height {
                    continue;
                }
                self.samples.extend(s.pixel(x, y).iter().map(|p: &PackedDepthPixel| Sample {
                    inverse_depth: s.inverse_depth(p.inverse_depth_code()) as f32,
                    normal: p.splat_index(),
                    color: u32::from_ne_bytes(p.color_srgb),
                }));
            }
        }
        self.starts.push(self.samples.len() as u32);
    }

    /// Deals the samples out, and appends the sheets.
    fn finish(&mut self, scale: &Scale, planes: &[Vec3], face: Face, x0: u32, y0: u32, to: &mut Sheets) {
        self.dealt.clear();
        for at in 0..SHEET_LEN {
            let pixel = self.starts[at] as usize..self.starts[at + 1] as usize;
            if !pixel.is_empty() {
                self.deal(scale, at, pixel);
            }
        }
        let inside = |at: usize| {
            (1..SHEET_COLUMNS - 1).contains(&(at % SHEET_COLUMNS))
                && (1..SHEET_ROWS - 1).contains(&(at / SHEET_COLUMNS))
        };
        for sheet in self.dealt.chunks_exact_mut(SHEET_LEN) {
            let (mut range, mut occupied, mut len) = ([f32::INFINITY, 0.0f32], 0u64, 0);
            for (at, sample) in sheet.iter().enumerate().filter(|(at, s)| s.inverse_depth > 0.0 && inside(*at)) {
                range = [range[0].min(sample.inverse_depth), range[1].max(sample.inverse_depth)];
                let groups = SHEET_COLUMNS / GROUP;
                occupied |= 1 << ((at / SHEET_COLUMNS - 1) * groups + at % SHEET_COLUMNS / GROUP);
                len += 1;
            }
            if len == 0 {
                continue;
            }
            extend_beyond_face(sheet, [x0, y0], scale);
            to.sheets.push(Sheet { face, x0, y0, inverse_depth: range, occupied, len });
            to.places.push(x0 | y0 << 14 | (face.index() as u32) << 28);
            for at in 0..SHEET_LEN {
                to.shapes.push(shape(sheet, at, scale, planes, [x0, y0]));
                to.colors.push(sheet[at].color);
            }
        }
    }

    /// Deals the samples of one pixel out: first those that go on a surface, each to the sheet where it does best, then the
    /// others to sheets that are still free there.
    fn deal(&mut self, scale: &Scale, at: usize, pixel: std::ops::Range<usize>) {
        let samples = &self.samples[pixel];
        let sheets = self.dealt.len() / SHEET_LEN;
        let mut placed = 0u64;
        let (column, row) = (at % SHEET_COLUMNS, at / SHEET_COLUMNS);
        for sheet in 0..sheets {
            let base = sheet * SHEET_LEN;
            let left = if column > 0 { self.dealt[base + at - 1].inverse_depth } else { 0.0 };
            let above = if row > 0 { self.dealt[base + at - SHEET_COLUMNS].inverse_depth } else { 0.0 };
            let right = if row > 0 && column + 1 < SHEET_COLUMNS {
                self.dealt[base + at + 1 - SHEET_COLUMNS].inverse_depth
            } else {
                0.0
            };
            let mut best = (f32::INFINITY, usize::MAX);
            for (i, sample) in samples.iter().enumerate().take(64) {
                if placed >> i & 1 == 0 {
                    for near in [left, above, right] {
                        let apart = (near - sample.inverse_depth).abs();
                        if near > 0.0 && apart < best.0 && scale.connects(near, sample.inverse_depth) {
                            best = (apart, i);
                        }
                    }
                }
            }
            if best.1 < samples.len() {
                self.dealt[base + at] = samples[best.1];
                placed |= 1 << best.1;
            }
        }
        let mut sheet = 0;
        // The nearest first, which is most often seen.
        for (i, sample) in samples.iter().enumerate().rev() {
            if i < 64 && placed >> i & 1 == 1 {
                continue;
            }
            while sheet * SHEET_LEN < self.dealt.len() && self.dealt[sheet * SHEET_LEN + at].inverse_depth > 0.0 {
                sheet += 1;
            }
            if sheet * SHEET_LEN == self.dealt.len() {
                self.dealt.resize(self.dealt.len() + SHEET_LEN, Sample::default());
            }
            self.dealt[sheet * SHEET_LEN + at] = *sample;
        }
    }
}

/// Continues surfaces that end with the face by one pixel, as planes.
fn extend_beyond_face(sheet: &mut [Sample], start: [u32; 2], scale: &Scale) {
    let [columns, rows] = [(start[0], SHEET_COLUMNS), (start[1], SHEET_ROWS)].map(|(start, size)| {
        let last = (scale.face_px - start) as usize;
        [(start == 0).then_some([0, 1, 2]), (last + 1 < size).then(|| [last + 1, last, last.saturating_sub(1)])]
    });
    for [beyond, border, inner] in columns.into_iter().flatten() {
        for row in sheet.chunks_exact_mut(SHEET_COLUMNS) {
            row[beyond] = scale.beyond(row[border], row[inner]);
        }
    }
    for [beyond, border, inner] in rows.into_iter().flatten() {
        for column in 0..SHEET_COLUMNS {
            let at = |row: usize| row * SHEET_COLUMNS + column;
            sheet[at(beyond)] = scale.beyond(sheet[at(border)], sheet[at(inner)]);
        }
    }
}

/// The eight neighbours of an entry, row by row.
const NEIGHBOURS: [(i32, i32); 8] = [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)];
const ALPHA_SHIFT: u32 = u32::from_ne_bytes([0, 0, 0, 1]).trailing_zeros();

fn shape(sheet: &[Sample], at: usize, scale: &Scale, planes: &[Vec3], [x0, y0]: [u32; 2]) -> Shape {
    let Sample { inverse_depth: q, normal, color } = sheet[at];
    if q <= 0.0 {
        return Shape::default();
    }
    let (column, row) = ((at % SHEET_COLUMNS) as i32, (at / SHEET_COLUMNS) as i32);
    let neighbour = |(dx, dy): (i32, i32)| {
        let (x, y) = (column + dx, row + dy);
        let inside = (0..SHEET_COLUMNS as i32).contains(&x) && (0..SHEET_ROWS as i32).contains(&y);
        let sample = if inside { sheet[y as usize * SHEET_COLUMNS + x as usize] } else { Sample::default() };
        (sample.inverse_depth > 0.0 && scale.connects(q, sample.inverse_depth)).then_some(sample)
    };
    let around = NEIGHBOURS.map(neighbour);
    let mask = around.iter().enumerate().fold(0, |mask, (i, n)| mask | u32::from(n.is_some()) << i);
    let opaque = |color: u32| color >> ALPHA_SHIFT & 255 == 255;
    let solid = opaque(color) && around.iter().all(|n| n.is_some_and(|n| opaque(n.color)));
    let plane = planes[normal as usize % planes.len()];
    let (x, y) = ((x0 as i32 + column) as f32 - 0.5, (y0 as i32 + row) as f32 - 0.5);
    let along_ray = plane.x * x + plane.y * y + plane.z;
    let q_of = |i: usize| around[i].map(|n| n.inverse_depth);
    let slope = |before: Option<f32>, after: Option<f32>, of_plane: f32| match (before, after) {
        (Some(a), Some(b)) => (b - a) / (2.0 * q),
        (Some(a), None) => (q - a) / q,
        (None, Some(b)) => (b - q) / q,
        (None, None) => of_plane / along_ray,
    };
    let code = |slope: f32| {
        let units = (slope / scale.slope_unit).clamp(-SLOPE_MAX, SLOPE_MAX);
        (units.round() as i32 + 2048) as u32
    };
    let [sx, sy] = [slope(q_of(3), q_of(4), plane.x), slope(q_of(1), q_of(6), plane.y)].map(code);
    let flag = if solid { SOLID } else { 0 };
    Shape { inverse_depth: q.to_bits() | flag, slopes: mask | sx << 8 | sy << 20 }
}
