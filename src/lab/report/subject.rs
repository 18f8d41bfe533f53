//! Subjects of a report: the scene itself, and given files.

use super::contender::SharedView;
use headbox_cube::pack::CubeLdi;
use headbox_sprite::SpriteSet;
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use std::sync::Arc;

/// Why a report could not be made.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// Threads could not be started.
    #[error("threads could not be started: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    /// A camera could not be made.
    #[error(transparent)]
    Camera(#[from] headbox_core::camera::CameraError),
    /// A capture failed.
    #[error("a capture failed: {0}")]
    Capture(#[from] std::io::Error),
    /// A capture could not be packed.
    #[error(transparent)]
    Pack(#[from] headbox_cube::pack::PackError),
    /// Sprites could not be made.
    #[error(transparent)]
    Sprite(#[from] headbox_sprite::SpriteError),
    /// A lumigraph could not be made.
    #[error(transparent)]
    Lumigraph(#[from] headbox_lumigraph::LumigraphError),
    /// A frame is no picture.
    #[error(transparent)]
    Frame(#[from] headbox_core::frame::FrameError),
    /// The rival was asked for and failed.
    #[error("the program that HEADBOX_EMBREE names: {0}")]
    Rival(#[source] std::io::Error),
    /// Pictures could not be compared.
    #[error(transparent)]
    Metric(#[from] headbox_core::metrics::MetricError),
}

/// Subject of a report.
pub struct Subject {
    /// Name in the rows.
    pub name: String,
    /// The scene, its origin at the centre of the headbox.
    pub tracer: Arc<Tracer>,
    /// Its light.
    pub lighting: Lighting,
    /// True if truth is lit.
    pub lit: bool,
    /// A capture that is given instead of made.
    pub cube: Option<CubeLdi>,
    /// Sprites that are given instead of made.
    pub sprites: Option<SpriteSet>,
    /// Another representation of the scene, to be compared with what is made.
    pub view: Option<SharedView>,
}
