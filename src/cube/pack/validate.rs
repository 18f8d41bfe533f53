//! Validation of the render-time layout (S17, S22, S23).

use super::layout::{CubeLdi, PackedSegment, SegmentSide};
use super::packed_depth_pixel::{PackedDepthPixel, SplatIndexLayout};
use super::planes::MAX_TILE_PX;
use crate::model::validate::{LdiError, MAX_FACE_SIZE_PX};
use headbox_core::cube_face::Face;

/// Violation of the layout by a packed cube.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PackedError {
    /// The environment or the capture information is invalid.
    #[error(transparent)]
    Shared(#[from] LdiError),
    /// The faces are empty or too large.
    #[error("{0} pixels a side of each face; a side must lie between 1 and {MAX_FACE_SIZE_PX}")]
    FaceSize(u32),
    /// Segments are out of order (by face, far before near), or duplicate.
    #[error("segment {0} does not come after the one before it (by face, far before near)")]
    SegmentOrder(usize),
    /// A plane is not a finite vector.
    #[error("plane {0} has a coordinate that is not a finite number")]
    Plane(usize),
    /// A tile has an invalid rectangle, plane, face, texel range or flag.
    #[error("picture {0} on a plane: {1}")]
    Tile(usize, &'static str),
    /// The number of texels, or the error of plane textures, is wrong.
    #[error("pictures on planes: {0}")]
    PlaneTextures(&'static str),
    /// A violation inside one segment.
    #[error("face {} {side:?}: {problem}", face.name())]
    Segment {
        /// The segment's face.
        face: Face,
        /// Near or far.
        side: SegmentSide,
        /// Problem found.
        problem: SegmentProblem,
    },
}

/// Problem of a segment.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SegmentProblem {
    /// The segment has no samples.
    #[error("it holds no samples and should have been left out")]
    Empty,
    /// The rectangle is empty or extends beyond the face.
    #[error("its rectangle reaches beyond the face")]
    Rectangle,
    /// An edge of the rectangle has no samples.
    #[error("its rectangle is larger than its samples need")]
    LooseRectangle,
    /// The range of inverse depth is not positive, finite and ascending.
    #[error("inverse depths from {0} to {1}; they must be positive, finite and ascending")]
    InverseDepthRange(f32, f32),
    /// The near segment overlaps the far one in depth.
    #[error("it reaches behind the face's far segment, so that no plane separates them")]
    SplitPlane,
    /// The number of row offsets is not height + 1.
    #[error("{found} row offsets; expected {expected}")]
    RowOffsetCount {
        /// Entries found.
        found: usize,
        /// Entries expected.
        expected: usize,
    },
    /// The number of in-row counts is not height * (width + 1).
    #[error("{found} row counts; expected {expected}")]
    RowCountCount {
        /// Entries found.
        found: usize,
        /// Entries expected.
        expected: usize,
    },
    /// Row offsets do not start at 0, ascend, and end at the number of depth pixels.
    #[error("row {0}: its offset does not fit the depth pixels")]
    RowOffsets(u32),
    /// In-row counts do not start at 0, ascend, and end at the row's length.
    #[error("row {0}: its running counts do not fit its depth pixels")]
    RowCounts(u32),
    /// The unused bit is set, or the splat index is unused.
    #[error("depth pixel {0}: bits that mean nothing")]
    Bits(usize),
    /// A depth pixel is farther than the one before it.
    #[error("pixel ({x}, {y}) of its rectangle: depth pixels are not farthest first")]
    DepthOrder {
        /// Column in the rectangle.
        x: u32,
        /// Row in the rectangle.
        y: u32,
    },
}

impl CubeLdi {
    /// Checks the layout.
    ///
    /// # Errors
    /// The first violation.
    pub fn validate(&self) -> Result<(), PackedError> {
        self.info.validate()?;
        self.environment.validate().map_err(LdiError::from)?;
        if !(1..=MAX_FACE_SIZE_PX).contains(&self.face_size_px) {
            return Err(PackedError::FaceSize(self.face_size_px));
        }
        let key = |s: &PackedSegment| (s.face, s.side == SegmentSide::Near);
        let mut before: Option<&PackedSegment> = None;
        for (i, segment) in self.segments.iter().enumerate() {
            if before.is_some_and(|b| key(b) >= key(segment)) {
                return Err(PackedError::SegmentOrder(i));
            }
            let far = before.filter(|b| b.face == segment.face);
            segment
                .validate(self.face_size_px, self.layout, far)
                .map_err(|problem| PackedError::Segment {
                    face: segment.face,
                    side: segment.side,
                    problem,
                })?;
            before = Some(segment);
        }
        self.validate_planes()
    }

    fn validate_planes(&self) -> Result<(), PackedError> {
        let set = &self.planes;
        if let Some(i) = set
            .planes
            .iter()
            .position(|plane| !plane.normal_per_distance.is_finite())
        {
            return Err(PackedError::Plane(i));
        }
        let (mut texels, last) = (0, self.face_size_px as i32);
        for (i, tile) in set.tiles.iter().enumerate() {
            let wrong = |what| Err(PackedError::Tile(i, what));
            if tile.plane as usize >= set.planes.len() {
                return wrong("its plane is not there");
            }
            if usize::from(tile.face) >= Face::ALL.len() || tile.opaque > 1 {
                return wrong("its face or its flag means nothing");
            }
            let fits = |start: i16, length: u16| {
                start >= -1 && length >= 2 && i32::from(start) + i32::from(length) - 1 <= last
            };
            if !fits(tile.x0, tile.width) || !fits(tile.y0, tile.height) {
                return wrong(
                    "its rectangle is too small, or reaches beyond the pixels around its face",
                );
            }
            if tile.width.max(tile.height) > MAX_TILE_PX {
                return wrong("its rectangle is larger than those of any program");
            }
            if tile.first_texel as usize != texels {
                return wrong("its texels do not follow those of the one before it");
            }
            texels += tile.texel_count();
            let Some(tile_texels) = set.texels.get(tile.texel_range()) else {
                return wrong("its texels are not there");
            };
            if (tile.opaque == 1) != tile_texels.iter().all(|texel| texel[3] == 255) {
                return wrong("its flag for opacity is wrong");
            }
        }
        if texels != set.texels.len() {
            return Err(PackedError::PlaneTextures(
                "there are texels that belong to none",
            ));
        }
        if set.tiles.is_empty() != (set.error_px == 0.0)
            || !(set.error_px >= 0.0 && set.error_px.is_finite())
        {
            return Err(PackedError::PlaneTextures(
                "their error is positive and finite, or 0 if there are none",
            ));
        }
        Ok(())
    }
}

impl PackedSegment {
    /// Checks one segment; `far` is the far segment of the same face, if this is the near one.
    fn validate(
        &self,
        face_px: u32,
        layout: SplatIndexLayout,
        far: Option<&Self>,
    ) -> Result<(), SegmentProblem> {
        let (min, max) = (self.inverse_depth_min, self.inverse_depth_max);
        if !(min > 0.0 && min <= max && max.is_finite()) {
            return Err(SegmentProblem::InverseDepthRange(min, max));
        }
        if far.is_some_and(|far| far.inverse_depth_max >= min) {
            return Err(SegmentProblem::SplitPlane);
        }
        if self.depth_pixels.is_empty() {
            return Err(SegmentProblem::Empty);
        }
        let fits =
            |start: u32, length: u32| u64::from(start) + u64::from(length) <= u64::from(face_px);
        if self.width == 0
            || self.height == 0
            || !fits(self.x0, self.width)
            || !fits(self.y0, self.height)
        {
            return Err(SegmentProblem::Rectangle);
        }
        self.validate_tables()?;
        let is_invalid = |p: &PackedDepthPixel| {
            p.geometry >> 31 != 0 || p.splat_index() as usize >= layout.index_count()
        };
        if let Some(i) = self.depth_pixels.iter().position(is_invalid) {
            return Err(SegmentProblem::Bits(i));
        }
        for y in 0..self.height {
            for x in 0..self.width {
                if !self
                    .pixel(x, y)
                    .is_sorted_by_key(|p| p.inverse_depth_code())
                {
                    return Err(SegmentProblem::DepthOrder { x, y });
                }
            }
        }
        let is_row_used = |y: u32| !self.row(y).0.is_empty();
        let is_column_used = |x: u32| (0..self.height).any(|y| !self.pixel(x, y).is_empty());
        let is_tight = is_row_used(0)
            && is_row_used(self.height - 1)
            && is_column_used(0)
            && is_column_used(self.width - 1);
        is_tight.then_some(()).ok_or(SegmentProblem::LooseRectangle)
    }

    /// Checks row offsets and in-row counts.
    fn validate_tables(&self) -> Result<(), SegmentProblem> {
        let (width, height) = (self.width as usize, self.height as usize);
        if self.row_offsets.len() != height + 1 {
            return Err(SegmentProblem::RowOffsetCount {
                found: self.row_offsets.len(),
                expected: height + 1,
            });
        }
        let expected = height * (width + 1);
        if self.row_counts.len() != expected {
            return Err(SegmentProblem::RowCountCount {
                found: self.row_counts.len(),
                expected,
            });
        }
        if self.row_offsets[0] != 0 {
            return Err(SegmentProblem::RowOffsets(0));
        }
        if self.row_offsets[height] as usize != self.depth_pixels.len() {
            return Err(SegmentProblem::RowOffsets(self.height));
        }
        for (y, counts) in self.row_counts.chunks_exact(width + 1).enumerate() {
            let length = self.row_offsets[y + 1].checked_sub(self.row_offsets[y]);
            let length = length.ok_or(SegmentProblem::RowOffsets(y as u32))?;
            if counts[0] != 0 || counts[width] != length || !counts.is_sorted() {
                return Err(SegmentProblem::RowCounts(y as u32));
            }
        }
        Ok(())
    }
}
