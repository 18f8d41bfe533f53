//! The `.lumi` file.
//!
//! Sections: `info` (JSON: the [`LumigraphInfo`], counts and sizes), `geometry` (14 `f64`: a point
//! of the plane, axes by columns, focal length in pixels, convergence; then the cameras' columns
//! and rows), `layers` (two `f64` each: smallest and largest disparity), `environment` (texels as
//! in `.ldi` files), `color` (RGB8) and `index` (one byte per pixel, or two), both image after
//! image, row by row of the grid from the lowest, row-major. With several light slabs, each section
//! except `info` and `environment` contains all of them, slab after slab.

use super::{CameraGrid, DisparityLayer, GridParts, Lumigraph, LumigraphInfo, Picture};
use crate::make::slabs::{MAX_SLABS, Slabs};
use glam::{DMat3, DVec3};
use headbox_core::container::{Container, ContainerWriter, FileError, FileKind, Section};
use headbox_core::environment::Environment;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Kind of the `.lumi` file.
pub const LUMI_FILE: FileKind = FileKind::LUMIGRAPH;

#[derive(Serialize, Deserialize)]
struct FileHeader {
    info: LumigraphInfo,
    environment_size_px: u32,
    #[serde(flatten)]
    first: SlabHeader,
    /// Slabs after the first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    others: Vec<SlabHeader>,
}

#[derive(Serialize, Deserialize)]
struct SlabHeader {
    columns: u32,
    rows: u32,
    width: u32,
    height: u32,
    layers: u32,
    /// True if there are unknown pixels.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    unknown: bool,
}

impl SlabHeader {
    fn new(slab: &Lumigraph) -> Self {
        let grid = slab.grid();
        let [width, height] = grid.size_px();
        Self {
            columns: grid.columns().len() as u32,
            rows: grid.rows().len() as u32,
            width,
            height,
            layers: slab.layers().len() as u32,
            unknown: slab.unknown_pixels() > 0,
        }
    }
}

/// Returns the size of an index that distinguishes infinity, `layers` layers and, if there are any,
/// unknown pixels, bytes.
pub(super) fn index_bytes(layers: usize, unknown: bool) -> usize {
    if layers + usize::from(unknown) < 256 {
        1
    } else {
        2
    }
}

/// Number of values of the section `geometry` before the camera positions.
const GEOMETRY: usize = 14;

/// Tolerance of a stored rotation's column products: rounding errors.
const ORTHONORMAL: f64 = 1e-6;

impl Lumigraph {
    /// Writes a `.lumi` file of this slab alone, completely or not at all.
    ///
    /// # Errors
    /// [`FileError::Io`].
    pub fn write(&self, path: &Path) -> Result<(), FileError> {
        write(&[self], path)
    }

    /// Reads a `.lumi` file of one light slab.
    ///
    /// # Errors
    /// See [`FileError`]; [`FileError::Damaged`] if there are several slabs, which [`Slabs::read`]
    /// reads.
    pub fn read(path: &Path) -> Result<Self, FileError> {
        let slabs = Slabs::read(path)?;
        let count = slabs.all().len();
        if let Some(slab) = slabs.into_single() {
            return Ok(slab);
        }
        let info = Container::open(path, LUMI_FILE)?.section("info")?;
        Err(info.damaged("one light slab", count.to_string()))
    }
}

impl Slabs {
    /// Writes a `.lumi` file, completely or not at all.
    ///
    /// # Errors
    /// [`FileError::Io`].
    pub fn write(&self, path: &Path) -> Result<(), FileError> {
        write(&self.all().iter().collect::<Vec<_>>(), path)
    }

    /// Reads a `.lumi` file.
    ///
    /// # Errors
    /// See [`FileError`].
    pub fn read(path: &Path) -> Result<Self, FileError> {
        let file = Container::open(path, LUMI_FILE)?;
        let info_section = file.section("info")?;
        let FileHeader {
            info,
            environment_size_px,
            first,
            others,
        } = info_section.json()?;
        if !info.frame.is_sane() {
            return Err(info_section.damaged(
                "a unit between 1e-9 and 1e9 m",
                info.frame.unit_m.to_string(),
            ));
        }
        if others.len() >= MAX_SLABS {
            return Err(info_section.damaged(
                format!("at most {MAX_SLABS} slabs"),
                (others.len() + 1).to_string(),
            ));
        }
        let [mut geometry, mut layers, mut color, mut index] = [
            file.section("geometry")?,
            file.section("layers")?,
            file.section("color")?,
            file.section("index")?,
        ];
        let mut slabs = Vec::new();
        for header in std::iter::once(&first).chain(&others) {
            let grid = read_grid(&mut geometry, header)?;
            let ranges: Vec<[f64; 2]> = layers.array(header.layers as usize)?;
            let bytes = index_bytes(ranges.len(), header.unknown);
            let pictures = read_pictures([&mut color, &mut index], &grid, bytes)?;
            let slab_layers = ranges
                .into_iter()
                .map(|[min, max]| DisparityLayer { min, max });
            let slab = Lumigraph::new(grid, slab_layers.collect(), pictures);
            slabs.push(slab.map_err(|e| layers.damaged("a consistent lumigraph", e.to_string()))?);
        }
        [&geometry, &layers, &color, &index]
            .into_iter()
            .try_for_each(Section::end)?;
        let environment =
            Environment::from_section(file.section("environment")?, environment_size_px)?;
        (slabs[0].info, slabs[0].environment) = (info, environment);
        Self::new(slabs).map_err(|e| info_section.damaged("light slabs", e.to_string()))
    }
}

