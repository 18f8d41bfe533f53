//! The end of a capture: light at kept hits, pooled over surfaces, merged into depth pixels, face by face.

use super::accumulate::DepthBins;
use super::build::Tracing;
use super::coverage::{AlphaMeasure, BinSpan};
use super::illuminate::{FaceSamples, ROUNDS, pool, sample};
use super::mend::Mender;
use super::merge::depth_pixels_of;
use super::parts::FaceParts;
use super::shade::{LitPart, Shader};
use super::store::TILE_PX;
use super::{CaptureInfo, CubeLdi, LayeredDepthImage};
use crate::capture::light::Lighting;
use crate::capture::rig::Face;
use crate::capture::trace::Tracer;
use crate::ldi::parameters::{CaptureSettings, Sampler};
use crate::progress::{Progress, check_cancelled};
use glam::Vec3;
use rayon::prelude::*;
use std::collections::VecDeque;
use std::io;

/// Lights and merges what was traced into a cube LDI. `info` is completed with the rays and the missing estimate.
///
/// # Errors
/// If spilled accumulators cannot be read.
pub fn finish(
    run: &Tracing,
    mut info: CaptureInfo,
    tracer: &Tracer,
    lighting: &Lighting,
    settings: &CaptureSettings,
    progress: &dyn Progress,
) -> io::Result<CubeLdi> {
    if settings.parameters.sampler != Sampler::CentreRays {
        let missing = run.plan.missing_estimate(&run.store)?;
        info.missing_estimate.iter_mut().zip(missing).for_each(|(slot, estimate)| *slot = Some(estimate));
    }
    (info.rays_traced, info.holes) = (run.rays, run.holes);
    if settings.resources.budget.is_some() {
        run.store.spill_all()?; // the LDI that now grows needs the memory
    }
    progress.begin("light and merge", "rows", 6 * (ROUNDS + 1) * u64::from(settings.face_size_px));
    let samples = settings.parameters.light_samples;
    let shader = Shader { tracer, lighting, samples, shape_only: false, face_size_px: settings.face_size_px };
    merge(run, info, &shader, settings, progress)
}

/// The same without light and colours, and without an end: more rays may be traced after it. For a look at what the rays so
/// far have found.
///
/// # Errors
/// If spilled accumulators cannot be read.
pub fn shape(
    run: &Tracing,
    info: CaptureInfo,
    tracer: &Tracer,
    lighting: &Lighting,
    settings: &CaptureSettings,
    progress: &dyn Progress,
) -> io::Result<CubeLdi> {
    let shader = Shader { tracer, lighting, samples: 0, shape_only: true, face_size_px: settings.face_size_px };
    merge(run, info, &shader, settings, progress)
}

fn merge(
    run: &Tracing,
    info: CaptureInfo,
    shader: &Shader,
    settings: &CaptureSettings,
    progress: &dyn Progress,
) -> io::Result<CubeLdi> {
    let Shader { tracer, lighting, .. } = *shader;
    let bins = DepthBins::new(settings.half_size_m, settings.face_size_px);
    let dark = Dark { run, shader, settings, bins: &bins, progress };
    let mut light = if shader.samples == 0 { None } else { Some(dark.sampled()?) };
    let rows_done = if light.is_some() { 1 } else { ROUNDS + 1 } * u64::from(settings.face_size_px);
    let mut faces = Vec::with_capacity(6);
    for face in Face::ALL {
        let parts = match &mut light {
            None => dark.face(face)?,
            Some(light) => dark.lit(face, light)?,
        };
        check_cancelled(progress)?;
        progress.advance(if shader.shape_only { 0 } else { rows_done });
        let (mut merged, spans) = merge_face(face, &parts, settings, &bins);
        drop(parts);
        let half_size_m = settings.half_size_m;
        let alphas = AlphaMeasure { tracer, bins: &bins, half_size_m, face: &merged, spans: &spans }.alphas();
        merged.samples.iter_mut().zip(alphas).for_each(|(sample, alpha)| sample.color_srgb[3] = alpha);
        faces.push(merged);
    }
    Ok(CubeLdi { info, faces, environment: run.misses.environment(lighting) })
}

/// Light samples of all faces, before any of them is pooled.
struct Sampled {
    samples: Vec<FaceSamples>,
    /// Of those that are not pooled yet.
    waiting: VecDeque<Waiting>,
}

/// What is kept of a face's parts while other faces are sampled.
enum Waiting {
    /// All of them.
    Parts(FaceParts),
    /// Where memory is short: the light straight from the sun; the rest is made again.
    Sun(Vec<Vec3>),
}

/// Makes the parts of faces.
struct Dark<'a> {
    run: &'a Tracing,
    shader: &'a Shader<'a>,
    settings: &'a CaptureSettings,
    bins: &'a DepthBins,
    progress: &'a dyn Progress,
}

