//! Sources of the window: each kind of file as a [`FrameSource`](headbox_viewer::FrameSource), and
//! the built-in scenes as its [`Library`](headbox_viewer::Library).
//!
//! | file | what |
//! |---|---|
//! | `library` | which source opens what; the start page |
//! | `view` | any [`View`](headbox_core::view::View) of a file |
//! | `cube` | a cube LDI that grows while it is looked at |
//! | `progressive_capture` | the capture of a scene in rounds, on a thread of low priority |
//! | `photographs` | a folder of photographs without depth, coloured into cube LDIs in the background, coarse ones first |
//! | `points` | a scene as points, until its first round is captured |
//! | `house` | a house whose light is baked while it is walked |
//! | `live` | a folder of images, by cube LDIs of those nearest to the view, built in the background |
//! | `marks` | where pictures were taken, drawn over what is made of them |
//! | `terms` | a sentence for each term of the panel |
//! | `threads` | frames rendered with fewer threads |

mod facts;
mod file_name;
mod marks;
pub mod sources;
mod terms;
#[cfg(test)]
mod tests;
mod threads;

pub use crate::marks::Marks;
pub use crate::sources::library::{
    OpenError, SceneLibrary, open, open_source, show_cube, show_live, show_marks, show_photographs,
    show_view,
};

use headbox_core::camera::Camera;
use headbox_core::view::StartView;
use headbox_viewer::Pose;

/// Upright pose that shows what a camera sees.
fn start_at(camera: &Camera) -> Pose {
    sources::view::pose(&StartView::of_camera(camera))
}
