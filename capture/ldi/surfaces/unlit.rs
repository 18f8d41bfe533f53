//! Builds the unlit surface samples of a face from accumulators.

use super::pixel_set::PixelSet;
use super::repair::repair_pinholes;
use super::rows::split_lengths;
use crate::accumulate::tile_store::TILE_PX;
use crate::light::shade::{Shader, SurfaceSample};
use crate::rays::trace_and_accumulate::TracedRays;
use crate::surfaces::surface_samples::FaceSurfaces;
use headbox_core::cube_face::Face;
use headbox_core::progress::check_cancelled;
use headbox_cube::model::parameters::Sampler;
use rayon::prelude::*;
use std::io;

/// Builds the unlit surface samples of faces.
pub(crate) struct UnlitFaces<'a> {
    pub(crate) tracing: &'a TracedRays,
    pub(crate) shader: &'a Shader<'a>,
}

impl UnlitFaces<'_> {
    /// Builds the samples of a face with its pinholes repaired: of all pixels, or only of a set.
    pub(crate) fn build(&self, face: Face, only: Option<&PixelSet>) -> io::Result<FaceSurfaces> {
        let mut surfaces = self.build_unrepaired(face, only)?;
        if self.shader.capture.spec.parameters.sampler != Sampler::CentreRays {
            repair_pinholes(&mut surfaces, face, self.shader);
        }
        Ok(surfaces)
    }

    /// Builds samples from the accumulators of a face, and clears the accumulators unless this is a
    /// geometry pass. A few rows of tiles are built at a time, so that a face is in memory only
    /// once.
    fn build_unrepaired(&self, face: Face, only: Option<&PixelSet>) -> io::Result<FaceSurfaces> {
        let store = &self.tracing.store;
        let capture = &self.shader.capture;
        let per_row = store.tiles_per_side as usize;
        let first = face.index() * per_row * per_row;
        let capacity: usize = match only {
            None => (first..first + per_row * per_row)
                .map(|tile| store.max_in_tile(tile))
                .sum(),
            Some(_) => 0,
        };
        let mut surfaces = FaceSurfaces {
            size_px: capture.spec.face_size_px,
            offsets: vec![0],
            // Untouched memory until a thread writes its rows there. Repair adds a few samples.
            samples: bytemuck::zeroed_vec(capacity + capacity / 64),
        };
        for tile_row in (0..per_row).step_by(TILE_ROWS_AT_ONCE) {
            check_cancelled(capture.options.progress)?;
            let end = per_row.min(tile_row + TILE_ROWS_AT_ONCE);
            let tiles = first + tile_row * per_row..first + end * per_row;
            let tiles: io::Result<Vec<TileSurfaces>> = tiles
                .into_par_iter()
                .map(|tile| self.build_tile(tile, only))
                .collect();
            append(&mut surfaces, &tiles?, per_row);
        }
        let count = surfaces.offsets.last().map_or(0, |&end| end as usize);
        surfaces.samples.truncate(count);
        Ok(surfaces)
    }

    fn build_tile(&self, tile: usize, only: Option<&PixelSet>) -> io::Result<TileSurfaces> {
        let Self { tracing, shader } = *self;
        let (face, x0, y0) = tracing.store.tile_origin(tile);
        let position = |pixel: u32| (x0 + pixel % TILE_PX, y0 + pixel / TILE_PX);
        let accumulators = match only {
            None => tracing.store.tile_run(tile)?,
            Some(only) => tracing.store.tile_run_where(tile, |pixel| {
                let (x, y) = position(pixel);
                only.contains(x, y)
            })?,
        };
        if !shader.geometry_only {
            tracing.store.clear_tile(tile);
        }
        let mut surfaces = TileSurfaces {
            counts: [0; SIDE * SIDE],
            samples: Vec::with_capacity(accumulators.len()),
        };
        for pixel in accumulators.chunk_by(|a, b| a.link == b.link) {
            let (x, y) = position(pixel[0].link);
            surfaces.counts[pixel[0].link as usize] = pixel.len() as u32;
            surfaces.samples.extend(
                pixel
                    .iter()
                    .map(|acc| shader.surface_sample(acc, face, x, y)),
            );
        }
        Ok(surfaces)
    }
}

