//! OBJ files with defects: one small file per defect, and the note about it.

use crate::folder::{Folder, TRIANGLE};
use glam::{DVec3, Vec2, Vec3, dvec3};
use headbox_core::color::linear_from_srgb8;
use headbox_core::file_frame::UpAxis;
use headbox_scene::load::LoadOptions;
use headbox_scene::scene::Scene;

/// Loads an OBJ without other files.
fn obj(text: &str) -> Result<Scene, String> {
    let folder = Folder::new();
    folder.write("a.obj", text);
    folder.load("a.obj")
}

/// Loads an OBJ and returns its notes as they are displayed.
fn notes(text: &str) -> Vec<String> {
    let notes = obj(text).expect("survives").summary.notes;
    notes.iter().map(ToString::to_string).collect()
}

/// Loads [`TRIANGLE`] with `m.mtl` and images.
fn with_material(mtl: &str, images: &[(&str, &[[u8; 4]])]) -> Scene {
    let folder = Folder::new();
    folder.write("a.obj", format!("mtllib m.mtl\nusemtl m\n{TRIANGLE}"));
    folder.write("m.mtl", mtl);
    for (name, texels) in images {
        folder.write_image(name, texels);
    }
    folder.load("a.obj").expect("survives")
}

#[test]
fn clean_obj_has_no_notes() {
    let scene = obj(TRIANGLE).expect("clean");
    assert_eq!(scene.summary.notes, Vec::<String>::new());
    assert_eq!(
        (
            scene.triangles.len(),
            scene.materials.len(),
            scene.name.as_str()
        ),
        (1, 1, "a")
    );
    assert!(scene.sun.is_some() && scene.sky.is_some() && scene.headbox.is_none());
    assert!(scene.normals.is_empty() && scene.texcoords.is_empty() && scene.colors.is_empty());
}

#[test]
fn axes_and_unit_are_applied_and_remembered() {
    let folder = Folder::new();
    folder.write(
        "A.OBJ",
        "v 100 200 300\nv 101 200 300\nv 100 201 300\nvn 0 0 1\nf 1//1 2//1 3//1\n",
    );
    let options = LoadOptions {
        up: Some(UpAxis::Z),
        unit_m: Some(0.01),
    };
    let scene = folder.load_with("A.OBJ", &options).expect("clean");
    assert_eq!(scene.positions[0], DVec3::new(100.0, 300.0, -200.0) * 0.01);
    assert_eq!(scene.normals[0], Vec3::Y);
    assert_eq!(scene.surface(0, 0.2, 0.2).normal, Vec3::Y);
    assert!(
        (scene.frame.file_from_world(scene.positions[0]) - dvec3(100.0, 200.0, 300.0)).length()
            < 1e-12
    );
    let error = folder
        .load_with(
            "A.OBJ",
            &LoadOptions {
                up: None,
                unit_m: Some(0.0),
            },
        )
        .expect_err("no length");
    assert!(
        error.contains("A.OBJ: the unit is 0 m, but must be positive and finite"),
        "{error}"
    );
}

#[test]
fn coordinates_of_1e7_stay_exact() {
    let scene = obj("v 10000000.001 0 0\nv 10000000.002 0 0\nv 10000000.001 0.001 0\nf 1 2 3\n")
        .expect("clean");
    assert_eq!(scene.positions[0].x, 10_000_000.001);
    assert_eq!(scene.positions[1].x, 10_000_000.002);
    assert_eq!(scene.triangles.len(), 1);
}

