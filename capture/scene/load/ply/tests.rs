use crate::load::{LoadOptions, load, load_grouped};
use crate::scene::Scene;
use glam::{Vec2, Vec3, dvec3};
use headbox_core::color::linear_from_srgb8;
use headbox_core::file_frame::UpAxis;
use std::fs;
use std::path::Path;

const OPTIONS: LoadOptions = LoadOptions {
    up: Some(UpAxis::Y),
    unit_m: Some(1.0),
};

/// A square with vertex colours, normals and an element to skip, in each format.
const PROPERTIES: &str = "comment a test\nelement vertex 4\nproperty float x\nproperty double y\n\
    property float32 z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
    element edge 1\nproperty int a\nproperty list uchar short b\n\
    element face 1\nproperty list uchar int vertex_indices\nend_header\n";
const VERTICES: [([f64; 3], [u8; 3]); 4] = [
    ([0.0, 0.0, 0.0], [200, 30, 30]),
    ([1.0, 0.0, 0.0], [200, 30, 30]),
    ([1.0, 1.0, 0.0], [200, 30, 30]),
    ([0.0, 1.0, 0.0], [0, 255, 0]),
];

fn ascii() -> Vec<u8> {
    let mut text = format!("ply\nformat ascii 1.0\n{PROPERTIES}");
    for ([x, y, z], [r, g, b]) in VERTICES {
        text += &format!("{x} {y} {z} {r} {g} {b}\n");
    }
    (text + "7 2 1 -1\n4 0 1 2 3").into_bytes()
}

fn binary(is_big: bool) -> Vec<u8> {
    let order = if is_big { "big" } else { "little" };
    let mut bytes = format!("ply\r\nformat binary_{order}_endian 1.0\r\n")
        .replace("\r\n", "\n")
        .into_bytes();
    bytes.extend(PROPERTIES.bytes());
    let mut push = |value: &[u8]| {
        if is_big {
            bytes.extend(value.iter().rev());
        } else {
            bytes.extend(value);
        }
    };
    for ([x, y, z], color) in VERTICES {
        push(&(x as f32).to_le_bytes());
        push(&y.to_le_bytes());
        push(&(z as f32).to_le_bytes());
        color.iter().for_each(|c| push(&[*c]));
    }
    push(&7_i32.to_le_bytes());
    push(&[2]);
    push(&1_i16.to_le_bytes());
    push(&(-1_i16).to_le_bytes());
    push(&[4]);
    (0..4_i32).for_each(|index| push(&index.to_le_bytes()));
    bytes
}

fn load_bytes(bytes: &[u8]) -> Result<Scene, String> {
    let folder = tempfile::tempdir().expect("a folder");
    load_in(folder.path(), bytes)
}

fn load_in(folder: &Path, bytes: &[u8]) -> Result<Scene, String> {
    let path = folder.join("a.ply");
    fs::write(&path, bytes).expect("written");
    let scene = load(&path, &OPTIONS).map_err(|error| error.to_string())?;
    assert_eq!(scene.validate(), Ok(()));
    Ok(scene)
}

#[test]
fn all_formats_give_the_same_mesh() {
    for bytes in [ascii(), binary(false), binary(true)] {
        let scene = load_bytes(&bytes).expect("loads");
        assert_eq!((scene.positions.len(), scene.triangles.len()), (4, 2));
        assert_eq!(scene.positions[2], dvec3(1.0, 1.0, 0.0));
        let [r, g, b] = [200, 30, 30].map(linear_from_srgb8);
        assert!((scene.colors[0] - Vec3::new(r, g, b)).length() < 1e-6);
        assert!((scene.colors[3] - Vec3::Y).length() < 1e-6);
        assert_eq!(scene.materials[0].albedo, [1.0; 3]);
        assert_eq!(scene.summary.notes, ["1 PLY element left out: edge"]);
    }
    let crlf = String::from_utf8(ascii())
        .expect("text")
        .replace('\n', "\r\n");
    assert!(load_bytes(crlf.as_bytes()).is_ok());
}

#[test]
fn textures_of_corners_and_vertices_are_mapped() {
    let image = image::RgbImage::from_pixel(2, 2, image::Rgb([255, 0, 0]));
    let head = "ply\nformat ascii 1.0\ncomment TextureFile t.png\nelement vertex 3\n\
        property float x\nproperty float y\nproperty float z\n";
    let by_corner = format!(
        "{head}element face 1\nproperty list uchar int vertex_index\n\
         property list uchar float texcoord\nproperty int texnumber\nend_header\n\
         0 0 0\n1 0 0\n0 1 0\n3 0 1 2 6 0 0 1 0 0.5 1 0\n"
    );
    let by_vertex = format!(
        "{head}property float s\nproperty float t\nelement face 1\n\
         property list uchar int vertex_indices\nend_header\n\
         0 0 0 0 0\n1 0 0 1 0\n0 1 0 0.5 1\n3 0 1 2\n"
    );
    for text in [by_corner.as_str(), &by_vertex] {
        let folder = tempfile::tempdir().expect("a folder");
        image.save(folder.path().join("t.png")).expect("an image");
        let scene = load_in(folder.path(), text.as_bytes()).expect("loads");
        assert_eq!(scene.summary.notes, [""; 0]);
        assert_eq!(scene.texcoords[2], Vec2::new(0.5, 1.0));
        assert_eq!(scene.surface(0, 0.2, 0.2).albedo, [1.0, 0.0, 0.0]);
    }
    let notes = load_bytes(by_corner.as_bytes())
        .expect("loads")
        .summary
        .notes;
    assert_eq!(notes, ["1 texture could not be read: t.png (no such file)"]);
}

