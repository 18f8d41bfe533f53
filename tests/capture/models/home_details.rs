//! Details of Sweet Home 3D homes: sloping and missing ceilings, arc walls, hidden storeys,
//! textures, models with materials.

use super::homes::{home, home_xml, load};
use glam::DVec3;
use headbox_core::color::linear_from_srgb;
use headbox_model::PortalModel;
use headbox_model::load::LoadedModel;
use headbox_scene::material::Material;
use headbox_trace::bvh::{Ray, Tracer};
use std::fs;
use std::io::Write;
use std::sync::Arc;

/// Loads a home without an export.
fn plan(attributes: &str, content: &str) -> LoadedModel {
    load(
        &super::homes::folder(&[("Home.xml", &format!("<home {attributes}>{content}</home>"))]),
        "Home.xml",
    )
}

/// A room of 4 m by 3 m with `attributes`.
fn room(attributes: &str) -> String {
    let corners = [[5, 5], [395, 5], [395, 295], [5, 295]];
    let points = corners
        .map(|[x, y]| format!("<point x='{x}' y='{y}'/>"))
        .concat();
    format!("<room {attributes}>{points}</room>")
}

/// The four walls of the room, 10 cm thick, each with `attributes`.
fn walls(attributes: &str) -> String {
    let ends = [
        [0, 0, 400, 0],
        [400, 0, 400, 300],
        [400, 300, 0, 300],
        [0, 300, 0, 0],
    ];
    let wall = |(i, [x0, y0, x1, y1]): (usize, [i32; 4])| {
        let [before, after] = [(i + 3) % 4, (i + 1) % 4];
        format!(
            "<wall id='w{i}' wallAtStart='w{before}' wallAtEnd='w{after}' xStart='{x0}' yStart='{y0}' xEnd='{x1}' yEnd='{y1}' \
             thickness='10' {attributes}/>"
        )
    };
    ends.into_iter().enumerate().map(wall).collect()
}

/// Distance to the first surface, metres.
fn distance(model: &PortalModel, from: [f64; 3], direction: [f32; 3]) -> Option<f32> {
    let tracer = Tracer::new(Arc::new(model.scene.clone()), DVec3::ZERO);
    let direction = glam::Vec3::from(direction).normalize();
    let ray = Ray {
        origin: DVec3::from(from).as_vec3(),
        direction,
        t_min: 0.0,
        t_max: f32::INFINITY,
    };
    tracer.closest(&ray).map(|hit| hit.t)
}

/// Walls above a room's ceiling do not belong to the room: assigning whole triangles by their
/// centres left holes in rooms.
#[test]
fn walls_are_cut_at_ceilings() {
    let levels =
        "<level id='a' elevation='0' height='200'/><level id='b' elevation='200' height='300'/>";
    let content = [levels, &room("level='a'"), &walls("level='a' height='300'")].concat();
    let model = plan("wallHeight='250'", &content).model;
    let area = |is_it: &dyn Fn(&[DVec3; 3]) -> bool| -> f64 {
        let triangles = model.cells[0]
            .triangles
            .clone()
            .map(|triangle| model.scene.corners(triangle));
        triangles
            .filter(|corners| is_it(corners))
            .map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0)
            .sum()
    };
    for (axis, at, length) in [
        (0, 0.05, 2.9),
        (0, 3.95, 2.9),
        (2, 0.05, 3.9),
        (2, 2.95, 3.9),
    ] {
        let wall = area(&|corners| corners.iter().all(|p| (p[axis] - at).abs() < 1e-9));
        assert!(
            (wall - length * 2.0).abs() < 1e-6,
            "{wall} m2 of {}",
            length * 2.0
        );
    }
    assert!(area(&|corners| corners.iter().any(|p| p.y > 2.0 + 1e-9)) == 0.0);
}