#[test]
fn errors_name_file_cause_and_line() {
    let line_error = |text: &str, line: &str, cause: &str| {
        let error = obj(text).expect_err("malformed");
        assert!(
            error.contains("a.obj") && error.contains(line) && error.contains(cause),
            "{error}"
        );
    };
    line_error(
        "v 0 0 0\n\nv 1 oops 2\nv 0 1 0\nf 1 2 3\n",
        "line 3",
        "\"v 1 oops 2\" is not a position: three numbers",
    );
    line_error("v 0 0 0\nv 1 0\n", "line 2", "position");
    line_error("v 0,5 0 0\n", "line 1", "decimal comma");
    line_error("v 0 0 0\r\nvt\r\n", "line 2", "texture coordinate");
    line_error("v 0 0 0\nvn 1 0\n", "line 2", "normal");
    line_error(
        &format!("{TRIANGLE}\n\nf 1 2 x\n"),
        "line 7",
        "\"f 1 2 x\" is not a face",
    );
    line_error(&format!("{TRIANGLE}f 1/1/1/1 2 3\n"), "line 5", "face");
    line_error("", "a.obj: there is no triangle", "");
    line_error("not an obj at all \u{1}\u{2}\n", "there is no triangle", "");
    line_error(
        "v 0 0 0\nf 1 1 1\n",
        "there is no triangle (1 degenerate triangle left out)",
        "",
    );

    let folder = Folder::new();
    let error = folder.load("missing.obj").expect_err("absent");
    assert!(error.contains("missing.obj: No such file"), "{error}");
    let error = folder.load("a.foo").expect_err("unknown");
    let formats =
        "a.foo: unknown scene format; use an .obj, .gltf, .glb, .ply or .stl file, a home";
    assert!(error.contains(formats), "{error}");
    let error = folder.load("a.FBX").expect_err("to be converted");
    assert!(
        error.contains(".fbx scenes are not read; save the scene as .glb"),
        "{error}"
    );
}

#[test]
fn non_obj_is_refused() {
    assert_eq!(
        notes(&format!("{TRIANGLE}# end\n\ns off\ncstype bezier\n")),
        [""; 0]
    );
    assert_eq!(
        notes(&format!("{TRIANGLE}junk after the end\nmore\n")),
        ["2 unrecognised OBJ lines skipped"]
    );
}

#[test]
fn out_of_range_index_drops_face() {
    let text = format!("{TRIANGLE}f 1 2 9\nf 0 1 2\nf -1 -2 -4\nf 1 2 99999999999999\nf /1 2 3\n");
    assert_eq!(
        notes(&text),
        ["5 faces with a vertex index out of range left out"]
    );
    let scene =
        obj("vt 0 0\nvn 0 0 1\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/7/1 2/1/8 3\n").expect("survives");
    assert_eq!(scene.triangles.len(), 1);
    let expected =
        ["1 face with a texture coordinate or normal index out of range, which is ignored"];
    assert_eq!(scene.summary.notes, expected);
}

#[test]
fn relative_and_forward_indices_work() {
    let scene = obj(
        "f 1 2 3\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 5 0 0\nv 6 0 0\nv 5 1 0\nf -3 -2 -1\n",
    );
    let scene = scene.expect("survives");
    assert_eq!(scene.triangles.len(), 3);
    assert_eq!(scene.corners(2)[0], dvec3(5.0, 0.0, 0.0));
    assert_eq!(scene.summary.notes, ["1 duplicate triangle kept"]);
}

#[test]
fn partial_attributes_stay_with_faces() {
    let scene =
        obj("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0.5 0.25\nvn 1 0 1\nf 1 2 3\nf 1/1/1 3/1/1 2/1/1\n")
            .expect("survives");
    let corners = |t: usize| scene.triangles[t].vertices.map(|v| v as usize);
    assert_eq!(
        corners(0).map(|v| (scene.texcoords[v], scene.normals[v])),
        [(Vec2::ZERO, Vec3::ZERO); 3]
    );
    for vertex in corners(1) {
        assert_eq!(scene.texcoords[vertex], Vec2::new(0.5, 0.25));
        assert!((scene.normals[vertex] - Vec3::new(1.0, 0.0, 1.0).normalize()).length() < 1e-6);
    }
}

