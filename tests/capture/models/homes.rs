//! Small homes and models in temporary folders.

use headbox_model::PortalModel;
use headbox_model::load::{LoadedModel, ModelOptions, load_model};
use std::fmt::Write as _;
use std::fs;
use tempfile::TempDir;

/// Writes files into a new folder.
pub(crate) fn folder(files: &[(&str, &str)]) -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, text) in files {
        fs::write(folder.path().join(name), text).expect("written");
    }
    folder
}

pub(crate) fn load(folder: &TempDir, name: &str) -> LoadedModel {
    load_model(&folder.path().join(name), &ModelOptions::default())
        .unwrap_or_else(|error| panic!("{error}"))
}

pub(crate) fn error_of(folder: &TempDir, name: &str) -> String {
    match load_model(&folder.path().join(name), &ModelOptions::default()) {
        Ok(_) => panic!("{name} loaded"),
        Err(error) => error.to_string(),
    }
}

/// Builder of an OBJ of quadrilaterals in groups.
#[derive(Default)]
pub(crate) struct Obj {
    pub(crate) text: String,
    corners: usize,
}

impl Obj {
    pub(crate) fn group(&mut self, name: &str) -> &mut Self {
        writeln!(self.text, "g {name}").expect("a string");
        self
    }

    pub(crate) fn quad(&mut self, corners: [[f64; 3]; 4]) -> &mut Self {
        for [x, y, z] in corners {
            writeln!(self.text, "v {x} {y} {z}").expect("a string");
        }
        let first = self.corners + 1;
        writeln!(
            self.text,
            "f {} {} {} {}",
            first,
            first + 1,
            first + 2,
            first + 3
        )
        .expect("a string");
        self.corners += 4;
        self
    }

    /// A wall with both faces, `thick` apart, along x from `x0` to `x1` at z.
    pub(crate) fn wall_along_x(
        &mut self,
        [x0, x1]: [f64; 2],
        [y0, y1]: [f64; 2],
        z: f64,
        thick: f64,
    ) -> &mut Self {
        let (a, b) = (z - thick / 2.0, z + thick / 2.0);
        self.quad([[x1, y0, a], [x0, y0, a], [x0, y1, a], [x1, y1, a]]);
        self.quad([[x0, y0, b], [x1, y0, b], [x1, y1, b], [x0, y1, b]])
    }

    pub(crate) fn wall_along_z(
        &mut self,
        x: f64,
        [z0, z1]: [f64; 2],
        [y0, y1]: [f64; 2],
        thick: f64,
    ) -> &mut Self {
        let (a, b) = (x - thick / 2.0, x + thick / 2.0);
        self.quad([[a, y0, z0], [a, y0, z1], [a, y1, z1], [a, y1, z0]]);
        self.quad([[b, y0, z1], [b, y0, z0], [b, y1, z0], [b, y1, z1]])
    }
}

