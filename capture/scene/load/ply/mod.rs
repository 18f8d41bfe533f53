//! PLY meshes: ASCII and binary in both byte orders.
//!
//! The format leaves the names of properties open; those of the common scanning programs are read.
//! * Vertex colours are sRGB: bytes, 16-bit numbers, or floats in 0..1.
//! * Images are named in `TextureFile` comments. Texture coordinates are those of a face's corners
//!   (`texcoord`), else those of vertices; `texnumber` is the index of a face's image.
//! * Strips of triangles (`tristrips`) end at -1.
//!
//! Axes and unit are guessed as those of an OBJ.

mod header;
mod records;
#[cfg(test)]
mod tests;

use super::builder::{Builder, GroupedScene};
use super::notes::{Note, Notes};
use super::obj::CUTOUT_THRESHOLD;
use super::orientation::{AxisAreas, FrameHints, comment_words};
use super::polygon::triangulate;
use super::textures::{DecodedTextures, Role, Slot, TextureTable};
use super::vertex_colors::VertexColors;
use super::{LoadError, LoadOptions, SPLATS_REFUSED, file_stem, folder_of};
use crate::material::{Cutout, Material};
use crate::scene::Vertex;
use glam::{DVec3, Vec2, Vec3};
use headbox_core::color::linear_from_srgb;
use headbox_core::files::InputFolder;
use header::{Element, Header, Type};
use records::{Record, Records};
use std::path::Path;

/// Loads a PLY with its images.
pub(super) fn load(
    path: &Path,
    bytes: &[u8],
    options: &LoadOptions,
    groups: bool,
) -> Result<GroupedScene, LoadError> {
    let malformed = |cause: String| LoadError::malformed(path, cause);
    let header = Header::parse(bytes).map_err(malformed)?;
    check_kind(&header).map_err(malformed)?;
    let hints = FrameHints {
        options: *options,
        comments: comment_words(header.comments.lines()),
        floors: AxisAreas::default(),
    };
    let mut notes = Notes::default();
    let mesh = Mesh::read(bytes, &header, &mut notes).map_err(malformed)?;

    let scene = InputFolder::new(folder_of(path));
    let mut table = TextureTable::default();
    let handles: Vec<_> = header
        .textures
        .iter()
        .filter(|_| mesh.has_texcoords())
        .map(|name| table.file(name, scene.path(), &scene, Role::Color.into(), &mut notes))
        .collect();
    if !header.textures.is_empty() && handles.is_empty() {
        notes.add(Note::TextureWithoutCoordinates, header.textures.len());
    }
    let textures = table.decode(&mut notes);
    let images: Vec<Option<Slot>> = handles
        .into_iter()
        .map(|handle| textures.slot(handle))
        .collect();

    let mut builder = Builder::with_hints(hints, notes);
    if groups {
        builder.begin_group(&file_stem(path));
    }
    let materials = mesh.materials(&images);
    mesh.push(images.len(), &mut builder)
        .map_err(|error| error.in_file(path))?;
    let DecodedTextures { textures, .. } = textures;
    builder.finish(path, materials, textures)
}

/// Refuses point clouds and splats.
fn check_kind(header: &Header) -> Result<(), String> {
    let element = |name: &str| header.elements.iter().find(|element| element.name == name);
    let vertex = element("vertex").ok_or("it has no vertices")?;
    let splats = ["f_dc_0", "rot_0", "scale_0", "packed_position"];
    if vertex.find(&splats).is_some() {
        return Err(SPLATS_REFUSED.into());
    }
    let has_faces = |name: &str| element(name).is_some_and(|element| element.count > 0);
    if !has_faces("face") && !has_faces("tristrips") {
        return Err(format!(
            "a cloud of {} points without a face, not a mesh; reconstruct a surface first (for \
             example in MeshLab: Filters > Remeshing > Screened Poisson)",
            vertex.count
        ));
    }
    Ok(())
}

/// Vertices and faces of a file.
#[derive(Default)]
struct Mesh {
    positions: Vec<DVec3>,
    normals: Vec<Vec3>,
    texcoords: Vec<Vec2>,
    /// sRGB colours of vertices, or else of faces.
    vertex_colors: Vec<[f64; 3]>,
    face_colors: Vec<[f64; 3]>,
    faces: Vec<Face>,
    /// Vertices of the corners of all faces.
    corners: Vec<u32>,
    /// Texture coordinates of the corners of all faces.
    corner_texcoords: Vec<Vec2>,
}

/// A polygon.
struct Face {
    /// Number of corners.
    corners: u32,
    /// Index of its image.
    image: u32,
}