#[test]
fn non_finite_vertices_drop_triangles() {
    for word in [
        "nan",
        "-nan(ind)",
        "1.#QNAN",
        "-1.#IND00",
        "inf",
        "-Infinity",
        "1e999",
    ] {
        let text = format!("{TRIANGLE}v {word} 0 0\nf 1 2 4\nf 4 2 3\n");
        let line = text
            .lines()
            .position(|line| line.contains(word))
            .expect("written")
            + 1;
        let told = [
            format!("1 vertex with a coordinate that is NaN or infinite: line {line}"),
            "2 triangles with a corner that is NaN or infinite left out".to_owned(),
        ];
        assert_eq!(notes(&text), told, "{word}");
    }
    let scene = obj("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt nan 0\nvn nan nan nan\nf 1/1/1 2/1/1 3/1/1\n")
        .expect("survives");
    assert!(scene.texcoords.is_empty() && scene.normals.is_empty());
}

#[test]
fn degenerate_triangles_are_dropped() {
    let text = format!("{TRIANGLE}v 2 0 0\nv 0.3333333333333333 0 0\nf 1 1 2\nf 1 2 4\nf 2 2 2\n");
    assert_eq!(notes(&text), ["3 degenerate triangles left out"]);
    let tiny = obj("v 0 0 0\nv 1e-9 0 0\nv 0 1e-9 0\nf 1 2 3\n").expect("small is not degenerate");
    assert_eq!(tiny.triangles.len(), 1);
}

#[test]
fn duplicate_triangles_kept_and_counted() {
    let text = format!("{TRIANGLE}v 0 0 0\nv -0.0 1 0\nf 2 3 1\nf 3 2 1\nf 4 2 5\n");
    let scene = obj(&text).expect("survives");
    assert_eq!(scene.triangles.len(), 4);
    assert_eq!(scene.summary.notes, ["3 duplicate triangles kept"]);
}

#[test]
fn ignored_elements_are_counted() {
    let text = "g default\nv 0 0 0\nv 1 0 0\nv 0 1 0\no whole\ng part\nf 1 2 3\ng hollow\ng also hollow\no last\nf 1 2\nf\nl 1 2\np 1\n";
    let expected = [
        "2 elements without a surface (points, lines, curves) left out",
        "2 groups without faces",
        "2 faces with fewer than three corners left out",
    ];
    assert_eq!(notes(text), expected);
}

#[test]
fn polygons_triangulate_inside_outline() {
    let scene =
        obj("v 0 0 0\nv 2 0 0\nv 2 1 0\nv 1 1 0\nv 1 2 0\nv 0 2 0\nf 3 4 5 6 1 2\nf 1 2 3 4\n")
            .expect("clean");
    let area = |t: u32| {
        let [a, b, c] = scene.corners(t);
        (b - a).cross(c - a).length() / 2.0
    };
    assert_eq!(
        (0..4).map(area).sum::<f64>(),
        3.0,
        "an L of area 3; a fan would cover 1 of it twice, and 1 beside it"
    );
    assert_eq!(scene.triangles.len(), 6);
}

#[test]
fn line_ends_comments_continuations_read() {
    let scene = obj(
        "\u{feff}v\t0 0 0 # here\r  v 1 0 \\\r 0\rv 0 1 0 1.0\rusemtl\tm # 1\rf 1/ 2// 3 # there\r",
    )
    .expect("survives");
    assert_eq!(scene.triangles.len(), 1);
    assert_eq!(
        scene.summary.notes,
        ["1 material used but not defined, shown as plain grey: m # 1"]
    );
}

#[test]
fn vertex_colours_srgb_white_where_missing() {
    let scene = obj("v 0 0 0 1 0.2 0\nv 1 0 0\nv 0 1 0 x y z\nf 1 2 3\n").expect("survives");
    let expected_note = "1 vertex colour could not be read, shown as white";
    assert_eq!(scene.summary.notes, [expected_note]);
    let expected = Vec3::new(1.0, linear_from_srgb8(51), 0.0);
    assert!((scene.colors[0] - expected).length() < 1e-6);
    assert_eq!(scene.colors[1..], [Vec3::ONE; 2]);
}

