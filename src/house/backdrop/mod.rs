//! Backdrops: representations of everything behind a portal (R2, R9, R11, P2; D1).
//!
//! Every backdrop belongs to one side of one portal. Its samples come from rays that start on the
//! portal's plane, so that nothing in front of it is ever taken for what lies behind, and it is
//! drawn into the portal's pixels alone.
//!
//! * `texture`: what the plane shows from one place or from many.
//! * `images`: depth images from a semicircle: one warped, the two nearest warped, or all in one
//!   LDI.
//! * `sprite`: a sprite with depth where what lies behind is smooth.
//! * `window`: cube LDIs from rays through the whole opening in all directions.
//! * `gather`: from rays to a cube LDI, with the conflict rules, and what is flat to pictures on
//!   planes, as captures have it (`headbox_cube::planes`); `mend`: what random rays left out of it.

mod draw;
mod gather;
mod images;
mod mend;
mod sprite;
mod texture;
mod window;

pub use draw::{BackdropStats, Drawer};
pub use sprite::PortalSprite;
pub use texture::TextureSet;

use super::house::House;
use super::opening::Opening;
use glam::DVec3;
use headbox_cube::model::parameters::MergeRule;
use headbox_cube::pack::{CubeLdi, PackError};
use headbox_sprite::SpriteError;
use serde::{Deserialize, Serialize};

/// Ways to show what is behind a portal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum BackdropKind {
    /// One texture on the portal's plane, as seen from straight in front (R2a).
    Texture,
    /// Textures from a semicircle, the nearest to the eye shown (R2b).
    Textures,
    /// One depth image from straight in front, warped (R5).
    Image,
    /// The two nearest of the depth images from a semicircle, the farther warped first (R9).
    TwoImages,
    /// All depth images from a semicircle in one LDI about the central one; of samples at similar
    /// depth the one with the smaller area stays, those of one image all stay, and those of the
    /// central image are never displaced (R11).
    Ldi,
    /// The same; samples at similar depth both stay if their colours differ (P2).
    LdiColorsApart,
    /// The same; samples at similar depth are averaged (S12).
    LdiAverage,
    /// A cube LDI about a place in front of the portal's middle, from rays through the whole
    /// opening.
    WindowLdi,
    /// Same as [`Self::WindowLdi`], centred in the viewing cell: the part of the cell's cube LDI
    /// that belongs to this portal.
    CellLdi,
    /// A sprite with depth from straight in front, drawn in two passes (S5), where what lies behind
    /// is smooth; elsewhere [`Self::WindowLdi`].
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
    /// The conflict rule under which its images are merged (D1).
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
    /// Pixels a side of the faces of cubes, and of the images: 90 degrees.
    pub face_px: u32,
    /// The same for [`BackdropKind::WindowLdi`], which sees a wider field than an image: about half
    /// of a sphere.
    pub window_face_px: u32,
    /// Distance of the centre of [`BackdropKind::WindowLdi`] in front of the portal's middle,
    /// metres. On the portal itself half of the samples lie beside what anyone farther away sees;
    /// an eye's distance away it would be an image's.
    pub window_back_m: f64,
    /// Images on a semicircle are twice this and one more (n = 6 in the papers).
    pub images: u32,
    /// Radius of the semicircle, metres.
    pub radius_m: f64,
    /// Height of the eye above a portal's lower edge for which images are taken, metres.
    pub eye_height_m: f64,
    /// Pixels of the longer side of a texture.
    pub texture_px: u32,
    /// Strata along each of the four dimensions of a window's rays.
    pub strata: u32,
    /// Rays in each stratum.
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
    /// Colours on the portal's plane.
    Textures(TextureSet),
    /// Cubes, each with the place from which it was taken; of several the two nearest are drawn.
    Cubes(Vec<CubeLdi>),
    /// A sprite with depth.
    Sprite(Box<PortalSprite>),
}

