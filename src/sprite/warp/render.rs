//! Drawing a sprite for a camera, by any of the paper's variants.

use super::backward::{BackwardPlan, Parallax, backward};
use super::field::Field;
use super::forward::{BandMemory, forward};
use super::pure_parallax::{FirstPass, StoredValue};
use super::sampling::SpriteSampling;
use super::splat::splat;
use super::transfer::{Outcome, SpriteTransfer};
use crate::model::shift::ShiftField;
use crate::model::texture::Texture;
use crate::{SpriteLayer, SpriteWithDepth};
use fearless_simd::Level;
use headbox_core::camera::Camera;
use headbox_core::simd;

/// Method of drawing parallax inside a sprite.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Hash, serde::Serialize)]
pub enum SpriteVariant {
    /// Not at all: the plane's homography (S3).
    Homography,
    /// By the displacement that the homography finds (S6): for small motions.
    OnePass,
    /// By displacements moved there first (S5, corrected by C5): the paper's recommendation.
    #[default]
    TwoPass,
    /// Two passes with a stored 2-D shift instead of the displacement (S7).
    ShiftField,
    /// Two passes with the epipole at infinity (S8).
    AffineParallax,
    /// Two passes by equations (7) and (8) as printed, to show their error (C5).
    AsPrinted,
    /// Colours mapped forward (S4).
    ForwardColor,
}

// The aliases are what issues and papers call them.
headbox_core::named_variants!(SpriteVariant {
    Homography => "homography",
    OnePass => "one-pass" | "crude",
    TwoPass => "two-pass",
    ShiftField => "shift-field" | "field",
    AffineParallax => "affine-parallax" | "affine",
    AsPrinted => "as-printed",
    ForwardColor => "forward-color" | "forward",
});

/// Options of drawing sprites.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize)]
pub struct RenderOptions {
    /// Method of drawing parallax.
    pub variant: SpriteVariant,
    /// Texture filter.
    pub sampling: SpriteSampling,
    /// Cells by which gaps after the first pass are filled (S9): 0 leaves them transparent.
    pub fill_steps: u32,
}

impl Default for RenderOptions {
    /// Two passes, bilinear, three steps of filling: what the paper found good.
    fn default() -> Self {
        Self {
            variant: SpriteVariant::default(),
            sampling: SpriteSampling::default(),
            fill_steps: 3,
        }
    }
}

/// A sprite in the form that is drawn: premultiplied texels in levels, displacements with slopes.
#[derive(Clone, Debug)]
pub struct PreparedSprite {
    sprite: SpriteWithDepth,
    texture: Texture,
    /// d1.
    field: Field,
    /// Pixels of the picture per displacement cell.
    cell_px: [f64; 2],
    /// Nothing of the picture shows.
    invisible: bool,
}

impl PreparedSprite {
    /// Prepares a sprite.
    pub fn new(sprite: SpriteWithDepth) -> Self {
        let (width, height) = sprite.displacement().size();
        let color = sprite.sprite().color();
        Self {
            texture: Texture::new(color),
            field: Field::of_sprite(sprite.sprite(), sprite.displacement()),
            cell_px: [
                f64::from(color.width()) / f64::from(width),
                f64::from(color.height()) / f64::from(height),
            ],
            invisible: color.pixels().all(|p| p.0[3] == 0),
            sprite,
        }
    }

    /// Sprite that was prepared.
    pub fn sprite(&self) -> &SpriteWithDepth {
        &self.sprite
    }
}

/// Draws sprites; keeps its memory from frame to frame.
#[derive(Clone, Debug)]
pub struct SpriteRenderer {
    level: Level,
    moved: Field,
    bands: Vec<BandMemory>,
    nearness: Vec<f32>,
}

impl Default for SpriteRenderer {
    fn default() -> Self {
        Self::new()
    }
}

impl SpriteRenderer {
    /// For the best SIMD level of the CPU.
    pub fn new() -> Self {
        Self::with_level(simd::level())
    }

    /// For a given SIMD level: every level gives the same bytes, as does every number of threads.
    pub fn with_level(level: Level) -> Self {
        Self {
            level,
            moved: Field::empty(),
            bands: Vec::new(),
            nearness: Vec::new(),
        }
    }

    /// Draws `sprite` as `target` sees it into `frame`, which takes the target's size; what was in
    /// it is gone. Runs on the rayon pool it is called from.
    ///
    /// The result tells of degenerate views; then the frame is transparent. Per pixel, what has no
    /// place in the picture is transparent: where the plane is behind the target eye (H w2 <= 0),
    /// where the surface is nearer to the target eye than a sixteenth of its plane's distance,
    /// where no displacement arrived.
    pub fn render(
        &mut self,
        sprite: &PreparedSprite,
        target: &Camera,
        options: &RenderOptions,
        frame: &mut SpriteLayer,
    ) -> Outcome {
        frame.resize(target.width(), target.height());
        match SpriteTransfer::new(sprite.sprite.sprite(), target) {
            Ok(_) if sprite.invisible => frame.pixels.fill(0),
            Ok(transfer) => self.render_transfer(sprite, &transfer, options, frame),
            Err(outcome) => {
                frame.pixels.fill(0);
                return outcome;
            }
        }
        Outcome::Drawn
    }

    /// Same as [`Self::render`] with the maps given, into a frame of a given size.
    pub fn render_transfer(
        &mut self,
        sprite: &PreparedSprite,
        transfer: &SpriteTransfer,
        options: &RenderOptions,
        frame: &mut SpriteLayer,
    ) {
        let affine;
        let mut transfer = transfer;
        if options.variant == SpriteVariant::AffineParallax {
            affine = transfer.with_epipole_at_infinity();
            transfer = &affine;
        }
        let PreparedSprite {
            texture,
            field,
            cell_px,
            ..
        } = sprite;
        let moves = !matches!(
            options.variant,
            SpriteVariant::Homography | SpriteVariant::OnePass | SpriteVariant::ForwardColor
        );
        if moves {
            let as_printed = options.variant == SpriteVariant::AsPrinted;
            let stored = if as_printed {
                StoredValue::AsPrinted
            } else {
                StoredValue::Corrected
            };
            let pass = FirstPass {
                cell_px: *cell_px,
                stored,
                fill_steps: options.fill_steps,
            };
            forward(
                self.level,
                field,
                transfer,
                pass,
                &mut self.moved,
                &mut self.bands,
            );
        }
        let shifts;
        let parallax = match options.variant {
            SpriteVariant::Homography => Parallax::None,
            SpriteVariant::OnePass => Parallax::Displacement(field),
            SpriteVariant::TwoPass => Parallax::Displacement(&self.moved),
            SpriteVariant::AsPrinted => Parallax::AsPrinted(&self.moved),
            SpriteVariant::AffineParallax => Parallax::Affine(&self.moved),
            SpriteVariant::ShiftField => {
                shifts = ShiftField::new(&self.moved, transfer, *cell_px);
                Parallax::Shift(&shifts)
            }
            SpriteVariant::ForwardColor => {
                let width = frame.size().0;
                let pixels = &mut frame.pixels;
                splat(
                    texture,
                    field,
                    *cell_px,
                    transfer,
                    options.sampling,
                    width,
                    pixels,
                    &mut self.nearness,
                );
                return;
            }
        };
        let view = BackwardPlan {
            texture,
            transfer,
            cell_px: *cell_px,
            parallax,
        };
        let width = frame.size().0;
        backward(
            self.level,
            &view,
            options.sampling == SpriteSampling::Nearest,
            width,
            &mut frame.pixels,
        );
    }
}
