//! Where the parts of a glTF file stand, from its JSON alone: that of a file of gigabytes is read at once.

use super::second_reading::SecondReading;
use super::{glb_length, placed_nodes};
use crate::load::notes::Notes;
use ::gltf::json::accessor::{Accessor, ComponentType};
use ::gltf::json::mesh::Semantic;
use ::gltf::json::validation::Checked;
use ::gltf::json::{Root, deserialize};
use glam::{DVec3, dvec3};
use serde_json::Value;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// A longer JSON is as slow to read as the rest.
const MOST_JSON_BYTES: u64 = 64 << 20;
/// Bytes of a GLB before its JSON: its header, and that of the first chunk.
const HEADER_BYTES: usize = 20;

/// The corners of the boxes about the meshes of a `.gltf` or `.glb`, each where its node puts it; corner `i` lies at the far end of axis
/// `k` where bit `k` of `i` is set. `None` if the file cannot be read so.
pub fn gltf_boxes(path: &Path) -> Option<Vec<[DVec3; 8]>> {
    let json = json_of(path)?;
    let root: Root = deserialize::from_slice(&json).ok()?;
    let reread = SecondReading::read(&json).ok()?;
    let mut boxes = Vec::new();
    for (index, world_from_node) in placed_nodes(&root, &reread, &mut Notes::default()) {
        let mesh = root.nodes.get(index).and_then(|node| root.meshes.get(node.mesh?.value()));
        for primitive in mesh.iter().flat_map(|mesh| &mesh.primitives) {
            let positions = primitive.attributes.get(&Checked::Valid(Semantic::Positions));
            let ends = positions.and_then(|positions| ends(root.accessors.get(positions.value())?));
            let Some([low, high]) = ends else { continue };
            let corner = |i: usize| {
                let [x, y, z] = [0, 1, 2].map(|axis| if i >> axis & 1 == 1 { high[axis] } else { low[axis] });
                world_from_node.transform_point3(dvec3(x, y, z))
            };
            boxes.push(std::array::from_fn(corner));
        }
    }
    Some(boxes)
}

/// The JSON of a file.
fn json_of(path: &Path) -> Option<Vec<u8>> {
    let mut file = File::open(path).ok()?;
    let mut header = [0; HEADER_BYTES];
    file.read_exact(&mut header).ok()?;
    if glb_length(&header).is_none() {
        return (file.metadata().ok()?.len() <= MOST_JSON_BYTES).then(|| std::fs::read(path).ok()).flatten();
    }
    let length = u64::from(u32::from_le_bytes([header[12], header[13], header[14], header[15]]));
    let mut json = Vec::new();
    (length <= MOST_JSON_BYTES).then(|| file.take(length).read_to_end(&mut json).ok()).flatten()?;
    Some(json)
}

/// The least and largest of an accessor's entries, as the file tells them.
fn ends(accessor: &Accessor) -> Option<[DVec3; 2]> {
    let Checked::Valid(component) = accessor.component_type else { return None };
    // Of integers that stand for parts of 1, the format keeps ends as integers.
    let whole = match (accessor.normalized, component.0) {
        (false, _) | (_, ComponentType::F32 | ComponentType::U32) => 1.0,
        (_, ComponentType::I8) => f64::from(i8::MAX),
        (_, ComponentType::U8) => f64::from(u8::MAX),
        (_, ComponentType::I16) => f64::from(i16::MAX),
        (_, ComponentType::U16) => f64::from(u16::MAX),
    };
    let end = |told: &Option<Value>| {
        let told = told.as_ref()?.as_array()?;
        let at = |axis: usize| told.get(axis)?.as_f64();
        Some(dvec3(at(0)?, at(1)?, at(2)?) / whole).filter(|end| end.is_finite())
    };
    Some([end(&accessor.min)?, end(&accessor.max)?])
}
