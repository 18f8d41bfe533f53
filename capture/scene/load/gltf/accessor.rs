//! Reads numbers from buffers and checks every offset, length and count.
//!
//! Only the JSON types of the `gltf` crate are used: its reader and its validation panic on some
//! damaged files (an attribute with a missing accessor, a count of 0), and reject files that lack
//! redundant data only.

use super::super::notes::{Note, Notes};
use super::super::textures::find_file;
use super::uri::UriTarget;
use crate::load::gltf::uri;
use gltf::json::accessor::{Accessor, ComponentType, Type};
use gltf::json::validation::Checked;
use gltf::json::{Index, Root, buffer};
use std::path::Path;

/// Maximum number of entries of an accessor without a buffer view (zeros, except for sparse
/// values). Others cannot have more than their buffer holds.
const MAX_ZEROS: usize = 1 << 24;

/// Buffers of a file.
pub(super) struct Buffers<'a> {
    root: &'a Root,
    data: Vec<Option<Vec<u8>>>,
}

impl<'a> Buffers<'a> {
    /// Reads the buffers; `blob` is the binary chunk of a GLB.
    pub(super) fn read(
        root: &'a Root,
        blob: Option<Vec<u8>>,
        folder: &Path,
        notes: &mut Notes,
    ) -> Self {
        let mut blob = blob;
        let mut read = |(index, buffer): (usize, &buffer::Buffer)| {
            let (name, bytes) = match buffer.uri.as_deref() {
                None => (
                    format!("buffer {index}"),
                    blob.take().ok_or_else(|| "no binary chunk".to_owned()),
                ),
                Some(uri) => match uri::resolve(uri) {
                    UriTarget::Data(bytes) => (format!("buffer {index}"), bytes),
                    UriTarget::File(file) => {
                        let bytes = match find_file(&file, &[folder]) {
                            Some(found) => {
                                notes.add_file(&found.path);
                                std::fs::read(found.path).map_err(|cause| cause.to_string())
                            }
                            None => Err("no such file".into()),
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
        Self { root, data }
    }

    /// Returns the bytes of a view, and its stride if it has one.
    pub(super) fn view(&self, index: Index<buffer::View>) -> Option<(&[u8], Option<usize>)> {
        let view = self.root.buffer_views.get(index.value())?;
        let data = self.data.get(view.buffer.value())?.as_deref()?;
        let start = usize::try_from(view.byte_offset.unwrap_or_default().0).ok()?;
        let length = usize::try_from(view.byte_length.0).ok()?;
        let bytes = data.get(start..start.checked_add(length)?)?;
        Some((bytes, view.byte_stride.map(|stride| stride.0)))
    }

    /// Returns true if an accessor has a buffer view, whose size limits the number of entries.
    pub(super) fn has_bytes(&self, index: Index<Accessor>) -> bool {
        self.root
            .accessors
            .get(index.value())
            .is_some_and(|accessor| accessor.buffer_view.is_some())
    }

    /// Reads an accessor as vectors of `N` components, without further components. Returns `None`
    /// if it has fewer or is damaged.
    pub(super) fn vectors<const N: usize>(&self, index: Index<Accessor>) -> Option<Vec<[f64; N]>> {
        let accessor = self.root.accessors.get(index.value())?;
        let layout = Layout::new(accessor)?;
        let count = usize::try_from(accessor.count.0).ok()?;
        let mut values = match accessor.buffer_view {
            Some(view) => {
                let offset = usize::try_from(accessor.byte_offset.unwrap_or_default().0).ok()?;
                self.entries(view, offset, count, layout)?
            }
            None if count <= MAX_ZEROS => vec![[0.0; N]; count],
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
        let (value, greatest) = match self.component {
            ComponentType::I8 => (f64::from(bytes[0].cast_signed()), 127.0),
            ComponentType::U8 => (f64::from(bytes[0]), 255.0),
            ComponentType::I16 => (f64::from(i16::from_le_bytes(two())), 32_767.0),
            ComponentType::U16 => (f64::from(u16::from_le_bytes(two())), 65_535.0),
            ComponentType::U32 => (f64::from(u32::from_le_bytes(four())), 4_294_967_295.0),
            ComponentType::F32 => return f64::from(f32::from_le_bytes(four())),
        };
        if self.normalized {
            (value / greatest).max(-1.0)
        } else {
            value
        }
    }
}
