//! Decoder of primitives that `KHR_draco_mesh_compression` compresses.

use draco_core::{DecoderBuffer, Mesh, MeshDecoder};
use headbox_core::panics;
use serde::Deserialize;
use std::collections::BTreeMap;

/// The extension's object in a primitive.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct CompressedPrimitive {
    /// Buffer view with the compressed bytes.
    pub(super) buffer_view: u32,
    /// Draco's identifier of each attribute, by the attribute's name in glTF.
    #[serde(default)]
    pub(super) attributes: BTreeMap<String, u32>,
}

/// Numbers of an attribute, or of the indices of triangles.
pub(super) struct Values {
    pub(super) components: usize,
    /// Components of the first element, of the second, and so on.
    pub(super) numbers: Vec<f64>,
}

/// A decoded primitive.
pub(super) struct DecodedPrimitive {
    pub(super) indices: Values,
    /// By the attribute's name in glTF; those that the compressed bytes lack are absent.
    pub(super) attributes: BTreeMap<String, Values>,
}

impl CompressedPrimitive {
    /// Decodes the attributes and the triangles.
    ///
    /// # Errors
    /// The cause, if the bytes are malformed.
    pub(super) fn decode(&self, bytes: &[u8]) -> Result<DecodedPrimitive, String> {
        let decode = || {
            let mut mesh = Mesh::new();
            MeshDecoder::new().decode(&mut DecoderBuffer::new(bytes), &mut mesh)?;
            Ok(mesh)
        };
        let mesh =
            panics::catch(decode)?.map_err(|cause: draco_core::DracoError| cause.to_string())?;
        let corners = mesh
            .faces()
            .iter()
            .flatten()
            .map(|vertex| f64::from(vertex.0));
        let indices = Values {
            components: 1,
            numbers: corners.collect(),
        };
        let attributes = self.attributes.iter().filter_map(|(name, &id)| {
            let attribute = mesh.attribute_by_unique_id(id)?;
            let components = usize::from(attribute.num_components());
            let numbers = attribute.read_f32s(mesh.num_points(), components);
            let numbers = numbers.into_iter().map(f64::from).collect();
            Some((
                name.clone(),
                Values {
                    components,
                    numbers,
                },
            ))
        });
        Ok(DecodedPrimitive {
            indices,
            attributes: attributes.collect(),
        })
    }
}
