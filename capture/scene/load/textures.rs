//! Texture files: decoding and sharing.

use super::named_files::find_file;
use super::notes::{Note, Notes};
use crate::material::{Sampler, Texture};
use headbox_core::color::srgb8_from_linear;
use headbox_core::files::InputFolder;
use headbox_core::image::codec::{self, PictureError};
use image::DynamicImage;
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Use of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Role {
    /// Colour, with its own alpha.
    Color,
    /// Opacity: the image's alpha if that varies, else its luminance.
    Mask,
    /// Opacity of the image that is the colour, too: its luminance if it is grey and its alpha does
    /// not vary, else nothing.
    GreyMask,
}

/// Use of an image as a texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct TextureUse {
    pub(super) role: Role,
    pub(super) sampler: Sampler,
}

impl From<Role> for TextureUse {
    fn from(role: Role) -> Self {
        Self {
            role,
            sampler: Sampler::default(),
        }
    }
}

/// Handle of a texture that was requested from a [`TextureTable`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Handle(usize);

/// Textures that the materials of a file use, each once. Textures of one image share its texels.
#[derive(Debug, Default)]
pub(super) struct TextureTable {
    /// Indices into `requests`.
    images: HashMap<(String, Role), usize>,
    requests: Vec<Request>,
    handles: HashMap<(usize, Sampler), Handle>,
    /// Request and sampler of each handle.
    textures: Vec<(usize, Sampler)>,
}

#[derive(Debug)]
struct Request {
    name: String,
    source: Source,
    role: Role,
}

#[derive(Debug)]
enum Source {
    File(PathBuf),
    Bytes(Vec<u8>),
    Absent(String),
}

/// Index of a decoded texture in the scene, and its range of alpha.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Slot {
    pub(super) index: u32,
    pub(super) least_alpha: u8,
    pub(super) greatest_alpha: u8,
}

impl Slot {
    /// Returns true if a part of the texture is below the threshold (0..=1) and a part is not. Only
    /// then is the alpha channel meaningful and a cut-out worth its cost.
    pub(super) fn is_cut_at(self, threshold: f32) -> bool {
        f32::from(self.least_alpha) < threshold * 255.0
            && f32::from(self.greatest_alpha) >= threshold * 255.0
    }
}

impl TextureTable {
    /// Requests the image file that a material in the folder `base` of the scene calls `written`.
    pub(super) fn file(
        &mut self,
        written: &str,
        base: &Path,
        scene: &InputFolder,
        texture_use: TextureUse,
        notes: &mut Notes,
    ) -> Handle {
        let (name, source) = match find_file(written, base, scene) {
            Ok(found) => {
                if found.is_renamed {
                    notes.add_named(Note::TextureRenamed, written);
                }
                // A material may spell the same path differently.
                let path = found.path.canonicalize().unwrap_or(found.path);
                notes.add_file(&path);
                (path.to_string_lossy().into_owned(), Source::File(path))
            }
            Err(cause) => (written.to_owned(), Source::Absent(cause)),
        };
        self.request(name, texture_use, || source)
    }

    /// Requests an image inside the scene's own file.
    pub(super) fn embedded(
        &mut self,
        name: &str,
        bytes: Result<&[u8], String>,
        texture_use: TextureUse,
    ) -> Handle {
        self.request(name.to_owned(), texture_use, || match bytes {
            Ok(bytes) => Source::Bytes(bytes.to_vec()),
            Err(cause) => Source::Absent(cause),
        })
    }

    fn request(
        &mut self,
        name: String,
        TextureUse { role, sampler }: TextureUse,
        source: impl FnOnce() -> Source,
    ) -> Handle {
        let next = self.requests.len();
        let request = *self.images.entry((name.clone(), role)).or_insert(next);
        if request == next {
            self.requests.push(Request {
                name,
                source: source(),
                role,
            });
        }
        let next = Handle(self.textures.len());
        let handle = *self.handles.entry((request, sampler)).or_insert(next);
        if handle == next {
            self.textures.push((request, sampler));
        }
        handle
    }

