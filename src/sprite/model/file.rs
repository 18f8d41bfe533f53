//! The `.sprite` file: one or many sprites with depth.
//!
//! Sections: `info` (JSON: the [`SpriteInfo`], the size of the environment and a header per
//! sprite), `environment` (as in `.ldi` files), `geometry` (18 `f64` per sprite: eye,
//! rotation by columns, focal length, plane, displacement scale), `color` (RGBA8, straight alpha)
//! and `depth` (stored displacements), both sprite after sprite, row-major.

use super::displacement::Values;
use crate::{
    Displacement, DisplacementFormat, Sprite, SpriteError, SpriteInfo, SpritePlane, SpriteSet,
    SpriteWithDepth,
};
use glam::{DMat3, DVec3};
use headbox_core::camera::{Camera, CameraError};
use headbox_core::container::{Container, ContainerWriter, FileError, FileKind, Section};
use headbox_core::environment::Environment;
use image::RgbaImage;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Kind of the `.sprite` file.
pub const SPRITE_FILE: FileKind = FileKind::SPRITES;

#[derive(Serialize, Deserialize)]
struct FileHeader {
    info: SpriteInfo,
    environment_size_px: u32,
    sprites: Vec<SpriteHeader>,
}

/// Header of a sprite in a file: sizes and format, without its arrays.
#[derive(Serialize, Deserialize)]
pub struct SpriteHeader {
    width: u32,
    height: u32,
    displacement_width: u32,
    displacement_height: u32,
    format: DisplacementFormat,
}

/// Number of values of a sprite in section `geometry`.
const GEOMETRY: usize = 18;

impl SpriteSet {
    /// Writes a `.sprite` file, completely or not at all.
    ///
    /// # Errors
    /// [`FileError::Io`].
    pub fn write(&self, path: &Path) -> Result<(), FileError> {
        let sprites = || self.sprites().iter().map(|prepared| prepared.sprite());
        let header = FileHeader {
            info: self.info.clone(),
            environment_size_px: self.environment.size_px,
            sprites: sprites().map(SpriteWithDepth::header).collect(),
        };
        let mut writer = ContainerWriter::new(SPRITE_FILE);
        writer.section("info", move || Ok(serde_json::to_vec(&header)?));
        writer.section("environment", || self.environment.to_section());
        writer.section("geometry", move || {
            Ok(bytemuck::cast_slice(&sprites().flat_map(geometry).collect::<Vec<f64>>()).to_vec())
        });
        writer.section("color", move || {
            Ok(sprites()
                .map(|s| s.sprite().color().as_raw().as_slice())
                .collect::<Vec<_>>()
                .concat())
        });
        writer.section("depth", move || {
            Ok(sprites()
                .map(|s| s.displacement().stored_bytes())
                .collect::<Vec<_>>()
                .concat())
        });
        writer.write(path)
    }

    /// Reads a `.sprite` file.
    ///
    /// # Errors
    /// See [`FileError`].
    pub fn read(path: &Path) -> Result<Self, FileError> {
        let file = Container::open(path, SPRITE_FILE)?;
        let info_section = file.section("info")?;
        let FileHeader {
            info,
            environment_size_px,
            sprites: headers,
        } = info_section.json()?;
        if !info.frame.is_sane() {
            return Err(info_section.damaged(
                "a unit between 1e-9 and 1e9 m",
                info.frame.unit_m.to_string(),
            ));
        }
        let environment =
            Environment::from_section(file.section("environment")?, environment_size_px)?;
        let [mut geometry, mut color, mut depth] = [
            file.section("geometry")?,
            file.section("color")?,
            file.section("depth")?,
        ];
        let mut sprites = Vec::new();
        for header in &headers {
            let numbers: [f64; GEOMETRY] = geometry.values()?;
            let pixels = color.array(header.color_bytes())?;
            let displacement = displacement(&mut depth, header, numbers[17] as f32)?;
            sprites.push(sprite(header, &numbers, pixels, displacement, &geometry)?);
        }
        [geometry, color, depth].iter().try_for_each(Section::end)?;
        let mut set = Self::new(sprites);
        (set.info, set.environment) = (info, environment);
        Ok(set)
    }
}

impl SpriteWithDepth {
    /// Returns the sizes and the format that reading [`Self::arrays`] needs.
    pub fn header(&self) -> SpriteHeader {
        let (width, height) = self.sprite().color().dimensions();
        let (displacement_width, displacement_height) = self.displacement().size();
        SpriteHeader {
            width,
            height,
            displacement_width,
            displacement_height,
            format: self.displacement().format(),
        }
    }

