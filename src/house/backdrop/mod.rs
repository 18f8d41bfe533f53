//! Backdrops: representations of everything behind a portal (R2, R9, R11, P2; D1).
//!
//! Every backdrop belongs to one side of one portal. Its samples come from rays that start on the
//! portal's plane, so that surfaces in front of it are excluded, and it is drawn only into the
//! portal's pixels.
//!
//! * `texture`: textures on the portal's plane, from one eye or from several.
//! * `images`: depth images from a semicircle: one warped, the two nearest warped, or all in one
//!   LDI.
//! * `sprite`: a sprite with depth, if the view behind the portal is smooth.
//! * `window`: cube LDIs from rays through the whole opening in all directions.
//! * `gather`: cube LDIs from rays, with the merge rules; planar parts become plane textures
//!   (`headbox_cube::planes`). `repair`: gaps that random rays leave in them.

mod draw;
mod gather;
mod images;
mod repair;
mod sprite;
mod texture;
mod window;

pub use draw::{BackdropStats, Drawer};
pub use sprite::PortalSprite;
pub use texture::TextureSet;

use super::house::House;
use super::portal_opening::Opening;
use glam::DVec3;
use headbox_cube::model::parameters::MergeRule;
use headbox_cube::pack::{CubeLdi, PackError};
use headbox_sprite::SpriteError;
use serde::{Deserialize, Serialize};

/// Kinds of backdrops.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum BackdropKind {
    /// One texture on the portal's plane, from an eye straight in front (R2a).
    Texture,
    /// Textures from a semicircle of eyes; the one nearest to the eye is drawn (R2b).
    Textures,
    /// One depth image from straight in front, warped (R5).
    Image,
    /// The two nearest of the depth images from a semicircle, the farther warped first (R9).
    TwoImages,
    /// All depth images from a semicircle in one LDI about the central one. Of samples at similar
    /// depth the one with the smaller area is kept; samples of the same image are all kept, and
    /// those of the central image are never replaced (R11).
    Ldi,
    /// Like `Ldi`, but samples at similar depth are both kept if their colours differ (P2).
    LdiColorsApart,
    /// Like `Ldi`, but samples at similar depth are averaged (S12).
    LdiAverage,
    /// A cube LDI about a point in front of the portal's middle, from rays through the whole
    /// opening.
    WindowLdi,
    /// Like `WindowLdi`, centred in the viewing cell: the part of the cell's cube LDI that belongs
    /// to this portal.
    CellLdi,
    /// A sprite with depth from straight in front, drawn in two passes (S5), if the view behind the
    /// portal is smooth; else `WindowLdi`.
    Sprite,
}

headbox_core::named_variants!(BackdropKind {
    Texture => "texture",
    Textures => "textures",
    Image => "image",
    TwoImages => "two-images",
    Ldi => "ldi",
    LdiColorsApart => "ldi-colors-apart",
    LdiAverage => "ldi-average",
    WindowLdi => "window-ldi",
    CellLdi => "cell-ldi",
    Sprite => "sprite",
});

impl BackdropKind {
    /// Returns the rule by which its samples are merged (D1).
    fn rule(self) -> MergeRule {
        match self {
            Self::LdiColorsApart => MergeRule::ColorsApart,
            Self::LdiAverage | Self::WindowLdi | Self::CellLdi | Self::Sprite => MergeRule::Average,
            Self::Texture | Self::Textures | Self::Image | Self::TwoImages | Self::Ldi => {
                MergeRule::SmallerArea
            }
        }
    }
}

