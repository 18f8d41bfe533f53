//! Geometry of a home without an OBJ export, built from the plan and the models and images of its
//! archive: walls with their openings, floors, ceilings and furniture. It is written as the OBJ
//! that Sweet Home 3D exports, with the same groups, so that all further steps are the same.
//!
//! Differences from an export: joined walls intersect instead of being mitred, arc walls consist of
//! straight pieces, normals and baseboards are missing, furniture whose model is not an OBJ is a
//! box, and holes of walls are rectangles.

use super::archive::{Archive, Corner, FaceGroup, Model};
use super::plan::finish::{Finish, Repeated};
use super::plan::home::{FurniturePiece, Home, Opening, Room};
use super::plan::walls::Wall;
use crate::polygon::area_normal;
use glam::{Affine2, DMat3, DVec2, DVec3};
use headbox_core::color::linear_from_srgb;
use headbox_scene::load::lines::without_comment;
use headbox_scene::load::mtl::{Map, MtlMaterial};
use headbox_scene::load::obj::EmbeddedImages;
use std::collections::HashSet;
use std::fmt::Write as _;

/// sRGB colours, as Sweet Home 3D exports them, of material names that models do not define.
const KNOWN_COLORS: [(&str, [f32; 3]); 18] = [
    ("amber", [0.5755, 0.2678, 0.0]),
    ("black", [0.002; 3]),
    ("dkdkgrey", [0.0122; 3]),
    ("dkgrey", [0.049; 3]),
    ("flblonde", [0.5714, 0.3283, 0.0443]),
    ("fldkgrey", [0.0939; 3]),
    ("flgrey", [0.5; 3]),
    ("flltbrown", [0.2776, 0.1143, 0.0531]),
    ("flltgrey", [0.8245; 3]),
    ("grey", [0.1837; 3]),
    ("ltgrey", [0.3837; 3]),
    ("red", [0.7714, 0.0, 0.0]),
    ("sand_stone", [0.1256, 0.1138, 0.0965]),
    ("silver", [0.6163; 3]),
    ("white", [1.0; 3]),
    ("yellow", [1.0, 0.6667, 0.0]),
    ("yellow_green", [0.1875, 0.4082, 0.0017]),
    ("yellowbrt", [1.0, 0.7837, 0.0]),
];

/// Colour of surfaces without a finish, linear RGB.
const NEUTRAL: [f32; 3] = [0.7; 3];

/// Sine of the greatest angle between a wall and an opening that belongs to it.
const MAX_SINE: f64 = 0.1;

/// Sine of the greatest angle between a piece of an arc wall and an opening that cuts it.
const MAX_ARC_SINE: f64 = 0.87;

/// Greatest distance of an opening's middle from the faces of its wall, centimetres.
const NEAR_WALL: f64 = 5.0;

/// A home as an OBJ.
pub(crate) struct PlainHome<'a> {
    /// OBJ text, centimetres, Y up.
    pub(crate) text: String,
    /// Materials of the OBJ.
    pub(crate) materials: Vec<MtlMaterial>,
    /// Images of its materials by the names of their maps.
    pub(super) pictures: EmbeddedImages,
    /// Models of the pieces of furniture replaced by boxes, empty for a piece without one.
    pub(crate) boxes: Vec<String>,
    pub(crate) archive: Archive<'a>,
    vertices: usize,
    texcoords: usize,
    /// Names of the materials so far.
    material_names: HashSet<String>,
}

impl<'a> PlainHome<'a> {
    /// Builds a home; `archive` has models and images.
    pub(crate) fn new(home: &Home, archive: &'a [u8]) -> Self {
        let mut plain = Self {
            text: String::new(),
            materials: Vec::new(),
            pictures: EmbeddedImages::new(),
            boxes: Vec::new(),
            archive: Archive::new(archive),
            vertices: 0,
            texcoords: 0,
            material_names: HashSet::new(),
        };
        for (i, room) in home.rooms.iter().enumerate() {
            plain.room(i, room);
        }
        for (i, wall) in home.walls.iter().enumerate() {
            plain.wall(i, wall, &home.openings);
        }
        for (i, piece) in home.pieces.iter().enumerate() {
            plain.piece(i, piece);
        }
        plain
    }

