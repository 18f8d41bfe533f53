//! Header of a `.house` file, and its errors.

use crate::backdrop::{BackdropKind, BackdropQuality, PortalSide};
use crate::house::HouseError;
use glam::{DVec2, DVec3, Vec3};
use headbox_core::color::tone::ToneMap;
use headbox_core::container::{FileError, FileKind};
use headbox_core::file_frame::FileFrame;
use headbox_core::read_note::ReadNote;
use headbox_cube::pack::file::CubeHeader;
use headbox_scene::material::{Sampler, Texture};
use headbox_scene::scene::Scene;
use headbox_sprite::SpriteHeader;
use serde::{Deserialize, Serialize};

/// Kind of the `.house` file.
pub const HOUSE_FILE: FileKind = FileKind::HOUSE;

/// Error of reading a house.
#[derive(Debug, thiserror::Error)]
pub enum HouseFileError {
    /// The file cannot be read, or is damaged.
    #[error(transparent)]
    File(#[from] FileError),
    /// The model in the file is invalid.
    #[error("{}: {source}", path.display())]
    House {
        /// The file.
        path: std::path::PathBuf,
        /// Cause.
        source: HouseError,
    },
}

/// Content of a file except its arrays.
#[derive(Serialize, Deserialize)]
pub(super) struct HouseHeader {
    pub(super) name: String,
    #[serde(flatten)]
    pub(super) frame: FileFrame,
    pub(super) sun: Option<(Vec3, [f32; 3], f32)>,
    pub(super) sky: Option<[[f32; 3]; 3]>,
    /// Size of a sky image (columns, rows) and its rotation, degrees; it replaces `sky`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) sky_picture: Option<([u32; 2], f64)>,
    /// Tone curve of frames and backdrops; houses in older files are clipped at white.
    #[serde(default, skip_serializing_if = "is_clipped")]
    pub(super) tone: ToneMap,
    pub(super) headbox: Option<(DVec3, f64)>,
    pub(super) notes: Vec<ReadNote>,
    pub(super) positions: usize,
    pub(super) normals: usize,
    pub(super) texcoords: usize,
    pub(super) colors: usize,
    pub(super) triangles: usize,
    #[serde(default, skip_serializing_if = "is_zero")]
    pub(super) emission_texcoords: usize,
    #[serde(default, skip_serializing_if = "is_zero")]
    pub(super) opacities: usize,
    /// Width and height of each texture.
    pub(super) textures: Vec<[u32; 2]>,
    /// Sampler of each texture; empty if all have the default one.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) samplers: Vec<Sampler>,
    pub(super) materials: Vec<MaterialRecord>,
    pub(super) cells: Vec<CellRecord>,
    pub(super) portals: Vec<PortalRecord>,
    pub(super) outside: Option<u32>,
    pub(super) quality: BackdropQuality,
    pub(super) captures: Vec<CaptureRecord>,
}

#[derive(Serialize, Deserialize)]
pub(super) struct MaterialRecord {
    pub(super) name: String,
    pub(super) albedo: [f32; 3],
    pub(super) albedo_texture: Option<u32>,
    pub(super) emission: [f32; 3],
    pub(super) emission_texture: Option<u32>,
    pub(super) cutout: Option<(Option<u32>, f32)>,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(super) single_sided: bool,
}

fn is_clipped(tone: &ToneMap) -> bool {
    *tone == ToneMap::SrgbClipped
}

fn is_zero(count: &usize) -> bool {
    *count == 0
}

/// Returns true if a scene needs version 3.
pub(super) fn needs_version_3(scene: &Scene) -> bool {
    let is_plain = |texture: &Texture| texture.sampler() == Sampler::default();
    !scene.emission_texcoords.is_empty()
        || !scene.opacities.is_empty()
        || !scene.textures.iter().all(is_plain)
        || scene.materials.iter().any(|m| m.single_sided)
}

#[derive(Serialize, Deserialize)]
pub(super) struct CellRecord {
    pub(super) name: String,
    /// Corners, floor, ceiling.
    pub(super) space: Vec<(Vec<DVec2>, f64, f64)>,
    pub(super) triangles: [u32; 2],
}

#[derive(Serialize, Deserialize)]
pub(super) struct PortalRecord {
    pub(super) name: String,
    pub(super) cells: [u32; 2],
    pub(super) polygon: Vec<DVec3>,
}

#[derive(Serialize, Deserialize)]
pub(super) struct CaptureRecord {
    pub(super) at: PortalSide,
    pub(super) kind: BackdropKind,
    pub(super) content: Content,
}

#[derive(Serialize, Deserialize)]
pub(super) enum Content {
    Cubes(Vec<CubeHeader>),
    Textures { size: [u32; 2], places: Vec<DVec3> },
    Sprite(SpriteHeader),
}

/// Section of the sky image.
pub(super) const SKY: &str = "sky";

pub(super) fn section_name(number: usize) -> String {
    format!("c{number}")
}