/// Capture quality of backdrops.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BackdropQuality {
    /// Face size of cubes and images (90 degrees), pixels.
    pub face_px: u32,
    /// Face size of [`BackdropKind::WindowLdi`], pixels; its field of view is wider than an
    /// image's, about a hemisphere.
    pub window_face_px: u32,
    /// Distance of the centre of [`BackdropKind::WindowLdi`] in front of the portal's middle,
    /// metres. At 0 half of the samples would be invisible from farther away; at an eye's distance
    /// it would be an image.
    pub window_back_m: f64,
    /// Number n of images to each side of the central one on the semicircle: 2 n + 1 in total (n =
    /// 6 in the papers).
    pub images: u32,
    /// Radius of the semicircle, metres.
    pub radius_m: f64,
    /// Height of the images' eyes above a portal's lower edge, metres.
    pub eye_height_m: f64,
    /// Longer side of a texture, pixels.
    pub texture_px: u32,
    /// Number of strata along each of the four dimensions of a window's rays.
    pub strata: u32,
    /// Number of rays in each stratum.
    pub rays: u32,
    /// Random seed.
    pub seed: u64,
}

impl Default for BackdropQuality {
    fn default() -> Self {
        Self {
            face_px: 512,
            window_face_px: 308,
            window_back_m: 1.0,
            images: 6,
            radius_m: 2.0,
            eye_height_m: 1.6,
            texture_px: 256,
            strata: 16,
            rays: 32,
            seed: 0,
        }
    }
}

/// Representation of everything behind a portal.
#[derive(Clone, Debug, PartialEq)]
pub enum Backdrop {
    /// Textures on the portal's plane.
    Textures(TextureSet),
    /// Cubes, each about its own centre; of several the two nearest are drawn.
    Cubes(Vec<CubeLdi>),
    /// A sprite with depth.
    Sprite(Box<PortalSprite>),
}

/// Error of capturing a backdrop.
#[derive(Debug, thiserror::Error)]
pub enum BackdropError {
    /// There is no such portal, or it has no area.
    #[error("there is no portal {0}, or it has no area")]
    NoPortal(u32),
    /// Invalid quality.
    #[error("a backdrop needs {0}")]
    Quality(&'static str),
    /// The LDI could not be packed.
    #[error("the backdrop of portal {portal} could not be packed: {source}")]
    Pack {
        /// Index of the portal.
        portal: u32,
        /// Cause.
        source: PackError,
    },
    /// The sprite could not be made.
    #[error("the sprite of portal {portal} could not be made: {source}")]
    Sprite {
        /// Index of the portal.
        portal: u32,
        /// Cause.
        source: SpriteError,
    },
}

/// One side of one portal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct PortalSide {
    /// Index of the portal.
    pub portal: u32,
    /// Viewing cell: 0 or 1, index into the portal's cells.
    pub side: u8,
}

impl PortalSide {
    /// Returns the opening; `None` if the portal does not exist or has no area.
    pub fn opening(self, house: &House) -> Option<Opening> {
        Opening::new(
            house.plan().portals.get(self.portal as usize)?,
            usize::from(self.side & 1),
        )
    }

    /// Returns the viewing cell and the cell behind the portal.
    pub fn cells(self, house: &House) -> Option<[u32; 2]> {
        let [a, b] = house.plan().portals.get(self.portal as usize)?.cells;
        Some(if self.side & 1 == 0 { [a, b] } else { [b, a] })
    }
}

impl BackdropQuality {
    /// Checks that the values allow a capture.
    ///
    /// # Errors
    /// [`BackdropError::Quality`].
    pub fn validate(&self) -> Result<(), BackdropError> {
        let positive = |v: f64| v > 0.0 && v.is_finite();
        let rules = [
            (
                (8..=2048).contains(&self.face_px),
                "faces of 8 to 2048 pixels",
            ),
            (
                (8..=2048).contains(&self.window_face_px),
                "window faces of 8 to 2048 pixels",
            ),
            (self.images <= 64, "at most 64 images on each side"),
            (
                (0.0..=100.0).contains(&self.window_back_m),
                "a window's centre 0 to 100 m in front of it",
            ),
            (
                positive(self.radius_m) && self.eye_height_m.is_finite(),
                "a positive radius and a finite height",
            ),
            (
                (8..=4096).contains(&self.texture_px),
                "textures of 8 to 4096 pixels",
            ),
            (
                (1..=32).contains(&self.strata) && (1..=256).contains(&self.rays),
                "1 to 32 strata of 1 to 256 rays",
            ),
        ];
        rules
            .iter()
            .find(|(holds, _)| !holds)
            .map_or(Ok(()), |(_, needs)| Err(BackdropError::Quality(needs)))
    }
}

