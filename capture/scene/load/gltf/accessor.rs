//! Reads numbers from buffers and checks every offset, length and count.
//!
//! Only the JSON types of the `gltf` crate are used: its reader and its validation panic on some
//! damaged files (an attribute with a missing accessor, a count of 0), and reject files that lack
//! redundant data only.

use super::super::named_files::find_file;
use super::super::notes::{Note, Notes};
use super::draco::{CompressedPrimitive, Values};
use super::meshopt::CompressedView;
use super::raw_json::{RawJson, RawPrimitive};
use super::uri::UriTarget;
use crate::load::gltf::uri;
use gltf::json::accessor::{Accessor, ComponentType, Type};
use gltf::json::validation::Checked;
use gltf::json::{Index, Root, buffer};
use headbox_core::files::InputFolder;
use headbox_core::memory::{self, OverBudget};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::OnceLock;

/// Maximum number of entries of an accessor without a buffer view (zeros, except for sparse
/// values). Others cannot have more than their buffer holds.
const MAX_ZEROS: usize = 1 << 24;

/// Buffers of a file, decompressed.
pub(super) struct Buffers<'a> {
    root: &'a Root,
    data: Vec<Option<Vec<u8>>>,
    /// Bytes of compressed views.
    decoded_views: BTreeMap<usize, Vec<u8>>,
    /// Numbers of accessors whose bytes are in compressed primitives.
    decoded_accessors: BTreeMap<usize, Values>,
    /// Corners of compressed primitives without an accessor for them, by that of their positions.
    decoded_corners: BTreeMap<usize, Values>,
    /// Why an accessor was not read although it is valid.
    over_budget: OnceLock<OverBudget>,
}

impl<'a> Buffers<'a> {
    /// Reads the buffers; `blob` is the binary chunk of a GLB.
    pub(super) fn read(
        root: &'a Root,
        raw: &RawJson,
        blob: Option<Vec<u8>>,
        folder: &InputFolder,
        notes: &mut Notes,
    ) -> Self {
        let mut blob = blob;
        let mut read = |(index, buffer): (usize, &buffer::Buffer)| {
            if raw.is_fallback_buffer(index) {
                return None;
            }
            let (name, bytes) = match buffer.uri.as_deref() {
                None => (
                    format!("buffer {index}"),
                    blob.take().ok_or_else(|| "no binary chunk".to_owned()),
                ),
                Some(uri) => match uri::resolve(uri, folder) {
                    UriTarget::Data(bytes) => (format!("buffer {index}"), bytes),
                    UriTarget::File(file) => {
                        let bytes = match find_file(&file, folder.path(), folder) {
                            Ok(found) => {
                                notes.add_file(&found.path);
                                memory::read_file(&found.path).map_err(|cause| {
                                    notes.add_if_over_budget(&file, &cause);
                                    cause.to_string()
                                })
                            }
                            Err(cause) => Err(cause),
                        };
                        (file, bytes)
                    }
                },
            };
            bytes
                .map_err(|cause| {
                    notes.add_named(Note::BufferUnreadable, format!("{name} ({cause})"));
                })
                .ok()
        };
        let data = root.buffers.iter().enumerate().map(&mut read).collect();
        let mut buffers = Self {
            root,
            data,
            decoded_views: BTreeMap::new(),
            decoded_accessors: BTreeMap::new(),
            decoded_corners: BTreeMap::new(),
            over_budget: OnceLock::new(),
        };
        buffers.decode_views(raw, notes);
        buffers.decode_primitives(raw, notes);
        buffers
    }

    /// Returns the error of the memory budget, if accessors were left out because of it.
    pub(super) fn over_budget(&self) -> Option<&OverBudget> {
        self.over_budget.get()
    }

    /// Decodes the compressed views.
    fn decode_views(&mut self, raw: &RawJson, notes: &mut Notes) {
        let compressed: Vec<_> = (0..self.root.buffer_views.len())
            .filter_map(|index| Some((index, raw.compressed_view(index)?)))
            .collect();
        let decode = |&(index, view): &(usize, &CompressedView)| {
            let data = self.data.get(view.buffer).and_then(Option::as_deref);
            let bytes = data.and_then(|data| data.get(view.byte_offset..)?.get(..view.byte_length));
            (index, bytes.and_then(|bytes| view.decode(bytes)))
        };
        let decoded: Vec<_> = compressed.par_iter().map(decode).collect();
        for (index, bytes) in decoded {
            match bytes {
                Some(bytes) => {
                    self.decoded_views.insert(index, bytes);
                }
                None => {
                    let name =
                        format!("buffer view {index} (its meshopt compression is malformed)");
                    notes.add_named(Note::BufferUnreadable, name);
                }
            }
        }
    }

