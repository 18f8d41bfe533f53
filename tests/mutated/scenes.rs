//! Mutated scenes of the formats that `files.rs` does not have: PLY, STL, compressed glTF, and
//! texts in other encodings.

use crate::mutations::{Alone, Files, corpus};
use headbox_model::load::load_scene;
use headbox_scene::load::LoadOptions;
use std::fmt::Write;
use std::path::Path;

fn read_scene(path: &Path) -> bool {
    load_scene(path, &LoadOptions::default()).is_ok_and(|scene| {
        assert_eq!(scene.validate(), Ok(()), "what is loaded is sound");
        true
    })
}

const PLY: &str = "ply\nformat ascii 1.0\ncomment TextureFile a.png\nelement vertex 4\n\
    property float x\nproperty float y\nproperty float z\nproperty uchar red\n\
    property uchar green\nproperty uchar blue\nelement face 2\n\
    property list uchar int vertex_indices\nend_header\n\
    0 0 0 255 0 0\n1 0 0 255 0 0\n1 1 0 0 0 255\n0 1 0 0 9 9\n3 0 1 2\n4 0 1 2 3\n";
const STL: &str = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n\
    vertex 0 1 0\nendloop\nendfacet\nendsolid a\n";

/// The vertices of [`PLY`] and a triangle in a binary file.
fn binary_ply(format: &str) -> Vec<u8> {
    let header = PLY.split("0 0 0 255").next().expect("a header");
    let mut bytes = header
        .replace("ascii", format)
        .replace("face 2", "face 1")
        .into_bytes();
    let is_little = format == "binary_little_endian";
    for [x, y] in [[0.0_f32, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]] {
        for c in [x, y, 0.0] {
            bytes.extend(if is_little {
                c.to_le_bytes()
            } else {
                c.to_be_bytes()
            });
        }
        bytes.extend([255, 0, 0]);
    }
    bytes.push(3);
    for i in 0..3_i32 {
        bytes.extend(if is_little {
            i.to_le_bytes()
        } else {
            i.to_be_bytes()
        });
    }
    bytes
}

fn binary_stl() -> Vec<u8> {
    let mut bytes = vec![b' '; 80];
    bytes.extend(2_u32.to_le_bytes());
    for _ in 0..2 {
        for n in [
            0.0_f32, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0,
        ] {
            bytes.extend(n.to_le_bytes());
        }
        bytes.extend([0, 0]);
    }
    bytes
}

#[test]
fn ply_files() {
    let alone = Alone::lock();
    let files = [
        PLY.into(),
        binary_ply("binary_little_endian"),
        binary_ply("binary_big_endian"),
    ];
    alone.try_mutations("a.ply", &files, false, read_scene);
}

#[test]
fn stl_files() {
    let alone = Alone::lock();
    alone.try_mutations("a.stl", &[STL.into(), binary_stl()], false, read_scene);
}

/// GLB with one mesh that needs an extension.
fn glb(json: &str, data: &[u8]) -> Vec<u8> {
    let mut json = json.as_bytes().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut data = data.to_vec();
    data.resize(data.len().next_multiple_of(4), 0);
    let mut glb = b"glTF\x02\0\0\0".to_vec();
    glb.extend((28 + json.len() as u32 + data.len() as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", &json), (b"BIN\0", &data)] {
        glb.extend((chunk.len() as u32).to_le_bytes());
        glb.extend(kind);
        glb.extend(chunk);
    }
    glb
}

const NODE: &str =
    r#""asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}]"#;

fn draco_glb() -> Vec<u8> {
    let data = corpus("cube.drc");
    let length = data.len();
    let json = format!(
        r#"{{{NODE},"extensionsUsed":["KHR_draco_mesh_compression"],"extensionsRequired":["KHR_draco_mesh_compression"],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1,
        "extensions":{{"KHR_draco_mesh_compression":{{"bufferView":0,"attributes":{{"POSITION":0}}}}}}}}]}}],
        "accessors":[{{"componentType":5126,"count":24,"type":"VEC3"}},{{"componentType":5123,"count":36,"type":"SCALAR"}}],
        "bufferViews":[{{"buffer":0,"byteLength":{length}}}],"buffers":[{{"byteLength":{length}}}]}}"#
    );
    glb(&json, &data)
}