#[test]
fn topmost_ceilings_hang_from_walls() {
    // Higher than the storey; counters and parapets are ignored.
    let counter =
        "<wall id='c' xStart='200' yStart='5' xEnd='200' yEnd='200' height='100' thickness='10'/>";
    let parapet = walls("height='300'")
        .replace("id='w0' wall", "id='w0' height='80' wall")
        .replace("height='300'/><wall id='w1'", "/><wall id='w1'");
    let model = plan(
        "wallHeight='250'",
        &[&room(""), &*parapet, counter].concat(),
    )
    .model;
    for x in [0.5, 2.5, 3.5] {
        assert!(
            distance(&model, [x, 1.0, 1.5], [0.0, 1.0, 0.0])
                .is_some_and(|t| (t - 2.0).abs() < 1e-5)
        );
    }
    assert!((model.cells[0].space[0].ceiling_y - 3.0).abs() < 1e-12);
    // A roof that rises from the wall at x = 0 to the one at x = 4 m.
    let sloping = walls("")
        .replace("id='w0'", "id='w0' height='200' heightAtEnd='400'")
        .replace("id='w1'", "id='w1' height='400'")
        .replace("id='w2'", "id='w2' height='400' heightAtEnd='200'")
        .replace("id='w3'", "id='w3' height='200'");
    let model = plan("wallHeight='250'", &[room(""), sloping].concat()).model;
    for x in [0.5, 2.0, 3.5] {
        // From 2 m at the face of one wall to 4 m at that of the other.
        let expected = 1.0 + 2.0 * (x - 0.05) / 3.9;
        let found = distance(&model, [x, 1.0, 1.5], [0.0, 1.0, 0.0]);
        assert!(
            found.is_some_and(|t| (f64::from(t) - expected).abs() < 1e-4),
            "{found:?} for {expected}"
        );
    }
}

#[test]
fn missing_ceilings_are_restored() {
    let off = "ceilingVisible='false'";
    let terrace = "<room ceilingVisible='false'><point x='405' y='5'/><point x='900' y='5'/><point x='900' y='295'/>\
                   <point x='405' y='295'/></room>";
    let LoadedModel { model, .. } = plan(
        "wallHeight='250'",
        &[&room(off), &walls(""), terrace].concat(),
    );
    assert_eq!(model.cells.len(), 2, "the terrace is outside");
    let notes = model.scene.summary.notes.join("\n");
    assert!(
        notes.contains("no room has a ceiling: one is added to 1 with walls around"),
        "{notes}"
    );
    assert!(
        distance(&model, [2.0, 1.0, 1.5], [0.0, 1.0, 0.0]).is_some_and(|t| (t - 1.5).abs() < 1e-5)
    );
    // If one room has a ceiling, the others are open on purpose.
    let other = room("").replace("'5'", "'1005'").replace("'395'", "'1395'");
    let LoadedModel { model, .. } =
        plan("wallHeight='250'", &[room(off), walls(""), other].concat());
    let notes = model.scene.summary.notes.join("\n");
    assert!(
        notes.contains("Room 1 has no ceiling and is part of the outside"),
        "{notes}"
    );
    // It is also added to an export without a ceiling.
    let rooms = super::homes::ROOMS.replace("<room", "<room ceilingVisible='false'");
    let folder = home(&rooms, "");
    fs::write(
        folder.path().join("Home.xml"),
        home_xml(&rooms, &walls("").replace("'400'", "'800'")),
    )
    .expect("written");
    let obj = fs::read_to_string(folder.path().join("home.obj")).expect("read");
    let without = |text: &str| {
        let mut shown = true;
        let keep = |line: &&str| {
            if line.starts_with("g ") {
                shown = !(line.starts_with("g room_") && line.ends_with("_2"));
            }
            shown || !line.starts_with('f')
        };
        text.lines().filter(keep).collect::<Vec<_>>().join("\n")
    };
    fs::write(folder.path().join("home.obj"), without(&obj)).expect("written");
    let LoadedModel { model, .. } = load(&folder, "Home.xml");
    assert_eq!(model.cells.len(), 3);
    for x in [2.0, 6.0] {
        assert!(
            distance(&model, [x, 1.0, 1.5], [0.0, 1.0, 0.0])
                .is_some_and(|t| (t - 1.5).abs() < 1e-5)
        );
    }
}

/// A semicircle of radius 2 m about (2 m, 0), to the left and to the right of the line from start
/// to end.
#[test]
fn arc_walls_are_curved() {
    for (extent, side) in [(std::f64::consts::PI, -1.0), (-std::f64::consts::PI, 1.0)] {
        let wall = format!(
            "<wall id='a' xStart='0' yStart='0' xEnd='400' yEnd='0' arcExtent='{extent}' height='250' thickness='10'/>"
        );
        let model = plan("wallHeight='250'", &wall).model;
        for degrees in 1..180 {
            let (sin, cos) = f32::to_radians(degrees as f32).sin_cos();
            let found = distance(&model, [2.0, 1.0, 0.0], [cos, 0.0, sin * side]);
            // The inner face, at most 1 - cos 5 degrees of the radius nearer.
            assert!(
                found.is_some_and(|t| (1.94..1.951).contains(&t)),
                "{found:?} at {degrees} degrees"
            );
            assert_eq!(
                distance(&model, [2.0, 1.0, 0.0], [cos, 0.0, -sin * side]),
                None
            );
            let outside = [2.0 + 3.0 * f64::from(cos), 1.0, 3.0 * f64::from(sin * side)];
            let found = distance(&model, outside, [-cos, 0.0, -sin * side]);
            assert!(
                found.is_some_and(|t| (0.949..0.96).contains(&t)),
                "{found:?} at {degrees} degrees"
            );
        }
    }
}

