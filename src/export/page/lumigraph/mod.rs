//! Page of a layered lumigraph: the images of its cameras, and the layer of each of their pixels.
//!
//! Rays are blended from the four cameras around each, by the rules of [`headbox_lumigraph`]; the
//! page plans the layers that a frame merges itself (`plan.js`).

use super::{Content, Part, byte_planes, check_size, environment, png};
use crate::{ExportError, POSTER_PX, jpeg};
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::view::level_up;
use headbox_lumigraph::{Lumigraph, LumigraphRenderer, LumigraphSettings, Picture};
use serde_json::json;

pub(super) const MODULES: &[&str] = &[
    include_str!("plan.js"),
    include_str!("place.js"),
    include_str!("shaders.js"),
    include_str!("renderer.js"),
];

/// Frame size that determines the initial field of view.
const FIRST_PX: [u32; 2] = [1024, 768];

/// Builds the content of a page of a lumigraph.
pub(super) fn content(lumigraph: &Lumigraph) -> Result<Content, ExportError> {
    let grid = lumigraph.grid();
    check_size((grid.camera_count() * grid.picture_pixels()) as u64 / 4)?;
    let mut parts = Vec::new();
    if lumigraph.environment.size_px > 0 {
        parts.push(environment(&lumigraph.environment));
    }
    let ends = lumigraph
        .layers()
        .iter()
        .flat_map(|layer| [layer.min, layer.max]);
    parts.push(Part {
        header: json!({"kind": "layers"}),
        bytes: ends.flat_map(f64::to_le_bytes).collect(),
    });
    for (round, shown) in rounds([grid.columns().len(), grid.rows().len()])
        .into_iter()
        .enumerate()
    {
        for camera in &shown.new {
            let (picture, later) = (&lumigraph.pictures()[*camera], round > 0);
            let header = json!({"kind": "indices", "camera": camera, "later": later});
            parts.push(Part {
                header,
                bytes: indices(picture),
            });
            let texels: Vec<[u8; 4]> = picture
                .color
                .iter()
                .map(|[r, g, b]| [*r, *g, *b, 255])
                .collect();
            let mut header = json!({"kind": "colors", "camera": camera, "later": later});
            if Some(camera) == shown.new.last() {
                header["shows"] = json!({"columns": shown.lines[0], "rows": shown.lines[1]});
            }
            parts.push(Part {
                header,
                bytes: png(&texels, grid.size_px())?,
            });
        }
    }
    let axes = grid.world_from_eye();
    let frame = lumigraph.info.frame;
    let header = json!({
        "centre": grid.origin(),
        "frame": {"unit": frame.unit_m, "zUp": bool::from(frame.up)},
        "ahead": -axes.z_axis,
        "up": level_up(Some(axes.y_axis)),
        "fov": lumigraph.clear_fov_deg(FIRST_PX),
        "nearest": lumigraph.range().map_or(1.0, |[_, max]| 1.0 / max),
        "grid": {
            "right": axes.x_axis, "up": axes.y_axis, "back": axes.z_axis, "columns": grid.columns(), "rows": grid.rows(),
            "focal": grid.focal_px(), "size": grid.size_px(), "convergence": grid.convergence(),
        },
    });
    Ok(Content {
        header,
        parts,
        poster: poster(lumigraph)?,
        modules: MODULES,
    })
}

/// Step of the progressive transfer: a sparser grid of cameras that the page can render.
struct ImageRound {
    /// Indices of its columns and rows.
    lines: [Vec<usize>; 2],
    /// Cameras that are transferred in this step.
    new: Vec<usize>,
}

/// Transfer order of a grid's images: its corners first, then each round halves the gaps.
fn rounds([columns, rows]: [usize; 2]) -> Vec<ImageRound> {
    let mut lines = [columns, rows].map(|count| {
        let mut ends = vec![0, count - 1];
        ends.dedup();
        ends
    });
    let mut known = vec![false; columns * rows];
    let mut rounds = Vec::new();
    loop {
        let of_row = |row: &usize| {
            lines[0]
                .iter()
                .map(move |column| row * columns + column)
                .collect::<Vec<_>>()
        };
        let cameras = lines[1].iter().flat_map(of_row);
        let new = cameras
            .filter(|camera| !std::mem::replace(&mut known[*camera], true))
            .collect();
        rounds.push(ImageRound {
            lines: lines.clone(),
            new,
        });
        if lines[0].len() == columns && lines[1].len() == rows {
            return rounds;
        }
        lines = lines.map(|lines| halve_gaps(&lines));
    }
}

/// Adds the middles of the gaps between ascending numbers.
fn halve_gaps(numbers: &[usize]) -> Vec<usize> {
    let middles = numbers
        .windows(2)
        .map(|pair| usize::midpoint(pair[0], pair[1]));
    let mut all: Vec<usize> = numbers.iter().copied().chain(middles).collect();
    all.sort_unstable();
    all.dedup();
    all
}

/// Encodes the layers of an image's pixels as differences: low bytes, then high bytes.
fn indices(picture: &Picture) -> Vec<u8> {
    let previous = std::iter::once(&0).chain(&picture.index);
    let differences: Vec<u32> = picture
        .index
        .iter()
        .zip(previous)
        .map(|(index, previous)| index.wrapping_sub(*previous).into())
        .collect();
    byte_planes(&differences, 2)
}

/// Renders the first view as a JPEG file.
fn poster(lumigraph: &Lumigraph) -> Result<Vec<u8>, ExportError> {
    let (grid, fov_y_deg) = (lumigraph.grid(), lumigraph.clear_fov_deg(POSTER_PX));
    let axes = grid.world_from_eye();
    let (eye, up): (DVec3, DVec3) = (grid.origin(), axes.y_axis);
    let camera = Camera::look_at(eye, eye - axes.z_axis, up, fov_y_deg, POSTER_PX)?;
    jpeg(
        LumigraphRenderer::new()
            .render(lumigraph, &camera, &LumigraphSettings::default())
            .0,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounds_start_with_corners_and_cover_grid() {
        for [columns, rows] in [[1, 1], [1, 5], [2, 2], [4, 4], [8, 3], [7, 9]] {
            let (mut known, rounds) = (Vec::new(), rounds([columns, rows]));
            for ImageRound { lines, new } in &rounds {
                known.extend(new);
                assert!(
                    !new.is_empty() && lines.iter().all(|lines| lines.is_sorted_by(|a, b| a < b))
                );
                // All that it shows is there.
                for (row, column) in lines[1]
                    .iter()
                    .flat_map(|row| lines[0].iter().map(move |column| (row, column)))
                {
                    assert!(known.contains(&(row * columns + column)), "{row} {column}");
                }
            }
            assert_eq!(rounds[0].new.len(), columns.min(2) * rows.min(2));
            known.sort_unstable();
            assert!(known.into_iter().eq(0..columns * rows), "{columns} {rows}");
        }
        let columns: Vec<Vec<usize>> = rounds([8, 1])
            .into_iter()
            .map(|shown| shown.lines[0].clone())
            .collect();
        assert_eq!(
            columns,
            [
                vec![0, 7],
                vec![0, 3, 7],
                vec![0, 1, 3, 5, 7],
                (0..8).collect()
            ]
        );
    }
}
