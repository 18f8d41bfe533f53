//! Sources of the window: each kind of file as a [`FrameSource`](headbox_viewer::FrameSource), and
//! the built-in scenes as its [`Library`](headbox_viewer::Library).
//!
//! | file | content |
//! |---|---|
//! | `library` | registry of sources by kind of file; the start page |
//! | `view` | any [`View`](headbox_core::view::View) as a source |
//! | `cube` | a cube LDI that is replaced by finer ones while it is shown |
//! | `progressive_capture` | the capture of a scene in rounds, on a thread of low priority |
//! | `photographs` | photographs without depth, coloured into cube LDIs in the background, coarse ones first |
//! | `preview` | scene without light, until its first round is captured and outside of the headbox |
//! | `house` | a house whose light is baked during the walk |
//! | `live` | a folder of images, by cube LDIs of those nearest to the view, built in the background |
//! | `marks` | camera positions and sparse points of an image set, drawn over frames |
//! | `terms` | explanations of the terms in the panel |
//! | `threads` | frames rendered with fewer threads |

mod facts;
mod file_name;
mod marks;
pub mod sources;
mod terms;
mod threads;

pub use crate::marks::Marks;
pub use crate::sources::library::{
    OpenError, SceneLibrary, is_captured, open, open_source, show_cube, show_live, show_marks,
    show_photographs, show_view,
};
pub use crate::sources::progressive_capture::CaptureOptions;

use headbox_core::camera::Camera;
use headbox_core::view::StartView;
use headbox_viewer::Pose;

/// Upright pose of a camera.
fn start_at(camera: &Camera) -> Pose {
    sources::view::pose(&StartView::from_camera(camera))
}
