//! Portal models from Sweet Home 3D: small homes written here, with their exports and without.

use super::homes::{DOOR, ROOMS, cells, error_of, folder, home, home_obj, home_xml, load};
use crate::folder::{Folder, TRIANGLE};
use headbox_core::color::{linear_from_srgb, linear_from_srgb8};
use headbox_core::file_frame::UpAxis;
use headbox_model::Finding;
use headbox_model::load::{LoadedModel, ModelOptions, load_model, load_scene};
use headbox_scene::load::{LoadError, LoadOptions};
use headbox_trace::bvh::{Ray, Tracer};
use std::fs;
use std::sync::Arc;

#[test]
fn home_becomes_cells_and_portals() {
    let folder = home(ROOMS, DOOR);
    let LoadedModel { model, findings } = load(&folder, "Home.xml");
    assert_eq!(model.scene.validate(), Ok(()));
    assert!(
        model
            .cells
            .iter()
            .map(|cell| cell.name.as_str())
            .eq(["Left", "Room 2", "Outside"])
    );
    assert_eq!(model.portals.len(), 1);
    let mut sides = model.portals[0].cells;
    sides.sort_unstable();
    assert_eq!(sides, [0, 1]);
    for corner in &model.portals[0].polygon {
        // The angle in the file has eight digits: 5e-8 of half a metre.
        assert!(
            (corner.x - 4.0).abs() < 1e-7 && [0.0, 2.0].iter().any(|y| (corner.y - y).abs() < 1e-9),
            "{corner}"
        );
    }
    assert!(
        findings
            .iter()
            .all(|f| matches!(f, Finding::Unreachable { name, .. } if name == "Outside")),
        "{findings:?}"
    );
    // Floor, ceiling, two walls, a wall in three pieces, two reveals, lintel and threshold: 22
    // triangles; the two long walls face both rooms and are cut: three triangles of each go to each
    // room. The table belongs to the right room.
    assert_eq!(
        model.scene.triangles.len() as u32,
        model.cells.last().expect("cells").triangles.end
    );
    let notes = model.scene.summary.notes.join("\n");
    assert!(notes.contains("2 groups that close 1 door"), "{notes}");
    let at = |x: f64, y: f64, z: f64| model.cell_at(glam::DVec3::new(x, y, z));
    assert_eq!(
        [at(1.0, 1.0, 1.0), at(7.0, 1.0, 1.0), at(1.0, 1.0, 9.0)],
        [Some(0), Some(1), Some(2)]
    );
    assert_eq!(
        [at(3.98, 1.0, 1.5), at(4.02, 1.0, 1.5)],
        [Some(0), Some(1)],
        "the space in the wall"
    );

    let tracer = Tracer::new(Arc::new(model.scene.clone()), glam::DVec3::ZERO);
    assert_eq!(model.leaks(&tracer, 1000, 1), []);
}

/// The walls along both rooms are cut at the wall between them: each part belongs to the room that
/// it faces, and no part is lost.
#[test]
fn walls_along_several_rooms_are_cut() {
    let folder = home(ROOMS, DOOR);
    let model = load(&folder, "Home.xml").model;
    let area = |triangles: std::ops::Range<u32>| -> f64 {
        triangles
            .map(|t| model.scene.corners(t))
            .map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0)
            .sum()
    };
    let inner_faces = |cell: usize| -> f64 {
        let faces = model.cells[cell].triangles.clone().filter(|&t| {
            [0.05, 2.95].iter().any(|z| {
                model
                    .scene
                    .corners(t)
                    .iter()
                    .all(|p| (p.z - z).abs() < 1e-9)
            })
        });
        faces.map(|t| area(t..t + 1)).sum()
    };
    for cell in [0, 1] {
        // Two walls of 3.9 m by 2.5 m; the niche, which is in no room, belongs to either.
        let seen = inner_faces(cell);
        assert!((19.5..20.1).contains(&seen), "{seen} m2");
    }
    let table = model.scene.triangles
        [model.cells[1].triangles.start as usize..model.cells[1].triangles.end as usize]
        .iter()
        .filter(|t| {
            t.vertices
                .iter()
                .all(|&v| (0.69..0.72).contains(&model.scene.positions[v as usize].y))
        })
        .count();
    assert_eq!(table, 4, "the whole table stands in the right room");
}

