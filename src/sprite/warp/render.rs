//! Rendering of a sprite for a camera, by any of the paper's variants.

use super::field::Field;
use super::first_pass::forward::{BandBuffers, forward};
use super::first_pass::pure_parallax::{FirstPass, StoredValue};
use super::second_pass::backward::{BackwardPlan, Parallax, backward};
use super::second_pass::sampling::SpriteSampling;
use super::splat::splat;
use super::transfer::{Outcome, SpriteTransfer};
use crate::model::shift::ShiftField;
use crate::model::texture::Texture;
use crate::{SpriteLayer, SpriteWithDepth};
use fearless_simd::Level;
use headbox_core::camera::Camera;
use headbox_core::simd;

/// Method of rendering the parallax inside a sprite.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Hash, serde::Serialize)]
pub enum SpriteVariant {
    /// No parallax: the plane's homography alone (S3).
    Homography,
    /// One pass with the displacement that the homography finds (S6): for small motions.
    OnePass,
    /// Two passes: displacements are moved to the target first (S5, corrected by C5). The paper's
    /// recommendation.
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

// The aliases are the names in the papers and in issues.
headbox_core::named_variants!(SpriteVariant {
    Homography => "homography",
    OnePass => "one-pass" | "crude",
    TwoPass => "two-pass",
    ShiftField => "shift-field" | "field",
    AffineParallax => "affine-parallax" | "affine",
    AsPrinted => "as-printed",
    ForwardColor => "forward-color" | "forward",
});

/// Options of sprite rendering.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize)]
pub struct RenderOptions {
    /// Method of rendering parallax.
    pub variant: SpriteVariant,
    /// Texture filter.
    pub sampling: SpriteSampling,
    /// Cells by which gaps after the first pass are filled (S9): 0 leaves them transparent.
    pub fill_steps: u32,
}

impl Default for RenderOptions {
    /// Two passes, bilinear, three steps of gap filling, as the paper recommends.
    fn default() -> Self {
        Self {
            variant: SpriteVariant::default(),
            sampling: SpriteSampling::default(),
            fill_steps: 3,
        }
    }
}

/// A sprite prepared for rendering: premultiplied mip levels, displacements with slopes.
#[derive(Clone, Debug)]
pub struct PreparedSprite {
    sprite: SpriteWithDepth,
    texture: Texture,
    /// Displacements d1.
    field: Field,
    /// Size of a displacement cell in pixels of the image.
    cell_px: [f64; 2],
    /// True if all pixels are transparent.
    invisible: bool,
}

impl PreparedSprite {
    /// Prepares a sprite.
    pub fn new(sprite: SpriteWithDepth) -> Self {
        let (width, height) = sprite.displacement().size();
        let color = sprite.sprite().color();
        Self {
            texture: Texture::new(color),
            field: Field::from_sprite(sprite.sprite(), sprite.displacement()),
            cell_px: [
                f64::from(color.width()) / f64::from(width),
                f64::from(color.height()) / f64::from(height),
            ],
            invisible: color.pixels().all(|p| p.0[3] == 0),
            sprite,
        }
    }

    /// The sprite, as given.
    pub fn sprite(&self) -> &SpriteWithDepth {
        &self.sprite
    }
}

/// Renderer of sprites; reuses its buffers from frame to frame.
#[derive(Clone, Debug)]
pub struct SpriteRenderer {
    level: Level,
    moved: Field,
    bands: Vec<BandBuffers>,
    nearness: Vec<f32>,
}

impl Default for SpriteRenderer {
    fn default() -> Self {
        Self::new()
    }
}

impl SpriteRenderer {
    /// Creates a renderer for the best SIMD level of the CPU.
    pub fn new() -> Self {
        Self::with_level(simd::level())
    }

    /// Creates a renderer for a given SIMD level. Every level and every number of threads gives the
    /// same bytes.
    pub fn with_level(level: Level) -> Self {
        Self {
            level,
            moved: Field::empty(),
            bands: Vec::new(),
            nearness: Vec::new(),
        }
    }

    /// Renders `sprite` for the camera `target` into `frame`, which is resized to the target and
    /// overwritten. Runs on the rayon pool of the caller.
    ///
    /// In degenerate views, which the result reports, the frame is transparent. A pixel without a
    /// source is transparent: where the plane is behind the target eye (H w2 <= 0), where the
    /// surface is nearer to the target eye than a sixteenth of its plane's distance, and in gaps of
    /// the moved displacements.
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

    /// Renders as [`Self::render`] with given maps, into a frame of a given size.
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
        let PreparedSprite { texture, field, .. } = sprite;
        let (cell_px, width) = (sprite.cell_px, frame.width);
        let moves = !matches!(
            options.variant,
            SpriteVariant::Homography | SpriteVariant::OnePass | SpriteVariant::ForwardColor
        );
        if moves {
            let pass = FirstPass {
                cell_px,
                stored: if options.variant == SpriteVariant::AsPrinted {
                    StoredValue::AsPrinted
                } else {
                    StoredValue::Corrected
                },
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
                shifts = ShiftField::new(&self.moved, transfer, cell_px);
                Parallax::Shift(&shifts)
            }
            SpriteVariant::ForwardColor => {
                splat(
                    texture,
                    field,
                    cell_px,
                    transfer,
                    options.sampling,
                    width,
                    &mut frame.pixels,
                    &mut self.nearness,
                );
                return;
            }
        };
        let plan = BackwardPlan {
            texture,
            transfer,
            cell_px,
            parallax,
        };
        backward(
            self.level,
            &plan,
            options.sampling == SpriteSampling::Nearest,
            width,
            &mut frame.pixels,
        );
    }
}
