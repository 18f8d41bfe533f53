//! The parts of a face before any light is on them.

use super::pixel_set::PixelSet;
use super::rows::pieces;
use crate::accumulate::tiles::TILE_PX;
use crate::light::shade::{LitPart, Shader};
use crate::merge::repair::Mender;
use crate::rays::trace::Tracing;
use crate::settings::CaptureSettings;
use crate::surfaces::surface_samples::FaceParts;
use headbox_core::cube_face::Face;
use headbox_core::progress::{Progress, check_cancelled};
use headbox_cube::model::depth_bins::DepthBins;
use headbox_cube::model::parameters::Sampler;
use rayon::prelude::*;
use std::io;

/// Makes the parts of faces.
pub(crate) struct Dark<'a> {
    pub(crate) run: &'a Tracing,
    pub(crate) shader: &'a Shader<'a>,
    pub(crate) settings: &'a CaptureSettings,
    pub(crate) bins: &'a DepthBins,
    pub(crate) progress: &'a dyn Progress,
}

impl Dark<'_> {
    /// The parts of a face, its gaps mended: of all pixels, or only of some.
    pub(crate) fn face(&self, face: Face, only: Option<&PixelSet>) -> io::Result<FaceParts> {
        let mut parts = self.unmended(face, only)?;
        if self.settings.parameters.sampler != Sampler::CentreRays {
            let half_size_m = self.settings.half_size_m as f32;
            Mender {
                face,
                shader: self.shader,
                bins: self.bins,
                half_size_m,
            }
            .mend(&mut parts);
        }
        Ok(parts)
    }

    /// Makes parts of the accumulators of a face, and forgets them unless only their shape is looked at: a few rows of tiles at a time,
    /// so that the parts of a face are in memory only once.
    fn unmended(&self, face: Face, only: Option<&PixelSet>) -> io::Result<FaceParts> {
        let (store, size_px) = (&self.run.store, self.shader.face_size_px);
        let per_row = store.tiles_per_side() as usize;
        let first = face.index() * per_row * per_row;
        let most: usize = match only {
            None => (first..first + per_row * per_row)
                .map(|tile| store.most_in_tile(tile))
                .sum(),
            Some(_) => 0,
        };
        // Memory that is not touched until a thread puts its rows there. Mending adds a few.
        let parts = bytemuck::zeroed_vec(most + most / 64);
        let mut made = FaceParts {
            size_px,
            offsets: vec![0],
            parts,
        };
        for tile_row in (0..per_row).step_by(TILE_ROWS_AT_ONCE) {
            check_cancelled(self.progress)?;
            let end = per_row.min(tile_row + TILE_ROWS_AT_ONCE);
            let tiles = first + tile_row * per_row..first + end * per_row;
            let tiles: io::Result<Vec<TileParts>> = tiles
                .into_par_iter()
                .map(|tile| self.tile_parts(tile, only))
                .collect();
            append(&mut made, &tiles?, per_row);
        }
        let count = made.offsets.last().map_or(0, |&end| end as usize);
        made.parts.truncate(count);
        Ok(made)
    }

    fn tile_parts(&self, tile: usize, only: Option<&PixelSet>) -> io::Result<TileParts> {
        let Self { run, shader, .. } = *self;
        let (face, x0, y0) = run.store.tile_place(tile);
        let place = |pixel: u32| (x0 + pixel % TILE_PX, y0 + pixel / TILE_PX);
        let accumulators = match only {
            None => run.store.tile_run(tile)?,
            Some(only) => run.store.tile_run_of(tile, |pixel| {
                let (x, y) = place(pixel);
                only.contains(x, y)
            })?,
        };
        if !shader.shape_only {
            run.store.clear_tile(tile);
        }
        let mut made = TileParts {
            parts: Vec::with_capacity(accumulators.len()),
            ..TileParts::default()
        };
        for pixel in accumulators.chunk_by(|a, b| a.link == b.link) {
            let (number, (x, y)) = (pixel[0].link as usize, place(pixel[0].link));
            made.counts[number] = pixel.len() as u32;
            made.parts
                .extend(pixel.iter().map(|acc| shader.part(acc, face, x, y)));
        }
        Ok(made)
    }
}

/// Rows of tiles whose parts are made before they move to the end of the face: enough tiles for many threads.
const TILE_ROWS_AT_ONCE: usize = 4;

