//! Promises of exports of Gaussian splats as glTF (KHR_gaussian_splatting), and of splats as input.

#![expect(
    clippy::unwrap_used,
    reason = "in a test a panic is the failure report"
)]

use crate::run::{fails, json, succeeds};
use glam::{Mat3, Quat, Vec3};
use serde_json::{Value, json};
use std::path::Path;

/// A Gaussian of a file, in the axes of glTF.
struct Splat {
    position: Vec3,
    rotation: Mat3,
    scale: Vec3,
    opacity: f32,
    harmonic: Vec3,
}

fn floats(bytes: &[u8]) -> Vec<f32> {
    let float = |chunk: &[u8]| f32::from_le_bytes(chunk.try_into().unwrap());
    bytes.chunks_exact(4).map(float).collect()
}

/// Reads a GLB: its JSON and its binary data.
fn read_glb(path: &Path) -> (Value, Vec<u8>) {
    let file = std::fs::read(path).unwrap();
    let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap()) as usize;
    assert_eq!(
        (&file[..4], word(4), word(8)),
        (&b"glTF"[..], 2, file.len())
    );
    let end = 20 + word(12);
    assert_eq!(
        (&file[16..20], &file[end + 4..end + 8]),
        (&b"JSON"[..], &b"BIN\0"[..])
    );
    assert_eq!(end + 8 + word(end), file.len());
    let json = serde_json::from_slice(&file[20..end]).unwrap();
    (json, file[end + 8..].to_vec())
}

/// Returns the values of an attribute of the only primitive, one element after another.
fn attribute(gltf: &Value, data: &[u8], name: &str, kind: &str, component: u32) -> Vec<Vec<u8>> {
    let index = &gltf["meshes"][0]["primitives"][0]["attributes"][name];
    let accessor = &gltf["accessors"][index.as_u64().unwrap() as usize];
    assert_eq!(
        (&accessor["type"], &accessor["componentType"]),
        (&json!(kind), &json!(component))
    );
    let view = &gltf["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
    let number = |value: &Value| value.as_u64().unwrap_or(0) as usize;
    let start = number(&view["byteOffset"]) + number(&accessor["byteOffset"]);
    let stride = number(&view["byteStride"]);
    let components = match kind {
        "SCALAR" => 1,
        "VEC3" => 3,
        _ => 4,
    };
    let bytes = components * if component == 5126 { 4 } else { 2 };
    assert!(start + (number(&accessor["count"]) - 1) * stride + bytes <= data.len());
    (0..number(&accessor["count"]))
        .map(|i| data[start + i * stride..start + i * stride + bytes].to_vec())
        .collect()
}

fn splats_of_glb(gltf: &Value, data: &[u8]) -> Vec<Splat> {
    let read = |name: &str, kind: &str| -> Vec<Vec<f32>> {
        let name = if name == "POSITION" {
            name.to_owned()
        } else {
            format!("KHR_gaussian_splatting:{name}")
        };
        let elements = attribute(gltf, data, &name, kind, 5126);
        elements.iter().map(|element| floats(element)).collect()
    };
    let positions = read("POSITION", "VEC3");
    let rotations = read("ROTATION", "VEC4");
    let scales = read("SCALE", "VEC3");
    let opacities = read("OPACITY", "SCALAR");
    let harmonics = read("SH_DEGREE_0_COEF_0", "VEC3");
    (0..positions.len())
        .map(|i| {
            let rotation = Quat::from_slice(&rotations[i]);
            assert!((rotation.length() - 1.0).abs() < 1e-6, "{rotation}");
            Splat {
                position: Vec3::from_slice(&positions[i]),
                rotation: Mat3::from_quat(rotation),
                scale: Vec3::from_slice(&scales[i]),
                opacity: opacities[i][0],
                harmonic: Vec3::from_slice(&harmonics[i]),
            }
        })
        .collect()
}

/// Reads a PLY of Gaussians, whose axes are X right, Y down, Z ahead.
fn splats_of_ply(path: &Path) -> Vec<Splat> {
    let file = std::fs::read(path).unwrap();
    let end = b"end_header\n";
    let start = file.windows(end.len()).position(|at| at == end).unwrap() + end.len();
    let turn = Mat3::from_diagonal(Vec3::new(1.0, -1.0, -1.0));
    let splat = |bytes: &[u8]| {
        let v = floats(bytes);
        Splat {
            position: turn * Vec3::from_slice(&v),
            rotation: turn * Mat3::from_quat(Quat::from_xyzw(v[14], v[15], v[16], v[13])),
            scale: Vec3::from_slice(&v[10..]).map(f32::exp),
            opacity: 1.0 / (1.0 + (-v[9]).exp()),
            harmonic: Vec3::from_slice(&v[6..]),
        }
    };
    file[start..].chunks_exact(68).map(splat).collect()
}

fn capture(folder: &Path) {
    let small = [
        "--face-size",
        "24",
        "--strata",
        "4",
        "--rays",
        "2",
        "--light-samples",
        "1",
    ];
    succeeds(
        folder,
        &[&["capture", "builtin:bump", "-o", "a.ldi"], &small[..]].concat(),
    );
}

#[test]
fn gaussians_of_glb_are_those_of_ply() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path();
    capture(folder);
    succeeds(folder, &["export", "a.ldi", "-o", "a.ply"]);
    succeeds(folder, &["export", "a.ldi", "-o", "a.glb", "--gaussians"]);
    let (gltf, data) = read_glb(&folder.join("a.glb"));
    let (found, expected) = (
        splats_of_glb(&gltf, &data),
        splats_of_ply(&folder.join("a.ply")),
    );
    assert_eq!(found.len(), expected.len());
    assert!(found.len() > 1000);
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for (a, b) in found.iter().zip(&expected) {
        (low, high) = (low.min(a.position), high.max(a.position));
        assert_eq!(a.position, b.position);
        assert_eq!(a.harmonic, b.harmonic);
        assert!(a.scale.min_element() > 0.0);
        // The logarithm of scales has steps of half a millionth where they are small.
        assert!(((a.scale - b.scale) / b.scale).abs().max_element() < 2e-6);
        // Quaternions of both axes are rounded for themselves.
        assert!(
            a.rotation.abs_diff_eq(b.rotation, 2e-6),
            "{} {}",
            a.rotation,
            b.rotation
        );
        // Logits have no 0 and 1.
        assert!((a.opacity.clamp(0.004, 0.996) - b.opacity).abs() < 1e-6);
    }
    let accessor = &gltf["accessors"][0];
    for (bound, values) in [("min", low), ("max", high)] {
        let bound: Vec<f32> = serde_json::from_value(accessor[bound].clone()).unwrap();
        assert_eq!(Vec3::from_slice(&bound), values);
    }
    let primitive = &gltf["meshes"][0]["primitives"][0];
    assert_eq!(primitive["mode"], 0);
    let extension = json!({
        "kernel": "ellipse", "colorSpace": "srgb_rec709_display",
        "sortingMethod": "cameraDistance", "projection": "perspective",
    });
    assert_eq!(primitive["extensions"]["KHR_gaussian_splatting"], extension);
    let used = gltf["extensionsUsed"].as_array().unwrap();
    assert!(used.contains(&json!("KHR_gaussian_splatting")));
    // The extension's formula of the fallback: decoded from sRGB, with opacity as alpha.
    let colors = attribute(&gltf, &data, "COLOR_0", "VEC4", 5123);
    for (color, splat) in colors.iter().zip(&found) {
        let value =
            |i: usize| f32::from(u16::from_le_bytes([color[2 * i], color[2 * i + 1]])) / 65_535.0;
        let srgb = (splat.harmonic * 0.282_095 + 0.5).clamp(Vec3::ZERO, Vec3::ONE);
        let linear = srgb.map(|c| {
            if c <= 0.040_45 {
                c / 12.92
            } else {
                ((c + 0.055) / 1.055).powf(2.4)
            }
        });
        let rgb = Vec3::new(value(0), value(1), value(2));
        assert!(rgb.abs_diff_eq(linear, 2e-5), "{rgb} {linear}");
        assert!((value(3) - splat.opacity).abs() < 1e-5);
    }
}

