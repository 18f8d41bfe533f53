//! From the build-time LDI to the 8-byte render-time one (S17, S22, S23).

use super::blocks::BlockIndex;
use super::depth_pixel::{INVERSE_DEPTH_CODE_MAX, PackedDepthPixel, SplatIndexLayout};
use super::layout::{CubeLdi, PackedSegment, SegmentSide};
use super::plane_set::PlaneSet;
use super::splat_index::{DepthCodeRange, SplatCoder};
use crate::model::samples::{CubeSamples, DepthPixel, LayeredDepthImage};
use crate::model::validate::LdiError;
use rayon::prelude::*;
use std::ops::Range;

/// Split of each face into a near and a far segment (S23).
///
/// Clipping keeps, of each segment, the rectangle of rays that a view can reach. A sample of
/// inverse depth q moves by q times the eye's displacement on the face (in units where a face is 2
/// wide), so the rectangle of a segment whose inverse depths span a range `dq` is wider than the
/// view itself by the displacement times `dq`. A cut that makes the ranges short for many samples
/// lets clipping drop more.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Split {
    /// For each face, the cut that minimises the depth pixels which a clipped view is expected to
    /// touch: the sum over both segments of `samples * min(4, (V + d * dq)^2)`, V = 1.15 the width
    /// of a 60-degree view on a face that is 2 wide, d = half of the headbox's half size, the mean
    /// displacement of an eye along an axis. 64 cuts, equally spaced in inverse depth, are tried. A
    /// face stays whole unless the best cut saves at least 5 %.
    #[default]
    Auto,
    /// No cut: one segment a face, filed as near.
    None,
    /// Samples at this eye depth (metres, along each face's normal) or nearer are near.
    AtDepth(f64),
}

/// Why a cube LDI cannot be packed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PackError {
    /// The LDI breaks a promise of its layout.
    #[error("the LDI is invalid: {0}")]
    Ldi(#[from] LdiError),
    /// The split depth is not a positive number.
    #[error("a split depth of {0} m; it must be positive and finite")]
    SplitDepth(f64),
}

impl CubeLdi {
    /// Packs a cube LDI: cuts each face at its split plane, quantises, and lays each segment out as
    /// S17 says.
    ///
    /// # Errors
    /// [`PackError`] if the LDI is invalid or the split depth is not positive and finite.
    pub fn pack(
        ldi: &CubeSamples,
        layout: SplatIndexLayout,
        split: Split,
    ) -> Result<Self, PackError> {
        if let Split::AtDepth(depth) = split
            && !(depth > 0.0 && depth.is_finite())
        {
            return Err(PackError::SplitDepth(depth));
        }
        ldi.validate()?;
        let segments_of = |face: &LayeredDepthImage| {
            // Near samples have an inverse depth of at least this.
            let cut = match split {
                Split::None => 0.0,
                Split::AtDepth(depth) => (1.0 / depth) as f32,
                Split::Auto => automatic_cut(face, ldi.info.half_size_m),
            };
            let far = || pack_segment(face, layout, SegmentSide::Far, |s| s.inverse_depth < cut);
            let near = || pack_segment(face, layout, SegmentSide::Near, |s| s.inverse_depth >= cut);
            <[_; 2]>::from(rayon::join(far, near))
        };
        let segments: Vec<[Option<PackedSegment>; 2]> =
            ldi.faces.par_iter().map(segments_of).collect();
        Ok(Self {
            info: ldi.info.clone(),
            face_size_px: ldi.faces.first().map_or(0, |f| f.size_px),
            layout,
            segments: segments.into_iter().flatten().flatten().collect(),
            environment: ldi.environment.clone(),
            planes: PlaneSet::default(),
        })
    }
}

/// Smallest and largest inverse depth of some samples.
fn inverse_depth_range<'a>(samples: impl Iterator<Item = &'a DepthPixel>) -> Option<(f32, f32)> {
    samples
        .map(|s| s.inverse_depth)
        .fold(None, |range, q| match range {
            None => Some((q, q)),
            Some((min, max)) => Some((min.min(q), max.max(q))),
        })
}

/// The inverse depth at which [`Split::Auto`] cuts a face; 0 leaves it whole.
fn automatic_cut(face: &LayeredDepthImage, half_size_m: f64) -> f32 {
    const CUTS: usize = 64;
    const VIEW_WIDTH: f64 = 1.15;
    const WORTHWHILE: f64 = 0.95;
    let Some((min, max)) = inverse_depth_range(face.samples.iter()) else {
        return 0.0;
    };
    let width = (f64::from(max) - f64::from(min)) / CUTS as f64;
    if width <= 0.0 {
        return 0.0;
    }
    let mut histogram = [0usize; CUTS];
    for sample in &face.samples {
        let bin = (f64::from(sample.inverse_depth) - f64::from(min)) / width;
        histogram[(bin as usize).min(CUTS - 1)] += 1;
    }
    let touched = |samples: usize, bins: usize| {
        let side = VIEW_WIDTH + 0.5 * half_size_m * bins as f64 * width;
        samples as f64 * (side * side).min(4.0)
    };
    let mut best = (touched(face.samples.len(), CUTS) * WORTHWHILE, 0.0);
    let mut far = 0;
    for cut in 1..CUTS {
        far += histogram[cut - 1];
        let cost = touched(far, cut) + touched(face.samples.len() - far, CUTS - cut);
        if cost < best.0 {
            best = (cost, f64::from(min) + cut as f64 * width);
        }
    }
    best.1 as f32
}