/// Why a backdrop could not be made.
#[derive(Debug, thiserror::Error)]
pub enum BackdropError {
    /// There is no such portal, or it has no area.
    #[error("there is no portal {0}, or it has no area")]
    NoPortal(u32),
    /// Numbers that allow no capture.
    #[error("a backdrop needs {0}")]
    Quality(&'static str),
    /// The LDI could not be packed.
    #[error("the backdrop of portal {portal} could not be packed: {source}")]
    Pack {
        /// Index of the portal.
        portal: u32,
        /// Why.
        source: PackError,
    },
    /// The sprite could not be made.
    #[error("the sprite of portal {portal} could not be made: {source}")]
    Sprite {
        /// Index of the portal.
        portal: u32,
        /// Why.
        source: SpriteError,
    },
}

/// One side of one portal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct PortalSide {
    /// Index of the portal.
    pub portal: u32,
    /// 0 or 1: which of the portal's cells looks.
    pub side: u8,
}

impl PortalSide {
    /// The opening in a house, if there is one.
    pub fn opening(self, house: &House) -> Option<Opening> {
        Opening::new(
            house.plan().portals.get(self.portal as usize)?,
            usize::from(self.side & 1),
        )
    }

    /// The cell that looks and the cell behind.
    pub fn cells(self, house: &House) -> Option<[u32; 2]> {
        let [a, b] = house.plan().portals.get(self.portal as usize)?.cells;
        Some(if self.side & 1 == 0 { [a, b] } else { [b, a] })
    }
}

impl BackdropQuality {
    /// Checks that a capture with these numbers makes sense.
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
    /// Captures what is behind one side of a portal.
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
        let [looking, _] = at.cells(house).ok_or_else(no_portal)?;
        let places = opening.semicircle(quality.images, quality.radius_m, quality.eye_height_m);
        let pack = |result: Result<CubeLdi, PackError>| {
            result.map_err(|source| BackdropError::Pack {
                portal: at.portal,
                source,
            })
        };
        let one =
            |places: &[DVec3]| pack(images::ldi(house, &opening, places, kind.rule(), quality));
        let cube = |centre: DVec3, face_px: u32| {
            Ok(Self::Cubes(vec![pack(window::ldi(
                house, &opening, centre, face_px, quality,
            ))?]))
        };
        let window = || {
            cube(
                opening.centre + opening.normal * quality.window_back_m,
                quality.window_face_px,
            )
        };
        Ok(match kind {
            BackdropKind::Texture => {
                Self::Textures(TextureSet::capture(house, &opening, &places[..1], quality))
            }
            BackdropKind::Textures => {
                Self::Textures(TextureSet::capture(house, &opening, &places, quality))
            }
            BackdropKind::Image => Self::Cubes(vec![one(&places[..1])?]),
            BackdropKind::TwoImages => Self::Cubes(
                places
                    .iter()
                    .map(|place| one(std::slice::from_ref(place)))
                    .collect::<Result<_, _>>()?,
            ),
            BackdropKind::Ldi | BackdropKind::LdiColorsApart | BackdropKind::LdiAverage => {
                Self::Cubes(vec![one(&places)?])
            }
            BackdropKind::WindowLdi => window()?,
            BackdropKind::CellLdi => cube(
                house.middle_of(looking).unwrap_or(places[0]),
                quality.face_px,
            )?,
            BackdropKind::Sprite => {
                let sprite = PortalSprite::capture(house, &opening, quality);
                match sprite.map_err(|source| BackdropError::Sprite {
                    portal: at.portal,
                    source,
                })? {
                    Some(sprite) => Self::Sprite(Box::new(sprite)),
                    None => window()?,
                }
            }
        })
    }

    /// Bytes in memory, near enough.
    pub fn bytes(&self) -> u64 {
        match self {
            Self::Textures(set) => set.bytes(),
            Self::Cubes(cubes) => cubes.iter().map(|cube| cube.bytes() as u64).sum(),
            Self::Sprite(sprite) => sprite.bytes(),
        }
    }

    /// Returns true if it has plane textures.
    pub(super) fn has_planes(&self) -> bool {
        matches!(self, Self::Cubes(cubes) if cubes.iter().any(|cube| !cube.planes.tiles.is_empty()))
    }

    /// Depth pixels of all cubes; texels of textures; pixels of a sprite.
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