#[test]
fn vertex_colours_of_bytes_and_polypaint_are_scaled() {
    let red = linear_from_srgb8(200);
    let scene = obj("v 0 0 0 200 0 0\nv 1 0 0 200 0 0\nv 0 1 0\nf 1 2 3\n").expect("survives");
    assert!((scene.colors[0] - Vec3::new(red, 0.0, 0.0)).length() < 1e-6);
    assert_eq!(scene.colors[2], Vec3::ONE);
    let expected = "2 vertex colours divided by the value that the file has for white: 255";
    assert_eq!(scene.summary.notes, [expected]);

    let text = TRIANGLE.replace("f 1", "#MRGB ffc80000ffc80000\n#MRGB ff0000ff\nf 1");
    let scene = obj(&text).expect("clean");
    assert!((scene.colors[0] - Vec3::new(red, 0.0, 0.0)).length() < 1e-6);
    assert_eq!(scene.colors[2], Vec3::Z);
    assert_eq!(scene.summary.notes, [""; 0]);

    let bright = notes("v 0 0 0 1.5 0 0\nv 1 0 0 1 0.5 0\nv 0 1 0 0 0 0\nf 1 2 3\n");
    assert_eq!(
        bright,
        ["1 vertex colour outside 0 to 1, limited to that range"]
    );
}

/// GBK of 木, which is valid UTF-8 by chance.
const WOOD: &[u8] = b"\xc4\xbe";

#[test]
fn texts_and_names_in_other_encodings_are_read() {
    let utf16 = |text: &str| -> Vec<u8> {
        let units = "\u{feff}".encode_utf16().chain(text.encode_utf16());
        units.flat_map(u16::to_le_bytes).collect()
    };
    let obj = |name: &[u8]| {
        let head: &[u8] = b"mtllib m.mtl\nusemtl ";
        [head, name, b"\n", TRIANGLE.as_bytes()].concat()
    };
    let mtl = |name: &[u8], file: &[u8]| [b"newmtl ", name, b"\nmap_Kd ", file, b".png\n"].concat();
    let latin = (b"gr\xfcn".as_slice(), "grün.png");
    let japanese = (b"\x95\x5c".as_slice(), "表.png"); // its second byte is a backslash
    for (obj, mtl, file) in [
        (obj(b"m"), mtl(b"m", WOOD), "木.png"),
        (obj(latin.0), mtl(latin.0, latin.0), latin.1),
        (obj(japanese.0), mtl(japanese.0, japanese.0), japanese.1),
        (obj(WOOD), mtl("木".as_bytes(), "木".as_bytes()), "木.png"),
        (
            utf16(&format!("mtllib m.mtl\r\nusemtl 木\r\n{TRIANGLE}")),
            mtl(WOOD, b"m"),
            "m.png",
        ),
        (
            obj("木".as_bytes()),
            utf16("newmtl 木\nmap_Kd 木.png\n"),
            "木.png",
        ),
    ] {
        let folder = Folder::new();
        folder.write("a.obj", obj);
        folder.write("m.mtl", mtl);
        folder.write_image(file, &[RED]);
        let scene = folder.load("a.obj").expect("survives");
        let albedo = scene.surface(0, 0.2, 0.2).albedo;
        assert_eq!(albedo, [1.0, 0.0, 0.0], "{file}: {:?}", scene.summary.notes);
    }
}

#[cfg(unix)]
#[test]
fn file_names_are_matched_in_their_bytes() {
    use std::os::unix::ffi::OsStrExt;
    let folder = Folder::new();
    folder.write("a.obj", format!("mtllib m.mtl\nusemtl m\n{TRIANGLE}"));
    folder.write(
        "m.mtl",
        [b"newmtl m\nmap_Kd gr\xfcn.png\n".as_slice()].concat(),
    );
    folder.write_image("image.png", &[RED]);
    let raw = std::ffi::OsStr::from_bytes(b"gr\xfcn.png");
    std::fs::rename(folder.path("image.png"), folder.path("").join(raw)).expect("renamed");
    let scene = folder.load("a.obj").expect("survives");
    assert_eq!(scene.surface(0, 0.2, 0.2).albedo, [1.0, 0.0, 0.0]);
}