/// Two rooms of 4 m by 3 m side by side in x, walls 10 cm thick about their lines, a door of 1 m by
/// 2 m between, in centimetres: the left one from x = 5, the right one from x = 405. One wall runs
/// along both rooms.
pub(crate) fn home_obj() -> Obj {
    let mut obj = Obj::default();
    for (room, x) in [(1, 5.0), (2, 405.0)] {
        obj.group(&format!("room_{room}_1"));
        obj.quad([
            [x, 0.0, 5.0],
            [x, 0.0, 295.0],
            [x + 390.0, 0.0, 295.0],
            [x + 390.0, 0.0, 5.0],
        ]);
        obj.group(&format!("room_{room}_2"));
        obj.quad([
            [x, 250.0, 5.0],
            [x + 390.0, 250.0, 5.0],
            [x + 390.0, 250.0, 295.0],
            [x, 250.0, 295.0],
        ]);
    }
    obj.group("wall_1_1")
        .wall_along_x([-5.0, 805.0], [0.0, 250.0], 0.0, 10.0);
    obj.group("wall_2_1")
        .wall_along_x([-5.0, 805.0], [0.0, 250.0], 300.0, 10.0);
    obj.group("wall_3_1")
        .wall_along_z(0.0, [5.0, 295.0], [0.0, 250.0], 10.0);
    obj.group("wall_4_1")
        .wall_along_z(800.0, [5.0, 295.0], [0.0, 250.0], 10.0);
    obj.group("wall_5_1")
        .wall_along_z(400.0, [5.0, 100.0], [0.0, 250.0], 10.0);
    obj.wall_along_z(400.0, [200.0, 295.0], [0.0, 250.0], 10.0);
    obj.wall_along_z(400.0, [100.0, 200.0], [200.0, 250.0], 10.0);
    // The reveals of the opening, cut in the middle of the wall.
    for x in [395.0, 400.0] {
        let y = [0.0, 200.0];
        obj.quad([
            [x, y[0], 100.0],
            [x + 5.0, y[0], 100.0],
            [x + 5.0, y[1], 100.0],
            [x, y[1], 100.0],
        ]);
        obj.quad([
            [x + 5.0, y[0], 200.0],
            [x, y[0], 200.0],
            [x, y[1], 200.0],
            [x + 5.0, y[1], 200.0],
        ]);
        obj.quad([
            [x, y[1], 100.0],
            [x + 5.0, y[1], 100.0],
            [x + 5.0, y[1], 200.0],
            [x, y[1], 200.0],
        ]);
        obj.quad([
            [x, 0.0, 100.0],
            [x, 0.0, 200.0],
            [x + 5.0, 0.0, 200.0],
            [x + 5.0, 0.0, 100.0],
        ]);
    }
    obj.group("door_9_Door_leaf_1").quad([
        [399.0, 1.0, 102.0],
        [399.0, 1.0, 198.0],
        [399.0, 198.0, 198.0],
        [399.0, 198.0, 102.0],
    ]);
    obj.group("door_9_Door_handle_2").quad([
        [392.0, 99.0, 110.0],
        [392.0, 99.0, 114.0],
        [392.0, 101.0, 114.0],
        [392.0, 101.0, 110.0],
    ]);
    obj.group("door_9_Door_frame_3").quad([
        [396.0, 0.0, 100.0],
        [396.0, 0.0, 103.0],
        [396.0, 200.0, 103.0],
        [396.0, 200.0, 100.0],
    ]);
    // A table in the right room that extends into the left one.
    obj.group("piece_3_Table_top_4").quad([
        [450.0, 70.0, 50.0],
        [450.0, 70.0, 80.0],
        [600.0, 70.0, 80.0],
        [600.0, 70.0, 50.0],
    ]);
    obj.group("piece_3_Table_rim_5").quad([
        [380.0, 71.0, 50.0],
        [380.0, 71.0, 80.0],
        [390.0, 71.0, 80.0],
        [390.0, 71.0, 50.0],
    ]);
    obj
}

pub(crate) const ROOMS: &str = "<room name='Left'><point x='5' y='5'/><point x='395' y='5'/><point x='395' y='295'/>\
    <point x='5' y='295'/></room><room><point x='405' y='5'/><point x='795' y='5'/><point x='795' y='295'/>\
    <point x='405' y='295'/></room>";

pub(crate) const DOOR: &str = "<furnitureGroup name='g'><doorOrWindow name='Door' x='400' y='150' angle='1.5707964' width='100' \
    depth='10' height='200'/></furnitureGroup>";

pub(crate) fn home_xml(rooms: &str, doors: &str) -> String {
    format!("<?xml version='1.0'?><home version='6500' wallHeight='250.0'>{doors}{rooms}</home>")
}

pub(crate) fn home(rooms: &str, doors: &str) -> TempDir {
    folder(&[
        ("Home.xml", &home_xml(rooms, doors)),
        ("home.obj", &home_obj().text),
    ])
}

/// Returns the names of a model's cells with their numbers of triangles.
pub(crate) fn cells(model: &PortalModel) -> Vec<(&str, usize)> {
    model
        .cells
        .iter()
        .map(|cell| (cell.name.as_str(), cell.triangles.len()))
        .collect()
}