    fn group(&mut self, name: std::fmt::Arguments) {
        // Writing to a string cannot fail.
        let _ = writeln!(self.text, "g {name}");
    }

    /// Sets the material of the following triangles; creates it if it is new.
    fn paint(&mut self, name: String, material: impl FnOnce() -> MtlMaterial) {
        let _ = writeln!(self.text, "usemtl {name}");
        if self.material_names.insert(name.clone()) {
            let material = MtlMaterial { name, ..material() };
            for map in [
                &material.diffuse_map,
                &material.emissive_map,
                &material.dissolve_map,
            ]
            .into_iter()
            .flatten()
            {
                if !self.pictures.contains_key(&map.file)
                    && let Some(bytes) = self.archive.file(&map.file)
                {
                    self.pictures.insert(map.file.clone(), bytes);
                }
            }
            self.materials.push(material);
        }
    }

    fn paint_color(&mut self, color: [f32; 3]) {
        let [r, g, b] = color.map(f32::to_bits);
        self.paint(format!("color_{r:x}_{g:x}_{b:x}"), || MtlMaterial {
            diffuse: Some(color),
            ..MtlMaterial::default()
        });
    }

    fn paint_finish(&mut self, finish: &Finish) {
        let Some(picture) = &finish.picture else {
            return self.paint_color(finish.color.unwrap_or(NEUTRAL));
        };
        self.paint(format!("picture_{}", picture.image), || MtlMaterial {
            diffuse_map: Some(Map {
                file: picture.image.clone(),
                image_from_vertex: Affine2::IDENTITY,
                ignored_options: Vec::new(),
                clamp: false,
            }),
            ..MtlMaterial::default()
        });
    }

    fn vertex(&mut self, p: DVec3) {
        self.vertices += 1;
        let _ = writeln!(self.text, "v {} {} {}", p.x, p.y, p.z);
    }

    /// Adds a texture coordinate and returns its index.
    fn texcoord(&mut self, t: DVec2) -> usize {
        self.texcoords += 1;
        let _ = writeln!(self.text, "vt {} {}", t.x, t.y);
        self.texcoords - 1
    }

    /// Writes a polygon with the given vertex indices.
    fn face(&mut self, corners: impl Iterator<Item = Corner>) {
        self.text.push('f');
        for (position, texcoord) in corners {
            let _ = match texcoord {
                Some(texcoord) => write!(self.text, " {}/{}", position + 1, texcoord + 1),
                None => write!(self.text, " {}", position + 1),
            };
        }
        self.text.push('\n');
    }

    /// Writes a polygon whose front is in the direction of `normal`. `place` returns the position
    /// of a corner on the finish, centimetres to the right and up.
    fn polygon(
        &mut self,
        finish: &Finish,
        corners: &[DVec3],
        normal: DVec3,
        place: impl Fn(DVec3) -> DVec2,
    ) {
        self.paint_finish(finish);
        let first = self.vertices;
        corners.iter().for_each(|&corner| self.vertex(corner));
        let texcoords: Option<Vec<usize>> = finish.picture.as_ref().map(|picture| {
            corners
                .iter()
                .map(|&corner| self.texcoord(picture.texcoord(place(corner))))
                .collect()
        });
        let corner = |i: usize| (first + i, texcoords.as_ref().map(|texcoords| texcoords[i]));
        let numbers = 0..corners.len();
        if area_normal(corners).dot(normal) < 0.0 {
            self.face(numbers.rev().map(corner));
        } else {
            self.face(numbers.map(corner));
        }
    }

    fn room(&mut self, index: usize, room: &Room) {
        let floor: Vec<DVec3> = room
            .outline
            .iter()
            .map(|p| DVec3::new(p.x, room.floor, p.y))
            .collect();
        if room.has_floor {
            self.group(format_args!("room_{}_1", index + 1));
            self.polygon(&room.floor_finish, &floor, DVec3::Y, |p| {
                DVec2::new(p.x, -p.z)
            });
        }
        if room.covered {
            self.group(format_args!("room_{}_2", index + 1));
            self.polygon(
                &room.ceiling_finish,
                &room.ceiling_corners(),
                DVec3::NEG_Y,
                |p| DVec2::new(p.x, p.z),
            );
        }
    }