#[test]
fn window_in_arc_wall_cuts_all_its_pieces() {
    let arc = "<wall xStart='0' yStart='300' xEnd='400' yEnd='300' height='250' thickness='10' \
               arcExtent='1.5707963'/>";
    let window = "<doorOrWindow x='200' y='217.2' width='120' depth='30' height='100' \
                  elevation='100'/>";
    let model = plan("wallHeight='250'", &(arc.to_owned() + window)).model;
    for x in [1.45, 1.7, 2.0, 2.3, 2.55] {
        assert_eq!(
            distance(&model, [x, 1.5, 4.5], [0.0, 0.0, -1.0]),
            None,
            "{x}"
        );
    }
    for x in [1.3, 2.7] {
        assert!(
            distance(&model, [x, 1.5, 4.5], [0.0, 0.0, -1.0]).is_some(),
            "{x}"
        );
    }
}

#[test]
fn upper_walls_reach_through_their_floor() {
    let levels = "<level id='a' elevation='0' floorThickness='12' height='250'/>\
                  <level id='b' elevation='262' floorThickness='12' height='250'/>";
    let content = [levels, &walls("level='a'"), &walls("level='b'")].concat();
    let model = plan("wallHeight='250'", &content).model;
    assert!(distance(&model, [2.0, 2.56, -3.0], [0.0, 0.0, 1.0]).is_some());
    assert_eq!(distance(&model, [2.0, -0.06, -3.0], [0.0, 0.0, 1.0]), None);
}

#[test]
fn flat_ceiling_stays_below_higher_walls() {
    let content = room("ceilingFlat='true'") + &walls("height='300'");
    let model = plan("wallHeight='250'", &content).model;
    let up = distance(&model, [2.0, 1.0, 1.5], [0.0, 1.0, 0.0]);
    assert!(up.is_some_and(|t| (t - 1.5).abs() < 1e-5), "{up:?}");
}

#[test]
fn collinear_walls_and_tops_keep_their_colours() {
    let wall = |id: &str, other: &str, x: i32, color: &str| {
        format!(
            "<wall id='{id}' {other} xStart='{x}' yStart='0' xEnd='{}' yEnd='0' thickness='30' \
             leftSideColor='{color}' rightSideColor='{color}' topColor='FF0000FF'/>",
            x + 200
        )
    };
    let red = wall("a", "wallAtEnd='b'", 0, "FFFF0000");
    let content = red + &wall("b", "wallAtStart='a'", 200, "FF00FF00");
    let scene = plan("wallHeight='250'", &content).model.scene;
    for (color, from, to) in [([1.0, 0.0, 0.0], 0.0, 2.0), ([0.0, 1.0, 0.0], 2.0, 4.0)] {
        let is_it = |t: &u32| {
            let material = scene.triangles[*t as usize].material;
            scene.materials[material as usize].albedo == color
        };
        let triangles = (0..scene.triangles.len() as u32).filter(is_it);
        let corners = triangles.flat_map(|t| scene.corners(t));
        let [low, high] = corners.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], p| {
            [low.min(p.x), high.max(p.x)]
        });
        assert_eq!([low, high], [from, to], "{color:?}");
    }
    let blue = |m: &Material| m.albedo == [0.0, 0.0, 1.0];
    assert!(scene.materials.iter().any(blue));
}

#[test]
fn hidden_storeys_are_left_out() {
    let levels = "<level id='a' elevation='0' height='250' visible='false'/>\
                  <level id='b' elevation='262' height='250' viewable='false'/>";
    let content = [
        levels,
        &room("level='a' name='below'"),
        &room("level='b'"),
        &walls("level='a'"),
        &walls("level='b'"),
    ];
    let model = plan("wallHeight='250'", &content.concat()).model;
    assert!(
        model
            .cells
            .iter()
            .map(|cell| cell.name.as_str())
            .eq(["below", "Outside"])
    );
    assert!(model.scene.bounds()[1].y < 2.6);
}

/// Writes an archive with these files.
fn archive(files: &[(&str, &[u8])]) -> LoadedModel {
    let folder = tempfile::tempdir().expect("a folder");
    let mut archive =
        zip::ZipWriter::new(fs::File::create(folder.path().join("home.sh3d")).expect("created"));
    for (name, bytes) in files {
        archive
            .start_file(*name, zip::write::SimpleFileOptions::default())
            .expect("started");
        archive.write_all(bytes).expect("written");
    }
    archive.finish().expect("finished");
    load(&folder, "home.sh3d")
}