impl Backdrop {
    /// Captures the backdrop of one side of a portal.
    ///
    /// # Errors
    /// See [`BackdropError`].
    pub fn capture(
        house: &House,
        at: PortalSide,
        kind: BackdropKind,
        quality: &BackdropQuality,
    ) -> Result<Self, BackdropError> {
        quality.validate()?;
        let no_portal = || BackdropError::NoPortal(at.portal);
        let opening = at.opening(house).ok_or_else(no_portal)?;
        let [viewing_cell, _] = at.cells(house).ok_or_else(no_portal)?;
        let eyes = opening.semicircle(quality.images, quality.radius_m, quality.eye_height_m);
        let pack = |result: Result<CubeLdi, PackError>| {
            result.map_err(|source| BackdropError::Pack {
                portal: at.portal,
                source,
            })
        };
        let merge = |eyes: &[DVec3]| pack(images::ldi(house, &opening, eyes, kind.rule(), quality));
        let cube = |centre: DVec3, face_px: u32| {
            let cube = pack(window::ldi(house, &opening, centre, face_px, quality))?;
            Ok(Self::Cubes(vec![cube]))
        };
        let window = || {
            cube(
                opening.centre + opening.normal * quality.window_back_m,
                quality.window_face_px,
            )
        };
        Ok(match kind {
            BackdropKind::Texture => {
                Self::Textures(TextureSet::capture(house, &opening, &eyes[..1], quality))
            }
            BackdropKind::Textures => {
                Self::Textures(TextureSet::capture(house, &opening, &eyes, quality))
            }
            BackdropKind::Image => Self::Cubes(vec![merge(&eyes[..1])?]),
            BackdropKind::TwoImages => {
                let cubes = eyes.iter().map(|eye| merge(std::slice::from_ref(eye)));
                Self::Cubes(cubes.collect::<Result<_, _>>()?)
            }
            BackdropKind::Ldi | BackdropKind::LdiColorsApart | BackdropKind::LdiAverage => {
                Self::Cubes(vec![merge(&eyes)?])
            }
            BackdropKind::WindowLdi => window()?,
            BackdropKind::CellLdi => cube(
                house.cell_centre(viewing_cell).unwrap_or(eyes[0]),
                quality.face_px,
            )?,
            BackdropKind::Sprite => {
                let sprite = PortalSprite::capture(house, &opening, quality);
                let sprite = sprite.map_err(|source| BackdropError::Sprite {
                    portal: at.portal,
                    source,
                })?;
                match sprite {
                    Some(sprite) => Self::Sprite(Box::new(sprite)),
                    None => window()?,
                }
            }
        })
    }

    /// Returns the approximate size in memory, bytes.
    pub fn bytes(&self) -> u64 {
        match self {
            Self::Textures(set) => set.bytes(),
            Self::Cubes(cubes) => cubes.iter().map(|cube| cube.bytes() as u64).sum(),
            Self::Sprite(sprite) => sprite.bytes(),
        }
    }

    /// Returns true if the backdrop has plane textures.
    pub(super) fn has_planes(&self) -> bool {
        matches!(self, Self::Cubes(cubes) if cubes.iter().any(|cube| !cube.planes.tiles.is_empty()))
    }

    /// Returns the number of depth pixels of all cubes, of texels, or of the sprite's pixels.
    pub fn sample_count(&self) -> u64 {
        match self {
            Self::Textures(set) => set.bytes() / 4,
            Self::Cubes(cubes) => cubes
                .iter()
                .map(|cube| cube.depth_pixel_count() as u64)
                .sum(),
            Self::Sprite(sprite) => sprite.sample_count(),
        }
    }
}
