//! Parts of the JSON that the `gltf` crate does not keep: node transforms in `f64` (it uses `f32`,
//! whose steps are a metre at 1e7 m) and further extensions. [`read_repaired`] removes defects of
//! the JSON at which the crate would refuse the whole file.

use super::draco::CompressedPrimitive;
use super::instances::InstanceAttributes;
use super::meshopt::CompressedView;
use glam::{DAffine3, DMat4, DQuat, DVec3};
use serde::de::{DeserializeSeed, Error, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::fmt;

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
    #[serde(rename = "EXT_meshopt_compression")]
    ext_meshopt: Option<CompressedView>,
    #[serde(rename = "KHR_meshopt_compression")]
    khr_meshopt: Option<CompressedView>,
}

impl ViewExtensions {
    fn meshopt(&self) -> Option<&CompressedView> {
        self.khr_meshopt.as_ref().or(self.ext_meshopt.as_ref())
    }
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
    /// Accessors of each morph target.
    #[serde(default)]
    targets: Vec<BTreeMap<String, IgnoredAny>>,
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
    extras: Value,
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
    fn primitive(&self, mesh: usize, primitive: usize) -> Option<&RawPrimitive> {
        self.meshes.get(mesh)?.primitives.get(primitive)
    }

    /// Returns true if a primitive of a mesh is a cloud of Gaussian splats.
    pub(super) fn has_splats(&self, mesh: usize, primitive: usize) -> bool {
        self.primitive(mesh, primitive)
            .is_some_and(RawPrimitive::has_splats)
    }

    /// Returns the indices of the morph targets of a primitive that also change colours or texture
    /// coordinates.
    pub(super) fn color_targets(&self, mesh: usize, primitive: usize) -> Vec<usize> {
        let is_read = |name: &String| ["POSITION", "NORMAL", "TANGENT"].contains(&name.as_str());
        let targets = self.primitive(mesh, primitive).map(|it| &it.targets);
        let targets = targets.into_iter().flatten().enumerate();
        targets
            .filter_map(|(i, target)| (!target.keys().all(is_read)).then_some(i))
            .collect()
    }

    /// Returns true if all primitives of the file are clouds of Gaussian splats.
    pub(super) fn has_splats_alone(&self) -> bool {
        let mut primitives = self.meshes.iter().flat_map(|mesh| &mesh.primitives);
        let is_empty = self.meshes.iter().all(|mesh| mesh.primitives.is_empty());
        !is_empty && primitives.all(RawPrimitive::has_splats)
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
        self.buffer_views.get(index)?.extensions.meshopt()
    }

    /// Returns true if all views of a buffer have a compressed form in another buffer, so that it
    /// is only for readers that do not support compression.
    pub(super) fn is_fallback_buffer(&self, buffer: usize) -> bool {
        let mut views = self
            .buffer_views
            .iter()
            .filter(|view| view.buffer == buffer)
            .peekable();
        views.peek().is_some() && views.all(|view| view.extensions.meshopt().is_some())
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

/// Message about files of the first version.
pub(super) const VERSION_REFUSED: &str =
    "glTF of version 1.0, which is not read; convert it to glTF 2.0";

/// Reads the JSON of a glTF file without `null` members and without extras, except for
/// [`HEADBOX_HALF_SIZE`]; both may be of any type. An index of -1, which some programs write for
/// none, counts as `null`. Removes animation channels that move no node.
///
/// # Errors
/// The cause: not JSON, or not version 2.
pub(super) fn read_repaired(json: &[u8]) -> Result<Value, String> {
    let read = |json: &[u8]| {
        let mut json = serde_json::Deserializer::from_slice(json);
        let root = Repair { is_extras: false }.deserialize(&mut json);
        root.and_then(|root| json.end().map(|()| root))
    };
    let root = read(json).or_else(|cause| match without_lone_surrogates(json) {
        Some(json) => read(&json),
        None => Err(cause),
    });
    let mut root = root.map_err(|cause| cause.to_string())?;
    let version = &root["asset"]["version"];
    let is_first = version.as_str().is_some_and(|it| it.starts_with("1."))
        || version.as_f64().is_some_and(|it| it < 2.0)
        || root["meshes"].is_object();
    if is_first {
        return Err(VERSION_REFUSED.into());
    }
    let scenes = list(&mut root, "scenes").into_iter().flatten();
    for scene in scenes.filter_map(Value::as_object_mut) {
        let nodes = scene.entry("nodes");
        nodes.or_insert_with(|| Value::Array(Vec::new()));
    }
    if let Some(animations) = list(&mut root, "animations") {
        animations.retain_mut(|animation| {
            if let Some(channels) = list(animation, "channels") {
                channels.retain(|channel| !channel["target"]["node"].is_null());
            }
            animation["channels"].is_array() && animation["samplers"].is_array()
        });
    }
    Ok(root)
}

/// Returns JSON with each lone surrogate (`\ud800`), which is no character, replaced by `\ufffd`:
/// programs cut names in the middle of a pair. `None` if there is none.
fn without_lone_surrogates(json: &[u8]) -> Option<Vec<u8>> {
    let surrogate = |at: usize| {
        let digits = json.get(at..at + 6)?.strip_prefix(b"\\u")?;
        let code = u16::from_str_radix(std::str::from_utf8(digits).ok()?, 16).ok()?;
        (0xd800..0xe000).contains(&code).then_some(code)
    };
    let mut repaired = None;
    let mut at = 0;
    while at < json.len() {
        match (surrogate(at), surrogate(at + 6)) {
            (None, _) if json[at] == b'\\' => at += 2, // an escape of two characters at least
            (None, _) => at += 1,
            (Some(0xd800..0xdc00), Some(0xdc00..)) => at += 12,
            (Some(_), _) => {
                let json = repaired.get_or_insert_with(|| json.to_vec());
                json[at..at + 6].copy_from_slice(br"\ufffd");
                at += 6;
            }
        }
    }
    repaired
}

fn list<'a>(object: &'a mut Value, name: &str) -> Option<&'a mut Vec<Value>> {
    object.get_mut(name)?.as_array_mut()
}

