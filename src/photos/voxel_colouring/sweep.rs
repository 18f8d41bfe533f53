//! The march outward: keeps candidates of each shell and claims the pixels that they cover.

use super::evidence::{EvidenceRow, ShellViews};
use super::photograph::{Photograph, Projection};
use super::runs::{KeptCandidate, RunRow};
use super::{MIN_VIEWS, Pass, PhotographsJob};
use glam::DVec3;
use headbox_core::cube_face::Face;
use headbox_core::progress::Progress;
use headbox_cube::model::depth_bins::DepthBins;
use headbox_cube::model::samples::{DepthPixel, EncodedNormal, LayeredDepthImage};
use rayon::prelude::*;
use std::time::{Duration, Instant};

/// Voxel colouring in progress.
pub(super) struct Sweep {
    half_size_m: f64,
    face_size_px: u32,
    /// Photographs, the nearest first.
    photographs: Vec<Photograph>,
    faces: Vec<SweptFace>,
    /// True if runs may be open.
    may_have_runs: bool,
}

/// Face of the cube in progress.
struct SweptFace {
    face: Face,
    /// Projection of every photograph.
    projections: Vec<Projection>,
    /// Runs of every row.
    runs: Vec<RunRow>,
    kept: Vec<KeptCandidate>,
}

/// Number of a face's rows that represent all when work is estimated.
const SAMPLED_ROWS: usize = 64;

impl Sweep {
    pub(super) fn new(job: &PhotographsJob, photographs: Vec<Photograph>) -> Self {
        let swept_face = |face| SweptFace {
            face,
            projections: photographs
                .iter()
                .map(|one| one.projection(face, job.face_size_px))
                .collect(),
            runs: vec![RunRow::default(); job.face_size_px as usize],
            kept: Vec::new(),
        };
        let faces = Face::ALL.into_iter().map(swept_face).collect();
        Self {
            half_size_m: job.half_size_m,
            face_size_px: job.face_size_px,
            photographs,
            faces,
            may_have_runs: false,
        }
    }

    /// Size of the faces, pixels.
    pub(super) fn face_size_px(&self) -> u32 {
        self.face_size_px
    }

    /// Sweeps the shells at these eye depths in every pass; returns the six faces.
    pub(super) fn run(
        mut self,
        depths: &[f64],
        passes: &[Pass],
        progress: &dyn Progress,
    ) -> Vec<LayeredDepthImage> {
        let work: Vec<u64> = depths.par_iter().map(|depth| self.work(*depth)).collect();
        progress.begin(
            "colouring",
            "kilopixels",
            work.iter().sum::<u64>() * passes.len() as u64,
        );
        // A shell without any candidate in one pass has none in the next.
        let mut has_candidates = vec![true; depths.len()];
        for pass in passes {
            for (i, depth) in depths.iter().enumerate() {
                if progress.is_cancelled() {
                    break;
                }
                if has_candidates[i] {
                    has_candidates[i] = self.sweep_shell(*depth, pass);
                } else {
                    self.end_runs(pass);
                }
                progress.advance(work[i]);
            }
            self.end_runs(pass);
        }
        self.finish()
    }

    /// Estimates the time of [`Self::run`] from that of comparing colours on some shells.
    pub(super) fn estimate(&self, depths: &[f64], passes: &[Pass]) -> Duration {
        /// Number of shells that represent all.
        const SHELLS: usize = 16;
        /// Time of a sweep relative to that of comparing colours.
        const SWEEP: f64 = 1.15;
        let interval = (depths.len() / SHELLS).max(1);
        let start = Instant::now();
        for pass in passes {
            for depth in depths.iter().skip(interval / 2).step_by(interval) {
                for face in &self.faces {
                    drop(
                        face.views(&self.photographs, *depth, pass.min_views)
                            .evidence(pass),
                    );
                }
            }
        }
        start.elapsed().mul_f64(interval as f64 * SWEEP)
    }

    /// Interval of the rows that represent all.
    fn row_interval(&self) -> usize {
        (self.face_size_px as usize / SAMPLED_ROWS).max(1)
    }

    /// Returns the number of pixels, in thousands, that photographs contribute to the candidates of
    /// a shell, about.
    fn work(&self, depth: f64) -> u64 {
        let pixels: usize = self
            .faces
            .iter()
            .map(|face| {
                let views = face.views(&self.photographs, depth, MIN_VIEWS);
                let rows = views.rows().step_by(self.row_interval());
                rows.map(|row| views.pixels(row)).sum::<usize>() * self.row_interval()
            })
            .sum();
        1 + pixels as u64 / 1000
    }

