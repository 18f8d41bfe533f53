//! Where nodes stand. The `gltf` crate reads their numbers as `f32`, in which a coordinate of 1e7 m has steps of a metre;
//! the file's text has all the digits, so it is read once more.

use glam::{DAffine3, DMat4, DQuat, DVec3};
use serde::Deserialize;

/// The transforms of all nodes.
#[derive(Default, Deserialize)]
pub(super) struct NodeTransforms {
    #[serde(default)]
    nodes: Vec<NodeTransform>,
}

#[derive(Default, Deserialize)]
struct NodeTransform {
    matrix: Option<[f64; 16]>,
    translation: Option<[f64; 3]>,
    rotation: Option<[f64; 4]>,
    scale: Option<[f64; 3]>,
}

impl NodeTransforms {
    /// Those of a glTF file's JSON.
    pub(super) fn read(json: &[u8]) -> Result<Self, serde_json::Error> {
        serde_json::from_slice(json)
    }

    /// The transform of a node; none if the file gives none.
    pub(super) fn parent_from_node(&self, index: usize) -> DAffine3 {
        let Some(node) = self.nodes.get(index) else { return DAffine3::IDENTITY };
        if let Some(columns) = node.matrix {
            return DAffine3::from_mat4(DMat4::from_cols_array(&columns));
        }
        let rotation = DQuat::from_array(node.rotation.unwrap_or([0.0; 4]));
        DAffine3::from_scale_rotation_translation(
            DVec3::from_array(node.scale.unwrap_or([1.0; 3])),
            if rotation.length_squared() > 0.0 { rotation.normalize() } else { DQuat::IDENTITY },
            DVec3::from_array(node.translation.unwrap_or_default()),
        )
    }
}
