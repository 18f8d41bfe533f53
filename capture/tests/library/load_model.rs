//! Portal models from files: a TOML model, small homes written here, and the real home where it is at hand.

use headbox_capture::load::{LoadedModel, ModelOptions, load_model};
use headbox_capture::portal_model::{Finding, PortalModel, Severity};
use headbox_capture::trace::{Ray, Tracer};
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tempfile::TempDir;

/// Writes files into a new folder.
fn folder(files: &[(&str, &str)]) -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, text) in files {
        fs::write(folder.path().join(name), text).expect("written");
    }
    folder
}

fn load(folder: &TempDir, name: &str) -> LoadedModel {
    load_model(&folder.path().join(name), &ModelOptions::default()).unwrap_or_else(|error| panic!("{error}"))
}

fn error_of(folder: &TempDir, name: &str) -> String {
    match load_model(&folder.path().join(name), &ModelOptions::default()) {
        Ok(_) => panic!("{name} loaded"),
        Err(error) => error.to_string(),
    }
}

/// An OBJ under construction: quadrilaterals in groups.
#[derive(Default)]
struct Obj {
    text: String,
    corners: usize,
}

impl Obj {
    fn group(&mut self, name: &str) -> &mut Self {
        writeln!(self.text, "g {name}").expect("a string");
        self
    }

    fn quad(&mut self, corners: [[f64; 3]; 4]) -> &mut Self {
        for [x, y, z] in corners {
            writeln!(self.text, "v {x} {y} {z}").expect("a string");
        }
        let first = self.corners + 1;
        writeln!(self.text, "f {} {} {} {}", first, first + 1, first + 2, first + 3).expect("a string");
        self.corners += 4;
        self
    }

    /// A wall with both faces, `thick` apart, along x from `x0` to `x1` at z.
    fn wall_along_x(&mut self, [x0, x1]: [f64; 2], [y0, y1]: [f64; 2], z: f64, thick: f64) -> &mut Self {
        let (a, b) = (z - thick / 2.0, z + thick / 2.0);
        self.quad([[x1, y0, a], [x0, y0, a], [x0, y1, a], [x1, y1, a]]);
        self.quad([[x0, y0, b], [x1, y0, b], [x1, y1, b], [x0, y1, b]])
    }

    fn wall_along_z(&mut self, x: f64, [z0, z1]: [f64; 2], [y0, y1]: [f64; 2], thick: f64) -> &mut Self {
        let (a, b) = (x - thick / 2.0, x + thick / 2.0);
        self.quad([[a, y0, z0], [a, y0, z1], [a, y1, z1], [a, y1, z0]]);
        self.quad([[b, y0, z1], [b, y0, z0], [b, y1, z0], [b, y1, z1]])
    }
}

