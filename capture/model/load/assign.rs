//! Assignment of the triangles of a scene to cells.

use super::split::{Corner, split_by_plane};
use crate::{PortalModel, Prism, distance_to_outline};
use glam::{DVec2, DVec3};
use headbox_scene::load::Group;
use headbox_scene::scene::{Scene, Triangle, Vertex};
use std::collections::HashMap;

/// Assignment of a group of triangles to cells.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Portion {
    /// The whole group belongs to this cell.
    Cell(u32),
    /// The group is left out.
    LeftOut,
    /// Each triangle belongs to the cell on its side of this portal.
    BySide(usize),
    /// All groups with this key belong to the cell that contains most of their area.
    Whole(String),
    /// Each triangle belongs to the cell that it faces, and is cut if it faces several.
    Facing,
}

/// Distance in front of a surface at which the cell that it faces is sampled, metres.
const BEFORE_M: f64 = 0.02;

/// Largest distance in plan of a surface that faces no room from the outline of its room, metres:
/// rooms are drawn by hand and may end slightly before the wall does. The outer faces of walls are
/// farther away by the thickness of the wall.
const BESIDE_M: f64 = BEFORE_M;

/// Assigns all triangles and sorts them by cell. Each group has a portion; triangles without a
/// group are [`Portion::Facing`].
pub(super) fn assign_triangles(model: &mut PortalModel, groups: &[Group], portions: &[Portion]) {
    let cells_by_key = cells_by_key(model, groups, portions);
    let mut by_triangle = vec![&Portion::Facing; model.scene.triangles.len()];
    for (group, portion) in groups.iter().zip(portions) {
        by_triangle[group.triangles.start as usize..group.triangles.end as usize].fill(portion);
    }
    let mut by_cell: Vec<Vec<Triangle>> = vec![Vec::new(); model.cells.len()];
    let mut scene = std::mem::take(&mut model.scene);
    let fallback = model.outside.unwrap_or_default();
    let mut assign = |cell: Option<u32>, triangle: Triangle| {
        if let Some(list) = by_cell.get_mut(cell.unwrap_or(fallback) as usize) {
            list.push(triangle);
        }
    };
    for (index, portion) in by_triangle.into_iter().enumerate() {
        let triangle = scene.triangles[index];
        match portion {
            Portion::LeftOut => {}
            Portion::Cell(cell) => assign(Some(*cell), triangle),
            Portion::BySide(portal) => {
                let [a, b, c] = scene.corners(index as u32);
                let centroid = (a + b + c) / 3.0;
                assign(cell_on_side(model, *portal, centroid), triangle);
            }
            Portion::Whole(key) => assign(cells_by_key.get(key.as_str()).copied(), triangle),
            Portion::Facing => {
                for (cell, piece) in split_by_faced_cell(model, &mut scene, triangle) {
                    assign(cell, piece);
                }
            }
        }
    }
    let mut end = 0;
    for (cell, list) in model.cells.iter_mut().zip(&by_cell) {
        cell.triangles = end..end + list.len() as u32;
        end = cell.triangles.end;
    }
    scene.triangles = by_cell.concat();
    model.scene = scene;
}

/// Returns the cell of each key of [`Portion::Whole`], by the area in each cell.
fn cells_by_key<'a>(
    model: &PortalModel,
    groups: &[Group],
    portions: &'a [Portion],
) -> HashMap<&'a str, u32> {
    let mut areas: HashMap<&str, Vec<f64>> = HashMap::new();
    for (group, portion) in groups.iter().zip(portions) {
        let Portion::Whole(key) = portion else {
            continue;
        };
        let shares = areas
            .entry(key)
            .or_insert_with(|| vec![0.0; model.cells.len()]);
        for triangle in group.triangles.clone() {
            let [a, b, c] = model.scene.corners(triangle);
            let cell = model.cell_at((a + b + c) / 3.0);
            if let Some(share) = cell.and_then(|cell| shares.get_mut(cell as usize)) {
                *share += (b - a).cross(c - a).length();
            }
        }
    }
    let largest = |shares: &Vec<f64>| {
        shares
            .iter()
            .enumerate()
            .max_by(|a, b| a.1.total_cmp(b.1))
            .map(|(i, _)| i as u32)
    };
    areas
        .iter()
        .filter_map(|(&key, shares)| Some((key, largest(shares)?)))
        .collect()
}