/// Optional members that are an index.
const INDICES: [&str; 8] = [
    "bufferView",
    "camera",
    "indices",
    "material",
    "mesh",
    "scene",
    "skin",
    "source",
];

/// Reader of JSON without `null` members and extras. Whole numbers that are written with a fraction
/// become integers.
struct Repair {
    /// True for the extras of an object, of which one member is read at most.
    is_extras: bool,
}

impl<'de> DeserializeSeed<'de> for Repair {
    type Value = Value;

    fn deserialize<D: Deserializer<'de>>(self, json: D) -> Result<Value, D::Error> {
        json.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Repair {
    type Value = Value;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("JSON")
    }

    fn visit_unit<E: Error>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }

    fn visit_bool<E: Error>(self, value: bool) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Value, E> {
        const EXACT: f64 = 9_007_199_254_740_992.0; // 2^53
        let is_whole = value.fract() == 0.0 && (0.0..EXACT).contains(&value);
        Ok(if is_whole {
            (value as u64).into()
        } else {
            value.into()
        })
    }

    fn visit_str<E: Error>(self, value: &str) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Value, A::Error> {
        let mut list = Vec::new();
        if self.is_extras {
            while items.next_element::<IgnoredAny>()?.is_some() {}
            return Ok(Value::Null);
        }
        while let Some(item) = items.next_element_seed(Self { is_extras: false })? {
            list.push(item);
        }
        Ok(list.into())
    }

    fn visit_map<A: MapAccess<'de>>(self, mut members: A) -> Result<Value, A::Error> {
        let mut object = Map::new();
        while let Some(name) = members.next_key::<String>()? {
            if self.is_extras && name != HEADBOX_HALF_SIZE {
                members.next_value::<IgnoredAny>()?;
                continue;
            }
            let is_extras = name == "extras";
            let value = members.next_value_seed(Self { is_extras })?;
            let is_kept = if is_extras {
                value.is_object()
            } else {
                !value.is_null() && (value != -1 || !INDICES.contains(&name.as_str()))
            };
            if is_kept {
                object.insert(name, value);
            }
        }
        Ok(object.into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lone_surrogates_are_replaced() {
        let repaired = |json: &str| read_repaired(json.as_bytes()).map(|root| root["a"].clone());
        assert_eq!(repaired(r#"{"a":"x\ud83d"}"#), Ok("x\u{fffd}".into()));
        assert_eq!(
            repaired(r#"{"a":"\udc00\ud83d\ude00"}"#),
            Ok("\u{fffd}\u{1f600}".into())
        );
        // A backslash before "ud800" is no escape of a surrogate.
        assert_eq!(
            repaired(r#"{"a":"\\ud800","b":"\ud800"}"#),
            Ok(r"\ud800".into())
        );
        assert!(repaired(r#"{"a":"\ud83"}"#).is_err());
    }

    #[test]
    fn minus_one_is_no_index() {
        let root = read_repaired(br#"{"nodes":[{"mesh":-1,"scale":[-1,1,1]}]}"#).expect("JSON");
        assert_eq!(root["nodes"][0], serde_json::json!({"scale": [-1, 1, 1]}));
    }

    #[test]
    fn unknown_compression_is_read() {
        let view = r#"{"buffer":0,"byteLength":9,"byteStride":4,"count":1,"mode":"NEW"}"#;
        let json = format!(
            r#"{{"bufferViews":[{{"buffer":1,"extensions":{{"EXT_meshopt_compression":{view}}}}}]}}"#
        );
        let raw: RawJson = serde_json::from_str(&json).expect("another mode");
        let view = raw.compressed_view(0).expect("a view");
        assert!(view.decode(&[0; 9]).is_none());
    }

    #[test]
    fn view_compressed_under_both_names_is_read() {
        let view = r#"{"buffer":0,"byteLength":9,"byteStride":4,"count":1,"mode":"ATTRIBUTES"}"#;
        let json = format!(
            r#"{{"bufferViews":[{{"buffer":1,"extensions":{{"EXT_meshopt_compression":{view},
            "KHR_meshopt_compression":{view}}}}}]}}"#
        );
        let raw: RawJson = serde_json::from_str(&json).expect("both");
        assert!(raw.compressed_view(0).is_some_and(|view| view.buffer == 0));
    }
}