/// Two rooms of 4 m by 3 m side by side in x, walls 10 cm thick about their lines, a door of 1 m by 2 m between, in
/// centimetres: the left one from x = 5, the right one from x = 405. One wall runs along both rooms.
fn home_obj() -> Obj {
    let mut obj = Obj::default();
    for (room, x) in [(1, 5.0), (2, 405.0)] {
        obj.group(&format!("room_{room}_1"));
        obj.quad([[x, 0.0, 5.0], [x, 0.0, 295.0], [x + 390.0, 0.0, 295.0], [x + 390.0, 0.0, 5.0]]);
        obj.group(&format!("room_{room}_2"));
        obj.quad([[x, 250.0, 5.0], [x + 390.0, 250.0, 5.0], [x + 390.0, 250.0, 295.0], [x, 250.0, 295.0]]);
    }
    obj.group("wall_1_1").wall_along_x([-5.0, 805.0], [0.0, 250.0], 0.0, 10.0);
    obj.group("wall_2_1").wall_along_x([-5.0, 805.0], [0.0, 250.0], 300.0, 10.0);
    obj.group("wall_3_1").wall_along_z(0.0, [5.0, 295.0], [0.0, 250.0], 10.0);
    obj.group("wall_4_1").wall_along_z(800.0, [5.0, 295.0], [0.0, 250.0], 10.0);
    obj.group("wall_5_1").wall_along_z(400.0, [5.0, 100.0], [0.0, 250.0], 10.0);
    obj.wall_along_z(400.0, [200.0, 295.0], [0.0, 250.0], 10.0);
    obj.wall_along_z(400.0, [100.0, 200.0], [200.0, 250.0], 10.0);
    // The reveals of the opening, cut in the middle of the wall.
    for x in [395.0, 400.0] {
        let y = [0.0, 200.0];
        obj.quad([[x, y[0], 100.0], [x + 5.0, y[0], 100.0], [x + 5.0, y[1], 100.0], [x, y[1], 100.0]]);
        obj.quad([[x + 5.0, y[0], 200.0], [x, y[0], 200.0], [x, y[1], 200.0], [x + 5.0, y[1], 200.0]]);
        obj.quad([[x, y[1], 100.0], [x + 5.0, y[1], 100.0], [x + 5.0, y[1], 200.0], [x, y[1], 200.0]]);
        obj.quad([[x, 0.0, 100.0], [x, 0.0, 200.0], [x + 5.0, 0.0, 200.0], [x + 5.0, 0.0, 100.0]]);
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
    // A table in the right room with a part that hangs over into the left one.
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

const ROOMS: &str = "<room name='Left'><point x='5' y='5'/><point x='395' y='5'/><point x='395' y='295'/>\
    <point x='5' y='295'/></room><room><point x='405' y='5'/><point x='795' y='5'/><point x='795' y='295'/>\
    <point x='405' y='295'/></room>";

const DOOR: &str = "<furnitureGroup name='g'><doorOrWindow name='Door' x='400' y='150' angle='1.5707964' width='100' \
    depth='10' height='200'/></furnitureGroup>";

fn home_xml(rooms: &str, doors: &str) -> String {
    format!("<?xml version='1.0'?><home version='6500' wallHeight='250.0'>{doors}{rooms}</home>")
}

fn home(rooms: &str, doors: &str) -> TempDir {
    folder(&[("Home.xml", &home_xml(rooms, doors)), ("home.obj", &home_obj().text)])
}

/// Names of a model's cells with their numbers of triangles.
fn cells(model: &PortalModel) -> Vec<(&str, usize)> {
    model.cells.iter().map(|cell| (cell.name.as_str(), cell.triangles.len())).collect()
}

#[test]
fn a_home_becomes_cells_and_portals() {
    let folder = home(ROOMS, DOOR);
    let LoadedModel { model, findings } = load(&folder, "Home.xml");
    assert_eq!(model.scene.validate(), Ok(()));
    assert!(model.cells.iter().map(|cell| cell.name.as_str()).eq(["Left", "Room 2", "Outside"]));
    assert_eq!(model.portals.len(), 1);
    let mut sides = model.portals[0].cells;
    sides.sort_unstable();
    assert_eq!(sides, [0, 1]);
    for corner in &model.portals[0].polygon {
        // The angle in the file has eight digits: 5e-8 of half a metre.
        assert!((corner.x - 4.0).abs() < 1e-7 && [0.0, 2.0].iter().any(|y| (corner.y - y).abs() < 1e-9), "{corner}");
    }
    assert!(
        findings.iter().all(|f| matches!(f, Finding::Unreachable { name, .. } if name == "Outside")),
        "{findings:?}"
    );
    // Floor, ceiling, two walls, a wall in three pieces, two reveals, lintel and threshold: 22 triangles; the two
    // long walls face both rooms, and are cut: three triangles of each end in each room. The table is the right one's.
    assert_eq!(model.scene.triangles.len() as u32, model.cells.last().expect("cells").triangles.end);
    let notes = model.scene.summary.notes.join("\n");
    assert!(notes.contains("2 groups that close 1 door"), "{notes}");
    let at = |x: f64, y: f64, z: f64| model.cell_at(glam::DVec3::new(x, y, z));
    assert_eq!([at(1.0, 1.0, 1.0), at(7.0, 1.0, 1.0), at(1.0, 1.0, 9.0)], [Some(0), Some(1), Some(2)]);
    assert_eq!([at(3.98, 1.0, 1.5), at(4.02, 1.0, 1.5)], [Some(0), Some(1)], "the space in the wall");

    let tracer = Tracer::new(Arc::new(model.scene.clone()), glam::DVec3::ZERO);
    assert_eq!(model.leaks(&tracer, 1000, 1), []);
}

/// The walls along both rooms are cut at the wall between them: all that faces a room belongs to it, and nothing is
/// lost.
#[test]
fn walls_along_several_rooms_are_cut() {
    let folder = home(ROOMS, DOOR);
    let model = load(&folder, "Home.xml").model;
    let area = |triangles: std::ops::Range<u32>| -> f64 {
        triangles.map(|t| model.scene.corners(t)).map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0).sum()
    };
    let inner_faces = |cell: usize| -> f64 {
        let faces = model.cells[cell]
            .triangles
            .clone()
            .filter(|&t| [0.05, 2.95].iter().any(|z| model.scene.corners(t).iter().all(|p| (p.z - z).abs() < 1e-9)));
        faces.map(|t| area(t..t + 1)).sum()
    };
    for cell in [0, 1] {
        // Two walls of 3.9 m by 2.5 m, and what lies in the niche of no room goes to either.
        let seen = inner_faces(cell);
        assert!((19.5..20.1).contains(&seen), "{seen} m2");
    }
    let table = model.scene.triangles[model.cells[1].triangles.start as usize..model.cells[1].triangles.end as usize]
        .iter()
        .filter(|t| t.vertices.iter().all(|&v| (0.69..0.72).contains(&model.scene.positions[v as usize].y)))
        .count();
    assert_eq!(table, 4, "the whole table stands in the right room");
}

#[test]
fn leaves_are_kept_where_asked_for() {
    let folder = home(ROOMS, DOOR);
    let without = load(&folder, "Home.xml").model.scene.triangles.len();
    let options = ModelOptions { keep_doors: true };
    let with = load_model(&folder.path().join("Home.xml"), &options).expect("loads").model;
    assert_eq!(with.scene.triangles.len(), without + 4);
}

#[test]
fn an_archive_is_read_like_its_plan() {
    let folder = home(ROOMS, DOOR);
    let path = folder.path().join("flat.sh3d");
    let mut archive = zip::ZipWriter::new(fs::File::create(&path).expect("created"));
    archive.start_file("Home.xml", zip::write::SimpleFileOptions::default()).expect("started");
    std::io::Write::write_all(&mut archive, home_xml(ROOMS, DOOR).as_bytes()).expect("written");
    archive.finish().expect("finished");
    let (a, b) = (load(&folder, "Home.xml").model, load(&folder, "flat.sh3d").model);
    assert_eq!(cells(&a), cells(&b));
    assert_eq!(a.portals, b.portals);

    let bytes = fs::read(&path).expect("read");
    fs::write(&path, &bytes[..bytes.len() / 2]).expect("written");
    assert!(error_of(&folder, "flat.sh3d").contains("a damaged archive"));
    let mut empty = zip::ZipWriter::new(fs::File::create(&path).expect("created"));
    empty.start_file("Home", zip::write::SimpleFileOptions::default()).expect("started");
    empty.finish().expect("finished");
    assert!(error_of(&folder, "flat.sh3d").contains("it has no Home.xml; save the home with"));
}

/// The walls of the two rooms, joined at three corners, and a table whose model has its front at its negative x.
const WALLS: &str = "<wall id='a' wallAtEnd='b' xStart='-5' yStart='0' xEnd='800' yEnd='0' thickness='10' \
    leftSideColor='FFFF0000'/><wall id='b' wallAtStart='a' wallAtEnd='c' xStart='800' yStart='0' xEnd='800' yEnd='300' \
    thickness='10'/><wall id='c' wallAtStart='b' wallAtEnd='d' xStart='800' yStart='300' xEnd='0' yEnd='300' \
    thickness='10'/><wall id='d' wallAtStart='c' xStart='0' yStart='300' xEnd='0' yEnd='-5' thickness='10'/><wall id='e' \
    xStart='400' yStart='5' xEnd='400' yEnd='295' thickness='10'/><pieceOfFurniture name='Table' x='600' y='100' \
    elevation='10' width='100' depth='40' height='70' angle='1.5707963' model='3' modelRotation='0 0 1 0 1 0 -1 0 0'>\
    <material name='top' color='FF336699'/></pieceOfFurniture><light x='100' y='100' width='20' depth='20' height='30' \
    model='none'/>";

/// One triangle that spans a box of 2 by 1 by 4.
const TABLE: &str = "v 0 0 0\nv 2 1 0\nv 2 0 4\nusemtl top\nf 1 2 3\n";

#[test]
fn an_archive_alone_is_built_from_its_plan() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut archive = zip::ZipWriter::new(fs::File::create(folder.path().join("flat.sh3d")).expect("created"));
    for (name, text) in [("Home.xml", home_xml(ROOMS, &[WALLS, DOOR].concat())), ("3", TABLE.into())] {
        archive.start_file(name, zip::write::SimpleFileOptions::default()).expect("started");
        std::io::Write::write_all(&mut archive, text.as_bytes()).expect("written");
    }
    archive.finish().expect("finished");
    let LoadedModel { model, findings } = load(&folder, "flat.sh3d");
    // Its walls end in each other's outer faces.
    let expected = |f: &Finding| match f {
        Finding::Coplanar { cell, .. } => cell == "Outside",
        other => matches!(other, Finding::Unreachable { .. }),
    };
    assert!(findings.iter().all(expected), "{findings:?}");
    assert_eq!(model.portals, load(&home(ROOMS, DOOR), "Home.xml").model.portals);
    let notes = &model.scene.summary.notes;
    assert!(notes.iter().any(|n| n.starts_with("there is no OBJ beside it")), "{notes:?}");
    assert!(notes.iter().any(|n| n.starts_with("1 pieces of furniture are boxes")), "{notes:?}");

    let tracer = Tracer::new(Arc::new(model.scene.clone()), glam::DVec3::ZERO);
    assert_eq!(model.leaks(&tracer, 2000, 1), [], "walls are closed but for the door");
    let distance = |from: [f64; 3], direction: [f32; 3]| {
        let origin = glam::DVec3::from(from).as_vec3();
        let ray = Ray { origin, direction: direction.into(), t_min: 0.0, t_max: f32::INFINITY };
        tracer.closest(&ray).map(|hit| hit.t)
    };
    let near = |found: Option<f32>, expected: f32| found.is_some_and(|found| (found - expected).abs() < 1e-4);
    // Through the door from wall to wall, beside it to the wall between, and above it.
    assert!(near(distance([2.0, 1.0, 1.5], [1.0, 0.0, 0.0]), 5.95));
    assert!(near(distance([2.0, 1.0, 0.8], [1.0, 0.0, 0.0]), 1.95));
    assert!(near(distance([2.0, 2.2, 1.5], [1.0, 0.0, 0.0]), 1.95));
    assert!(near(distance([4.0, 1.0, 1.5], [0.0, 1.0, 0.0]), 1.0), "the lintel");
    assert!(
        near(distance([2.0, 1.0, 1.5], [0.0, 0.0, -1.0]), 1.45)
            && near(distance([2.0, 1.0, 1.5], [0.0, 1.0, 0.0]), 1.5)
    );
    // The table: 40 cm along x and 100 cm along z after its turn, 70 cm high from 10 cm on.
    let table: Vec<u32> = (0..model.scene.triangles.len() as u32)
        .filter(|&t| {
            model.scene.materials[model.scene.triangles[t as usize].material as usize].albedo == [0.2, 0.4, 0.6]
        })
        .collect();
    let [triangle] = table[..] else { panic!("{table:?}") };
    let corners = model.scene.corners(triangle);
    let low = corners.into_iter().reduce(|a, b| a.min(b)).expect("corners");
    let high = corners.into_iter().reduce(|a, b| a.max(b)).expect("corners");
    assert!(
        (low - glam::dvec3(5.8, 0.1, 0.5)).length() < 1e-6 && (high - glam::dvec3(6.2, 0.8, 1.5)).length() < 1e-6,
        "{low} {high}"
    );
    assert!(model.cells[1].triangles.contains(&triangle), "in the right room");
}