#[test]
fn keep_doors_keeps_leaves() {
    let folder = home(ROOMS, DOOR);
    let without = load(&folder, "Home.xml").model.scene.triangles.len();
    let options = ModelOptions { keep_doors: true };
    let with = load_model(&folder.path().join("Home.xml"), &options)
        .expect("loads")
        .model;
    assert_eq!(with.scene.triangles.len(), without + 4);
}

#[test]
fn archive_equals_plan() {
    let folder = home(ROOMS, DOOR);
    let path = folder.path().join("flat.sh3d");
    let mut archive = zip::ZipWriter::new(fs::File::create(&path).expect("created"));
    archive
        .start_file("Home.xml", zip::write::SimpleFileOptions::default())
        .expect("started");
    std::io::Write::write_all(&mut archive, home_xml(ROOMS, DOOR).as_bytes()).expect("written");
    archive.finish().expect("finished");
    let (a, b) = (
        load(&folder, "Home.xml").model,
        load(&folder, "flat.sh3d").model,
    );
    assert_eq!(cells(&a), cells(&b));
    assert_eq!(a.portals, b.portals);

    let bytes = fs::read(&path).expect("read");
    fs::write(&path, &bytes[..bytes.len() / 2]).expect("written");
    assert!(error_of(&folder, "flat.sh3d").contains("damaged archive"));
    let mut empty = zip::ZipWriter::new(fs::File::create(&path).expect("created"));
    empty
        .start_file("Home", zip::write::SimpleFileOptions::default())
        .expect("started");
    empty.finish().expect("finished");
    assert!(error_of(&folder, "flat.sh3d").contains("it has no Home.xml; save the home with"));
}

/// The walls of the two rooms, joined at three corners, and a table whose model has its front at
/// its negative x.
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
fn archive_without_export_is_built() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut archive =
        zip::ZipWriter::new(fs::File::create(folder.path().join("flat.sh3d")).expect("created"));
    for (name, text) in [
        ("Home.xml", home_xml(ROOMS, &[WALLS, DOOR].concat())),
        ("3", TABLE.into()),
    ] {
        archive
            .start_file(name, zip::write::SimpleFileOptions::default())
            .expect("started");
        std::io::Write::write_all(&mut archive, text.as_bytes()).expect("written");
    }
    archive.finish().expect("finished");
    let LoadedModel { model, findings } = load(&folder, "flat.sh3d");
    // Joined walls end at each other's outer faces.
    let expected = |f: &Finding| match f {
        Finding::Coplanar { cell, .. } => cell == "Outside",
        other => matches!(other, Finding::Unreachable { .. }),
    };
    assert!(findings.iter().all(expected), "{findings:?}");
    assert_eq!(
        model.portals,
        load(&home(ROOMS, DOOR), "Home.xml").model.portals
    );
    let notes = &model.scene.summary.notes;
    assert!(
        notes
            .iter()
            .any(|n| n.starts_with("no OBJ export in its folder")),
        "{notes:?}"
    );
    assert!(
        notes
            .iter()
            .any(|n| n.starts_with("1 piece of furniture is shown as a box")),
        "{notes:?}"
    );

    let tracer = Tracer::new(Arc::new(model.scene.clone()), glam::DVec3::ZERO);
    assert_eq!(
        model.leaks(&tracer, 2000, 1),
        [],
        "walls are closed but for the door"
    );
    let distance = |from: [f64; 3], direction: [f32; 3]| {
        let origin = glam::DVec3::from(from).as_vec3();
        let ray = Ray {
            origin,
            direction: direction.into(),
            t_min: 0.0,
            t_max: f32::INFINITY,
        };
        tracer.closest(&ray).map(|hit| hit.t)
    };
    let near = |found: Option<f32>, expected: f32| {
        found.is_some_and(|found| (found - expected).abs() < 1e-4)
    };
    // Through the door to the opposite wall, beside the door to the wall between, and above the
    // door.
    assert!(near(distance([2.0, 1.0, 1.5], [1.0, 0.0, 0.0]), 5.95));
    assert!(near(distance([2.0, 1.0, 0.8], [1.0, 0.0, 0.0]), 1.95));
    assert!(near(distance([2.0, 2.2, 1.5], [1.0, 0.0, 0.0]), 1.95));
    assert!(
        near(distance([4.0, 1.0, 1.5], [0.0, 1.0, 0.0]), 1.0),
        "the lintel"
    );
    assert!(
        near(distance([2.0, 1.0, 1.5], [0.0, 0.0, -1.0]), 1.45)
            && near(distance([2.0, 1.0, 1.5], [0.0, 1.0, 0.0]), 1.5)
    );
    // The table: 40 cm along x and 100 cm along z after its turn, 70 cm high from 10 cm on.
    let table: Vec<u32> = (0..model.scene.triangles.len() as u32)
        .filter(|&t| {
            model.scene.materials[model.scene.triangles[t as usize].material as usize].albedo
                == [0x33, 0x66, 0x99].map(linear_from_srgb8)
        })
        .collect();
    let [triangle] = table[..] else {
        panic!("{table:?}")
    };
    let corners = model.scene.corners(triangle);
    let low = corners
        .into_iter()
        .reduce(|a, b| a.min(b))
        .expect("corners");
    let high = corners
        .into_iter()
        .reduce(|a, b| a.max(b))
        .expect("corners");
    assert!(
        (low - glam::dvec3(5.8, 0.1, 0.5)).length() < 1e-6
            && (high - glam::dvec3(6.2, 0.8, 1.5)).length() < 1e-6,
        "{low} {high}"
    );
    assert!(
        model.cells[1].triangles.contains(&triangle),
        "in the right room"
    );
}