impl Mesh {
    fn read(bytes: &[u8], header: &Header, notes: &mut Notes) -> Result<Self, String> {
        let mut mesh = Self::default();
        let mut records = Records::new(bytes, header);
        for element in &header.elements {
            match element.name.as_str() {
                "vertex" => mesh.read_vertices(&mut records, element, notes)?,
                "face" => mesh.read_faces(&mut records, element, notes)?,
                "tristrips" => mesh.read_strips(&mut records, element)?,
                name => {
                    if element.count > 0 {
                        notes.add_named(Note::ElementSkipped, name);
                    }
                    records.read(element, |_| {})?;
                }
            }
        }
        Ok(mesh)
    }

    fn read_vertices(
        &mut self,
        records: &mut Records,
        element: &Element,
        notes: &mut Notes,
    ) -> Result<(), String> {
        let position =
            find_all(element, [&["x"], &["y"], &["z"]]).ok_or("its vertices have no x, y and z")?;
        let normal = find_all(element, [&["nx"], &["ny"], &["nz"]]);
        let texcoord = find_all(
            element,
            [
                &["s", "u", "texture_u", "texture_s"],
                &["t", "v", "texture_v", "texture_t"],
            ],
        );
        let color = Color::find(element);
        let alpha = element.find(&["alpha", "a"]);
        let mut colors = VertexColors::default();
        let mut index = 0;
        records.read(element, |record| {
            let position = DVec3::from(record.values(position));
            if !position.is_finite() {
                notes.add_numbered(Note::VertexNotFinite, "vertex", index);
            }
            index += 1;
            self.positions.push(position);
            if let Some(normal) = normal {
                self.normals
                    .push(DVec3::from(record.values(normal)).as_vec3());
            }
            if let Some(texcoord) = texcoord {
                self.texcoords.push(texcoord_from(record.values(texcoord)));
            }
            if let Some(color) = &color {
                colors.add_vertex(Some(Some(color.read(record))));
            }
            if let Some(alpha) = alpha {
                let white = element.properties[alpha].value.white();
                let is_transparent = record.value(alpha) < white;
                notes.add(Note::VertexAlphaIgnored, usize::from(is_transparent));
            }
        })?;
        self.vertex_colors = colors.finish(notes);
        Ok(())
    }

    fn read_faces(
        &mut self,
        records: &mut Records,
        element: &Element,
        notes: &mut Notes,
    ) -> Result<(), String> {
        let corners = element
            .find(&["vertex_indices", "vertex_index"])
            .ok_or("its faces have no vertex_indices")?;
        let texcoord = element.find(&["texcoord"]);
        let image = element.find(&["texnumber"]);
        let color = Color::find(element);
        let mut colors = VertexColors::default();
        records.read(element, |record| {
            let list = record.list(corners);
            self.push_face(list, image.map_or(0.0, |image| record.value(image)));
            if let Some(color) = &color {
                colors.add_vertex(Some(Some(color.read(record))));
            }
            if let Some(texcoord) = texcoord {
                let numbers = record.list(texcoord);
                let is_complete = numbers.len() == 2 * list.len();
                notes.add(
                    Note::FaceTexcoordMissing,
                    usize::from(!is_complete && !list.is_empty()),
                );
                for corner in 0..list.len() {
                    self.corner_texcoords.push(if is_complete {
                        texcoord_from([numbers[2 * corner], numbers[2 * corner + 1]])
                    } else {
                        Vec2::ZERO
                    });
                }
            }
        })?;
        self.face_colors = colors.finish(notes);
        Ok(())
    }

    fn read_strips(&mut self, records: &mut Records, element: &Element) -> Result<(), String> {
        let strips = element
            .find(&["vertex_indices", "vertex_index"])
            .ok_or("its strips have no vertex_indices")?;
        records.read(element, |record| {
            for strip in record.list(strips).split(|&index| index < 0.0) {
                for (i, triangle) in strip.windows(3).enumerate() {
                    let [a, b, c] = [triangle[0], triangle[1], triangle[2]];
                    let is_repeat = a == b || b == c || a == c; // joins parts of a strip
                    match i % 2 {
                        _ if is_repeat => {}
                        0 => self.push_face(&[a, b, c], 0.0),
                        _ => self.push_face(&[b, a, c], 0.0),
                    }
                }
            }
        })
    }

    fn push_face(&mut self, corners: &[f64], image: f64) {
        // Numbers that are not indices become one that is out of range.
        let index = |&index: &f64| {
            if index >= 0.0 && index < f64::from(u32::MAX) {
                index as u32
            } else {
                u32::MAX
            }
        };
        self.corners.extend(corners.iter().map(index));
        self.faces.push(Face {
            corners: corners.len() as u32,
            image: index(&image),
        });
    }

