//! glTF files with skins, morph targets, instances, and other material models.

use super::gltf_asset::{Asset, NODE, SQUARE, load_text, square};
use crate::folder::Folder;
use glam::{DVec3, Vec3, dvec3};
use headbox_scene::scene::Scene;

/// Returns true if the scene has a vertex at a position.
fn has(scene: &Scene, place: DVec3) -> bool {
    scene
        .positions
        .iter()
        .any(|position| (*position - place).length() < 1e-6)
}

/// A skinned square, accessors 0 to 5: lower corners on the first joint, the left one with this
/// weight, upper corners on both joints.
fn skinned_square(weight: f32) -> Asset {
    let mut asset = square();
    asset.accessor(
        &[0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0],
        5121,
        "VEC4",
        4,
        "",
    );
    // The weights of the upper corners add up to 2 and are normalised.
    asset.floats(&[
        [weight, 0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0, 0.0],
        [0.5, 1.5, 0.0, 0.0],
        [0.5, 1.5, 0.0, 0.0],
    ]);
    // The rest pose of both joints is one metre to the left of their nodes.
    let column = |x: f32| {
        [
            1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, x, 0.0, 0.0, 1.0_f32,
        ]
    };
    let matrices: Vec<u8> = [column(1.0), column(1.0)]
        .iter()
        .flatten()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    asset.accessor(&matrices, 5126, "MAT4", 2, "");
    asset
}

const SKINNED: &str = r#""meshes":[{"primitives":[{"attributes":{"POSITION":0,"JOINTS_0":3,"WEIGHTS_0":4},"indices":2}]}]"#;
/// Nodes of a skinned mesh. That of the mesh is far away, which has no effect; the second joint is
/// 4 m above the first.
const JOINTS: &str = r#""scenes":[{"nodes":[0,1]}],"nodes":[{"mesh":0,"skin":0,"translation":[50,0,0]},
    {"translation":[0,0,2],"children":[2]},{"translation":[0,4,0]}]"#;