/// Columns and rows from the first to the last that have a sample for which `belongs` says so;
/// `None` if there is none.
fn occupied(
    face: &LayeredDepthImage,
    belongs: impl Fn(&DepthPixel) -> bool,
) -> Option<[Range<u32>; 2]> {
    let occupied = |x: u32, y: u32| face.pixel(x, y).iter().any(&belongs);
    let size = face.size_px as usize;
    let (mut columns, mut rows) = (face.size_px..0, face.size_px..0);
    for y in 0..face.size_px {
        let start = y as usize * size;
        if face.offsets[start] == face.offsets[start + size] {
            continue;
        }
        let Some(first) = (0..face.size_px).find(|&x| occupied(x, y)) else {
            continue;
        };
        columns.start = columns.start.min(first);
        let last = (columns.end.max(first)..face.size_px).rfind(|&x| occupied(x, y));
        columns.end = columns.end.max(last.map_or(0, |last| last + 1));
        rows = rows.start.min(y)..y + 1;
    }
    (!rows.is_empty()).then_some([columns, rows])
}

/// The segment of a face that holds the samples for which `belongs` says so, or `None` if there are
/// none.
fn pack_segment(
    face: &LayeredDepthImage,
    layout: SplatIndexLayout,
    side: SegmentSide,
    belongs: impl Fn(&DepthPixel) -> bool + Sync,
) -> Option<PackedSegment> {
    let (min, max) = inverse_depth_range(face.samples.iter().filter(|s| belongs(s)))?;
    let [columns, rows] = occupied(face, &belongs)?;

    let range = DepthCodeRange::from_inverse_depths(min, max);
    let codes_per_inverse_depth = match max > min {
        true => f64::from(INVERSE_DEPTH_CODE_MAX) / (f64::from(max) - f64::from(min)),
        false => 0.0,
    };
    let face_from_world = face.face.world_from_eye().transpose();
    let encode = |coder: &mut SplatCoder, sample: &DepthPixel, [x, y]: [u32; 2]| {
        let inverse_depth = f64::from(sample.inverse_depth);
        let code = ((inverse_depth - f64::from(min)) * codes_per_inverse_depth).round() as u32;
        let normal = face_from_world * sample.normal.decode().as_dvec3();
        let toward = face
            .face
            .direction(f64::from(x) + 0.5, f64::from(y) + 0.5, face.size_px);
        let toward = face_from_world * toward.normalize();
        let index = coder.code(normal, toward, 1.0 / inverse_depth);
        let geometry = index << 20 | code.min(INVERSE_DEPTH_CODE_MAX);
        PackedDepthPixel {
            geometry,
            color_srgb: sample.color_srgb,
        }
    };

    // Of a row, the depth pixels, and how many there are up to each column.
    let row = |y: u32| {
        let (mut depth_pixels, mut counts, mut coder) =
            (Vec::new(), vec![0], SplatCoder::new(layout, range));
        for x in columns.clone() {
            depth_pixels.extend(
                face.pixel(x, y)
                    .iter()
                    .filter(|s| belongs(s))
                    .map(|s| encode(&mut coder, s, [x, y])),
            );
            counts.push(depth_pixels.len() as u32);
        }
        (depth_pixels, counts)
    };
    let (of_rows, counts): (Vec<Vec<PackedDepthPixel>>, Vec<Vec<u32>>) =
        rows.clone().into_par_iter().map(row).unzip();
    let mut row_offsets = vec![0];
    for depth_pixels in &of_rows {
        // Lossless: a valid face has at most u32::MAX samples.
        row_offsets.push(row_offsets[row_offsets.len() - 1] + depth_pixels.len() as u32);
    }
    let mut segment = PackedSegment {
        face: face.face,
        side,
        x0: columns.start,
        y0: rows.start,
        width: columns.len() as u32,
        height: rows.len() as u32,
        inverse_depth_min: min,
        inverse_depth_max: max,
        row_offsets,
        row_counts: counts.concat(),
        depth_pixels: of_rows.concat(),
        blocks: BlockIndex::default(),
    };
    segment.blocks = segment.block_index();
    Some(segment)
}
