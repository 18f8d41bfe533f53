//! glTF 2.0, as `.gltf` and as `.glb`.
//!
//! Node transforms are read and composed in `f64`; a mirroring one turns the winding of its triangles. What is animated stands
//! still: skins where the file's nodes put their joints, morph targets at the weights it gives. Metallic surfaces are shown as diffuse ones of their base colour; a surface that lets more than half of
//! the light through (blended alpha, transmission) is left out.

mod accessor;
mod attributes;
pub(crate) mod cameras;
mod instances;
mod lights;
mod material;
mod pose;
mod primitive;
mod second_reading;
mod uri;

use super::builder::{Builder, GroupedScene};
use super::notes::{Note, Notes};
use super::orientation::FrameHints;
use super::{LoadError, LoadOptions, folder_of};
use ::gltf::json::{Node, Root};
use accessor::Buffers;
use glam::DAffine3;
use headbox_core::file_frame::FileFrame;
use material::GltfMaterials;
use pose::Pose;
use primitive::push_primitive;
pub use second_reading::HEADBOX_HALF_SIZE;
use second_reading::SecondReading;
use std::path::Path;

/// Extensions that a file may require: read here, or of no consequence for a diffuse surface.
const KNOWN_EXTENSIONS: [&str; 5] = [
    "KHR_texture_transform",
    "KHR_mesh_quantization",
    "KHR_lights_punctual",
    "EXT_texture_webp",
    "EXT_mesh_gpu_instancing",
];

/// What is said of a file that requires an extension that is not read, and what to do.
fn unsupported(extension: &str) -> String {
    let is = |words: &[&str]| words.iter().any(|word| extension.contains(word));
    let (what, otherwise) = match extension {
        _ if is(&["draco"]) => (
            "its meshes are compressed",
            "without Draco compression, which `gltf-transform copy` takes out",
        ),
        _ if is(&["meshopt"]) => (
            "its meshes are compressed",
            "without meshopt compression, which `gltf-transform copy` takes out",
        ),
        _ if is(&["texture_basisu"]) => (
            "its textures are compressed for a GPU",
            "with PNG, JPEG or WebP textures",
        ),
        _ if is(&["texture"]) => (
            "its textures have another format",
            "with PNG, JPEG or WebP textures",
        ),
        _ => ("it cannot be read without", "without it"),
    };
    let verb = if what.ends_with("without") { "" } else { " by" };
    format!(
        "{what}{verb} the glTF extension {extension}, which is not supported; export it {otherwise}"
    )
}

/// Extensions of materials change the looks at most.
const MATERIAL_EXTENSIONS: &str = "KHR_materials_";

pub(super) fn load(
    path: &Path,
    bytes: &[u8],
    options: &LoadOptions,
    groups: bool,
) -> Result<GroupedScene, LoadError> {
    // Chapter 3.4 of the specification: Y up, metres.
    let frame = FileFrame {
        up: options.up.unwrap_or_default(),
        unit_m: options.unit_m.unwrap_or(1.0),
    };
    let (root, reread, blob) = parse(path, bytes)?;
    let mut notes = Notes::default();
    if let Some(length) = glb_length(bytes) {
        notes.add(Note::BytesBeyondEnd, bytes.len().saturating_sub(length));
    }
    for required in &root.extensions_required {
        if required.starts_with(MATERIAL_EXTENSIONS) {
            notes.add_named(Note::UnknownExtension, required);
        } else if !KNOWN_EXTENSIONS.contains(&required.as_str()) {
            let cause = unsupported(required);
            return Err(LoadError::Malformed {
                path: path.to_path_buf(),
                cause,
            });
        }
    }
    let buffers = Buffers::read(&root, blob, folder_of(path), &mut notes);
    let surfaces = GltfMaterials::read(&root, &reread, &buffers, path, &mut notes);
    let mut builder = Builder::new(frame, notes);
    push_nodes(&root, &reread, &buffers, &surfaces, &mut builder, groups).map_err(
        |TooManyVertices| LoadError::Malformed {
            path: path.to_path_buf(),
            cause: "it has more than 2^32 vertices".into(),
        },
    )?;
    if options.up.is_none() || options.unit_m.is_none() {
        builder.report_doubts(&FrameHints {
            options: *options,
            ..FrameHints::default()
        });
    }
    builder.finish(path, surfaces.materials, surfaces.textures.textures)
}

/// The length that the header of a GLB tells, bytes; `None` if this is none.
fn glb_length(bytes: &[u8]) -> Option<usize> {
    let length = bytes.strip_prefix(b"glTF")?.get(4..8)?;
    Some(u32::from_le_bytes([length[0], length[1], length[2], length[3]]) as usize)
}