    /// Decodes all images in parallel; the result does not depend on the number of threads.
    pub(super) fn decode(self, notes: &mut Notes) -> DecodedTextures {
        let decoded: Vec<_> = self.requests.par_iter().map(Request::decode).collect();
        let mut images = Vec::new();
        for (request, decoded) in self.requests.iter().zip(decoded) {
            images.push(match decoded {
                Ok((texture, damage)) => {
                    if let Some(damage) = damage {
                        let name = request.file_name();
                        notes.add_named(Note::TextureDamaged, format!("{name} ({damage})"));
                    }
                    let alphas = texture.texels().iter().map(|texel| texel[3]);
                    let range = alphas.fold([255, 0], |[l, g], a| [l.min(a), g.max(a)]);
                    Some((texture, range))
                }
                Err(DecodeError::OverBudget(cause)) => {
                    notes.add_over_budget(&request.file_name(), &cause);
                    None
                }
                Err(DecodeError::NotGrey) => None,
                Err(DecodeError::Unreadable(cause)) => {
                    let name = request.file_name();
                    notes.add_named(Note::TextureUnreadable, format!("{name} ({cause})"));
                    None
                }
            });
        }
        let mut result = DecodedTextures::default();
        for (request, sampler) in self.textures {
            let slot = images[request].as_ref().map(|(texture, range)| {
                result.textures.push(texture.with_sampler(sampler));
                Slot {
                    index: result.textures.len() as u32 - 1,
                    least_alpha: range[0],
                    greatest_alpha: range[1],
                }
            });
            result.slots.push(slot);
        }
        result
    }
}

/// The outcome of [`TextureTable::decode`].
#[derive(Debug, Default)]
pub(super) struct DecodedTextures {
    /// Textures that could be read.
    pub(super) textures: Vec<Texture>,
    slots: Vec<Option<Slot>>,
}

impl DecodedTextures {
    /// Returns the slot of a texture; `None` if it could not be read.
    pub(super) fn slot(&self, handle: Handle) -> Option<Slot> {
        self.slots.get(handle.0).copied().flatten()
    }
}

/// Why a texture could not be decoded.
enum DecodeError {
    OverBudget(PictureError),
    /// The image of a [`Role::GreyMask`] is not one.
    NotGrey,
    Unreadable(String),
}

impl Request {
    fn file_name(&self) -> Cow<'_, str> {
        let file_name = Path::new(&self.name).file_name();
        file_name.map_or(self.name.as_str().into(), |name| name.to_string_lossy())
    }

    /// Decodes the texture; also returns the damage of a file that is cut short.
    fn decode(&self) -> Result<(Texture, Option<String>), DecodeError> {
        let image = match &self.source {
            Source::Absent(cause) => return Err(DecodeError::Unreadable(cause.clone())),
            Source::Bytes(bytes) => codec::decode(bytes, None, codec::MAX_BYTES),
            Source::File(path) => codec::read(path, codec::MAX_BYTES),
        };
        let codec::Decoded {
            image,
            damage,
            memory: _memory,
        } = image.map_err(|error| match error.is_over_budget() {
            true => DecodeError::OverBudget(error),
            false => DecodeError::Unreadable(error.to_string()),
        })?;
        let (width, height) = (image.width(), image.height());
        let texels = match self.role {
            Role::Color => srgb_texels(&image),
            Role::GreyMask if !is_grey(&image) => return Err(DecodeError::NotGrey),
            Role::Mask | Role::GreyMask => mask_texels(&image),
        };
        let texture = Texture::new(width, height, texels)
            .ok_or_else(|| DecodeError::Unreadable("it has no pixels".into()))?;
        Ok((texture, damage))
    }
}

/// Converts an image to sRGB with straight alpha. Float images are linear, others sRGB already.
fn srgb_texels(image: &DynamicImage) -> Vec<[u8; 4]> {
    match image {
        DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_) => {
            let encode = |p: &image::Rgba<f32>| {
                let [r, g, b, a] = p.0;
                let alpha = (a.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
                [
                    srgb8_from_linear(r),
                    srgb8_from_linear(g),
                    srgb8_from_linear(b),
                    alpha,
                ]
            };
            image.to_rgba32f().pixels().map(encode).collect()
        }
        _ => codec::rgba8_pixels(image),
    }
}

/// Returns true if all texels are grey and their alpha does not vary.
fn is_grey(image: &DynamicImage) -> bool {
    let rgba = codec::rgba8_pixels(image);
    rgba.iter()
        .all(|&[r, g, b, a]| r == g && g == b && a == rgba[0][3])
}

/// Converts an image to white texels whose alpha is its opacity.
fn mask_texels(image: &DynamicImage) -> Vec<[u8; 4]> {
    let rgba = codec::rgba8_pixels(image);
    let alpha_varies = rgba.iter().any(|texel| texel[3] != rgba[0][3]);
    let opacity = |texel: &[u8; 4]| {
        let [r, g, b, a] = texel.map(u32::from);
        // Rec. 709 luma in integers; the weights add up to 65536.
        if alpha_varies {
            a
        } else {
            (13_933 * r + 46_871 * g + 4_732 * b + 32_768) >> 16
        }
    };
    rgba.iter()
        .map(|texel| [255, 255, 255, opacity(texel) as u8])
        .collect()
}