/// Pixels a side of a tile.
const SIDE: usize = TILE_PX as usize;

/// The parts of one tile, row-major.
struct TileParts {
    /// Number of parts of each pixel.
    counts: [u32; SIDE * SIDE],
    parts: Vec<LitPart>,
}

impl Default for TileParts {
    fn default() -> Self {
        Self {
            counts: [0; SIDE * SIDE],
            parts: Vec::new(),
        }
    }
}

/// Copies whole rows of tiles, of `per_row` each, to the end of the face, row of pixels by row of pixels.
fn append(face: &mut FaceParts, tiles: &[TileParts], per_row: usize) {
    let (size, before) = (face.size_px as usize, face.offsets.len() - 1);
    let used = face.offsets[before] as usize;
    let mut rest: Vec<&[LitPart]> = tiles.iter().map(|tile| &*tile.parts).collect();
    let mut rows: Vec<Vec<&[LitPart]>> = Vec::new();
    let mut total = used as u32;
    for y in 0..(tiles.len() / per_row * SIDE).min(size - before / size) {
        let in_row = y / SIDE * per_row..(y / SIDE + 1) * per_row;
        let counts = tiles[in_row.clone()]
            .iter()
            .map(|tile| &tile.counts[y % SIDE * SIDE..][..SIDE]);
        let lengths = counts
            .clone()
            .map(|counts| counts.iter().sum::<u32>() as usize);
        rows.push(
            rest[in_row]
                .iter_mut()
                .zip(lengths)
                .map(take_first)
                .collect(),
        );
        let offset = |count: &u32| {
            total += count;
            total
        };
        face.offsets.extend(counts.flatten().take(size).map(offset));
    }
    if face.parts.len() < total as usize {
        face.parts
            .resize(total as usize, bytemuck::Zeroable::zeroed());
    }
    let lengths = rows.iter().map(|row| row.iter().map(|of| of.len()).sum());
    let places = pieces(&mut face.parts[used..], lengths);
    places.into_par_iter().zip(&rows).for_each(|(place, row)| {
        let of_tiles = pieces(place, row.iter().map(|of| of.len()));
        of_tiles
            .into_iter()
            .zip(row)
            .for_each(|(place, of)| place.copy_from_slice(of));
    });
}

fn take_first<'a>((from, count): (&mut &'a [LitPart], usize)) -> &'a [LitPart] {
    from.split_off(..count).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    /// How many parts a pixel has; those beyond the face have none.
    fn count(x: usize, y: usize, size: usize) -> usize {
        if x < size && y < size {
            (x * 7 + y * 3) % 4
        } else {
            0
        }
    }

    /// Part `number` of a pixel, told from all others by its name.
    fn part(x: usize, y: usize, number: usize) -> LitPart {
        LitPart {
            primitive: ((y * 1000 + x) * 10 + number) as u32,
            ..LitPart::zeroed()
        }
    }

    #[test]
    fn parts_of_tiles_follow_each_other_pixel_by_pixel() {
        let size = 3 * SIDE - 5; // no whole number of tiles
        let tile = |tx: usize, ty: usize| {
            let mut made = TileParts::default();
            for pixel in 0..SIDE * SIDE {
                let (x, y) = (tx * SIDE + pixel % SIDE, ty * SIDE + pixel / SIDE);
                let count = count(x, y, size);
                made.counts[pixel] = count as u32;
                made.parts
                    .extend((0..count).map(|number| part(x, y, number)));
            }
            made
        };
        let mut face = FaceParts {
            size_px: size as u32,
            offsets: vec![0],
            parts: Vec::new(),
        };
        for rows in [0..2, 2..3] {
            let tiles: Vec<TileParts> = rows
                .flat_map(|ty| (0..3).map(move |tx| (tx, ty)))
                .map(|(x, y)| tile(x, y))
                .collect();
            append(&mut face, &tiles, 3);
        }
        assert_eq!(face.offsets.len(), size * size + 1);
        for y in 0..size {
            for x in 0..size {
                let expected: Vec<LitPart> = (0..count(x, y, size))
                    .map(|number| part(x, y, number))
                    .collect();
                assert_eq!(face.pixel(x as u32, y as u32), expected, "pixel {x}, {y}");
            }
        }
        assert_eq!(face.parts.len(), face.offsets[size * size] as usize);
    }
}
