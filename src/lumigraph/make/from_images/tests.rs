//! Image sets on disk become the lumigraphs that the scene itself gives.

use super::*;
use crate::tests::{Bed, psnr_db, render, unmerged};
use crate::{Lumigraph, LumigraphSettings, Placement};
use glam::{DMat3, DMat4};
use headbox_core::camera::Camera;
use headbox_core::color::srgb8_from_linear;
use headbox_core::file_frame::{FileFrame, UpAxis};
use headbox_core::progress::Silent;
use headbox_images::{DepthPicture, ImageSetOptions};
use headbox_sprite::write_depth_exr;
use headbox_trace::bvh::Ray;
use headbox_trace::truth;
use image::{Rgb, RgbImage};
use proptest::prelude::*;
use serde_json::json;
use std::path::Path;

/// A picture of a set to be: its camera, colours and depths.
struct Shot {
    camera: Camera,
    color: Vec<[u8; 3]>,
    depth: Vec<f32>,
}

/// Axes of nerfstudio's files.
const FRAME: FileFrame = FileFrame {
    up: UpAxis::Z,
    unit_m: 1.0,
};

/// Writes pictures as a set of nerfstudio's.
fn write(folder: &Path, shots: &[Shot]) {
    let frames: Vec<_> = shots.iter().enumerate().map(|(i, shot)| {
        let [width, height] = [shot.camera.width(), shot.camera.height()];
        let (color, depth) = (format!("{i:03}.png"), format!("{i:03}.exr"));
        let pixel = |x: u32, y: u32| Rgb(shot.color[(y * width + x) as usize]);
        RgbImage::from_fn(width, height, pixel).save(folder.join(&color)).expect("written");
        let values = shot.depth.clone();
        write_depth_exr(&DepthPicture { width, height, values }, &folder.join(&depth)).expect("written");
        let turn = shot.camera.world_from_eye();
        let axis = |axis| FRAME.file_from_world(axis).extend(0.0);
        let eye = FRAME.file_from_world(shot.camera.eye()).extend(1.0);
        let matrix = DMat4::from_cols(axis(turn.x_axis), axis(turn.y_axis), axis(turn.z_axis), eye);
        let [cx, cy] = shot.camera.principal_px();
        json!({
            "file_path": color, "depth_file_path": depth, "transform_matrix": matrix.transpose().to_cols_array_2d(),
            "w": width, "h": height, "fl_x": shot.camera.focal_px(), "fl_y": shot.camera.focal_px(), "cx": cx, "cy": cy,
        })
    }).collect();
    let set = json!({"camera_model": "PINHOLE", "frames": frames});
    std::fs::write(folder.join("transforms.json"), set.to_string()).expect("written");
}

/// Builds a lumigraph from images.
fn made_of(shots: &[Shot]) -> Result<FromImages, FromImagesError> {
    with(shots, |_| {})
}

/// Builds a lumigraph from a changed set.
fn with(shots: &[Shot], change: impl FnOnce(&mut ImageSet)) -> Result<FromImages, FromImagesError> {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), shots);
    let mut set = ImageSet::open(folder.path(), &ImageSetOptions::default()).expect("a set");
    change(&mut set);
    RawLumigraph::from_images(&set, &Silent)
}

fn refused(shots: &[Shot]) -> String {
    made_of(shots).expect_err("refused").to_string()
}

/// The images of a scene as pictures of a set.
fn shots_of(raw: &RawLumigraph) -> Vec<Shot> {
    let columns = raw.grid().columns().len();
    let shot = |(i, picture): (usize, &RawPicture)| Shot {
        camera: raw.grid().camera(i % columns, i / columns),
        color: picture.color.clone(),
        depth: picture.disparity.iter().map(|d| 1.0 / d).collect(),
    };
    raw.pictures.iter().enumerate().map(shot).collect()
}

/// A plate with a dome on it before the sky, seen from 4x3 places that are unevenly spaced.
fn plate() -> Bed {
    let scene = headbox_scenes::build("bump", 0).expect("built in");
    Bed::of(
        scene,
        DVec3::new(0.0, 0.0, 9.0),
        vec![-0.5, -0.1, 0.2, 0.5],
        vec![-0.3, 0.1, 0.3],
        [97, 64],
    )
}

