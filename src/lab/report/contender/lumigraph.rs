//! Lumigraphs.

use super::{ContenderFrame, Draw};
use headbox_core::camera::Camera;
use headbox_lumigraph::{Lumigraph, LumigraphRenderer, LumigraphSettings};
use std::sync::Arc;

/// A lumigraph under one setting.
pub struct LumigraphDraw {
    lumigraph: Arc<Lumigraph>,
    settings: LumigraphSettings,
    renderer: LumigraphRenderer,
}

impl LumigraphDraw {
    /// Draws `lumigraph`.
    pub fn new(lumigraph: Arc<Lumigraph>, settings: LumigraphSettings) -> Self {
        Self {
            lumigraph,
            settings,
            renderer: LumigraphRenderer::new(),
        }
    }
}

impl Draw for LumigraphDraw {
    fn draw(&mut self, camera: &Camera) {
        self.renderer
            .render(&self.lumigraph, camera, &self.settings);
    }

    fn picture(&mut self, camera: &Camera) -> ContenderFrame {
        ContenderFrame::from_frame(
            self.renderer
                .render(&self.lumigraph, camera, &self.settings)
                .0,
        )
    }
}
