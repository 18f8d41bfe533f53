//! `EXT_mesh_gpu_instancing`: many instances of a node's mesh.

use super::super::notes::{Note, Notes};
use super::accessor::Buffers;
use super::raw_json::compose;
use glam::DAffine3;
use gltf::json::Index;
use serde::Deserialize;

/// Accessors of a node's instances, if the file has them.
#[derive(Clone, Default, Deserialize)]
#[serde(default, rename_all = "UPPERCASE")]
pub(super) struct InstanceAttributes {
    translation: Option<u32>,
    rotation: Option<u32>,
    scale: Option<u32>,
}

/// Returns the transforms of the instances of a node's mesh, or that of the node without instances.
/// Damaged instances are counted and ignored.
pub(super) fn instance_transforms(
    attributes: Option<&InstanceAttributes>,
    world_from_node: DAffine3,
    buffers: &Buffers,
    notes: &mut Notes,
) -> Vec<DAffine3> {
    let Some(attributes) = attributes else {
        return vec![world_from_node];
    };
    match node_from_instances(attributes, buffers) {
        Some(instances) => instances
            .into_iter()
            .map(|node_from_instance| world_from_node * node_from_instance)
            .collect(),
        None => {
            notes.add(Note::AccessorUnreadable, 1);
            vec![world_from_node]
        }
    }
}

fn node_from_instances(
    attributes: &InstanceAttributes,
    buffers: &Buffers,
) -> Option<Vec<DAffine3>> {
    let translations = read::<3>(attributes.translation, buffers)?;
    let rotations = read::<4>(attributes.rotation, buffers)?;
    let scales = read::<3>(attributes.scale, buffers)?;
    let lengths = [
        translations.as_ref().map(Vec::len),
        rotations.as_ref().map(Vec::len),
        scales.as_ref().map(Vec::len),
    ];
    // Attributes of applications alone, such as `_ID`, do not move the mesh.
    let Some(count) = lengths.into_iter().flatten().next() else {
        return Some(vec![DAffine3::IDENTITY]);
    };
    if lengths.into_iter().flatten().any(|length| length != count) {
        return None;
    }
    let instance = |i: usize| {
        compose(
            translations.as_ref().map(|all| all[i]),
            rotations.as_ref().map(|all| all[i]),
            scales.as_ref().map(|all| all[i]),
        )
    };
    Some((0..count).map(instance).collect())
}

/// Reads an attribute: `Some(None)` if it is absent, `None` if it is damaged or far longer than its
/// bytes.
fn read<const N: usize>(
    attribute: Option<u32>,
    buffers: &Buffers,
) -> Option<Option<Vec<[f64; N]>>> {
    let Some(attribute) = attribute else {
        return Some(None);
    };
    let accessor = Index::new(attribute);
    buffers
        .has_bytes(accessor)
        .then(|| buffers.vectors(accessor))?
        .map(Some)
}
