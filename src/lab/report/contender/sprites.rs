//! Sprites with depth, over the environment.

use super::{Draw, JudgedFrame};
use headbox_core::camera::Camera;
use headbox_core::frame::Frame;
use headbox_sprite::compose::{ComposeSettings, Composer, Composition};
use headbox_sprite::{RenderOptions, SpriteSet};
use std::sync::Arc;

/// A set of sprites under one setting.
pub struct SpriteDraw {
    layers: Arc<Composition>,
    settings: ComposeSettings,
    composer: Composer,
    frame: Frame,
}

impl SpriteDraw {
    /// Draws `layers`, which hold sprites only.
    pub fn new(layers: Arc<Composition>, options: RenderOptions) -> Self {
        let settings = ComposeSettings {
            sprites: options,
            ..ComposeSettings::default()
        };
        let (composer, frame) = Default::default();
        Self {
            layers,
            settings,
            composer,
            frame,
        }
    }
}

/// Bytes of pictures and displacements.
pub fn bytes_of(set: &SpriteSet) -> u64 {
    let sprite = |prepared: &headbox_sprite::PreparedSprite| {
        let (color, displacement) = (
            prepared.sprite().sprite().color(),
            prepared.sprite().displacement(),
        );
        let (width, height) = displacement.size();
        let cell = match displacement.format() {
            headbox_sprite::DisplacementFormat::I8 => 1,
            headbox_sprite::DisplacementFormat::I16 => 2,
            headbox_sprite::DisplacementFormat::F32 => 4,
        };
        color.as_raw().len() as u64 + u64::from(width) * u64::from(height) * cell
    };
    set.sprites().iter().map(sprite).sum::<u64>() + size_of_val(&set.environment.texels[..]) as u64
}

impl Draw for SpriteDraw {
    fn draw(&mut self, camera: &Camera) {
        self.layers
            .render(&mut self.composer, camera, &self.settings, &mut self.frame);
    }

    fn picture(&mut self, camera: &Camera) -> JudgedFrame {
        self.draw(camera);
        JudgedFrame::of_frame(&self.frame)
    }
}
