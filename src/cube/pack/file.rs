//! The `.ldi` file: a packed cube LDI.
//!
//! Sections: `info` (JSON: the [`CaptureInfo`], face size, splat-index layout and a header per
//! segment), `environment` (a PNG; bare texels before version 3), and for each segment with samples
//! one section named after its face and side, e.g. `+X far`: row offsets, row counts, depth pixels,
//! as they lie in memory.
//!
//! In cubes with plane textures (since version 2) the row counts are run-length encoded
//! ([`super::runs`]), and three sections are added: `planes` ([`Plane`]), `tiles` ([`PlaneTile`]),
//! and `texels`: three bytes of colour for each texel of all tiles, then a byte of alpha for each
//! texel of the tiles that are not opaque.

use super::plane_set::PlaneSet;
use super::planes::{Plane, PlaneTile};
use super::{BlockIndex, CubeLdi, PackedSegment, SegmentSide, SplatIndexLayout};
use crate::model::info::CaptureInfo;
use crate::model::validate::MAX_FACE_SIZE_PX;
use crate::pack::runs;
use headbox_core::container::{Container, ContainerWriter, FileError, FileKind, Section};
use headbox_core::cube_face::Face;
use headbox_core::environment::Environment;
use serde::{Deserialize, Serialize};
use std::io;
use std::path::Path;

/// File kind of cube LDIs.
pub const CUBE_LDI: FileKind = FileKind::CUBE_LDI;

/// Header of a cube LDI: all fields but the arrays.
#[derive(Serialize, Deserialize)]
pub struct CubeHeader {
    info: CaptureInfo,
    face_size_px: u32,
    layout: SplatIndexLayout,
    environment_size_px: u32,
    segments: Vec<SegmentHeader>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    planes: Option<PlanesHeader>,
}

