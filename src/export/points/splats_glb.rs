//! Flat Gaussians as standard glTF: `.glb` with the extension KHR_gaussian_splatting (release
//! candidate of 2026).
//!
//! Positions are metres from the centre of the headbox in the axes of glTF, X right, Y up, Z
//! toward the viewer; the node moves them to the place of the headbox. Colours are those of
//! display, as in the `.ply` of [`super::splats`]. Viewers without the extension show points with
//! linear vertex colours (`COLOR_0`).

use super::splats::{Gaussian, harmonics};
use super::{PointBudget, PointSummary, Points};
use crate::ExportError;
use crate::mesh::glb_file::glb_header;
use glam::Vec3;
use headbox_core::color::linear_from_srgb8;
use headbox_core::headbox::Headbox;
use headbox_core::progress::{Progress, Silent};
use headbox_cube::pack::CubeLdi;
use headbox_scene::load::HEADBOX_HALF_SIZE;
use serde_json::{Value, json};
use std::io::Write;

/// Name of the extension.
const EXTENSION: &str = "KHR_gaussian_splatting";

/// Bytes of a Gaussian; its values are interleaved.
const STRIDE: u64 = 64;

/// Component types of glTF.
const FLOAT: u32 = 5126;
const UNSIGNED_SHORT: u32 = 5123;

/// Attributes of a Gaussian: name, offset in bytes, component type, and type.
const ATTRIBUTES: [(&str, u64, u32, &str); 6] = [
    ("POSITION", 0, FLOAT, "VEC3"),
    ("KHR_gaussian_splatting:ROTATION", 12, FLOAT, "VEC4"),
    ("KHR_gaussian_splatting:SCALE", 28, FLOAT, "VEC3"),
    ("KHR_gaussian_splatting:OPACITY", 40, FLOAT, "SCALAR"),
    (
        "KHR_gaussian_splatting:SH_DEGREE_0_COEF_0",
        44,
        FLOAT,
        "VEC3",
    ),
    ("COLOR_0", 56, UNSIGNED_SHORT, "VEC4"),
];

/// Writes the Gaussians of [`super::splats::write_ply`] within a budget.
///
/// # Errors
/// [`ExportError::Empty`], [`ExportError::Budget`], [`ExportError::TooLarge`], [`ExportError::Io`].
pub fn write(
    cube: &CubeLdi,
    budget: PointBudget,
    progress: &dyn Progress,
    to: &mut dyn Write,
) -> Result<PointSummary, ExportError> {
    let headbox = Headbox {
        centre: cube.info.centre,
        half_size_m: cube.info.half_size_m,
    };
    // No number is written with more digits than these.
    let longest = [Vec3::splat(-f32::MIN_POSITIVE / 3.0); 2];
    let count = u64::from(u32::MAX) / STRIDE;
    let header_bytes = glb_header(&document(headbox, count, longest), 0)?.len() as u64;
    let points = Points::new(cube, true, budget, [header_bytes, STRIDE], progress)?;
    let mut bounds = [Vec3::INFINITY, Vec3::NEG_INFINITY];
    points.for_each(&Silent, &mut |surfel| {
        let position = surfel.position.as_vec3();
        bounds = [bounds[0].min(position), bounds[1].max(position)];
        Ok(())
    })?;
    let count = points.summary.points;
    let header = glb_header(&document(headbox, count, bounds), count * STRIDE)?;
    to.write_all(&header)?;
    points.for_each(progress, &mut |surfel| {
        Ok(to.write_all(&bytes(&Gaussian::new(surfel, |v| v)))?)
    })?;
    Ok(points.summary)
}

/// Returns the values of a Gaussian in the order of [`ATTRIBUTES`].
fn bytes(gaussian: &Gaussian) -> [u8; STRIDE as usize] {
    let [r, g, b, a] = gaussian.color_srgb;
    let alpha = f32::from(a) / 255.0;
    let rotation = gaussian.rotation.normalize();
    let mut floats = [0.0; 14];
    floats[..3].copy_from_slice(&gaussian.position.to_array());
    floats[3..7].copy_from_slice(&rotation.to_array());
    floats[7..10].copy_from_slice(&gaussian.deviations);
    floats[10] = alpha;
    floats[11..].copy_from_slice(&harmonics(gaussian.color_srgb));
    let color = [
        linear_from_srgb8(r),
        linear_from_srgb8(g),
        linear_from_srgb8(b),
        alpha,
    ];
    let color = color.map(|c| (c * 65_535.0).round() as u16);
    let mut bytes = [0; STRIDE as usize];
    for (to, value) in bytes.chunks_exact_mut(4).zip(floats) {
        to.copy_from_slice(&value.to_le_bytes());
    }
    for (to, value) in bytes[56..].chunks_exact_mut(2).zip(color) {
        to.copy_from_slice(&value.to_le_bytes());
    }
    bytes
}

/// Returns the JSON of a file with `count` Gaussians whose positions have the given bounds.
fn document(headbox: Headbox, count: u64, [low, high]: [Vec3; 2]) -> Value {
    let accessor = |(name, offset, component, kind): (&str, u64, u32, &str)| {
        let mut accessor = json!({
            "bufferView": 0, "byteOffset": offset, "componentType": component, "count": count, "type": kind,
        });
        if component == UNSIGNED_SHORT {
            accessor["normalized"] = true.into();
        }
        if name == "POSITION" {
            accessor["min"] = low.to_array().into();
            accessor["max"] = high.to_array().into();
        }
        accessor
    };
    let attributes: serde_json::Map<String, Value> = ATTRIBUTES
        .iter()
        .enumerate()
        .map(|(i, (name, ..))| ((*name).to_owned(), i.into()))
        .collect();
    json!({
        "asset": {"version": "2.0", "generator": "headbox"},
        "extensionsUsed": [EXTENSION, "KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{
            "name": "headbox", "mesh": 0, "translation": headbox.centre.to_array(),
            "extras": {HEADBOX_HALF_SIZE: headbox.half_size_m},
        }],
        "meshes": [{"primitives": [{
            "attributes": attributes, "mode": 0, "material": 0,
            "extensions": {EXTENSION: {
                "kernel": "ellipse", "colorSpace": "srgb_rec709_display",
                "sortingMethod": "cameraDistance", "projection": "perspective",
            }},
        }]}],
        "materials": [{"extensions": {"KHR_materials_unlit": {}}}],
        "accessors": ATTRIBUTES.map(accessor),
        "bufferViews": [{
            "buffer": 0, "byteLength": count * STRIDE, "byteStride": STRIDE, "target": 34962,
        }],
        "buffers": [{"byteLength": count * STRIDE}],
    })
}