#[test]
fn skins_follow_joint_nodes() {
    let asset = skinned_square(1.0);
    let load = |skin: &str| {
        load_text(asset.gltf(&format!(r#"{JOINTS},{SKINNED},"skins":[{skin}]"#))).expect("survives")
    };
    let scene = load(r#"{"joints":[1,2],"inverseBindMatrices":5}"#);
    assert_eq!(scene.summary.notes, Vec::<String>::new());
    assert!(has(&scene, dvec3(1.0, 0.0, 2.0)), "{:?}", scene.positions);
    assert!(
        has(&scene, dvec3(2.0, 1.0 + 0.75 * 4.0, 2.0)),
        "{:?}",
        scene.positions
    );
    let unbound = skinned_square(0.0).gltf(&format!(
        r#"{JOINTS},{SKINNED},"skins":[{{"joints":[1,2],"inverseBindMatrices":5}}]"#
    ));
    assert_eq!(
        load_text(unbound).expect("survives").positions,
        scene.positions,
        "a vertex of no joint goes with the first"
    );
    let without = load(r#"{"joints":[1,2]}"#);
    assert!(
        has(&without, dvec3(0.0, 0.0, 2.0)),
        "{:?}",
        without.positions
    );
    for damaged in [
        r#"{"joints":[1]}"#,
        r#"{"joints":[1,99]}"#,
        r#"{"joints":[1,2],"inverseBindMatrices":1}"#,
    ] {
        let scene = load(damaged);
        assert_eq!(
            scene.summary.notes,
            ["1 skinned mesh with damaged joints or weights shown undeformed"],
            "{damaged}"
        );
        assert!(has(&scene, dvec3(51.0, 0.0, 0.0)), "{:?}", scene.positions);
    }
}

#[test]
fn morph_targets_use_file_weights() {
    let mut asset = square();
    let up = asset.floats(&[
        [0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0],
        [0.0, 8.0, 0.0],
        [0.0, 8.0, 0.0],
    ]);
    let mesh = |weights: &str, target: usize| {
        format!(
            r#""meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":2,"targets":[{{"POSITION":{target}}}]}}]{weights}}}]"#
        )
    };
    let load = |nodes: &str, mesh: &str| {
        load_text(asset.gltf(&format!("{nodes},{mesh}"))).expect("survives")
    };
    let top = |scene: &Scene| scene.positions.iter().map(|p| p.y).fold(0.0, f64::max);
    assert_eq!(top(&load(NODE, &mesh("", up))), 1.0, "no weights: at rest");
    assert_eq!(top(&load(NODE, &mesh(r#","weights":[0.5]"#, up))), 5.0);
    let of_node = r#""nodes":[{"mesh":0,"weights":[0.25]}]"#;
    assert_eq!(
        top(&load(of_node, &mesh(r#","weights":[0.5]"#, up))),
        3.0,
        "the node's weights come first"
    );
    let colors =
        mesh(r#","weights":[0.5]"#, up).replace(r#""targets":[{"#, r#""targets":[{"COLOR_0":0,"#);
    let colors = load(NODE, &colors);
    assert_eq!(top(&colors), 5.0);
    assert_eq!(
        colors.summary.notes,
        [
            "changes of colours and texture coordinates by morph targets left out; those of positions are used"
        ]
    );
    let damaged = load(of_node, &mesh("", 99));
    assert_eq!(
        damaged.summary.notes,
        ["1 damaged mesh part or attribute left out"]
    );
    assert_eq!(top(&damaged), 1.0);
}

#[test]
fn instances_use_their_transforms() {
    let mut asset = square();
    let places = asset.floats(&[[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 0.0, 30.0]]);
    let scales = asset.floats(&[[1.0, 1.0, 1.0], [1.0, 3.0, 1.0], [1.0, 1.0, 1.0]]);
    let short = asset.floats(&[[1.0, 1.0, 1.0]]);
    let load = |attributes: &str| {
        let node = format!(
            r#""nodes":[{{"mesh":0,"translation":[0,1,0],"extensions":{{"EXT_mesh_gpu_instancing":{{"attributes":{{{attributes}}}}}}}}}]"#
        );
        let rest = format!(r#"{node},{SQUARE},"extensionsRequired":["EXT_mesh_gpu_instancing"]"#);
        load_text(asset.gltf(&rest)).expect("survives")
    };
    let scene = load(&format!(
        r#""TRANSLATION":{places},"SCALE":{scales},"_COLOR":7"#
    ));
    assert_eq!(scene.triangles.len(), 6);
    assert!(
        has(&scene, dvec3(11.0, 4.0, 0.0)) && has(&scene, dvec3(1.0, 2.0, 30.0)),
        "{:?}",
        scene.positions
    );
    assert_eq!(scene.summary.notes, Vec::<String>::new());
    let numbered = load(r#""_ID":7"#);
    assert_eq!(numbered.triangles.len(), 2);
    assert_eq!(numbered.summary.notes, Vec::<String>::new());
    let damaged = load(&format!(r#""TRANSLATION":{places},"SCALE":{short}"#));
    assert_eq!(
        damaged.summary.notes,
        ["1 damaged mesh part or attribute left out"]
    );
    assert_eq!(damaged.triangles.len(), 2);
}

#[test]
fn sparse_instances_without_view_are_read() {
    let mut asset = square();
    let places = asset.view(&[1, 2, 0, 0]);
    let moved = [[10.0, 0.0, 0.0_f32], [0.0, 0.0, 30.0]];
    let moved = moved.as_flattened().iter().flat_map(|x| x.to_le_bytes());
    let values = asset.view(&moved.collect::<Vec<u8>>());
    asset.accessors.push(format!(
        r#"{{"componentType":5126,"type":"VEC3","count":3,"sparse":{{"count":2,
        "indices":{{"bufferView":{places},"componentType":5121}},"values":{{"bufferView":{values}}}}}}}"#
    ));
    let node = r#""nodes":[{"mesh":0,"extensions":{"EXT_mesh_gpu_instancing":{"attributes":{"TRANSLATION":3}}}}]"#;
    let scene = load_text(asset.gltf(&format!("{node},{SQUARE}"))).expect("clean");
    assert_eq!(scene.triangles.len(), 6);
    assert!(has(&scene, dvec3(11.0, 1.0, 0.0)) && has(&scene, dvec3(1.0, 1.0, 30.0)));
}

#[test]
fn oversized_instances_are_refused() {
    let mut asset = square();
    asset
        .accessors
        .push(r#"{"componentType":5126,"type":"VEC3","count":16000000}"#.into());
    let node = r#""nodes":[{"mesh":0,"extensions":{"EXT_mesh_gpu_instancing":{"attributes":{"TRANSLATION":3}}}}]"#;
    let scene = load_text(asset.gltf(&format!("{node},{SQUARE}"))).expect("survives");
    assert_eq!(scene.triangles.len(), 2);
}

/// Returns the albedo of a material with textures of one texel each: 0 red, 1 blue.
fn albedo(material: &str, textures: &str) -> [f32; 3] {
    let folder = Folder::new();
    folder.write_image("red.png", &[[255, 0, 0, 255]]);
    folder.write_image("blue.png", &[[0, 0, 255, 255]]);
    folder.write("cut.webp", "RIFF");
    let rest = format!(
        r#"{NODE},{SQUARE},"materials":[{material}],"textures":[{textures}],"images":[{{"uri":"red.png"}},{{"uri":"blue.png"}},{{"uri":"cut.webp"}}]"#
    );
    folder.write("a.gltf", square().gltf(&rest));
    folder
        .load("a.gltf")
        .expect("survives")
        .surface(0, 0.3, 0.3)
        .albedo
}

#[test]
fn specular_gloss_keeps_diffuse_colour() {
    let with = |usual: &str, older: &str| {
        let material = format!(
            r#"{{{usual}"extensions":{{"KHR_materials_pbrSpecularGlossiness":{{{older}}}}}}}"#
        );
        albedo(&material, r#"{"source":0},{"source":1}"#)
    };
    assert_eq!(
        with(
            "",
            r#""diffuseTexture":{"index":1},"diffuseFactor":[1,1,0.5,1]"#
        ),
        [0.0, 0.0, 0.5]
    );
    assert_eq!(
        with(
            "",
            r#""diffuseFactor":[0,0,0,1],"specularFactor":[1,0.5,0.25]"#
        ),
        [1.0, 0.5, 0.25],
        "a metal"
    );
    let usual = r#""pbrMetallicRoughness":{"baseColorTexture":{"index":0}},"#;
    assert_eq!(
        with(usual, r#""diffuseTexture":{"index":1}"#),
        [0.0, 0.0, 1.0],
        "the metallic-roughness model is a fallback for readers without the extension"
    );
    assert_eq!(
        with(
            usual,
            r#""diffuseFactor":[0,0,0,1],"specularFactor":[1,0.5,0.25]"#
        ),
        [1.0, 0.0, 0.0],
        "a metal with a base colour"
    );
}

#[test]
fn texture_image_comes_from_extension() {
    let material = r#"{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}"#;
    let webp = |source: usize, rest: &str| {
        albedo(
            material,
            &format!(r#"{{"extensions":{{"EXT_texture_webp":{{"source":{source}}}}}{rest}}}"#),
        )
    };
    assert_eq!(webp(1, ""), [0.0, 0.0, 1.0]);
    assert_eq!(webp(1, r#","source":0"#), [0.0, 0.0, 1.0]);
    assert_eq!(
        webp(2, r#","source":0"#),
        [1.0, 0.0, 0.0],
        "a damaged image"
    );
    assert_eq!(
        webp(99, r#","source":0"#),
        [1.0, 0.0, 0.0],
        "an index out of range"
    );
}

#[test]
fn skin_transforms_normals() {
    let mut asset = skinned_square(1.0);
    let normals = asset.floats(&[[0.0, 0.0, 1.0]; 4]);
    let mesh = SKINNED.replace(
        "\"JOINTS_0\"",
        &format!("\"NORMAL\":{normals},\"JOINTS_0\""),
    );
    // A quarter turn about Y takes +Z to +X.
    let nodes = r#""scenes":[{"nodes":[0,1]}],"nodes":[{"mesh":0,"skin":0},{"rotation":[0,0.7071068,0,0.7071068],"children":[2]},{}]"#;
    let rest = format!(r#"{nodes},{mesh},"skins":[{{"joints":[1,2],"inverseBindMatrices":5}}]"#);
    let scene = load_text(asset.gltf(&rest)).expect("survives");
    assert!(
        (scene.surface(0, 0.3, 0.3).normal - Vec3::X).length() < 1e-5,
        "{:?}",
        scene.surface(0, 0.3, 0.3)
    );
}

/// A lamp in front of the square, for nodes with `KHR_lights_punctual`.
const LAMP: &str = r#""extensions":{"KHR_lights_punctual":{"lights":[{"type":"point"}]}}"#;

#[test]
fn hidden_nodes_show_neither_mesh_nor_lamp() {
    let nodes = |first: &str| {
        format!(
            r#""nodes":[{{"mesh":0,"children":[1],"extensions":{{{first}"KHR_lights_punctual":{{"light":0}}}}}},
            {{"mesh":0,"translation":[5,0,0],"extensions":{{"KHR_node_visibility":{{"visible":true}}}}}},{{"mesh":0,"translation":[9,0,0]}}]"#
        )
    };
    let load = |first: &str| {
        load_text(square().gltf(&format!("{},{SQUARE},{LAMP}", nodes(first)))).expect("clean")
    };
    let hidden = load(r#""KHR_node_visibility":{"visible":false},"#);
    assert_eq!((hidden.triangles.len(), hidden.lamps.len()), (2, 0));
    assert!(hidden.positions.iter().all(|p| p.x >= 9.0));
    assert_eq!(
        hidden.summary.notes,
        ["2 meshes or lamps hidden by the file (KHR_node_visibility) left out"]
    );
    for shown in [r#""KHR_node_visibility":{"visible":true},"#, ""] {
        let scene = load(shown);
        assert_eq!((scene.triangles.len(), scene.lamps.len()), (6, 1));
    }
}

#[test]
fn hidden_joints_move_skins() {
    let joints = JOINTS.replace(
        r#"{"translation":[0,0,2]"#,
        r#"{"extensions":{"KHR_node_visibility":{"visible":false}},"translation":[0,0,2]"#,
    );
    let skin = r#""skins":[{"joints":[1,2],"inverseBindMatrices":5}]"#;
    let text = skinned_square(1.0).gltf(&format!("{joints},{SKINNED},{skin}"));
    let scene = load_text(text).expect("clean");
    assert!(has(&scene, dvec3(1.0, 0.0, 2.0)), "{:?}", scene.positions);
}

#[test]
fn extensions_that_change_nothing_may_be_required() {
    let with = |extension: &str| {
        let required = format!(r#"{NODE},{SQUARE},"extensionsRequired":["{extension}"]"#);
        load_text(square().gltf(&required)).map(|scene| scene.summary.notes)
    };
    for extension in ["KHR_materials_variants", "KHR_xmp_json_ld", "VRM"] {
        assert_eq!(with(extension).expect(extension), Vec::<String>::new());
    }
    assert_eq!(
        with("KHR_materials_sheen").expect("read without"),
        ["1 unsupported extension ignored: KHR_materials_sheen"]
    );
    let error = with("ACME_shape").expect_err("unknown").to_string();
    assert!(error.contains("ACME_shape"), "{error}");
}

#[test]
fn colours_are_divided_by_the_white_of_their_numbers() {
    let load = |component: u32, more: &str, bytes: &[u8]| {
        let mut asset = square();
        let colors = asset.accessor(bytes, component, "VEC4", 4, more);
        let mesh = SQUARE.replace("\"TEXCOORD_0\":1", &format!("\"COLOR_0\":{colors}"));
        load_text(asset.gltf(&format!("{NODE},{mesh}"))).expect("clean")
    };
    let floats = |corner: [f32; 4]| {
        let all = [corner; 4];
        all.as_flattened()
            .iter()
            .flat_map(|c| c.to_le_bytes())
            .collect::<Vec<u8>>()
    };
    let divided = "1 mesh part with vertex colours of 0 to 255 or 65535 that are not normalized, divided by that";
    let bytes = [[204, 51, 0, 255_u8]; 4].concat();
    let shorts = [52_428, 13_107, 0, 65_535_u16].map(u16::to_le_bytes);
    let shorts = [shorts.as_flattened(); 4].concat();
    for scene in [load(5121, "", &bytes), load(5123, "", &shorts)] {
        assert_eq!(scene.colors[0], Vec3::new(0.8, 0.2, 0.0));
        assert_eq!(scene.summary.notes, [divided]);
    }
    for opacity in [1.0, 255.0] {
        let scene = load(5126, "", &floats([204.0, 51.0, 0.0, opacity]));
        assert_eq!(scene.colors[0], Vec3::new(0.8, 0.2, 0.0));
        assert_eq!(scene.summary.notes, [divided]);
    }
    let normalized = load(5121, r#","normalized":true"#, &bytes);
    assert_eq!(normalized.colors[0], Vec3::new(0.8, 0.2, 0.0));
    assert_eq!(normalized.summary.notes, Vec::<String>::new());
    for (bright, limited) in [
        ([1.5, 0.5, 0.25, 1.0], Vec3::new(1.0, 0.5, 0.25)),
        ([2.0, 0.0, 0.0, 1.0], Vec3::X),
    ] {
        let bright = load(5126, "", &floats(bright));
        assert_eq!(bright.colors[0], limited);
        assert_eq!(
            bright.summary.notes,
            ["4 vertices with a colour above 1, which is reduced to 1"]
        );
    }
}

#[test]
fn opacity_of_integer_colours_counts_in_their_range() {
    for corner in [[255, 0, 0, 51_u8], [0, 0, 0, 51]] {
        let mut asset = square();
        let colors = asset.accessor(&[corner; 4].concat(), 5121, "VEC4", 4, "");
        let mesh = SQUARE.replace("\"TEXCOORD_0\":1", &format!("\"COLOR_0\":{colors}"));
        let materials = r#""materials":[{"alphaMode":"BLEND"}]"#;
        let error = load_text(asset.gltf(&format!("{NODE},{mesh},{materials}")));
        let error = error.expect_err("clear");
        assert!(
            error.contains("2 triangles with an opacity of one half or less"),
            "{error}"
        );
    }
}

#[test]
fn padding_and_byte_order_mark_of_json_are_skipped() {
    let rest = format!("{NODE},{SQUARE}");
    let folder = Folder::new();
    let text: String = square().gltf(&rest);
    folder.write("a.gltf", format!("\u{feff}{text}"));
    let mut glb = square().glb(&rest);
    let end = 20 + u32::from_le_bytes([glb[12], glb[13], glb[14], glb[15]]) as usize;
    let padding = glb[..end].iter().rev().take_while(|&&byte| byte == b' ');
    let first = end - padding.count();
    // Another word of padding, so that there is some.
    glb.splice(end..end, [0; 4]);
    glb[first..end].fill(0);
    let longer = |glb: &mut [u8], at: usize| {
        let length = u32::from_le_bytes([glb[at], glb[at + 1], glb[at + 2], glb[at + 3]]) + 4;
        glb[at..at + 4].copy_from_slice(&length.to_le_bytes());
    };
    longer(&mut glb, 8);
    longer(&mut glb, 12);
    folder.write("b.glb", &glb);
    for name in ["a.gltf", "b.glb"] {
        assert_eq!(folder.load(name).expect(name).triangles.len(), 2, "{name}");
    }
}

#[test]
fn splats_next_to_a_mesh_are_left_out_and_noted() {
    let splats = |name: &str| {
        let primitive =
            format!(r#"{{"mode":0,"attributes":{{"POSITION":0}},"extensions":{{"{name}":{{}}}}}}"#);
        let both = SQUARE.replace(
            r#""primitives":["#,
            &format!(r#""primitives":[{primitive},"#),
        );
        let alone = format!(r#""meshes":[{{"primitives":[{primitive}]}}]"#);
        [both, alone]
    };
    for name in [
        "KHR_gaussian_splatting",
        "KHR_spz_gaussian_splats_compression",
    ] {
        let [both, alone] = splats(name);
        let scene = load_text(square().gltf(&format!("{NODE},{both}"))).expect("loads");
        assert_eq!(scene.triangles.len(), 2, "{name}");
        let note = "1 cloud of Gaussian splats left out, because splats have no surface that rays \
                    could meet";
        assert_eq!(scene.summary.notes, [note], "{name}");
        let error = load_text(square().gltf(&format!("{NODE},{alone}"))).expect_err("refused");
        assert!(
            error.contains("a cloud of Gaussian splats, not a mesh"),
            "{error}"
        );
    }
    let [both, _] = splats("KHR_gaussian_splatting");
    let required = r#""extensionsRequired":["KHR_gaussian_splatting"]"#;
    let scene = load_text(square().gltf(&format!("{NODE},{both},{required}"))).expect("loads");
    assert_eq!(scene.summary.notes.len(), 1);
}

#[test]
fn unread_lights_in_use_are_noted() {
    for light in [
        "EXT_lights_image_based",
        "KHR_environment_map",
        "EXT_lights_area",
    ] {
        let used = format!(r#"{NODE},{SQUARE},"extensionsUsed":["{light}","KHR_lights_punctual"]"#);
        let scene = load_text(square().gltf(&used)).expect("clean");
        let expected = format!("1 unsupported extension ignored: {light} (its light is left out)");
        assert_eq!(scene.summary.notes, [expected]);
    }
}

#[test]
fn odd_json_is_read_like_clean() {
    let deep = format!("{}{}", "[".repeat(500), "]".repeat(500));
    let node = |member: &str| format!(r#""nodes":[{{"mesh":0,{member}}}],{SQUARE}"#);
    let clean = format!("{NODE},{SQUARE}");
    for rest in [
        node(r#""extras":"text""#),
        node(r#""extras":[1,{"a":null}]"#),
        node(&format!(r#""extras":{{"a":{deep}}}"#)),
        node(r#""extensions":null,"children":null"#),
        format!(r#"{clean},"scene":0.0,"scenes":[{{"nodes":[0]}},{{"name":"empty"}}]"#),
        format!(r#"{clean},"animations":[{{"samplers":[]}}]"#),
        format!(
            r#"{clean},"animations":[{{"samplers":[{{"input":0,"output":0}}],
            "channels":[{{"sampler":0,"target":{{"path":"translation"}}}}]}}]"#
        ),
    ] {
        let text = format!("{}\0\0", square().gltf(&rest));
        let scene = load_text(text).expect(&rest);
        assert_eq!(scene.triangles.len(), 2, "{rest}");
        assert_eq!(scene.summary.notes, [""; 0], "{rest}");
    }
}

#[test]
fn unknown_chunks_of_glb_are_ignored() {
    let mut glb = square().glb(&format!("{NODE},{SQUARE}"));
    let end = 20 + u32::from_le_bytes([glb[12], glb[13], glb[14], glb[15]]) as usize;
    glb.splice(end..end, *b"\x04\0\0\0ABCDdata");
    let length = glb.len() as u32;
    glb[8..12].copy_from_slice(&length.to_le_bytes());
    let folder = Folder::new();
    folder.write("a.glb", &glb);
    assert_eq!(folder.load("a.glb").expect("clean").triangles.len(), 2);
}

#[test]
fn first_version_is_named() {
    let text = square().gltf(&format!("{NODE},{SQUARE}"));
    let error = load_text(text.replace("2.0", "1.0")).expect_err("another format");
    assert!(error.contains("glTF of version 1.0"), "{error}");
}