    fn has_texcoords(&self) -> bool {
        !self.texcoords.is_empty() || !self.corner_texcoords.is_empty()
    }

    /// Returns a material for each image, and one for faces without.
    fn materials(&self, images: &[Option<Slot>]) -> Vec<Material> {
        let plain = Material::default();
        let is_coloured = !self.vertex_colors.is_empty() || !self.face_colors.is_empty();
        let material = |image: Option<Slot>| Material {
            albedo: if is_coloured || image.is_some() {
                [1.0; 3]
            } else {
                plain.albedo
            },
            albedo_texture: image.map(|image| image.index),
            cutout: image
                .filter(|image| image.is_cut_at(CUTOUT_THRESHOLD))
                .map(|image| Cutout {
                    texture: Some(image.index),
                    threshold: CUTOUT_THRESHOLD,
                }),
            ..plain.clone()
        };
        images.iter().copied().chain([None]).map(material).collect()
    }

    /// Adds the triangles. Materials are numbered as the `images`, then that without one.
    fn push(&self, images: usize, builder: &mut Builder) -> Result<(), super::builder::MeshError> {
        let colors_of_faces = !self.face_colors.is_empty() && self.vertex_colors.is_empty();
        let is_split = !self.corner_texcoords.is_empty() || colors_of_faces;
        let vertex = |index: usize, corner: usize, face: usize| {
            let color = if colors_of_faces {
                self.face_colors.get(face)
            } else {
                self.vertex_colors.get(index)
            };
            let texcoords = if self.corner_texcoords.is_empty() {
                self.texcoords.get(index)
            } else {
                self.corner_texcoords.get(corner)
            };
            Vertex {
                position: self.positions[index],
                normal: self.normals.get(index).copied().unwrap_or(Vec3::ZERO),
                texcoord: texcoords.copied().unwrap_or(Vec2::ZERO),
                emission_texcoord: Vec2::ZERO,
                opacity: 1.0,
                color: color.map_or(Vec3::ONE, |color| {
                    Vec3::from(color.map(|c| linear_from_srgb(c as f32)))
                }),
            }
        };
        if !is_split {
            builder.next_vertex(self.positions.len())?;
            for index in 0..self.positions.len() {
                builder.push_vertex(vertex(index, 0, 0));
            }
        }
        let mut first = 0;
        for (number, face) in self.faces.iter().enumerate() {
            let corners = &self.corners[first..][..face.corners as usize];
            let first_corner = first;
            first += corners.len();
            if corners.len() < 3 {
                builder.notes.add(Note::FaceTooShort, 1);
                continue;
            }
            let positions: Option<Vec<DVec3>> = corners
                .iter()
                .map(|&corner| self.positions.get(corner as usize).copied())
                .collect();
            let Some(positions) = positions else {
                builder.notes.add(Note::FaceIndexOutOfRange, 1);
                continue;
            };
            let material = (face.image as usize).min(images) as u32;
            let split = if is_split {
                let split = builder.next_vertex(corners.len())?;
                for (i, &index) in corners.iter().enumerate() {
                    builder.push_vertex(vertex(index as usize, first_corner + i, number));
                }
                Some(split)
            } else {
                None
            };
            for triangle in triangulate(&positions) {
                let vertices = triangle.map(|corner| match split {
                    Some(split) => split + corner as u32,
                    None => corners[corner],
                });
                builder.push_triangle(vertices, material);
            }
        }
        Ok(())
    }
}

/// Properties of a colour.
struct Color {
    properties: [usize; 3],
    white: f64,
}

impl Color {
    fn find(element: &Element) -> Option<Self> {
        let names = [
            ["red", "r", "diffuse_red"],
            ["green", "g", "diffuse_green"],
            ["blue", "b", "diffuse_blue"],
        ];
        let properties = find_all(element, names.each_ref().map(<[_; 3]>::as_slice))?;
        let value = element.properties[properties[0]].value;
        Some(Self {
            properties,
            // Programs write bytes as `ushort`, too: their values show it.
            white: if value == Type::U16 {
                1.0
            } else {
                value.white()
            },
        })
    }

    fn read(&self, record: &Record) -> [f64; 3] {
        record.values(self.properties).map(|c| c / self.white)
    }
}

fn find_all<const N: usize>(element: &Element, names: [&[&str]; N]) -> Option<[usize; N]> {
    let mut found = [0; N];
    for (property, names) in found.iter_mut().zip(names) {
        *property = element.find(names)?;
    }
    Some(found)
}

fn texcoord_from([u, v]: [f64; 2]) -> Vec2 {
    Vec2::new(u as f32, v as f32)
}
