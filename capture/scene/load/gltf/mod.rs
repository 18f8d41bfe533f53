//! glTF 2.0, as `.gltf` and as `.glb`.
//!
//! Node transforms are composed in `f64`; mirrored triangles change their winding. Animations are
//! not played: skins have the pose of the file's nodes, morph targets the file's weights. Metals
//! become diffuse surfaces of their base colour. Surfaces that transmit more than half of the light
//! (blended alpha, transmission) are left out.

mod accessor;
mod attributes;
pub(crate) mod cameras;
mod draco;
mod instances;
mod lights;
mod material;
mod meshopt;
mod pose;
mod primitive;
mod raw_json;
mod uri;

use super::builder::{Builder, GroupedScene, MeshError};
use super::notes::{Note, Notes};
use super::orientation::FrameHints;
use super::{LoadError, LoadOptions, SPLATS_REFUSED, folder_of};
use ::gltf::json::{Node, Root};
use accessor::Buffers;
use glam::DAffine3;
use headbox_core::file_frame::FileFrame;
use headbox_core::files::InputFolder;
use instances::instance_transforms;
use material::GltfMaterials;
use pose::Pose;
use primitive::push_primitive;
pub use raw_json::HEADBOX_HALF_SIZE;
use raw_json::RawJson;
use serde::Deserialize;
use std::path::Path;

/// Extensions that a file may require because they are read.
const READ_EXTENSIONS: [&str; 14] = [
    "KHR_texture_transform",
    "KHR_mesh_quantization",
    "KHR_lights_punctual",
    "KHR_node_visibility",
    "KHR_materials_emissive_strength",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "EXT_texture_webp",
    "EXT_mesh_gpu_instancing",
    "KHR_draco_mesh_compression",
    "EXT_meshopt_compression",
    "KHR_meshopt_compression",
    "KHR_texture_basisu",
];

/// Extensions that a file may require although they are not read: metadata, behaviour, physics,
/// sound, animation, and alternatives to what the file shows by default. They do not change the
/// picture.
const HARMLESS_EXTENSIONS: [&str; 27] = [
    "KHR_materials_variants",
    "KHR_xmp",
    "KHR_xmp_json_ld",
    "KHR_animation_pointer",
    "KHR_audio_emitter",
    "KHR_collision_shapes",
    "KHR_implicit_shapes",
    "KHR_interactivity",
    "KHR_node_hoverability",
    "KHR_node_selectability",
    "KHR_physics_rigid_bodies",
    "EXT_feature_metadata",
    "EXT_instance_features",
    "EXT_mesh_features",
    "EXT_structural_metadata",
    "AGI_articulations",
    "AGI_stk_metadata",
    "CESIUM_primitive_outline",
    "GODOT_single_root",
    "MPEG_scene_dynamic",
    "MSFT_audio_emitter",
    "MSFT_lod",
    "OMI_physics_body",
    "OMI_physics_shape",
    "VRM",
    "VRMC_springBone",
    "VRMC_vrm",
];

/// Returns the message about a required extension that is not supported, with a remedy.
fn unsupported_message(extension: &str) -> String {
    let (what, otherwise) = if extension.contains("texture") {
        (
            "its textures have another format by",
            "with PNG, JPEG, WebP or KTX2 textures",
        )
    } else {
        ("it cannot be read without", "without it")
    };
    format!("{what} the glTF extension {extension}, which is not supported; export it {otherwise}")
}

/// Note about morph targets that are left out in part.
const MORPHED_COLORS: &str = "changes of colours and texture coordinates by morph targets left out; those of positions are \
     used";

/// Prefix of extensions of Gaussian splats, which are left out with a note.
const SPLAT_EXTENSIONS: &str = "KHR_gaussian_splatting";

/// Prefix of extensions that change the appearance only.
const MATERIAL_EXTENSIONS: &str = "KHR_materials_";