#[test]
fn homes_that_lack_something_say_so() {
    let LoadedModel { model, findings } = load(&home(ROOMS, ""), "Home.xml");
    assert!(model.portals.is_empty());
    assert!(findings.contains(&Finding::NoPortals), "{findings:?}");

    let LoadedModel { model, findings } = load(&home("", DOOR), "Home.xml");
    assert_eq!(model.cells.len(), 1);
    assert!(findings.contains(&Finding::NoCells), "{findings:?}");
    assert!(findings.iter().any(|f| f.to_string().contains("has Outside on both of its sides; it is left out")));
    assert!(model.portals.is_empty());

    let terrace = ROOMS.replace("<room>", "<room ceilingVisible='false'>");
    let model = load(&home(&terrace, DOOR), "Home.xml").model;
    assert_eq!(model.cells.len(), 2);
    assert!(model.scene.summary.notes.iter().any(|n| n == "Room 2 has no ceiling and is taken as part of the outside"));

    let no_number = load(&home(&ROOMS.replace("x='795'", "x='?'"), DOOR), "Home.xml").model;
    assert_eq!(no_number.cells.len(), 2);
    assert!(no_number.scene.summary.notes.iter().any(|n| n.starts_with("1 rooms, walls, doors")));
}

#[test]
fn files_that_are_no_homes_say_so() {
    let obj = home_obj().text;
    let broken = folder(&[("Home.xml", "<home><room>"), ("home.obj", &obj)]);
    assert!(error_of(&broken, "Home.xml").contains("Home.xml: "));
    let other = folder(&[("Home.xml", "<html/>"), ("home.obj", &obj)]);
    assert!(error_of(&other, "Home.xml").contains("its root is <html>, not <home>"));
    let alone = load(&folder(&[("Home.xml", &home_xml(ROOMS, DOOR))]), "Home.xml").model;
    assert!(alone.scene.summary.notes.iter().any(|note| note.starts_with("there is no OBJ beside it")));
    let two = folder(&[("Home.xml", &home_xml(ROOMS, DOOR)), ("a.obj", &obj), ("b.obj", &obj)]);
    assert!(error_of(&two, "Home.xml").contains("2 OBJ files lie beside it"));
    assert!(error_of(&two, "a.obj").contains("not a kind of home that is read"));
    assert!(error_of(&two, "none.xml").contains("No such file"));
}

