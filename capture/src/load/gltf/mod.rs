//! glTF 2.0, as `.gltf` and as `.glb`.
//!
//! Node transforms are read and composed in `f64`; a mirroring one turns the winding of its triangles. Skins and morph targets
//! stay at rest. Metallic surfaces are shown as diffuse ones of their base colour; a surface that lets more than half of
//! the light through (blended alpha, transmission) is left out.

mod accessor;
pub(crate) mod cameras;
mod lights;
mod material;
mod transform;
mod uri;

use super::builder::{Builder, GroupedScene, Vertex};
use super::notes::{Note, Notes};
use super::orientation::Hints;
use super::{LoadError, LoadOptions, folder_of};
use crate::scene::FileFrame;
use ::gltf::json::mesh::{Mode, Primitive, Semantic};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Node, Root};
use accessor::Buffers;
use glam::{DAffine3, DMat3, DVec3, Vec2, Vec3};
use material::{GltfMaterial, GltfMaterials};
use std::path::Path;
pub use transform::HEADBOX_HALF_SIZE;
use transform::NodeTransforms;

/// Extensions that a file may require: read here, or of no consequence for a diffuse surface.
const KNOWN_EXTENSIONS: [&str; 4] =
    ["KHR_texture_transform", "KHR_mesh_quantization", "KHR_lights_punctual", "EXT_texture_webp"];

/// Extensions of materials change the looks at most.
const MATERIAL_EXTENSIONS: &str = "KHR_materials_";

pub(super) fn load(path: &Path, bytes: &[u8], options: &LoadOptions, groups: bool) -> Result<GroupedScene, LoadError> {
    // Chapter 3.4 of the specification: Y up, metres.
    let frame = FileFrame { up: options.up.unwrap_or_default(), unit_m: options.unit_m.unwrap_or(1.0) };
    let (root, transforms, blob) = parse(path, bytes)?;
    let mut notes = Notes::default();
    if let Some(length) = glb_length(bytes) {
        notes.add(Note::BytesBeyondEnd, bytes.len().saturating_sub(length));
    }
    for required in &root.extensions_required {
        if required.starts_with(MATERIAL_EXTENSIONS) {
            notes.add_named(Note::UnknownExtension, required);
        } else if !KNOWN_EXTENSIONS.contains(&required.as_str()) {
            let cause = format!("it requires the extension {required}, which is not supported");
            return Err(LoadError::Malformed { path: path.to_path_buf(), cause });
        }
    }
    let buffers = Buffers::read(&root, blob, folder_of(path), &mut notes);
    let surfaces = GltfMaterials::read(&root, &buffers, path, &mut notes);
    let mut builder = Builder::new(frame, notes);
    push_nodes(&root, &transforms, &buffers, &surfaces, &mut builder, groups).map_err(|TooManyVertices| {
        LoadError::Malformed { path: path.to_path_buf(), cause: "it has more than 2^32 vertices".into() }
    })?;
    if options.up.is_none() || options.unit_m.is_none() {
        builder.doubt(Hints::none(options));
    }
    builder.finish(path, surfaces.materials, surfaces.textures.textures)
}

/// The length that the header of a GLB tells, bytes; `None` if this is none.
fn glb_length(bytes: &[u8]) -> Option<usize> {
    let length = bytes.strip_prefix(b"glTF")?.get(4..8)?;
    Some(u32::from_le_bytes([length[0], length[1], length[2], length[3]]) as usize)
}

/// The JSON part, where its nodes stand, and the binary chunk of a GLB.
fn parse(path: &Path, bytes: &[u8]) -> Result<(Root, NodeTransforms, Option<Vec<u8>>), LoadError> {
    let malformed = |cause: String| LoadError::Malformed { path: path.to_path_buf(), cause };
    if !bytes.starts_with(b"glTF") {
        let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes).trim_ascii_start();
        if !text.starts_with(b"{") {
            return Err(malformed(
                "it is neither a GLB (it does not begin with \"glTF\") nor a glTF (it is no JSON)".into(),
            ));
        }
        let at_line = |cause: ::gltf::json::Error| LoadError::Line {
            path: path.to_path_buf(),
            line: cause.line(),
            cause: without_place(&cause.to_string()),
        };
        let root = ::gltf::json::deserialize::from_slice(bytes).map_err(at_line)?;
        return Ok((root, NodeTransforms::read(bytes).map_err(at_line)?, None));
    }
    // The `gltf` crate subtracts the length of the header from the length in it, unchecked.
    let length = glb_length(bytes).unwrap_or(0);
    if length < 20 || length > bytes.len() {
        let actual = bytes.len();
        return Err(malformed(format!("the GLB header says {length} bytes and the file has {actual}")));
    }
    let glb = ::gltf::binary::Glb::from_slice(bytes).map_err(|cause| malformed(cause.to_string()))?;
    let root = ::gltf::json::deserialize::from_slice(&glb.json);
    let no_json = |cause| malformed(format!("its JSON chunk does not parse: {cause}"));
    let (root, transforms) = (root.map_err(no_json)?, NodeTransforms::read(&glb.json).map_err(no_json)?);
    Ok((root, transforms, glb.bin.map(Into::into)))
}

