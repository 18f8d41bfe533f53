//! Contenders that trace rays for every frame, and the cube map.

use super::{Draw, JudgedFrame};
use crate::cube_map::CubeMap;
use headbox_core::camera::Camera;
use headbox_core::progress::Silent;
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use headbox_trace::truth;
use headbox_trace::truth::Truth;
use image::RgbImage;
use std::sync::Arc;

/// Full path tracing with a few rays per pixel: truth, too early.
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

    fn picture(&mut self, camera: &Camera) -> JudgedFrame {
        if self.last.as_ref().is_none_or(|(drawn, _)| drawn != camera) {
            self.draw(camera);
        }
        self.last
            .take()
            .map(|(_, truth)| JudgedFrame::of_frame(&truth.frame))
            .unwrap_or_default()
    }
}

/// A cube map about the headbox's centre: no parallax at all.
pub struct CubeMapDraw {
    map: Arc<CubeMap>,
    color: RgbImage,
}

impl CubeMapDraw {
    /// Looks `map` up.
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

    fn picture(&mut self, camera: &Camera) -> JudgedFrame {
        JudgedFrame {
            color: self.map.resample(camera),
            shown: Vec::new(),
        }
    }
}
