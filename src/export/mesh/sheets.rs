//! Sheets: the samples of a cube as small images of one surface each, which a mesh can follow.
//!
//! A face is divided into tiles of [`TILE_COLUMNS`] x [`TILE_ROWS`] pixels. The samples of a tile
//! are distributed to *sheets*, images with at most one sample per pixel, such that adjacent
//! samples of one surface are adjacent on one sheet. A sheet has a border of one pixel on all sides
//! with the samples of the surrounding tiles, so that textures meet.

use crate::pieces::SurfaceTest;
use headbox_core::cube_face::Face;
use headbox_cube::pack::{CubeLdi, PackedSegment};
use headbox_cube::render::footprint::rules::MAX_SLOPE;
use rayon::prelude::*;

/// Columns of a sheet with its border.
pub(crate) const SHEET_COLUMNS: usize = 32;
/// Rows of a sheet with its border.
pub(crate) const SHEET_ROWS: usize = 16;
/// Entries of a sheet.
pub(crate) const SHEET_LEN: usize = SHEET_COLUMNS * SHEET_ROWS;
const TILE_COLUMNS: u32 = SHEET_COLUMNS as u32 - 2;
const TILE_ROWS: u32 = SHEET_ROWS as u32 - 2;

/// Sample on a sheet.
#[derive(Clone, Copy)]
pub(crate) struct SheetSample {
    /// Inverse depth, 1/m.
    pub(crate) inverse_depth: f64,
    /// Change of the inverse depth per pixel right and down on the sample's plane, 1/m.
    pub(crate) slopes: [f64; 2],
    /// sRGB, straight alpha.
    pub(crate) color_srgb: [u8; 4],
}

/// Image of one surface.
pub(crate) struct SurfaceSheet {
    pub(crate) face: Face,
    /// Face position of its upper left corner; -1 where the border is outside of the face.
    pub(crate) origin: [f64; 2],
    /// [`SHEET_LEN`] entries, row by row.
    pub(crate) entries: Vec<Option<SheetSample>>,
    /// Number of samples inside the border.
    pub(crate) samples: u32,
}

/// Makes all sheets of a cube with samples inside their borders.
pub(crate) fn sheets(cube: &CubeLdi) -> Vec<SurfaceSheet> {
    let tiles = Face::ALL.into_iter().flat_map(|face| {
        let rows = 0..cube.face_size_px.div_ceil(TILE_ROWS);
        rows.flat_map(move |row| {
            let columns = 0..cube.face_size_px.div_ceil(TILE_COLUMNS);
            columns.map(move |column| (face, column * TILE_COLUMNS, row * TILE_ROWS))
        })
    });
    let tiles: Vec<_> = tiles.collect();
    let tile_sheets = |(face, x0, y0): &(Face, u32, u32)| sheets_of_tile(cube, *face, *x0, *y0);
    tiles
        .par_iter()
        .map(tile_sheets)
        .collect::<Vec<_>>()
        .into_iter()
        .flatten()
        .collect()
}

fn sheets_of_tile(cube: &CubeLdi, face: Face, x0: u32, y0: u32) -> Vec<SurfaceSheet> {
    let segments: Vec<&PackedSegment> = cube
        .segments
        .iter()
        .filter(|segment| segment.face == face)
        .collect();
    let surfaces = SurfaceTest::new(cube);
    let mut sheet_entries: Vec<Vec<Option<SheetSample>>> = Vec::new();
    for at in 0..SHEET_LEN {
        let (column, row) = ((at % SHEET_COLUMNS) as u32, (at / SHEET_COLUMNS) as u32);
        let Some((x, y)) = (x0 + column).checked_sub(1).zip((y0 + row).checked_sub(1)) else {
            continue;
        };
        let samples: Vec<SheetSample> = segments
            .iter()
            .flat_map(|segment| entries(cube, segment, x, y))
            .collect();
        place_samples(&samples, at, &surfaces, &mut sheet_entries);
    }
    let inside = |at: usize| {
        (1..SHEET_COLUMNS - 1).contains(&(at % SHEET_COLUMNS))
            && (1..SHEET_ROWS - 1).contains(&(at / SHEET_COLUMNS))
    };
    let origin = [f64::from(x0) - 1.0, f64::from(y0) - 1.0];
    let sheets = sheet_entries.into_iter().map(|entries| {
        let samples = entries
            .iter()
            .enumerate()
            .filter(|(at, entry)| entry.is_some() && inside(*at))
            .count() as u32;
        SurfaceSheet {
            face,
            origin,
            entries,
            samples,
        }
    });
    sheets.filter(|sheet| sheet.samples > 0).collect()
}

/// Returns the samples of a face pixel in a segment.
fn entries<'a>(
    cube: &'a CubeLdi,
    segment: &'a PackedSegment,
    x: u32,
    y: u32,
) -> impl Iterator<Item = SheetSample> + use<'a> {
    let within = x.checked_sub(segment.x0).zip(y.checked_sub(segment.y0));
    let pixel = within
        .filter(|(x, _)| *x < segment.width)
        .map_or(&[][..], |(x, y)| segment.pixel(x, y));
    let face_px = cube.face_size_px;
    let d = segment
        .face
        .direction(f64::from(x) + 0.5, f64::from(y) + 0.5, face_px);
    let step = 2.0 / f64::from(face_px);
    let most = f64::from(MAX_SLOPE) * step;
    pixel.iter().map(move |pixel| {
        let found = segment.decode(cube.layout, *pixel);
        let (n, q) = (found.normal, found.inverse_depth);
        let slopes = [segment.face.right(), -segment.face.up()]
            .map(|to| (n.dot(to) * step / n.dot(d)).min(most).max(-most) * q);
        SheetSample {
            inverse_depth: q,
            slopes,
            color_srgb: found.color_srgb,
        }
    })
}

/// Places the samples of one pixel: first, on each sheet, the sample that best continues an
/// adjacent surface, then the others on sheets that are still empty there.
fn place_samples(
    samples: &[SheetSample],
    at: usize,
    surfaces: &SurfaceTest,
    sheets: &mut Vec<Vec<Option<SheetSample>>>,
) {
    let mut placed = vec![false; samples.len()];
    let (column, row) = (at % SHEET_COLUMNS, at / SHEET_COLUMNS);
    let before = [
        (column > 0).then(|| at - 1),
        (row > 0).then(|| at - SHEET_COLUMNS),
        (row > 0 && column + 1 < SHEET_COLUMNS).then(|| at + 1 - SHEET_COLUMNS),
    ];
    for sheet in sheets.iter_mut() {
        let mut best = None;
        for near in before.into_iter().flatten().filter_map(|at| sheet[at]) {
            for (i, sample) in samples.iter().enumerate().filter(|(i, _)| !placed[*i]) {
                let difference = (near.inverse_depth - sample.inverse_depth).abs();
                let is_best = best.is_none_or(|(least, _)| difference < least);
                if is_best && surfaces.connects(near.inverse_depth, sample.inverse_depth) {
                    best = Some((difference, i));
                }
            }
        }
        if let Some((_, i)) = best {
            sheet[at] = Some(samples[i]);
            placed[i] = true;
        }
    }
    for (sample, _) in samples.iter().zip(&placed).filter(|(_, placed)| !**placed) {
        match sheets.iter_mut().find(|sheet| sheet[at].is_none()) {
            Some(sheet) => sheet[at] = Some(*sample),
            None => {
                let mut sheet = vec![None; SHEET_LEN];
                sheet[at] = Some(*sample);
                sheets.push(sheet);
            }
        }
    }
}
