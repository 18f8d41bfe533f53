//! The tables of the packed LDI (S17, S22).

use super::blocks::BlockIndex;
use super::packed_depth_pixel::{PackedDepthPixel, SplatIndexLayout};
use super::plane_set::PlaneSet;
use crate::model::info::CaptureInfo;
use headbox_core::cube_face::Face;
use headbox_core::environment::Environment;

/// Side of the face's split plane on which a segment lies (S23).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SegmentSide {
    /// Behind the split plane.
    Far,
    /// Between the centre and the split plane.
    Near,
}

/// The near or the far part of one face.
///
/// A segment covers the bounding rectangle of its samples in face pixels. For example, a rectangle
/// of 3x2 pixels with 2, 0, 1 samples in its upper row and 1, 1, 3 in its lower row:
///
/// ```text
/// row_offsets  [ 0, 3, 8 ]                    one per row, and the end
/// row_counts   [ 0, 2, 2, 3,   0, 1, 2, 5 ]   width + 1 a row: samples of the row before pixel x
/// pixel (x, y) = depth_pixels[row_offsets[y] + row_counts[y*4 + x] .. row_offsets[y] + row_counts[y*4 + x + 1]]
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct PackedSegment {
    /// The face.
    pub face: Face,
    /// Near or far.
    pub side: SegmentSide,
    /// Left edge of the rectangle on the face, pixels.
    pub x0: u32,
    /// Upper edge of the rectangle on the face, pixels.
    pub y0: u32,
    /// Width of the rectangle, pixels; 0 for a segment without samples.
    pub width: u32,
    /// Height of the rectangle, pixels.
    pub height: u32,
    /// Inverse depth of code 0, 1/m.
    pub inverse_depth_min: f32,
    /// Inverse depth of the largest code, 2^20 - 1.
    pub inverse_depth_max: f32,
    /// `height + 1` entries: first depth pixel of each row, and the end.
    pub row_offsets: Vec<u32>,
    /// `height * (width + 1)` entries: running counts inside each row.
    pub row_counts: Vec<u32>,
    /// Rows from top to bottom, pixels from left to right, farthest first inside a pixel.
    pub depth_pixels: Vec<PackedDepthPixel>,
    /// Depth ranges of blocks, derived from the other fields, for clipping.
    pub blocks: BlockIndex,
}

/// A packed cube LDI: the content of a `.ldi` file and the input of the renderer.
#[derive(Clone, Debug, PartialEq)]
pub struct CubeLdi {
    /// Header of the capture.
    pub info: CaptureInfo,
    /// Pixels a side of each face.
    pub face_size_px: u32,
    /// Layout of the splat indices of all segments.
    pub layout: SplatIndexLayout,
    /// Segments with samples, ordered by face, far before near.
    pub segments: Vec<PackedSegment>,
    /// Background of all faces.
    pub environment: Environment,
    /// Plane textures; the segments hold the other samples.
    pub planes: PlaneSet,
}
