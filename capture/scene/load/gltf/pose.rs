//! Deformation of a mesh: morph targets with the file's weights, then a skin with the pose of its
//! nodes.

use super::super::notes::{Note, Notes};
use super::accessor::Buffers;
use super::attributes::{Attributes, cofactors};
use ::gltf::json::mesh::{Mesh, Primitive, Semantic};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Index, Node, Root};
use glam::{DAffine3, DMat3, DMat4, DVec3};

/// Deformation of the mesh of a node.
pub(super) struct Pose {
    /// Weight of each morph target.
    weights: Vec<f32>,
    /// Transform from the rest pose to the world for each joint of the skin, if there is one.
    joints: Option<Vec<DAffine3>>,
}

impl Pose {
    /// Reads the pose of a node with a mesh. Nodes that are not in the scene have no world
    /// transform.
    pub(super) fn read(
        root: &Root,
        node: &Node,
        mesh: &Mesh,
        world_from_nodes: &[Option<DAffine3>],
        buffers: &Buffers,
        notes: &mut Notes,
    ) -> Self {
        let weights = node
            .weights
            .as_ref()
            .or(mesh.weights.as_ref())
            .cloned()
            .unwrap_or_default();
        let joints = node
            .skin
            .and_then(|skin| joints(root, skin, world_from_nodes, buffers));
        notes.add(
            Note::SkinUnreadable,
            usize::from(node.skin.is_some() && joints.is_none()),
        );
        Self { weights, joints }
    }

    /// Returns true if a morph target has a weight.
    pub(super) fn has_target(&self, index: usize) -> bool {
        self.weights.get(index).is_some_and(|&weight| weight != 0.0)
    }

    /// Adds the weighted morph targets to positions and normals.
    pub(super) fn apply_morph_targets(
        &self,
        primitive: &Primitive,
        attributes: &mut Attributes,
        buffers: &Buffers,
        notes: &mut Notes,
    ) {
        let targets = primitive.targets.iter().flatten().zip(&self.weights);
        for (target, &weight) in targets.filter(|(_, weight)| **weight != 0.0) {
            for (moved, by) in [
                (&mut attributes.positions, target.positions),
                (&mut attributes.normals, target.normals),
            ] {
                let Some(by) = by.filter(|_| !moved.is_empty()) else {
                    continue;
                };
                match buffers
                    .vectors::<3>(by)
                    .filter(|by| by.len() == moved.len())
                {
                    Some(by) => add_scaled(moved, &by, f64::from(weight)),
                    None => notes.add(Note::AccessorUnreadable, 1),
                }
            }
        }
    }

    /// Transforms positions and normals to the world by the skin. Returns false without a readable
    /// skin.
    pub(super) fn apply_skin(
        &self,
        primitive: &Primitive,
        attributes: &mut Attributes,
        buffers: &Buffers,
        notes: &mut Notes,
    ) -> bool {
        let Some(joints) = &self.joints else {
            return false;
        };
        let skinned = world_from_vertices(primitive, attributes.positions.len(), joints, buffers);
        let Some(world_from_vertices) = skinned else {
            notes.add(Note::SkinUnreadable, 1);
            return false;
        };
        for (position, world_from_vertex) in
            attributes.positions.iter_mut().zip(&world_from_vertices)
        {
            *position = world_from_vertex
                .transform_point3(DVec3::from(*position))
                .to_array();
        }
        for (normal, world_from_vertex) in attributes.normals.iter_mut().zip(&world_from_vertices) {
            *normal = (cofactors(world_from_vertex.matrix3) * DVec3::from(*normal)).to_array();
        }
        true
    }
}

fn add_scaled(moved: &mut [[f64; 3]], by: &[[f64; 3]], weight: f64) {
    for (value, by) in moved.iter_mut().zip(by) {
        *value = (DVec3::from(*value) + DVec3::from(*by) * weight).to_array();
    }
}

/// Returns the transform from the rest pose to the world for each joint; `None` if the skin is
/// damaged.
fn joints(
    root: &Root,
    skin: Index<::gltf::json::Skin>,
    world_from_nodes: &[Option<DAffine3>],
    buffers: &Buffers,
) -> Option<Vec<DAffine3>> {
    let skin = root.skins.get(skin.value())?;
    let inverse_bind = match skin.inverse_bind_matrices {
        None => vec![DAffine3::IDENTITY; skin.joints.len()],
        Some(matrices) => {
            let matrices = buffers.vectors::<16>(matrices)?;
            matrices
                .iter()
                .map(|m| DAffine3::from_mat4(DMat4::from_cols_array(m)))
                .collect()
        }
    };
    let world_from_joint = |joint: usize| world_from_nodes.get(joint).copied().flatten();
    let world_from_rest = |(i, joint): (usize, &Index<Node>)| {
        Some(world_from_joint(joint.value())? * *inverse_bind.get(i)?)
    };
    skin.joints
        .iter()
        .enumerate()
        .map(world_from_rest)
        .collect()
}

/// Returns the weighted mean of the joints of each vertex of a primitive.
fn world_from_vertices(
    primitive: &Primitive,
    count: usize,
    joints: &[DAffine3],
    buffers: &Buffers,
) -> Option<Vec<DAffine3>> {
    let accessor = |semantic| primitive.attributes.get(&Checked::Valid(semantic)).copied();
    let mut sums = vec![(DAffine3::ZERO, 0.0); count];
    // A set has four joints; the specification requires at least one set.
    let sets = (0..).map_while(|set| {
        Some([
            accessor(Semantic::Joints(set))?,
            accessor(Semantic::Weights(set))?,
        ])
    });
    for [indices, weights] in sets {
        let (indices, weights) = (
            buffers.vectors::<4>(indices)?,
            buffers.vectors::<4>(weights)?,
        );
        if indices.len() != count || weights.len() != count {
            return None;
        }
        for ((sum, indices), weights) in sums.iter_mut().zip(indices).zip(weights) {
            for (index, weight) in indices
                .into_iter()
                .zip(weights)
                .filter(|(_, weight)| *weight != 0.0)
            {
                let joint = joints.get(index as usize)?;
                sum.0 = DAffine3 {
                    matrix3: sum.0.matrix3 + joint.matrix3 * weight,
                    translation: sum.0.translation + joint.translation * weight,
                };
                sum.1 += weight;
            }
        }
    }
    // The sum of the weights is not exactly 1. Vertices whose weights are all zero, which some
    // programs write, follow the first joint, as in other viewers.
    let first = *joints.first()?;
    let mean = |(sum, weight): (DAffine3, f64)| {
        if weight == 0.0 {
            return Some(first);
        }
        let scale = 1.0 / weight;
        (weight > 0.0).then(|| DAffine3 {
            matrix3: DMat3::from_cols(
                sum.matrix3.x_axis * scale,
                sum.matrix3.y_axis * scale,
                sum.matrix3.z_axis * scale,
            ),
            translation: sum.translation * scale,
        })
    };
    sums.into_iter().map(mean).collect()
}
