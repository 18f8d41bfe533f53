//! A layered lumigraph as a page: the images of its cameras, and the layer of each of their pixels.
//!
//! Frames are blended ray by ray from the four cameras about it, by the rules of [`crate::lumigraph`]; what a frame merges is
//! planned in the page (`plan.js`).

use super::{Content, MAX_PAGE_BYTES, Part, environment, png};
use crate::capture::Camera;
use crate::export::{ExportError, POSTER_PX, jpeg};
use crate::lumigraph::{Lumigraph, LumigraphRenderer, LumigraphSettings, Picture};
use glam::DVec3;
use serde_json::json;

pub(super) const MODULES: &[&str] =
    &[include_str!("plan.js"), include_str!("place.js"), include_str!("shaders.js"), include_str!("renderer.js")];

/// Width and height of the frame whose field of view the page begins with.
const FIRST_PX: [u32; 2] = [1024, 768];

/// What a page of a lumigraph holds.
pub(super) fn content(lumigraph: &Lumigraph) -> Result<Content, ExportError> {
    let grid = lumigraph.grid();
    let at_least = (grid.camera_count() * grid.picture_pixels()) as u64 / 4;
    if at_least > MAX_PAGE_BYTES {
        return Err(ExportError::TooLarge { bytes: at_least, limit: MAX_PAGE_BYTES });
    }
    let mut parts = Vec::new();
    if lumigraph.environment.size_px > 0 {
        parts.push(environment(&lumigraph.environment));
    }
    let ends = lumigraph.layers().iter().flat_map(|layer| [layer.min, layer.max]);
    parts.push(Part { header: json!({"kind": "layers"}), bytes: ends.flat_map(f64::to_le_bytes).collect() });
    for (camera, picture) in lumigraph.pictures().iter().enumerate() {
        parts.push(Part { header: json!({"kind": "indices", "camera": camera}), bytes: indices(picture) });
        let texels: Vec<[u8; 4]> = picture.color.iter().map(|[r, g, b]| [*r, *g, *b, 255]).collect();
        let last = camera + 1 == grid.camera_count();
        let header = json!({"kind": "colors", "camera": camera, "last": last});
        parts.push(Part { header, bytes: png(&texels, grid.size_px())? });
    }
    let axes = grid.world_from_eye();
    let frame = lumigraph.info.frame;
    let header = json!({
        "centre": grid.origin(),
        "frame": {"unit": frame.unit_m, "zUp": bool::from(frame.up)},
        "ahead": -axes.z_axis,
        "fov": lumigraph.clear_fov_deg(FIRST_PX),
        "nearest": lumigraph.range().map_or(1.0, |[_, max]| 1.0 / max),
        "grid": {
            "right": axes.x_axis, "up": axes.y_axis, "back": axes.z_axis, "columns": grid.columns(), "rows": grid.rows(),
            "focal": grid.focal_px(), "size": grid.size_px(), "convergence": grid.convergence(),
        },
    });
    Ok(Content { header, parts, poster: poster(lumigraph)?, modules: MODULES })
}

/// The layers of an image's pixels, each less the one before: low bytes, then high ones.
fn indices(picture: &Picture) -> Vec<u8> {
    let before = std::iter::once(&0).chain(&picture.index);
    let more: Vec<[u8; 2]> =
        picture.index.iter().zip(before).map(|(index, before)| index.wrapping_sub(*before).to_le_bytes()).collect();
    (0..2).flat_map(|byte| more.iter().map(move |two| two[byte])).collect()
}

/// A JPEG file of the first view.
pub(crate) fn poster(lumigraph: &Lumigraph) -> Result<Vec<u8>, ExportError> {
    let (grid, fov_y_deg) = (lumigraph.grid(), lumigraph.clear_fov_deg(POSTER_PX));
    let axes = grid.world_from_eye();
    let (eye, up): (DVec3, DVec3) = (grid.origin(), axes.y_axis);
    let camera = Camera::look_at(eye, eye - axes.z_axis, up, fov_y_deg, POSTER_PX)?;
    jpeg(LumigraphRenderer::new().render(lumigraph, &camera, &LumigraphSettings::default()).0)
}
