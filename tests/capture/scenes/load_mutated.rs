//! Mutated scene files: loading returns a valid scene or an error that names the file.

use crate::folder::Folder;
use proptest::prelude::*;

const OBJ: &str = "mtllib m.mtl\no a\nv 0 0 0 1 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0.5\nvt 0 0\nvt 1 1\nvn 0 0 1\nusemtl m\n\
                   f 1/1/1 2/2/1 3//1 4\ng b\nf -1 -2 -3\nusemtl n\nl 1 2\nf 1 2 \\\n 3\n";
const MTL: &str = "newmtl m\nKd 0.5 0.5 0.5\nKa 20 20 20\nmap_Kd -s 2 2 2 -o 0.5 a.png\nmap_d a.png\nd 0.6\nnewmtl n\nTr 0.2\nillum 4\n";
const GLTF: &str = r#"{"asset":{"version":"2.0"},"extensions":{"KHR_lights_punctual":{"lights":[{"type":"spot","intensity":4,"range":9,"spot":{"outerConeAngle":0.5}}]}},"scene":0,"scenes":[{"nodes":[0]}],
"nodes":[{"mesh":0,"scale":[1,2,-1],"children":[1]},{"mesh":0,"extensions":{"KHR_lights_punctual":{"light":0}},"matrix":[1,0,0,0,0,1,0,0,0,0,1,0,5,0,0,1]}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0,"COLOR_0":0},"indices":1,"material":0,"mode":4}]}],
"materials":[{"alphaMode":"MASK","alphaCutoff":0.4,"pbrMetallicRoughness":{"baseColorFactor":[1,1,1,1],"baseColorTexture":{"index":0}}}],
"textures":[{"source":0}],"images":[{"uri":"a.png"}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"},{"bufferView":1,"componentType":5123,"count":3,"type":"SCALAR"}],
"bufferViews":[{"buffer":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":6}],
"buffers":[{"byteLength":42,"uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAAAAABAAIA"}]}"#;

const PLY: &str = "ply\nformat ascii 1.0\ncomment TextureFile a.png\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\n\
                   property uchar green\nproperty uchar blue\nelement face 1\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\nend_header\n\
                   0 0 0 255 0 0\n1 0 0 255 0 0\n0 1 0 0 0 255\n3 0 1 2 6 0 0 1 0 0 1\n";
const STL: &str = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid a\n";

/// Triangle of [`PLY`] without texture coordinates, binary.
fn binary_ply() -> Vec<u8> {
    let header = PLY.split("0 0 0 255").next().expect("a header");
    let mut bytes = header
        .replace("ascii", "binary_little_endian")
        .replace("property list uchar float texcoord\n", "")
        .into_bytes();
    for [x, y] in [[0.0_f32, 0.0], [1.0, 0.0], [0.0, 1.0]] {
        [x, y, 0.0]
            .iter()
            .for_each(|c| bytes.extend(c.to_le_bytes()));
        bytes.extend([255, 0, 0]);
    }
    bytes.push(3);
    (0..3_i32).for_each(|index| bytes.extend(index.to_le_bytes()));
    bytes
}

/// A triangle in a binary file.
fn binary_stl() -> Vec<u8> {
    let mut bytes = vec![b' '; 80];
    bytes.extend(1_u32.to_le_bytes());
    for number in [
        0.0_f32, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0,
    ] {
        bytes.extend(number.to_le_bytes());
    }
    bytes.extend([0, 0]);
    bytes
}

/// The JSON above in a GLB, its buffer still in the URI.
fn glb() -> Vec<u8> {
    let mut json = GLTF.as_bytes().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut glb = b"glTF\x02\0\0\0".to_vec();
    glb.extend((20 + json.len() as u32).to_le_bytes());
    glb.extend((json.len() as u32).to_le_bytes());
    glb.extend(b"JSON");
    glb.extend(json);
    glb
}

/// One change to a file.
#[derive(Clone, Debug)]
enum Change {
    Set(usize, u8),
    Insert(usize, Vec<u8>),
    Remove(usize, usize),
    Truncate(usize),
}

fn change() -> impl Strategy<Value = Change> {
    // Bytes with a meaning for parsers are more frequent than others.
    let byte = prop_oneof![
        any::<u8>(),
        proptest::sample::select(b"0123456789-./\\ \n\r\t\"{}[],:eE#nfv".to_vec())
    ];
    let place = any::<usize>();
    prop_oneof![
        4 => (place, byte.clone()).prop_map(|(at, byte)| Change::Set(at, byte)),
        2 => (place, proptest::collection::vec(byte, 1..8)).prop_map(|(at, bytes)| Change::Insert(at, bytes)),
        2 => (place, 1_usize..20).prop_map(|(at, count)| Change::Remove(at, count)),
        1 => place.prop_map(Change::Truncate),
    ]
}

fn mutate(mut bytes: Vec<u8>, changes: &[Change]) -> Vec<u8> {
    for change in changes {
        let place = |at: usize| at % (bytes.len() + 1);
        match change {
            Change::Set(at, byte) => {
                let at = place(*at);
                if let Some(old) = bytes.get_mut(at) {
                    *old = *byte;
                }
            }
            Change::Insert(at, new) => {
                let at = place(*at);
                bytes.splice(at..at, new.iter().copied());
            }
            Change::Remove(at, count) => {
                let at = place(*at);
                bytes.drain(at..(at + count).min(bytes.len()));
            }
            Change::Truncate(at) => bytes.truncate(place(*at)),
        }
    }
    bytes
}

/// Loads `name`; errors name it. [`Folder::load`] checks scenes.
fn loads_or_explains(folder: &Folder, name: &str) {
    if let Err(error) = folder.load(name) {
        assert!(error.contains(name), "{error}");
    }
}

fn folder() -> Folder {
    let folder = Folder::new();
    folder.write("m.mtl", MTL);
    folder.write_image("a.png", &[[255, 0, 0, 255], [0, 255, 0, 0]]);
    folder
}

#[test]
fn unmutated_files_load() {
    let folder = folder();
    folder.write("a.obj", OBJ);
    folder.write("a.gltf", GLTF);
    folder.write("a.glb", glb());
    assert_eq!(folder.load("a.obj").expect("clean").triangles.len(), 4);
    assert_eq!(folder.load("a.gltf").expect("clean").triangles.len(), 2);
    assert_eq!(folder.load("a.glb").expect("clean").triangles.len(), 2);
    for (name, bytes) in [
        ("a.ply", PLY.into()),
        ("b.ply", binary_ply()),
        ("a.stl", STL.into()),
        ("b.stl", binary_stl()),
    ] {
        folder.write(name, bytes);
        assert_eq!(
            folder.load(name).expect("clean").triangles.len(),
            1,
            "{name}"
        );
    }
}

proptest! {
    #[test]
    fn mutated_obj_files_never_panic(changes in proptest::collection::vec(change(), 1..6)) {
        let folder = folder();
        folder.write("a.obj", mutate(OBJ.into(), &changes));
        loads_or_explains(&folder, "a.obj");
    }

    #[test]
    fn mutated_mtl_keeps_geometry(changes in proptest::collection::vec(change(), 1..6)) {
        let folder = folder();
        folder.write("a.obj", OBJ.replace("usemtl m\n", ""));
        folder.write("m.mtl", mutate(MTL.into(), &changes));
        prop_assert!(folder.load("a.obj").is_ok());
    }

    #[test]
    fn mutated_gltf_files_never_panic(changes in proptest::collection::vec(change(), 1..6)) {
        let folder = folder();
        folder.write("a.gltf", mutate(GLTF.into(), &changes));
        loads_or_explains(&folder, "a.gltf");
    }

    #[test]
    fn mutated_glb_files_never_panic(changes in proptest::collection::vec(change(), 1..6)) {
        let folder = folder();
        folder.write("a.glb", mutate(glb(), &changes));
        loads_or_explains(&folder, "a.glb");
    }

    #[test]
    fn mutated_ply_and_stl_files_never_panic(
        kind in 0_usize..4,
        changes in proptest::collection::vec(change(), 1..6)
    ) {
        let folder = folder();
        let bytes = [PLY.into(), STL.into(), binary_ply(), binary_stl()][kind].clone();
        let name = ["a.ply", "a.stl"][kind % 2];
        folder.write(name, mutate(bytes, &changes));
        loads_or_explains(&folder, name);
    }

    #[test]
    fn mutated_images_never_panic(changes in proptest::collection::vec(change(), 1..4)) {
        let folder = folder();
        folder.write("a.obj", OBJ);
        folder.write("a.png", mutate(folder.read("a.png"), &changes));
        prop_assert!(folder.load("a.obj").is_ok());
    }
}