/// Header of a [`PlaneSet`]: all fields but the arrays.
#[derive(Serialize, Deserialize)]
struct PlanesHeader {
    error_px: f64,
    samples: u64,
    planes: usize,
    tiles: usize,
    texels: usize,
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

impl CubeHeader {
    /// Checks the sizes of the arrays before any is read: at most one segment for each face and
    /// side, each a non-empty rectangle of a face.
    fn check(&self, section: &Section) -> Result<(), FileError> {
        let key = |segment: &SegmentHeader| (segment.face, segment.near);
        if !self.segments.is_sorted_by(|a, b| key(a) < key(b)) {
            return Err(section.damaged(
                "segments in the order of faces, far before near",
                "another order",
            ));
        }
        let face = u64::from(self.face_size_px.min(MAX_FACE_SIZE_PX));
        let fits = |start: u32, length: u32| u64::from(start) + u64::from(length) <= face;
        let is_wrong = |it: &&SegmentHeader| {
            !fits(it.x0, it.width) || !fits(it.y0, it.height) || it.depth_pixels == 0
        };
        if let Some(it) = self.segments.iter().find(is_wrong) {
            let found = format!(
                "{}x{} pixels, {} depth pixels",
                it.width, it.height, it.depth_pixels
            );
            return Err(section.damaged("a rectangle on a face with depth pixels in it", found));
        }
        Ok(())
    }
}

impl SegmentHeader {
    fn new(segment: &PackedSegment) -> Self {
        Self {
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

    /// Returns the face; `section` is that of the header, for the error.
    fn face(&self, section: &Section) -> Result<Face, FileError> {
        let face = Face::ALL.get(usize::from(self.face)).copied();
        face.ok_or_else(|| section.damaged("face numbers 0 to 5", self.face.to_string()))
    }
}

/// Returns the section name of a segment.
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

impl CubeLdi {
    /// Writes a `.ldi` file atomically.
    ///
    /// # Errors
    /// [`FileError::Io`].
    pub fn write(&self, path: &Path) -> Result<(), FileError> {
        self.writer().write(path)
    }

    /// Returns the size that the file of [`Self::write`] will have, bytes.
    ///
    /// # Errors
    /// If the header or the environment cannot be encoded.
    pub fn file_bytes(&self) -> io::Result<u64> {
        self.writer().size()
    }

    fn writer(&self) -> ContainerWriter<'_> {
        let header = self.header();
        let has_planes = !self.planes.tiles.is_empty();
        let mut writer = ContainerWriter::new(CUBE_LDI);
        writer.section("info", move || Ok(serde_json::to_vec(&header)?));
        writer.section("environment", || self.environment.to_section());
        for segment in &self.segments {
            let name = segment_name(segment.face, segment.side == SegmentSide::Near);
            writer.section(name, move || Ok(segment_bytes(segment, has_planes)));
        }
        if has_planes {
            writer.section("planes", || {
                Ok(bytemuck::cast_slice(&self.planes.planes).to_vec())
            });
            writer.section("tiles", || {
                Ok(bytemuck::cast_slice(&self.planes.tiles).to_vec())
            });
            writer.section("texels", || Ok(texel_bytes(&self.planes)));
        }
        writer
    }

    /// Reads and validates a `.ldi` file ([`CubeLdi::validate`]).
    ///
    /// # Errors
    /// See [`FileError`].
    pub fn read(path: &Path) -> Result<Self, FileError> {
        let file = Container::open(path, CUBE_LDI)?;
        let info_section = file.section("info")?;
        let header: CubeHeader = info_section.json()?;
        header.check(&info_section)?;
        let environment =
            Environment::from_section(file.section("environment")?, header.environment_size_px)?;
        let mut segments = Vec::with_capacity(header.segments.len());
        for segment in &header.segments {
            let face = segment.face(&info_section)?;
            let mut section = file.section(segment_name(face, segment.near))?;
            segments.push(read_segment(
                &mut section,
                face,
                segment,
                header.planes.is_some(),
            )?);
            section.end()?;
        }
        let planes = match &header.planes {
            Some(planes) => read_planes(&file, planes)?,
            None => PlaneSet::default(),
        };
        Self::assemble(header, segments, environment, planes, &info_section)
    }

    /// Builds the header of a file.
    pub fn header(&self) -> CubeHeader {
        CubeHeader {
            info: self.info.clone(),
            face_size_px: self.face_size_px,
            layout: self.layout,
            environment_size_px: self.environment.size_px,
            segments: self.segments.iter().map(SegmentHeader::new).collect(),
            planes: (!self.planes.tiles.is_empty()).then_some(PlanesHeader {
                error_px: self.planes.error_px,
                samples: self.planes.samples,
                planes: self.planes.planes.len(),
                tiles: self.planes.tiles.len(),
                texels: self.planes.texels.len(),
            }),
        }
    }

    /// Concatenates all arrays in the order of a `.ldi` file, for another file kind that stores the
    /// header elsewhere.
    pub fn arrays(&self) -> Vec<u8> {
        let mut bytes = bytemuck::cast_slice(&self.environment.texels).to_vec();
        let has_planes = !self.planes.tiles.is_empty();
        self.segments
            .iter()
            .for_each(|segment| bytes.extend(segment_bytes(segment, has_planes)));
        if has_planes {
            bytes.extend_from_slice(bytemuck::cast_slice(&self.planes.planes));
            bytes.extend_from_slice(bytemuck::cast_slice(&self.planes.tiles));
            bytes.extend(texel_bytes(&self.planes));
        }
        bytes
    }

    /// Reads the arrays of [`Self::arrays`], and validates the cube like [`Self::read`].
    pub fn from_arrays(header: CubeHeader, section: &mut Section) -> Result<Self, FileError> {
        header.check(section)?;
        let size_px = header.environment_size_px;
        let texels = section.array(environment_texel_count(size_px))?;
        let environment = Environment { size_px, texels };
        let segments = header.segments.iter().map(|segment| {
            let face = segment.face(section)?;
            read_segment(section, face, segment, header.planes.is_some())
        });
        let segments = segments.collect::<Result<_, _>>()?;
        let planes = match &header.planes {
            Some(planes) => read_plane_set(
                section.array(planes.planes)?,
                section.array(planes.tiles)?,
                section,
                planes,
            )?,
            None => PlaneSet::default(),
        };
        Self::assemble(header, segments, environment, planes, section)
    }

    fn assemble(
        header: CubeHeader,
        segments: Vec<PackedSegment>,
        environment: Environment,
        planes: PlaneSet,
        section: &Section,
    ) -> Result<Self, FileError> {
        let mut cube = Self {
            info: header.info,
            face_size_px: header.face_size_px,
            layout: header.layout,
            segments,
            environment,
            planes,
        };
        cube.validate()
            .map_err(|error| section.damaged("a consistent cube LDI", error.to_string()))?;
        cube.segments
            .iter_mut()
            .for_each(|segment| segment.blocks = segment.block_index());
        Ok(cube)
    }
}

/// Serialises row offsets, row counts (run-length encoded if `in_runs`) and depth pixels.
fn segment_bytes(segment: &PackedSegment, in_runs: bool) -> Vec<u8> {
    let runs;
    let counts: &[u8] = if in_runs {
        runs = runs::encode(segment);
        &runs
    } else {
        bytemuck::cast_slice(&segment.row_counts)
    };
    [
        bytemuck::cast_slice(&segment.row_offsets),
        counts,
        bytemuck::cast_slice(&segment.depth_pixels),
    ]
    .concat()
}

fn environment_texel_count(size_px: u32) -> usize {
    let size = size_px as usize;
    size.saturating_mul(size).saturating_mul(6)
}

/// Serialises the colours of all texels, then the alphas of the tiles that are not opaque.
fn texel_bytes(set: &PlaneSet) -> Vec<u8> {
    let mut bytes: Vec<u8> = set
        .texels
        .iter()
        .flat_map(|[r, g, b, _]| [*r, *g, *b])
        .collect();
    for tile in set.tiles.iter().filter(|tile| tile.opaque == 0) {
        bytes.extend(set.texels[tile.texel_range()].iter().map(|texel| texel[3]));
    }
    bytes
}

fn read_planes(file: &Container, header: &PlanesHeader) -> Result<PlaneSet, FileError> {
    let mut section = file.section("planes")?;
    let planes: Vec<Plane> = section.array(header.planes)?;
    section.end()?;
    let mut section = file.section("tiles")?;
    let tiles: Vec<PlaneTile> = section.array(header.tiles)?;
    section.end()?;
    let mut section = file.section("texels")?;
    let set = read_plane_set(planes, tiles, &mut section, header)?;
    section.end()?;
    Ok(set)
}

/// Reads the texels of plane textures from a section.
fn read_plane_set(
    planes: Vec<Plane>,
    tiles: Vec<PlaneTile>,
    section: &mut Section,
    header: &PlanesHeader,
) -> Result<PlaneSet, FileError> {
    let colors: Vec<[u8; 3]> = section.array(header.texels)?;
    let mut texels: Vec<[u8; 4]> = colors.into_iter().map(|[r, g, b]| [r, g, b, 255]).collect();
    for tile in tiles.iter().filter(|tile| tile.opaque == 0) {
        let alphas: Vec<u8> = section.array(tile.texel_count())?;
        let Some(tile_texels) = texels.get_mut(tile.texel_range()) else {
            return Err(section.damaged("tiles within the texels", "one beyond them"));
        };
        for (texel, alpha) in tile_texels.iter_mut().zip(alphas) {
            texel[3] = alpha;
        }
    }
    Ok(PlaneSet {
        error_px: header.error_px,
        samples: header.samples,
        planes,
        tiles,
        texels,
        ..PlaneSet::default()
    })
}

/// Reads a segment; `in_runs`: the row counts are run-length encoded.
fn read_segment(
    section: &mut Section,
    face: Face,
    header: &SegmentHeader,
    in_runs: bool,
) -> Result<PackedSegment, FileError> {
    let (width, height) = (header.width as usize, header.height as usize);
    let row_offsets = section.array(height.saturating_add(1))?;
    let row_counts = if in_runs {
        runs::decode(section, header.width, header.height)?
    } else {
        section.array(height.saturating_mul(width.saturating_add(1)))?
    };
    let depth_pixels = section.array(header.depth_pixels)?;
    Ok(PackedSegment {
        face,
        side: if header.near {
            SegmentSide::Near
        } else {
            SegmentSide::Far
        },
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
