//! The march outward: which candidates of a shell are kept, and what those claim.

use super::evidence::{EvidenceRow, Witnesses};
use super::photograph::{Photograph, Projection};
use super::runs::{KeptCandidates, RunRow};
use super::{Pass, PhotographsJob};
use glam::DVec3;
use headbox_core::cube_face::Face;
use headbox_cube::model::depth_bins::DepthBins;
use headbox_cube::model::samples::{DepthPixel, EncodedNormal, LayeredDepthImage};
use rayon::prelude::*;

/// The cube so far.
pub(super) struct Sweep<'a> {
    job: &'a PhotographsJob,
    /// The nearest first.
    photographs: Vec<Photograph>,
    faces: Vec<SweptFace>,
    /// True if runs may still be open.
    may_run: bool,
}

/// One of its faces.
struct SweptFace {
    face: Face,
    /// Projection of every photograph.
    projections: Vec<Projection>,
    /// Runs of every row.
    runs: Vec<RunRow>,
    kept: Vec<KeptCandidates>,
}

impl<'a> Sweep<'a> {
    pub(super) fn new(job: &'a PhotographsJob, photographs: Vec<Photograph>) -> Self {
        let swept = |face| SweptFace {
            face,
            projections: photographs
                .iter()
                .map(|one| one.projection(face, job.face_size_px))
                .collect(),
            runs: vec![RunRow::default(); job.face_size_px as usize],
            kept: Vec::new(),
        };
        let faces = Face::ALL.into_iter().map(swept).collect();
        Self {
            job,
            photographs,
            faces,
            may_run: false,
        }
    }

    /// Sweeps the shell at an eye depth of the faces, metres; `false` if there is no evidence of
    /// any surface.
    pub(super) fn shell(&mut self, depth: f64, pass: &Pass) -> bool {
        let mut is_anything = false;
        let side = self.job.face_size_px as usize;
        let before: Vec<usize> = self.faces.iter().map(|face| face.kept.len()).collect();
        for face in &mut self.faces {
            let witnesses = Witnesses::new(
                &self.photographs,
                &face.projections,
                depth,
                side,
                pass.least_views,
            );
            let rows = witnesses.rows();
            let first = rows.start;
            let evidence: Vec<EvidenceRow> = rows
                .into_par_iter()
                .map(|row| witnesses.row(row, pass))
                .collect();
            is_anything |= evidence.iter().any(|row| !row.is_empty());
            face.step(&evidence, first, depth, pass);
        }
        self.claim(&before);
        self.may_run = is_anything;
        is_anything
    }

    /// Ends all runs, at the end of a pass or where a shell is passed over: the best of each is
    /// kept.
    pub(super) fn end(&mut self, pass: &Pass) {
        if !std::mem::take(&mut self.may_run) {
            return;
        }
        let before: Vec<usize> = self.faces.iter().map(|face| face.kept.len()).collect();
        self.faces
            .iter_mut()
            .for_each(|face| face.step(&[], 0, f64::INFINITY, pass));
        self.claim(&before);
    }

    /// Claims what candidates cover, those that faces kept beyond `before`, in every photograph
    /// that is asked for their colours.
    fn claim(&mut self, before: &[usize]) {
        let (faces, face_px) = (&self.faces, self.job.face_size_px);
        self.photographs.par_iter_mut().for_each(|photograph| {
            for (face, before) in faces.iter().zip(before) {
                for kept in &face.kept[*before..] {
                    let depth = 1.0 / f64::from(kept.inverse_depth);
                    if !photograph.is_inside(depth) {
                        continue;
                    }
                    let point = middle(face.face, kept.pixel, face_px) * depth;
                    if let Some([x, y]) = photograph.project(point) {
                        let reach = depth / f64::from(face_px) * photograph.pixels_a_metre(point);
                        photograph.claim(x as f32, y as f32, reach as f32);
                    }
                }
            }
        });
    }

    /// The six faces. What lies within one pixel of parallax along a ray is one surface: the
    /// nearest of it stays.
    pub(super) fn finish(self) -> Vec<LayeredDepthImage> {
        let similar =
            DepthBins::new(self.job.half_size_m, self.job.face_size_px).inverse_depth(1.0) as f32;
        let face_px = self.job.face_size_px;
        self.faces
            .into_iter()
            .map(|face| layers(face.face, face_px, face.kept, similar))
            .collect()
    }
}

impl SweptFace {
    /// Takes in the evidence of a shell, of rows from `first` on.
    fn step(&mut self, evidence: &[EvidenceRow], first: usize, depth: f64, pass: &Pass) {
        let side = self.runs.len();
        let with_evidence = first..first + evidence.len();
        let step = |(row, runs): (usize, &mut RunRow)| {
            let is_idle = !runs.may_end() && !with_evidence.contains(&row);
            if is_idle {
                Vec::new()
            } else {
                runs.step(evidence, first, row, side, (1.0 / depth) as f32, pass)
            }
        };
        let kept: Vec<Vec<KeptCandidates>> =
            self.runs.par_iter_mut().enumerate().map(step).collect();
        kept.into_iter().for_each(|row| self.kept.extend(row));
    }
}

/// A face of what was kept.
fn layers(
    face: Face,
    face_px: u32,
    mut kept: Vec<KeptCandidates>,
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
        for kept in pixel.iter().rev().filter(|kept| {
            let is_distinct = nearest - kept.inverse_depth > similar;
            nearest = if is_distinct {
                kept.inverse_depth
            } else {
                nearest
            };
            is_distinct
        }) {
            let [r, g, b] = kept.color_srgb;
            let normal =
                EncodedNormal::new(-middle(face, kept.pixel, face_px).normalize().as_vec3());
            let sample = DepthPixel {
                inverse_depth: kept.inverse_depth,
                normal,
                color_srgb: [r, g, b, 255],
            };
            image.samples.push(sample);
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

/// The ray through the middle of a pixel, at eye depth 1.
fn middle(face: Face, pixel: u32, face_px: u32) -> DVec3 {
    face.direction(
        f64::from(pixel % face_px) + 0.5,
        f64::from(pixel / face_px) + 0.5,
        face_px,
    )
}