    fn wall(&mut self, index: usize, wall: &Wall, openings: &[Opening]) {
        let Some(along) = (wall.end - wall.start).try_normalize() else {
            return;
        };
        let length = wall.start.distance(wall.end);
        let half = wall.thickness / 2.0;
        let [before, after] = wall.extension.map(Option::unwrap_or_default);
        let [from, to] = [-before, length + after];
        let left = DVec2::new(along.y, -along.x);
        let top = |s: f64| {
            wall.bottom + wall.heights[0] + (wall.heights[1] - wall.heights[0]) * (s / length)
        };
        // The point at `s` along the wall, `offset` to the left of its middle line.
        let at = |s: f64, offset: f64, y: f64| {
            let p = wall.start + along * s + left * offset;
            DVec3::new(p.x, y.min(top(s)), p.y)
        };
        let horizontal = |v: DVec2| DVec3::new(v.x, 0.0, v.y);
        let gaps: Vec<[[f64; 2]; 2]> = openings
            .iter()
            .filter_map(|opening| wall.gap(opening, along, [from, to]))
            .collect();
        self.group(format_args!("wall_{}_1", index + 1));
        // Seen from the left side, the direction from start to end is to the left.
        let sides = [
            (half, &wall.finishes[0], -1.0),
            (-half, &wall.finishes[1], 1.0),
        ];
        let along_side = |p: DVec3, sign: f64| {
            DVec2::new((DVec2::new(p.x, p.z) - wall.start).dot(along) * sign, p.y)
        };
        let plain = Finish {
            picture: None,
            ..wall.finishes[0].clone()
        };
        let origin = |_| DVec2::ZERO; // the finish has no picture
        let mut cuts: Vec<f64> = gaps
            .iter()
            .flat_map(|[span, _]| *span)
            .chain([from, to])
            .collect();
        cuts.sort_by(f64::total_cmp);
        for ends in cuts.windows(2).filter(|ends| ends[1] - ends[0] > 1e-6) {
            let [a, b] = [ends[0], ends[1]];
            let here = gaps
                .iter()
                .filter(|[span, _]| span[0] <= a && b <= span[1])
                .map(|[_, heights]| *heights);
            let solid = solid_parts([wall.lower_edge, f64::INFINITY], here);
            let across = |y: f64| {
                [
                    at(a, half, y),
                    at(b, half, y),
                    at(b, -half, y),
                    at(a, -half, y),
                ]
            };
            if solid.first().is_none_or(|[low, _]| *low > wall.lower_edge) {
                // The floor of a doorway, which belongs to no room.
                self.polygon(&plain, &across(wall.lower_edge), DVec3::Y, origin);
            }
            for [low, high] in solid {
                if low >= top(a).max(top(b)) {
                    continue;
                }
                for (offset, finish, sign) in sides {
                    let corners = [
                        at(a, offset, low),
                        at(b, offset, low),
                        at(b, offset, high),
                        at(a, offset, high),
                    ];
                    self.polygon(finish, &corners, horizontal(left * offset), |p| {
                        along_side(p, sign)
                    });
                }
                let top_finish = wall.top_finish.as_ref().filter(|_| high == f64::INFINITY);
                let upper = top_finish.unwrap_or(&plain);
                self.polygon(upper, &across(high), DVec3::Y, origin);
                if low > wall.lower_edge {
                    self.polygon(&plain, &across(low), DVec3::NEG_Y, origin);
                }
            }
        }
        // End faces: jambs of openings, then the ends of the wall.
        let mut end_face = |s: f64, [low, high]: [f64; 2], sign: f64| {
            let corners = [
                at(s, half, low),
                at(s, -half, low),
                at(s, -half, high),
                at(s, half, high),
            ];
            self.polygon(&plain, &corners, horizontal(along * sign), origin);
        };
        for [span, heights] in gaps {
            if span[0] > from {
                end_face(span[0], heights, 1.0);
            }
            if span[1] < to {
                end_face(span[1], heights, -1.0);
            }
        }
        for (s, extension, sign) in [
            (from, wall.extension[0], -1.0),
            (to, wall.extension[1], 1.0),
        ] {
            if extension.is_none() {
                end_face(s, [wall.lower_edge, f64::INFINITY], sign);
            }
        }
    }

