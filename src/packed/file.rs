//! The `.ldi` file: a packed cube LDI.
//!
//! Sections: `info` (JSON: the [`CaptureInfo`], face size, splat-index layout and a header per segment), `environment`
//! (texels), and for each segment with samples one section named after its face and side, e.g. `+X far`: row offsets,
//! row counts, depth pixels, as they lie in memory.

use super::{BlockIndex, PackedCube, PackedSegment, SegmentSide, SplatIndexLayout};
use crate::capture::rig::Face;
use crate::container::{Container, ContainerWriter, FileError, Kind, Section};
use crate::environment::Environment;
use crate::ldi::CaptureInfo;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// A cube LDI file.
pub const CUBE_LDI: Kind = Kind::CUBE_LDI;

/// What a cube LDI is but for its arrays.
#[derive(Serialize, Deserialize)]
pub(crate) struct Header {
    info: CaptureInfo,
    face_size_px: u32,
    layout: SplatIndexLayout,
    environment_size_px: u32,
    segments: Vec<SegmentHeader>,
}

#[derive(Serialize, Deserialize)]
struct SegmentHeader {
    face: u8,
    near: bool,
    x0: u32,
    y0: u32,
    width: u32,
    height: u32,
    inverse_depth_min: f32,
    inverse_depth_max: f32,
    depth_pixels: usize,
}

/// Section name of a segment.
fn segment_name(face: Face, near: bool) -> &'static str {
    const NAMES: [[&str; 2]; 6] = [
        ["+X far", "+X near"],
        ["-X far", "-X near"],
        ["+Y far", "+Y near"],
        ["-Y far", "-Y near"],
        ["+Z far", "+Z near"],
        ["-Z far", "-Z near"],
    ];
    NAMES[face.index()][usize::from(near)]
}

impl PackedCube {
    /// Writes a `.ldi` file, whole or not at all.
    ///
    /// # Errors
    /// [`FileError::Io`].
    pub fn write(&self, path: &Path) -> Result<(), FileError> {
        let header = self.header();
        let mut writer = ContainerWriter::new(CUBE_LDI);
        writer.section("info", move || Ok(serde_json::to_vec(&header)?));
        writer.section("environment", || Ok(bytemuck::cast_slice(&self.environment.texels).to_vec()));
        for segment in &self.segments {
            let name = segment_name(segment.face, segment.side == SegmentSide::Near);
            writer.section(name, || Ok(segment_arrays(segment).concat()));
        }
        writer.write(path)
    }

    /// Reads a `.ldi` file. Every table is checked against the others ([`PackedCube::validate`]), so that a renderer
    /// can rely on them.
    ///
    /// # Errors
    /// See [`FileError`].
    pub fn read(path: &Path) -> Result<Self, FileError> {
        let file = Container::open(path, CUBE_LDI)?;
        let info_section = file.section("info")?;
        let header: Header = info_section.json()?;
        let environment = read_environment(file.section("environment")?, header.environment_size_px)?;
        let mut segments = Vec::with_capacity(header.segments.len());
        for segment in &header.segments {
            let Some(&face) = Face::ALL.get(usize::from(segment.face)) else {
                return Err(info_section.damaged("face numbers 0 to 5", segment.face.to_string()));
            };
            let mut section = file.section(segment_name(face, segment.near))?;
            segments.push(read_segment(&mut section, face, segment)?);
            section.end()?;
        }
        Self::assemble(header, segments, environment, &info_section)
    }

    /// The header of a file.
    pub(crate) fn header(&self) -> Header {
        Header {
            info: self.info.clone(),
            face_size_px: self.face_size_px,
            layout: self.layout,
            environment_size_px: self.environment.size_px,
            segments: self.segments.iter().map(segment_header).collect(),
        }
    }

    /// All arrays of a cube one after the other, for a file of another kind that keeps its header elsewhere.
    pub(crate) fn arrays(&self) -> Vec<u8> {
        let mut bytes = bytemuck::cast_slice(&self.environment.texels).to_vec();
        self.segments.iter().flat_map(segment_arrays).for_each(|array| bytes.extend_from_slice(array));
        bytes
    }

    /// The inverse of [`Self::arrays`], checked as [`Self::read`] checks.
    pub(crate) fn from_arrays(header: Header, section: &mut Section) -> Result<Self, FileError> {
        let size_px = header.environment_size_px;
        let texels = section.array((size_px as usize).saturating_mul(size_px as usize).saturating_mul(6))?;
        let segments = header.segments.iter().map(|segment| {
            let face = Face::ALL.get(usize::from(segment.face)).copied();
            let face = face.ok_or_else(|| section.damaged("face numbers 0 to 5", segment.face.to_string()))?;
            read_segment(section, face, segment)
        });
        let segments = segments.collect::<Result<_, _>>()?;
        Self::assemble(header, segments, Environment { size_px, texels }, section)
    }

    fn assemble(
        header: Header,
        segments: Vec<PackedSegment>,
        environment: Environment,
        section: &Section,
    ) -> Result<Self, FileError> {
        let Header { info, face_size_px, layout, .. } = header;
        let mut cube = Self { info, face_size_px, layout, segments, environment, sheets: Default::default() };
        cube.validate().map_err(|error| section.damaged("a consistent cube LDI", error.to_string()))?;
        cube.segments.iter_mut().for_each(|segment| segment.blocks = BlockIndex::of(segment));
        Ok(cube)
    }
}

fn segment_arrays(segment: &PackedSegment) -> [&[u8]; 3] {
    let [offsets, counts] = [&segment.row_offsets, &segment.row_counts].map(|t| bytemuck::cast_slice::<u32, u8>(t));
    [offsets, counts, bytemuck::cast_slice(&segment.depth_pixels)]
}

fn segment_header(segment: &PackedSegment) -> SegmentHeader {
    SegmentHeader {
        face: segment.face.index() as u8,
        near: segment.side == SegmentSide::Near,
        x0: segment.x0,
        y0: segment.y0,
        width: segment.width,
        height: segment.height,
        inverse_depth_min: segment.inverse_depth_min,
        inverse_depth_max: segment.inverse_depth_max,
        depth_pixels: segment.depth_pixels.len(),
    }
}

fn read_environment(mut section: Section, size_px: u32) -> Result<Environment, FileError> {
    let texels = section.array((size_px as usize).saturating_mul(size_px as usize).saturating_mul(6))?;
    section.end()?;
    Ok(Environment { size_px, texels })
}

fn read_segment(section: &mut Section, face: Face, header: &SegmentHeader) -> Result<PackedSegment, FileError> {
    let (width, height) = (header.width as usize, header.height as usize);
    let row_offsets = section.array(height.saturating_add(1))?;
    let row_counts = section.array(height.saturating_mul(width.saturating_add(1)))?;
    let depth_pixels = section.array(header.depth_pixels)?;
    Ok(PackedSegment {
        face,
        side: if header.near { SegmentSide::Near } else { SegmentSide::Far },
        x0: header.x0,
        y0: header.y0,
        width: header.width,
        height: header.height,
        inverse_depth_min: header.inverse_depth_min,
        inverse_depth_max: header.inverse_depth_max,
        row_offsets,
        row_counts,
        depth_pixels,
        blocks: BlockIndex::default(),
    })
}
