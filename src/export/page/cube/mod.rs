//! Page of a cube LDI. It is rendered by the rules of
//! [`headbox_cube::render::canvas::surface_canvas`], whose parameters are in the page's header, so
//! that its frames can be compared with the CPU's.

mod samples;
mod shell;

use super::texels::{TexelImage, residuals};
use super::{Content, Part, check_size, environment, poster};
use crate::ExportError;
use headbox_core::cube_face::Face;
use headbox_core::view::level_up;
use headbox_cube::model::depth_bins::DepthBins;
use headbox_cube::pack::splat_index::SPLAT_INDEX_COUNT;
use headbox_cube::pack::{CubeLdi, PlaneSet};
use headbox_cube::render::canvas::surface_canvas;
use headbox_cube::render::footprint::rules;
use serde_json::{Value, json};

pub(super) const MODULES: &[&str] = &[
    include_str!("../headbox.js"),
    include_str!("../texels.js"),
    include_str!("samples.js"),
    include_str!("shell.js"),
    include_str!("planes.js"),
    include_str!("shaders.js"),
    include_str!("renderer.js"),
];

/// Builds the content of a page of a cube.
pub(super) fn content(cube: &CubeLdi) -> Result<Content, ExportError> {
    if cube.depth_pixel_count() == 0
        && cube.planes.tiles.is_empty()
        && cube.environment.size_px == 0
    {
        return Err(ExportError::Empty);
    }
    check_size(cube.bytes() as u64 / 4)?;
    Ok(Content {
        header: header(cube),
        parts: parts(cube)?,
        poster: poster(cube)?,
        modules: MODULES,
    })
}

fn header(cube: &CubeLdi) -> Value {
    let info = &cube.info;
    let face_px = f64::from(cube.face_size_px);
    let faces = Face::ALL
        .map(|face| json!({"right": face.right(), "up": face.up(), "normal": face.normal()}));
    let segments: Vec<Value> = cube.segments.iter().map(|segment| {
        json!({"face": segment.face.index(), "min": segment.inverse_depth(0), "step": segment.inverse_depth_step()})
    }).collect();
    json!({
        "centre": info.centre,
        "halfSize": info.half_size_m,
        "frame": {"unit": info.frame.unit_m, "zUp": bool::from(info.frame.up)},
        "ahead": ahead(cube),
        "up": level_up(info.up),
        "fov": info.fov_y_deg.unwrap_or(60.0),
        "facePx": cube.face_size_px,
        "blockPx": samples::BLOCK_PX,
        "samples": cube.depth_pixel_count(),
        "faces": faces,
        "segments": segments,
        "rules": {
            "pixel": 2.0 / face_px,
            "tolerance": surface_canvas::SurfaceCanvas::tolerance(cube.face_size_px),
            "bin": DepthBins::new(info.half_size_m, cube.face_size_px).inverse_depth(1.0),
            "maxSlope": rules::MAX_SLOPE,
            "minRadius": rules::MIN_RADIUS_PX,
            "maxRadius": rules::MAX_RADIUS_PX,
            "minPeak": rules::MIN_PEAK,
            "wNear": rules::W_NEAR,
            "steps": rules::WEIGHT_STEPS,
            "opaque": rules::OPAQUE_WEIGHT,
            "rampStart": rules::RAMP_START,
        },
    })
}

/// Default viewing direction.
fn ahead(cube: &CubeLdi) -> glam::DVec3 {
    cube.info.ahead.unwrap_or(glam::DVec3::NEG_Z)
}

/// Returns all data, in the order in which a view needs them.
fn parts(cube: &CubeLdi) -> Result<Vec<Part>, ExportError> {
    let mut parts = vec![shell::part(cube)?, normals(cube)];
    parts.extend((cube.environment.size_px > 0).then(|| environment(&cube.environment)));
    parts.extend((!cube.planes.tiles.is_empty()).then(|| planes(&cube.planes)));
    let mut segments: Vec<usize> = (0..cube.segments.len()).collect();
    let toward = |i: &usize| cube.segments[*i].face.normal().dot(ahead(cube));
    segments.sort_by(|a, b| toward(b).total_cmp(&toward(a)));
    for i in segments {
        for part in samples::parts(&cube.segments[i]) {
            let header = json!({
                "kind": "samples", "segment": i, "blocks": part.blocks, "samples": part.samples, "later": toward(&i) <= 0.5,
            });
            parts.push(Part {
                header,
                bytes: part.bytes,
            });
        }
    }
    Ok(parts)
}

/// Encodes the normals of all splat indices, in the face's frame, as 16-bit integers of 1/32767.
fn normals(cube: &CubeLdi) -> Part {
    let normals =
        (0..SPLAT_INDEX_COUNT as u32).flat_map(|index| cube.layout.normal(index).to_array());
    let bytes = normals
        .flat_map(|c| ((c * 32767.0).round() as i16).to_le_bytes())
        .collect();
    Part {
        header: json!({"kind": "normals"}),
        bytes,
    }
}

/// Encodes planes and tiles as they are in memory, then the residuals of the tiles' texels.
fn planes(set: &PlaneSet) -> Part {
    let mut bytes = bytemuck::cast_slice(&set.planes).to_vec();
    bytes.extend_from_slice(bytemuck::cast_slice(&set.tiles));
    let pictures = set.tiles.iter().map(|tile| TexelImage {
        texels: tile.texel_range(),
        width: usize::from(tile.width),
        opaque: tile.opaque != 0,
    });
    bytes.extend(residuals(&set.texels, pictures));
    let header = json!({
        "kind": "planes", "planes": set.planes.len(), "tiles": set.tiles.len(), "texels": set.texels.len(),
    });
    Part { header, bytes }
}

#[cfg(test)]
mod tests {
    use super::*;
    use headbox_core::environment::Environment;
    use headbox_cube::model::info::CaptureInfo;
    use headbox_cube::pack::SplatIndexLayout;

    #[test]
    fn photographs_taken_upside_down_are_shown_upright() {
        let header_of = |info: CaptureInfo| {
            header(&CubeLdi {
                info,
                face_size_px: 8,
                layout: SplatIndexLayout::Normal,
                segments: Vec::new(),
                environment: Environment::default(),
                planes: PlaneSet::default(),
            })
        };
        let photographs = CaptureInfo {
            up: Some(glam::DVec3::NEG_Y),
            fov_y_deg: Some(44.0),
            ..CaptureInfo::default()
        };
        let of_photographs = header_of(photographs);
        assert_eq!(of_photographs["up"], json!([0.0, -1.0, 0.0]));
        assert_eq!(of_photographs["fov"], json!(44.0));
        let of_scene = header_of(CaptureInfo::default());
        assert_eq!(of_scene["up"], json!([0.0, 1.0, 0.0]));
        assert_eq!(of_scene["fov"], json!(60.0));
    }
}
