//! glTF files as other programs write them: compressed meshes and textures of more forms, samplers,
//! visibility, sides, and texture coordinates in other places than in the simplest files.
//!
//! The compressed bytes were made by draco3d 1.5.7, meshoptimizer 1.0.1 and Basis Universal 2.10.

use super::gltf_asset::{Asset, NODE, SQUARE, load_text, square};
use crate::folder::Folder;
use glam::{DVec3, Vec2, Vec3};
use headbox_scene::material::{Sampler, Wrap};
use headbox_scene::scene::Scene;

const RED: [u8; 4] = [255, 0, 0, 255];
const BLUE: [u8; 4] = [0, 0, 255, 255];
const CLEAR: [u8; 4] = [0, 0, 255, 51];

/// The square with texture coordinates and colours, its upper left corner with an alpha of 0.2:
/// sequential, floats as they are.
const DRACO_SEQUENTIAL: &str = "445241434f020201000000020401000102000203010300090300000309020001020204000200000100000000\
    00000000000000000000803f00000000000000000000803f0000803f00000000000000000000803f00000000\
    000000000000803f0000803f0000803f0000803f000000000000000000000000000101010169011c01180108\
    ff9301040600b8b0fa4c8100000000ff000000";
/// The same: edge breaker, positions of 11 bits, texture coordinates of 10.
const DRACO_EDGE_BREAKER: &str = "445241434f02020101000000040202020000011fff0111ff0111ff011103ff00000000000100000100090300\
    000201030902000102010202040002010101010003030130011003002882980000000000ff07000000000000\
    00000000000000000000803f0b050101000303013001100300248226000200000001012000000000ff030000\
    00000000000000000000803f0a010101010369012001180104ff93010405005473a26800000000ff000000";
/// Corners of the square, floats, in versions 0 and 1 of the attribute codec.
const CORNERS_0: &str = "a000000133000000ffff01330000007e7d0000010c000000ff010c0000007e00000000000000000000000000\
    0000000000000000000000000000000000000000000000";
const CORNERS_1: &str =
    "a1faeaaa000000ff007f007e00007f00000000000000000000000000000000000000000000010100";
/// The same with the exponential filter.
const EXPONENTIAL_0: &str = "a0000133000000403f00012000000000010c0000004000012000000000000001200000000000000000000000\
    000000000000000000000000000000f2000000f2000000f2";
const EXPONENTIAL_1: &str = "a1eeeeea0040003f00020000000040000002000000020000000000000000000000000000f2000000f2000000\
    f2000000";
/// Indices of the square, as triangles and as a sequence.
const TRIANGLES: &str = "e1f000007687566778a9866589689801690000";
const SEQUENCE: &str = "d100040406080400000000";
/// 8 x 4 texels, half red, half blue with an alpha of 0.2: UASTC, Zstandard.
const KTX2_UASTC: &str = "ab4b5458203230bb0d0a1a0a0000000001000000080000000400000000000000000000000100000001000000\
    02000000680000002c000000940000002400000000000000000000000000000000000000b800000000000000\
    260000000000000020000000000000002c0000000000000002002800a6010200030300001000000000000000\
    00007f030000000000000000ffffffff1f0000004b545877726974657200426173697320556e697665727361\
    6c20322e3130000028b52ffd2020ed0000b8f71f00e01f7a001700e07f0602e0010000000000000000010005\
    3002";
/// The same: ETC1S.
const KTX2_ETC1S: &str = "ab4b5458203230bb0d0a1a0a0000000001000000080000000400000000000000000000000100000001000000\
    01000000680000003c000000a400000024000000c8000000000000008b000000000000005301000000000000\
    020000000000000000000000000000003c0000000000000002003800a3010200030300000808000000000000\
    00003f000000000000000000ffffffff40003f0f0000000000000000ffffffff1f0000004b54587772697465\
    7200426173697320556e6976657273616c20322e31300000040002002d000000090000002d00000000000000\
    000000000000000001000000010000000100000020c094000000000010e40d9217c044000000000000724100\
    98000000000000400800260000000000001000cc05acaaaaaa525555550500c144000000000000f25f8d0098\
    0010000000004074049810200000000082c8290500130000000000000820000a74";

/// Returns the bytes of hexadecimal digits.
fn bytes(digits: &str) -> Vec<u8> {
    let digits: Vec<u32> = digits.chars().filter_map(|c| c.to_digit(16)).collect();
    let pair = |pair: &[u32]| (pair[0] << 4 | pair[1]) as u8;
    digits.chunks_exact(2).map(pair).collect()
}

