//! Triangles of a primitive.

use super::super::builder::{Builder, MeshError};
use super::super::notes::Note;
use super::accessor::Buffers;
use super::attributes::{Attributes, cofactors};
use super::material::{GltfMaterial, Mapping};
use super::pose::Pose;
use crate::scene::Vertex;
use ::gltf::json::mesh::{Mode, Primitive, Semantic};
use ::gltf::json::validation::Checked;
use glam::{DAffine3, DVec3, Vec2};

/// Adds the triangles of a primitive for each transform to the world in `instances`.
pub(super) fn push_primitive(
    primitive: &Primitive,
    instances: &[DAffine3],
    pose: &Pose,
    surface: Option<GltfMaterial>,
    buffers: &Buffers,
    builder: &mut Builder,
) -> Result<(), MeshError> {
    let Checked::Valid(mode @ (Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan)) =
        primitive.mode
    else {
        builder.notes.add(Note::NonTriangles, 1);
        return Ok(());
    };
    let Some(surface) = surface else {
        return Ok(());
    };
    let sets = [surface.mapping, surface.emission_mapping].map(|mapping| mapping.texcoord_set);
    let Some(mut attributes) = Attributes::read(primitive, sets, buffers, &mut builder.notes)
    else {
        return Ok(());
    };
    pose.apply_morph_targets(primitive, &mut attributes, buffers, &mut builder.notes);
    let is_in_world = pose.apply_skin(primitive, &mut attributes, buffers, &mut builder.notes);
    let instances = if is_in_world {
        &[DAffine3::IDENTITY]
    } else {
        instances
    };
    let count = attributes.positions.len();
    let corners: Vec<usize> = match primitive.indices {
        None => {
            let positions = primitive
                .attributes
                .get(&Checked::Valid(Semantic::Positions));
            let compressed = positions.and_then(|&it| buffers.compressed_corners(it));
            compressed.unwrap_or_else(|| (0..count).collect())
        }
        Some(indices) => match buffers.vectors::<1>(indices) {
            Some(indices) => indices.into_iter().map(|[index]| index as usize).collect(),
            None => {
                builder.notes.add(Note::AccessorUnreadable, 1);
                return Ok(());
            }
        },
    };
    let all = triangles(mode, &corners);
    let valid: Vec<[usize; 3]> = all
        .iter()
        .copied()
        .filter(|t| t.iter().all(|&vertex| vertex < count))
        .collect();
    builder
        .notes
        .add(Note::FaceIndexOutOfRange, all.len() - valid.len());
    let Some(material) = surface.material else {
        builder
            .notes
            .add(Note::SeeThrough, valid.len() * instances.len());
        return Ok(());
    };
    let is_opaque = |&vertex: &usize| {
        let color = attributes.colors.get(vertex);
        color.is_none_or(|&[.., opacity]| opacity as f32 >= surface.least_opacity)
    };
    let (visible, invisible): (Vec<_>, Vec<_>) =
        valid.into_iter().partition(|t| t.iter().any(is_opaque));
    builder
        .notes
        .add(Note::SeeThrough, invisible.len() * instances.len());
    for &world_from_node in instances {
        let first = push_vertices(&attributes, world_from_node, surface, builder)?;
        let is_mirrored = world_from_node.matrix3.determinant() < 0.0;
        for &[a, b, c] in &visible {
            let [b, c] = if is_mirrored { [c, b] } else { [b, c] };
            // `push_vertices` has checked that they fit 32 bits.
            builder.push_triangle([a, b, c].map(|vertex| first + vertex as u32), material);
        }
    }
    Ok(())
}

/// Adds the vertices of a primitive. Returns the index of the first.
fn push_vertices(
    attributes: &Attributes,
    world_from_node: DAffine3,
    surface: GltfMaterial,
    builder: &mut Builder,
) -> Result<u32, MeshError> {
    let first = builder.next_vertex(attributes.positions.len())?;
    let normal_from_node = cofactors(world_from_node.matrix3);
    for (i, &position) in attributes.positions.iter().enumerate() {
        let normal = attributes
            .normals
            .get(i)
            .map_or(DVec3::ZERO, |&n| normal_from_node * DVec3::from(n));
        let texcoord = texcoord(attributes.texcoords.get(i), surface.mapping);
        let is_shared = surface.emission_mapping.texcoord_set == surface.mapping.texcoord_set;
        let emission_texcoord = if surface.emission_mapping == surface.mapping {
            texcoord
        } else {
            let of_set = if is_shared {
                &attributes.texcoords
            } else {
                &attributes.emission_texcoords
            };
            self::texcoord(of_set.get(i), surface.emission_mapping)
        };
        let [r, g, b, opacity] = attributes.colors.get(i).copied().unwrap_or([1.0; 4]);
        builder.push_vertex(Vertex {
            position: world_from_node.transform_point3(DVec3::from(position)),
            normal: normal.normalize_or_zero().as_vec3(),
            texcoord,
            emission_texcoord,
            color: DVec3::new(r, g, b).as_vec3(),
            opacity: if surface.least_opacity > 0.0 {
                opacity as f32
            } else {
                1.0
            },
        });
    }
    Ok(first)
}

/// Returns the texture coordinate of a vertex with v upward; (0, 0) if the file has none.
fn texcoord(in_file: Option<&[f64; 2]>, mapping: Mapping) -> Vec2 {
    in_file.map_or(Vec2::ZERO, |&[u, v]| {
        let in_image = mapping
            .image_from_vertex
            .transform_point2(Vec2::new(u as f32, v as f32));
        Vec2::new(in_image.x, 1.0 - in_image.y) // v of glTF is downward
    })
}

fn triangles(mode: Mode, corners: &[usize]) -> Vec<[usize; 3]> {
    let triples = corners.windows(3).map(|t| [t[0], t[1], t[2]]);
    match mode {
        Mode::TriangleStrip => {
            // Every other triangle of a strip has the opposite winding.
            triples
                .enumerate()
                .map(|(i, [a, b, c])| if i % 2 == 0 { [a, b, c] } else { [b, a, c] })
                .collect()
        }
        Mode::TriangleFan => triples.map(|[_, b, c]| [corners[0], b, c]).collect(),
        _ => corners
            .chunks_exact(3)
            .map(|t| [t[0], t[1], t[2]])
            .collect(),
    }
}
