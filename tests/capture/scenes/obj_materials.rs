//! Materials of OBJ files: libraries, textures, cutouts and emission.

use super::load_obj::obj;
use crate::folder::{Folder, TRIANGLE};
use glam::Vec2;
use headbox_scene::scene::Scene;

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
fn first_of_several_libraries_counts() {
    let folder = Folder::new();
    folder.write("a.obj", format!("mtllib a.mtl b.mtl\nusemtl m\n{TRIANGLE}"));
    folder.write("a.mtl", "newmtl m\nKd 0 1 0\nnewmtl m\nKd 1 0 0\n");
    folder.write("b.mtl", "newmtl m\nKd 0 0 1\n");
    let scene = folder.load("a.obj").expect("loaded");
    assert_eq!(scene.materials[0].albedo, [1.0, 0.0, 0.0]);
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

pub(super) const RED: [u8; 4] = [255, 0, 0, 255];
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