#[test]
fn draco_attributes_follow_their_ids() {
    for (compressed, error, indices) in [
        (DRACO_SEQUENTIAL, 1e-6, r#""indices":3,"#),
        (DRACO_EDGE_BREAKER, 1e-3, r#""indices":3,"#),
        (DRACO_EDGE_BREAKER, 1e-3, ""),
    ] {
        let mut asset = Asset::default();
        let view = asset.view(&bytes(compressed));
        let rest = format!(
            r#"{NODE},"materials":[{{"alphaMode":"MASK"}}],"meshes":[{{"primitives":[{{
            "attributes":{{"POSITION":0,"TEXCOORD_0":1,"COLOR_0":2}},{indices}"material":0,
            "extensions":{{"KHR_draco_mesh_compression":{{"bufferView":{view},
            "attributes":{{"COLOR_0":2,"TEXCOORD_0":1,"POSITION":0}}}}}}}}]}}]"#
        );
        let accessors = r#""accessors":[{"componentType":5126,"count":4,"type":"VEC3"},
            {"componentType":5126,"count":4,"type":"VEC2"},
            {"componentType":5121,"normalized":true,"count":4,"type":"VEC4"},
            {"componentType":5125,"count":6,"type":"SCALAR"}]"#;
        let text = asset.gltf(&rest).replace(r#""accessors":[]"#, accessors);
        let scene = load_text(text).expect("a square");
        assert_eq!(scene.summary.notes, [""; 0]);
        assert_eq!(scene.triangles.len(), 2);
        let corners = [
            (DVec3::ZERO, Vec2::ZERO, Vec3::X, 1.0),
            (DVec3::X, Vec2::X, Vec3::Y, 1.0),
            (DVec3::new(1.0, 1.0, 0.0), Vec2::ONE, Vec3::Z, 1.0),
            (DVec3::Y, Vec2::Y, Vec3::ONE, 0.2),
        ];
        for (position, texcoord, color, opacity) in corners {
            let is_near = |p: &DVec3| (*p - position).length() < error;
            let i = scene.positions.iter().position(is_near).expect("a corner");
            assert!(
                scene.texcoords[i].distance(texcoord) < 2e-3,
                "{:?}",
                scene.texcoords
            );
            assert_eq!(scene.colors[i], color);
            assert!((scene.opacities[i] - opacity).abs() < 1e-6);
        }
    }
}

#[test]
fn meshopt_versions_filters_and_index_modes_are_decoded() {
    let cases = [
        (
            "EXT_meshopt_compression",
            CORNERS_0,
            "NONE",
            TRIANGLES,
            "TRIANGLES",
        ),
        (
            "EXT_meshopt_compression",
            EXPONENTIAL_0,
            "EXPONENTIAL",
            SEQUENCE,
            "INDICES",
        ),
        (
            "KHR_meshopt_compression",
            CORNERS_1,
            "NONE",
            SEQUENCE,
            "INDICES",
        ),
        (
            "KHR_meshopt_compression",
            EXPONENTIAL_1,
            "EXPONENTIAL",
            TRIANGLES,
            "TRIANGLES",
        ),
    ];
    for (extension, corners, filter, indices, mode) in cases {
        let [corners, indices] = [corners, indices].map(bytes);
        let mut asset = Asset::default();
        asset.bytes = [&corners[..], &indices].concat();
        let length = asset.bytes.len();
        let start = corners.len();
        let views = format!(
            r#""bufferViews":[
            {{"buffer":1,"byteLength":48,"byteStride":12,"extensions":{{"{extension}":{{"buffer":0,
            "byteLength":{start},"byteStride":12,"count":4,"mode":"ATTRIBUTES","filter":"{filter}"}}}}}},
            {{"buffer":1,"byteLength":12,"extensions":{{"{extension}":{{"buffer":0,
            "byteOffset":{start},"byteLength":{},"byteStride":2,"count":6,"mode":"{mode}"}}}}}}]"#,
            indices.len()
        );
        let accessors = r#""accessors":[{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3"},
            {"bufferView":1,"componentType":5123,"count":6,"type":"SCALAR"}]"#;
        let mesh = r#""meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}]"#;
        let text = asset
            .gltf(&format!(
                r#"{NODE},"extensionsRequired":["{extension}"],{mesh}"#
            ))
            .replace(
                r#"}],"bufferViews":[]"#,
                &format!(r#"}},{{"byteLength":60}}],{views}"#),
            )
            .replace(r#""accessors":[]"#, accessors);
        let scene = load_text(text).unwrap_or_else(|error| panic!("{extension} {mode}: {error}"));
        assert_eq!((scene.triangles.len(), length > 0), (2, true));
        let expected = load_text(square().gltf(&format!("{NODE},{SQUARE}"))).expect("clean");
        assert_eq!(
            scene.positions, expected.positions,
            "{extension} {mode} {filter}"
        );
        assert_eq!(
            scene.triangles, expected.triangles,
            "{extension} {mode} {filter}"
        );
    }
}