/// Writes slabs; info and environment of the first are those of all.
fn write(slabs: &[&Lumigraph], path: &Path) -> Result<(), FileError> {
    let [first, others @ ..] = slabs else {
        return Ok(());
    };
    let header = FileHeader {
        info: first.info.clone(),
        environment_size_px: first.environment.size_px,
        first: SlabHeader::new(first),
        others: others.iter().map(|slab| SlabHeader::new(slab)).collect(),
    };
    let mut writer = ContainerWriter::new(LUMI_FILE);
    writer.section("info", move || Ok(serde_json::to_vec(&header)?));
    writer.section("geometry", || {
        Ok(slabs
            .iter()
            .flat_map(|slab| geometry(slab.grid()))
            .collect())
    });
    writer.section("layers", || {
        let layers = slabs.iter().flat_map(|slab| slab.layers());
        Ok(bytemuck::cast_slice(&layers.map(DisparityLayer::range).collect::<Vec<_>>()).to_vec())
    });
    writer.section("environment", || first.environment.to_section());
    writer.section("color", || {
        let pictures = slabs.iter().flat_map(|slab| slab.pictures());
        Ok(pictures
            .map(|picture| picture.color.as_flattened())
            .collect::<Vec<_>>()
            .concat())
    });
    writer.section("index", || {
        Ok(slabs.iter().flat_map(|slab| indices(slab)).collect())
    });
    writer.write(path)
}

fn geometry(grid: &CameraGrid) -> Vec<u8> {
    let mut numbers = [0.0; GEOMETRY];
    numbers[..3].copy_from_slice(&grid.origin().to_array());
    numbers[3..12].copy_from_slice(&grid.world_from_eye().to_cols_array());
    numbers[12..].copy_from_slice(&[grid.focal_px(), grid.convergence()]);
    bytemuck::cast_slice(&[&numbers, grid.columns(), grid.rows()].concat()).to_vec()
}

fn indices(slab: &Lumigraph) -> Vec<u8> {
    let indices = slab.pictures().iter().flat_map(|picture| &picture.index);
    match slab.index_bytes() {
        1 => indices.map(|index| *index as u8).collect(),
        _ => indices.flat_map(|index| index.to_le_bytes()).collect(),
    }
}

fn read_grid(section: &mut Section, header: &SlabHeader) -> Result<CameraGrid, FileError> {
    let numbers: [f64; GEOMETRY] = section.values()?;
    let columns = section.array(header.columns as usize)?;
    let rows = section.array(header.rows as usize)?;
    let vector = |i: usize| DVec3::new(numbers[i], numbers[i + 1], numbers[i + 2]);
    let axes = DMat3::from_cols(vector(3), vector(6), vector(9));
    let off = (axes.transpose() * axes - DMat3::IDENTITY).to_cols_array();
    if !off.iter().all(|v| v.abs() < ORTHONORMAL) {
        return Err(section.damaged("a rotation", "another matrix"));
    }
    let parts = GridParts {
        origin: vector(0),
        world_from_eye: axes,
        columns,
        rows,
        focal_px: numbers[12],
        size_px: [header.width, header.height],
        convergence: numbers[13],
    };
    CameraGrid::new(parts).map_err(|e| section.damaged("a grid of cameras", e.to_string()))
}

fn read_pictures(
    [color, index]: [&mut Section; 2],
    grid: &CameraGrid,
    index_bytes: usize,
) -> Result<Vec<Picture>, FileError> {
    let pixels = grid.picture_pixels();
    let mut pictures = Vec::new();
    for _ in 0..grid.camera_count() {
        let color = color.array(pixels)?;
        let index = match index_bytes {
            1 => index
                .array::<u8>(pixels)?
                .into_iter()
                .map(u16::from)
                .collect(),
            _ => index.array::<u16>(pixels)?,
        };
        pictures.push(Picture { color, index });
    }
    Ok(pictures)
}