/// The two rooms as a TOML model, Z up and in centimetres.
const TOML: &str = r#"
name = "flat"
up = "z"
unit = 0.01
scene = "flat.obj"

[[cell]]
name = "left"
groups = ["left_*"]
[[cell.prism]]
outline = [[0, 0], [400, 0], [400, 300], [0, 300]]
floor = 0
ceiling = 250

[[cell]]
name = "right"
groups = ["right wall", "right_floor"]
[[cell.prism]]
outline = [[400, 0], [800, 0], [800, 300], [400, 300]]
floor = 0
ceiling = 250

[[portal]]
name = "door"
cells = ["left", "right"]
polygon = [[400, 100, 200], [400, 200, 200], [400, 200, 0], [400, 100, 0]]
"#;

fn toml_folder(text: &str) -> TempDir {
    let mut obj = Obj::default();
    for (side, x) in [("left", 0.0), ("right", 400.0)] {
        obj.group(&format!("{side}_floor")).quad([
            [x, 0.0, 0.0],
            [x + 400.0, 0.0, 0.0],
            [x + 400.0, 300.0, 0.0],
            [x, 300.0, 0.0],
        ]);
    }
    obj.group("right wall").quad([[800.0, 0.0, 0.0], [800.0, 300.0, 0.0], [800.0, 300.0, 250.0], [800.0, 0.0, 250.0]]);
    obj.group("tree").quad([[2000.0, 0.0, 0.0], [2000.0, 30.0, 0.0], [2000.0, 30.0, 300.0], [2000.0, 0.0, 300.0]]);
    folder(&[("flat.toml", text), ("flat.obj", &obj.text)])
}

