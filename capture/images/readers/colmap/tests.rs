//! Tests of COLMAP's layouts, on folders of tiny images.

use crate::Lens;
use crate::readers::tests::{folder, open};

#[test]
fn largest_model_read_and_others_named() {
    let cameras = "1 PINHOLE 8 6 5 5 4 3\n";
    let files = [
        ("sparse/0/cameras.txt", cameras),
        ("sparse/0/images.txt", "1 1 0 0 0 0 0 0 1 a.png\n"),
        ("sparse/1/cameras.txt", cameras),
        (
            "sparse/1/images.txt",
            "1 1 0 0 0 0 0 0 1 a.png\n2 1 0 0 0 nan 0 0 1 b.png\n3 1 0 0 0 0 0 1 1 c.PNG\n",
        ),
    ];
    let folder = folder(
        &files,
        &["images/a.png", "images/b.png", "images/c.png"],
        &[],
    );
    let set = open(folder.path());
    assert_eq!(set.views.len(), 2);
    let notes = set.notes.join("\n");
    assert!(notes.contains("read sparse/1 with 3 images"), "{notes}");
    assert!(notes.contains("sparse/0 with 1 images"), "{notes}");
    assert!(notes.contains("left out 1 of 3 frames: b.png"), "{notes}");
}

#[test]
fn model_beside_numbered_ones_considered() {
    let camera = "1 PINHOLE 8 6 5 5 4 3\n";
    let files = [
        ("sparse/cameras.txt", camera),
        (
            "sparse/images.txt",
            "1 1 0 0 0 0 0 0 1 a.png\n2 1 0 0 0 0 0 1 1 b.png\n",
        ),
        ("sparse/0/cameras.txt", camera),
        ("sparse/0/images.txt", "1 1 0 0 0 0 0 0 1 a.png\n"),
    ];
    let folder = folder(&files, &["images/a.png", "images/b.png"], &[]);
    let set = open(folder.path());
    assert_eq!(set.views.len(), 2);
    assert!(
        set.notes.join("\n").contains("read sparse with 2 images"),
        "{:?}",
        set.notes
    );
}

#[test]
fn unusable_camera_leaves_out_its_images() {
    for camera in [
        "FANCY 8 6 5",
        "PINHOLE 8 6 0 5 4 3",
        "PINHOLE 8 6 nan 5 4 3",
    ] {
        let cameras = format!("\u{feff}1 PINHOLE 8 6 5 5 4 3\n2 {camera}\n");
        let files = [
            ("sparse/cameras.txt", cameras.as_str()),
            (
                "sparse/images.txt",
                "1 1 0 0 0 0 0 0 1 a.png\n2 1 0 0 0 0 0 1 2 b.png\n",
            ),
        ];
        let folder = folder(&files, &["images/a.png", "images/b.png"], &[]);
        let set = open(folder.path());
        let notes = set.notes.join("\n");
        assert_eq!(set.views.len(), 1, "{notes}");
        assert!(
            notes.contains("left out 1 of 2 frames: b.png (camera 2 has"),
            "{notes}"
        );
    }
}

/// One image, taken from the origin.
const ONE: &str = "1 1 0 0 0 0 0 0 1 a.png\n";

#[test]
fn depth_of_a_dense_workspace_is_found_or_named() {
    let cameras = "1 PINHOLE 8 6 5 5 4 3\n";
    let files = |sparse: &[&str]| {
        let files = sparse.iter().flat_map(|folder| {
            let file = |name: &str| format!("{folder}/{name}.txt");
            [(file("cameras"), cameras), (file("images"), ONE)]
        });
        files.collect::<Vec<_>>()
    };
    let maps = "dense/0/stereo/depth_maps/a.png.geometric.bin";
    let opened = |sparse: &[&str]| {
        let mut files = files(sparse);
        files.push((maps.to_owned(), "depth"));
        let files: Vec<(&str, &str)> = files.iter().map(|(path, text)| (&**path, *text)).collect();
        open(folder(&files, &["images/a.png", "dense/0/images/a.png"], &[]).path())
    };
    let set = opened(&["sparse/0", "dense/0/sparse"]);
    assert_eq!(set.views_with_depth().count(), 0);
    assert!(set.notes.join("\n").contains("dense/0"), "{:?}", set.notes);
    let set = opened(&["dense/0/sparse"]);
    assert_eq!(set.views_with_depth().count(), 1);
    assert!(set.views[0].color.ends_with("dense/0/images/a.png"));
    assert!(!set.notes.join("\n").contains("dense/0"), "{:?}", set.notes);
}

#[test]
fn lenses_are_scaled_to_resized_images() {
    // Images have 8x6 pixels.
    for (camera, focal) in [
        ("1 PINHOLE 32 24 20 20 16 12\n", 5.0),
        ("1 PINHOLE 8 6 5 5 4 3\n", 5.0),
    ] {
        let files = [
            ("sparse/0/cameras.txt", camera),
            ("sparse/0/images.txt", ONE),
        ];
        let folder = folder(&files, &["images_4/a.png"], &[]);
        let set = open(folder.path());
        let view = &set.views[0];
        let Lens::Pinhole(lens) = view.lens else {
            panic!("{:?}", view.lens);
        };
        assert_eq!((view.size_px, lens.focal_px), ([8, 6], [focal; 2]));
        assert_eq!(lens.principal_px, [4.0, 3.0]);
        let is_noted = set.notes.join("\n").contains("8x6 pixels for 32x24");
        assert_eq!(is_noted, camera.contains("32"), "{:?}", set.notes);
        assert!(view.load().is_ok());
    }
}