#[test]
fn names_stay_distinct_in_other_encodings() {
    let folder = Folder::new();
    let faces: &[u8] = b"usemtl \xfc\nf 1 2 3\nusemtl \xf6\nf 1 2 3\n";
    folder.write(
        "a.obj",
        [b"mtllib m.mtl\n", TRIANGLE.as_bytes(), faces].concat(),
    );
    folder.write("m.mtl", b"newmtl \xfc\nKd 1 0 0\nnewmtl \xf6\nKd 0 1 0\n");
    let scene = folder.load("a.obj").expect("survives");
    assert_eq!(scene.surface(1, 0.2, 0.2).albedo, [1.0, 0.0, 0.0]);
    assert_eq!(scene.surface(2, 0.2, 0.2).albedo, [0.0, 1.0, 0.0]);
}

#[test]
fn comments_behind_names_are_left_out() {
    for (used, defined, map) in [
        ("r # wall", "r # red", "t.png # comment"),
        ("r", "r # red", "-s 1 1 t.png #comment"),
        ("r #wall", "r", "t.png -o 0 0 # comment"),
        ("r #1", "r #1", "-unknown 3 t.png"),
    ] {
        let folder = Folder::new();
        folder.write(
            "a.obj",
            format!("mtllib m.mtl # library\nusemtl {used}\n{TRIANGLE}"),
        );
        folder.write("m.mtl", format!("newmtl {defined}\nmap_Kd {map}\n"));
        folder.write_image("t.png", &[RED]);
        let scene = folder.load("a.obj").expect("survives");
        assert_eq!(scene.surface(0, 0.2, 0.2).albedo, [1.0, 0.0, 0.0], "{used}");
        let note = "1 option of a map not supported and ignored: -unknown 3";
        let has_note = scene.summary.notes.iter().any(|n| n == note);
        assert_eq!(has_note, map.starts_with("-unknown"), "{used}");
    }
}

#[test]
fn first_of_several_libraries_counts() {
    let folder = Folder::new();
    folder.write("a.obj", format!("mtllib a.mtl b.mtl\nusemtl m\n{TRIANGLE}"));
    folder.write("a.mtl", "newmtl m\nKd 0 1 0\nnewmtl m\nKd 1 0 0\n");
    folder.write("b.mtl", "newmtl m\nKd 0 0 1\n");
    let scene = folder.load("a.obj").expect("loaded");
    assert_eq!(scene.materials[0].albedo, [1.0, 0.0, 0.0]);
}

#[test]
fn decomposed_names_are_found() {
    let folder = Folder::new();
    folder.write(
        "a.obj",
        format!("mtllib T\u{fc}r.mtl\nusemtl gru\u{308}n\n{TRIANGLE}"),
    );
    folder.write("Tu\u{308}r.mtl", "newmtl gr\u{fc}n\nKd 0 1 0\n");
    let scene = folder.load("a.obj").expect("loaded");
    assert_eq!(scene.materials[0].albedo, [0.0, 1.0, 0.0]);
}

#[test]
fn missing_material_files_and_materials_are_grey() {
    let text = format!("mtllib no such.mtl\nusemtl\nusemtl wood\n{TRIANGLE}");
    let scene = obj(&text).expect("survives");
    let expected = [
        "2 material files could not be read: no (no such file), such.mtl (no such file)",
        "1 material used but not defined, shown as plain grey: wood",
    ];
    assert_eq!(scene.summary.notes, expected);
    assert_eq!(scene.surface(0, 0.2, 0.2).albedo, [0.6; 3]);
}

#[test]
fn several_mtl_files_and_spaced_names_found() {
    let folder = Folder::new();
    folder.write(
        "a.obj",
        format!(
            "usemtl one\n{TRIANGLE}mtllib my file.mtl\nmtllib x.mtl Y.MTL\nusemtl two\nf 1 3 2\n"
        ),
    );
    folder.write("my file.mtl", "newmtl one\nKd 1 0 0\n");
    folder.write("x.mtl", "newmtl unused\nmap_Kd nowhere.png\n");
    folder.write("y.mtl", "newmtl two\nKd 0 1 0\n");
    let scene = folder.load("a.obj").expect("survives");
    assert_eq!(
        scene.surface(0, 0.2, 0.2).albedo,
        [1.0, 0.0, 0.0],
        "a library may come after its use"
    );
    assert_eq!(scene.surface(1, 0.2, 0.2).albedo, [0.0, 1.0, 0.0]);
    assert_eq!(
        scene.materials.len(),
        2,
        "what nothing uses is left out, and its textures are not looked for"
    );
    let [duplicate, coplanar] = &scene.summary.notes[..] else {
        panic!("{:?}", scene.summary.notes);
    };
    assert_eq!(duplicate, "1 duplicate triangle kept");
    assert!(
        coplanar.starts_with("2 triangles in one plane"),
        "{coplanar}"
    );
}

