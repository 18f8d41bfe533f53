//! Cube LDIs: the renderer, and the f64 reference renderer.

use super::{ContenderFrame, Draw};
use crate::baselines::fragments::FragmentRenderer;
use headbox_core::camera::Camera;
use headbox_cube::model::samples::CubeSamples;
use headbox_cube::pack::{CubeLdi, UnquantisedCube};
use headbox_cube::render::reference::oracle::render_oracle;
use headbox_cube::render::{RenderSettings, Renderer};
use std::sync::Arc;

/// Counts the depth pixels that survive clipping against the whole frame, each once (R-N6);
/// [`FrameStats::depth_pixels_in`] counts a depth pixel in each band that it reaches.
///
/// [`FrameStats::depth_pixels_in`]: headbox_cube::render::FrameStats::depth_pixels_in
fn count_after_clipping(
    renderer: &mut Renderer,
    cube: &CubeLdi,
    camera: &Camera,
    settings: &RenderSettings,
) -> u64 {
    if settings.unclipped {
        cube.depth_pixel_count() as u64
    } else {
        renderer.clip_counts(cube, camera, settings).kept
    }
}

/// A packed cube LDI under one setting of the renderer.
pub struct LdiDraw {
    cube: Arc<CubeLdi>,
    settings: RenderSettings,
    renderer: Renderer,
}

impl LdiDraw {
    /// Draws `cube`.
    pub fn new(cube: Arc<CubeLdi>, settings: RenderSettings) -> Self {
        Self {
            cube,
            settings,
            renderer: Renderer::new(),
        }
    }
}

impl Draw for LdiDraw {
    fn draw(&mut self, camera: &Camera) {
        self.renderer
            .render_with_stats(&self.cube, camera, &self.settings);
    }

    fn depth_pixels(&mut self, camera: &Camera) -> u64 {
        count_after_clipping(&mut self.renderer, &self.cube, camera, &self.settings)
    }

    fn picture(&mut self, camera: &Camera) -> ContenderFrame {
        ContenderFrame::from_frame(self.renderer.render(&self.cube, camera, &self.settings))
    }
}

/// A packed cube LDI in fragments along epipolar lines.
pub struct FragmentDraw {
    cube: Arc<CubeLdi>,
    count: u32,
    renderer: FragmentRenderer,
}

impl FragmentDraw {
    /// Draws `cube` in `count` fragments, 0 for one per thread.
    pub fn new(cube: Arc<CubeLdi>, count: u32) -> Self {
        Self {
            cube,
            count,
            renderer: FragmentRenderer::default(),
        }
    }
}

impl Draw for FragmentDraw {
    fn draw(&mut self, camera: &Camera) {
        self.renderer
            .render(&self.cube, camera, &RenderSettings::default(), self.count);
    }

    fn depth_pixels(&mut self, camera: &Camera) -> u64 {
        count_after_clipping(
            &mut Renderer::new(),
            &self.cube,
            camera,
            &RenderSettings::default(),
        )
    }

    fn picture(&mut self, camera: &Camera) -> ContenderFrame {
        ContenderFrame::from_frame(
            self.renderer
                .render(&self.cube, camera, &RenderSettings::default(), self.count)
                .0,
        )
    }
}

/// A cube LDI with unquantised depth pixels, drawn by the same renderer.
pub struct ExactDraw {
    exact: UnquantisedCube,
    settings: RenderSettings,
    renderer: Renderer,
}

impl ExactDraw {
    /// Draws `exact`.
    pub fn new(exact: UnquantisedCube, settings: RenderSettings) -> Self {
        Self {
            exact,
            settings,
            renderer: Renderer::new(),
        }
    }
}

impl Draw for ExactDraw {
    fn draw(&mut self, camera: &Camera) {
        self.renderer
            .render_exact(&self.exact, camera, &self.settings);
    }

    fn depth_pixels(&mut self, camera: &Camera) -> u64 {
        count_after_clipping(&mut self.renderer, &self.exact.cube, camera, &self.settings)
    }

    fn picture(&mut self, camera: &Camera) -> ContenderFrame {
        ContenderFrame::from_frame(
            self.renderer
                .render_exact(&self.exact, camera, &self.settings)
                .0,
        )
    }
}

/// A cube LDI drawn by the reference renderer: direct warp in f64, exact footprints, no
/// quantisation beyond that of the LDI itself.
pub struct OracleDraw {
    ldi: CubeSamples,
    last: Option<(Camera, ContenderFrame)>,
}

impl OracleDraw {
    /// Draws `ldi`, which must be valid.
    pub fn new(ldi: CubeSamples) -> Self {
        Self { ldi, last: None }
    }
}

impl Draw for OracleDraw {
    fn draw(&mut self, camera: &Camera) {
        let frame = render_oracle(&self.ldi, camera);
        self.last = Some((*camera, ContenderFrame::from_frame(&frame)));
    }

    fn depth_pixels(&mut self, _: &Camera) -> u64 {
        self.ldi
            .faces
            .iter()
            .map(|face| face.samples.len() as u64)
            .sum()
    }

    fn picture(&mut self, camera: &Camera) -> ContenderFrame {
        match self.last.take() {
            Some((drawn, picture)) if drawn == *camera => picture,
            _ => ContenderFrame::from_frame(&render_oracle(&self.ldi, camera)),
        }
    }
}
