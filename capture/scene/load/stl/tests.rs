use crate::load::{LoadOptions, load};
use crate::scene::Scene;
use glam::dvec3;
use headbox_core::file_frame::UpAxis;
use std::fs;

const OPTIONS: LoadOptions = LoadOptions {
    up: Some(UpAxis::Y),
    unit_m: Some(1.0),
};

const ASCII: &str = "solid a part\n facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n   \
    vertex 1 0 0\n   vertex 0 1e0 0\n  endloop\n endfacet\nendsolid a part\n";

/// Two triangles after a header that begins with `solid`.
fn binary(attribute: u16) -> Vec<u8> {
    let mut bytes = b"solid written by a program".to_vec();
    bytes.resize(80, b' ');
    bytes.extend(2_u32.to_le_bytes());
    for z in [0.0_f32, 1.0] {
        for number in [0.0, 0.0, 1.0, 0.0, 0.0, z, 1.0, 0.0, z, 0.0, 1.0, z] {
            bytes.extend(number.to_le_bytes());
        }
        bytes.extend(attribute.to_le_bytes());
    }
    bytes
}

fn load_bytes(bytes: &[u8]) -> Result<Scene, String> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.stl");
    fs::write(&path, bytes).expect("written");
    let scene = load(&path, &OPTIONS).map_err(|error| error.to_string())?;
    assert_eq!(scene.validate(), Ok(()));
    Ok(scene)
}

#[test]
fn both_forms_are_read() {
    let upper = ASCII.to_uppercase().replace('\n', "\r\n");
    let one_line = ASCII.replace('\n', " ");
    for text in [ASCII, &upper, &one_line] {
        let scene = load_bytes(text.as_bytes()).expect("loads");
        assert_eq!(scene.corners(0)[2], dvec3(0.0, 1.0, 0.0));
        assert_eq!((scene.triangles.len(), scene.summary.notes.len()), (1, 0));
    }
    let scene = load_bytes(&binary(0)).expect("loads");
    assert_eq!(scene.corners(1)[2], dvec3(0.0, 1.0, 1.0));
    assert_eq!((scene.triangles.len(), scene.summary.notes.len()), (2, 0));
}

#[test]
fn colours_and_trailing_bytes_are_reported() {
    let mut bytes = binary(0x8123);
    bytes[40..46].copy_from_slice(b"COLOR=");
    bytes[46] = 0;
    bytes.push(0);
    let expected = [
        "3 colours in the header or the attributes of an STL left out; save as PLY to keep colours",
        "1 byte after the last triangle skipped",
    ];
    assert_eq!(load_bytes(&bytes).expect("loads").summary.notes, expected);
}

#[test]
fn damaged_files_are_refused_with_the_cause() {
    let mut huge = binary(0);
    huge[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
    huge[30] = 0;
    let comma = ASCII.replace("1e0", "0,5");
    let cut = &ASCII[..ASCII.len() / 2];
    for (bytes, cause) in [
        (
            huge.as_slice(),
            "declares 4294967295 triangles, which need 214748364834 bytes",
        ),
        (b"short", "not an STL"),
        (
            comma.as_bytes(),
            "line 6: \"vertex 0 0,5 0\" is not a vertex: three numbers; it has a",
        ),
        (cut.as_bytes(), "a.stl"),
    ] {
        let error = load_bytes(bytes).expect_err("damaged");
        assert!(error.contains("a.stl") && error.contains(cause), "{error}");
    }
}

#[test]
fn truncated_and_changed_files_never_panic() {
    for bytes in [binary(1), ASCII.as_bytes().to_vec()] {
        for end in 0..bytes.len() {
            if let Err(error) = load_bytes(&bytes[..end]) {
                assert!(!error.contains("parser failed"), "{end}: {error}");
            }
        }
        for at in 0..bytes.len() {
            for value in [0, b'9', b'\n', 255] {
                let mut changed = bytes.clone();
                changed[at] = value;
                if let Err(error) = load_bytes(&changed) {
                    assert!(!error.contains("parser failed"), "{at} {value}: {error}");
                }
            }
        }
    }
}