#[test]
fn ktx2_forms_keep_colour_alpha_and_sampler() {
    for image in [KTX2_UASTC, KTX2_ETC1S] {
        let folder = Folder::new();
        folder.write("a.ktx2", bytes(image));
        let rest = format!(
            r#"{NODE},{SQUARE},"materials":[{{"alphaMode":"MASK",
            "pbrMetallicRoughness":{{"baseColorTexture":{{"index":0}}}}}}],
            "samplers":[{{"wrapS":33071,"wrapT":33071}}],
            "textures":[{{"sampler":0,"extensions":{{"KHR_texture_basisu":{{"source":0}}}}}}],
            "images":[{{"uri":"a.ktx2","mimeType":"image/ktx2"}}]"#
        );
        folder.write("a.gltf", square().gltf(&rest));
        let scene = folder.load("a.gltf").expect("survives");
        assert_eq!(scene.summary.notes, [""; 0]);
        assert_eq!(scene.textures[0].sampler().wrap, [Wrap::Clamp; 2]);
        let [r, _, b] = scene.surface(0, 0.1, 0.0).albedo;
        assert!(r > 0.9 && b < 0.05, "{r} {b}");
        let [r, _, b] = scene.surface(0, 0.9, 0.0).albedo;
        assert!(r < 0.05 && b > 0.9, "{r} {b}");
        assert!(scene.is_solid(0, 0.1, 0.0) && !scene.is_solid(0, 0.9, 0.0));
    }
}

/// Loads the square with a material and the images `a.png` (red, blue) and `b.png` (red, clear),
/// textures 0 and 1, each with the samplers 0 and 1.
fn textured(asset: &Asset, mesh: &str, material: &str, samplers: &str) -> Scene {
    let folder = Folder::new();
    folder.write_image("a.png", &[RED, BLUE]);
    folder.write_image("b.png", &[RED, CLEAR]);
    let rest = format!(
        r#"{NODE},{mesh},"materials":[{material}],"samplers":[{samplers}],
        "textures":[{{"source":0,"sampler":0}},{{"source":1,"sampler":1}}],
        "images":[{{"uri":"a.png"}},{{"uri":"b.png"}}]"#
    );
    folder.write("a.gltf", asset.gltf(&rest));
    folder.load("a.gltf").expect("survives")
}

/// Offset of a texture by a width to the right: coordinates from 1 to 2.
const NEXT: &str = r#""extensions":{"KHR_texture_transform":{"offset":[1,0]}}"#;

#[test]
fn samplers_apply_to_moved_emissive_and_cut_out_textures() {
    let [clamp, mirror] = [33_071, 33_648].map(|wrap| format!(r#"{{"wrapS":{wrap}}}"#));
    let lamp = format!(
        r#"{{"pbrMetallicRoughness":{{"baseColorTexture":{{"index":0,{NEXT}}}}},
        "emissiveTexture":{{"index":1,{NEXT}}},"emissiveFactor":[1,1,1]}}"#
    );
    let scene = textured(&square(), SQUARE, &lamp, &format!("{clamp},{mirror}"));
    let (red, blue) = ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0]);
    let [left, right] = [0.1, 0.9].map(|u| scene.surface(0, u, 0.0));
    assert_eq!([left.albedo, right.albedo], [blue, blue], "clamped");
    assert_eq!([left.emission, right.emission], [blue, red], "mirrored");

    let leaf = format!(
        r#"{{"alphaMode":"MASK","pbrMetallicRoughness":{{"baseColorTexture":{{"index":1,{NEXT}}}}}}}"#
    );
    for (samplers, solid) in [
        (format!("{{}},{clamp}"), [false, false]),
        (format!("{{}},{mirror}"), [false, true]),
        ("{},{}".to_owned(), [true, false]),
    ] {
        let scene = textured(&square(), SQUARE, &leaf, &samplers);
        let found = [0.1, 0.9].map(|u| scene.is_solid(0, u, 0.0));
        assert_eq!(found, solid, "{samplers}");
    }
}

