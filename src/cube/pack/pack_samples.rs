//! Packing: from the build-time LDI to the 8-byte render-time one (S17, S22, S23).

use super::blocks::BlockIndex;
use super::layout::{CubeLdi, PackedSegment, SegmentSide};
use super::packed_depth_pixel::{INVERSE_DEPTH_CODE_MAX, PackedDepthPixel, SplatIndexLayout};
use super::plane_set::PlaneSet;
use super::splat_index::{DepthCodeRange, SplatCoder};
use crate::model::samples::{CubeSamples, DepthPixel, LayeredDepthImage};
use crate::model::validate::LdiError;
use rayon::prelude::*;
use std::ops::Range;

/// Split of each face into a near and a far segment (S23).
///
/// Clipping keeps, for each segment, the rectangle of face pixels that a view can show. A sample of
/// inverse depth q moves by q times the eye's displacement on the face (in units where a face is 2
/// wide), so the rectangle of a segment whose inverse depths span a range `dq` is wider than the
/// view itself by the displacement times `dq`. A split that makes the ranges short for many samples
/// lets clipping drop more.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Split {
    /// For each face, the split that minimises the expected number of depth pixels that a clipped
    /// view touches: the sum over both segments of `samples * min(4, (V + d * dq)^2)`, V = 1.15 the
    /// width of a 60-degree view on a face that is 2 wide, d = half of the headbox's half size, the
    /// mean displacement of an eye along an axis. 64 splits, equally spaced in inverse depth, are
    /// tried. A face is not split unless the best split saves at least 5 %.
    #[default]
    Auto,
    /// One segment per face, marked as near.
    None,
    /// Samples at this eye depth (metres, along each face's normal) or nearer are near.
    AtDepth(f64),
}

/// Error of packing a cube LDI.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PackError {
    /// The LDI violates its layout.
    #[error("the LDI is invalid: {0}")]
    Ldi(#[from] LdiError),
    /// The split depth is not a positive number.
    #[error("a split depth of {0} m; it must be positive and finite")]
    SplitDepth(f64),
}

impl CubeLdi {
    /// Packs a cube LDI: splits each face at its split plane, quantises, and builds the tables of
    /// each segment (S17).
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
        let pack_face = |face: &LayeredDepthImage| {
            // The least inverse depth of near samples.
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
            ldi.faces.par_iter().map(pack_face).collect();
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

/// Finds the smallest and largest inverse depth of the samples.
fn inverse_depth_range<'a>(samples: impl Iterator<Item = &'a DepthPixel>) -> Option<(f32, f32)> {
    samples
        .map(|s| (s.inverse_depth, s.inverse_depth))
        .reduce(|(min, max), (q, _)| (min.min(q), max.max(q)))
}

/// Finds the inverse depth at which [`Split::Auto`] splits a face; 0 for no split.
fn automatic_cut(face: &LayeredDepthImage, half_size_m: f64) -> f32 {
    const CUTS: usize = 64;
    const VIEW_WIDTH: f64 = 1.15;
    /// Largest relative cost of a worthwhile split.
    const MAX_COST: f64 = 0.95;
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
    let mut best = (touched(face.samples.len(), CUTS) * MAX_COST, 0.0);
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

/// Finds the bounding rectangle, as columns and rows, of the samples for which `belongs` returns
/// true; `None` if there are none.
fn bounding_rectangle(
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

/// Packs the samples of a face for which `belongs` returns true into a segment; `None` if there are
/// none.
fn pack_segment(
    face: &LayeredDepthImage,
    layout: SplatIndexLayout,
    side: SegmentSide,
    belongs: impl Fn(&DepthPixel) -> bool + Sync,
) -> Option<PackedSegment> {
    let (min, max) = inverse_depth_range(face.samples.iter().filter(|s| belongs(s)))?;
    let [columns, rows] = bounding_rectangle(face, &belongs)?;

    let range = DepthCodeRange::from_inverse_depths(min, max);
    let codes_per_inverse_depth = if max > min {
        f64::from(INVERSE_DEPTH_CODE_MAX) / (f64::from(max) - f64::from(min))
    } else {
        0.0
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
        let index = coder.encode(normal, toward, 1.0 / inverse_depth);
        PackedDepthPixel {
            geometry: index << 20 | code.min(INVERSE_DEPTH_CODE_MAX),
            color_srgb: sample.color_srgb,
        }
    };

    // The depth pixels of a row, and its running counts.
    let pack_row = |y: u32| {
        let mut coder = SplatCoder::new(layout, range);
        let (mut depth_pixels, mut counts) = (Vec::new(), vec![0]);
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
    let (depth_pixels, counts): (Vec<Vec<PackedDepthPixel>>, Vec<Vec<u32>>) =
        rows.clone().into_par_iter().map(pack_row).unzip();
    let mut row_offsets = vec![0];
    for row in &depth_pixels {
        // Lossless: a valid face has at most u32::MAX samples.
        row_offsets.push(row_offsets[row_offsets.len() - 1] + row.len() as u32);
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
        depth_pixels: depth_pixels.concat(),
        blocks: BlockIndex::default(),
    };
    segment.blocks = segment.block_index();
    Some(segment)
}