const RED: [u8; 4] = [255, 0, 0, 255];
const HOLE: [u8; 4] = [0, 255, 0, 0];

#[test]
fn unreadable_textures_leave_the_plain_colour() {
    let folder = Folder::new();
    folder.write(
        "a.obj",
        format!("mtllib m.mtl\nusemtl m\n{TRIANGLE}usemtl n\nf 1 3 2\nusemtl o\nf 2 1 3\n"),
    );
    folder.write(
        "m.mtl",
        "newmtl m\nKd 0 1 0\nmap_Kd gone.png\nnewmtl n\nmap_Kd broken.png\nnewmtl o\nmap_Kd bomb.png\n",
    );
    folder.write("broken.png", "not an image");
    folder.write("bomb.png", crate::folder::png_header(60_000, 60_000));
    let scene = folder.load("a.obj").expect("survives");
    assert_eq!(scene.surface(0, 0.2, 0.2).albedo, [0.0, 1.0, 0.0]);
    let note = &scene.summary.notes[0];
    assert!(note.starts_with("3 textures could not be read: "), "{note}");
    assert!(
        note.contains("gone.png (no such file)")
            && note.contains("broken.png (")
            && note.contains("bomb.png ("),
        "{note}"
    );
}

#[test]
fn unreadable_maps_leave_grey_surfaces() {
    let material =
        |mtl: &str| with_material(&format!("newmtl m\n{mtl}\n"), &[]).materials[0].clone();
    let grey = material("").albedo;
    assert_eq!(
        material("Kd 0 0 0\nmap_Kd gone.png").albedo,
        grey,
        "0 beside a map is not meant"
    );
    assert_eq!(material("Kd 0 0 0").albedo, [0.0; 3]);
    assert_eq!(material("Ke 1 1 1\nmap_Ke gone.png").emission, [0.0; 3]);
}

#[test]
fn vertex_colours_set_albedo() {
    let folder = Folder::new();
    folder.write(
        "a.obj",
        "v 0 0 0 1 1 1\nv 1 0 0 1 1 1\nv 0 1 0 0 1 1\nf 1 2 3\n",
    );
    let scene = folder.load("a.obj").expect("survives");
    assert_eq!(scene.surface(0, 0.0, 0.0).albedo, [1.0; 3], "white");
    assert_eq!(scene.surface(0, 0.0, 1.0).albedo, [0.0, 1.0, 1.0]);
}

#[test]
fn textures_are_found_under_other_spellings() {
    let spellings = [
        ("wood.png", false),
        ("\"wood.png\"", false),
        ("sub/../wood.png", false),
        ("WOOD.PNG", true),
        ("C:\\Users\\x\\Textures\\Wood.png", true),
        ("/home/x/wood.png", true),
        ("-s 1 1 1 -clamp on wood.png", false),
    ];
    for (written, renamed) in spellings {
        let folder = Folder::new();
        folder.write("sub/keep", "");
        folder.write("a.obj", format!("mtllib m.mtl\nusemtl m\n{TRIANGLE}"));
        folder.write("m.mtl", format!("newmtl m\nmap_Kd {written}\n"));
        folder.write_image("wood.png", &[RED]);
        let scene = folder.load("a.obj").expect("survives");
        assert_eq!(
            scene.surface(0, 0.2, 0.2).albedo,
            [1.0, 0.0, 0.0],
            "{written}"
        );
        let note = "1 texture found in another folder or spelling than specified";
        assert_eq!(
            scene.summary.notes.iter().any(|n| n.starts_with(note)),
            renamed,
            "{written}"
        );
    }
    // Maps are relative to the material file.
    let folder = Folder::new();
    folder.write("a.obj", format!("mtllib sub\\m.mtl\nusemtl m\n{TRIANGLE}"));
    folder.write("sub/m.mtl", "newmtl m\nmap_Kd wood.png\n");
    folder.write_image("sub/wood.png", &[RED]);
    assert_eq!(folder.load("a.obj").expect("survives").textures.len(), 1);
}