impl Dark<'_> {
    /// The parts of a face without light, its gaps mended.
    fn face(&self, face: Face) -> io::Result<FaceParts> {
        let mut parts = dark_face(self.run, face, self.shader, self.progress)?;
        if self.settings.parameters.sampler != Sampler::CentreRays {
            let half_size_m = self.settings.half_size_m as f32;
            Mender { face, shader: self.shader, bins: self.bins, half_size_m }.mend(&mut parts);
        }
        Ok(parts)
    }

    /// Samples the light of all faces: walls go on across their borders.
    fn sampled(&self) -> io::Result<Sampled> {
        let is_short = self.settings.resources.budget.is_some();
        let mut sampled = Sampled { samples: Vec::with_capacity(6), waiting: VecDeque::with_capacity(6) };
        for face in Face::ALL {
            let mut parts = self.face(face)?;
            sampled.samples.push(sample(&mut parts, face, self.shader, self.progress));
            check_cancelled(self.progress)?;
            sampled.waiting.push_back(match is_short {
                true => Waiting::Sun(parts.parts.iter().map(|part| part.sun).collect()),
                false => Waiting::Parts(parts),
            });
        }
        Ok(sampled)
    }

    /// The parts of a face in its light.
    fn lit(&self, face: Face, light: &mut Sampled) -> io::Result<FaceParts> {
        let mut parts = match light.waiting.pop_front() {
            Some(Waiting::Parts(parts)) => parts,
            waiting => {
                let mut parts = self.face(face)?;
                if let Some(Waiting::Sun(sun)) = waiting {
                    parts.parts.iter_mut().zip(sun).for_each(|(part, sun)| part.sun = sun);
                }
                parts
            }
        };
        pool(&mut parts, face, &mut light.samples);
        Ok(parts)
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

/// Makes parts of all accumulators of a face, and forgets them unless only their shape is looked at: a row of tiles at a time, so that
/// the parts of a face are in memory only once.
fn dark_face(run: &Tracing, face: Face, shader: &Shader, progress: &dyn Progress) -> io::Result<FaceParts> {
    let size_px = shader.face_size_px;
    let per_row = run.store.tiles_per_side() as usize;
    let first = face.index() * per_row * per_row;
    let most: usize = (first..first + per_row * per_row).map(|tile| run.store.most_in_tile(tile)).sum();
    // Mending adds a few.
    let parts = Vec::with_capacity(most + most / 64);
    let mut made = FaceParts { size_px, offsets: vec![0], parts };
    for tile_row in 0..per_row {
        check_cancelled(progress)?;
        let tiles = first + tile_row * per_row..first + (tile_row + 1) * per_row;
        let tiles: io::Result<Vec<TileParts>> =
            tiles.into_par_iter().map(|tile| tile_parts(run, tile, shader)).collect();
        let mut tiles = tiles?;
        let y0 = tile_row as u32 * TILE_PX;
        for y in y0..(y0 + TILE_PX).min(size_px) {
            append_row(&mut made, &mut tiles, y);
        }
    }
    Ok(made)
}

fn tile_parts(run: &Tracing, tile: usize, shader: &Shader) -> io::Result<TileParts> {
    let (face, x0, y0) = run.store.tile_place(tile);
    let accumulators = run.store.tile_run(tile)?;
    if !shader.shape_only {
        run.store.clear_tile(tile);
    }
    let mut made = TileParts::default();
    for pixel in accumulators.chunk_by(|a, b| a.link == b.link) {
        let (x, y) = (x0 + pixel[0].link % TILE_PX, y0 + pixel[0].link / TILE_PX);
        made.pixels.push((x, y, pixel.len() as u32));
        made.parts.extend(pixel.iter().map(|acc| shader.part(acc, face, x, y)));
    }
    Ok(made)
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

/// Merges the parts of every pixel into depth pixels.
fn merge_face(
    face: Face,
    parts: &FaceParts,
    settings: &CaptureSettings,
    bins: &DepthBins,
) -> (LayeredDepthImage, Vec<BinSpan>) {
    let size_px = parts.size_px;
    let merge_row = |y: u32| {
        let (mut samples, mut counts) = (Vec::new(), Vec::with_capacity(size_px as usize));
        for x in 0..size_px {
            let before = samples.len();
            depth_pixels_of(parts.pixel(x, y), settings.parameters.merge_rule, bins, &mut samples);
            counts.push((samples.len() - before) as u32);
        }
        (samples, counts)
    };
    let rows: Vec<_> = (0..size_px).into_par_iter().map(merge_row).collect();
    let mut ldi = LayeredDepthImage::empty(face, size_px);
    let mut total = 0;
    for (slot, count) in ldi.offsets[1..].iter_mut().zip(rows.iter().flat_map(|row| &row.1)) {
        total += count;
        *slot = total;
    }
    let mut spans = Vec::with_capacity(total as usize);
    ldi.samples.reserve_exact(total as usize);
    for (sample, span) in rows.into_iter().flat_map(|row| row.0) {
        ldi.samples.push(sample);
        spans.push(span);
    }
    (ldi, spans)
}