#[test]
fn alpha_of_texture_cuts_holes() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut image = image::RgbaImage::from_pixel(2, 1, image::Rgba([255; 4]));
    image.put_pixel(1, 0, image::Rgba([255, 255, 255, 0]));
    image.save(folder.path().join("t.png")).expect("written");
    let text = "ply\nformat ascii 1.0\ncomment TextureFile t.png\nelement vertex 3\n\
        property float x\nproperty float y\nproperty float z\nproperty float s\n\
        property float t\nelement face 1\nproperty list uchar int vertex_indices\n\
        end_header\n0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n";
    let scene = load_in(folder.path(), text.as_bytes()).expect("loaded");
    assert!(scene.materials[0].cutout.is_some());
}

#[test]
fn colours_of_sixteen_bits_may_be_bytes() {
    for (white, scaled) in [(255, "255"), (65_535, "65535")] {
        let text = format!(
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
             property float z\nproperty ushort red\nproperty ushort green\nproperty ushort blue\n\
             element face 1\nproperty list uchar int vertex_indices\nend_header\n\
             0 0 0 {white} 0 0\n1 0 0 {white} 0 0\n0 1 0 {white} 0 0\n3 0 1 2\n"
        );
        let scene = load_bytes(text.as_bytes()).expect("loads");
        assert_eq!(scene.surface(0, 0.2, 0.2).albedo, [1.0, 0.0, 0.0]);
        assert!(
            scene.summary.notes[0].contains(scaled),
            "{:?}",
            scene.summary.notes
        );
    }
}

#[test]
fn face_colours_strips_and_defects_are_read() {
    let head = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
        property float z\nproperty float alpha\n";
    let points = "0 0 0 1\n1 0 0 0.5\n0 1 0 1\n1 1 0 1\n";
    let faces = format!(
        "{head}element face 3\nproperty list uchar int vertex_indices\nproperty uchar red\n\
         property uchar green\nproperty uchar blue\nend_header\n{points}\
         3 0 1 2 255 0 0\n3 1 2 9 0 0 0\n2 0 1 0 0 0\n"
    );
    let scene = load_bytes(faces.as_bytes()).expect("loads");
    assert_eq!(scene.surface(0, 0.2, 0.2).albedo, [1.0, 0.0, 0.0]);
    let expected = [
        "1 face with fewer than three corners left out",
        "1 face with a vertex index out of range left out",
        "1 vertex with an alpha below 1, shown as opaque",
    ];
    assert_eq!(scene.summary.notes, expected);
    let strips = format!(
        "{head}element tristrips 1\nproperty list int int vertex_indices\nend_header\n{points}\
         8 0 1 2 3 -1 0 2 1\n"
    );
    let scene = load_bytes(strips.as_bytes()).expect("loads");
    let normals = (0..3).map(|t| {
        let [a, b, c] = scene.corners(t);
        (b - a).cross(c - a).z
    });
    assert_eq!(normals.collect::<Vec<_>>(), [1.0, 1.0, -1.0]);
}

#[test]
fn clouds_and_damaged_files_are_refused_with_the_cause() {
    let splats = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n\
        property float z\nproperty float f_dc_0\nend_header\n0 0 0 0\n";
    let cloud = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n\
        property float z\nend_header\n0 0 0\n";
    let text = String::from_utf8(ascii()).expect("text");
    let huge = text.replace("vertex 4", "vertex 4294967295");
    let huge_list = text.replace("\n4 0 1 2 3", "\n4000000000 0 1 2 3");
    let comma = text.replace("\n1 1 0", "\n1 0,5 0");
    let mut huge_binary = binary(false);
    let at = huge_binary
        .windows(8)
        .position(|w| w == b"vertex 4")
        .expect("there");
    huge_binary.splice(at + 7..at + 8, *b"99999999999999999999");
    for (bytes, cause) in [
        (splats.as_bytes(), "a cloud of Gaussian splats, not a mesh"),
        (cloud.as_bytes(), "a cloud of 1 points without a face"),
        (b"solid\n", "not a PLY"),
        (b"ply\nformat ascii 1.0\n", "no end_header"),
        (b"ply\nformat odd 1.0\nend_header\n", "no known format"),
        (
            b"ply\nelephant 4\nend_header\n",
            "\"elephant 4\" is not a line",
        ),
        (
            huge.as_bytes(),
            "4294967295 records of the element \"vertex\"",
        ),
        (
            huge_list.as_bytes(),
            "list \"vertex_indices\" has 4000000000",
        ),
        (&huge_binary, "is not a line of a PLY header"),
        (
            comma.as_bytes(),
            "vertex 2 of 4: \"0,5\" is not a number; write 0.5",
        ),
    ] {
        let error = load_bytes(bytes).expect_err("damaged");
        assert!(error.contains("a.ply") && error.contains(cause), "{error}");
    }
}

#[test]
fn truncated_and_changed_files_never_panic() {
    let folder = tempfile::tempdir().expect("a folder");
    for bytes in [ascii(), binary(false), binary(true)] {
        for end in 0..bytes.len() - 1 {
            assert!(load_in(folder.path(), &bytes[..end]).is_err(), "{end}");
        }
        for at in 0..bytes.len() {
            for value in [0, b'9', b'-', b'\n', 255] {
                let mut changed = bytes.clone();
                changed[at] = value;
                if let Err(error) = load_in(folder.path(), &changed) {
                    assert!(!error.contains("parser failed"), "{at} {value}: {error}");
                }
            }
        }
    }
}

#[test]
fn group_has_the_name_of_the_file() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.ply");
    fs::write(&path, ascii()).expect("written");
    let grouped = load_grouped(&path, &OPTIONS).expect("loads");
    assert_eq!(grouped.groups[0].name, "a");
}
