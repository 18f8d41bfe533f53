//! Builder of glTF files.

use crate::folder::Folder;
use headbox_scene::scene::Scene;

/// Builder of a binary buffer with its views and accessors.
#[derive(Default)]
pub(crate) struct Asset {
    pub(crate) bytes: Vec<u8>,
    views: Vec<String>,
    pub(crate) accessors: Vec<String>,
}

impl Asset {
    pub(crate) fn view(&mut self, bytes: &[u8]) -> usize {
        self.views.push(format!(
            r#"{{"buffer":0,"byteOffset":{},"byteLength":{}}}"#,
            self.bytes.len(),
            bytes.len()
        ));
        self.bytes.extend(bytes);
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.views.len() - 1
    }

    pub(crate) fn accessor(
        &mut self,
        bytes: &[u8],
        component: u32,
        kind: &str,
        count: usize,
        more: &str,
    ) -> usize {
        let view = self.view(bytes);
        self.accessors.push(format!(
            r#"{{"bufferView":{view},"componentType":{component},"type":"{kind}","count":{count}{more}}}"#
        ));
        self.accessors.len() - 1
    }

    pub(crate) fn floats<const N: usize>(&mut self, values: &[[f32; N]]) -> usize {
        let bytes: Vec<u8> = values
            .iter()
            .flatten()
            .flat_map(|x| x.to_le_bytes())
            .collect();
        self.accessor(
            &bytes,
            5126,
            ["", "SCALAR", "VEC2", "VEC3", "VEC4"][N],
            values.len(),
            "",
        )
    }

    pub(crate) fn indices(&mut self, values: &[u16]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
        self.accessor(&bytes, 5123, "SCALAR", values.len(), "")
    }

    /// Returns the JSON; `buffer` refers to the bytes, `rest` has nodes, meshes, materials and so
    /// on.
    pub(crate) fn json(&self, buffer: &str, rest: &str) -> String {
        format!(
            r#"{{"asset":{{"version":"2.0"}},"buffers":[{{"byteLength":{}{buffer}}}],"bufferViews":[{}],"accessors":[{}],{rest}}}"#,
            self.bytes.len(),
            self.views.join(","),
            self.accessors.join(",")
        )
    }

    pub(crate) fn gltf(&self, rest: &str) -> String {
        self.json(
            &format!(
                r#","uri":"data:application/octet-stream;base64,{}""#,
                base64(&self.bytes)
            ),
            rest,
        )
    }

    pub(crate) fn glb(&self, rest: &str) -> Vec<u8> {
        let mut json = self.json("", rest).into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let mut glb = b"glTF\x02\0\0\0".to_vec();
        glb.extend((28 + json.len() as u32 + self.bytes.len() as u32).to_le_bytes());
        for (kind, chunk) in [(b"JSON", &json), (b"BIN\0", &self.bytes)] {
            glb.extend((chunk.len() as u32).to_le_bytes());
            glb.extend(kind);
            glb.extend(chunk);
        }
        glb
    }
}

pub(crate) fn base64(bytes: &[u8]) -> String {
    const ALPHABET: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let group = |chunk: &[u8]| -> [char; 4] {
        let bits = chunk
            .iter()
            .fold(0_u32, |bits, &b| bits << 8 | u32::from(b))
            << (8 * (3 - chunk.len()));
        std::array::from_fn(|i| match ALPHABET[(bits >> (18 - 6 * i) & 63) as usize] {
            letter if i <= chunk.len() => char::from(letter),
            _ => '=',
        })
    };
    bytes.chunks(3).flat_map(group).collect()
}

pub(crate) fn load_text(text: impl AsRef<[u8]>) -> Result<Scene, String> {
    let folder = Folder::new();
    folder.write("a.gltf", text);
    folder.load("a.gltf")
}

pub(crate) const CORNERS: [[f32; 3]; 4] = [
    [0.0, 0.0, 0.0],
    [1.0, 0.0, 0.0],
    [1.0, 1.0, 0.0],
    [0.0, 1.0, 0.0],
];
pub(crate) const TEXCOORDS: [[f32; 2]; 4] = [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]];

/// A square with texture coordinates and indices; accessors 0, 1, 2.
pub(crate) fn square() -> Asset {
    let mut asset = Asset::default();
    asset.floats(&CORNERS);
    asset.floats(&TEXCOORDS);
    asset.indices(&[0, 1, 2, 0, 2, 3]);
    asset
}

pub(crate) const SQUARE: &str = r#""meshes":[{"primitives":[{"attributes":{"POSITION":0,"TEXCOORD_0":1},"indices":2,"material":0}]}]"#;
pub(crate) const NODE: &str = r#""nodes":[{"mesh":0}]"#;
