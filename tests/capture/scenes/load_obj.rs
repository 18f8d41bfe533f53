//! OBJ files with defects: one small file per defect, and the note about it.

use crate::folder::{Folder, TRIANGLE};
use glam::{DVec3, Vec2, Vec3, dvec3};
use headbox_core::color::linear_from_srgb8;
use headbox_core::file_frame::UpAxis;
use headbox_scene::load::LoadOptions;
use headbox_scene::scene::Scene;

/// Loads an OBJ without other files.
pub(super) fn obj(text: &str) -> Result<Scene, String> {
    let folder = Folder::new();
    folder.write("a.obj", text);
    folder.load("a.obj")
}

/// Loads an OBJ and returns its notes as they are displayed.
pub(super) fn notes(text: &str) -> Vec<String> {
    let notes = obj(text).expect("survives").summary.notes;
    notes.iter().map(ToString::to_string).collect()
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
    let error = folder.load("a.ldi").expect_err("a capture");
    assert!(error.contains("already captured; show it"), "{error}");
    let error = folder.load("a.jpg").expect_err("an image");
    assert!(error.contains("name the folder"), "{error}");
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
