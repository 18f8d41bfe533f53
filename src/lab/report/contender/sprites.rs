//! Sprites with depth, over the environment.

use super::{Draw, JudgedFrame};
use headbox_core::camera::Camera;
use headbox_core::frame::Frame;
use headbox_sprite::RenderOptions;
use headbox_sprite::compose::{ComposeSettings, Composer, Composition};
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
