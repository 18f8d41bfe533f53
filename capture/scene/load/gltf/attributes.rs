//! Vertex attributes of a primitive, and the transform of normals.

use super::super::notes::{Note, Notes};
use super::accessor::Buffers;
use ::gltf::json::mesh::{Primitive, Semantic};
use ::gltf::json::validation::Checked;
use glam::DMat3;

/// Vertex attributes of a primitive; damaged ones are left out and counted.
pub(super) struct Attributes {
    pub(super) positions: Vec<[f64; 3]>,
    /// One per position, or empty.
    pub(super) normals: Vec<[f64; 3]>,
    pub(super) texcoords: Vec<[f64; 2]>,
    /// Those of the emission texture, or empty if they are `texcoords`.
    pub(super) emission_texcoords: Vec<[f64; 2]>,
    /// Linear RGB and opacity.
    pub(super) colors: Vec<[f64; 4]>,
}

impl Attributes {
    pub(super) fn read(
        primitive: &Primitive,
        [texcoord_set, emission_texcoord_set]: [u32; 2],
        buffers: &Buffers,
        notes: &mut Notes,
    ) -> Option<Self> {
        let accessor = |semantic| primitive.attributes.get(&Checked::Valid(semantic)).copied();
        let positions =
            accessor(Semantic::Positions).and_then(|positions| buffers.vectors(positions));
        let Some(positions) = positions else {
            notes.add(Note::AccessorUnreadable, 1);
            return None;
        };
        let count = positions.len();
        let colors = accessor(Semantic::Colors(0)).map(|a| {
            let (colors, is_raw) = buffers.colors(a)?;
            notes.add(Note::ColorNotNormalized, usize::from(is_raw));
            Some(colors)
        });
        let texcoords =
            |set: u32| accessor(Semantic::TexCoords(set)).map(|a| buffers.vectors::<2>(a));
        Some(Self {
            normals: optional(
                accessor(Semantic::Normals).map(|a| buffers.vectors(a)),
                count,
                notes,
            ),
            texcoords: optional(texcoords(texcoord_set), count, notes),
            emission_texcoords: if emission_texcoord_set == texcoord_set {
                Vec::new()
            } else {
                optional(texcoords(emission_texcoord_set), count, notes)
            },
            colors: optional(colors, count, notes),
            positions,
        })
    }
}

/// Returns an attribute, or none if it is absent (`None`) or damaged (`Some(None)`, another
/// length).
fn optional<T>(read: Option<Option<Vec<T>>>, count: usize, notes: &mut Notes) -> Vec<T> {
    let is_given = read.is_some();
    let values = read.flatten().filter(|values| values.len() == count);
    notes.add(
        Note::AccessorUnreadable,
        usize::from(is_given && values.is_none()),
    );
    values.unwrap_or_default()
}

/// Returns the matrix that transforms normals if `m` transforms points: the inverse transpose
/// except for its scale, defined for a singular `m`, too. Outward normals stay outward if `m`
/// mirrors.
pub(super) fn cofactors(m: DMat3) -> DMat3 {
    let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis];
    let sign = if m.determinant() < 0.0 { -1.0 } else { 1.0 };
    DMat3::from_cols(y.cross(z) * sign, z.cross(x) * sign, x.cross(y) * sign)
}