    fn piece(&mut self, index: usize, piece: &FurniturePiece) {
        let kind = if piece.is_opening { "door" } else { "piece" };
        let turn = DMat3::from_rotation_y(-piece.angle) * piece.tilt.unwrap_or(DMat3::IDENTITY);
        // A tilted piece stands on the lowest corner of its box.
        let half_height = match piece.tilt {
            Some(_) => turn.transpose().y_axis.abs().dot(piece.size) / 2.0,
            None => piece.size.y / 2.0,
        };
        let place = |p: DVec3| {
            turn * p
                + DVec3::new(
                    piece.centre.x,
                    piece.elevation + half_height,
                    piece.centre.y,
                )
        };
        let model = piece
            .model
            .as_deref()
            .and_then(|name| Some((name, self.archive.model(name)?)));
        let Some((name, model)) = model else {
            // A door without a model leaves a hole in its wall.
            if !piece.is_opening {
                self.boxes.push(piece.model.clone().unwrap_or_default());
                self.group(format_args!("{kind}_{}_box_1", index + 1));
                self.cuboid(piece, place, turn);
            }
            return;
        };
        let rotation = piece.rotation.unwrap_or(DMat3::IDENTITY);
        let rotated: Vec<DVec3> = model.positions.iter().map(|&p| rotation * p).collect();
        let low = rotated.iter().copied().fold(DVec3::INFINITY, DVec3::min);
        let high = rotated
            .iter()
            .copied()
            .fold(DVec3::NEG_INFINITY, DVec3::max);
        let extent = (high - low).max(DVec3::splat(f64::MIN_POSITIVE));
        let mirror = if piece.mirrored {
            DVec3::new(-1.0, 1.0, 1.0)
        } else {
            DVec3::ONE
        };
        let scaled: Vec<DVec3> = rotated
            .into_iter()
            .map(|p| (p - (low + high) / 2.0) / extent * piece.size * mirror)
            .collect();
        let first = [self.vertices, self.texcoords];
        scaled.iter().for_each(|&p| self.vertex(place(p)));
        model.texcoords.iter().for_each(|&t| _ = self.texcoord(t));
        for (part, faces) in model.parts.iter().enumerate() {
            self.group(format_args!(
                "{kind}_{}_{}_{}",
                index + 1,
                faces.group,
                part + 1
            ));
            let finish = self.paint_part(piece, name, &model, faces);
            for polygon in &faces.polygons {
                let corners: Vec<Corner> = polygon
                    .iter()
                    .map(|&(position, texcoord)| {
                        let own = texcoord.map(|texcoord| first[1] + texcoord);
                        // Textures of the home on a model without texture coordinates are projected
                        // on its front and its top.
                        let projected = |picture: &Repeated| {
                            let p = scaled[position];
                            picture.texcoord(DVec2::new(p.x, p.y - p.z))
                        };
                        let picture = finish.as_ref().and_then(|finish| finish.picture.as_ref());
                        let texcoord = own.or_else(|| Some(self.texcoord(projected(picture?))));
                        (first[0] + position, texcoord)
                    })
                    .collect();
                let corners = corners.into_iter();
                if piece.mirrored {
                    self.face(corners.rev());
                } else {
                    self.face(corners);
                }
            }
        }
    }

    /// Sets the material of a part of a model to the home's finish, which is returned, or else to
    /// that of the model.
    fn paint_part(
        &mut self,
        piece: &FurniturePiece,
        name: &str,
        model: &Model,
        faces: &FaceGroup,
    ) -> Option<Finish> {
        let written = faces.material.as_str();
        let bare = without_comment(written).unwrap_or(written);
        let own = piece
            .materials
            .iter()
            .find(|(name, _)| name == written || name == bare)
            .map(|(_, finish)| finish);
        if let Some(finish) = own.or(Some(&piece.finish).filter(|finish| finish.is_specified())) {
            self.paint_finish(finish);
            return Some(finish.clone());
        }
        if let Some(index) = model.names.find(written) {
            let material = &model.materials[index];
            self.paint(format!("model_{name}_{}", material.name), || {
                material.clone()
            });
            return None;
        }
        let known = KNOWN_COLORS
            .iter()
            .find(|(name, _)| *name == bare)
            .map(|(_, color)| color.map(linear_from_srgb));
        self.paint_color(known.unwrap_or(NEUTRAL));
        None
    }