#[test]
fn images_give_same_lumigraph_as_scene() {
    let raw = plate().raw();
    let mut shots = shots_of(&raw);
    let sky = raw
        .pictures
        .iter()
        .flat_map(|p| &p.disparity)
        .filter(|d| **d == 0.0)
        .count();
    assert!(sky > 100, "there is sky to be told from surfaces");
    // In whatever order they were taken.
    shots.rotate_left(5);
    shots.swap(0, 7);
    let FromImages { raw: found, notes } = made_of(&shots).expect("a grid");
    assert!(notes.is_empty(), "{notes:?}");
    let (a, b) = (found.grid(), raw.grid());
    assert_eq!(a.size_px(), b.size_px());
    let off = |a: &[f64], b: &[f64]| {
        a.iter()
            .zip(b)
            .map(|(a, b)| (a - b).abs())
            .fold((a.len() - b.len()) as f64, f64::max)
    };
    assert!(
        off(a.columns(), b.columns()).max(off(a.rows(), b.rows())) < 1e-9,
        "{:?} {:?}",
        a.columns(),
        a.rows()
    );
    assert!(a.origin().distance(b.origin()) < 1e-9 && (a.focal_px() - b.focal_px()).abs() < 1e-9);
    assert!((a.convergence() - b.convergence()).abs() < 1e-9);
    assert!(
        (a.world_from_eye() - b.world_from_eye())
            .to_cols_array()
            .iter()
            .all(|v| v.abs() < 1e-9)
    );
    for (a, b) in found.pictures.iter().zip(&raw.pictures) {
        assert!(a.color == b.color, "colours to the last bit");
        let differs = |(a, b): (&f32, &f32)| (a - b).abs() > 1e-6 * b;
        assert!(!a.disparity.iter().zip(&b.disparity).any(differs));
    }
    let layered = |raw: &RawLumigraph| raw.layered(60, Placement::Histogram).expect("layered");
    let (a, b) = (layered(&found), layered(&raw));
    assert_eq!(a.layers().len(), b.layers().len());
    let pairs = a
        .pictures()
        .iter()
        .zip(b.pictures())
        .flat_map(|(a, b)| a.index.iter().zip(&b.index));
    let others = pairs.filter(|(a, b)| a != b).count();
    // Where a layer ends at a pixel's own disparity, rounding may put it into the next.
    assert!(others * 2000 < 12 * 97 * 64, "{others} other layers");
}