/// Number of rows of tiles that are built before their samples move to the end of the face: enough
/// tiles for many threads.
const TILE_ROWS_AT_ONCE: usize = 4;

/// Pixels along a side of a tile.
const SIDE: usize = TILE_PX as usize;

/// The surface samples of one tile, row-major.
struct TileSurfaces {
    /// Number of samples of each pixel.
    counts: [u32; SIDE * SIDE],
    samples: Vec<SurfaceSample>,
}

/// Copies whole rows of tiles, `per_row` tiles each, to the end of the face, row of pixels by row
/// of pixels.
fn append(face: &mut FaceSurfaces, tiles: &[TileSurfaces], per_row: usize) {
    let size = face.size_px as usize;
    let pixels_before = face.offsets.len() - 1;
    let samples_before = face.offsets[pixels_before] as usize;
    let mut rest: Vec<&[SurfaceSample]> = tiles.iter().map(|tile| &*tile.samples).collect();
    let mut rows: Vec<Vec<&[SurfaceSample]>> = Vec::new();
    let mut total = samples_before as u32;
    for y in 0..(tiles.len() / per_row * SIDE).min(size - pixels_before / size) {
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
                .map(|(samples, length)| samples.split_off(..length).unwrap_or_default())
                .collect(),
        );
        let offset = |count: &u32| {
            total += count;
            total
        };
        face.offsets.extend(counts.flatten().take(size).map(offset));
    }
    if face.samples.len() < total as usize {
        face.samples
            .resize(total as usize, bytemuck::Zeroable::zeroed());
    }
    let lengths = rows.iter().map(|row| row.iter().map(|run| run.len()).sum());
    let places = split_lengths(&mut face.samples[samples_before..], lengths);
    places.into_par_iter().zip(&rows).for_each(|(place, row)| {
        let runs = split_lengths(place, row.iter().map(|run| run.len()));
        runs.into_iter()
            .zip(row)
            .for_each(|(place, run)| place.copy_from_slice(run));
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    /// Number of samples of a pixel; 0 beyond the face.
    fn count(x: usize, y: usize, size: usize) -> usize {
        if x < size && y < size {
            (x * 7 + y * 3) % 4
        } else {
            0
        }
    }

    /// Sample `number` of a pixel; its primitive identifies it.
    fn sample(x: usize, y: usize, number: usize) -> SurfaceSample {
        SurfaceSample {
            primitive: ((y * 1000 + x) * 10 + number) as u32,
            ..SurfaceSample::zeroed()
        }
    }

    #[test]
    fn appended_tiles_are_in_pixel_order() {
        let size = 3 * SIDE - 5; // not a whole number of tiles
        let tile = |tx: usize, ty: usize| {
            let mut made = TileSurfaces {
                counts: [0; SIDE * SIDE],
                samples: Vec::new(),
            };
            for pixel in 0..SIDE * SIDE {
                let (x, y) = (tx * SIDE + pixel % SIDE, ty * SIDE + pixel / SIDE);
                let count = count(x, y, size);
                made.counts[pixel] = count as u32;
                made.samples
                    .extend((0..count).map(|number| sample(x, y, number)));
            }
            made
        };
        let mut face = FaceSurfaces {
            size_px: size as u32,
            offsets: vec![0],
            samples: Vec::new(),
        };
        for rows in [0..2, 2..3] {
            let tiles: Vec<TileSurfaces> = rows
                .flat_map(|ty| (0..3).map(move |tx| (tx, ty)))
                .map(|(x, y)| tile(x, y))
                .collect();
            append(&mut face, &tiles, 3);
        }
        assert_eq!(face.offsets.len(), size * size + 1);
        for y in 0..size {
            for x in 0..size {
                let expected: Vec<SurfaceSample> = (0..count(x, y, size))
                    .map(|number| sample(x, y, number))
                    .collect();
                assert_eq!(face.pixel(x as u32, y as u32), expected, "pixel {x}, {y}");
            }
        }
        assert_eq!(face.samples.len(), face.offsets[size * size] as usize);
    }
}