/// A parser's words without the line that is named anyway.
fn without_place(cause: &str) -> String {
    cause.rsplit_once(" at line ").map_or(cause, |(words, _)| words).to_owned()
}

struct TooManyVertices;

/// Walks the nodes of the default scene (without scenes: of every tree of nodes) and adds their meshes.
fn push_nodes(
    root: &Root,
    transforms: &NodeTransforms,
    buffers: &Buffers,
    surfaces: &GltfMaterials,
    builder: &mut Builder,
    groups: bool,
) -> Result<(), TooManyVertices> {
    let children = |node: &Node| node.children.iter().flatten().map(|child| child.value()).collect::<Vec<_>>();
    let scene = root.scene.map_or(0, |scene| scene.value());
    let mut roots = match root.scenes.get(scene).or(root.scenes.first()) {
        Some(scene) => scene.nodes.iter().map(|node| node.value()).collect(),
        None => {
            let mut is_child = vec![false; root.nodes.len()];
            let all = root.nodes.iter().flat_map(children);
            all.filter(|&child| child < root.nodes.len()).for_each(|child| is_child[child] = true);
            (0..root.nodes.len()).filter(|&node| !is_child[node]).collect::<Vec<_>>()
        }
    };
    // A stack, so that a long chain of nodes does not overflow the program's own; each node once, so that a cycle ends.
    roots.reverse();
    let mut open: Vec<(usize, DAffine3)> = roots.into_iter().map(|node| (node, DAffine3::IDENTITY)).collect();
    let mut visited = vec![false; root.nodes.len()];
    while let Some((index, world_from_parent)) = open.pop() {
        let Some(node) = root.nodes.get(index) else {
            builder.notes.add(Note::AccessorUnreadable, 1);
            continue;
        };
        if std::mem::replace(&mut visited[index], true) {
            builder.notes.add(Note::NodeCycle, 1);
            continue;
        }
        let world_from_node = world_from_parent * transforms.parent_from_node(index);
        open.extend(children(node).into_iter().rev().map(|child| (child, world_from_node)));
        lights::push(root, node, world_from_node, builder);
        if let Some(half_size) = transforms.headbox_half_size(index) {
            builder.place_headbox(world_from_node.translation, half_size);
        }
        if let Some(mesh) = node.mesh {
            builder.notes.add(Note::SkinAtRest, usize::from(node.skin.is_some()));
            if groups {
                let mesh_name = || root.meshes.get(mesh.value()).and_then(|mesh| mesh.name.as_deref());
                builder.begin_group(node.name.as_deref().or_else(mesh_name).unwrap_or_default());
            }
            let primitives = root.meshes.get(mesh.value()).map(|mesh| mesh.primitives.as_slice());
            builder.notes.add(Note::AccessorUnreadable, usize::from(primitives.is_none()));
            for primitive in primitives.unwrap_or_default() {
                let surface = surfaces.of(primitive.material.map(|material| material.value()));
                push_primitive(primitive, world_from_node, surface, buffers, builder)?;
            }
        }
    }
    Ok(())
}

/// The vertex attributes of a primitive; those that are damaged are left out and counted.
struct Attributes {
    positions: Vec<[f64; 3]>,
    normals: Vec<[f64; 3]>,
    texcoords: Vec<[f64; 2]>,
    colors: Vec<[f64; 3]>,
}

impl Attributes {
    fn read(primitive: &Primitive, texcoord_set: u32, buffers: &Buffers, notes: &mut Notes) -> Option<Self> {
        let accessor = |semantic| primitive.attributes.get(&Checked::Valid(semantic)).copied();
        let positions = accessor(Semantic::Positions).and_then(|positions| buffers.vectors(positions));
        let Some(positions) = positions else {
            notes.add(Note::AccessorUnreadable, 1);
            return None;
        };
        let count = positions.len();
        Some(Self {
            normals: optional(accessor(Semantic::Normals).map(|a| buffers.vectors(a)), count, notes),
            texcoords: optional(accessor(Semantic::TexCoords(texcoord_set)).map(|a| buffers.vectors(a)), count, notes),
            colors: optional(accessor(Semantic::Colors(0)).map(|a| buffers.vectors(a)), count, notes),
            positions,
        })
    }
}

