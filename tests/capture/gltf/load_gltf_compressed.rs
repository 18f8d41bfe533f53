//! glTF files whose meshes and textures are compressed. The bytes were made by Draco 1.5, gltfpack
//! 1.3 and the encoder of Basis Universal 2.1.

use super::gltf_asset::{Asset, NODE, SQUARE, load_text, square};
use crate::folder::Folder;
use headbox_scene::scene::Scene;

/// A cube from -0.6 to 0.6: Draco, edge breaker, positions of 14 bits.
const DRACO_CUBE: &[u8] = include_bytes!("../../corpus/cube.drc");
/// Positions of eight bytes, the corners of a square, then those of a cube, and the indices of both.
const MESHOPT_CUBE: &[u8] = include_bytes!("../../corpus/cube.meshopt");
/// Size of the positions, bytes.
const MESHOPT_POSITIONS: usize = 138;
/// The cube's normals with the octahedral filter.
const MESHOPT_NORMALS: &str = "a00500c0c00003fdc0c00000fefd050000c0c0fd0300c00000fd000000000000000000000000000000000000\
    00000000000000000000000081007f00";
/// 4 x 4 red texels, UASTC.
const KTX2_RED: &[u8] = include_bytes!("../../corpus/red.ktx2");

/// Returns the bytes of hexadecimal digits.
fn bytes(digits: &str) -> Vec<u8> {
    let digits: Vec<u32> = digits
        .chars()
        .filter_map(|digit| digit.to_digit(16))
        .collect();
    digits
        .chunks_exact(2)
        .map(|pair| (pair[0] << 4 | pair[1]) as u8)
        .collect()
}

/// Returns the least and the greatest coordinates of the vertices.
fn bounds(scene: &Scene) -> [f64; 2] {
    let coordinates = scene
        .positions
        .iter()
        .flat_map(|position| position.to_array());
    coordinates.fold([f64::INFINITY, f64::NEG_INFINITY], |[l, g], c| {
        [l.min(c), g.max(c)]
    })
}

fn draco_cube(compressed: &[u8]) -> Result<Scene, String> {
    let mut asset = Asset::default();
    let view = asset.view(compressed);
    let text = asset.gltf(&format!(
        r#"{NODE},"extensionsRequired":["KHR_draco_mesh_compression"],"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},
        "indices":1,"extensions":{{"KHR_draco_mesh_compression":{{"bufferView":{view},"attributes":{{"POSITION":0}}}}}}}}]}}]"#
    ));
    let accessors = r#""accessors":[{"componentType":5126,"count":24,"type":"VEC3"},{"componentType":5123,"count":36,"type":"SCALAR"}]"#;
    load_text(text.replace(r#""accessors":[]"#, accessors))
}

#[test]
fn draco_meshes_are_decoded() {
    let scene = draco_cube(DRACO_CUBE).expect("a cube");
    assert_eq!(scene.triangles.len(), 12);
    let [least, greatest] = bounds(&scene);
    assert!(
        (least + 0.6).abs() < 1e-6 && (greatest - 0.6).abs() < 1e-4,
        "{least} {greatest}"
    );
    assert!(scene.summary.notes.is_empty(), "{:?}", scene.summary.notes);
}

#[test]
fn damaged_draco_mesh_is_an_error() {
    let whole = DRACO_CUBE;
    let error = draco_cube(&whole[..40]).expect_err("is cut");
    assert!(error.contains("buffer view 0 (Draco: "), "{error}");
    for (i, bit) in (0..whole.len()).flat_map(|i| (0..8).map(move |bit| (i, bit))) {
        let mut damaged = whole.to_vec();
        damaged[i] ^= 1 << bit;
        let _survives = draco_cube(&damaged);
    }
}

/// Loads the square and the cube; the views are compressed by this extension.
fn meshopt_cube(extension: &str, positions: &[u8]) -> Result<Scene, String> {
    let (triangles, normals) = (&MESHOPT_CUBE[MESHOPT_POSITIONS..], bytes(MESHOPT_NORMALS));
    let data = [positions, triangles, &normals].concat();
    let view = |(length, layout, start, compressed, mode): (usize, &str, usize, usize, &str)| {
        format!(
            r#"{{"buffer":1,"byteLength":{length}{layout},"extensions":{{"{extension}":{{"buffer":0,"byteOffset":{start},
            "byteLength":{compressed},{mode}}}}}}}"#
        )
    };
    let views = [
        (
            224,
            r#","byteStride":8"#,
            0,
            positions.len(),
            r#""byteStride":8,"mode":"ATTRIBUTES","count":28"#,
        ),
        (
            84,
            "",
            positions.len(),
            32,
            r#""byteStride":2,"mode":"TRIANGLES","count":42"#,
        ),
        (
            96,
            r#","byteStride":4"#,
            positions.len() + 32,
            60,
            r#""byteStride":4,"mode":"ATTRIBUTES","filter":"OCTAHEDRAL","count":24"#,
        ),
    ];
    let mut asset = Asset::default();
    asset.bytes = data;
    let text = asset
        .gltf(&format!(
            r#"{NODE},"extensionsRequired":["{extension}","KHR_mesh_quantization"],
            "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"NORMAL":1}},"indices":2}}]}}]"#
        ))
        .replace(r#""bufferViews":[]"#, &format!(r#""bufferViews":[{}]"#, views.map(view).join(",")))
        .replace(
            r#""accessors":[]"#,
            r#""accessors":[{"bufferView":0,"byteOffset":32,"componentType":5123,"count":24,"type":"VEC3"},
            {"bufferView":2,"componentType":5120,"count":24,"type":"VEC3","normalized":true},
            {"bufferView":1,"byteOffset":12,"componentType":5123,"count":36,"type":"SCALAR"}]"#,
        )
        .replace(r#"}],"bufferViews""#, r#"},{"byteLength":404}],"bufferViews""#);
    load_text(text)
}

