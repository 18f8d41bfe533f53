//! Parts of the JSON that the `gltf` crate does not keep: node transforms in `f64` (it uses `f32`,
//! whose steps are a metre at 1e7 m) and further extensions.

use super::draco::CompressedPrimitive;
use super::instances::InstanceAttributes;
use super::meshopt::CompressedView;
use glam::{DAffine3, DMat4, DQuat, DVec3};
use serde::Deserialize;
use serde::de::IgnoredAny;
use std::collections::BTreeMap;

/// Name of the property, in a node's extras, with half of the headbox's edge: Blender exports
/// custom properties of objects there.
pub const HEADBOX_HALF_SIZE: &str = "headbox_half_size";

/// Nodes, textures and compressed parts of the JSON of a file.
#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct RawJson {
    #[serde(default)]
    nodes: Vec<NodeTransform>,
    #[serde(default)]
    textures: Vec<TextureSource>,
    #[serde(default)]
    buffer_views: Vec<RawView>,
    #[serde(default)]
    meshes: Vec<RawMesh>,
}

#[derive(Deserialize)]
struct RawView {
    buffer: usize,
    #[serde(default)]
    extensions: ViewExtensions,
}

#[derive(Default, Deserialize)]
struct ViewExtensions {
    #[serde(rename = "EXT_meshopt_compression", alias = "KHR_meshopt_compression")]
    meshopt: Option<CompressedView>,
}

#[derive(Deserialize)]
struct RawMesh {
    #[serde(default)]
    primitives: Vec<RawPrimitive>,
}

/// Accessors of a primitive, and its compressed form.
#[derive(Deserialize)]
pub(super) struct RawPrimitive {
    pub(super) indices: Option<usize>,
    #[serde(default)]
    pub(super) attributes: BTreeMap<String, usize>,
    #[serde(default)]
    extensions: PrimitiveExtensions,
}

#[derive(Default, Deserialize)]
struct PrimitiveExtensions {
    #[serde(rename = "KHR_draco_mesh_compression")]
    draco: Option<CompressedPrimitive>,
    #[serde(rename = "KHR_gaussian_splatting")]
    splats: Option<IgnoredAny>,
    /// Compressed splats of drafts of the extension.
    #[serde(rename = "KHR_spz_gaussian_splats_compression")]
    draft_splats: Option<IgnoredAny>,
}

impl RawPrimitive {
    /// Returns true if the primitive is a cloud of Gaussian splats.
    fn has_splats(&self) -> bool {
        let extensions = &self.extensions;
        extensions.splats.is_some() || extensions.draft_splats.is_some()
    }
}

#[derive(Default, Deserialize)]
struct TextureSource {
    #[serde(default)]
    extensions: TextureExtensions,
}

#[derive(Default, Deserialize)]
struct TextureExtensions {
    #[serde(rename = "EXT_texture_webp")]
    webp: Option<ImageOfTexture>,
    #[serde(rename = "KHR_texture_basisu")]
    basis: Option<ImageOfTexture>,
}

#[derive(Default, Deserialize)]
struct ImageOfTexture {
    source: usize,
}

/// Transform of a node, as in the file.
#[derive(Clone, Default, Deserialize)]
pub(super) struct NodeTransform {
    matrix: Option<[f64; 16]>,
    pub(super) translation: Option<[f64; 3]>,
    pub(super) rotation: Option<[f64; 4]>,
    pub(super) scale: Option<[f64; 3]>,
    #[serde(default)]
    extras: serde_json::Value,
    #[serde(default)]
    extensions: NodeExtensions,
}

#[derive(Clone, Default, Deserialize)]
struct NodeExtensions {
    #[serde(rename = "EXT_mesh_gpu_instancing")]
    instancing: Option<Instancing>,
    #[serde(rename = "KHR_node_visibility")]
    visibility: Option<Visibility>,
}

#[derive(Clone, Default, Deserialize)]
struct Visibility {
    visible: Option<bool>,
}

#[derive(Clone, Default, Deserialize)]
struct Instancing {
    #[serde(default)]
    attributes: InstanceAttributes,
}

impl RawJson {
    /// Returns true if a primitive of a mesh is a cloud of Gaussian splats.
    pub(super) fn has_splats(&self, mesh: usize, primitive: usize) -> bool {
        let primitives = self.meshes.get(mesh).map(|mesh| &mesh.primitives);
        primitives
            .and_then(|primitives| primitives.get(primitive))
            .is_some_and(RawPrimitive::has_splats)
    }

