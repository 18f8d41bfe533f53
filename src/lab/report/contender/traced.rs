//! Path tracing of every frame, and the cube map.

use super::{ContenderFrame, Draw};
use crate::cube_map::CubeMap;
use headbox_core::camera::Camera;
use headbox_core::progress::Silent;
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use headbox_trace::truth;
use headbox_trace::truth::Truth;
use image::RgbImage;
use std::sync::Arc;

/// Path tracer with a few rays per pixel: truth before convergence.
pub struct PathTraced {
    tracer: Arc<Tracer>,
    lighting: Lighting,
    lit: bool,
    samples: u32,
    last: Option<(Camera, Truth)>,
}

impl PathTraced {
    /// Traces `samples` rays per pixel (rounded up to a multiple of 2).
    pub fn new(tracer: Arc<Tracer>, lighting: Lighting, lit: bool, samples: u32) -> Self {
        Self {
            tracer,
            lighting,
            lit,
            samples,
            last: None,
        }
    }
}

impl Draw for PathTraced {
    fn draw(&mut self, camera: &Camera) {
        let truth = truth::render(
            &self.tracer,
            &self.lighting,
            self.lit,
            camera,
            self.samples,
            &Silent,
        );
        self.last = Some((*camera, truth));
    }

    fn picture(&mut self, camera: &Camera) -> ContenderFrame {
        if self.last.as_ref().is_none_or(|(drawn, _)| drawn != camera) {
            self.draw(camera);
        }
        self.last
            .take()
            .map(|(_, truth)| ContenderFrame::from_frame(&truth.frame))
            .unwrap_or_default()
    }
}

/// A cube map about the headbox's centre, without parallax.
pub struct CubeMapDraw {
    map: Arc<CubeMap>,
    color: RgbImage,
}

impl CubeMapDraw {
    /// Resamples `map`.
    pub fn new(map: Arc<CubeMap>) -> Self {
        Self {
            map,
            color: RgbImage::new(0, 0),
        }
    }
}

impl Draw for CubeMapDraw {
    fn draw(&mut self, camera: &Camera) {
        self.color = self.map.resample(camera);
    }

    fn picture(&mut self, camera: &Camera) -> ContenderFrame {
        ContenderFrame {
            color: self.map.resample(camera),
            origins: Vec::new(),
        }
    }
}