pub(super) fn load(
    path: &Path,
    bytes: &[u8],
    options: &LoadOptions,
    groups: bool,
) -> Result<GroupedScene, LoadError> {
    // Section 3.4 of the specification: Y up, metres.
    let frame = FileFrame {
        up: options.up.unwrap_or_default(),
        unit_m: options.unit_m.unwrap_or(1.0),
    };
    let (root, raw, blob) = parse(path, bytes)?;
    if raw.has_splats_alone() {
        return Err(LoadError::malformed(path, SPLATS_REFUSED));
    }
    let mut notes = Notes::default();
    if let Some(length) = glb_length(bytes) {
        notes.add(Note::BytesBeyondEnd, bytes.len().saturating_sub(length));
    }
    for required in &root.extensions_required {
        let is_in = |names: &[&str]| names.contains(&required.as_str());
        let is_of_splats = required.starts_with(SPLAT_EXTENSIONS);
        if is_in(&READ_EXTENSIONS) || is_in(&HARMLESS_EXTENSIONS) || is_of_splats {
            continue;
        }
        if required.starts_with(MATERIAL_EXTENSIONS) {
            notes.add_named(Note::UnknownExtension, required);
        } else {
            return Err(LoadError::malformed(path, unsupported_message(required)));
        }
    }
    let unread_lights = root.extensions_used.iter().filter(|it| is_unread_light(it));
    for light in unread_lights {
        notes.add_named(
            Note::UnknownExtension,
            format!("{light} (its light is left out)"),
        );
    }
    let folder = InputFolder::new(folder_of(path));
    let buffers = Buffers::read(&root, &raw, blob, &folder, &mut notes);
    let surfaces = GltfMaterials::read(&root, &raw, &buffers, &folder, &mut notes);
    let mut builder = Builder::new(frame, notes);
    push_nodes(&root, &raw, &buffers, &surfaces, &mut builder, groups)
        .map_err(|error| error.in_file(path))?;
    if let Some(cause) = buffers.over_budget() {
        builder.notes.add_over_budget("a mesh", cause);
    }
    if options.up.is_none() || options.unit_m.is_none() {
        builder.report_doubts(&FrameHints {
            options: *options,
            ..FrameHints::default()
        });
    }
    builder.finish(path, surfaces.materials, surfaces.textures.textures)
}

/// Returns true if an extension adds light that is not read.
fn is_unread_light(extension: &str) -> bool {
    let adds_light = ["_lights_", "_light_", "_environment_map"];
    extension != "KHR_lights_punctual" && adds_light.iter().any(|it| extension.contains(it))
}

/// Returns the length in the header of a GLB, bytes; `None` if it is not a GLB.
fn glb_length(bytes: &[u8]) -> Option<usize> {
    let length = bytes.strip_prefix(b"glTF")?.get(4..8)?;
    Some(u32::from_le_bytes([length[0], length[1], length[2], length[3]]) as usize)
}

/// Parses the JSON twice (see [`raw_json`]); also returns the binary chunk of a GLB.
fn parse(path: &Path, bytes: &[u8]) -> Result<(Root, RawJson, Option<Vec<u8>>), LoadError> {
    let malformed = |cause: String| LoadError::malformed(path, cause);
    let is_glb = bytes.starts_with(b"glTF");
    let (json, blob) = if is_glb {
        split_glb(bytes).map_err(malformed)?
    } else {
        (bytes, None)
    };
    let json = without_padding(json).trim_ascii_start();
    if !is_glb && !json.starts_with(b"{") {
        return Err(malformed(
            "neither a GLB (it does not begin with \"glTF\") nor a glTF (not JSON)".into(),
        ));
    }
    let no_json = |cause: String| {
        malformed(if is_glb && cause != raw_json::VERSION_REFUSED {
            format!("its JSON chunk does not parse: {cause}")
        } else {
            cause
        })
    };
    let json = raw_json::read_repaired(json).map_err(no_json)?;
    let raw = RawJson::deserialize(&json).map_err(|cause| no_json(cause.to_string()))?;
    let root = ::gltf::json::deserialize::from_value(json);
    Ok((root.map_err(|cause| no_json(cause.to_string()))?, raw, blob))
}

/// Returns the JSON chunk and the binary chunk of a GLB; other chunks are ignored.
///
/// # Errors
/// The cause, if the file is damaged or not of version 2.
fn split_glb(bytes: &[u8]) -> Result<(&[u8], Option<Vec<u8>>), String> {
    match bytes.get(4..8) {
        Some([1, 0, 0, 0]) => return Err(raw_json::VERSION_REFUSED.into()),
        Some([2, 0, 0, 0]) | None => {}
        Some(_) => return Err("the GLB header specifies another version than 2".into()),
    }
    let length = glb_length(bytes).unwrap_or(0);
    if length < 20 || length > bytes.len() {
        let actual = bytes.len();
        return Err(format!(
            "the GLB header specifies {length} bytes, but the file has {actual}"
        ));
    }
    let mut rest = &bytes[12..length];
    let mut chunks = [None; 2];
    while let Some((&[a, b, c, d, kind @ ..], after)) = rest.split_first_chunk::<8>() {
        let length = u32::from_le_bytes([a, b, c, d]) as usize;
        let Some((chunk, after)) = after.split_at_checked(length) else {
            let actual = after.len();
            return Err(format!(
                "a chunk of the GLB has {length} bytes, but only {actual} follow"
            ));
        };
        rest = after;
        match &kind {
            b"JSON" => chunks[0] = chunks[0].or(Some(chunk)),
            b"BIN\0" => chunks[1] = chunks[1].or(Some(chunk)),
            _ => {}
        }
    }
    let [json, blob] = chunks;
    let json = json.ok_or("the GLB has no JSON chunk")?;
    Ok((json, blob.map(Into::into)))
}