#[test]
fn sharp_texels_do_not_depend_on_the_minifying_filter() {
    let base = r#"{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}"#;
    for (sampler, nearest) in [
        (r#"{"magFilter":9728,"minFilter":9987}"#, true),
        (r#"{"magFilter":9729,"minFilter":9728}"#, false),
        (r#"{"minFilter":9984}"#, false),
    ] {
        let scene = textured(&square(), SQUARE, base, &format!("{sampler},{{}}"));
        let expected = Sampler {
            nearest,
            ..Sampler::default()
        };
        assert_eq!(scene.textures[0].sampler(), expected, "{sampler}");
        let [r, _, b] = scene.surface(0, 0.45, 0.0).albedo;
        assert_eq!(r == 1.0 && b == 0.0, nearest, "{sampler}: {r} {b}");
    }
}

#[test]
fn colour_and_emission_may_have_any_set_of_coordinates() {
    let mut asset = square();
    let second = asset.floats(&[[0.75, 0.5]; 4]);
    let third = asset.floats(&[[0.25, 0.5]; 4]);
    let attributes = format!("\"TEXCOORD_0\":1,\"TEXCOORD_1\":{second},\"TEXCOORD_2\":{third}");
    let mesh = SQUARE.replace("\"TEXCOORD_0\":1", &attributes);
    let (red, blue) = ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0]);
    for (color, emission, expected) in [
        (1, 0, [blue, red]),
        (1, 2, [blue, red]),
        (2, 1, [red, blue]),
        (1, 1, [blue, blue]),
    ] {
        let material = format!(
            r#"{{"pbrMetallicRoughness":{{"baseColorTexture":{{"index":0,"texCoord":{color}}}}},
            "emissiveTexture":{{"index":0,"texCoord":{emission}}},"emissiveFactor":[1,1,1]}}"#
        );
        let scene = textured(&asset, &mesh, &material, r#"{"magFilter":9728},{}"#);
        assert_eq!(scene.summary.notes, [""; 0]);
        let surface = scene.surface(0, 0.2, 0.0);
        assert_eq!(
            [surface.albedo, surface.emission],
            expected,
            "{color} {emission}"
        );
    }
    // The extension's set replaces the texture's own.
    let moved = r#"{"pbrMetallicRoughness":{"baseColorTexture":{"index":0,"texCoord":2,
        "extensions":{"KHR_texture_transform":{"texCoord":1}}}}}"#;
    let scene = textured(&asset, &mesh, moved, r#"{"magFilter":9728},{}"#);
    assert_eq!(scene.surface(0, 0.2, 0.0).albedo, blue);
}

#[test]
fn visibility_hides_instances_and_skips_what_is_not_false() {
    let nodes = |visibility: &str, first: &str| {
        format!(
            r#""scenes":[{{"nodes":[0,2]}}],"nodes":[
            {{"children":[1],"extensions":{{"KHR_node_visibility":{{{visibility}}}}}}},
            {{"mesh":0{first}}},{{"mesh":0,"translation":[9,0,0]}}]"#
        )
    };
    let mut asset = square();
    let places = asset.floats(&[[0.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 6.0, 0.0]]);
    let instances = format!(
        r#","extensions":{{"EXT_mesh_gpu_instancing":{{"attributes":{{"TRANSLATION":{places}}}}}}}"#
    );
    let load = |visibility: &str, first: &str| {
        let rest = format!("{},{SQUARE}", nodes(visibility, first));
        load_text(asset.gltf(&rest)).expect("clean")
    };
    let hidden = r#""visible":false"#;
    for first in ["", &instances] {
        let scene = load(hidden, first);
        assert_eq!(scene.triangles.len(), 2);
        let note = "1 mesh or lamp hidden by the file (KHR_node_visibility) left out";
        assert_eq!(scene.summary.notes, [note]);
    }
    for shown in ["", r#""visible":true"#] {
        assert_eq!(load(shown, "").triangles.len(), 4, "{shown}");
        assert_eq!(load(shown, &instances).triangles.len(), 8, "{shown}");
    }
    // A node that is visible itself stays hidden below a hidden one.
    let own = r#","extensions":{"KHR_node_visibility":{"visible":true}}"#;
    assert_eq!(load(hidden, own).triangles.len(), 2);
}

