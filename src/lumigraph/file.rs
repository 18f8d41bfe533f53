//! The `.lumi` file.
//!
//! Sections: `info` (JSON: the [`LumigraphInfo`], counts and sizes), `geometry` (14 `f64`: a point of the plane, axes by columns, focal
//! length in pixels, convergence; then the cameras' columns and rows), `layers` (two `f64` each: least and greatest
//! disparity), `environment` (texels as in `.ldi` files), `color` (RGB8) and `index` (one byte a pixel, or two), both image after
//! image, row by row of the grid from the lowest, row-major.

use super::{CameraGrid, DisparityLayer, GridParts, Lumigraph, LumigraphInfo, Picture};
use crate::container::{Container, ContainerWriter, FileError, FileKind, Section};
use crate::packed::file::read_environment;
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// A lumigraph.
pub const LUMI_FILE: FileKind = FileKind::LUMIGRAPH;

#[derive(Serialize, Deserialize)]
struct FileHeader {
    info: LumigraphInfo,
    environment_size_px: u32,
    columns: u32,
    rows: u32,
    width: u32,
    height: u32,
    layers: u32,
    /// Whether there are pixels of which nothing is known.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    unknown: bool,
}

/// Bytes of an index that tells infinity, some layers and, if there is any, what is not known apart.
pub(super) fn index_bytes(layers: usize, unknown: bool) -> usize {
    if layers + usize::from(unknown) < 256 { 1 } else { 2 }
}

/// Numbers of the section `geometry` before the cameras' places.
const GEOMETRY: usize = 14;

/// How far a stored rotation's products of columns may be from those of a rotation: what rounding leaves.
const ORTHONORMAL: f64 = 1e-6;

impl Lumigraph {
    /// Writes a `.lumi` file, whole or not at all.
    ///
    /// # Errors
    /// [`FileError::Io`].
    pub fn write(&self, path: &Path) -> Result<(), FileError> {
        let grid = self.grid();
        let [width, height] = grid.size_px();
        let header = FileHeader {
            info: self.info.clone(),
            environment_size_px: self.environment.size_px,
            columns: grid.columns().len() as u32,
            rows: grid.rows().len() as u32,
            width,
            height,
            layers: self.layers().len() as u32,
            unknown: self.unknown_pixels() > 0,
        };
        let mut writer = ContainerWriter::new(LUMI_FILE);
        writer.section("info", move || Ok(serde_json::to_vec(&header)?));
        writer.section("geometry", || {
            let mut numbers = [0.0; GEOMETRY];
            numbers[..3].copy_from_slice(&grid.origin().to_array());
            numbers[3..12].copy_from_slice(&grid.world_from_eye().to_cols_array());
            numbers[12..].copy_from_slice(&[grid.focal_px(), grid.convergence()]);
            Ok(bytemuck::cast_slice(&[&numbers, grid.columns(), grid.rows()].concat()).to_vec())
        });
        writer.section("layers", || {
            let ranges: Vec<[f64; 2]> = self.layers().iter().map(DisparityLayer::range).collect();
            Ok(bytemuck::cast_slice(&ranges).to_vec())
        });
        writer.section("environment", || Ok(bytemuck::cast_slice(&self.environment.texels).to_vec()));
        writer.section("color", || {
            Ok(self.pictures().iter().map(|picture| picture.color.as_flattened()).collect::<Vec<_>>().concat())
        });
        writer.section("index", || {
            let indices = self.pictures().iter().flat_map(|picture| &picture.index);
            Ok(match self.index_bytes() {
                1 => indices.map(|index| *index as u8).collect(),
                _ => indices.flat_map(|index| index.to_le_bytes()).collect(),
            })
        });
        writer.write(path)
    }

    /// Reads a `.lumi` file.
    ///
    /// # Errors
    /// See [`FileError`].
    pub fn read(path: &Path) -> Result<Self, FileError> {
        let file = Container::open(path, LUMI_FILE)?;
        let info_section = file.section("info")?;
        let header: FileHeader = info_section.json()?;
        if !header.info.frame.is_sane() {
            return Err(info_section.damaged("a unit between 1e-9 and 1e9 m", header.info.frame.unit_m.to_string()));
        }
        let grid = read_grid(file.section("geometry")?, &header)?;
        let mut section = file.section("layers")?;
        let ranges: Vec<[f64; 2]> = section.array(header.layers as usize)?;
        section.end()?;
        let layers: Vec<DisparityLayer> = ranges.into_iter().map(|[min, max]| DisparityLayer { min, max }).collect();
        let pictures = read_pictures(&file, &grid, index_bytes(layers.len(), header.unknown))?;
        let mut lumigraph =
            Self::new(grid, layers, pictures).map_err(|e| section.damaged("a consistent lumigraph", e.to_string()))?;
        lumigraph.environment = read_environment(file.section("environment")?, header.environment_size_px)?;
        lumigraph.info = header.info;
        Ok(lumigraph)
    }
}

fn read_grid(mut section: Section, header: &FileHeader) -> Result<CameraGrid, FileError> {
    let numbers: [f64; GEOMETRY] = section.values()?;
    let columns = section.array(header.columns as usize)?;
    let rows = section.array(header.rows as usize)?;
    section.end()?;
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

fn read_pictures(file: &Container, grid: &CameraGrid, index_bytes: usize) -> Result<Vec<Picture>, FileError> {
    let (pixels, mut color, mut index) = (grid.picture_pixels(), file.section("color")?, file.section("index")?);
    let mut pictures = Vec::new();
    for _ in 0..grid.camera_count() {
        let color = color.array(pixels)?;
        let index = match index_bytes {
            1 => index.array::<u8>(pixels)?.into_iter().map(u16::from).collect(),
            _ => index.array::<u16>(pixels)?,
        };
        pictures.push(Picture { color, index });
    }
    color.end()?;
    index.end()?;
    Ok(pictures)
}
