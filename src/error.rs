//! One error for all that the library does.

use headbox_core::camera::CameraError;
use headbox_core::container::FileError;
use headbox_core::frame::FrameError;
use headbox_core::metrics::MetricError;
use headbox_cube::pack::PackError;
use headbox_house::backdrop::BackdropError;
use headbox_house::file::HouseFileError;
use headbox_house::house::HouseError;
use headbox_ldi::scene_source::SceneSourceError;
use headbox_sprite::SpriteError;
use headbox_trace::viewpoint::HeadboxError;

/// Why something could not be done. The sentence says which file, which value and what was expected; nothing panics on input.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A scene cannot be opened.
    #[error(transparent)]
    Scene(#[from] SceneSourceError),
    /// A headbox cannot be placed.
    #[error(transparent)]
    Headbox(#[from] HeadboxError),
    /// A capture was asked for what cannot be.
    #[error("{name} is {value}; it must be from {} to {}", .allowed[0], .allowed[1])]
    Parameter {
        /// Which parameter.
        name: &'static str,
        /// Its value.
        value: f64,
        /// The least and the most that it may be.
        allowed: [f64; 2],
    },
    /// A capture was given up, or its temporary files failed.
    #[error("the capture failed: {0}")]
    Capture(#[from] std::io::Error),
    /// A capture cannot be packed.
    #[error(transparent)]
    Pack(#[from] PackError),
    /// There is no such camera.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// A file of ours cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// A frame cannot be saved.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// Sprites cannot be made.
    #[error(transparent)]
    Sprite(#[from] SpriteError),
    /// A house cannot be opened or walked.
    #[error(transparent)]
    House(#[from] HouseError),
    /// A `.house` file cannot be read or written.
    #[error(transparent)]
    HouseFile(#[from] HouseFileError),
    /// What is behind a portal cannot be captured.
    #[error(transparent)]
    Backdrop(#[from] BackdropError),
    /// Pictures cannot be compared.
    #[error(transparent)]
    Metric(#[from] MetricError),
}