fn meshopt_glb() -> Vec<u8> {
    let data = corpus("cube.meshopt");
    let (length, positions) = (data.len(), data.len() - 32);
    let mut json = format!(
        r#"{{{NODE},"extensionsUsed":["EXT_meshopt_compression","KHR_mesh_quantization"],
        "extensionsRequired":["EXT_meshopt_compression","KHR_mesh_quantization"],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1}}]}}],
        "accessors":[{{"bufferView":0,"byteOffset":32,"componentType":5123,"count":24,"type":"VEC3"}},
        {{"bufferView":1,"byteOffset":12,"componentType":5123,"count":36,"type":"SCALAR"}}],"bufferViews":["#
    );
    for (start, bytes, size, stride, mode, count) in [
        (0, positions, 224, 8, "ATTRIBUTES", 28),
        (positions, 32, 84, 2, "TRIANGLES", 42),
    ] {
        let comma = if start == 0 { "" } else { "," };
        let own = if stride == 8 {
            r#","byteStride":8"#
        } else {
            ""
        };
        write!(
            json,
            r#"{comma}{{"buffer":1,"byteLength":{size}{own},"extensions":{{"EXT_meshopt_compression":
            {{"buffer":0,"byteOffset":{start},"byteLength":{bytes},"byteStride":{stride},"mode":"{mode}","count":{count}}}}}}}"#
        )
        .expect("a string");
    }
    write!(
        json,
        r#"],"buffers":[{{"byteLength":{length}}},{{"byteLength":308}}]}}"#
    )
    .expect("a string");
    glb(&json, &data)
}

/// A square with a texture in KTX2 inside the file.
fn ktx2_glb() -> Vec<u8> {
    let mut data = Vec::new();
    let corners = [[0.0_f32, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    for [x, y] in corners {
        [x, y, 0.0]
            .iter()
            .for_each(|c| data.extend(c.to_le_bytes()));
    }
    for c in corners.as_flattened() {
        data.extend(c.to_le_bytes());
    }
    [0_u16, 1, 2, 0, 2, 3]
        .iter()
        .for_each(|i| data.extend(i.to_le_bytes()));
    let start = data.len();
    data.extend(corpus("red.ktx2"));
    let (length, image) = (data.len(), data.len() - start);
    let json = format!(
        r#"{{{NODE},"extensionsUsed":["KHR_texture_basisu"],"extensionsRequired":["KHR_texture_basisu"],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":1}},"indices":2,"material":0}}]}}],
        "materials":[{{"pbrMetallicRoughness":{{"baseColorTexture":{{"index":0}}}}}}],
        "textures":[{{"extensions":{{"KHR_texture_basisu":{{"source":0}}}}}}],
        "images":[{{"bufferView":3,"mimeType":"image/ktx2"}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3"}},
        {{"bufferView":1,"componentType":5126,"count":4,"type":"VEC2"}},
        {{"bufferView":2,"componentType":5123,"count":6,"type":"SCALAR"}}],
        "bufferViews":[{{"buffer":0,"byteLength":48}},{{"buffer":0,"byteOffset":48,"byteLength":32}},
        {{"buffer":0,"byteOffset":80,"byteLength":12}},{{"buffer":0,"byteOffset":{start},"byteLength":{image}}}],
        "buffers":[{{"byteLength":{length}}}]}}"#
    );
    glb(&json, &data)
}

#[test]
fn draco_meshes() {
    let alone = Alone::lock();
    alone.try_mutations("draco.glb", &[draco_glb()], false, read_scene);
}

#[test]
fn meshopt_meshes() {
    let alone = Alone::lock();
    alone.try_mutations("meshopt.glb", &[meshopt_glb()], false, read_scene);
}

#[test]
fn ktx2_textures() {
    let alone = Alone::lock();
    alone.try_mutations("ktx2.glb", &[ktx2_glb()], false, read_scene);
}

/// The text in UTF-16 with a byte order mark.
fn utf16(text: &str) -> Vec<u8> {
    let units = std::iter::once(0xfeff).chain(text.encode_utf16());
    units.flat_map(u16::to_le_bytes).collect()
}

#[test]
fn texts_in_other_encodings() {
    let alone = Alone::lock();
    let obj = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl Wände\nf 1/1 2/1 3/1\n";
    let mtl = "newmtl Wände\nKd 0.5 0.4 0.3\nmap_Kd -s 2 2 2 Größe.png\nd 0.6\n";
    let latin = |text: &str| text.chars().map(|c| c as u8).collect::<Vec<u8>>();
    let of = |encode: &dyn Fn(&str) -> Vec<u8>| -> Files {
        vec![("a.obj".into(), encode(obj)), ("m.mtl".into(), encode(mtl))]
    };
    // "床" in Shift-JIS; its second byte is above the ASCII letters.
    let japanese: Files = vec![
        (
            "a.obj".into(),
            [
                b"mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl ".as_slice(),
                b"\x8f\xb0\nf 1 2 3\n",
            ]
            .concat(),
        ),
        (
            "m.mtl".into(),
            b"newmtl \x8f\xb0\nKd 0.5 0.4 0.3\n".to_vec(),
        ),
    ];
    let folders = [of(&utf16), of(&latin), japanese];
    alone.try_folders("encodings", &folders, |folder| {
        read_scene(&folder.join("a.obj"))
    });
}

/// A GLB with textures and lights, whose chunks are mutated with valid lengths.
#[test]
fn glb_chunks() {
    let alone = Alone::lock();
    alone.try_mutations("chunks.glb", &[corpus("a.glb")], false, read_scene);
}
