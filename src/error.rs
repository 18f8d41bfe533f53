//! The error of the library.

use headbox_core::camera::CameraError;
use headbox_core::container::FileError;
use headbox_core::frame::FrameError;
use headbox_core::metrics::MetricError;
use headbox_cube::pack::PackError;
use headbox_house::backdrop::BackdropError;
use headbox_house::file::HouseFileError;
use headbox_house::house::HouseError;
use headbox_ldi::scene_source::SceneSourceError;
use headbox_ldi::spec::RangeError;
use headbox_sprite::SpriteError;
use headbox_trace::viewpoint::HeadboxError;

/// Error of any operation of the library. Its message names the file or the value, and what was
/// expected; invalid input never panics.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A scene cannot be opened.
    #[error(transparent)]
    Scene(#[from] SceneSourceError),
    /// A headbox cannot be placed.
    #[error(transparent)]
    Headbox(#[from] HeadboxError),
    /// A parameter of a capture is out of range.
    #[error(transparent)]
    Parameter(#[from] RangeError),
    /// A capture was cancelled, or its temporary files failed.
    #[error("the capture failed: {0}")]
    Capture(#[from] std::io::Error),
    /// A capture cannot be packed.
    #[error(transparent)]
    Pack(#[from] PackError),
    /// A camera is invalid.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// A file of this library cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// A frame cannot be saved.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// Sprites cannot be captured.
    #[error(transparent)]
    Sprite(#[from] SpriteError),
    /// A house cannot be opened or walked.
    #[error(transparent)]
    House(#[from] HouseError),
    /// A `.house` file cannot be read or written.
    #[error(transparent)]
    HouseFile(#[from] HouseFileError),
    /// A backdrop of a portal cannot be captured.
    #[error(transparent)]
    Backdrop(#[from] BackdropError),
    /// Images cannot be compared.
    #[error(transparent)]
    Metric(#[from] MetricError),
}