#[test]
fn glb_of_gaussians_keeps_its_budget() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path();
    capture(folder);
    let export = ["export", "a.ldi", "-o", "a.glb", "--json", "--gaussians"];
    let all = json(folder, &export)["points"].as_u64().unwrap();
    let few = json(folder, &[&export[..], &["500"]].concat());
    assert!(few["points"].as_u64().unwrap() <= 500, "{few}");
    let small = json(folder, &[&export[..], &["--mb", "0.05"]].concat());
    assert!(small["bytes"].as_u64().unwrap() <= 50_000, "{small}");
    let points = small["points"].as_u64().unwrap();
    assert!((400..all).contains(&points), "{small}");
    fails(
        folder,
        2,
        &[
            "export",
            "a.ldi",
            "-o",
            "a.glb",
            "--gaussians",
            "--triangles",
            "9",
        ],
        "--triangles and --gaussians are two contents of a .glb",
    );
}

#[test]
fn splats_as_scenes_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path();
    capture(folder);
    succeeds(folder, &["export", "a.ldi", "-o", "a.ply"]);
    succeeds(
        folder,
        &["export", "a.ldi", "-o", "a.glb", "--gaussians", "100"],
    );
    let packed = "ply\nformat binary_little_endian 1.0\nelement chunk 1\nproperty float min_x\n\
        element vertex 1\nproperty uint packed_position\nproperty uint packed_rotation\nend_header\n";
    std::fs::write(folder.join("b.ply"), [packed.as_bytes(), &[0; 12]].concat()).unwrap();
    std::fs::write(folder.join("a.spz"), [0; 99]).unwrap();
    for name in ["a.ply", "b.ply", "a.glb", "a.spz"] {
        let expected = format!("{name}: a cloud of Gaussian splats, not a mesh");
        fails(folder, 1, &["truth", name, "-o", "a.png"], &expected);
    }
}