    /// Decodes the compressed primitives whose accessors have no bytes of their own.
    fn decode_primitives(&mut self, raw: &RawJson, notes: &mut Notes) {
        let lacks_bytes = |&index: &usize| {
            let accessor = self.root.accessors.get(index);
            accessor.is_some_and(|accessor| accessor.buffer_view.is_none())
        };
        let compressed: Vec<_> = raw
            .compressed_primitives()
            .filter(|(primitive, _)| {
                primitive
                    .indices
                    .iter()
                    .chain(primitive.attributes.values())
                    .any(lacks_bytes)
            })
            .collect();
        let decode = |(_, compressed): &(&RawPrimitive, &CompressedPrimitive)| {
            let view = self.view(Index::new(compressed.buffer_view));
            match view {
                Some((bytes, _)) => compressed.decode(bytes),
                None => Err("its bytes are missing".into()),
            }
        };
        let decoded: Vec<_> = compressed.par_iter().map(decode).collect();
        for ((primitive, compressed), decoded) in compressed.into_iter().zip(decoded) {
            match decoded {
                Ok(mut decoded) => {
                    let attributes = primitive.attributes.iter();
                    let values = attributes.filter_map(|(name, &index)| {
                        Some((index, decoded.attributes.remove(name)?))
                    });
                    self.decoded_accessors.extend(values);
                    if let Some(indices) = primitive.indices {
                        self.decoded_accessors.insert(indices, decoded.indices);
                    } else if let Some(&positions) = primitive.attributes.get("POSITION") {
                        self.decoded_corners.insert(positions, decoded.indices);
                    }
                }
                Err(cause) => {
                    let view = compressed.buffer_view;
                    let name = format!("buffer view {view} (Draco: {cause})");
                    notes.add_named(Note::BufferUnreadable, name);
                }
            }
        }
    }

    /// Returns the bytes of a view, and its stride if it has one.
    pub(super) fn view(&self, index: Index<buffer::View>) -> Option<(&[u8], Option<usize>)> {
        let view = self.root.buffer_views.get(index.value())?;
        let stride = view.byte_stride.map(|stride| stride.0);
        if let Some(bytes) = self.decoded_views.get(&index.value()) {
            return Some((bytes, stride));
        }
        let data = self.data.get(view.buffer.value())?.as_deref()?;
        let start = usize::try_from(view.byte_offset.unwrap_or_default().0).ok()?;
        let length = usize::try_from(view.byte_length.0).ok()?;
        let bytes = data.get(start..start.checked_add(length)?)?;
        Some((bytes, stride))
    }

    /// Returns true if the bytes of an accessor limit its number of entries: it has a buffer view,
    /// or sparse values for one entry in sixteen.
    pub(super) fn has_bytes(&self, index: Index<Accessor>) -> bool {
        let Some(accessor) = self.root.accessors.get(index.value()) else {
            return false;
        };
        let sparse = accessor.sparse.as_ref();
        accessor.buffer_view.is_some()
            || sparse.is_some_and(|it| it.count.0.saturating_mul(16) >= accessor.count.0)
    }

    /// Returns the corners of the triangles of a compressed primitive with these positions, if it
    /// has no accessor for them.
    pub(super) fn compressed_corners(&self, positions: Index<Accessor>) -> Option<Vec<usize>> {
        let corners = self.decoded_corners.get(&positions.value())?;
        Some(
            corners
                .numbers
                .iter()
                .map(|&corner| corner as usize)
                .collect(),
        )
    }

    /// Reads colours with opacity, which is 1 if the file has three components; also returns true
    /// if they are integers that the file does not declare as normalized, or floating-point numbers
    /// of 0 to 255, which is invalid but common.
    pub(super) fn colors(&self, index: Index<Accessor>) -> Option<(Vec<[f64; 4]>, bool)> {
        let layout = Layout::new(self.root.accessors.get(index.value())?)?;
        let is_integer = matches!(layout.component, ComponentType::U8 | ComponentType::U16);
        let has_opacity = layout.components == 4;
        let mut colors: Vec<[f64; 4]> = if has_opacity {
            self.vectors(index)?
        } else {
            let opaque = |[r, g, b]: [f64; 3]| [r, g, b, 1.0];
            self.vectors(index)?.into_iter().map(opaque).collect()
        };
        let [brightest, most_opaque] = colors.iter().fold([0.0_f64; 2], |most, [rgb @ .., a]| {
            [rgb.iter().copied().fold(most[0], f64::max), most[1].max(*a)]
        });
        let white = if layout.component == ComponentType::F32 {
            // No light is so much above white.
            (32.0..=255.0).contains(&brightest).then_some(255.0)
        } else {
            let is_raw = is_integer && !layout.normalized && brightest.max(most_opaque) > 1.0;
            is_raw.then(|| layout.greatest())
        };
        if let Some(white) = white {
            for [rgb @ .., opacity] in &mut colors {
                rgb.iter_mut().for_each(|c| *c /= white);
                *opacity /= if most_opaque > 1.0 { white } else { 1.0 };
            }
        }
        Some((colors, white.is_some()))
    }