/// A picture of one pixel.
fn picture(color: [u8; 3]) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image::RgbImage::from_pixel(1, 1, image::Rgb(color))
        .write_to(&mut bytes, image::ImageFormat::Png)
        .expect("written");
    bytes.into_inner()
}

#[test]
fn pictures_and_materials_in_an_archive_are_used() {
    let floor = room("").replace(
        "</room>",
        "<texture attribute='floorTexture' image='1' width='40' height='20' xOffset='0.5' scale='2'/></room>",
    );
    let chair = "<pieceOfFurniture name='Chair' x='200' y='100' width='40' depth='40' height='80' model='2/x/chair.obj'/>\
                 <pieceOfFurniture name='Rug' x='200' y='200' width='90' depth='60' height='1' model='3'>\
                 <texture image='1' width='90' height='60'/></pieceOfFurniture>";
    let xml = format!("<home wallHeight='250'>{floor}{}{chair}</home>", walls(""));
    let obj = "mtllib chair.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 1\nvt 0 0\nvt 1 0\nvt 1 1\nusemtl seat\nf 1/1 2/2 3/3\nusemtl leg\nf 1 2 3\n";
    let mtl = "newmtl seat\nKd 1 1 1\nmap_Kd pictures\\cloth.png\nnewmtl leg\nKd 0.2 0.4 0.6\n";
    let (parquet, cloth) = (picture([10, 20, 30]), picture([200, 100, 50]));
    let LoadedModel { model, .. } = archive(&[
        ("Home.xml", xml.as_bytes()),
        ("1", &parquet),
        ("2/x/chair.obj", obj.as_bytes()),
        ("2/x/chair.mtl", mtl.as_bytes()),
        ("2/x/pictures/cloth.png", &cloth),
        ("3", b"v 0 0 0\nv 1 0 0\nv 1 0 1\nf 1 2 3\n"),
    ]);
    let scene = &model.scene;
    assert_eq!(scene.validate(), Ok(()));
    let texels: Vec<[u8; 4]> = scene
        .textures
        .iter()
        .map(|texture| texture.texels()[0])
        .collect();
    let index_of = |[r, g, b]: [u8; 3]| {
        texels
            .iter()
            .position(|texel| *texel == [r, g, b, 255])
            .expect("the picture") as u32
    };
    assert_eq!(texels.len(), 2, "each picture once");
    let faces = |texture: u32| {
        let is_it = move |t: &u32| {
            scene.materials[scene.triangles[*t as usize].material as usize].albedo_texture
                == Some(texture)
        };
        (0..scene.triangles.len() as u32).filter(is_it)
    };
    // Floor and rug, seen from above: a texture of 80 by 40 cm, offset by half; one of 90 by 60 cm
    // about the rug's centre.
    for triangle in faces(index_of([10, 20, 30])) {
        for vertex in scene.triangles[triangle as usize].vertices {
            let (p, t) = (
                scene.positions[vertex as usize],
                scene.texcoords[vertex as usize].as_dvec2(),
            );
            let expected = if p.y == 0.0 {
                glam::dvec2((p.x - 0.4) / 0.8, -p.z / 0.4)
            } else {
                glam::dvec2((p.x - 2.0) / 0.9, -(p.z - 2.0) / 0.6)
            };
            assert!((t - expected).length() < 1e-2, "{t} for {expected} at {p}");
        }
    }
    assert_eq!(faces(index_of([200, 100, 50])).count(), 1);
    assert!(
        scene
            .materials
            .iter()
            .any(|material| material.albedo == [0.2, 0.4, 0.6].map(linear_from_srgb)),
        "colours are those that Sweet Home 3D shows"
    );
}

/// Models are read as other OBJ files are: with comments, several material files and names in other
/// case.
#[test]
fn model_with_comments_and_libraries_is_used() {
    let piece =
        "<pieceOfFurniture x='200' y='100' width='40' depth='40' height='80' model='1/a.obj'/>";
    let xml = format!("<home>{}{}{piece}</home>", room(""), walls(""));
    let obj = "mtllib b.mtl A.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 1 # corner\nusemtl seat # red\nf 1 2 3 # face\n";
    let LoadedModel { model, .. } = archive(&[
        ("Home.xml", xml.as_bytes()),
        ("1/a.obj", obj.as_bytes()),
        ("1/a.mtl", b"newmtl seat # soft\nKd 0.2 0.4 0.6\n"),
        ("1/b.mtl", b"newmtl other\nKd 0 0 0\n"),
    ]);
    let materials = &model.scene.materials;
    let albedo = [0.2, 0.4, 0.6].map(linear_from_srgb);
    assert!(materials.iter().any(|m| m.albedo == albedo));
}

