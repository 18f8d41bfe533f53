//! Sources of the window: each kind of file as a [`FrameSource`](headbox_viewer::FrameSource), and
//! the built-in scenes as its [`Library`](headbox_viewer::Library).
//!
//! | file | what |
//! |---|---|
//! | `library` | which source opens what; the start page |
//! | `cube` | a cube LDI, from a file or growing; its overlays |
//! | `progressive_capture` | the progressive capture of a scene, in rounds on a thread of low priority |
//! | `photographs` | a folder of photographs without depth, coloured into cube LDIs in the background, coarse ones first |
//! | `points` | a scene as points, until its first round is captured |
//! | `reference` | ray-traced truth of the current view, refined in the background |
//! | `variation` | the LDI with some of its segments, or recoloured by depth, layer, face, segment |
//! | `overlay` | what is painted instead of colours |
//! | `effort` | overlays of how a frame was made: footprints, overdraw, clipping |
//! | `geometry` | a folder of images, drawn without a model |
//! | `geometry_overlay` | its overlays: whose pictures show, the mesh, ages |
//! | `house` | a house, walked; its backdrops are built in the background |
//! | `live` | a folder of images, by cube LDIs of those nearest to the view, built in the background |
//! | `lumigraph` | a lumigraph; its overlays |
//! | `marks` | where pictures were taken, drawn over what is made of them |
//! | `sprite` | a set of sprites with depth |
//! | `terms` | a sentence for each term of the panel |
//! | `background` | thread pools: of low priority for work nobody waits for, of fewer threads for frames |

mod background;
mod facts;
mod file_name;
mod overlays;
pub mod sources;
mod terms;
#[cfg(test)]
mod tests;

pub use crate::overlays::marks::Marks;
pub use crate::sources::library::{
    OpenError, SceneLibrary, open, open_source, show_cube, show_geometry, show_live, show_marks,
    show_photographs,
};

use headbox_core::camera::Camera;
use headbox_trace::viewpoint::level_up;
use headbox_viewer::Pose;

/// Upright pose that shows what a camera sees.
fn start_at(camera: &Camera) -> Pose {
    let fov_y_deg = 2.0
        * (f64::from(camera.height()) / 2.0 / camera.focal_px())
            .atan()
            .to_degrees();
    let up = level_up(Some(camera.world_from_eye().y_axis));
    Pose::upright(camera.eye(), camera.eye() + camera.forward(), up, fov_y_deg)
}