/// Returns the cell of a portal on the side of a point.
fn cell_on_side(model: &PortalModel, portal: usize, p: DVec3) -> Option<u32> {
    let portal = model.portals.get(portal)?;
    let &[a, b, c, ..] = portal.polygon.as_slice() else {
        return None;
    };
    let in_front = (b - a).cross(c - b).dot(p - a) >= 0.0;
    Some(portal.cells[usize::from(!in_front)])
}

/// Returns the mean of a polygon's corners.
fn centroid(polygon: &[Corner]) -> DVec3 {
    let positions = polygon.iter().map(|corner| corner.vertex.position);
    positions.sum::<DVec3>() / polygon.len() as f64
}

/// Cuts a triangle into pieces that face one cell each; returns the triangle itself if it faces one
/// cell.
fn split_by_faced_cell(
    model: &PortalModel,
    scene: &mut Scene,
    triangle: Triangle,
) -> Vec<(Option<u32>, Triangle)> {
    let corners = triangle
        .vertices
        .map(|vertex| Corner::from_vertex(scene, vertex));
    let [a, b, c] = corners.map(|corner| corner.vertex.position);
    let Some(normal) = (b - a).cross(c - a).try_normalize() else {
        return vec![(model.outside, triangle)];
    };
    let faced_cell = |polygon: &[Corner]| {
        let before = centroid(polygon) + normal * BEFORE_M;
        let inside = model.cell_at(before);
        if inside == model.outside {
            adjacent_room(model, before).or(inside)
        } else {
            inside
        }
    };
    let mut pieces = vec![corners.to_vec()];
    for [from, to] in borders_near(model, [a, b, c], normal) {
        let [from, across] = [from, (to - from).perp()].map(|v| DVec3::new(v.x, 0.0, v.y));
        pieces = pieces
            .into_iter()
            .flat_map(|piece| split_by_plane(piece, from, across))
            .collect();
    }
    // Walls may be higher than a ceiling and extend over several storeys.
    pieces = pieces
        .into_iter()
        .flat_map(|piece| split_by_storeys(model, piece, normal))
        .collect();
    let cells: Vec<Option<u32>> = pieces.iter().map(|piece| faced_cell(piece)).collect();
    if cells.iter().all(|cell| *cell == cells[0]) {
        return vec![(cells[0], triangle)];
    }
    let mut assigned = Vec::new();
    for (piece, cell) in pieces.into_iter().zip(cells) {
        let vertices: Vec<u32> = piece.iter().map(|corner| corner.vertex_in(scene)).collect();
        let fan = vertices.windows(2).skip(1).map(|pair| Triangle {
            vertices: [vertices[0], pair[0], pair[1]],
            material: triangle.material,
        });
        assigned.extend(fan.map(|triangle| (cell, triangle)));
    }
    assigned
}

/// Cuts a polygon in front of one room, in plan, at the heights of its floors and ceilings.
fn split_by_storeys(model: &PortalModel, piece: Vec<Corner>, normal: DVec3) -> Vec<Vec<Corner>> {
    let before = centroid(&piece) + normal * BEFORE_M;
    let plan = DVec2::new(before.x, before.z);
    let is_at_room = |prism: &&Prism| {
        prism.contains(before.with_y(prism.floor_y))
            || distance_to_outline(&prism.outline, plan) <= BESIDE_M
    };
    let prisms = model
        .cells
        .iter()
        .flat_map(|cell| &cell.space)
        .filter(is_at_room);
    let heights = prisms.flat_map(|prism| [prism.floor_y, prism.ceiling_y]);
    heights.fold(vec![piece], |pieces, height| {
        let split = |piece| split_by_plane(piece, DVec3::Y * height, DVec3::Y);
        pieces.into_iter().flat_map(split).collect()
    })
}