    /// Returns true if all primitives of the file are clouds of Gaussian splats.
    pub(super) fn has_splats_alone(&self) -> bool {
        let mut primitives = self.meshes.iter().flat_map(|mesh| &mesh.primitives);
        let is_empty = self.meshes.iter().all(|mesh| mesh.primitives.is_empty());
        !is_empty && primitives.all(RawPrimitive::has_splats)
    }

    /// Parses the JSON of a glTF file.
    pub(super) fn parse(json: &[u8]) -> Result<Self, serde_json::Error> {
        serde_json::from_slice(json)
    }

    /// Returns the transform of a node; the identity if the file has none.
    pub(super) fn parent_from_node(&self, index: usize) -> DAffine3 {
        self.nodes
            .get(index)
            .map_or(DAffine3::IDENTITY, NodeTransform::parent_from_node)
    }

    /// Returns half of the edge of the headbox about a node, file units, if its extras have one.
    pub(super) fn headbox_half_size(&self, index: usize) -> Option<f64> {
        let half_size = self
            .nodes
            .get(index)?
            .extras
            .get(HEADBOX_HALF_SIZE)?
            .as_f64()?;
        (half_size.is_finite() && half_size > 0.0).then_some(half_size)
    }

    /// Returns the WebP image of a texture, which is preferred to its own.
    pub(super) fn image_of_texture(&self, index: usize) -> Option<usize> {
        self.textures
            .get(index)?
            .extensions
            .webp
            .as_ref()
            .map(|webp| webp.source)
    }

    /// Returns the KTX2 image of a texture, which is used where it has no other.
    pub(super) fn ktx2_image_of_texture(&self, index: usize) -> Option<usize> {
        let basis = self.textures.get(index)?.extensions.basis.as_ref()?;
        Some(basis.source)
    }

    /// Returns the compressed form of a buffer view, if it has one.
    pub(super) fn compressed_view(&self, index: usize) -> Option<&CompressedView> {
        self.buffer_views.get(index)?.extensions.meshopt.as_ref()
    }

    /// Returns true if all views of a buffer have a compressed form in another buffer, so that it
    /// is only for readers that do not support compression.
    pub(super) fn is_fallback_buffer(&self, buffer: usize) -> bool {
        let mut views = self
            .buffer_views
            .iter()
            .filter(|view| view.buffer == buffer)
            .peekable();
        views.peek().is_some() && views.all(|view| view.extensions.meshopt.is_some())
    }

    /// Returns the primitives that have a compressed form.
    pub(super) fn compressed_primitives(
        &self,
    ) -> impl Iterator<Item = (&RawPrimitive, &CompressedPrimitive)> {
        let primitives = self.meshes.iter().flat_map(|mesh| &mesh.primitives);
        primitives.filter_map(|primitive| Some((primitive, primitive.extensions.draco.as_ref()?)))
    }

    /// Returns the instances of a node's mesh, if it has some.
    pub(super) fn instances(&self, index: usize) -> Option<&InstanceAttributes> {
        self.nodes
            .get(index)?
            .extensions
            .instancing
            .as_ref()
            .map(|instancing| &instancing.attributes)
    }

    /// Returns false if `KHR_node_visibility` hides a node.
    pub(super) fn is_visible(&self, index: usize) -> bool {
        let visibility = self
            .nodes
            .get(index)
            .and_then(|node| node.extensions.visibility.as_ref());
        visibility.is_none_or(|visibility| visibility.visible.unwrap_or(true))
    }

    /// Returns a node's transform for animation; animated nodes have no matrix.
    pub(super) fn node_transform(&self, index: usize) -> NodeTransform {
        self.nodes.get(index).cloned().unwrap_or_default()
    }
}

impl NodeTransform {
    pub(super) fn parent_from_node(&self) -> DAffine3 {
        if let Some(columns) = self.matrix {
            return DAffine3::from_mat4(DMat4::from_cols_array(&columns));
        }
        compose(self.translation, self.rotation, self.scale)
    }
}

/// Composes a transform; absent parts and a zero quaternion are the identity.
pub(super) fn compose(
    translation: Option<[f64; 3]>,
    rotation: Option<[f64; 4]>,
    scale: Option<[f64; 3]>,
) -> DAffine3 {
    let rotation = DQuat::from_array(rotation.unwrap_or([0.0; 4]));
    DAffine3::from_scale_rotation_translation(
        DVec3::from_array(scale.unwrap_or([1.0; 3])),
        if rotation.length_squared() > 0.0 {
            rotation.normalize()
        } else {
            DQuat::IDENTITY
        },
        DVec3::from_array(translation.unwrap_or_default()),
    )
}
