//! The parts of a face before any light is on them.

use super::accumulate::DepthBins;
use super::build::Tracing;
use super::mend::Mender;
use super::parameters::{CaptureSettings, Sampler};
use super::parts::FaceParts;
use super::pixel_set::PixelSet;
use super::shade::{LitPart, Shader};
use super::store::TILE_PX;
use crate::capture::rig::Face;
use crate::progress::{Progress, check_cancelled};
use rayon::prelude::*;
use std::io;

/// Makes the parts of faces.
pub(super) struct Dark<'a> {
    pub(super) run: &'a Tracing,
    pub(super) shader: &'a Shader<'a>,
    pub(super) settings: &'a CaptureSettings,
    pub(super) bins: &'a DepthBins,
    pub(super) progress: &'a dyn Progress,
}

impl Dark<'_> {
    /// The parts of a face, its gaps mended: of all pixels, or only of some.
    pub(super) fn face(&self, face: Face, only: Option<&PixelSet>) -> io::Result<FaceParts> {
        let mut parts = self.unmended(face, only)?;
        if self.settings.parameters.sampler != Sampler::CentreRays {
            let half_size_m = self.settings.half_size_m as f32;
            Mender { face, shader: self.shader, bins: self.bins, half_size_m }.mend(&mut parts);
        }
        Ok(parts)
    }

    /// Makes parts of the accumulators of a face, and forgets them unless only their shape is looked at: a row of tiles at a time, so
    /// that the parts of a face are in memory only once.
    fn unmended(&self, face: Face, only: Option<&PixelSet>) -> io::Result<FaceParts> {
        let (store, size_px) = (&self.run.store, self.shader.face_size_px);
        let per_row = store.tiles_per_side() as usize;
        let first = face.index() * per_row * per_row;
        let mut parts = Vec::new();
        if only.is_none() {
            let most: usize = (first..first + per_row * per_row).map(|tile| store.most_in_tile(tile)).sum();
            // Mending adds a few.
            parts.reserve_exact(most + most / 64);
        }
        let mut made = FaceParts { size_px, offsets: vec![0], parts };
        for tile_row in 0..per_row {
            check_cancelled(self.progress)?;
            let tiles = first + tile_row * per_row..first + (tile_row + 1) * per_row;
            let tiles: io::Result<Vec<TileParts>> =
                tiles.into_par_iter().map(|tile| self.tile_parts(tile, only)).collect();
            let mut tiles = tiles?;
            let y0 = tile_row as u32 * TILE_PX;
            for y in y0..(y0 + TILE_PX).min(size_px) {
                append_row(&mut made, &mut tiles, y);
            }
        }
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
        let mut made = TileParts::default();
        for pixel in accumulators.chunk_by(|a, b| a.link == b.link) {
            let (x, y) = place(pixel[0].link);
            made.pixels.push((x, y, pixel.len() as u32));
            made.parts.extend(pixel.iter().map(|acc| shader.part(acc, face, x, y)));
        }
        Ok(made)
    }
}

/// The parts of one tile, row-major.
#[derive(Default)]
struct TileParts {
    /// Column, row and number of parts of each occupied pixel.
    pixels: Vec<(u32, u32, u32)>,
    parts: Vec<LitPart>,
    /// How many pixels and parts have been taken.
    taken: [usize; 2],
}

/// Moves row `y` of a row of tiles, from left to right, to the end of the face.
fn append_row(face: &mut FaceParts, tiles: &mut [TileParts], y: u32) {
    let start = face.offsets.len();
    face.offsets.resize(start + face.size_px as usize, 0);
    for tile in tiles {
        let [mut pixel, part] = tile.taken;
        let mut end = part;
        while let Some(&(x, _, count)) = tile.pixels.get(pixel).filter(|pixel| pixel.1 == y) {
            face.offsets[start + x as usize] = count;
            end += count as usize;
            pixel += 1;
        }
        face.parts.extend_from_slice(&tile.parts[part..end]);
        tile.taken = [pixel, end];
    }
    for p in start..face.offsets.len() {
        face.offsets[p] += face.offsets[p - 1];
    }
}
