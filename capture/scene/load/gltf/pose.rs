//! How a mesh is bent: morph targets at the weights that the file gives, then a skin whose joints are where its nodes are.

use super::super::notes::{Note, Notes};
use super::accessor::Buffers;
use super::attributes::{Attributes, cofactors};
use ::gltf::json::mesh::{Mesh, Primitive, Semantic};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Index, Node, Root};
use glam::{DAffine3, DMat3, DMat4, DVec3};

/// How the mesh of a node is bent.
pub(super) struct Pose {
    /// The weight of each morph target.
    weights: Vec<f32>,
    /// For each joint of the skin, if there is one, what takes a point of the unbent mesh to the world.
    joints: Option<Vec<DAffine3>>,
}

impl Pose {
    /// That of a node with a mesh, among the nodes of the file, of which those that are not in the scene stand nowhere.
    pub(super) fn of(
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

    /// Moves positions and normals as the morph targets say.
    pub(super) fn morph(
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

    /// Takes positions and normals to the world where the mesh has a skin; whether it has one that could be read.
    pub(super) fn bend(
        &self,
        primitive: &Primitive,
        attributes: &mut Attributes,
        buffers: &Buffers,
        notes: &mut Notes,
    ) -> bool {
        let Some(joints) = &self.joints else {
            return false;
        };
        let bent = world_from_vertices(primitive, attributes.positions.len(), joints, buffers);
        let Some(world_from_vertices) = bent else {
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

/// For each joint of a skin, what takes a point of the unbent mesh to the world; `None` if it is damaged.
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
    let of_joint = |(i, joint): (usize, &Index<Node>)| {
        Some(world_from_joint(joint.value())? * *inverse_bind.get(i)?)
    };
    skin.joints.iter().enumerate().map(of_joint).collect()
}

/// For each vertex of a primitive the mean of its joints by their weights.
fn world_from_vertices(
    primitive: &Primitive,
    count: usize,
    joints: &[DAffine3],
    buffers: &Buffers,
) -> Option<Vec<DAffine3>> {
    let accessor = |semantic| primitive.attributes.get(&Checked::Valid(semantic)).copied();
    let mut sums = vec![(DAffine3::ZERO, 0.0); count];
    // Four joints a set; the specification asks for at least one set.
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
    // Weights are rounded, and some files' do not add up to 1. Vertices that no joint moves are written as weights of zero by some; they go with
    // the first joint, as in other viewers.
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