#[test]
fn a_toml_model_points_at_groups() {
    let LoadedModel { model, findings } = load(&toml_folder(TOML), "flat.toml");
    assert_eq!(model.scene.name, "flat");
    assert_eq!(cells(&model), [("left", 2), ("right", 4), ("Outside", 2)]);
    assert_eq!(model.cell_at(glam::DVec3::new(1.0, 1.0, -1.0)), Some(0), "Z up: y of the file is -z of the world");
    // It has a floor and a single wall.
    assert!(findings.iter().all(|f| matches!(f, Finding::NoWall { .. })), "{findings:?}");
    assert_eq!(findings.len(), 5);
    assert!((model.portals[0].polygon[1] - glam::DVec3::new(4.0, 2.0, -2.0)).length() < 1e-12);
}

/// A triangle in each of two nodes.
const GLTF: &str = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0,1]}],
    "nodes":[{"name":"left floor","mesh":0},{"name":"right floor","mesh":0,"translation":[4,0,0]}],
    "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
    "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,-1],"max":[1,0,0]}],
    "bufferViews":[{"buffer":0,"byteLength":36}],
    "buffers":[{"byteLength":36,"uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAAAAAAAAAAAAAIC/AACAPwAAAAAAAAAA"}]}"#;

#[test]
fn a_toml_model_points_at_nodes_of_a_gltf() {
    let text = r#"
        scene = "flat.gltf"
        cell = [{ name = "left", groups = ["left*"] }, { name = "right", groups = ["right floor"] }]
    "#;
    let LoadedModel { model, findings } = load(&folder(&[("flat.toml", text), ("flat.gltf", GLTF)]), "flat.toml");
    assert_eq!(cells(&model), [("left", 1), ("right", 1), ("Outside", 0)]);
    let right = model.scene.corners(model.cells[1].triangles.start);
    assert!(right.iter().all(|p| p.x >= 4.0), "{right:?}");
    assert!(findings.contains(&Finding::NoPortals), "{findings:?}");
    assert!(findings.contains(&Finding::NoSpace { cell: 0, name: "left".into() }), "{findings:?}");
}