#[test]
fn incomplete_home_is_reported() {
    let LoadedModel { model, findings } = load(&home(ROOMS, ""), "Home.xml");
    assert!(model.portals.is_empty());
    assert!(findings.contains(&Finding::NoPortals), "{findings:?}");

    let LoadedModel { model, findings } = load(&home("", DOOR), "Home.xml");
    assert_eq!(model.cells.len(), 1);
    assert!(findings.contains(&Finding::NoCells), "{findings:?}");
    assert!(findings.iter().any(|f| {
        f.to_string()
            .contains("has Outside on both of its sides; it is left out")
    }));
    assert!(model.portals.is_empty());

    let terrace = ROOMS.replace("<room>", "<room ceilingVisible='false'>");
    let model = load(&home(&terrace, DOOR), "Home.xml").model;
    assert_eq!(model.cells.len(), 2);
    assert!(
        model
            .scene
            .summary
            .notes
            .iter()
            .any(|n| n == "Room 2 has no ceiling and is part of the outside")
    );

    let no_number = load(&home(&ROOMS.replace("x='795'", "x='?'"), DOOR), "Home.xml").model;
    assert_eq!(no_number.cells.len(), 2);
    assert!(
        no_number
            .scene
            .summary
            .notes
            .iter()
            .any(|n| n.starts_with("1 rooms, walls, doors"))
    );
}