#[test]
fn textures_are_shared_by_path() {
    let mtl = "newmtl m\nmap_Kd a.png\nmap_Ke ./a.png\nKe 1 1 1\n";
    assert_eq!(with_material(mtl, &[("a.png", &[RED])]).textures.len(), 1);
    let mtl = "newmtl m\nmap_Kd a.png\nmap_Ke a.png\n";
    let scene = with_material(mtl, &[("a.png", &[RED])]);
    assert_eq!(scene.textures.len(), 1);
    assert_eq!(
        scene.surface(0, 0.1, 0.1).emission,
        [1.0, 0.0, 0.0],
        "a map without Ke shines as it is"
    );
}

#[test]
fn map_options_place_the_texture() {
    let folder = Folder::new();
    folder.write(
        "a.obj",
        "mtllib m.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0.5 0.5\nf 1/1 2/1 3/1\n",
    );
    folder.write(
        "m.mtl",
        "newmtl m\nmap_Kd -o 0.25 0 -s 2 3 a.png\nmap_Ke a.png\n",
    );
    folder.write_image("a.png", &[RED]);
    let scene = folder.load("a.obj").expect("survives");
    assert_eq!(scene.texcoords[0], Vec2::new(1.25, 1.5));
    assert_eq!(
        scene.emission_texcoords[0],
        Vec2::new(0.5, 0.5),
        "the emission has its own placement"
    );
    assert!(scene.summary.notes.is_empty(), "{:?}", scene.summary.notes);
}

#[test]
fn dissolve_of_one_half_drops_triangles() {
    let text = |mtl: &str| {
        let folder = Folder::new();
        folder.write(
            "a.obj",
            format!("mtllib m.mtl\nusemtl m\n{TRIANGLE}v 1 1 0\nf 1 2 4 3\nusemtl n\nf 1 2 3\n"),
        );
        folder.write("m.mtl", format!("newmtl n\nnewmtl m\n{mtl}\n"));
        let scene = folder.load("a.obj").expect("survives");
        (scene.triangles.len(), scene.summary.notes.join(" "))
    };
    for glass in ["d 0.5", "Tr 0.5", "d 0\nmap_Kd missing.png"] {
        let (count, notes) = text(glass);
        assert_eq!(count, 1, "{glass}");
        assert!(
            notes.contains("3 triangles with an opacity of one half or less left out"),
            "{notes}"
        );
    }
    for solid in ["d 0.51", "Tr 0.49", "d 1\nTr 1", "illum 4"] {
        assert_eq!(text(solid).0, 4, "{solid}");
    }
    let (count, notes) = text("Tr 1");
    assert!(
        count == 4 && notes.contains("1 material with Tr 1 and no d, shown as opaque"),
        "{notes}"
    );
}