/// A picture of a bed by a camera, of a smooth texture on its surfaces.
fn smooth(bed: &Bed, camera: Camera) -> Shot {
    let pixels = (0..camera.height()).flat_map(|y| (0..camera.width()).map(move |x| (x, y)));
    let pixel = |(x, y)| {
        let direction = camera.direction(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let origin = (camera.eye() - bed.tracer.origin()).as_vec3();
        let ray = Ray {
            origin,
            direction: direction.as_vec3(),
            t_min: 0.0,
            t_max: f32::INFINITY,
        };
        let depth = bed.tracer.closest(&ray).map_or(f32::INFINITY, |hit| hit.t);
        if depth == f32::INFINITY {
            return ([60, 90, 200], depth);
        }
        let point = camera.eye() + direction * f64::from(depth);
        let level = |at: f64| srgb8_from_linear(0.5 + 0.4 * (2.0 * at).sin() as f32);
        (
            [level(point.x), level(point.y), level(point.x + point.z)],
            depth,
        )
    };
    let (color, depth) = pixels.map(pixel).unzip();
    Shot {
        camera,
        color,
        depth,
    }
}

#[test]
fn other_lenses_give_same_images() {
    let bed = Bed::new(vec![-0.5, 0.1, 0.5], vec![-0.3, 0.3], [120, 90]);
    // The grid as a whole is turned about where it looks, and each camera in its own way, by up to
    // some ten degrees.
    let shots: Vec<Shot> = (0..6)
        .map(|i| {
            let straight = bed.grid.camera(i % 3, i / 3);
            let own = |k: f64| (k + 2.3 * i as f64).sin() * 0.15;
            let turn = straight.world_from_eye()
                * DMat3::from_rotation_x(own(0.0))
                * DMat3::from_rotation_y(own(1.0))
                * DMat3::from_rotation_z(0.2 + own(2.0));
            let focal_px = straight.focal_px() * (1.0 + 0.05 * i as f64);
            smooth(
                &bed,
                Camera::from_parts(straight.eye(), turn, focal_px, 160, 140).expect("valid"),
            )
        })
        .collect();
    let FromImages { raw, .. } = made_of(&shots).expect("a grid");
    let (mut pixels, mut off, mut known) = (0usize, 0usize, 0usize);
    for (i, picture) in raw.pictures.iter().enumerate() {
        let expected = smooth(&bed, raw.grid().camera(i % 3, i / 3));
        for ((color, disparity), (expected, depth)) in picture
            .color
            .iter()
            .zip(&picture.disparity)
            .zip(expected.color.iter().zip(&expected.depth))
        {
            pixels += 1;
            if disparity.is_nan() {
                continue;
            }
            known += 1;
            let is_far = (disparity * depth - 1.0).abs() > 0.002;
            // Bilinear between pixels of a texture of waves that are some fifty pixels long.
            off += usize::from(is_far || (0..3).any(|c| color[c].abs_diff(expected[c]) > 3));
        }
    }
    assert!(known * 3 > pixels, "{known} of {pixels} pixels are known");
    // At silhouettes the nearest pixel decides.
    assert!(off * 50 < known, "{off} of {known} are off");
}

#[test]
fn uneven_grid_frames_match_scene_quality() {
    let bed = Bed::new(
        vec![-0.5, -0.2, 0.05, 0.5],
        vec![-0.4, 0.0, 0.1, 0.4],
        [160, 160],
    );
    let raw = bed.raw();
    let of_pictures = made_of(&shots_of(&raw)).expect("a grid").raw;
    let eye = bed.grid.origin() + DVec3::new(0.13, 0.07, 0.4);
    let camera = Camera::look_at(eye, eye - DVec3::Z, DVec3::Y, 36.0, [128, 128]).expect("valid");
    let truth = truth::render(&bed.tracer, &bed.lighting, false, &camera, 64, &Silent).frame;
    let settings = unmerged();
    let [found, scenes] = [&of_pictures, &raw].map(|raw| {
        let lumigraph = raw.layered(255, Placement::Histogram).expect("layered");
        psnr_db(&render(&lumigraph, &camera, &settings).color, &truth.color)
    });
    assert!(
        found > 23.0 && (found - scenes).abs() < 0.05,
        "{found} and {scenes} dB"
    );
}

#[test]
fn unknown_pixels_filled_from_others_or_hole() {
    let bed = Bed::new(vec![-0.3, 0.0, 0.3], vec![0.0], [120, 90]);
    let mut shots = shots_of(&bed.raw());
    let centre = |i: usize| (40..50).contains(&(i / 120)) && (50..62).contains(&(i % 120));
    shots[1]
        .depth
        .iter_mut()
        .enumerate()
        .filter(|(i, _)| centre(*i))
        .for_each(|(_, depth)| *depth = f32::NAN);
    let lumigraph_of = |shots: &[Shot]| {
        let raw = made_of(shots).expect("a grid").raw;
        let mut lumigraph = raw.layered(255, Placement::Histogram).expect("layered");
        lumigraph.environment = Environment {
            size_px: 2,
            texels: vec![[255, 0, 255, 255]; 24],
        };
        lumigraph
    };
    let known = lumigraph_of(&shots_of(&bed.raw()));
    let partly = lumigraph_of(&shots);
    assert_eq!((known.unknown_pixels(), partly.unknown_pixels()), (0, 120));
    let camera = bed.grid.camera(1, 0);
    let frames = |lumigraph: &Lumigraph| {
        let fast = render(lumigraph, &camera, &LumigraphSettings::default());
        let slow = crate::render_by_rays(lumigraph, &camera, &LumigraphSettings::default());
        assert!(psnr_db(&fast.color, &slow.color) > 45.0);
        fast
    };
    let (expected, found) = (frames(&known), frames(&partly));
    assert_eq!(
        found.hole_count(),
        expected.hole_count(),
        "its neighbours see it"
    );
    assert!(psnr_db(&expected.color, &found.color) > 25.0);
    // Files keep what is not known, also where it needs a second byte.
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.lumi");
    for count in [9, 255, 256] {
        let lumigraph = made_of(&shots)
            .expect("a grid")
            .raw
            .layered(count, Placement::Uniform)
            .expect("layered");
        lumigraph.write(&path).expect("written");
        let back = Lumigraph::read(&path).expect("read");
        assert_eq!(
            (back.pictures(), back.unknown_pixels()),
            (lumigraph.pictures(), 120)
        );
        assert_eq!(
            back.index_bytes(),
            if lumigraph.layers().len() < 255 { 1 } else { 2 }
        );
    }
    // One camera, which alone does not know it: no sky is shown there.
    let alone = lumigraph_of(&shots[1..2]);
    let hole = frames(&alone);
    let holes = hole.hole_count();
    assert!(holes.abs_diff(120) <= 30, "{holes}");
    assert!(!hole.color.contains(&[255, 0, 255, 255]));
}

/// Small pictures of a wall 2 m before some places, looking straight or turned.
fn wall_from(places: &[DVec3], turn: DMat3) -> Vec<Shot> {
    let shot = |eye: &DVec3| {
        let camera = Camera::from_parts(*eye, turn, 20.0, 16, 12).expect("valid");
        let pixels =
            (0..12).flat_map(|y| (0..16).map(move |x| [f64::from(x) + 0.5, f64::from(y) + 0.5]));
        let depth = pixels.map(|[x, y]| ((-2.0 - eye.z) / camera.direction(x, y).z) as f32);
        Shot {
            camera,
            color: vec![[90; 3]; 16 * 12],
            depth: depth.collect(),
        }
    };
    places.iter().map(shot).collect()
}

fn places(columns: &[f64], rows: &[f64]) -> Vec<DVec3> {
    rows.iter()
        .flat_map(|y| columns.iter().map(|x| DVec3::new(*x, *y, 0.0)))
        .collect()
}

#[test]
fn sets_without_grid_are_refused() {
    let full = places(&[0.0, 0.2, 0.5], &[0.0, 0.3]);
    let straight = |places: &[DVec3]| wall_from(places, DMat3::IDENTITY);
    assert!(made_of(&straight(&full)).is_ok());
    let without: Vec<DVec3> = full
        .iter()
        .copied()
        .filter(|p| *p != DVec3::new(0.5, 0.3, 0.0))
        .collect();
    let said = refused(&straight(&without));
    // The file's axes have Z up.
    assert!(
        said.contains("5 cameras stand in 3 columns and 2 rows")
            && said.contains("0.500,-0.000,0.300"),
        "{said}"
    );
    let mut moved = full.clone();
    moved[4].z = 0.1;
    let said = refused(&straight(&moved));
    assert!(
        said.contains("004.png") && said.contains("off the plane") && said.contains("leave it out"),
        "{said}"
    );
    (moved[4].z, moved[4].x) = (0.0, 0.32);
    let said = refused(&straight(&moved));
    assert!(
        said.contains("4 columns and 2 rows, but none where these cross at"),
        "{said}"
    );
    moved[4] = moved[3];
    let said = refused(&straight(&moved));
    assert!(
        said.contains("003.png and 004.png were taken from the same place"),
        "{said}"
    );
    let said = refused(&wall_from(&full, DMat3::from_rotation_x(1.2)));
    assert!(said.contains("000.png looks 69 degrees away"), "{said}");
    let mut set = straight(&full);
    set[2].camera =
        Camera::from_parts(full[2], DMat3::from_rotation_y(2.0), 20.0, 16, 12).expect("valid");
    assert!(refused(&set).contains("002.png looks"));
    let said = |change: fn(&mut ImageSet)| {
        with(&straight(&full), change)
            .expect_err("refused")
            .to_string()
    };
    assert!(said(|set| set.views.clear()).contains("at least one camera"));
    assert!(said(|set| set.views[3].depth = None).contains("003.png has no depth"));
    assert!(
        said(|set| set.views[1].lens = Lens::Equirectangular).contains("001.png is a panorama")
    );
    assert!(said(|set| set.views[1].color = "nowhere.png".into()).contains("nowhere.png"));
}

#[test]
fn camera_offset_below_visibility_accepted() {
    // Something at 1 m before a wall at 2 m: half a unit of disparity, 20 px of focal length.
    let near = |places: &[DVec3]| {
        let mut shots = wall_from(places, DMat3::IDENTITY);
        shots
            .iter_mut()
            .for_each(|shot| shot.depth[100..104].fill(1.0));
        shots
    };
    let full = places(&[0.0, 1.0, 2.0], &[0.0, 1.0]);
    let off = |by: f64| {
        let mut moved = full.clone();
        moved[1].y += by;
        made_of(&near(&moved))
    };
    // Parallel images: a pixel is 1 / (20 * 1).
    assert!(off(0.09).is_ok(), "its row goes between its cameras");
    let said = off(0.14).expect_err("refused").to_string();
    assert!(
        said.contains("displaced by a pixel") && said.contains("0.05"),
        "{said}"
    );
}

#[test]
fn rows_columns_and_single_cameras_are_grids() {
    for (columns, rows) in [
        (vec![0.0], vec![0.0]),
        (vec![0.0, 0.1, 0.4], vec![0.0]),
        (vec![0.0], vec![0.0, 0.3]),
    ] {
        let FromImages { raw, .. } =
            made_of(&wall_from(&places(&columns, &rows), DMat3::IDENTITY)).expect("a grid");
        assert_eq!(
            (raw.grid().columns().len(), raw.grid().rows().len()),
            (columns.len(), rows.len())
        );
        assert!(
            (raw.grid().world_from_eye() - DMat3::IDENTITY)
                .to_cols_array()
                .iter()
                .all(|v| v.abs() < 1e-9)
        );
        assert_eq!(raw.grid().size_px(), [16, 12]);
        let [min, max] = raw.range().expect("a wall");
        assert!((min - 0.5).abs() < 1e-6 && (max - 0.5).abs() < 1e-6);
    }
    let one_behind_the_other = [DVec3::ZERO, DVec3::Z * 0.3, DVec3::Z];
    let said = refused(&wall_from(&one_behind_the_other, DMat3::IDENTITY));
    assert!(said.contains("000.png looks 90 degrees away"), "{said}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn any_grid_is_found_however_it_stands(
        gaps in proptest::collection::vec(0.2..3.0f64, 0..5), up_gaps in proptest::collection::vec(0.2..3.0f64, 1..5),
        turn in proptest::array::uniform3(-3.0..3.0f64), roll in -0.7..0.7f64, noise in 0.0..0.01f64, seed in 0u32..1000,
    ) {
        let from_gaps = |gaps: &[f64]| gaps.iter().scan(0.0, |at, gap| { *at += gap; Some(*at) }).collect::<Vec<f64>>();
        let (columns, rows) = ([vec![0.0], from_gaps(&gaps)].concat(), [vec![0.0], from_gaps(&up_gaps)].concat());
        let grid = DMat3::from_rotation_x(turn[0]) * DMat3::from_rotation_y(turn[1]) * DMat3::from_rotation_z(turn[2]);
        let mut random = headbox_core::random::Rng::keyed(u64::from(seed));
        let mut shake = || noise * (2.0 * random.below(1000) as f64 / 999.0 - 1.0);
        let mut stands = Vec::new();
        for y in &rows {
            for x in &columns {
                let eye = DVec3::new(100.0, -3.0, 7.0) + grid * DVec3::new(x + shake(), y + shake(), shake());
                let world_from_eye = grid * DMat3::from_rotation_z(roll) * DMat3::from_rotation_x(0.2);
                stands.push(CameraPose { name: "", pose: headbox_images::Pose { eye, world_from_eye } });
            }
        }
        stands.reverse();
        let found = find_grid(&stands, &FRAME).expect("a grid");
        prop_assert_eq!((found.columns.len(), found.rows.len()), (columns.len(), rows.len()));
        let count = stands.len();
        let gaps_of = |places: &[f64]| places.windows(2).map(|pair| pair[1] - pair[0]).collect::<Vec<f64>>();
        for (a, b) in gaps_of(&found.columns).iter().zip(&gaps).chain(gaps_of(&found.rows).iter().zip(&up_gaps)) {
            prop_assert!((a - b).abs() <= 1e-9 + 6.0 * noise, "{a} {b}");
        }
        prop_assert!(found.cameras.iter().enumerate().all(|(place, camera)| *camera == count - 1 - place));
        prop_assert!(found.off_m.iter().all(|off| *off <= 1e-9 + 6.0 * noise));
    }
}
