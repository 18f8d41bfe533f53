//! glTF files built here, clean and damaged.

use super::gltf_asset::{Asset, CORNERS, NODE, SQUARE, base64, load_text, square};
use crate::folder::Folder;
use glam::{Vec2, Vec3, dvec3};
use headbox_core::file_frame::FileFrame;
use headbox_scene::scene::Scene;

/// Loads a [`square`] with a material and images.
fn with_material(material: &str, rest: &str, images: &[(&str, &[[u8; 4]])]) -> Scene {
    let folder = Folder::new();
    folder.write(
        "a.gltf",
        square().gltf(&format!(
            r#"{NODE},{SQUARE},"materials":[{material}]{rest}"#
        )),
    );
    for (name, texels) in images {
        folder.write_image(name, texels);
    }
    folder.load("a.gltf").expect("survives")
}

#[test]
fn gltf_and_glb_and_an_external_buffer_agree() {
    let asset = square();
    let rest = format!(r#"{NODE},{SQUARE}"#);
    let folder = Folder::new();
    folder.write("a.gltf", asset.gltf(&rest));
    folder.write("b.GLB", asset.glb(&rest));
    folder.write("c.gltf", asset.json(r#","uri":"the%20buffer.bin""#, &rest));
    folder.write("the buffer.bin", &asset.bytes);
    let scenes = ["a.gltf", "b.GLB", "c.gltf"].map(|name| folder.load(name).expect(name));
    for scene in &scenes {
        assert_eq!(scene.triangles, scenes[0].triangles);
        assert_eq!(scene.positions, scenes[0].positions);
        assert_eq!(scene.summary.notes, Vec::<String>::new());
    }
    assert_eq!(scenes[0].triangles.len(), 2);
    assert_eq!(scenes[0].texcoords[0], Vec2::ZERO, "v is turned to go up");
    assert_eq!(scenes[0].surface(0, 0.2, 0.2).normal, Vec3::Z);
}

#[test]
fn node_transforms_composed_in_f64() {
    let nodes = r#""scene":0,"scenes":[{"nodes":[0]}],"nodes":[
        {"translation":[100000,0,0],"children":[1]},
        {"rotation":[0,0.70710678,0,0.70710678],"scale":[2,2,2],"children":[2,3]},
        {"mesh":0,"translation":[0,0,0.001]},
        {"mesh":0,"matrix":[-1,0,0,0, 0,1,0,0, 0,0,1,0, 0,5,0,1]}]"#;
    let mut asset = square();
    asset.floats(&[[0.0, 0.0, 1.0]; 4]);
    let mesh = SQUARE.replace("\"TEXCOORD_0\":1", "\"NORMAL\":3");
    let scene = load_text(asset.gltf(&format!("{nodes},{mesh}"))).expect("clean");
    // Rotated by 90 degrees about y: the file's +z is the world's +x, its +x the world's -z. The
    // tolerance is that of the file's rotation, which has eight digits.
    let near = |a: glam::DVec3, b: glam::DVec3| (a - b).length() < 1e-7;
    assert!(
        near(scene.positions[0], dvec3(100_000.002, 0.0, 0.0)),
        "{}",
        scene.positions[0]
    );
    assert!(
        near(scene.positions[1], dvec3(100_000.002, 0.0, -2.0)),
        "{}",
        scene.positions[1]
    );
    assert_eq!(scene.triangles.len(), 4);
    // The second one is mirrored; its front must still be on the side of its normals.
    for triangle in 0..4 {
        let surface = scene.surface(triangle, 0.3, 0.3);
        let vertex = scene.triangles[triangle as usize].vertices[0];
        assert!(
            (surface.normal - Vec3::X).length() < 1e-6,
            "{triangle}: {}",
            surface.normal
        );
        assert!((scene.normals[vertex as usize] - Vec3::X).length() < 1e-6);
    }
}

#[test]
fn strips_and_fans_keep_their_winding() {
    for (mode, order) in [(5, [0, 1, 3, 2]), (6, [0, 1, 2, 3])] {
        let mut asset = square();
        let indices = asset.indices(&order);
        let mesh = format!(
            r#""meshes":[{{"primitives":[{{"mode":{mode},"attributes":{{"POSITION":0}},"indices":{indices}}}]}}]"#
        );
        let scene = load_text(asset.gltf(&format!("{NODE},{mesh}"))).expect("clean");
        assert_eq!(scene.triangles.len(), 2);
        assert!(
            (0..2).all(|t| scene.surface(t, 0.3, 0.3).normal == Vec3::Z),
            "mode {mode}"
        );
    }
}

#[test]
fn number_formats_and_sparse_accessors_read() {
    let mut asset = Asset::default();
    let quantized: Vec<u8> = CORNERS
        .iter()
        .flatten()
        .flat_map(|&x| (x as i16 * 16_383).to_le_bytes())
        .collect();
    let places = asset.view(&[2, 0, 0, 0]);
    let values = asset.view(
        &[0.5_f32, 7.0, 0.25]
            .iter()
            .flat_map(|x| x.to_le_bytes())
            .collect::<Vec<_>>(),
    );
    let sparse = format!(
        r#","normalized":true,"sparse":{{"count":1,"indices":{{"bufferView":{places},"componentType":5121}},"values":{{"bufferView":{values}}}}}"#
    );
    asset.accessor(&quantized, 5122, "VEC3", 4, r#","normalized":true"#);
    asset.accessor(
        &[255, 0, 51, 255, 0, 255, 0, 255, 0, 0, 0, 255, 9, 9, 9, 255],
        5121,
        "VEC4",
        4,
        r#","normalized":true"#,
    );
    asset.accessor(&[0, 1, 2, 0, 2, 3], 5121, "SCALAR", 6, "");
    let floats: Vec<u8> = CORNERS
        .iter()
        .flatten()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    asset.accessor(&floats, 5126, "VEC3", 4, &sparse);
    let mesh = |position: u32| {
        format!(
            r#"{NODE},"meshes":[{{"primitives":[{{"attributes":{{"POSITION":{position},"COLOR_0":1}},"indices":2}}]}}]"#
        )
    };
    let scene = load_text(asset.gltf(&format!(
        "{},\"extensionsRequired\":[\"KHR_mesh_quantization\"]",
        mesh(0)
    )))
    .expect("clean");
    assert!((scene.positions[2] - dvec3(1.0, 1.0, 0.0) * (16_383.0 / 32_767.0)).length() < 1e-12);
    assert_eq!(scene.colors[0], Vec3::new(1.0, 0.0, 0.2));
    let scene = load_text(asset.gltf(&mesh(3))).expect("clean");
    assert_eq!(scene.positions[2], dvec3(0.5, 7.0, 0.25));
    assert_eq!(scene.positions[1], dvec3(1.0, 0.0, 0.0));
}

const RED: [u8; 4] = [255, 0, 0, 255];
const HOLE: [u8; 4] = [0, 255, 0, 100];
const TEXTURE: &str = r#","textures":[{"source":0}],"images":[{"uri":"my%20wood.png"}]"#;

#[test]
fn factors_textures_and_emission() {
    let material = r#"{"name":"m","pbrMetallicRoughness":{"baseColorFactor":[0.5,1,1,1],"baseColorTexture":{"index":0}},
        "emissiveFactor":[1,0.5,0],"extensions":{"KHR_materials_emissive_strength":{"emissiveStrength":8}}}"#;
    let scene = with_material(material, TEXTURE, &[("my wood.png", &[RED])]);
    let surface = scene.surface(0, 0.3, 0.3);
    assert_eq!(
        (surface.albedo, surface.emission),
        ([0.5, 0.0, 0.0], [8.0, 4.0, 0.0])
    );
    assert_eq!(scene.materials[0].name, "m");
    assert!(scene.materials[0].cutout.is_none());
}

#[test]
fn alpha_modes() {
    let cutout = |material: &str| {
        let material = format!(
            r#"{{"pbrMetallicRoughness":{{"baseColorTexture":{{"index":0}}}},{material}}}"#
        );
        with_material(&material, TEXTURE, &[("my wood.png", &[RED, HOLE])]).materials[0]
            .cutout
            .map(|c| c.threshold)
    };
    assert_eq!(cutout(r#""alphaMode":"OPAQUE""#), None);
    assert_eq!(cutout(r#""alphaMode":"MASK""#), Some(0.5));
    assert_eq!(
        cutout(r#""alphaMode":"MASK","alphaCutoff":0.3"#),
        None,
        "no texel is below"
    );
    assert_eq!(cutout(r#""alphaMode":"BLEND""#), Some(0.5));

    let dropped = |material: &str| {
        let mesh = SQUARE.replace("}]}]", r#"},{"attributes":{"POSITION":0},"indices":2}]}]"#);
        let text = square().gltf(&format!(r#"{NODE},{mesh},"materials":[{material}]"#));
        load_text(text)
            .expect("the other square is left")
            .summary
            .notes
            .join("")
    };
    let factor =
        |alpha: f32| format!(r#""pbrMetallicRoughness":{{"baseColorFactor":[1,1,1,{alpha}]}}"#);
    assert!(
        dropped(&format!(r#"{{"alphaMode":"BLEND",{}}}"#, factor(0.4)))
            .starts_with("2 triangles with an opacity of one half or less")
    );
    assert!(!dropped(&format!(r#"{{"alphaMode":"BLEND",{}}}"#, factor(0.5))).contains("opacity"));
    assert!(
        !dropped(&format!(r#"{{{}}}"#, factor(0.1))).contains("opacity"),
        "alpha of an opaque material is ignored"
    );
    let transmission =
        r#"{"extensions":{"KHR_materials_transmission":{"transmissionFactor":0.9}}}"#;
    assert!(dropped(transmission).contains("opacity"));
    // The texture limits it to a part of the surface.
    let panes = r#"{"extensions":{"KHR_materials_transmission":{"transmissionFactor":1,"transmissionTexture":{"index":0}}}}"#;
    assert!(!dropped(panes).contains("opacity"));
}

#[test]
fn texture_transforms_scale_turn_and_move() {
    let material = r#"{"pbrMetallicRoughness":{"baseColorTexture":{"index":0,"extensions":
        {"KHR_texture_transform":{"offset":[0.25,0.5],"scale":[2,4],"rotation":1.5707963267948966}}}}}"#;
    let scene = with_material(material, TEXTURE, &[("my wood.png", &[RED])]);
    // Corner 2 has (1, 0) in the file: scaled (2, 0); rotated counter-clockwise by 90 degrees with
    // v downward (0, -2); offset (0.25, -1.5); with v upward (0.25, 2.5).
    let corner = scene
        .positions
        .iter()
        .position(|p| *p == dvec3(1.0, 1.0, 0.0))
        .expect("there");
    assert!(
        (scene.texcoords[corner] - Vec2::new(0.25, 2.5)).length() < 1e-6,
        "{}",
        scene.texcoords[corner]
    );
}

#[test]
fn embedded_images_decoded_missing_noted() {
    let folder = Folder::new();
    folder.write_image("x.png", &[RED]);
    let png = folder.read("x.png");
    let mut asset = square();
    let view = asset.view(&png);
    let material = r#""materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}],"textures":[{"source":0}]"#;
    let in_view = format!(r#"{{"bufferView":{view},"mimeType":"image/png"}}"#);
    let in_uri = format!(r#"{{"uri":"data:image/png;base64,{}"}}"#, base64(&png));
    for image in [
        in_view.as_str(),
        &in_view.replace(r#","mimeType":"image/png""#, ""),
        &in_uri,
    ] {
        let rest = format!(r#"{NODE},{SQUARE},{material},"images":[{image}]"#);
        folder.write("a.glb", asset.glb(&rest));
        let scene = folder.load("a.glb").expect("survives");
        assert_eq!(
            scene.surface(0, 0.3, 0.3).albedo,
            [1.0, 0.0, 0.0],
            "{image}"
        );
        assert_eq!(scene.summary.notes, Vec::<String>::new());
    }
    for (image, cause) in [
        (r#"{"uri":"gone.png"}"#, "gone.png (no such file)"),
        (r#"{"uri":"%FF.png"}"#, "no such file"),
        (
            r#"{"name":"n"}"#,
            "image 0 n (it has neither bytes nor a name)",
        ),
        (r#"{"bufferView":99}"#, "image 0 (its bytes are missing)"),
        (
            r#"{"uri":"data:image/png;base64,?"}"#,
            "image 0 (character 0 of its base64 text is not base64)",
        ),
    ] {
        let scene =
            load_text(asset.gltf(&format!(r#"{NODE},{SQUARE},{material},"images":[{image}]"#)))
                .expect("survives");
        let note = &scene.summary.notes[0];
        assert!(
            note.starts_with("1 texture could not be read: ") && note.contains(cause),
            "{note}"
        );
    }
}

#[test]
fn errors_name_file_and_cause() {
    let asset = square();
    let rest = format!(r#"{NODE},{SQUARE}"#);
    let folder = Folder::new();
    let error = |name: &str, bytes: &[u8], causes: &[&str]| {
        folder.write(name, bytes);
        let error = folder.load(name).expect_err(name);
        assert!(
            error.contains(name) && causes.iter().all(|cause| error.contains(cause)),
            "{error}"
        );
    };
    error(
        "a.gltf",
        b"{\"asset\":{\"version\":\"2.0\"},\n\"nodes\":[}",
        &["line 2"],
    );
    error("b.gltf", b"", &["neither a GLB", "nor a glTF"]);
    error(
        "c.gltf",
        b"{\"asset\":{\"version\":\"2.0\"}}",
        &["there is no triangle"],
    );
    error(
        "d.glb",
        b"glTF",
        &["the GLB header specifies 0 bytes, but the file has 4"],
    );
    let glb = asset.glb(&rest);
    error(
        "e.glb",
        &glb[..glb.len() - 5],
        &["the GLB header specifies", "bytes, but the file has"],
    );
    folder.write("long.glb", [&glb[..], b"junk"].concat());
    let long = folder.load("long.glb").expect("survives");
    assert_eq!(
        long.summary.notes,
        ["4 bytes after the end specified in the GLB header skipped"]
    );
    let mut wrong_version = glb.clone();
    wrong_version[4] = 1;
    error("f.glb", &wrong_version, &["version"]);
    let mut short_header = glb.clone();
    short_header[8..12].copy_from_slice(&7_u32.to_le_bytes());
    error(
        "g.glb",
        &short_header,
        &["the GLB header specifies 7 bytes"],
    );
    for (extension, advice) in [
        (
            "EXT_texture_avif",
            "its textures have another format by the glTF extension EXT_texture_avif",
        ),
        (
            "X_y",
            "it cannot be read without the glTF extension X_y, which is not supported; export it without it",
        ),
    ] {
        let required = asset.gltf(&format!(r#"{rest},"extensionsRequired":["{extension}"]"#));
        error("h.gltf", required.as_bytes(), &[advice]);
    }
    let no_buffer = asset.json(r#","uri":"gone.bin""#, &rest);
    error(
        "i.gltf",
        no_buffer.as_bytes(),
        &[
            "there is no triangle",
            "1 buffer could not be read: gone.bin (no such file)",
        ],
    );
    let no_blob = asset.json("", &rest);
    error(
        "j.gltf",
        no_blob.as_bytes(),
        &["buffer 0 (no binary chunk)"],
    );
}

#[test]
fn damaged_parts_are_left_out_and_counted() {
    let mut asset = square();
    let wild = asset.indices(&[0, 1, 2, 0, 2, 900]);
    let primitives = format!(
        r#"{{"attributes":{{"POSITION":0,"TEXCOORD_0":77}},"indices":{wild}}},
           {{"attributes":{{"POSITION":99}}}},
           {{"attributes":{{"POSITION":1}}}},
           {{"attributes":{{}}}},
           {{"attributes":{{"POSITION":0}},"indices":50}},
           {{"attributes":{{"POSITION":0}},"material":12,"mode":1}},
           {{"attributes":{{"POSITION":0,"NORMAL":1}},"material":12}}"#
    );
    let rest = format!(
        r#""nodes":[{{"mesh":0,"skin":0,"children":[1]}},{{"children":[0]}},{{"mesh":44}},{{"children":[99]}}],
           "scenes":[{{"nodes":[0,2,3]}}],"meshes":[{{"primitives":[{primitives}]}}]"#
    );
    let scene = load_text(asset.gltf(&rest)).expect("survives");
    assert_eq!(
        scene.triangles.len(),
        2,
        "one of the wild indices, one without indices"
    );
    let expected = [
        "8 damaged mesh parts or attributes left out",
        "1 skinned mesh with damaged joints or weights shown undeformed",
        "1 node reached more than once and used only the first time",
        "1 element without a surface (points, lines, curves) left out",
        "1 face with a vertex index out of range left out",
        "1 duplicate triangle kept",
    ];
    assert_eq!(scene.summary.notes, expected);
}

#[test]
fn oversized_counts_refused_before_allocation() {
    let claim = |accessor: &str| {
        let rest =
            format!(r#"{NODE},"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}}]}}]"#);
        let text = format!(
            r#"{{"asset":{{"version":"2.0"}},"buffers":[{{"byteLength":4,"uri":"data:;base64,AAAA"}}],
               "bufferViews":[{{"buffer":0,"byteOffset":18446744073709551615,"byteLength":18446744073709551615}},
               {{"buffer":0,"byteLength":3}}],"accessors":[{accessor}],{rest}}}"#
        );
        load_text(text).expect_err("nothing is there")
    };
    for accessor in [
        r#"{"componentType":5126,"type":"VEC3","count":18446744073709551615}"#,
        r#"{"bufferView":0,"componentType":5126,"type":"VEC3","count":9}"#,
        r#"{"bufferView":1,"componentType":5121,"type":"VEC3","count":18446744073709551615}"#,
        r#"{"bufferView":1,"byteOffset":18446744073709551615,"componentType":5121,"type":"VEC3","count":1}"#,
        r#"{"bufferView":1,"componentType":5121,"type":"VEC3","count":0}"#,
        r#"{"bufferView":1,"componentType":77,"type":"VEC9","count":1}"#,
        r#"{"bufferView":1,"componentType":5121,"type":"MAT4","count":1}"#,
    ] {
        let error = claim(accessor);
        assert!(
            error.contains("1 damaged mesh part or attribute left out"),
            "{error}"
        );
    }
}

/// A room of 5 by 4 by 2.7 units with a table, which stands on the plane of X and Y: Z points up.
fn room_with_z_up(scale: f32) -> Asset {
    let mut asset = Asset::default();
    let (mut positions, mut indices) = (Vec::new(), Vec::new());
    for [low, high] in [
        [[0.0, 0.0, 0.0], [5.0, 4.0, 2.7]],
        [[1.0, 1.0, 0.0], [2.5, 2.0, 0.75]],
    ] {
        let first = positions.len() as u16;
        let corner = |bits: usize| {
            [0, 1, 2].map(|axis| {
                scale
                    * if bits >> axis & 1 == 0 {
                        low[axis]
                    } else {
                        high[axis]
                    }
            })
        };
        positions.extend((0..8).map(corner));
        for [a, b, c, d] in [
            [0, 1, 3, 2],
            [4, 5, 7, 6],
            [0, 1, 5, 4],
            [2, 3, 7, 6],
            [0, 2, 6, 4],
            [1, 3, 7, 5],
        ] {
            indices.extend([a, b, d, b, c, d].map(|corner: u16| first + corner));
        }
    }
    asset.floats(&positions);
    asset.indices(&indices);
    asset
}

#[test]
fn gltf_z_up_evidence_is_noted_only() {
    let text = |scale: f32, node: &str| {
        room_with_z_up(scale).gltf(&format!(
            r#""nodes":[{{"mesh":0{node}}}],"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1}}]}}]"#
        ))
    };
    let told = |text: String| {
        let scene = load_text(text).expect("survives");
        assert_eq!(scene.frame, FileFrame::default());
        scene.summary.notes.join("; ")
    };
    let doubts = told(text(100.0, ""));
    assert!(
        doubts.contains("--up z if so") && doubts.contains("--unit cm"),
        "{doubts}"
    );
    let doubts = told(text(1.0, ""));
    assert!(
        doubts.contains("--up z if so") && !doubts.contains("--unit"),
        "{doubts}"
    );
    // Upright by the rotation of its node, as exporters write it.
    let upright = r#","rotation":[-0.7071067811865476,0,0,0.7071067811865476]"#;
    assert_eq!(told(text(1.0, upright)), "");
    // A file with a headbox was written by headbox.
    let headbox = r#","translation":[1,2,3],"extras":{"headbox_half_size":0.25}"#;
    let scene = load_text(text(100.0, headbox)).expect("survives");
    assert!(scene.summary.notes.is_empty(), "{:?}", scene.summary.notes);
    let found = scene.headbox.expect("said");
    assert_eq!(
        (found.centre, found.half_size_m),
        (dvec3(1.0, 2.0, 3.0), 0.25)
    );
    for nonsense in ["-1", "0", "\"large\"", "null"] {
        let extras = format!(r#","extras":{{"headbox_half_size":{nonsense}}}"#);
        assert_eq!(
            load_text(text(1.0, &extras)).expect("survives").headbox,
            None,
            "{nonsense}"
        );
    }
}