#[test]
fn meshopt_views_are_decoded() {
    for extension in ["EXT_meshopt_compression", "KHR_meshopt_compression"] {
        let scene = meshopt_cube(extension, &MESHOPT_CUBE[..MESHOPT_POSITIONS]).expect("a cube");
        assert_eq!(scene.triangles.len(), 12);
        assert_eq!(bounds(&scene), [1474.0, 8355.0]);
        let [note] = &scene.summary.notes[..] else {
            panic!("{:?}", scene.summary.notes);
        };
        assert!(note.contains("327.0 m high"), "{note}");
        let is_axis = |normal: &glam::Vec3| normal.abs().max_element() == 1.0;
        assert!(
            scene.normals.iter().all(is_axis),
            "normals of a cube: {:?}",
            scene.normals
        );
    }
}

#[test]
fn damaged_meshopt_view_is_an_error() {
    let cut = &MESHOPT_CUBE[1..MESHOPT_POSITIONS];
    let error = meshopt_cube("EXT_meshopt_compression", cut).expect_err("is cut");
    assert!(
        error.contains("buffer view 0 (its meshopt compression is malformed)"),
        "{error}"
    );
}

fn textured(image: &[u8], own_source: &str) -> Scene {
    let folder = Folder::new();
    folder.write("a.ktx2", image);
    folder.write_image("blue.png", &[[0, 0, 255, 255]]);
    let rest = format!(
        r#"{NODE},{SQUARE},"materials":[{{"pbrMetallicRoughness":{{"baseColorTexture":{{"index":0}}}}}}],
        "textures":[{{{own_source}"extensions":{{"KHR_texture_basisu":{{"source":0}}}}}}],
        "images":[{{"uri":"a.ktx2"}},{{"uri":"blue.png"}}]"#
    );
    folder.write("a.gltf", square().gltf(&rest));
    folder.load("a.gltf").expect("survives")
}

#[test]
fn ktx2_textures_are_decoded() {
    let image = KTX2_RED;
    let [r, g, b] = textured(image, "").surface(0, 0.3, 0.3).albedo;
    // 247 of 255 is the next red of five bits.
    assert!(r > 0.9 && g < 0.01 && b < 0.01, "{r} {g} {b}");
    let albedo = textured(image, r#""source":1,"#)
        .surface(0, 0.3, 0.3)
        .albedo;
    assert_eq!(
        albedo,
        [0.0, 0.0, 1.0],
        "its own image is not compressed again"
    );

    let cut = textured(&image[..120], "");
    let expected = "1 texture could not be read: a.ktx2 (malformed: the KTX2 texture is damaged, or not by Basis Universal)";
    assert_eq!(cut.summary.notes, [expected]);
    let mut huge = image.to_vec();
    huge[20..28].copy_from_slice(&[0, 0, 1, 0, 0, 0, 1, 0]);
    assert!(textured(&huge, "").summary.notes[0].contains("65536x65536 pixels"));
    let mut other = image.to_vec();
    other[12] = 37;
    assert!(textured(&other, "").summary.notes[0].contains("Vulkan format 37"));
}