#[test]
fn non_home_is_refused() {
    let obj = home_obj().text;
    let broken = folder(&[("Home.xml", "<home><room>"), ("home.obj", &obj)]);
    assert!(error_of(&broken, "Home.xml").contains("Home.xml: "));
    let other = folder(&[("Home.xml", "<html/>"), ("home.obj", &obj)]);
    assert!(error_of(&other, "Home.xml").contains("the root element is <html>, not <home>"));
    let alone = load(&folder(&[("Home.xml", &home_xml(ROOMS, DOOR))]), "Home.xml").model;
    assert!(
        alone
            .scene
            .summary
            .notes
            .iter()
            .any(|note| note.starts_with("no OBJ export in its folder"))
    );
    let two = folder(&[
        ("Home.xml", &home_xml(ROOMS, DOOR)),
        ("a.obj", &obj),
        ("b.obj", &obj),
    ]);
    assert!(error_of(&two, "Home.xml").contains("2 OBJ files are in its folder"));
    let text = home_xml(ROOMS, DOOR);
    let other = "o chair\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    for (files, note) in [
        (
            vec![("Home.xml", text.as_str()), ("chair.obj", other)],
            Some("1 OBJ file in its folder not used"),
        ),
        (
            vec![
                ("Home.xml", &text),
                ("chair.obj", other),
                ("table.obj", other),
            ],
            Some("2 OBJ files in its folder not used"),
        ),
        (
            vec![("Home.xml", &text), ("home.obj", other)],
            Some("home.obj is used as the export of the home because of its name"),
        ),
        (
            vec![("Home.xml", &text), ("chair.obj", other), ("b.obj", &obj)],
            None,
        ),
    ] {
        let notes = load(&folder(&files), "Home.xml").model.scene.summary.notes;
        let found = notes.iter().find(|note| note.contains(".obj"));
        match note {
            Some(start) => assert!(found.is_some_and(|n| n.starts_with(start)), "{notes:?}"),
            None => assert_eq!(found, None),
        }
    }
    let away = obj.replace("v -", "v ").replace("v ", "v 5000");
    for (files, cause) in [
        (
            vec![("Home.xml", text.as_str()), ("b.sh3d", ""), ("b.obj", &obj)],
            "it has the name of another home",
        ),
        (
            vec![("Home.xml", &text), ("villa.obj", &away)],
            "it lies away from the plan",
        ),
    ] {
        let notes = load(&folder(&files), "Home.xml").model.scene.summary.notes;
        assert!(notes.iter().any(|note| note.ends_with(cause)), "{notes:?}");
        let is_built = notes.iter().any(|n| n.starts_with("no OBJ export"));
        assert!(is_built, "{notes:?}");
    }
    assert!(error_of(&two, "a.obj").contains("not a home; use"));
    assert!(error_of(&two, "none.xml").contains("No such file"));
}

/// A home is captured and traced like any scene, without the leaves of its doors; files store the
/// frame for reopening it.
#[test]
fn home_is_scene() {
    let folder = home(ROOMS, DOOR);
    let path = folder.path().join("Home.xml");
    let model = load(&folder, "Home.xml").model;
    let open = |up, unit_m| load_scene(&path, &LoadOptions { up, unit_m });
    let scene = open(None, None).expect("loads");
    assert_eq!(scene.validate(), Ok(()));
    assert!(scene.positions == model.scene.positions && scene.triangles == model.scene.triangles);
    let again = open(Some(scene.frame.up), Some(scene.frame.unit_m)).expect("loads again");
    assert_eq!(again.positions, scene.positions);
    for other in [open(Some(UpAxis::Z), None), open(None, Some(1.0))] {
        let error = other.expect_err("another frame");
        assert!(matches!(error, LoadError::Frame { .. }), "{error}");
        assert!(
            error.to_string().ends_with(
                "Home.xml: a home defines its own up axis and unit; leave out --up and --unit"
            ),
            "{error}"
        );
    }
}

#[test]
fn exports_of_sweet_home_3d_have_the_colours_it_shows() {
    let albedo = |comment: &str| {
        let folder = Folder::new();
        folder.write(
            "a.obj",
            format!("{comment}mtllib a.mtl\nusemtl wall\n{TRIANGLE}"),
        );
        folder.write("a.mtl", "newmtl wall\nKd 0.2 0.4 0.6\n");
        let scene = folder.load("a.obj").expect("loaded");
        scene.materials[0].albedo
    };
    assert_eq!(albedo("# Made by hand\n"), [0.2, 0.4, 0.6]);
    let exported = albedo("#\n# a.obj\n#\n# Generated by Sweet Home 3D\n");
    assert_eq!(exported, [0.2, 0.4, 0.6].map(linear_from_srgb));
}
