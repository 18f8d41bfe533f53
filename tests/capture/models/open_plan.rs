//! Homes with rooms that are open to each other: openings without walls become portals, and defects
//! of walls are reported by name.

use glam::DVec2;
use headbox_model::load::{LoadedModel, ModelOptions, load_model};
use headbox_model::{Finding, PortalModel};
use headbox_trace::bvh::Tracer;
use std::fmt::Write as _;
use std::sync::Arc;

/// A home of four bedrooms along a corridor, 1.1 m wide, that ends without a door in a living room;
/// the kitchen is in the same room, behind a counter. Centimetres; walls 10 cm thick about their
/// lines.
struct Plan {
    xml: String,
    walls: usize,
}

impl Plan {
    fn new() -> Self {
        Self {
            xml: "<home wallHeight='250'>".into(),
            walls: 0,
        }
    }

    fn room(mut self, name: &str, [x0, y0]: [f64; 2], [x1, y1]: [f64; 2]) -> Self {
        let corners = [[x0, y0], [x1, y0], [x1, y1], [x0, y1]];
        let points: String = corners
            .iter()
            .map(|[x, y]| format!("<point x='{x}' y='{y}'/>"))
            .collect();
        write!(self.xml, "<room name='{name}'>{points}</room>").expect("a string");
        self
    }

    fn wall(mut self, [x0, y0]: [f64; 2], [x1, y1]: [f64; 2], height: f64, color: &str) -> Self {
        self.walls += 1;
        let id = self.walls;
        write!(
            self.xml,
            "<wall id='w{id}' xStart='{x0}' yStart='{y0}' xEnd='{x1}' yEnd='{y1}' height='{height}' thickness='10' \
             leftSideColor='{color}' rightSideColor='{color}' wallAtStart='w{id}' wallAtEnd='w{id}'/>"
        )
        .expect("a string");
        self
    }

    fn walls(self, ends: &[[[f64; 2]; 2]]) -> Self {
        ends.iter().fold(self, |plan, [from, to]| {
            plan.wall(*from, *to, 250.0, "FFE0E0E0")
        })
    }

    fn door(mut self, name: &str, [x, y]: [f64; 2], angle: f64) -> Self {
        write!(
            self.xml,
            "<doorOrWindow name='{name}' x='{x}' y='{y}' angle='{angle}' width='90' depth='10' height='208'/>"
        )
        .expect("a string");
        self
    }

    fn load(&self) -> LoadedModel {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(
            folder.path().join("Home.xml"),
            format!("{}</home>", self.xml),
        )
        .expect("written");
        load_model(&folder.path().join("Home.xml"), &ModelOptions::default()).expect("loads")
    }
}

/// Without the wall along the lower side of the kitchen.
fn four_bedrooms() -> Plan {
    Plan::new()
        .room("Bedroom 1", [5.0, 5.0], [395.0, 395.0])
        .room("Bedroom 2", [405.0, 5.0], [795.0, 395.0])
        .room("Bedroom 3", [5.0, 525.0], [395.0, 895.0])
        .room("Bedroom 4", [405.0, 525.0], [795.0, 895.0])
        .room("Corridor", [5.0, 405.0], [795.0, 515.0])
        .room("Living room", [805.0, 5.0], [1195.0, 515.0])
        .room("Kitchen", [805.0, 515.0], [1195.0, 895.0])
        .walls(&[
            [[0.0, 0.0], [1200.0, 0.0]],
            [[1200.0, 0.0], [1200.0, 900.0]],
            [[0.0, 0.0], [0.0, 900.0]],
            [[0.0, 900.0], [800.0, 900.0]],
            [[0.0, 400.0], [800.0, 400.0]],
            [[0.0, 520.0], [800.0, 520.0]],
            [[400.0, 0.0], [400.0, 400.0]],
            [[400.0, 520.0], [400.0, 900.0]],
            [[800.0, 0.0], [800.0, 400.0]],
            [[800.0, 520.0], [800.0, 900.0]],
        ])
        .wall([805.0, 515.0], [1000.0, 515.0], 100.0, "FF805030")
        .door("Door", [200.0, 400.0], 0.0)
        .door("Door", [600.0, 400.0], 0.0)
        .door("Door", [200.0, 520.0], 0.0)
        .door("Door", [600.0, 520.0], 0.0)
}

fn closed() -> Plan {
    four_bedrooms().walls(&[[[800.0, 900.0], [1200.0, 900.0]]])
}

fn cell(model: &PortalModel, name: &str) -> u32 {
    model
        .cells
        .iter()
        .position(|cell| cell.name == name)
        .unwrap_or_else(|| panic!("no {name}")) as u32
}