    fn cuboid(&mut self, piece: &FurniturePiece, place: impl Fn(DVec3) -> DVec3, turn: DMat3) {
        let half = piece.size / 2.0;
        for axis in 0..3 {
            let [u, v] = [
                DVec3::AXES[(axis + 1) % 3] * half,
                DVec3::AXES[(axis + 2) % 3] * half,
            ];
            for side in [-1.0, 1.0] {
                let middle = DVec3::AXES[axis] * half * side;
                let corners = [
                    middle - u - v,
                    middle + u - v,
                    middle + u + v,
                    middle - u + v,
                ]
                .map(&place);
                self.polygon(
                    &piece.finish,
                    &corners,
                    turn * DVec3::AXES[axis] * side,
                    |p| DVec2::new(p.x, p.y - p.z),
                );
            }
        }
    }
}

impl Wall {
    /// Returns the gap that an opening leaves in the wall, a range along it and one in height, or
    /// `None` if the opening is not in this wall. `along` is the wall's direction and `from` and
    /// `to` are its ends.
    fn gap(&self, opening: &Opening, along: DVec2, [from, to]: [f64; 2]) -> Option<[[f64; 2]; 2]> {
        let left = DVec2::new(along.y, -along.x);
        let middle = opening.in_wall() - self.start;
        let slope = opening.along.dot(along).abs();
        let sine = opening.along.perp_dot(along).abs();
        // Where the wall crosses the sides of the opening; straight walls are along it.
        let (s, half) = if self.is_arc && sine < MAX_ARC_SINE {
            let s = middle.dot(opening.along) / opening.along.dot(along);
            (s, opening.width / 2.0 / slope)
        } else {
            (middle.dot(along), opening.width / 2.0)
        };
        let span = [(s - half).max(from), (s + half).min(to)];
        let [low, high] = opening.heights;
        let low = if low <= self.bottom + 0.1 {
            self.bottom
        } else {
            low
        };
        let is_in_wall = if self.is_arc {
            let part = along * ((span[0] + span[1]) / 2.0) - middle;
            let reach = (self.thickness + opening.wall_thickness) / 2.0 + NEAR_WALL;
            part.dot(opening.across()).abs() <= reach && sine < MAX_ARC_SINE
        } else {
            middle.dot(left).abs() <= self.thickness / 2.0 + NEAR_WALL && sine < MAX_SINE
        };
        (is_in_wall && span[0] < span[1] && low < high).then_some([span, [low, high]])
    }
}

/// Returns the parts of a range outside gaps, from below.
fn solid_parts(whole: [f64; 2], gaps: impl Iterator<Item = [f64; 2]>) -> Vec<[f64; 2]> {
    gaps.fold(vec![whole], |parts, [low, high]| {
        let cut = |[from, to]: [f64; 2]| [[from, to.min(low)], [from.max(high), to]];
        parts
            .into_iter()
            .flat_map(cut)
            .filter(|[from, to]| from < to)
            .collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solid_parts_exclude_gaps() {
        let parts = |gaps: &[[f64; 2]]| solid_parts([0.0, 9.0], gaps.iter().copied());
        assert_eq!(parts(&[]), [[0.0, 9.0]]);
        assert_eq!(parts(&[[0.0, 2.0]]), [[2.0, 9.0]]);
        assert_eq!(
            parts(&[[1.0, 2.0], [5.0, 6.0]]),
            [[0.0, 1.0], [2.0, 5.0], [6.0, 9.0]]
        );
        assert_eq!(parts(&[[1.0, 5.0], [3.0, 6.0]]), [[0.0, 1.0], [6.0, 9.0]]);
        assert!(parts(&[[-1.0, 10.0]]).is_empty());
    }
}