    /// Returns geometry, colour and displacement as one section of another kind of file.
    pub fn arrays(&self) -> Vec<u8> {
        let numbers = geometry(self);
        [
            bytemuck::cast_slice(&numbers),
            self.sprite().color().as_raw(),
            self.displacement().stored_bytes(),
        ]
        .concat()
    }

    /// Reads a sprite from the bytes of [`Self::arrays`].
    pub fn from_arrays(header: &SpriteHeader, section: &mut Section) -> Result<Self, FileError> {
        let numbers: [f64; GEOMETRY] = section.values()?;
        let pixels = section.array(header.color_bytes())?;
        let displacement = displacement(section, header, numbers[17] as f32)?;
        sprite(header, &numbers, pixels, displacement, section)
    }
}

impl SpriteHeader {
    fn color_bytes(&self) -> usize {
        (self.width as usize)
            .saturating_mul(self.height as usize)
            .saturating_mul(4)
    }
}

/// Assembles a sprite from its arrays; errors name `section`.
fn sprite(
    header: &SpriteHeader,
    numbers: &[f64; GEOMETRY],
    pixels: Vec<u8>,
    displacement: Displacement,
    section: &Section,
) -> Result<SpriteWithDepth, FileError> {
    let camera = camera(numbers, header).map_err(|e| section.damaged("a camera", e.to_string()))?;
    let color = RgbaImage::from_raw(header.width, header.height, pixels);
    let color = color.ok_or_else(|| section.damaged("a picture of its size", "another"))?;
    let plane = SpritePlane {
        normal: DVec3::new(numbers[13], numbers[14], numbers[15]),
        offset: numbers[16],
    };
    let is_unit = (plane.normal.length() - 1.0).abs() < ORTHONORMAL;
    let sprite = if is_unit {
        Sprite::new(color, camera, plane)
    } else {
        Err(SpriteError::NotFinite)
    };
    let sprite = sprite.and_then(|sprite| SpriteWithDepth::new(sprite, displacement));
    sprite.map_err(|e| section.damaged("a consistent sprite", e.to_string()))
}

fn geometry(sprite: &SpriteWithDepth) -> [f64; GEOMETRY] {
    let (camera, plane) = (sprite.sprite().camera(), sprite.sprite().plane());
    let mut numbers = [0.0; GEOMETRY];
    numbers[..3].copy_from_slice(&camera.eye().to_array());
    numbers[3..12].copy_from_slice(&camera.world_from_eye().to_cols_array());
    numbers[12] = camera.focal_px();
    numbers[13..16].copy_from_slice(&plane.normal.to_array());
    numbers[16] = plane.offset;
    numbers[17] = f64::from(sprite.displacement().scale());
    numbers
}

/// Tolerance of a stored rotation's column products and of a normal's length: accepts rounding
/// errors, but nothing that a renderer would notice.
const ORTHONORMAL: f64 = 1e-6;

fn camera(numbers: &[f64; GEOMETRY], header: &SpriteHeader) -> Result<Camera, CameraError> {
    let vector = |i: usize| DVec3::new(numbers[i], numbers[i + 1], numbers[i + 2]);
    let rotation = DMat3::from_cols(vector(3), vector(6), vector(9));
    let off = (rotation.transpose() * rotation - DMat3::IDENTITY).to_cols_array();
    if !vector(0).is_finite() {
        return Err(CameraError::NotFinite("eye"));
    }
    if !off.iter().all(|v| v.abs() < ORTHONORMAL) || !(1e-6..1e12).contains(&numbers[12]) {
        return Err(CameraError::NotFinite("rotation or focal length"));
    }
    Camera::from_parts(
        vector(0),
        rotation,
        numbers[12],
        header.width,
        header.height,
    )
}

fn displacement(
    section: &mut Section,
    header: &SpriteHeader,
    scale: f32,
) -> Result<Displacement, FileError> {
    let (width, height) = (header.displacement_width, header.displacement_height);
    let count = (width as usize).saturating_mul(height as usize);
    let values = match header.format {
        DisplacementFormat::I8 => Values::I8(section.array(count)?),
        DisplacementFormat::I16 => Values::I16(section.array(count)?),
        DisplacementFormat::F32 => Values::F32(section.array(count)?),
    };
    let checked = Displacement::from_stored(width, height, scale, values);
    checked.map_err(|error| section.damaged("a finite displacement per pixel", error.to_string()))
}