#[test]
fn mistakes_in_a_toml_model_are_named() {
    let error = |from: &str, to: &str| error_of(&toml_folder(&TOML.replace(from, to)), "flat.toml");
    assert!(error("unit = 0.01", "unit = -1").contains("a unit of -1 m"));
    assert!(error("unit = 0.01", "units = 1").contains("unknown field `units`"));
    assert!(error("flat.obj", "none.obj").contains("No such file"));
    assert!(error("[[cell]]", "[[cell").contains("flat.toml"));
    assert!(error("name = \"right\"", "name = \"left\"").contains("two cells are called \"left\""));
    let model = load(
        &toml_folder(&TOML.replace("cells = [\"left\", \"right\"]", "cells = [\"left\", \"attic\"]")),
        "flat.toml",
    );
    assert!(model.findings.iter().any(|f| matches!(f, Finding::MissingCell { .. }) && f.severity() == Severity::Error));
    assert!(model.model.portals.iter().all(|portal| portal.name != "door"));
    let notes = model.model.scene.summary.notes.join("\n");
    assert!(notes.contains("portal \"door\" leads to a cell called \"attic\", which there is not"), "{notes}");
    let unmatched = load(&toml_folder(&TOML.replace("right wall", "wrong wall")), "flat.toml");
    assert!(unmatched.model.scene.summary.notes.iter().any(|n| n.contains("\"wrong wall\"")));
}

fn apartment() -> Option<PathBuf> {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/apartment"));
    path.is_dir().then(|| path.to_path_buf())
}