/// Returns a JSON text without byte-order mark and padding. Padding is spaces, but some programs
/// write NUL, as in the binary chunk of a GLB.
fn without_padding(chunk: &[u8]) -> &[u8] {
    let text = chunk.strip_prefix(b"\xef\xbb\xbf").unwrap_or(chunk);
    let end = text.iter().rposition(|&byte| byte != 0);
    &text[..end.map_or(0, |last| last + 1)]
}

/// A node of the scene in use.
struct PlacedNode {
    index: usize,
    world_from_node: DAffine3,
    /// False if `KHR_node_visibility` hides it or one of its ancestors.
    is_visible: bool,
}

/// Returns the nodes of the default scene (of all trees if there is no scene), depth first.
fn place_nodes(root: &Root, raw: &RawJson, notes: &mut Notes) -> Vec<PlacedNode> {
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
    // An explicit stack, because chains of nodes may be long; each node once, because of cycles.
    roots.reverse();
    let mut open: Vec<(usize, DAffine3, bool)> = roots
        .into_iter()
        .map(|node| (node, DAffine3::IDENTITY, true))
        .collect();
    let mut visited = vec![false; root.nodes.len()];
    let mut placed = Vec::new();
    while let Some((index, world_from_parent, parent_is_visible)) = open.pop() {
        let Some(node) = root.nodes.get(index) else {
            notes.add(Note::AccessorUnreadable, 1);
            continue;
        };
        if std::mem::replace(&mut visited[index], true) {
            notes.add(Note::NodeCycle, 1);
            continue;
        }
        let world_from_node = world_from_parent * raw.parent_from_node(index);
        let is_visible = parent_is_visible && raw.is_visible(index);
        open.extend(
            children(node)
                .into_iter()
                .rev()
                .map(|child| (child, world_from_node, is_visible)),
        );
        placed.push(PlacedNode {
            index,
            world_from_node,
            is_visible,
        });
    }
    placed
}

/// Adds the headbox, and the lights and the meshes of the visible nodes. Hidden nodes still move
/// the joints of skins.
fn push_nodes(
    root: &Root,
    raw: &RawJson,
    buffers: &Buffers,
    surfaces: &GltfMaterials,
    builder: &mut Builder,
    groups: bool,
) -> Result<(), MeshError> {
    let placed = place_nodes(root, raw, &mut builder.notes);
    let mut world_from_nodes = vec![None; root.nodes.len()];
    placed
        .iter()
        .for_each(|node| world_from_nodes[node.index] = Some(node.world_from_node));
    for placed in placed {
        let PlacedNode {
            index,
            world_from_node,
            is_visible,
        } = placed;
        let node = &root.nodes[index];
        if let Some(half_size) = raw.headbox_half_size(index) {
            builder.place_headbox(world_from_node.translation, half_size);
        }
        if !is_visible {
            let shows_something = node.mesh.is_some() || lights::has_lamp(node);
            builder
                .notes
                .add(Note::Hidden, usize::from(shows_something));
            continue;
        }
        lights::push(root, node, world_from_node, builder);
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
        let instances = instance_transforms(
            raw.instances(index),
            world_from_node,
            buffers,
            &mut builder.notes,
        );
        let pose = Pose::read(
            root,
            node,
            mesh,
            &world_from_nodes,
            buffers,
            &mut builder.notes,
        );
        for (i, primitive) in mesh.primitives.iter().enumerate() {
            if raw.has_splats(mesh_index.value(), i) {
                builder.notes.add(Note::Splats, 1);
                continue;
            }
            let colors = raw.color_targets(mesh_index.value(), i);
            let messages = &mut builder.notes.messages;
            if colors.into_iter().any(|it| pose.has_target(it))
                && !messages.iter().any(|it| it == MORPHED_COLORS)
            {
                messages.push(MORPHED_COLORS.into());
            }
            let surface = surfaces.find(primitive.material.map(|material| material.value()));
            push_primitive(primitive, &instances, &pose, surface, buffers, builder)?;
        }
    }
    Ok(())
}