/// The JSON part, where its nodes stand, and the binary chunk of a GLB.
fn parse(path: &Path, bytes: &[u8]) -> Result<(Root, SecondReading, Option<Vec<u8>>), LoadError> {
    let malformed = |cause: String| LoadError::Malformed {
        path: path.to_path_buf(),
        cause,
    };
    if !bytes.starts_with(b"glTF") {
        let text = bytes
            .strip_prefix(b"\xef\xbb\xbf")
            .unwrap_or(bytes)
            .trim_ascii_start();
        if !text.starts_with(b"{") {
            return Err(malformed(
                "it is neither a GLB (it does not begin with \"glTF\") nor a glTF (it is no JSON)"
                    .into(),
            ));
        }
        let no_json = |cause: ::gltf::json::Error| malformed(cause.to_string());
        let root = ::gltf::json::deserialize::from_slice(bytes).map_err(no_json)?;
        return Ok((root, SecondReading::read(bytes).map_err(no_json)?, None));
    }
    // The `gltf` crate subtracts the length of the header from the length in it, unchecked.
    let length = glb_length(bytes).unwrap_or(0);
    if length < 20 || length > bytes.len() {
        let actual = bytes.len();
        return Err(malformed(format!(
            "the GLB header says {length} bytes and the file has {actual}"
        )));
    }
    let glb =
        ::gltf::binary::Glb::from_slice(bytes).map_err(|cause| malformed(cause.to_string()))?;
    let root = ::gltf::json::deserialize::from_slice(&glb.json);
    let no_json = |cause| malformed(format!("its JSON chunk does not parse: {cause}"));
    let (root, reread) = (
        root.map_err(no_json)?,
        SecondReading::read(&glb.json).map_err(no_json)?,
    );
    Ok((root, reread, glb.bin.map(Into::into)))
}

struct TooManyVertices;

/// The nodes of the default scene (without scenes: of every tree of nodes) in the order of their trees, and where they stand.
fn placed_nodes(root: &Root, reread: &SecondReading, notes: &mut Notes) -> Vec<(usize, DAffine3)> {
    let children = |node: &Node| {
        node.children
            .iter()
            .flatten()
            .map(|child| child.value())
            .collect::<Vec<_>>()
    };
    let scene = root.scene.map_or(0, |scene| scene.value());
    let mut roots = match root.scenes.get(scene).or(root.scenes.first()) {
        Some(scene) => scene.nodes.iter().map(|node| node.value()).collect(),
        None => {
            let mut is_child = vec![false; root.nodes.len()];
            let all = root.nodes.iter().flat_map(children);
            all.filter(|&child| child < root.nodes.len())
                .for_each(|child| is_child[child] = true);
            (0..root.nodes.len())
                .filter(|&node| !is_child[node])
                .collect::<Vec<_>>()
        }
    };
    // A stack, so that a long chain of nodes does not overflow the program's own; each node once, so that a cycle ends.
    roots.reverse();
    let mut open: Vec<(usize, DAffine3)> = roots
        .into_iter()
        .map(|node| (node, DAffine3::IDENTITY))
        .collect();
    let mut visited = vec![false; root.nodes.len()];
    let mut placed = Vec::new();
    while let Some((index, world_from_parent)) = open.pop() {
        let Some(node) = root.nodes.get(index) else {
            notes.add(Note::AccessorUnreadable, 1);
            continue;
        };
        if std::mem::replace(&mut visited[index], true) {
            notes.add(Note::NodeCycle, 1);
            continue;
        }
        let world_from_node = world_from_parent * reread.parent_from_node(index);
        open.extend(
            children(node)
                .into_iter()
                .rev()
                .map(|child| (child, world_from_node)),
        );
        placed.push((index, world_from_node));
    }
    placed
}

/// Adds what stands at the nodes of the scene: lights, the headbox, meshes.
fn push_nodes(
    root: &Root,
    reread: &SecondReading,
    buffers: &Buffers,
    surfaces: &GltfMaterials,
    builder: &mut Builder,
    groups: bool,
) -> Result<(), TooManyVertices> {
    let placed = placed_nodes(root, reread, &mut builder.notes);
    let mut world_from_nodes = vec![None; root.nodes.len()];
    placed
        .iter()
        .for_each(|&(index, world_from_node)| world_from_nodes[index] = Some(world_from_node));
    for &(index, world_from_node) in &placed {
        let node = &root.nodes[index];
        lights::push(root, node, world_from_node, builder);
        if let Some(half_size) = reread.headbox_half_size(index) {
            builder.place_headbox(world_from_node.translation, half_size);
        }
        let Some(mesh_index) = node.mesh else {
            continue;
        };
        let mesh = root.meshes.get(mesh_index.value());
        builder
            .notes
            .add(Note::AccessorUnreadable, usize::from(mesh.is_none()));
        let Some(mesh) = mesh else { continue };
        if groups {
            builder.begin_group(
                node.name
                    .as_deref()
                    .or(mesh.name.as_deref())
                    .unwrap_or_default(),
            );
        }
        let places = instances::places(
            reread.instances(index),
            world_from_node,
            buffers,
            &mut builder.notes,
        );
        let pose = Pose::of(
            root,
            node,
            mesh,
            &world_from_nodes,
            buffers,
            &mut builder.notes,
        );
        for primitive in &mesh.primitives {
            let surface = surfaces.of(primitive.material.map(|material| material.value()));
            push_primitive(primitive, &places, &pose, surface, buffers, builder)?;
        }
    }
    Ok(())
}