/// Width and height of the portals between two cells, centimetres.
fn between(model: &PortalModel, a: &str, b: &str) -> Vec<[i32; 2]> {
    let (a, b) = (cell(model, a), cell(model, b));
    let of_both = model
        .portals
        .iter()
        .filter(|p| p.cells == [a, b] || p.cells == [b, a]);
    let size = |polygon: &[glam::DVec3]| {
        let low = polygon
            .iter()
            .copied()
            .reduce(|p, q| p.min(q))
            .expect("corners");
        let size = polygon
            .iter()
            .copied()
            .reduce(|p, q| p.max(q))
            .expect("corners")
            - low;
        [DVec2::new(size.x, size.z).length(), size.y].map(|m| (m * 100.0).round() as i32)
    };
    of_both.map(|portal| size(&portal.polygon)).collect()
}

#[test]
fn wide_openings_are_portals() {
    let LoadedModel { model, findings } = closed().load();
    assert_eq!(
        between(&model, "Corridor", "Living room"),
        [[110, 250]],
        "{findings:?}"
    );
    // Above the counter, too: one portal along the whole border.
    assert_eq!(between(&model, "Living room", "Kitchen"), [[390, 250]]);
    assert_eq!(between(&model, "Bedroom 1", "Corridor"), [[90, 208]]);
    assert!(
        between(&model, "Bedroom 1", "Bedroom 2").is_empty()
            && between(&model, "Kitchen", "Outside").is_empty()
    );
    let reached = model.reachable(cell(&model, "Bedroom 3"));
    let unreached: Vec<&str> = model
        .cells
        .iter()
        .zip(&reached)
        .filter(|(_, r)| !**r)
        .map(|(cell, _)| cell.name.as_str())
        .collect();
    assert_eq!(unreached, ["Outside"]);
    let tracer = Tracer::new(
        Arc::new(model.scene.clone()),
        glam::DVec3::new(6.0, 1.0, 4.5),
    );
    let leaks = model.leaks(&tracer, 2000, 3);
    let rays: usize = leaks
        .iter()
        .map(|leak| {
            if let Finding::Leak { rays, .. } = leak {
                *rays
            } else {
                0
            }
        })
        .sum();
    assert!(rays <= 7, "{leaks:?}"); // of 14,000
    assert!(
        model
            .check()
            .iter()
            .all(|f| matches!(f, Finding::Unreachable { .. })),
        "{:?}",
        model.check()
    );
    assert!(
        !findings
            .iter()
            .any(|f| matches!(f, Finding::NoWall { .. } | Finding::Joined { .. })),
        "{findings:?}"
    );
}

#[test]
fn missing_wall_is_reported() {
    let LoadedModel { model, findings } = four_bedrooms().load();
    let named: Vec<_> = findings
        .iter()
        .filter(|f| matches!(f, Finding::NoWall { .. }))
        .map(ToString::to_string)
        .collect();
    let [text] = &named[..] else {
        panic!("{findings:?}")
    };
    assert!(
        text.starts_with("Kitchen has no wall to the outside over 3.90 x 2.50 m"),
        "{text}"
    );
    assert_eq!(between(&model, "Kitchen", "Outside"), [[390, 250]]);
}

#[test]
fn walls_in_one_plane_are_named() {
    let LoadedModel { findings, .. } = closed()
        .wall([400.0, 900.0], [700.0, 900.0], 200.0, "FFB04040")
        .load();
    let named: Vec<_> = findings
        .iter()
        .filter(|f| matches!(f, Finding::Coplanar { .. }))
        .map(ToString::to_string)
        .collect();
    assert!(
        named
            .iter()
            .any(|text| text.starts_with("Bedroom 4: surfaces of different materials")),
        "{findings:?}"
    );
}

#[test]
fn obliquely_visible_rooms_are_joined() {
    // Two walls, each along half of the border between rooms that extend to the walls' centre
    // lines, so that no ray crosses it perpendicularly.
    let plan = Plan::new()
        .room("Left", [5.0, 5.0], [319.0, 295.0])
        .room("Right", [319.0, 5.0], [695.0, 295.0])
        .walls(&[
            [[0.0, 0.0], [700.0, 0.0]],
            [[0.0, 300.0], [700.0, 300.0]],
            [[0.0, 0.0], [0.0, 300.0]],
            [[700.0, 0.0], [700.0, 300.0]],
            [[305.0, 0.0], [305.0, 150.0]],
            [[333.0, 144.0], [333.0, 300.0]],
        ]);
    let LoadedModel { model, findings } = plan.load();
    let joined = findings.iter().any(|f| matches!(f, Finding::Joined { .. }));
    assert!(joined, "{findings:?}");
    let names: Vec<&str> = model.cells.iter().map(|cell| cell.name.as_str()).collect();
    assert_eq!(names, ["Left + Right", "Outside"]);
    assert_eq!(model.cells[0].triangles.end, model.cells[1].triangles.start);
    assert_eq!(
        model.cells[1].triangles.end as usize,
        model.scene.triangles.len()
    );
    assert!(
        model
            .portals
            .iter()
            .all(|portal| portal.cells[0] != portal.cells[1])
    );
}
