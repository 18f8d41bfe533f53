//! Sprites with depth, over the environment.

use super::{ContenderFrame, Draw};
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
    /// Draws `layers`, which contain sprites only.
    pub fn new(layers: Arc<Composition>, options: RenderOptions) -> Self {
        let settings = ComposeSettings {
            sprites: options,
            ..ComposeSettings::default()
        };
        Self {
            layers,
            settings,
            composer: Composer::default(),
            frame: Frame::default(),
        }
    }
}

impl Draw for SpriteDraw {
    fn draw(&mut self, camera: &Camera) {
        self.layers
            .render(&mut self.composer, camera, &self.settings, &mut self.frame);
    }

    fn picture(&mut self, camera: &Camera) -> ContenderFrame {
        self.draw(camera);
        ContenderFrame::from_frame(&self.frame)
    }
}