#[test]
fn the_real_apartment() {
    let Some(folder) = apartment() else {
        println!("skipped: no shared/data/apartment");
        return;
    };
    let LoadedModel { model, findings } =
        load_model(&folder.join("Home.xml"), &ModelOptions::default()).expect("loads");
    assert_eq!(model.scene.validate(), Ok(()));
    let names: Vec<&str> = model.cells.iter().map(|cell| cell.name.as_str()).collect();
    let rooms = ["Bathroom", "Bedroom #1", "Living room", "Room 5", "Kitchen", "Bedroom #2", "Bedroom #3", "Corridor"];
    assert_eq!(names, [&rooms[..], &["Outside"]].concat());
    // 21 doors and windows, four of them in the rail of the balcony, which is outside.
    assert_eq!(model.portals.len(), 17);
    let is_coplanar = |f: &&Finding| matches!(f, Finding::Coplanar { .. });
    let others: Vec<&Finding> = findings.iter().filter(|f| !is_coplanar(f)).collect();
    assert_eq!(others.len(), 4, "{findings:?}");
    assert!(others.iter().all(|f| matches!(f, Finding::SameCell { name, .. } if name == "Fixed window")));
    assert!(model.reachable(0).iter().all(|reached| *reached));
    assert_eq!(model.check(), []);
    let between = |a: &str, b: &str| {
        let pair = [a, b].map(|name| names.iter().position(|n| *n == name).expect("a cell") as u32);
        model.portals.iter().filter(|p| p.cells == pair || p.cells == [pair[1], pair[0]]).count()
    };
    assert_eq!([between("Living room", "Corridor"), between("Kitchen", "Living room")], [1, 2]);
    assert_eq!([between("Living room", "Outside"), between("Corridor", "Outside")], [4, 0]);
    // Every cell has its own floor and ceiling at least, and furniture.
    assert!(model.cells.iter().all(|cell| cell.triangles.len() > 1000));

    let tracer = Tracer::new(Arc::new(model.scene.clone()), glam::DVec3::new(5.0, 1.0, 4.0));
    assert_eq!(model.leaks(&tracer, 500, 1), []);
    let archive = load_model(&folder.join("3-BedroomApartment.sh3d"), &ModelOptions::default()).expect("loads");
    assert_eq!(cells(&archive.model), cells(&model));

    let alone = tempfile::tempdir().expect("a folder");
    fs::copy(folder.join("3-BedroomApartment.sh3d"), alone.path().join("alone.sh3d")).expect("copied");
    let built = load(&alone, "alone.sh3d").model;
    assert_eq!((&built.portals, built.check()), (&model.portals, Vec::new()));
    let of_built = Tracer::new(Arc::new(built.scene.clone()), tracer.origin());
    assert_eq!(built.leaks(&of_built, 500, 1), []);
    // What is seen from the middle of every room, in the export and in what was built.
    let (mut same, mut all) = (0, 0);
    for cell in model.cells.iter().filter(|cell| !cell.space.is_empty()) {
        let outline = &cell.space[0].outline;
        let middle = outline.iter().sum::<glam::DVec2>() / outline.len() as f64;
        let origin = (glam::dvec3(middle.x, 1.5, middle.y) - tracer.origin()).as_vec3();
        for i in 0..2000_u32 {
            // A spiral over the sphere.
            let (y, turn) = (1.0 - (f64::from(i) + 0.5) / 1000.0, f64::from(i) * 2.399_963);
            let flat = (1.0 - y * y).sqrt();
            let direction = glam::dvec3(flat * turn.cos(), y, flat * turn.sin()).as_vec3();
            let ray = Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY };
            let [a, b] = [&tracer, &of_built].map(|tracer| tracer.closest(&ray).map_or(1e9, |hit| hit.t));
            all += 1;
            same += u32::from((a - b).abs() < 0.01 * a);
        }
    }
    println!("{same} of {all} rays meet what they meet in the export");
    assert!(same * 100 > all * SAME_PERCENT, "{same} of {all}");
}

/// Rays of a hundred that meet a surface in the same place (1 %) in an export and in what is built without one.
const SAME_PERCENT: u32 = 95;