/// Returns the room whose outline is nearest to a point outside of rooms, within [`BESIDE_M`].
fn adjacent_room(model: &PortalModel, p: DVec3) -> Option<u32> {
    let rooms = (0u32..).zip(&model.cells);
    let prisms = rooms.flat_map(|(cell, it)| it.space.iter().map(move |prism| (cell, prism)));
    let plan = DVec2::new(p.x, p.z);
    let (cell, distance) = prisms
        .filter(|(_, prism)| (prism.floor_y..=prism.ceiling_y).contains(&p.y))
        .map(|(cell, prism)| (cell, distance_to_outline(&prism.outline, plan)))
        .min_by(|a, b| a.1.total_cmp(&b.1))?;
    (distance <= BESIDE_M).then_some(cell)
}

/// Returns the edges of the cells' outlines near a triangle, moved along its normal, in plan.
fn borders_near(model: &PortalModel, triangle: [DVec3; 3], normal: DVec3) -> Vec<[DVec2; 2]> {
    const MARGIN: f64 = 2.0 * BEFORE_M;
    let moved = triangle.map(|p| p + normal * BEFORE_M);
    let low = moved.into_iter().fold(DVec3::INFINITY, DVec3::min) - MARGIN;
    let high = moved.into_iter().fold(DVec3::NEG_INFINITY, DVec3::max) + MARGIN;
    let prisms = model.cells.iter().flat_map(|cell| &cell.space);
    let at_height = prisms.filter(|prism| prism.floor_y <= high.y && prism.ceiling_y >= low.y);
    let edges = at_height.flat_map(|prism| {
        let outline = &prism.outline;
        (0..outline.len()).map(move |i| [outline[i], outline[(i + 1) % outline.len()]])
    });
    edges
        .filter(|[from, to]| {
            let (least, most) = (from.min(*to), from.max(*to));
            least.x <= high.x && most.x >= low.x && least.y <= high.z && most.y >= low.z
        })
        .collect()
}

impl Corner {
    fn from_vertex(scene: &Scene, index: u32) -> Self {
        Self {
            vertex: scene.vertex(index),
            index: Some(index),
        }
    }

    /// Returns the index of the corner's vertex, which is added if it is new.
    fn vertex_in(&self, scene: &mut Scene) -> u32 {
        self.index.unwrap_or_else(|| {
            scene.add_vertex(Vertex {
                normal: self.vertex.normal.normalize_or_zero(),
                ..self.vertex
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Cell;
    use glam::dvec3;
    use headbox_scene::material::Material;

    /// A wall of 4 m in front of a room that is 1 cm shorter; its outer face; a wall 10 cm beyond
    /// the room.
    #[test]
    fn wall_slightly_longer_than_room_belongs_to_it() {
        let outline = [[0.0, 0.0], [3.99, 0.0], [3.99, 3.0], [0.0, 3.0]]
            .map(DVec2::from)
            .to_vec();
        let space = vec![Prism {
            outline,
            floor_y: 0.0,
            ceiling_y: 2.5,
        }];
        let cells = vec![Cell::new("room", space), Cell::new("outside", Vec::new())];
        // Facing +Z at z = 0, -Z at z = -0.1, and +Z again.
        let wall = |from: f64, to: f64, z: f64| {
            [dvec3(from, 0.0, z), dvec3(to, 0.0, z), dvec3(to, 2.0, z)]
        };
        let [a, b, c] = wall(0.0, 4.0, -0.1);
        let positions = [wall(0.0, 4.0, 0.0), [a, c, b], wall(4.09, 4.2, 0.0)].concat();
        let triangles = [[0, 1, 2], [3, 4, 5], [6, 7, 8]]
            .map(|vertices| Triangle {
                vertices,
                material: 0,
            })
            .to_vec();
        let scene = Scene {
            positions,
            triangles,
            materials: vec![Material::default()],
            ..Scene::default()
        };
        let mut model = PortalModel {
            scene,
            cells,
            portals: Vec::new(),
            outside: Some(1),
        };
        assign_triangles(&mut model, &[], &[]);
        let outside = &model.scene.triangles[model.cells[1].triangles.start as usize..];
        assert_eq!(
            outside
                .iter()
                .map(|triangle| triangle.vertices)
                .collect::<Vec<_>>(),
            [[3, 4, 5], [6, 7, 8]]
        );
        assert!(!model.cells[0].triangles.is_empty());
    }
}