    /// Sweeps the shell at an eye depth of the faces, metres; returns false if no candidate is
    /// consistent.
    fn sweep_shell(&mut self, depth: f64, pass: &Pass) -> bool {
        let mut has_candidates = false;
        let before: Vec<usize> = self.faces.iter().map(|face| face.kept.len()).collect();
        for face in &mut self.faces {
            let views = face.views(&self.photographs, depth, pass.min_views);
            let first = views.rows().start;
            let evidence = views.evidence(pass);
            has_candidates |= evidence.iter().any(|row| !row.is_empty());
            face.step(&evidence, first, depth, pass);
        }
        self.claim(&before);
        self.may_have_runs = has_candidates;
        has_candidates
    }

    /// Ends all runs at the end of a pass or where a shell is skipped: the best candidate of each
    /// is kept.
    fn end_runs(&mut self, pass: &Pass) {
        if !std::mem::take(&mut self.may_have_runs) {
            return;
        }
        let before: Vec<usize> = self.faces.iter().map(|face| face.kept.len()).collect();
        self.faces
            .iter_mut()
            .for_each(|face| face.step(&[], 0, f64::INFINITY, pass));
        self.claim(&before);
    }

    /// Claims the pixels that newly kept candidates cover, in every photograph taken from inside of
    /// their shell. `before` is the number of each face's earlier candidates.
    fn claim(&mut self, before: &[usize]) {
        let (faces, face_px) = (&self.faces, self.face_size_px);
        self.photographs.par_iter_mut().for_each(|photograph| {
            for (face, before) in faces.iter().zip(before) {
                for kept in &face.kept[*before..] {
                    let depth = 1.0 / f64::from(kept.inverse_depth);
                    if !photograph.is_inside(depth) {
                        continue;
                    }
                    let point = ray_through(face.face, kept.pixel, face_px) * depth;
                    if let Some([x, y]) = photograph.project(point) {
                        let reach = depth / f64::from(face_px) * photograph.pixels_per_metre(point);
                        photograph.claim(x as f32, y as f32, reach as f32);
                    }
                }
            }
        });
    }

    /// Returns the six faces. Candidates within one pixel of parallax along a ray are one surface,
    /// of which the nearest is kept.
    fn finish(self) -> Vec<LayeredDepthImage> {
        let similar = DepthBins::new(self.half_size_m, self.face_size_px).inverse_depth(1.0) as f32;
        let face_px = self.face_size_px;
        self.faces
            .into_iter()
            .map(|face| layers(face.face, face_px, face.kept, similar))
            .collect()
    }
}

impl SweptFace {
    /// Collects the photographs that see its shell at an eye depth, metres.
    fn views<'a>(
        &'a self,
        photographs: &'a [Photograph],
        depth: f64,
        min_views: usize,
    ) -> ShellViews<'a> {
        let side = self.runs.len();
        ShellViews::new(photographs, &self.projections, depth, side, min_views)
    }

    /// Continues the runs of all rows by the evidence of a shell, whose rows begin at `first`.
    fn step(&mut self, evidence: &[EvidenceRow], first: usize, depth: f64, pass: &Pass) {
        let side = self.runs.len();
        let step = |(row, runs): (usize, &mut RunRow)| {
            runs.step(evidence, first, row, side, (1.0 / depth) as f32, pass)
        };
        let kept: Vec<Vec<KeptCandidate>> =
            self.runs.par_iter_mut().enumerate().map(step).collect();
        kept.into_iter().for_each(|row| self.kept.extend(row));
    }
}

/// Makes a face's LDI of its kept candidates.
fn layers(
    face: Face,
    face_px: u32,
    mut kept: Vec<KeptCandidate>,
    similar: f32,
) -> LayeredDepthImage {
    // By pixel, the farthest first.
    kept.sort_by(|a, b| {
        a.pixel
            .cmp(&b.pixel)
            .then(a.inverse_depth.total_cmp(&b.inverse_depth))
    });
    let mut image = LayeredDepthImage::empty(face, face_px);
    for pixel in kept.chunk_by(|a, b| a.pixel == b.pixel) {
        let first = image.samples.len();
        let mut nearest = f32::INFINITY;
        for kept in pixel.iter().rev() {
            if nearest - kept.inverse_depth <= similar {
                continue;
            }
            nearest = kept.inverse_depth;
            let [r, g, b] = kept.color_srgb;
            let normal =
                EncodedNormal::new(-ray_through(face, kept.pixel, face_px).normalize().as_vec3());
            image.samples.push(DepthPixel {
                inverse_depth: kept.inverse_depth,
                normal,
                color_srgb: [r, g, b, 255],
            });
        }
        image.samples[first..].reverse();
        image.offsets[pixel[0].pixel as usize + 1] = (image.samples.len() - first) as u32;
    }
    let mut total = 0;
    for offset in &mut image.offsets {
        total += *offset;
        *offset = total;
    }
    image
}

/// Returns the ray through the centre of a pixel, at eye depth 1.
fn ray_through(face: Face, pixel: u32, face_px: u32) -> DVec3 {
    face.direction(
        f64::from(pixel % face_px) + 0.5,
        f64::from(pixel / face_px) + 0.5,
        face_px,
    )
}
