//! glTF materials: samplers, alpha of vertices, second sets of texture coordinates, sides.

use super::gltf_asset::{Asset, NODE, SQUARE, load_text, square};
use crate::folder::Folder;
use headbox_scene::material::{Sampler, Wrap};
use headbox_scene::scene::Scene;

const RED: [u8; 4] = [255, 0, 0, 255];
const BLUE: [u8; 4] = [0, 0, 255, 255];
const CLEAR: [u8; 4] = [255, 0, 0, 102];

/// Loads an asset with the images `a.png` (red, blue) and `b.png` (red, clear).
fn load(asset: &Asset, rest: &str) -> Scene {
    let folder = Folder::new();
    folder.write_image("a.png", &[RED, BLUE]);
    folder.write_image("b.png", &[RED, CLEAR]);
    folder.write("a.gltf", asset.gltf(&format!("{NODE},{rest}")));
    folder.load("a.gltf").expect("survives")
}

#[test]
fn textures_of_one_image_have_their_own_samplers() {
    let material = r#"{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}},
        "emissiveTexture":{"index":1},"emissiveFactor":[1,1,1]}"#;
    let textures = r#""textures":[{"source":0,"sampler":0},{"source":0}],"images":[{"uri":"a.png"}],
        "samplers":[{"wrapS":33071,"wrapT":33648,"magFilter":9728}]"#;
    let scene = load(
        &square(),
        &format!(r#"{SQUARE},"materials":[{material}],{textures}"#),
    );
    let expected = Sampler {
        wrap: [Wrap::Clamp, Wrap::Mirror],
        nearest: true,
    };
    let [clamped, plain] = &scene.textures[..] else {
        panic!("{} textures", scene.textures.len());
    };
    assert_eq!(clamped.sampler(), expected);
    assert_eq!(plain.sampler(), Sampler::default());
    assert!(clamped.shares_texels(plain));
    assert_eq!(clamped.sample(1.25, 0.5), [0.0, 0.0, 1.0, 1.0]);
    assert_eq!(plain.sample(1.25, 0.5), [1.0, 0.0, 0.0, 1.0]);
}

