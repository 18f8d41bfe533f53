//! Real files: number of triangles, notes and size.

use headbox_core::file_frame::UpAxis;
use headbox_model::load::load_scene as load;
use headbox_scene::load::LoadOptions;
use headbox_scene::scene::Scene;
use std::path::PathBuf;

/// Loads a file of the folder of real data; `None` if it is absent.
fn real(relative: &str, options: &LoadOptions) -> Option<Scene> {
    let path = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data")).join(relative);
    if !path.is_file() {
        println!("skipped: {relative} is absent");
        return None;
    }
    let scene = load(&path, options).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(scene.validate(), Ok(()));
    Some(scene)
}

/// Checks the number of triangles and textures, the notes, and the size in metres.
fn check(
    relative: &str,
    options: LoadOptions,
    triangles: usize,
    textures: usize,
    notes: &[&str],
    size_m: [f64; 3],
) {
    let Some(scene) = real(relative, &options) else {
        return;
    };
    assert_eq!(scene.triangles.len(), triangles, "{relative}");
    assert_eq!(scene.textures.len(), textures, "{relative}");
    assert_eq!(scene.summary.notes, notes, "{relative}");
    let [low, high] = scene.bounds();
    for (size, expected) in (high - low).to_array().into_iter().zip(size_m) {
        assert!(
            (size - expected).abs() < 0.01,
            "{relative}: {size} m, expected {expected} m"
        );
    }
}

const Z_UP: LoadOptions = LoadOptions {
    up: Some(UpAxis::Z),
    unit_m: Some(1.0),
};
const Y_UP: LoadOptions = LoadOptions {
    up: Some(UpAxis::Y),
    unit_m: Some(1.0),
};

#[test]
fn small_house() {
    let notes = [
        "2 materials without map_d, with holes where the alpha of map_Kd is below one half: \
         aws_robomaker_residential_Door_01_Material__27, \
         aws_robomaker_residential_Vase_01_MaterialFBXASC032FBXASC03538",
        "4 degenerate triangles left out",
        "124 triangles in one plane with another of a different material, of which the one that \
         faces the viewer is shown, or else the later one in the file",
    ];
    check(
        "small_house/small_house.obj",
        Z_UP,
        145_844 - 4,
        83,
        &notes,
        [19.0, 3.0, 11.4],
    );
}

#[test]
fn apartment() {
    let notes = [
        "202 degenerate triangles left out",
        "1749 triangles with an opacity of one half or less left out",
        "40 duplicate triangles kept",
        "2582 triangles in one plane with another of a different material, of which the one that \
         faces the viewer is shown, or else the later one in the file",
    ];
    let centimetres = LoadOptions {
        up: Some(UpAxis::Y),
        unit_m: Some(0.01),
    };
    check(
        "apartment/home.obj",
        centimetres,
        91_875 - 202 - 1749,
        0,
        &notes,
        [11.56, 2.5, 9.07],
    );
}

#[test]
fn willowgarage() {
    let notes = [
        "252 degenerate triangles left out",
        "6727 duplicate triangles kept",
        "11890 triangles in one plane with another of a different material, of which the one that \
         faces the viewer is shown, or else the later one in the file",
    ];
    check(
        "willowgarage/willowgarage.obj",
        Z_UP,
        13_839 - 252,
        7,
        &notes,
        [58.63, 2.84, 48.62],
    );
}

#[test]
fn medieval_building() {
    let notes = [
        "112 degenerate triangles left out",
        "92 triangles in one plane with another of a different material, of which the one that \
         faces the viewer is shown, or else the later one in the file",
    ];
    check(
        "medieval_building/Medieval_building.obj",
        Y_UP,
        16_715 - 112,
        7,
        &notes,
        [4.11, 4.35, 3.76],
    );
}

#[test]
fn cornell_box() {
    // The faces of the light and of the front wall are commented out in the file, and with them the
    // light of `Ka 20`.
    let millimetres = LoadOptions {
        up: None,
        unit_m: Some(0.001),
    };
    check(
        "cornell_box/cornell_box.obj",
        millimetres,
        34,
        0,
        &["2 groups without faces"],
        [0.556, 0.549, 0.559],
    );
}

#[test]
fn trees_have_cut_out_leaves() {
    for (i, triangles) in [(1, 646), (2, 646), (3, 412), (4, 368)] {
        let Some(scene) = real(&format!("trees/tree_{i}/tree_{i}.obj"), &Y_UP) else {
            return;
        };
        assert_eq!(scene.triangles.len(), triangles);
        assert_eq!(scene.summary.notes, Vec::<String>::new());
        for material in &scene.materials {
            assert_eq!(
                material.cutout.is_some(),
                material.name.starts_with("branch"),
                "{}",
                material.name
            );
            if let Some(cutout) = material.cutout {
                assert_eq!(
                    cutout.texture, material.albedo_texture,
                    "the same image gives colour and alpha"
                );
            }
        }
    }
}