    /// Reads an accessor as vectors of `N` components, without further components. Returns `None`
    /// if it has fewer or is damaged.
    pub(super) fn vectors<const N: usize>(&self, index: Index<Accessor>) -> Option<Vec<[f64; N]>> {
        let accessor = self.root.accessors.get(index.value())?;
        let layout = Layout::new(accessor)?;
        if let Some(values) = self.decoded_accessors.get(&index.value()) {
            if values.components < N {
                return None;
            }
            let vector = |element: &[f64]| std::array::from_fn(|i| layout.scale(element[i]));
            return Some(
                values
                    .numbers
                    .chunks_exact(values.components)
                    .map(vector)
                    .collect(),
            );
        }
        let count = usize::try_from(accessor.count.0).ok()?;
        let mut values = match accessor.buffer_view {
            Some(view) => {
                let offset = usize::try_from(accessor.byte_offset.unwrap_or_default().0).ok()?;
                self.entries(view, offset, count, layout)?
            }
            None if count <= MAX_ZEROS => {
                let memory = memory::reserve(8 * (N * count) as u64);
                let _memory = memory
                    .map_err(|cause| self.over_budget.get_or_init(|| cause).clone())
                    .ok()?;
                vec![[0.0; N]; count]
            }
            None => return None,
        };
        if let Some(sparse) = &accessor.sparse {
            let count = usize::try_from(sparse.count.0).ok()?;
            let Checked::Valid(index_type) = sparse.indices.component_type else {
                return None;
            };
            let index_layout = Layout {
                component: index_type.0,
                components: 1,
                normalized: false,
            };
            let offset = |offset: u64| usize::try_from(offset).ok();
            let indices: Vec<[f64; 1]> = self.entries(
                sparse.indices.buffer_view,
                offset(sparse.indices.byte_offset.0)?,
                count,
                index_layout,
            )?;
            let replacements = self.entries(
                sparse.values.buffer_view,
                offset(sparse.values.byte_offset.0)?,
                count,
                layout,
            )?;
            for ([index], replacement) in indices.into_iter().zip(replacements) {
                *values.get_mut(index as usize)? = replacement;
            }
        }
        Some(values)
    }

    fn entries<const N: usize>(
        &self,
        view: Index<buffer::View>,
        offset: usize,
        count: usize,
        layout: Layout,
    ) -> Option<Vec<[f64; N]>> {
        if layout.components < N {
            return None;
        }
        let (bytes, stride) = self.view(view)?;
        let bytes = bytes.get(offset..)?;
        let component_size = layout.component.size();
        let entry_size = component_size * layout.components;
        let stride = stride.unwrap_or(entry_size).max(entry_size);
        let end = count
            .checked_sub(1)?
            .checked_mul(stride)?
            .checked_add(entry_size)?;
        let bytes = bytes.get(..end)?;
        let entry = |entry: &[u8]| {
            std::array::from_fn(|i| layout.read_component(&entry[i * component_size..]))
        };
        Some(bytes.chunks(stride).map(entry).collect())
    }
}

/// Storage format of an accessor's numbers.
#[derive(Clone, Copy)]
struct Layout {
    component: ComponentType,
    components: usize,
    normalized: bool,
}

impl Layout {
    /// Returns the layout of an accessor. Of matrices only those of skins are supported: columns of
    /// four floats have no padding.
    fn new(accessor: &Accessor) -> Option<Self> {
        let Checked::Valid(component) = accessor.component_type else {
            return None;
        };
        let Checked::Valid(shape) = accessor.type_ else {
            return None;
        };
        match shape {
            Type::Scalar | Type::Vec2 | Type::Vec3 | Type::Vec4 => {}
            Type::Mat4 if component.0 == ComponentType::F32 => {}
            Type::Mat2 | Type::Mat3 | Type::Mat4 => return None,
        }
        Some(Self {
            component: component.0,
            components: shape.multiplicity(),
            normalized: accessor.normalized,
        })
    }

    /// Reads the number at the start of `bytes`, which must have at least the component's size.
    fn read_component(self, bytes: &[u8]) -> f64 {
        let two = || [bytes[0], bytes[1]];
        let four = || [bytes[0], bytes[1], bytes[2], bytes[3]];
        self.scale(match self.component {
            ComponentType::I8 => f64::from(bytes[0].cast_signed()),
            ComponentType::U8 => f64::from(bytes[0]),
            ComponentType::I16 => f64::from(i16::from_le_bytes(two())),
            ComponentType::U16 => f64::from(u16::from_le_bytes(two())),
            ComponentType::U32 => f64::from(u32::from_le_bytes(four())),
            ComponentType::F32 => f64::from(f32::from_le_bytes(four())),
        })
    }

    /// Maps a stored number to the range of a normalized accessor, and leaves others unchanged.
    fn scale(self, value: f64) -> f64 {
        if self.normalized {
            (value / self.greatest()).max(-1.0)
        } else {
            value
        }
    }

    /// Returns the greatest number of an integer component; 1 for floats.
    fn greatest(self) -> f64 {
        match self.component {
            ComponentType::F32 => 1.0,
            ComponentType::I8 => 127.0,
            ComponentType::U8 => 255.0,
            ComponentType::I16 => 32_767.0,
            ComponentType::U16 => 65_535.0,
            ComponentType::U32 => 4_294_967_295.0,
        }
    }
}
