//! Subject of a report: a scene with optional files of its representations.

use super::contender::SharedView;
use headbox_cube::pack::CubeLdi;
use headbox_sprite::SpriteSet;
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use std::sync::Arc;

/// Error of a report.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// A thread pool could not be started.
    #[error("threads could not be started: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    /// A camera is invalid.
    #[error(transparent)]
    Camera(#[from] headbox_core::camera::CameraError),
    /// A capture failed.
    #[error("a capture failed: {0}")]
    Capture(#[from] std::io::Error),
    /// A capture could not be packed.
    #[error(transparent)]
    Pack(#[from] headbox_cube::pack::PackError),
    /// Sprites could not be captured.
    #[error(transparent)]
    Sprite(#[from] headbox_sprite::SpriteError),
    /// A lumigraph could not be captured.
    #[error(transparent)]
    Lumigraph(#[from] headbox_lumigraph::LumigraphError),
    /// A frame is not a valid image.
    #[error(transparent)]
    Frame(#[from] headbox_core::frame::FrameError),
    /// Embree was requested and failed.
    #[error("the program that HEADBOX_EMBREE names: {0}")]
    Rival(#[source] std::io::Error),
    /// Frames could not be compared.
    #[error(transparent)]
    Metric(#[from] headbox_core::metrics::MetricError),
}

/// Subject of a report.
pub struct Subject {
    /// Name in the rows.
    pub name: String,
    /// Tracer of the scene, its origin at the centre of the headbox.
    pub tracer: Arc<Tracer>,
    /// Light of the scene.
    pub lighting: Lighting,
    /// True if truth is lit.
    pub lit: bool,
    /// Cube LDI from a file, instead of a new capture.
    pub cube: Option<CubeLdi>,
    /// Sprites from a file, instead of a new capture.
    pub sprites: Option<SpriteSet>,
    /// Another representation of the scene, as a further contender.
    pub view: Option<SharedView>,
}
