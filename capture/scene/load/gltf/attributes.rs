//! Vertex attributes of a primitive, and the transform of normals.

use super::super::notes::{Note, Notes};
use super::accessor::Buffers;
use ::gltf::json::Index;
use ::gltf::json::accessor::Accessor;
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
        let mut colors = optional(
            accessor(Semantic::Colors(0)).map(|a| colors(a, buffers)),
            count,
            notes,
        );
        normalize_colors(&mut colors, notes);
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
            colors,
            positions,
        })
    }
}

/// Reads colours with opacity, which is 1 if the file has three components.
fn colors(accessor: Index<Accessor>, buffers: &Buffers) -> Option<Vec<[f64; 4]>> {
    if buffers.components(accessor) == 4 {
        return buffers.vectors(accessor);
    }
    let opaque = |[r, g, b]: [f64; 3]| [r, g, b, 1.0];
    Some(buffers.vectors(accessor)?.into_iter().map(opaque).collect())
}

/// Divides colours of 0 to 255 or 65,535 by that: whole numbers that the file does not declare as
/// normalized, which is invalid but common.
fn normalize_colors(colors: &mut [[f64; 4]], notes: &mut Notes) {
    let rgb = || colors.iter().flat_map(|&[r, g, b, _]| [r, g, b]);
    let largest = rgb().fold(0.0, f64::max);
    if largest <= 1.0 || largest > 65_535.0 || rgb().any(|c| c.fract() != 0.0) {
        return;
    }
    let full = if largest > 255.0 { 65_535.0 } else { 255.0 };
    for [r, g, b, opacity] in colors.iter_mut() {
        [r, g, b].into_iter().for_each(|c| *c /= full);
        if *opacity > 1.0 {
            *opacity /= full;
        }
    }
    notes.add(Note::ColorNotNormalized, 1);
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