/// Loads the square with vertices of these opacities.
fn with_opacities(opacities: [f32; 4], material: &str) -> Result<Scene, String> {
    let mut asset = square();
    let colors = asset.floats(&opacities.map(|opacity| [1.0, 1.0, 1.0, opacity]));
    let attributes = format!("\"TEXCOORD_0\":1,\"COLOR_0\":{colors}");
    let mesh = SQUARE.replace("\"TEXCOORD_0\":1", &attributes);
    let folder = Folder::new();
    folder.write_image("b.png", &[RED, CLEAR]);
    let textures = r#""textures":[{"source":0}],"images":[{"uri":"b.png"}]"#;
    let rest = format!(r#"{NODE},{mesh},"materials":[{material}],{textures}"#);
    folder.write("a.gltf", asset.gltf(&rest));
    folder.load("a.gltf")
}

#[test]
fn alpha_is_factor_times_texture_times_vertex() {
    let gone = |opacity: f32, material: &str| {
        let error = with_opacities([opacity; 4], material).expect_err("nothing is left");
        assert!(
            error.contains("2 triangles with an opacity of one half or less"),
            "{error}"
        );
    };
    gone(0.2, r#"{"alphaMode":"BLEND"}"#);
    gone(0.1, r#"{"alphaMode":"MASK"}"#);
    let factor = r#""pbrMetallicRoughness":{"baseColorFactor":[1,1,1,0.7]}"#;
    gone(0.7, &format!(r#"{{"alphaMode":"BLEND",{factor}}}"#));
    let shown = with_opacities([0.8; 4], &format!(r#"{{"alphaMode":"BLEND",{factor}}}"#));
    assert!(shown.expect("0.56").is_solid(0, 0.3, 0.3));

    let opaque = with_opacities([0.2; 4], "{}").expect("opaque");
    assert!(opaque.opacities.is_empty() && opaque.materials[0].cutout.is_none());

    // From the left to the right; the corners are (0, 0), (1, 0), (1, 1), (0, 1).
    let fade = with_opacities([0.0, 1.0, 1.0, 0.0], r#"{"alphaMode":"BLEND"}"#).expect("a part");
    assert!(!fade.is_solid(0, 0.4, 0.0) && fade.is_solid(0, 0.6, 0.0));

    let textured = r#"{"alphaMode":"MASK","alphaCutoff":0.3,"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}"#;
    let both = with_opacities([0.5; 4], textured).expect("a part");
    assert!(both.is_solid(0, 0.2, 0.0), "0.5 times 1");
    assert!(!both.is_solid(0, 0.8, 0.0), "0.5 times 0.4");
    let full = with_opacities([1.0; 4], textured).expect("all");
    assert!(full.opacities.is_empty() && full.materials[0].cutout.is_none());
}

#[test]
fn emission_texture_has_its_own_coordinates() {
    let mut asset = square();
    let second = asset.floats(&[[0.75, 0.5]; 4]);
    let attributes = format!("\"TEXCOORD_0\":1,\"TEXCOORD_1\":{second}");
    let mesh = SQUARE.replace("\"TEXCOORD_0\":1", &attributes);
    let with = |emission: &str| {
        let material = format!(
            r#"{{"pbrMetallicRoughness":{{"baseColorTexture":{{"index":0}}}},"emissiveTexture":{emission},"emissiveFactor":[1,1,1]}}"#
        );
        let textures = r#""textures":[{"source":0}],"images":[{"uri":"a.png"}]"#;
        load(
            &asset,
            &format!(r#"{mesh},"materials":[{material}],{textures}"#),
        )
    };
    let scene = with(r#"{"index":0,"texCoord":1}"#);
    assert_eq!(scene.summary.notes, Vec::<String>::new());
    let surface = scene.surface(0, 0.25, 0.0);
    assert_eq!(surface.albedo, [1.0, 0.0, 0.0]);
    assert_eq!(surface.emission, [0.0, 0.0, 1.0]);
    let moved = r#"{"index":0,"extensions":{"KHR_texture_transform":{"offset":[0.5,0]}}}"#;
    let moved = with(moved).surface(0, 0.25, 0.0);
    assert_eq!(moved.albedo, [1.0, 0.0, 0.0]);
    assert_eq!(moved.emission, [0.0, 0.0, 1.0]);
    assert!(with(r#"{"index":0}"#).emission_texcoords.is_empty());
}

#[test]
fn materials_are_single_sided_unless_the_file_says_otherwise() {
    for (material, expected) in [
        ("{}", true),
        (r#"{"doubleSided":false}"#, true),
        (r#"{"doubleSided":true}"#, false),
    ] {
        let text = square().gltf(&format!(r#"{NODE},{SQUARE},"materials":[{material}]"#));
        let scene = load_text(text).expect("clean");
        assert_eq!(scene.materials[0].single_sided, expected, "{material}");
    }
}

#[test]
fn overlapping_surfaces_in_one_plane_are_counted() {
    let nodes = |z: f32| {
        format!(
            r#""nodes":[{{"mesh":0}},{{"mesh":1,"translation":[0.25,0.125,{z}],"scale":[0.5,0.5,1]}}]"#
        )
    };
    let primitive = |material: u32| {
        format!(
            r#"{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":2,"material":{material}}}]}}"#
        )
    };
    let notes = |z: f32, materials: [u32; 2]| {
        let [wall, poster] = materials.map(primitive);
        let rest = format!(
            r#"{},"meshes":[{wall},{poster}],"materials":[{{}},{{}}]"#,
            nodes(z)
        );
        load_text(square().gltf(&rest))
            .expect("clean")
            .summary
            .notes
    };
    let expected = "4 triangles in one plane with another of a different material, of which the one that faces the viewer is shown, or else the later one in the file";
    assert_eq!(notes(0.0, [0, 1]), [expected]);
    assert_eq!(notes(0.0, [0, 0]), Vec::<String>::new());
    assert_eq!(notes(0.001, [0, 1]), Vec::<String>::new());
}
