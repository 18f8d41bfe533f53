//! Names in OBJ and MTL files: encodings, comments and composed characters.

use super::obj_materials::RED;
use crate::folder::{Folder, TRIANGLE};

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