#[test]
fn front_of_single_sided_surfaces_survives_mirrors() {
    let without = SQUARE.replace(",\"material\":0", "");
    for (mesh, materials, single) in [
        (without.as_str(), "", true),
        (SQUARE, r#","materials":[{"alphaMode":"BLEND"}]"#, true),
        (
            SQUARE,
            r#","materials":[{"extensions":{"KHR_materials_unlit":{}}}]"#,
            true,
        ),
        (
            SQUARE,
            r#","materials":[{"alphaMode":"MASK","doubleSided":true}]"#,
            false,
        ),
    ] {
        let scales = [
            ("1,1,1", 1.0),
            ("-1,1,1", 1.0),
            ("1,1,-1", -1.0),
            ("-1,-1,-1", -1.0),
        ];
        for (scale, front) in scales {
            let node = format!(r#""nodes":[{{"mesh":0,"scale":[{scale}]}}]"#);
            let scene =
                load_text(square().gltf(&format!("{node},{mesh}{materials}"))).expect("clean");
            let material = scene.triangles[0].material as usize;
            assert_eq!(
                scene.materials[material].single_sided, single,
                "{materials}"
            );
            let [a, b, c] = scene.corners(0);
            assert_eq!((b - a).cross(c - a).z.signum(), front, "{scale}");
        }
    }
}

#[test]
fn coplanar_surfaces_are_found_turned_and_apart() {
    // A poster of half the size on the wall, at its middle or beside it.
    let notes = |x: f64, turn: &str| {
        let primitive = |material: u32| {
            format!(
                r#"{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":2,"material":{material}}}]}}"#
            )
        };
        let rest = format!(
            r#""nodes":[{{"mesh":0}},{{"mesh":1,"translation":[{x},0.3,0],"scale":[0.4,0.4,1]{turn}}}],
            "meshes":[{},{}],"materials":[{{"doubleSided":true}},{{}}]"#,
            primitive(0),
            primitive(1)
        );
        load_text(square().gltf(&rest))
            .expect("clean")
            .summary
            .notes
    };
    let (flat, tilted) = ("", r#","rotation":[0,0,0.258819,0.9659258]"#);
    // Half a turn about Y: the poster shows its back.
    let back = r#","rotation":[0,1,0,0]"#;
    for (x, turn) in [(0.3, flat), (0.4, tilted), (0.7, back), (-0.2, flat)] {
        let found = notes(x, turn);
        assert_eq!(found.len(), 1, "{x} {turn}: {found:?}");
        assert!(found[0].contains("in one plane with another"), "{found:?}");
    }
    // They touch at an edge, or lie side by side.
    for (x, turn) in [(1.0, flat), (1.2, flat), (2.0, back), (1.4, tilted)] {
        assert_eq!(notes(x, turn), [""; 0], "{x} {turn}");
    }
}

#[test]
fn baked_oblique_plane_far_from_origin_is_one() {
    let x_axis = DVec3::new(0.9, 0.1, 0.4).normalize();
    let y_axis = DVec3::new(-0.2, 0.9, 0.3).reject_from(x_axis).normalize();
    let normal = x_axis.cross(y_axis);
    let notes = |middle: DVec3, distance: f64| {
        let mut asset = Asset::default();
        for (half, off) in [(1.3, 0.0), (0.7, distance)] {
            let corner = |[x, y]: [f64; 2]| {
                let place = middle + half * (x * x_axis + y * y_axis) + off * normal;
                place.as_vec3().to_array()
            };
            asset.floats(&[[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(corner));
        }
        asset.indices(&[0, 1, 2, 0, 2, 3]);
        let rest = format!(
            r#"{NODE},"materials":[{{}},{{}}],"meshes":[{{"primitives":[
            {{"attributes":{{"POSITION":0}},"indices":2,"material":0}},
            {{"attributes":{{"POSITION":1}},"indices":2,"material":1}}]}}]"#
        );
        load_text(asset.gltf(&rest)).expect("clean").summary.notes
    };
    for scale in [0.0, 1.0, 10.0, 100.0] {
        let middle = scale * DVec3::new(10.0, 5.0, -3.0);
        let found = notes(middle, 0.0);
        assert!(
            found
                .iter()
                .any(|note| note.starts_with("4 triangles in one plane")),
            "{middle}: {found:?}"
        );
        assert_eq!(
            notes(middle, 1e-3),
            [""; 0],
            "{middle}: a poster 1 mm before its wall"
        );
    }
}
