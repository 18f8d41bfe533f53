//! Cube LDIs: the renderer, and the slow one in f64.

use super::{Draw, Picture};
use crate::capture::Camera;
use crate::ldi::CubeLdi;
use crate::packed::{ExactCube, PackedCube};
use crate::render::oracle::render_oracle;
use crate::render::{RenderSettings, Renderer};
use std::sync::Arc;

/// A packed cube LDI under one setting of the renderer.
pub struct LdiDraw {
    cube: Arc<PackedCube>,
    settings: RenderSettings,
    renderer: Renderer,
}

impl LdiDraw {
    /// Draws `cube`.
    pub fn new(cube: Arc<PackedCube>, settings: RenderSettings) -> Self {
        Self { cube, settings, renderer: Renderer::new() }
    }
}

impl Draw for LdiDraw {
    fn draw(&mut self, camera: &Camera) -> u64 {
        self.renderer.render_with_stats(&self.cube, camera, &self.settings).1.depth_pixels_in
    }

    fn picture(&mut self, camera: &Camera) -> Picture {
        Picture::of_frame(self.renderer.render(&self.cube, camera, &self.settings))
    }
}

/// A cube LDI of which no depth pixel is quantised, by the same renderer.
pub struct ExactDraw {
    exact: ExactCube,
    settings: RenderSettings,
    renderer: Renderer,
}

impl ExactDraw {
    /// Draws `exact`.
    pub fn new(exact: ExactCube, settings: RenderSettings) -> Self {
        Self { exact, settings, renderer: Renderer::new() }
    }
}

impl Draw for ExactDraw {
    fn draw(&mut self, camera: &Camera) -> u64 {
        self.renderer.render_exact(&self.exact, camera, &self.settings).1.depth_pixels_in
    }

    fn picture(&mut self, camera: &Camera) -> Picture {
        Picture::of_frame(self.renderer.render_exact(&self.exact, camera, &self.settings).0)
    }
}

/// A cube LDI by the slow renderer: direct warp in f64, exact footprints, nothing quantised that the LDI has not.
pub struct OracleDraw {
    ldi: CubeLdi,
    last: Option<(Camera, Picture)>,
}

impl OracleDraw {
    /// Draws `ldi`, which must be valid.
    pub fn new(ldi: CubeLdi) -> Self {
        Self { ldi, last: None }
    }
}

impl Draw for OracleDraw {
    fn draw(&mut self, camera: &Camera) -> u64 {
        let frame = render_oracle(&self.ldi, camera);
        self.last = Some((*camera, Picture::of_frame(&frame)));
        self.ldi.faces.iter().map(|face| face.samples.len() as u64).sum()
    }

    fn picture(&mut self, camera: &Camera) -> Picture {
        match self.last.take() {
            Some((drawn, picture)) if drawn == *camera => picture,
            _ => Picture::of_frame(&render_oracle(&self.ldi, camera)),
        }
    }
}