#[test]
fn cutouts_from_map_d_and_alpha() {
    let two: &[[u8; 4]] = &[RED, HOLE];
    let cut = |mtl: &str, images: &[(&str, &[[u8; 4]])]| {
        let scene = with_material(&format!("newmtl m\n{mtl}\n"), images);
        scene.materials[0]
            .cutout
            .and_then(|cutout| cutout.texture)
            .map(|texture| scene.textures[texture as usize].sample(0.75, 0.5)[3])
    };
    assert_eq!(
        cut("map_Kd a.png\nmap_d a.png", &[("a.png", two)]),
        Some(0.0)
    );
    assert_eq!(
        cut("map_Kd a.png\nd 0.3", &[("a.png", two)]),
        Some(0.0),
        "claims transparency"
    );
    assert_eq!(cut("map_Kd a.png\nillum 4", &[("a.png", two)]), Some(0.0));
    assert_eq!(
        cut("map_Kd a.png", &[("a.png", two)]),
        Some(0.0),
        "the only word on opacity"
    );
    assert_eq!(
        cut("map_Kd a.png\nmap_d a.png", &[("a.png", &[RED, RED])]),
        None,
        "alpha that never varies"
    );
    let grey: &[[u8; 4]] = &[[255; 4], [10, 10, 10, 255]];
    assert_eq!(
        cut("map_d g.png", &[("g.png", grey)]),
        Some(10.0 / 255.0),
        "luminance of a separate image"
    );
    for same in [
        "map_Kd g.png\nmap_d g.png",
        "map_Kd g.png\nmap_opacity g.png",
    ] {
        assert_eq!(cut(same, &[("g.png", grey)]), Some(10.0 / 255.0), "{same}");
    }
    let colour: &[[u8; 4]] = &[[255; 4], [10, 10, 11, 255]];
    assert_eq!(
        cut("map_Kd a.png\nmap_d a.png", &[("a.png", colour)]),
        None,
        "a colour image without alpha"
    );
    assert_eq!(cut("map_d missing.png", &[]), None);
}

#[test]
fn emission_from_ke_or_bright_ambient() {
    let scene = with_material("newmtl m\nKe 2 3 4\nKa 20 20 20\n", &[]);
    assert_eq!(scene.materials[0].emission, [2.0, 3.0, 4.0]);
    let scene = with_material("newmtl m\nKe 0 0 0\nKa 20 20 20\nKd 1 1 1\n", &[]);
    assert_eq!(scene.materials[0].emission, [20.0; 3]);
    assert_eq!(
        scene.summary.notes,
        ["1 material with an ambient colour above 1, used as emission: m"]
    );
    let scene = with_material("newmtl m\nKa 1 1 1\nKd 7 0.5 -1\n", &[]);
    assert_eq!(
        (scene.materials[0].emission, scene.materials[0].albedo),
        ([0.0; 3], [1.0, 0.5, 0.0])
    );
    assert_eq!(
        scene.summary.notes,
        ["1 material with a diffuse colour outside 0 to 1, limited to that range: m"]
    );
    let scene = with_material("newmtl m\nKd 0 0 0\nmap_Kd a.png\n", &[("a.png", &[RED])]);
    assert_eq!(
        scene.materials[0].albedo, [1.0; 3],
        "black under a texture means that nobody set it"
    );
}

#[test]
fn every_image_format_is_read() {
    for name in [
        "a.png", "a.jpg", "a.bmp", "a.tga", "a.tif", "a.webp", "a.gif", "a.hdr",
    ] {
        let scene = with_material(
            &format!("newmtl m\nmap_Kd {name}\n"),
            &[(name, &[[255, 255, 255, 255]; 4])],
        );
        assert_eq!(scene.summary.notes, Vec::<String>::new(), "{name}");
        assert!(
            scene.surface(0, 0.2, 0.2).albedo.iter().all(|&c| c > 0.99),
            "{name}"
        );
    }
}

#[test]
fn result_independent_of_threads() {
    let folder = Folder::new();
    let faces: String = (0..20).map(|i| format!("usemtl m{i}\nf 1 2 3\n")).collect();
    folder.write(
        "a.obj",
        format!("mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\n{faces}"),
    );
    let materials: String = (0..20)
        .map(|i| format!("newmtl m{i}\nmap_Kd {}.png\n", i % 7))
        .collect();
    folder.write("m.mtl", materials);
    for i in 0..6_u8 {
        folder.write_image(&format!("{i}.png"), &[[i * 40, 0, 0, 255]; 3]);
    }
    let with_threads = |count: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(count)
            .build()
            .expect("a pool");
        pool.install(|| folder.load("a.obj").expect("survives"))
    };
    let (one, four) = (with_threads(1), with_threads(4));
    assert_eq!(
        (one.textures, one.materials, one.triangles),
        (four.textures, four.materials, four.triangles)
    );
    assert_eq!(one.summary, four.summary);
    assert_eq!(
        one.summary.notes[0],
        "1 texture could not be read: 6.png (no such file)"
    );
}