/// An attribute that may be absent (`None`), or damaged (`Some(None)`, or of another length).
fn optional<T>(read: Option<Option<Vec<T>>>, count: usize, notes: &mut Notes) -> Vec<T> {
    let is_given = read.is_some();
    let values = read.flatten().filter(|values| values.len() == count);
    notes.add(Note::AccessorUnreadable, usize::from(is_given && values.is_none()));
    values.unwrap_or_default()
}

fn push_primitive(
    primitive: &Primitive,
    world_from_node: DAffine3,
    surface: Option<GltfMaterial>,
    buffers: &Buffers,
    builder: &mut Builder,
) -> Result<(), TooManyVertices> {
    let Checked::Valid(mode @ (Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan)) = primitive.mode else {
        builder.notes.add(Note::NonTriangles, 1);
        return Ok(());
    };
    let Some(surface) = surface else { return Ok(()) };
    let Some(attributes) = Attributes::read(primitive, surface.texcoord_set, buffers, &mut builder.notes) else {
        return Ok(());
    };
    let count = attributes.positions.len();
    let corners: Vec<usize> = match primitive.indices {
        None => (0..count).collect(),
        Some(indices) => match buffers.vectors::<1>(indices) {
            Some(indices) => indices.into_iter().map(|[index]| index as usize).collect(),
            None => {
                builder.notes.add(Note::AccessorUnreadable, 1);
                return Ok(());
            }
        },
    };
    let all = triangles(mode, &corners);
    let valid: Vec<[usize; 3]> = all.iter().copied().filter(|t| t.iter().all(|&vertex| vertex < count)).collect();
    builder.notes.add(Note::FaceIndexOutOfRange, all.len() - valid.len());
    let Some(material) = surface.material else {
        builder.notes.add(Note::SeeThrough, valid.len());
        return Ok(());
    };

    let first = push_vertices(&attributes, world_from_node, surface, builder).ok_or(TooManyVertices)?;
    let is_mirrored = world_from_node.matrix3.determinant() < 0.0;
    for [a, b, c] in valid {
        let [b, c] = if is_mirrored { [c, b] } else { [b, c] };
        // Below 2^32, as `push_vertices` has checked.
        builder.push_triangle([a, b, c].map(|vertex| first + vertex as u32), material);
    }
    Ok(())
}

/// Adds all vertices of a primitive; the index of the first, or `None` if there are too many.
fn push_vertices(
    attributes: &Attributes,
    world_from_node: DAffine3,
    surface: GltfMaterial,
    builder: &mut Builder,
) -> Option<u32> {
    let first = builder.next_vertex(attributes.positions.len())?;
    let normal_from_node = cofactors(world_from_node.matrix3);
    for (i, &position) in attributes.positions.iter().enumerate() {
        let normal = attributes.normals.get(i).map_or(DVec3::ZERO, |&n| normal_from_node * DVec3::from(n));
        let texcoord = attributes.texcoords.get(i).map_or(Vec2::ZERO, |&[u, v]| {
            let in_image = surface.image_from_vertex.transform_point2(Vec2::new(u as f32, v as f32));
            Vec2::new(in_image.x, 1.0 - in_image.y) // v of glTF goes down
        });
        builder.push_vertex(Vertex {
            position: world_from_node.transform_point3(DVec3::from(position)),
            normal: normal.normalize_or_zero().as_vec3(),
            texcoord,
            color: attributes.colors.get(i).map_or(Vec3::ONE, |&c| DVec3::from(c).as_vec3()),
        });
    }
    Some(first)
}

/// The matrix that takes normals along when `m` takes points along: the inverse transpose but for its length, also
/// where `m` has no inverse. A mirroring `m` keeps outward normals outward.
fn cofactors(m: DMat3) -> DMat3 {
    let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis];
    let sign = if m.determinant() < 0.0 { -1.0 } else { 1.0 };
    DMat3::from_cols(y.cross(z) * sign, z.cross(x) * sign, x.cross(y) * sign)
}

fn triangles(mode: Mode, corners: &[usize]) -> Vec<[usize; 3]> {
    let triples = corners.windows(3).map(|t| [t[0], t[1], t[2]]);
    match mode {
        Mode::TriangleStrip => {
            // Every other triangle of a strip runs the other way around.
            triples.enumerate().map(|(i, [a, b, c])| if i % 2 == 0 { [a, b, c] } else { [b, a, c] }).collect()
        }
        Mode::TriangleFan => triples.map(|[_, b, c]| [corners[0], b, c]).collect(),
        _ => corners.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
    }
}