#[test]
fn furniture_without_a_readable_model_is_named() {
    let piece =
        "<pieceOfFurniture x='200' y='100' width='40' depth='40' height='80' model='1/a.obj'/>";
    let content = room("") + &walls("") + piece;
    let xml = format!("<home>{content}</home>");
    let damaged = archive(&[("Home.xml", xml.as_bytes()), ("1/a.obj", b"f 1 2 3\n")]);
    for (loaded, cause) in [
        (damaged, "the archive has no OBJ that can be read: 1/a.obj"),
        (
            plan("", &content),
            "models are read from an archive (.sh3d) only: 1/a.obj",
        ),
    ] {
        let notes = loaded.model.scene.summary.notes;
        assert!(notes.iter().any(|note| note.ends_with(cause)), "{notes:?}");
    }
}

/// A board of 1 m by 2 m by 10 cm with a pitch or roll of a right angle lies flat on the floor.
#[test]
fn pitch_and_roll_tilt_furniture() {
    let piece = |attributes: &str| {
        let piece = format!(
            "<pieceOfFurniture x='200' y='150' width='100' depth='10' height='200' elevation='0' \
             {attributes}/>"
        );
        plan("wallHeight='250'", &(room("") + &walls("") + &piece)).model
    };
    let down = |model: &PortalModel, x: f64, z: f64| {
        let height = 2.4;
        distance(model, [x, height, z], [0.0, -1.0, 0.0]).expect("a floor") - height as f32
    };
    let quarter = std::f64::consts::FRAC_PI_2;
    let near = |a: f32, b: f32| (a - b).abs() < 1e-4;
    let upright = piece("");
    assert!(near(down(&upright, 2.0, 1.5), -2.0) && near(down(&upright, 2.0, 2.3), 0.0));
    let pitched = piece(&format!("pitch='{quarter}'"));
    assert!(near(down(&pitched, 2.0, 1.5), -0.1) && near(down(&pitched, 2.0, 2.3), -0.1));
    let rolled = piece(&format!("roll='{quarter}'"));
    assert!(near(down(&rolled, 2.0, 1.5), -1.0) && near(down(&rolled, 2.9, 1.5), -1.0));
}

#[test]
fn what_a_plan_cannot_build_is_reported() {
    let size = "x='200' width='90' depth='10' height='200' elevation='0'";
    let levels =
        "<level id='l0' elevation='0' height='250'/><level id='l1' elevation='262' height='250'/>";
    let pieces = format!(
        "<pieceOfFurniture {size} y='150' staircaseCutOutShape='M0,0 v1 h1 v-1 z'/>\
         <doorOrWindow {size} y='0' cutOutShape='M0,0 v1 h1 v-1 z'/>\
         <doorOrWindow {size} y='300' cutOutShape='M0.5,0 L1,1 L0,1 z'>\
         <transformation name='sweethome3d_opening_on_hinge_1' matrix='1'/></doorOrWindow>\
         <pieceOfFurniture {size} y='200' staircaseCutOutShape='false'/>\
         <light {size} y='250'><lightSource x='0.5' y='0.5' z='0.5'/></light>\
         <polyline elevation='5'/><polyline/><label elevation='100' pitch='1.5'/>\
         <compass northDirection='1.5'/><wall><baseboard thickness='1' height='20'/></wall>"
    );
    let content = format!(
        "{levels}{}{}{pieces}",
        room("level='l0'"),
        walls("level='l0' height='200' heightAtEnd='250'")
    );
    let notes = plan("", &content).model.scene.summary.notes;
    for expected in [
        "1 staircase whose opening in floors and ceilings is not cut",
        "1 door or window with a hole of another shape or size, cut as the whole rectangle",
        "1 piece of furniture with moved parts, shown in the pose of the model",
        "1 baseboard left out",
        "1 polyline in 3D left out",
        "1 label in 3D left out",
        "1 lamp whose light is left out",
        "1 compass whose north is ignored: suns are placed as if it were upward in the plan",
        "1 room below the topmost storey with sloping walls, built with a level ceiling",
    ] {
        assert!(
            notes.iter().any(|note| note == expected),
            "{expected}: {notes:?}"
        );
    }
    let plain = plan("", &(room("") + &walls(""))).model.scene.summary.notes;
    assert_eq!(
        plain.iter().filter(|note| note.starts_with('1')).count(),
        0,
        "{plain:?}"
    );
}
